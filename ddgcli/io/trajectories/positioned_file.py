"""Reads and writes at places of a file, on every system (Windows has neither `os.pread` nor `os.pwrite`)."""

from __future__ import annotations

import os
from io import FileIO

from ddgcli.errors import OutputError


class PositionedFile:
    """A file that is read and written at places, by one thread.

    Windows renames no open file and replaces none: close it before, and `reopen` it under its new name.

    Parameters
    ----------
    path : str
    create : bool
        Make it empty first.
    """

    def __init__(self, path: str, *, create: bool = False) -> None:
        self.path = path
        self._file: FileIO | None = FileIO(path, "w+" if create else "r+")
        self._identity = _identity(os.fstat(self._file.fileno()))

    def read(self, n_bytes: int, offset: int) -> bytes:
        """Bytes from an offset on, fewer at the end of the file."""
        file = self._open_file()
        file.seek(offset)
        return file.read(n_bytes)

    def write(self, data: bytes, offset: int) -> None:
        """Put bytes at an offset; OutputError where the disk does not take them."""
        file, view = self._open_file(), memoryview(data)
        try:
            file.seek(offset)
            while len(view):
                view = view[file.write(view) :]
        except OSError as error:
            raise OutputError(
                f"{self.path}: cannot be written ({error.strerror}); free some disk space"
            ) from error

    def truncate(self, n_bytes: int) -> None:
        """Set the length."""
        self._open_file().truncate(n_bytes)

    def sync(self) -> None:
        """Flush everything to the disk."""
        os.fsync(self._open_file().fileno())

    def is_at(self, path: str) -> bool:
        """Whether this file, open or closed, is the one at a path."""
        try:
            return _identity(os.stat(path)) == self._identity
        except OSError:
            return False

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def reopen(self, path: str) -> None:
        """Open the closed file at its present path; it stays closed if another file is there."""
        self.path = path
        try:
            self._file = FileIO(path, "r+")
        except FileNotFoundError:
            return
        if _identity(os.fstat(self._file.fileno())) != self._identity:
            self.close()

    def _open_file(self) -> FileIO:
        if self._file is None:
            raise OutputError(f"{self.path}: another run took this place; give each run its own output")
        return self._file


def _identity(status: os.stat_result) -> tuple[int, int]:
    return status.st_ino, status.st_dev
