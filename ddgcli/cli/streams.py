"""Standard streams that were closed before the program started (`ddgcli ... >&-`)."""

from __future__ import annotations

import io
import os
import sys


def occupy_closed_streams() -> None:
    """Open the null device in the place of each closed standard stream.

    Else the next file that is opened takes its number, and what a library prints ends in that file. Where
    standard input or output is closed, `sys.stdin` or `sys.stdout` stays None, so that `-` is refused.
    """
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number: this one
    if sys.stderr is None:
        sys.stderr = io.TextIOWrapper(io.FileIO(2, "w", closefd=False), "utf-8", "replace")
