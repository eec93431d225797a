"""Angle sums and scale factors that a conformal map must have at its vertices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.choices import CONFORMAL_BOUNDARIES
from ddgcli.errors import MeshError, ParameterError
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.require import LENGTH_RANGE, require
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh

GAUSS_BONNET_TOLERANCE = 1e-9  # of a full turn


@dataclass(frozen=True, eq=False)
class ConformalTargets:
    """What a conformal map must have at its vertices.

    Parameters
    ----------
    angle : (n,) ndarray of float64
        Angle sums in radians; not used at fixed vertices.
    fixed : (n,) ndarray of bool
        Vertices whose scale factor is prescribed.
    scale : (n,) ndarray of float64
        Logarithmic scale factors of fixed vertices.
    cone : (n,) ndarray of bool
        Interior vertices with an angle sum other than a full turn.
    """

    angle: NDArray[np.float64]
    fixed: NDArray[np.bool_]
    scale: NDArray[np.float64]
    cone: NDArray[np.bool_]


def conformal_targets(
    mesh: TriangleMesh,
    cones: Mapping[int, float] | None = None,
    boundary: str = "free",
    boundary_values: NDArray | None = None,
) -> ConformalTargets:
    """Angle sums and fixed scale factors from what a user prescribes, checked by Gauss-Bonnet.

    Parameters
    ----------
    mesh : TriangleMesh
        A connected oriented manifold.
    cones : mapping of vertex to degrees, optional
        Angle sums, 360 elsewhere; of boundary vertices with `boundary='angles'` only.
    boundary : {'free', 'lengths', 'angles'}
        `free`: scale factor 1 on the boundary, whose edges keep their lengths (the least distortion of area).
        `lengths`: the logarithmic scale factors of `boundary_values`. `angles`: the angle sums of
        `boundary_values` in degrees, or 180 but for the boundary vertices in `cones`; without both, turning
        in
        proportion to length, nearly a circle.
    boundary_values : (n,) ndarray, optional
        Read at boundary vertices.

    Returns
    -------
    ConformalTargets

    Raises
    ------
    MeshError
        Several components, or no oriented manifold.
    ParameterError
        A vertex without faces, an angle that is not positive, a scale factor that leaves no length whose
        square is a number, or angle sums that contradict Gauss-Bonnet.
    """
    subject = "a discrete conformal map"
    require(mesh, subject, manifold=True, oriented=True, extent=True)
    topology = mesh.topology
    if topology.n_components != 1:
        raise MeshError(f"{topology.n_components} components; {subject} takes one: {remedy('components')}")
    if boundary not in CONFORMAL_BOUNDARIES:
        raise ParameterError(
            f"{boundary!r} is not one of {', '.join(CONFORMAL_BOUNDARIES)}", parameter="boundary"
        )
    edge = topology.boundary_vertex
    angle = np.where(edge, np.pi, 2 * np.pi)
    scale = np.zeros(mesh.n_vertices)
    _check_boundary(boundary, boundary_values, mesh)
    degrees = dict(cones or {})
    on_boundary = _checked_cones(mesh, degrees, boundary)
    if boundary == "lengths":
        scale[edge] = np.asarray(boundary_values, dtype=float)[edge]
        _check_scale(mesh, np.flatnonzero(edge), scale[edge])
    elif boundary == "angles" and boundary_values is not None:
        angle[edge] = np.radians(np.asarray(boundary_values, dtype=float)[edge])
    vertex = np.fromiter(degrees, dtype=np.int64, count=len(degrees))
    angle[vertex] = np.radians(np.fromiter(degrees.values(), dtype=float, count=len(degrees)))
    if boundary == "angles" and boundary_values is None and not on_boundary:
        angle[edge] -= _turning(mesh, angle)[edge]
    if not (angle > 0).all():
        bad = int(np.argmin(angle))
        raise ParameterError(
            f"the angle sum of vertex {bad} is {np.degrees(angle[bad]):.4g} degrees; it must be positive",
            parameter="cones",
        )
    fixed = edge & (boundary != "angles")
    if not fixed.any():
        values_alone = boundary == "angles" and boundary_values is not None and not degrees
        _check_total(mesh, angle, "boundary_values" if values_alone else "cones")
    return ConformalTargets(angle, fixed, scale, ~edge & (np.abs(angle - 2 * np.pi) > GAUSS_BONNET_TOLERANCE))


def _check_boundary(boundary: str, values: NDArray | None, mesh: TriangleMesh) -> None:
    if boundary != "free" and mesh.topology.is_closed:
        raise ParameterError("the surface is closed; leave the option out", parameter="boundary")
    if boundary == "lengths" and values is None:
        raise ParameterError(
            "`boundary=lengths` needs logarithmic scale factors; add `boundary_values`", parameter="boundary"
        )
    if values is None:
        return
    if boundary == "free":
        raise ParameterError(
            "applies to `boundary=lengths` and `boundary=angles`; add one of them",
            parameter="boundary_values",
        )
    values = np.asarray(values)
    if values.shape != (mesh.n_vertices,) or not np.isfinite(values[mesh.topology.boundary_vertex]).all():
        raise ParameterError(
            f"needs a finite number at each of {mesh.n_vertices} vertices", parameter="boundary_values"
        )


def _check_scale(mesh: TriangleMesh, vertex: NDArray, scale: NDArray) -> None:
    """Raise ParameterError for a scale factor whose exponential takes sides out of the range of lengths."""
    low, high = np.log(LENGTH_RANGE[2]) - np.log(mesh.side_length.max())
    bad = np.flatnonzero((scale < low) | (scale > high))
    if len(bad):
        raise ParameterError(
            f"the logarithmic scale factor of vertex {vertex[bad[0]]} is {scale[bad[0]]:.6g}, and lengths "
            f"times its exponential over- or underflow if squared; use {np.ceil(low):.0f} to "
            f"{np.floor(high):.0f}",
            parameter="boundary_values",
        )


def _checked_cones(mesh: TriangleMesh, degrees: dict[int, float], boundary: str) -> bool:
    """Check vertices and angles of cones; True where one lies on the boundary."""
    topology, on_boundary = mesh.topology, False
    for vertex, value in degrees.items():
        if not 0 <= vertex < mesh.n_vertices or not topology.referenced_vertex[vertex]:
            raise ParameterError(
                f"vertex {vertex} belongs to no face; use vertices of faces, below {mesh.n_vertices}",
                parameter="cones",
            )
        if not 0 < value < np.inf:
            raise ParameterError(f"vertex {vertex} has {value:g} degrees; use more than 0", parameter="cones")
        if topology.boundary_vertex[vertex]:
            on_boundary = True
            if boundary != "angles":
                raise ParameterError(
                    f"vertex {vertex} lies on the boundary; add `boundary=angles`", parameter="cones"
                )
    return on_boundary


def _turning(mesh: TriangleMesh, angle: NDArray) -> NDArray[np.float64]:
    """(n,) turning angles along the boundary in proportion to length, with the total of Gauss-Bonnet."""
    topology = mesh.topology
    ends, inside = topology.edges[topology.boundary_edges], ~topology.boundary_vertex
    length = np.linalg.norm(mesh.points[ends[:, 1]] - mesh.points[ends[:, 0]], axis=1)
    share = sum_by_index(ends.ravel(), np.repeat(0.5 * length, 2), mesh.n_vertices) / length.sum()
    inside &= topology.referenced_vertex
    total = 2 * np.pi * topology.euler_characteristic - (2 * np.pi - angle[inside]).sum()
    return share * total


def _check_total(mesh: TriangleMesh, angle: NDArray, parameter: str) -> None:
    """Raise ParameterError where the angle sums contradict Gauss-Bonnet."""
    topology = mesh.topology
    full = np.where(topology.boundary_vertex, np.pi, 2 * np.pi)
    total = (full - angle)[topology.referenced_vertex].sum()
    euler = topology.euler_characteristic
    if abs(total - 2 * np.pi * euler) > 2 * np.pi * GAUSS_BONNET_TOLERANCE:
        if topology.is_closed and (angle == full).all():
            raise ParameterError(
                f"a closed surface of genus {topology.genus} needs cones, whose 360 minus angle sum to "
                f"{360 * euler} (Gauss-Bonnet): {2 * abs(euler)} vertices with {360 - 180 * np.sign(euler)} "
                f"degrees, for example; or {remedy('no boundary', topology)}",
                parameter="cones",
            )
        where = "vertices" if topology.is_closed else "vertices, 180 minus it on the boundary,"
        raise ParameterError(
            f"360 minus the angle sum, over all {where} is {np.degrees(total):.6g} degrees in total; it must "
            f"be {360 * euler} (Gauss-Bonnet); change the angles of `{parameter}`",
            parameter=parameter,
        )
