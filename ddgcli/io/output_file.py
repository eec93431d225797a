"""Write output files: whole or not at all."""

from __future__ import annotations

import contextlib
import io
import os
import stat
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

from ddgcli.errors import OutputError, StandardOutputError
from ddgcli.io.temporary import StagedOutputs, create_new, temporary_name

FileContent = bytes | memoryview | Callable[[IO[bytes]], Any]


def check_place(path: str, *, inputs: tuple[str, ...] = ()) -> None:
    """Raise an error for an output that cannot be written, or that is one of the inputs.

    Parameters
    ----------
    path : str
    inputs : tuple of str
        Paths that must not be the output's file.

    Raises
    ------
    OutputError
        A folder that is missing or not writable; a folder, pipe or device in the place of the file; an input.
    """
    target = Path(path)
    _check_regular(path)
    if not target.parent.is_dir():
        raise OutputError(f"{path}: folder {target.parent} does not exist; create it")
    if not os.access(target.parent, os.W_OK):
        raise OutputError(f"{path}: folder {target.parent} cannot be written to; choose another")
    for source in inputs:
        if target.exists() and os.path.exists(source) and os.path.samefile(target, source):
            raise OutputError(f"{path}: is the input itself; write to another file")


def _check_regular(path: str) -> None:
    """Raise OutputError for a pipe, socket or device, which an atomic write would replace by a file."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):  # missing or not accessible: writing reports it
        return
    if stat.S_ISDIR(mode):
        raise OutputError(f"{path}: is a folder; name a file in it")
    if not stat.S_ISREG(mode):
        raise OutputError(f"{path}: is a pipe or device, not a file; name a file, or - for standard output")


def write_atomically(path: str, content: FileContent, *, staged: StagedOutputs | None = None) -> None:
    """Write content to a path, all or nothing, or to standard output.

    Parameters
    ----------
    path : str
        `-` is standard output.
    content : bytes, or callable (binary file) -> object
        A function writes to the open file: a large archive is then never whole in memory.
    staged : StagedOutputs, optional
        As for `atomic_output`.

    Raises
    ------
    OutputError
        As for `atomic_output`.
    """
    if path == "-":
        if sys.stdout is None:
            raise OutputError("-: standard output is closed; name a file")
        buffer = io.BytesIO()  # an archive is written with seeks, which a pipe does not support
        write_content(buffer, content)
        try:
            sys.stdout.buffer.write(buffer.getbuffer())
            sys.stdout.buffer.flush()
        except BrokenPipeError:  # the reader has enough
            raise
        except OSError as error:
            raise StandardOutputError(
                f"-: cannot be written ({error.strerror}); the output is cut"
            ) from error
        return
    with atomic_output(path, staged) as temporary, open(temporary, "wb") as file:
        write_content(file, content)


def write_content(file: IO[bytes], content: FileContent) -> None:
    """Write bytes to an open file, or call the function that does."""
    if callable(content):
        content(file)
    else:
        file.write(content)


@contextlib.contextmanager
def atomic_output(path: str, staged: StagedOutputs | None = None) -> Iterator[str]:
    """A temporary path beside `path` (same extension) that is renamed to it if the block raises nothing.

    A link is followed; the permissions of a replaced file are kept, a new one has those of the umask. After
    an error no file remains.

    Parameters
    ----------
    path : str
    staged : StagedOutputs, optional
        The complete file is added to it instead, and its `commit` renames it.

    Yields
    ------
    str
        Path of an empty file.

    Raises
    ------
    OutputError
        A folder, pipe or device in the place of the file, or an OSError, also one of the block.
    """
    _check_regular(path)
    target = Path(os.path.realpath(path))
    try:
        partial = temporary_name(target, target.suffix)
        completed = False
        try:
            permissions = stat.S_IMODE(target.stat().st_mode) & 0o777 if target.exists() else None
            create_new(partial, private=permissions is not None)
            yield partial
            if permissions is not None:
                os.chmod(partial, permissions)
            if staged is None:
                os.replace(partial, target)
            else:
                staged.add(partial, target)
            completed = True
        finally:
            if not completed and os.path.exists(partial):
                os.unlink(partial)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror or error}); nothing was changed"
        ) from error
