"""Independent tasks in several processes, which end with the process that started them."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ddgcli.errors import SolveError
from ddgcli.waiting import WAIT_SECONDS

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    Worker = tuple[Any, Connection]  # process, and the end of the pipe to it
    Prepare = Callable[..., Any] | None

_OTHER_ENDS = {getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)}
TASKS_PER_JOB = 2  # that are drawn ahead of the result which is awaited: waiting tasks fill memory


def results_in_order(
    function: Callable[..., Any],
    tasks: Iterable[tuple],
    jobs: int,
    *,
    prepare: Callable[..., Any] | None = None,
    arguments: tuple = (),
    modules: Sequence[str] = (),
) -> Iterator[Any]:
    """Results of a function of each of some tasks, in their order, from several processes.

    The processes end with the iteration, with an error or a signal in this process, and when it is killed.

    Parameters
    ----------
    function : callable
        Of a module, as `prepare` is.
    tasks : iterable of tuple
        Arguments of `function`; drawn a few ahead of the results.
    jobs : int
        Number of processes. With one, this process computes each result when it is drawn; so it does where
        it may start none, as a worker of a pool.
    prepare : callable, optional
        Called once in each process, with `arguments`; what it returns is the first argument of `function`.
    arguments : tuple
    modules : sequence of str
        That `function` uses. They are imported once for all processes, where the system can copy a process:
        this one, if it has loaded them and runs no other thread, or else a process that has only these.

    Yields
    ------
    object
        Each as soon as it and those before it exist.

    Raises
    ------
    SolveError
        A process ended without a result.
    Exception
        What `function` or `prepare` raises.
    """
    if jobs <= 1 or _may_start_none():
        shared = _shared(prepare, arguments)
        yield from (function(*shared, *task) for task in tasks)
        return
    from multiprocessing.connection import wait

    numbered = enumerate(tasks)
    done: dict[int, tuple[Any, Exception | None]] = {}
    running: dict[Connection, int] = {}
    following = 0  # index of the next result
    with _workers(jobs, prepare, arguments, modules) as pipes:
        idle = pipes
        while True:
            while idle and len(done) + len(running) <= TASKS_PER_JOB * jobs:
                number, task = next(numbered, (-1, ()))
                if number < 0:
                    break
                running[idle[-1]] = number
                _send(idle.pop(), (function, task))
            patience = WAIT_SECONDS
            if following in done:
                result, error = done.pop(following)
                if error is not None:  # that of the first task with one, as from one process
                    raise error
                yield result
                following += 1
                patience = 0.0
            elif not running:
                return
            ready = wait(list(running), patience)
            for pipe in [pipe for pipe in running if pipe in ready]:
                done[running.pop(pipe)] = _received(pipe)
                idle.append(pipe)


def start_early(jobs: int, modules: Sequence[str]) -> None:
    """Import the modules of later tasks in the process that workers are copies of, while this one computes.

    Parameters
    ----------
    jobs : int
        Nothing starts for one.
    modules : sequence of str
        As in `results_in_order`.
    """
    if jobs > 1 and not are_copies() and _context(modules).get_start_method() == "forkserver":
        from multiprocessing import forkserver

        with _signals_held(with_tracker=True):
            forkserver.ensure_running()


def are_copies(modules: Sequence[str] = ()) -> bool:
    """Whether processes will be copies of this one, whose memory they share: arguments are not sent.

    On Linux, where no other thread runs, compiled libraries included: a copy would wait for its locks.

    Parameters
    ----------
    modules : sequence of str
        As in `results_in_order`.

    Returns
    -------
    bool
    """
    try:
        threads = len(os.listdir("/proc/self/task"))
    except OSError:  # not Linux
        return False
    return threads == 1 and all(name in sys.modules for name in modules)


def _may_start_none() -> bool:
    """Whether this is a process of a pool, which ends with those that it started and may start none."""
    from multiprocessing import current_process

    return current_process().daemon


def _context(modules: Sequence[str]) -> Any:
    """How processes start: as copies of one with these modules, where the system allows it."""
    from multiprocessing import get_all_start_methods, get_context

    if are_copies(modules):
        return get_context("fork")
    copies = "forkserver" in get_all_start_methods()
    context: Any = get_context("forkserver" if copies else "spawn")
    if copies:
        context.set_forkserver_preload([__name__, *modules])
    return context


@contextmanager
def _workers(
    jobs: int, prepare: Prepare, arguments: tuple, modules: Sequence[str]
) -> Iterator[list[Connection]]:
    """Pipes to new processes, which are ended at the end."""
    context = _context(modules)
    copied = context.get_start_method() == "fork"
    if copied and prepare is not None:  # once, in memory that all processes share
        prepare, arguments = _itself, (prepare(*arguments),)
    workers: list[Worker] = []
    try:
        with _signals_held(with_tracker=not copied), _without_main_module():
            for _ in range(jobs):
                workers.append(_started(context, [pipe for _, pipe in workers], prepare, arguments))
        yield [pipe for _, pipe in workers]
    finally:
        for process, pipe in workers:
            process.terminate()
            pipe.close()
        for process, _ in workers:
            process.join()


def _started(context: Any, pipes: Sequence[Connection], prepare: Prepare, arguments: tuple) -> Worker:
    """A new process; `pipes` lead to those before it: a copy of this process closes its copies of them."""
    try:
        ours, theirs = context.Pipe()
        copies = [ours, *pipes] if context.get_start_method() == "fork" else []
        process = context.Process(target=_serve, args=(theirs, copies, prepare, arguments), daemon=True)
        process.start()
        theirs.close()
    except OSError:  # no memory for another process, or it ended as it started
        raise _lost() from None
    return process, ours


@contextmanager
def _without_main_module() -> Iterator[None]:
    """New processes do not import the script that calls: they use nothing of it, and it may have no guard."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextmanager
