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
    prepare: Callable[..., None] | None = None,
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
        Number of processes.
    prepare : callable, optional
        Called once in each process, with `arguments`.
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
    from multiprocessing.connection import wait

    numbered = enumerate(tasks)
    done: dict[int, Any] = {}
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
            if following in done:
                yield done.pop(following)
                following += 1
            elif not running:
                return
            ready = wait(list(running), WAIT_SECONDS if following not in done else 0.0)
            for pipe in [pipe for pipe in running if pipe in ready]:
                done[running.pop(pipe)] = _received(pipe)
                idle.append(pipe)


@contextmanager
def _workers(
    jobs: int, prepare: Callable[..., None] | None, arguments: tuple, modules: Sequence[str]
) -> Iterator[list[Connection]]:
    """Pipes to new processes, which are ended at the end."""
    from multiprocessing import get_all_start_methods, get_context

    copies = "forkserver" in get_all_start_methods()
    context: Any = get_context("forkserver" if copies else "spawn")
    if copies:
        context.set_forkserver_preload([__name__, *modules])
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


def _serve(pipe: Connection, prepare: Callable[..., None] | None, arguments: tuple) -> None:
    """Answer the tasks of a pipe until its other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where signals cannot be held
    failure: Exception | None = None
    try:
        if prepare is not None:
            prepare(*arguments)
    except Exception as error:  # that of the first task, in the process that awaits it
        failure = error
    try:
        while True:
            function, task = pipe.recv()
            pipe.send(_answer(function, task) if failure is None else (None, failure))
    except (EOFError, OSError):
        return


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


def _received(pipe: Connection) -> Any:
    try:
        result, error = pipe.recv()
    except (EOFError, OSError):
        raise _lost() from None
    if error is not None:
        raise error
    return result


def _lost() -> SolveError:
    return SolveError("a process of several jobs ended without a result (out of memory?); use one job")
