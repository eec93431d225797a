"""Folders for the inputs of a trial."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


def scratch_folder() -> Path:
    """A folder in memory where there is one: opening a file on a disk costs more than reading it."""
    memory = "/dev/shm"
    return Path(tempfile.mkdtemp(prefix="ddgcli-fuzz-", dir=memory if os.path.isdir(memory) else None))
