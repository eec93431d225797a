"""Runs of the program in forked children, which signals reach after a chosen processor time."""

import io
import os
import signal
import sys
import time

from ddgcli.cli import main as program


def forked(folder, words) -> int:
    """The program on these words in a child that need not import it; its process number."""
    # until the child handles signals as a new process: before, one would be an exception of pytest in it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGTERM])
    pid = os.fork()
    if pid:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return pid
    code = 1
    try:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # until the program handles it, as before Python starts
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        os.chdir(folder)
        target = os.open("streams", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        for stream in (1, 2):
            os.dup2(target, stream)
        sys.stdout, sys.stderr = (io.TextIOWrapper(io.FileIO(k, "w", closefd=False)) for k in (1, 2))
        program.main([str(word) for word in words], prog_name="ddgcli")
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    finally:
        os._exit(code)


def processor_seconds(pid: int) -> float:
    return time.clock_gettime((~pid << 3) | 2)  # the clock of another process, as clock_getcpuclockid has it


def ended_after(pid: int) -> tuple[int, float]:
    """Exit code, and the processor time of the child alone, without that of the children it started."""
    last_seconds = 0.0
    while True:
        seconds = processor_seconds(pid)  # a child that ended keeps its clock until it is waited for
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status), max(last_seconds, seconds)
        last_seconds = seconds
        time.sleep(0.001)


def ended(pid: int, at: float = float("inf"), number: int = signal.SIGKILL) -> int:
    """Exit code; the child gets the signal once it has used this much processor time: whatever else runs."""
    while True:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if processor_seconds(pid) >= at:
            os.kill(pid, number)
            at = float("inf")
        time.sleep(0.001)
