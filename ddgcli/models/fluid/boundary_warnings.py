"""Warnings of sections of the effect `boundary` that hold elsewhere than they seem to."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.effect_parts import BoundaryPart

log = logging.getLogger("ddgcli")


def warn_of_crossed_obstacles(
    context: FluidContext, sections: Sequence[BoundaryPart], owner: NDArray, vertices: NDArray
) -> None:
    """Report obstacles that fluid crosses, since an inflow or outflow holds on their boundary, too.

    Parameters
    ----------
    context : FluidContext
    sections : sequence of BoundaryPart
    owner : (s,) ndarray of int64
        Index of the section of every boundary side.
    vertices : (s, 2 or 3) ndarray of int64
        Corners of these sides.
    """
    for number, section in enumerate(sections):
        if section.kind not in ("inflow", "outflow") or section.obstacle is not None:
            continue
        for name, rim in context.obstacles.items():
            if (rim[vertices].all(axis=1) & (owner == number)).any():
                log.warning(
                    "the %s where %r holds on the boundary of obstacle %r, too, so that fluid crosses it: "
                    "narrow `where`, or write a section with obstacle = %r before it",
                    section.kind, section.where, name, name,
                )  # fmt: skip


def warn_of_still_walls(sections: Sequence[BoundaryPart], owner: NDArray, along: NDArray) -> None:
    """Report walls that sections before them hide, and moving walls that move nothing.

    Parameters
    ----------
    sections : sequence of BoundaryPart
    owner : (s,) ndarray of int64
        Index of the section of every boundary side.
    along : (s,) ndarray of float64
        What is 0 where the prescribed velocity has no component along the side.
    """
    hidden = sorted(set(range(len(sections))) - set(owner.tolist()))
    for number in hidden:
        section = sections[number]
        where = "" if section.where is None else f" where {section.where!r} holds"
        log.warning(
            "section %d of boundary (%s%s) has no side left: sections before it hold at all of its sides; "
            "put it before them",
            number + 1, section.kind, where,
        )  # fmt: skip
    moving = [
        i
        for i, section in enumerate(sections)
        if section.kind in ("no-slip", "wall") and section.velocity and i not in hidden
    ]
    if moving and not along[np.isin(owner, moving)].any():
        log.warning("no part of the wall moves along itself: velocity or where is 0 at every boundary side")
