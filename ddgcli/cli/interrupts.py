"""Signals that end a run, also where a library drops their exception or turns it into another one."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from ddgcli.cli.early_interrupt import end_at_once

PARTIAL_RUN = "ddgcli.partial_run"  # key of `meta` of the context: path of an incomplete trajectory
REPEAT_DELAY = 0.01  # seconds after which a signal whose exception was dropped is delivered again

_received: BaseException | None = None
_delivery: object | None = None  # of the thread that delivers a dropped signal, until its exception is raised
_is_in_hook = False  # Python handles a dropped exception: another one would be printed


class Terminated(BaseException):
    """SIGTERM or SIGHUP ends this process; unlike a plain exit, the exception removes half-written files."""


def received_signal() -> signal.Signals | None:
    """The last signal that came since the last `signals_as_exceptions` began."""
    return None if _received is None else _received.args[0]


def raise_received() -> None:
    """Raise the exception of a signal that came since `signals_as_exceptions` began."""
    global _delivery
    _delivery = None
    if _received is not None:
        raise type(_received)(*_received.args)


def _raise(number: int, stack_frame: Any) -> None:
    global _received
    kind = KeyboardInterrupt if number == signal.SIGINT else Terminated
    _received = kind(signal.Signals(number))
    if _is_in_hook:
        _deliver_later()
    else:
        raise_received()


def _deliver_later() -> None:
    """Deliver the signal again from a thread of its own, whose start does not wait for the thread.

    One thread is enough: if each of its signals within the hook started another, the hook would not return.
    """
    global _delivery
    if _received is not None and _delivery is None:
        _delivery = object()
        try:
            _thread.start_new_thread(_deliver_again, (_delivery,))
        except RuntimeError:  # no thread starts while the interpreter ends
            _delivery = None


def _deliver_again(delivery: object) -> None:
    """Deliver the last signal until its exception is raised."""
    while _delivery is delivery:
        time.sleep(REPEAT_DELAY)
        if _delivery is delivery and _received is not None:
            with suppress(RuntimeError):
                _thread.interrupt_main(_received.args[0])


@contextmanager
def signals_as_exceptions() -> Iterator[None]:
    """Raise KeyboardInterrupt at SIGINT, `Terminated` at SIGTERM and SIGHUP; record what came.

    Extension modules that are interrupted during their import print a traceback of it and raise ImportError;
    Python ends a process whose text of `exec` or `eval` was interrupted by SIGINT, whatever its exit code.
    """
    global _received, _delivery
    _received = _delivery = None
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    kinds = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    # nohup ignores SIGHUP: leave ignored signals alone
    default = {signal.SIG_DFL, signal.default_int_handler, end_at_once}
    before = {k: signal.signal(k, _raise) for k in kinds if signal.getsignal(k) in default}
    print_exception, print_dropped = sys.excepthook, sys.unraisablehook

    def print_other(kind: type[BaseException], *rest: Any) -> None:
        if not issubclass(kind, (KeyboardInterrupt, Terminated)):
            print_exception(kind, *rest)

    def deliver_dropped_again(hook_args: sys.UnraisableHookArgs) -> None:
        """Python drops exceptions in destructors and callbacks; a dropped signal comes again later."""
        global _is_in_hook
        _is_in_hook = True
        try:
            if isinstance(hook_args.exc_value, (KeyboardInterrupt, Terminated)):
                _deliver_later()
            else:
                print_dropped(hook_args)
        finally:
            _is_in_hook = False

    sys.excepthook, sys.unraisablehook = print_other, deliver_dropped_again
    try:
        yield
    finally:
        _delivery = None
        sys.excepthook, sys.unraisablehook = print_exception, print_dropped
        for kind, handler in before.items():
            signal.signal(kind, handler)
        eval("0")  # clears the mark by which Python would end the process with SIGINT
