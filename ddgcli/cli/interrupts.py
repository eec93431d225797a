"""Interruptions from the keyboard, also where a library turns the exception into another one."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_received = False


def interrupted() -> bool:
    """Whether SIGINT came since the last `recorded_interrupts` began."""
    return _received


@contextmanager
def recorded_interrupts() -> Iterator[None]:
    """Record SIGINT and raise KeyboardInterrupt.

    Extension modules that are interrupted during their import print a traceback of it and raise ImportError;
    Python ends a process whose text of `exec` or `eval` was interrupted by SIGINT, whatever its exit code.
    """
    global _received
    _received = False
    own = threading.current_thread() is threading.main_thread()
    if not own or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    print_exception = sys.excepthook

    def record(number: int, stack_frame: Any) -> None:
        global _received
        _received = True
        raise KeyboardInterrupt

    def print_other(kind: type[BaseException], *rest: Any) -> None:
        if not issubclass(kind, KeyboardInterrupt):
            print_exception(kind, *rest)

    signal.signal(signal.SIGINT, record)
    sys.excepthook = print_other
    try:
        yield
    finally:
        sys.excepthook = print_exception
        signal.signal(signal.SIGINT, signal.default_int_handler)
        eval("0")  # clears the mark by which Python would end the process with SIGINT
