"""A bar on standard error for work that takes long; silent in pipes and for what is quick."""

from __future__ import annotations

import sys
import threading
import time

PATIENCE = 2.0  # seconds of a run before a bar appears by itself
PACE = 0.1  # seconds between two drawings
PULSE = 1.0  # seconds after which work that tells nothing shows that it goes on
FORETOLD = 0.01  # share of the work after which the rest of the time is told
WIDTH = 30


class Progress:
    """Callback that draws a bar; between two calls, and before the first, the seconds go on by themselves.

    Parameters
    ----------
    label : str
    terminal : bool or None
        Whether standard error is a terminal; None: look.
    wanted : bool or None
        --progress, --no-progress or neither (then: on a terminal, where the run is two seconds old).
    since : float, optional
        When the run began, by `time.perf_counter`; by default now.
    """

    def __init__(
        self, label: str, terminal: bool | None, wanted: bool | None, since: float | None = None
    ) -> None:
        self.label = label
        is_terminal = sys.stderr.isatty() if terminal is None else terminal
        self.active = is_terminal if wanted is None else wanted and terminal is not False
        self.began = time.perf_counter()
        self.due = (self.began if since is None else since) + (PATIENCE if wanted is None else 0.0)
        self._next_pulse = self.due
        self.drawn = 0
        self._share: float | None = None
        self._lock = threading.Lock()
        self._over = threading.Event()
        if self.active and is_terminal:
            threading.Thread(target=self._pulse, daemon=True).start()

    def __call__(self, done: float, total: float = 1.0) -> None:
        """Tell that `done` of `total` is done; costs next to nothing when no bar is due."""
        if not self.active:
            return
        self._share = min(max(done / total, 0.0), 1.0) if total > 0 else 1.0
        if time.perf_counter() >= self.due:
            self._draw()

    def _pulse(self) -> None:
        """Draw where the work has told nothing for a while."""
        while not self._over.wait(max(self._next_pulse - time.perf_counter(), PACE)):
            if time.perf_counter() >= self._next_pulse:
                self._draw()

    def _draw(self) -> None:
        with self._lock:
            if not self.active:
                return
            now = time.perf_counter()
            self.due, self._next_pulse = now + PACE, now + PULSE
            text = f"{self.label}: {now - self.began:.0f} s"
            if self._share is not None:
                bar = "#" * round(WIDTH * self._share)
                known = self._share >= FORETOLD
                eta = f", {(now - self.began) * (1 / self._share - 1):.0f} s left" if known else ""
                text = f"{self.label} [{bar:<{WIDTH}}] {100 * self._share:3.0f} %{eta}"
            sys.stderr.write("\r" + text.ljust(self.drawn))
            sys.stderr.flush()
            self.drawn = len(text)

    def clear(self) -> None:
        """Take the bar away."""
        self._over.set()
        with self._lock:
            if self.drawn:
                sys.stderr.write("\r" + " " * self.drawn + "\r")
                sys.stderr.flush()
                self.drawn = 0
            self.active = False
