"""The progress bar on standard error."""

import os
import re
import subprocess
import sys
import time

import pytest

from ddgcli.cli.progress import Progress


def test_progress_bar_follows_terminal_and_option(capsys):
    for terminal, option, drawn in (
        (False, None, False),
        (True, False, False),
        (True, None, False),
        (None, True, True),
    ):
        bar = Progress("work", terminal, option)
        bar(1, 4)
        bar.clear()
        assert ("work" in capsys.readouterr().err) == drawn


def test_bar_appears_when_work_is_long(capsys):
    bar = Progress("work", True, None)
    bar.due = 0.0
    bar(1, 4)
    assert "25 %" in capsys.readouterr().err
    bar.clear()
    bar(2, 4)
    assert "50 %" not in capsys.readouterr().err


def test_time_left_is_shown_from_the_first_measurable_share(capsys):
    for done, has_estimate in ((0, False), (1e-9, False), (1e-3, False), (0.1, True), (1, True)):
        bar = Progress("work", None, True)
        bar(done)
        assert ("s left" in capsys.readouterr().err) == has_estimate


def test_the_estimate_of_the_time_left_only_falls(capsys):
    bar, seconds = Progress("work", None, True), []
    for elapsed, done in ((1.0, 0.1), (2.0, 0.5), (30.0, 0.55), (40.0, 0.99)):
        bar.began, bar.due = time.perf_counter() - elapsed, 0.0
        bar(done)
        seconds.append(int(re.search(r"(\d+) s left", capsys.readouterr().err)[1]))
    assert seconds == [9, 2, 2, 0]  # the third step alone would give 25


def test_progress_bar_is_redrawn_during_silent_work(capsys, monkeypatch):
    monkeypatch.setattr("ddgcli.cli.progress.IDLE_INTERVAL", 0.05)
    bars = [Progress(name, True, None, since=time.perf_counter() - 10) for name in ("silent", "quarter")]
    bars[1](1, 4)
    output, until = "", time.perf_counter() + 60
    while time.perf_counter() < until and (output.count("silent: 0 s") < 2 or output.count("25 %") < 3):
        time.sleep(0.02)
        output += capsys.readouterr().err
    assert output.count("silent: 0 s") >= 2 and output.count("25 %") >= 3
    for bar in bars:
        bar.clear()
    capsys.readouterr()
    time.sleep(0.3)
    assert capsys.readouterr().err == ""


def test_no_command_is_silent_for_long_on_a_terminal(torus):
    """Whatever it does, and without a word of the core: here reading, slowed."""
    code = (
        "import time\nfrom ddgcli.io import mesh_file\nfrom ddgcli.cli.main import main\n"
        "read = mesh_file.read_mesh\n"
        "mesh_file.read_mesh = lambda *words: (time.sleep(3), read(*words))[1]\n"
        f"main(['info', {str(torus)!r}], standalone_mode=False)\n"
    )
    pty = pytest.importorskip("pty")
    master, slave = pty.openpty()
    run = subprocess.Popen([sys.executable, "-c", code], stderr=slave, stdout=subprocess.DEVNULL)
    assert run.wait(timeout=300) == 0
    output = os.read(master, 10_000).decode()
    os.close(slave), os.close(master)
    assert "info: " in output and " s" in output and output.endswith("\r")