def _signals_held(with_tracker: bool) -> Iterator[None]:
    """Signals that end a run wait meanwhile; those of a terminal never reach processes that start here.

    A server of copies starts a tracker of its resources, whose start would let the signals through.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    if with_tracker:
        from multiprocessing import resource_tracker

        resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, *_OTHER_ENDS})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(pipe: Connection, copies: Sequence[Connection], prepare: Prepare, arguments: tuple) -> None:
    """Answer the tasks of a pipe until its other end is closed, of which this process may have copies."""
    for other_end in copies:
        other_end.close()
    _restore_signals()
    _keep_freed_memory()
    shared: tuple = ()
    failure: Exception | None = None
    try:
        shared = _shared(prepare, arguments)
    except Exception as error:  # that of the first task, in the process that awaits it
        failure = error
    try:
        while True:
            function, task = pipe.recv()
            pipe.send(_answer(function, (*shared, *task)) if failure is None else (None, failure))
    except (EOFError, OSError):
        return


def _restore_signals() -> None:
    """End at once at signals that the copied process turns into exceptions; ignore those of a terminal."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where signals cannot be held
    for number in _OTHER_ENDS:
        if signal.getsignal(number) != signal.SIG_IGN:  # as of nohup
            signal.signal(number, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _OTHER_ENDS)


def _keep_freed_memory() -> None:
    """Let the C library keep memory that arrays free: a third of a worker's time would go into new pages.

    glibc returns freed blocks to the system that are larger than any it has freed before, up to 32 MiB; the
    process that reads a mesh has freed large ones.
    """
    bytearray(31 << 20)


def _itself(prepared: Any) -> Any:
    return prepared


def _shared(prepare: Prepare, arguments: tuple) -> tuple:
    """The first arguments of all calls in a process."""
    return () if prepare is None else (prepare(*arguments),)


def _answer(function: Callable[..., Any], task: tuple) -> tuple[Any, Exception | None]:
    try:
        return function(*task), None
    except Exception as error:  # raised again in the process that awaits the result
        return None, error


def _send(pipe: Connection, task: tuple) -> None:
    try:
        pipe.send(task)
    except OSError:
        raise _lost() from None


def _received(pipe: Connection) -> tuple[Any, Exception | None]:
    try:
        return pipe.recv()
    except (EOFError, OSError):
        raise _lost() from None


def _lost() -> SolveError:
    return SolveError("a process of several jobs ended without a result (out of memory?); use one job")
