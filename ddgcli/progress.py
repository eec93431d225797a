"""Types of the callbacks that long computations call with their progress."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

ProgressCallback = Callable[[float, float], Any]  # called with (completed, total), in any unit of work
StageProgress = Callable[[str], ProgressCallback]  # called with the name of a stage; its callback


def no_progress(completed: float, total: float) -> None:
    """Progress callback that does nothing."""


def no_stage_progress(stage_name: str) -> ProgressCallback:
    """Progress of stages that does nothing.

    Parameters
    ----------
    stage_name : str

    Returns
    -------
    callable
    """
    return no_progress
