"""Third-party readers in a separate process with bounded time, memory and files.

HDF5, meshio and trimesh can loop without end inside compiled code, allocate all memory, or follow a reference
to any file of the user. A child process reads and sends back plain arrays. On Linux it is forked, which
costs a few milliseconds; elsewhere a new interpreter starts (some tenths of a second).

Bounds, by the size of the file: `cpu_seconds`, `memory_bytes`. The memory bound needs POSIX limits; on
Windows only the time is bounded.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import pickle
import select
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ddgcli.errors import MeshFileError, excerpt
from ddgcli.io.readers.inflate import largest_content

SOURCE_FOLDER = Path(__file__).resolve().parents[3]  # holds the package ddgcli
MIN_CPU_SECONDS = 5.0
CPU_SECONDS_PER_MIB = 10.0
MIN_MEMORY = 1 << 30  # bytes in addition to the memory of the process
MIN_WALL_SECONDS = 10.0
WALL_TO_CPU_RATIO = 4.0  # a busy machine gives a process a fraction of its time
_BANNED_CALLS = ("socket.", "subprocess.", "os.system", "os.exec", "os.posix_spawn", "os.remove", "os.rename",
              "os.fork", "urllib.", "shutil.")  # fmt: skip


def cpu_seconds(size: int) -> float:
    """Most processor time that a reader may take for a file of `size` bytes."""
    return MIN_CPU_SECONDS + CPU_SECONDS_PER_MIB * size / 2**20


def memory_bytes(size: int) -> int:
    """Most memory that a reader may take for a file of `size` bytes."""
    return MIN_MEMORY + largest_content(size)


def guarded(
    module: str, function: str, *args: Any, size: int, needs: tuple[str, ...], folder: str | None = None
) -> Any:
    """Call `ddgcli.io.MODULE.FUNCTION(*args)` in a process of its own.

    Parameters
    ----------
    module, function : str
        Name of a module below `ddgcli.io`, and of a function in it.
    *args
        Arguments of the function; they can be pickled.
    size : int
        Of the file in bytes; sets the bounds.
    needs : tuple of str
        Packages that the function uses; imported before the process is confined, and before it is forked.
    folder : str, optional
        The only folder, beside Python's own, that the reader may open files in; None: no folder at all.

    Returns
    -------
    object
        Result of the function, through pickle.

    Raises
    ------
    MeshFileError
        As the function does; or a bound was reached; or the reader crashed.
    """
    call = (module, function, args, size, needs, folder)
    wall = MIN_WALL_SECONDS + WALL_TO_CPU_RATIO * cpu_seconds(size)
    answer, code = (_forked if sys.platform == "linux" else _spawned)(call, wall)
    if answer:
        kind, value = pickle.loads(answer)
        if kind == "result":
            return value
        raise MeshFileError(value)
    if code is None or code == -getattr(signal, "SIGXCPU", 0):
        raise MeshFileError(
            f"its reader did not end within {cpu_seconds(size):.0f} s, the bound for {size:,} bytes; the "
            "file is damaged"
        )
    raise MeshFileError(f"its reader crashed (code {code}); the file is damaged")


def _forked(call: tuple, wall: float) -> tuple[bytes, int | None]:
    """Answer and exit code of a forked child; None for one that was stopped after `wall` seconds."""
    _function(call)
    receive, send = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of threads: those of the linear algebra, which readers do not use
        child = os.fork()
    if child == 0:
        os.close(receive)
        try:
            with os.fdopen(send, "wb") as stream:
                stream.write(_answer(call))
        finally:
            os._exit(0)
    os.close(send)
    try:
        return _received(receive, wall, child)
    finally:
        os.close(receive)


def _received(receive: int, wall: float, child: int) -> tuple[bytes, int | None]:
    chunks, end, whole = [], time.monotonic() + wall, False
    try:
        while select.select([receive], [], [], max(end - time.monotonic(), 0))[0]:
            chunk = os.read(receive, 1 << 20)
            if not chunk:
                whole = True
                break
            chunks.append(chunk)
    finally:
        if not whole:
            os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    return (b"".join(chunks), code) if whole and code == 0 else (b"", code if whole else None)


def _spawned(call: tuple, wall: float) -> tuple[bytes, int | None]:
    """The same in a new interpreter."""
    paths = [str(SOURCE_FOLDER), *filter(None, [os.environ.get("PYTHONPATH")])]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    try:
        process = subprocess.run(
            [sys.executable, "-P", "-m", "ddgcli.io.readers.guarded"],
            input=pickle.dumps(call), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=wall,
            env=env,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return b"", None
    return process.stdout if process.returncode == 0 else b"", process.returncode


def _function(call: tuple) -> Callable[..., Any]:
    """The reader of a call, with the packages that it needs."""
    module, function, _, _, needs, _ = call
    for package in needs:
        importlib.import_module(package)
    return getattr(importlib.import_module(f"ddgcli.io.{module}"), function)


def _answer(call: tuple) -> bytes:
    """Answer of the child: the result, or the message of an error."""
    _, _, args, size, needs, folder = call
    read = _function(call)
    try:
        _limit(size)
        _confine(folder, hdf5="h5py" in needs)
        return pickle.dumps(("result", read(*args)), protocol=5)
    except MeshFileError as error:
        message = str(error)
    except MemoryError:
        message = (
            f"its reader needs more than {memory_bytes(size) >> 20:,} MiB, the bound for {size:,} bytes; "
            "the file is damaged"
        )
    except (Exception, SystemExit) as error:
        message = f"its reader failed ({type(error).__name__}: {excerpt(error)}); the file is damaged"
    return pickle.dumps(("refused", message))


def _limit(size: int) -> None:
    """Bound processor time and address space of this process."""
    try:
        import resource
    except ImportError:  # Windows
        return
    seconds = int(cpu_seconds(size)) + 1
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with contextlib.suppress(OSError, ValueError):
        used_bytes = 0
        with open("/proc/self/statm") as statm:
            used_bytes = int(statm.read().split()[0]) * resource.getpagesize()
        limit = used_bytes + memory_bytes(size)
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(
            resource.RLIMIT_AS, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard)
        )


def _confine(folder: str | None, *, hdf5: bool) -> None:
    """Restrict this process to files of `folder` and of Python; no sockets, no programs."""
    places = (sys.prefix, sys.base_prefix, str(SOURCE_FOLDER / "ddgcli"), *sys.path)
    own = {os.path.realpath(p) for p in places if p and os.path.isabs(p)}
    own -= {os.path.realpath(p) for p in ("/", "/usr", os.path.expanduser("~"))}
    inside = None if folder is None else os.path.realpath(folder)

    def allow(path: Any) -> None:
        if isinstance(path, int):
            return
        real = os.path.realpath(os.fsdecode(path))
        if inside is not None and _below(real, inside):
            return
        if real != os.devnull and not any(_below(real, folder) for folder in own):
            raise MeshFileError(
                f"refers to {excerpt(os.fsdecode(path), 60)}, outside its own folder; such references are "
                "not followed: copy what it needs beside it"
            )

    def watch(event: str, arguments: tuple) -> None:
        if event == "open":
            allow(arguments[0])
        elif event.startswith(_BANNED_CALLS):
            raise MeshFileError(f"makes its reader use {event}; such files are not read")

    sys.dont_write_bytecode = True  # a module imported from here on would be renamed into the bytecode cache
    sys.addaudithook(watch)
    if hdf5 and inside is not None:  # HDF5 opens files without asking Python
        _check_hdf5(allow)


def _below(path: str, folder: str) -> bool:
    return path == folder or path.startswith(folder.rstrip(os.sep) + os.sep)


def _check_hdf5(allow: Callable[[Any], None]) -> None:
    """Every HDF5 file that a third-party reader opens passes `refuse_outside`."""
    import h5py

    from ddgcli.io.readers.hdf5_links import refuse_outside

    begin = h5py.File.__init__
    identifiers = (h5py.h5f.FileID, h5py.h5g.GroupID, h5py.h5d.DatasetID)  # of objects in an open file

    def checked(self: Any, name: Any, *args: Any, **kwargs: Any) -> None:
        if isinstance(name, (str, bytes, os.PathLike)):
            allow(os.fspath(name))
        begin(self, name, *args, **kwargs)
        if not isinstance(name, identifiers):  # `Group.get` wraps its open file again at every call
            refuse_outside(self)

    h5py.File.__init__ = checked


def main() -> None:
    """The child where processes are not forked: a call on standard input, the answer on standard output."""
    call = pickle.loads(sys.stdin.buffer.read())
    sys.stdout.buffer.write(_answer(call))


if __name__ == "__main__":
    main()
