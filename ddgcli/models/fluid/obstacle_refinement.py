"""Finer cells round an obstacle, before it is cut out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ddgcli.mesh.bisection import bisected
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.obstacles import SignedDistance

BISECTION_PASSES = 2  # bisections of a face that halve its sides
LEVEL_FRACTION = 0.6  # of the longest side of a level, above which a face still counts to it
REFINEMENT_REACH = 5.0  # distance from the outline, over the longest side, up to which a face is halved


def refined(context: FluidContext, distance: SignedDistance, times: int) -> FluidContext:
    """Halve the sides of the faces near an outline; arrays are interpolated.

    Parameters
    ----------
    context : FluidContext
    distance : callable
        Signed distance from the outline at positions (k, 3).
    times : int
        How often to halve.

    Returns
    -------
    FluidContext

    Raises
    ------
    ValueError
        For volumes and periodic grids.
    """
    if not isinstance(context.mesh, TriangleMesh):
        raise ValueError("refine is that of obstacles in surfaces that are not periodic; leave it out")
    size = float(np.median(context.mesh.side_length.max(axis=1)))
    for level in range(times):
        for _ in range(BISECTION_PASSES):
            mesh, longest = context.mesh, size / 2.0**level
            centre = mesh.points[mesh.faces].mean(axis=1)
            near = np.abs(distance(centre)) < REFINEMENT_REACH * longest
            context = _bisected(context, near & (mesh.side_length.max(axis=1) > LEVEL_FRACTION * longest))
    return context


def _bisected(context: FluidContext, marked: np.ndarray) -> FluidContext:
    children = bisected(context.mesh, marked)
    vertex = {
        name: np.concatenate([values, values[children.ends].mean(axis=1)])
        for name, values in context.vertex.items()
    }
    face = {name: values[children.parent] for name, values in context.face.items()}
    return replace(context, mesh=children.mesh, vertex=vertex, face=face)
