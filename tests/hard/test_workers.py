"""Processes of `--jobs`: results in order, errors as of one process, and none that outlives a signal."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import pytest

from ddgcli.errors import SolveError
from ddgcli.workers import TASKS_PER_JOB, results_in_order


def doubled(value):
    return 2 * value


def slow_first(*numbers):
    *shared, k = numbers
    time.sleep(0.2 if k == 0 else 0.0)
    return k * k + sum(shared)


def odd_is_an_error(k):
    if k % 2:
        raise SolveError(f"task {k}")
    return k


def vanish(k):
    os._exit(3)


def test_results_come_in_the_order_of_the_tasks():
    tasks = [(k,) for k in range(9)]
    assert list(results_in_order(slow_first, tasks, 2)) == [k * k for k in range(9)]
    for jobs in (1, 3):
        results = results_in_order(slow_first, tasks, jobs, prepare=doubled, arguments=(50,))
        assert list(results) == [k * k + 100 for k in range(9)]
    assert list(results_in_order(slow_first, [], 2)) == []


def test_tasks_are_drawn_a_few_ahead():
    drawn = []
    results = results_in_order(slow_first, ((drawn.append(k) or k,) for k in range(50)), 2)
    assert next(results) == 0
    assert len(drawn) <= TASKS_PER_JOB * 2 + 2
    results.close()


def test_an_error_of_a_task_is_raised_where_its_result_is_awaited():
    for jobs in (1, 2):
        results = results_in_order(odd_is_an_error, [(0,), (1,), (2,)], jobs)
        assert next(results) == 0
        with pytest.raises(SolveError, match="task 1"):
            next(results)
        with pytest.raises(SolveError, match="task 5"):
            list(results_in_order(slow_first, [(0,)], jobs, prepare=odd_is_an_error, arguments=(5,)))


def test_the_last_result_ends_the_iteration(monkeypatch):
    """It waited once more, for tasks that there were none of: a quarter of a second for every call."""
    monkeypatch.setattr("ddgcli.workers.WAIT_SECONDS", 20.0)
    began = time.monotonic()
    assert list(results_in_order(doubled, [(k,) for k in range(3)], 2)) == [0, 2, 4]
    assert time.monotonic() - began < 20.0


EARLY = """
import threading, time
from ddgcli.workers import results_in_order, start_early
from tests.hard.test_workers import imported
if __name__ == "__main__":
    threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
    for early in (False, True):
        if early:
            start_early(1, ("wave",))
            start_early(2, ("wave",))
        print(*results_in_order(imported, [("wave",)], 2 if early else 1))
"""


def imported(name):
    return name in sys.modules


@pytest.mark.skipif("forkserver" not in multiprocessing.get_all_start_methods(), reason="nothing to copy")
def test_modules_are_imported_before_the_first_task():
    printed = subprocess.run([sys.executable, "-c", EARLY], capture_output=True, text=True, check=True).stdout
    assert printed.split() == ["False", "True"]


PREPARED = """
import os, sys, threading, time
from ddgcli.workers import results_in_order
from tests.hard.test_workers import own_and, own_number
if __name__ == "__main__":
    if "thread" in sys.argv:
        threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
    modules = ("wave",) if "module" in sys.argv else ()
    for prepared, worker in results_in_order(own_and, [(0,), (1,)], 2, prepare=own_number, arguments=(0,),
                                             modules=modules):
        print(prepared == os.getpid(), worker == os.getpid())
"""


def own_and(prepared, k):
    return prepared, own_number(k)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are not copied")
@pytest.mark.parametrize(("words", "once"), [([], True), (["thread"], False), (["module"], False)])
def test_a_process_of_one_thread_prepares_once_for_its_copies(words, once):
    """A copy of a process with other threads may wait for a lock of them without end."""
    call = [sys.executable, "-c", PREPARED, *words]
    printed = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    assert printed.split() == [str(once), "False"] * 2


UNGUARDED = """
import sys, threading, time
import ddgcli as ddg
if "thread" in sys.argv:
    threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
sphere = ddg.icosphere(1)
two = ddg.distance_matrix(sphere, [0, 1, 2], range(9), jobs=2)
print((two == ddg.distance_matrix(sphere, [0, 1, 2], range(9))).all())
"""


@pytest.mark.parametrize("words", [[], ["thread"]])
@pytest.mark.parametrize("place", ["file", "input"])
def test_a_script_without_a_guard_may_start_jobs(words, place, tmp_path):
    """Workers imported it again, up to the same call: two tracebacks and a broken pipe."""
    path = tmp_path / "script.py"
    path.write_text(UNGUARDED)
    call = [sys.executable, str(path) if place == "file" else "-", *words]
    run = subprocess.run(call, input=UNGUARDED, capture_output=True, text=True)
    assert (run.stdout, run.stderr) == ("True\n", "")


def number_of_results(_):
    return len(list(results_in_order(doubled, [(0,), (1,)], 2)))


def test_a_process_of_a_pool_computes_alone():
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(number_of_results, [0]) == [2]


def test_a_process_that_cannot_start_is_an_error(monkeypatch):
    def no_memory(*_):
        raise OSError(12, "Cannot allocate memory")

    monkeypatch.setattr("multiprocessing.process.BaseProcess.start", no_memory)
    with pytest.raises(SolveError, match="use one job"):
        list(results_in_order(doubled, [(0,), (1,)], 2))


def test_a_process_that_ends_is_reported():
    with pytest.raises(SolveError, match="use one job"):
        list(results_in_order(vanish, [(0,), (1,)], 2))


SCRIPT = """
import signal, sys, threading, time
from ddgcli.workers import results_in_order
if __name__ == "__main__":
    if "thread" in sys.argv:
        threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
    if "terminate" in sys.argv:  # as the command line does
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    for pid in results_in_order(__import__("tests.hard.test_workers", fromlist=["own_number"]).own_number,
                                ((k,) for k in range(1000)), 2):
        print(pid, flush=True)
"""


def own_number(k):
    time.sleep(0.05)
    return os.getpid()


def is_running(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.parametrize("threads", ["one", "thread"])
@pytest.mark.parametrize("end", ["interrupt", "terminate", "kill"])
def test_no_process_outlives_the_one_that_started_it(end, threads, tmp_path):
    """Nor writes a traceback: Ctrl-C reaches all processes of a terminal, other signals the first alone."""
    path = tmp_path / "script.py"
    path.write_text(SCRIPT)
    root = os.path.dirname(os.path.dirname(os.path.dirname(__file__)))
    environment = os.environ | {"PYTHONPATH": root}
    process = subprocess.Popen(
        [sys.executable, str(path), end, threads], env=environment, start_new_session=True, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    workers = {int(process.stdout.readline()) for _ in range(6)}
    assert workers and process.pid not in workers
    if end == "interrupt":
        os.killpg(process.pid, signal.SIGINT)
    else:
        os.kill(process.pid, signal.SIGTERM if end == "terminate" else signal.SIGKILL)
    _, error = process.communicate(timeout=60)
    assert error.count("Traceback") == (1 if end == "interrupt" else 0)  # of the script itself
    until = time.monotonic() + 60
    while any(map(is_running, workers)) and time.monotonic() < until:
        time.sleep(0.02)
    assert not any(map(is_running, workers))
