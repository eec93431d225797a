"""Temporary files beside an output: each names its process, so that those of killed ones can be removed."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


def temporary_beside(target: Path, suffix: str = "") -> str:
    """Path of a new empty file in the target's folder; leftovers of killed processes for it are removed."""
    name = temporary_name(target, suffix)
    create_new(name)
    return name


def temporary_name(target: Path, suffix: str = "") -> str:
    """Path of a file in the target's folder that is not there yet; leftovers of killed processes are removed.

    Who creates the file within a `try` that removes it leaves nothing, at whatever moment a signal comes.
    """
    beginning = f".{target.name.removesuffix(suffix)}-{_host()}-"
    _remove_leftovers(target.parent, beginning)
    return str(target.parent / f"{beginning}{os.getpid()}-{os.urandom(4).hex()}{suffix}")


def create_new(path: str) -> None:
    """Create an empty file that only its owner reads; OSError where there is one already."""
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))


def _host() -> str:
    """Name of this machine: process numbers of another one, on a shared disk, say nothing here."""
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
