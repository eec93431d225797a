"""Whether a surface passes through itself during a flow: no energy feels it."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import counted
from ddgcli.geometry.intersections import bounded_intersections
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.state import FlowState

STEPS_PER_CHECK = 10  # so that checks take a few hundredths of a flow
UNKNOWN = -1


def self_intersections(mesh: TriangleMesh) -> int:
    """Number of pairs of faces of a surface that cross.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    int
        UNKNOWN where too many faces lie side by side.
    """
    pairs = bounded_intersections(mesh.points, mesh.faces)
    return UNKNOWN if pairs is None else len(pairs)


def checked(before: FlowState, after: FlowState) -> FlowState:
    """The state after a step; every tenth with its number of intersections, else with that of the last check.

    Where that is unknown, it stays so.

    Parameters
    ----------
    before, after : FlowState

    Returns
    -------
    FlowState
    """
    is_known = before.self_intersections != UNKNOWN
    if not is_known or after.steps // STEPS_PER_CHECK == before.steps // STEPS_PER_CHECK:
        return after
    mesh = TriangleMesh(after.points, after.topology)
    return replace(after, self_intersections=self_intersections(mesh))


def report_of(
    series: Mapping[str, NDArray], times: NDArray | None, last: TriangleMesh
) -> dict[str, int | None]:
    """Intersections at the start, at the end and the most of a run, with a warning where it made some.

    Parameters
    ----------
    series : mapping of str to (T,) ndarray
        Scalars of every frame.
    times : (T,) ndarray or None
        Of the frames of a flow in time; others are at steps.
    last : TriangleMesh
        At the end.

    Returns
    -------
    dict of str to int or None
        `start`, `end`, `most`; None where a number is unknown.
    """
    counts = series["self_intersections"].astype(np.int64)
    if counts[-1] != UNKNOWN:
        counts[-1] = self_intersections(last)
    if counts[-1] == UNKNOWN:
        return {"start": None if counts[0] == UNKNOWN else int(counts[0]), "end": None, "most": None}
    start, most = int(counts[0]), int(counts.max())
    if most > start:
        first = int(np.argmax(counts > start))
        when = f"step {series['steps'][first]:.0f}" if times is None else f"time {times[first]:.6g}"
        logging.getLogger("ddgcli").warning(
            "the surface passes through itself, which no energy prevents: %s at the end "
            "(%d at the start, at most %d; more than at the start first seen at %s)",
            counted(int(counts[-1]), "pair of faces crosses", "pairs of faces cross"), start, most, when,
        )  # fmt: skip
    return {"start": start, "end": int(counts[-1]), "most": most}
