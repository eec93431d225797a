"""Temporary files beside an output: each names its process, so that those of killed ones can be removed."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path


def temporary_beside(target: Path, suffix: str = "") -> str:
    """Path of a new empty file in the target's folder; leftovers of killed processes for it are removed."""
    beginning = f".{target.name.removesuffix(suffix)}-{_host()}-"
    _remove_leftovers(target.parent, beginning)
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f"{beginning}{os.getpid()}-", suffix=suffix)
    os.close(handle)
    return name


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
