"""Type of the callbacks that long computations call with their progress."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

ProgressCallback = Callable[[float, float], Any]  # called with (done, total), in any unit of work
