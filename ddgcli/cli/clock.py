"""Clocks of a run: the seconds of imports, of reading, of writing and of computing."""

from __future__ import annotations

import builtins
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any

from ddgcli.cli.interrupts import raise_received


class ImportClock:
    """Seconds that import statements take while the clock runs as a context manager.

    Attributes
    ----------
    seconds : float
        Time of the outermost import statements; an import inside an imported module is part of it.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self._depth = 0

    def __enter__(self) -> ImportClock:
        self._import = builtins.__import__
        builtins.__import__ = self._timed_import
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        builtins.__import__ = self._import

    def _timed_import(self, *arguments: Any, **options: Any) -> Any:
        if self._depth:
            return self._import(*arguments, **options)
        began = time.perf_counter()
        self._depth = 1
        try:
            return self._import(*arguments, **options)
        except ImportError:
            raise_received()
            raise
        finally:
            self._depth = 0
            self.seconds += time.perf_counter() - began


class RunClock:
    """Seconds of each section of a run; imports count as start, not as part of the run.

    Parameters
    ----------
    began : float
        Start of the run by `time.perf_counter`.
    imports : ImportClock
        Clock of the imports since then.
    """

    def __init__(self, began: float, imports: ImportClock) -> None:
        self.began = began
        self._imports = imports
        self._seconds = {"read": 0.0, "write": 0.0}

    @contextmanager
    def timed(self, section: str) -> Iterator[None]:
        """Count the time inside as "read" or "write"; all other time is "compute"."""
        began = self._now()
        try:
            yield
        finally:
            if section != "compute":
                self._seconds[section] += self._now() - began

    def seconds(self) -> dict[str, float]:
        """`start`, and the parts `read`, `compute` and `write` of `total`, which leaves the start out."""
        total = self._now() - self.began
        read, write = self._seconds["read"], self._seconds["write"]
        compute = total - read - write
        seconds = {"read": read, "compute": compute, "write": write}
        return {"start": self._imports.seconds, **seconds, "total": total}

    def _now(self) -> float:
        return time.perf_counter() - self._imports.seconds
