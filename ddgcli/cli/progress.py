"""Progress bar on standard error; silent in pipes and for short runs."""

from __future__ import annotations

import math
import sys
import threading
import time

from ddgcli.cli.interrupts import raise_received

START_DELAY = 2.0  # seconds of a run before the bar appears without --progress
REDRAW_INTERVAL = 0.1  # seconds between two drawings
IDLE_INTERVAL = 1.0  # seconds without a report after which the bar is redrawn
MIN_ESTIMATE_SHARE = 0.01  # share of the work from which the remaining time is estimated
BAR_WIDTH = 30  # characters


class Progress:
    """Callback that draws a progress bar; without calls, a thread updates the seconds.

    Parameters
    ----------
    label : str
    terminal : bool or None
        Whether standard error is a terminal; None tests it.
    enabled : bool or None
        --progress, --no-progress or neither: then on a terminal, two seconds after the start.
    since : float, optional
        Start of the run by `time.perf_counter`; by default now.
    """

    def __init__(
        self, label: str, terminal: bool | None, enabled: bool | None, since: float | None = None
    ) -> None:
        self.label = label
        is_terminal = sys.stderr.isatty() if terminal is None else terminal
        self.active = is_terminal if enabled is None else enabled and terminal is not False
        self.began = time.perf_counter()
        self.due = (self.began if since is None else since) + (START_DELAY if enabled is None else 0.0)
        self._next_idle_redraw = self.due
        self.drawn = 0
        self._share: float | None = None
        self._seconds_left = math.inf  # lowest estimate so far: the displayed time never rises
        self._lock = threading.Lock()
        self._finished = threading.Event()
        if self.active and is_terminal:
            threading.Thread(target=self._redraw_when_idle, daemon=True).start()

    def __call__(self, completed: float, total: float = 1.0) -> None:
        """Report that `completed` of `total` is complete; cheap if no redraw is due.

        The exception of a signal is raised here where a library dropped it.
        """
        raise_received()
        if not self.active:
            return
        self._share = min(max(completed / total, 0.0), 1.0) if total > 0 else 1.0
        if time.perf_counter() >= self.due:
            self._draw()

    def _redraw_when_idle(self) -> None:
        """Redraw the bar while the work reports nothing."""
        while not self._finished.wait(max(self._next_idle_redraw - time.perf_counter(), REDRAW_INTERVAL)):
            if time.perf_counter() >= self._next_idle_redraw:
                self._draw()

    def _draw(self) -> None:
        with self._lock:
            if not self.active:
                return
            now = time.perf_counter()
            self.due, self._next_idle_redraw = now + REDRAW_INTERVAL, now + IDLE_INTERVAL
            text = f"{self.label}: {now - self.began:.0f} s"
            if self._share is not None:
                bar = "#" * round(BAR_WIDTH * self._share)
                eta = ""
                if self._share >= MIN_ESTIMATE_SHARE:
                    estimate = (now - self.began) * (1 / self._share - 1)
                    self._seconds_left = min(self._seconds_left, estimate)
                    eta = f", {self._seconds_left:.0f} s left"
                text = f"{self.label} [{bar:<{BAR_WIDTH}}] {100 * self._share:3.0f} %{eta}"
            sys.stderr.write("\r" + text.ljust(self.drawn))
            sys.stderr.flush()
            self.drawn = len(text)

    def clear(self) -> None:
        """Remove the bar and stop drawing."""
        self._finished.set()
        with self._lock:
            if self.drawn:
                sys.stderr.write("\r" + " " * self.drawn + "\r")
                sys.stderr.flush()
                self.drawn = 0
            self.active = False
