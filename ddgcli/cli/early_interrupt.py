"""SIGINT before there is anything to clean up."""

from __future__ import annotations

import os
from typing import Any

INTERRUPTED = 128 + 2  # exit code of shells for SIGINT


def end_at_once(number: int, stack_frame: Any) -> None:
    """Handler of SIGINT while modules are imported, where an exception would be lost or printed."""
    try:
        os.write(2, b"Interrupted\n")
    finally:
        os._exit(INTERRUPTED)
