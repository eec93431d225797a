"""Checks of key frames in scene sections: each model interprets them."""

from __future__ import annotations

from bisect import bisect_right
from typing import Any

from ddgcli.scenes.shapes import Rotation


def require_ascending(times: list[float]) -> None:
    """Raise an error where key times are not strictly ascending.

    Parameters
    ----------
    times : list of float
        In s.

    Raises
    ------
    ValueError
    """
    for k, (before, after) in enumerate(zip(times, times[1:])):
        if not after > before:
            raise ValueError(f"must ascend: entry {k + 1}, {after:g} s, is not after {before:g} s")


def require_from_rest(
    times: list[float], positions: list[Any] | None, rotations: list[Rotation] | None
) -> None:
    """Raise an error where key frames are incomplete, or do not start where the body is drawn.

    Parameters
    ----------
    times : list of float
        In s.
    positions : list or None
    rotations : list of Rotation or None

    Raises
    ------
    ValueError
    """
    if positions is None and rotations is None:
        raise ValueError("give positions, rotations or both beside times")
    for name, key_frames in (("positions", positions), ("rotations", rotations)):
        if key_frames is not None and len(key_frames) != len(times):
            raise ValueError(f"{name} has {len(key_frames)} entries and times {len(times)}")
    if positions is not None and any(positions[0]):
        raise ValueError("positions[0] must be [0, 0, 0]: the body starts where it is drawn")
    if rotations is not None and rotations[0].degrees:
        raise ValueError("rotations[0] must have degrees = 0: the body starts where it is drawn")
    last = bisect_right(times, 0.0)  # key frame after t = 0
    around = slice(max(last - 1, 0), last if last and times[last - 1] == 0 else last + 1)
    moved = any(any(position) for position in (positions or [])[around])
    turned = any(rotation.degrees for rotation in (rotations or [])[around])
    if times[0] < 0 and (moved or turned):
        raise ValueError(
            f"times begin at {times[0]:g} s, and the run at 0 s, where the key frames have moved the body "
            f"already: the body starts where it is drawn; add {-times[0]:g} s to each of times"
        )
