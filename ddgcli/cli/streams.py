"""Standard streams that are closed or cannot be written."""

from __future__ import annotations

import io
import os
import sys
from typing import Any


def open_standard_streams() -> None:
    """Replace standard error by a stream that never fails, and reserve the descriptors of closed streams.

    A file opened later would otherwise get the descriptor of a closed stream, and messages would go to it.
    Closed standard input and output stay None, for errors that name them.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free descriptor
    if sys.stderr is None or sys.stderr is sys.__stderr__:
        encoding = "utf-8" if sys.stderr is None else sys.stderr.encoding
        sys.stderr = io.TextIOWrapper(
            io.BufferedWriter(_TolerantFile(2, "wb", closefd=False)),
            encoding=encoding,
            errors="backslashreplace",
            line_buffering=True,
        )


class _TolerantFile(io.FileIO):
    """A file to which messages are written as far as that is possible: without them, the results stand."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data) or len(data)
        except OSError:
            return len(data)
