"""Folders for the inputs of a trial."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

MEMORY = "/dev/shm"  # opening a file on a disk costs more than reading it
_created: list[tuple[int, Path]] = []  # process and folder


def scratch_folder() -> Path:
    """A folder in memory where there is one."""
    folder = Path(tempfile.mkdtemp(prefix="ddgcli-fuzz-", dir=MEMORY if os.path.isdir(MEMORY) else None))
    _created.append((os.getpid(), folder))
    return folder


def remove_scratch_folders() -> None:
    """Remove the folders that this process has created, not those of the process it was forked from."""
    for process, folder in _created:
        if process == os.getpid():
            shutil.rmtree(folder, ignore_errors=True)
    _created[:] = [entry for entry in _created if entry[0] != os.getpid()]
