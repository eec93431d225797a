"""Independent tasks in several processes, which end with the process that started them."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ddgcli.errors import SolveError
from ddgcli.waiting import WAIT_SECONDS

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    Worker = tuple[Any, Connection]  # process, and the end of the pipe to it

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
        Number of processes. With one, this process computes each result when it is drawn.
    prepare : callable, optional
        Called once in each process, with `arguments`; what it returns is the first argument of `function`.
    arguments : tuple
    modules : sequence of str
        Modules that are imported once for all processes, where the system can copy a process.

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
    if jobs <= 1:
        shared = _shared(prepare, arguments)
        yield from (function(*shared, *task) for task in tasks)
        return
    from multiprocessing.connection import wait

    numbered = enumerate(tasks)
    done: dict[int, tuple[Any, Exception | None]] = {}
    running: dict[Connection, int] = {}
    following = 0  # number of the next result
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
    if jobs > 1 and _context(modules).get_start_method() == "forkserver":
        from multiprocessing import forkserver

        with _interrupts_held():
            forkserver.ensure_running()


def _context(modules: Sequence[str]) -> Any:
    """How processes start: as copies of one with these modules, where the system allows it."""
    from multiprocessing import get_all_start_methods, get_context

    copies = "forkserver" in get_all_start_methods()
    context: Any = get_context("forkserver" if copies else "spawn")
    if copies:
        context.set_forkserver_preload([__name__, *modules])
    return context


@contextmanager
def _workers(
    jobs: int, prepare: Callable[..., Any] | None, arguments: tuple, modules: Sequence[str]
) -> Iterator[list[Connection]]:
    """Pipes to new processes, which are ended at the end."""
    context = _context(modules)
    workers: list[Worker] = []
    try:
        with _interrupts_held():
            for _ in range(jobs):
                ours, theirs = context.Pipe()
                process = context.Process(target=_serve, args=(theirs, prepare, arguments), daemon=True)
                process.start()
                theirs.close()
                workers.append((process, ours))
        yield [pipe for _, pipe in workers]
    finally:
        for process, pipe in workers:
            process.terminate()
            pipe.close()
        for process, _ in workers:
            process.join()


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Signals of a terminal wait meanwhile, and never reach processes that start here."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # it would let them through
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(pipe: Connection, prepare: Callable[..., Any] | None, arguments: tuple) -> None:
    """Answer the tasks of a pipe until its other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where signals cannot be held
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


def _keep_freed_memory() -> None:
    """Let the C library keep memory that arrays free: a third of a worker's time would go into new pages.

    glibc returns freed blocks to the system that are larger than any it has freed before, up to 32 MiB; the
    process that reads a mesh has freed large ones.
    """
    bytearray(31 << 20)


def _shared(prepare: Callable[..., Any] | None, arguments: tuple) -> tuple:
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
