"""Triangulation that a flow is computed on: the mesh's own, or the Delaunay one of the same vertices.

The discrete flows exist on any triangles (dual lengths then have signs), but across edges whose opposite
angles sum to far more than pi the linear stream function is a bad interpolant, and errors are ten times those
of good triangles. Where this holds for more than `MAX_BAD_SHARE` of the inner edges, edges are flipped: the
surface and its vertices stay as they are (A. Bobenko and B. Springborn, 2007).
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any

import numpy as np

from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.extent import plane_axes

log = logging.getLogger("ddgcli")

BAD_ANGLES = np.pi + 0.2  # sum of the angles opposite an edge, above which it counts as bad
MAX_BAD_SHARE = 0.02  # of the inner edges


def with_triangulation(context: FluidContext, choice: str) -> FluidContext:
    """The context of a fluid on the triangulation that `choice` names; 'auto' by the rule of this module.

    Parameters
    ----------
    context : FluidContext
    choice : {'input', 'delaunay', 'auto'}

    Returns
    -------
    FluidContext

    Raises
    ------
    ValueError
        When 'delaunay' is chosen and impossible: arrays on faces, or edges that would join one vertex to
        itself or two vertices twice.
    """
    mesh = context.mesh
    if not isinstance(mesh, TriangleMesh) or choice == "input":
        return context
    bad, inner = bad_edges(mesh), int((mesh.topology.side_twin >= 0).sum()) // 2
    facts: dict[str, Any] = {"used": "input", "bad_edges": bad, "inner_edges": inner}
    context = replace(context, triangulation=facts)
    if choice == "auto" and not bad > MAX_BAD_SHARE * inner:
        return context
    from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay

    delaunay = flip_to_delaunay(mesh)
    obstacle = _hindrance(context, delaunay.mesh)
    if obstacle:
        if choice == "delaunay":
            raise ValueError(f'triangulation = "delaunay": {obstacle}')
        log.warning(
            "%s: %d of %d inner edges are far from Delaunay, and errors may be ten times those of good "
            "triangles: %s; remesh it", context.name, bad, inner, obstacle,
        )  # fmt: skip
        return context
    if choice == "auto":
        log.info(
            "%s: %d of %d inner edges are far from Delaunay; the flow is computed on the Delaunay "
            'triangulation of the same vertices (%d flips; triangulation = "input" keeps the mesh\'s own)',
            context.name, bad, inner, delaunay.flips,
        )  # fmt: skip
    facts = {**facts, "used": "delaunay", "flips": delaunay.flips}
    return replace(context, mesh=_on_points(delaunay.mesh, context), triangulation=facts)


def bad_edges(mesh: TriangleMesh | IntrinsicMesh) -> int:
    """Number of inner edges whose opposite angles sum to more than `BAD_ANGLES`."""
    opposite = corner_angle(mesh.side_length)[:, [2, 0, 1]].ravel()
    twin = mesh.topology.side_twin.ravel()
    first = twin > np.arange(len(twin))
    return int((first & (opposite + opposite[np.maximum(twin, 0)] > BAD_ANGLES)).sum())


def _hindrance(context: FluidContext, delaunay: IntrinsicMesh) -> str:
    """Why a triangulation cannot be used, or ""."""
    if context.face:
        return f"the file has arrays on faces ({', '.join(context.face)})"
    ends = np.sort(delaunay.topology.edges, axis=1)
    if (ends[:, 0] == ends[:, 1]).any() or len(np.unique(ends, axis=0)) < len(ends):
        return "two vertices would be joined by two edges"
    return ""


def _on_points(delaunay: IntrinsicMesh, context: FluidContext) -> TriangleMesh | IntrinsicMesh:
    """A mesh in space where the surface is flat, else lengths with the positions of the vertices."""
    points = np.asarray(context.mesh.points)
    if plane_axes(context) is not None:
        return TriangleMesh.from_arrays(points, np.array(delaunay.faces))
    topology = Topology(np.array(delaunay.faces), len(points))
    return IntrinsicMesh(topology, delaunay.side_length, points)
