"""Temporary files beside an output: each names its process, so that those of killed ones can be removed."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from ddgcli.errors import OutputError


class StagedOutputs:
    """Complete files beside their targets, which they replace together: all outputs of a run, or none."""

    def __init__(self) -> None:
        self._files: list[tuple[str, Path]] = []  # temporary path, target
        self._inodes: dict[str, int] = {}  # inode of a temporary path that is never removed
        self._folders: list[Path] = []  # made for them

    def add(self, partial: str, target: Path, *, keep: bool = False) -> None:
        """Hold a complete file until `commit` or `discard`; `keep`: `discard` leaves it where it is."""
        self._files.append((partial, target))
        if keep:
            self._inodes[partial] = os.stat(partial).st_ino

    def make_folder(self, folder: Path) -> None:
        """Make a folder and those above it; `discard` removes them."""
        missing = [path for path in (folder, *folder.parents) if not path.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        self._folders += missing[::-1]

    def commit(self) -> None:
        """Rename every file to its target.

        Raises
        ------
        OutputError
            A file that cannot be renamed; those before it are in place.
        """
        while self._files:
            partial, target = self._files[0]
            if partial in self._inodes and self._inodes[partial] != os.stat(partial).st_ino:
                raise OutputError(f"{partial}: another run took this place; give each run its own output")
            try:
                os.replace(partial, target)
            except OSError as error:
                raise OutputError(f"{target}: cannot be written ({error.strerror or error})") from error
            del self._files[0]
        self._folders.clear()

    def discard(self) -> None:
        """Remove the files that have not replaced their targets, and the empty folders made for them."""
        while self._files:
            with contextlib.suppress(OSError):
                if self._files[-1][0] not in self._inodes:
                    os.unlink(self._files[-1][0])
            del self._files[-1]
        while self._folders:
            with contextlib.suppress(OSError):
                self._folders[-1].rmdir()
            del self._folders[-1]


def temporary_name(target: Path, suffix: str = "") -> str:
    """Path of a file in the target's folder that is not there yet; leftovers of killed processes are removed.

    Create the file within a `try` that removes it: then nothing remains, at whatever moment a signal comes.

    Parameters
    ----------
    target : Path
        The output that the file will replace.
    suffix : str
        End of the name, removed from that of `target` first.

    Returns
    -------
    str
        Hidden; it contains the machine's name and the number of the process.
    """
    beginning = f".{target.name.removesuffix(suffix)}-{_host()}-"
    _remove_leftovers(target.parent, beginning)
    return str(target.parent / f"{beginning}{os.getpid()}-{os.urandom(4).hex()}{suffix}")


def create_new(path: str, *, private: bool) -> None:
    """Create an empty file.

    The system applies the umask: to read the umask is to change it, also for the other threads.

    Parameters
    ----------
    path : str
    private : bool
        Only its owner reads it.

    Raises
    ------
    OSError
        There is one already, or it cannot be created.
    """
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600 if private else 0o666))


def _host() -> str:
    """Name of this machine: process numbers of another one, on a shared disk, mean nothing here."""
    return os.uname().nodename.replace("-", "").replace(os.sep, "") if os.name == "posix" else ""


def _remove_leftovers(folder: Path, beginning: str) -> None:
    if os.name != "posix":  # elsewhere the test for a process would end it
        return
    for name in [entry.name for entry in os.scandir(folder) if entry.name.startswith(beginning)]:
        number = name[len(beginning) :].partition("-")[0]
        if number.isdecimal() and not _is_running(int(number)):
            with contextlib.suppress(OSError):
                os.unlink(folder / name)


def _is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # of another user
        return True
    return True
