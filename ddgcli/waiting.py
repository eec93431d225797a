"""Waits that a signal ends: one that comes just before a call blocks is handled when the call returns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import subprocess

WAIT_SECONDS = 0.25


def wait_in_steps(wait: Callable[[float], Any]) -> None:
    """Wait in steps of `WAIT_SECONDS` until `wait` returns a true value.

    Parameters
    ----------
    wait : callable
        Waits for at most the seconds that it is called with.
    """
    while not wait(WAIT_SECONDS):
        pass


def captured_run(call: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run a program to its end, or until a signal; its exit code and texts.

    Parameters
    ----------
    call : sequence of str

    Returns
    -------
    subprocess.CompletedProcess
    """
    import subprocess

    with subprocess.Popen(
        call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8", errors="replace"
    ) as process:
        try:
            while True:
                try:
                    texts = process.communicate(timeout=WAIT_SECONDS)
                    return subprocess.CompletedProcess(call, process.returncode, *texts)
                except subprocess.TimeoutExpired:
                    continue
        except BaseException:
            process.kill()
            raise
