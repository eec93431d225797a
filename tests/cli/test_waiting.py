"""Signals that arrive just before a wait begins.

`interrupt_main` is such a signal: it is pending, and ends no call that waits.
"""

import _thread
import sys
import threading
import time

import pytest

from ddgcli.cli.batch import process
from ddgcli.cli.batch.process import TaskLimits
from ddgcli.cli.batch.run import run_batch
from ddgcli.cli.batch.tasks import make_tasks
from ddgcli.tradeoff.measure import peak_mib
from ddgcli.waiting import captured_run

TASK_SECONDS = 2.0


def batch(monkeypatch, code):
    monkeypatch.setattr(process, "PROGRAM", (sys.executable, "-c", code))
    return run_batch(make_tasks(["a.ply"], {}, None, ["info"]), TaskLimits())


def tradeoff(monkeypatch, code):
    return peak_mib(lambda: exec(code))


def check(monkeypatch, code):
    return captured_run([sys.executable, "-c", code])


@pytest.mark.parametrize("wait", [batch, tradeoff, check])
def test_a_signal_before_a_wait_ends_the_task(wait, monkeypatch, tmp_path):
    begun, ended = tmp_path / "begun", tmp_path / "ended"
    code = (
        f"import pathlib, time\npathlib.Path({str(begun)!r}).touch()\ntime.sleep({TASK_SECONDS})\n"
        f"pathlib.Path({str(ended)!r}).touch()"
    )

    def interrupt():
        while not begun.exists():
            time.sleep(0.01)
        _thread.interrupt_main()

    threading.Thread(target=interrupt, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        wait(monkeypatch, code)
    assert not ended.exists()


def test_a_program_has_its_texts_and_exit_code():
    run = captured_run([sys.executable, "-c", "import sys; print('a'); sys.exit('b')"])
    assert (run.returncode, run.stdout, run.stderr) == (1, "a\n", "b\n")
