"""A bar on standard error for work that takes long; silent in pipes and for what is quick."""

from __future__ import annotations

import sys
import time

PATIENCE = 2.0  # seconds before a bar appears by itself
PACE = 0.1  # seconds between two drawings
WIDTH = 30


class Progress:
    """Callback that draws a bar.

    Parameters
    ----------
    label : str
    terminal : bool or None
        Whether standard error is a terminal; None: look.
    wanted : bool or None
        --progress, --no-progress or neither (then: on a terminal, after two seconds).
    """

    def __init__(self, label: str, terminal: bool | None, wanted: bool | None) -> None:
        self.label = label
        is_terminal = sys.stderr.isatty() if terminal is None else terminal
        self.active = is_terminal if wanted is None else wanted and terminal is not False
        self.began = time.perf_counter()
        self.due = self.began + (PATIENCE if wanted is None else 0.0)
        self.drawn = 0

    def __call__(self, done: float, total: float = 1.0) -> None:
        """Tell that `done` of `total` is done; costs next to nothing when no bar is due."""
        if not self.active:
            return
        now = time.perf_counter()
        if now < self.due:
            return
        self.due = now + PACE
        share = min(max(done / total, 0.0), 1.0) if total > 0 else 1.0
        left = (now - self.began) * (1 - share) / share if share > 0 else float("inf")
        eta = f", {left:.0f} s left" if left < 1e6 else ""
        bar = "#" * round(WIDTH * share)
        text = f"{self.label} [{bar:<{WIDTH}}] {100 * share:3.0f} %{eta}"
        sys.stderr.write("\r" + text.ljust(self.drawn))
        sys.stderr.flush()
        self.drawn = len(text)

    def clear(self) -> None:
        """Take the bar away."""
        if self.drawn:
            sys.stderr.write("\r" + " " * self.drawn + "\r")
            sys.stderr.flush()
            self.drawn = 0
        self.active = False
