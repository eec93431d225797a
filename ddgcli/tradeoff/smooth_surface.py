"""Smooth surface through the vertices of a mesh, and answers on it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.polynomial_fits import fitted_gradient
from ddgcli.algorithms.curvature.rings import two_rings
from ddgcli.geometry.extrinsic import dihedral_angle
from ddgcli.geometry.normals import sphere_normals
from ddgcli.mesh.shapes import midpoint_subdivided
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_dot

MIN_FITTED_NEIGHBOURS = 14  # of a cubic fit; below, a third ring is added
MAX_OVERSHOOT = 0.1  # of the range of the values around an edge
CREASE_ANGLE = np.pi / 4  # dihedral angle above which an edge stays a crease


def smoothly_subdivided(mesh: TriangleMesh) -> TriangleMesh:
    """Every face split in four, edge midpoints moved onto a smooth surface; original vertices stay.

    On a sphere the midpoints are at a distance of fourth order in the edge length from it.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    TriangleMesh

    References
    ----------
    A. Vlachos et al., "Curved PN triangles", 2001: each edge is a cubic with its ends' tangent planes.
    """
    topology = mesh.topology
    crease = np.abs(dihedral_angle(mesh)) > CREASE_ANGLE
    creased = np.zeros(mesh.n_vertices, dtype=bool)
    creased[topology.edges[crease]] = True
    tail, head = topology.edges.T
    normal = sphere_normals(mesh)
    vector = mesh.points[head] - mesh.points[tail]
    lift = np.zeros_like(vector)
    for end, sign in ((tail, 1.0), (head, -1.0)):
        height = np.where(creased[end], 0.0, sign * row_dot(vector, normal[end]))
        lift -= height[:, None] * normal[end] / 8.0
    finer = midpoint_subdivided(mesh)
    points = np.array(finer.points)
    points[mesh.n_vertices :] += lift
    return finer.moved_unchecked(points)


def smooth_midpoint_values(mesh: TriangleMesh, values: NDArray) -> NDArray[np.float64]:
    """Values of a smooth function at the midpoints of edges, given those at the vertices.

    Along each edge the function is a cubic with the gradients at the ends, of cubic fits. Where the values
    jump it may leave those around both ends by a tenth of their range.

    Parameters
    ----------
    mesh : TriangleMesh
    values : (n,) or (n, d) ndarray of float64

    Returns
    -------
    (e,) or (e, d) ndarray of float64
    """
    if values.ndim == 2:
        return np.stack([smooth_midpoint_values(mesh, column) for column in values.T], axis=1)
    tail, head = mesh.topology.edges.T
    columns = np.ascontiguousarray(mesh.points.T)
    regions = two_rings(mesh.topology, MIN_FITTED_NEIGHBOURS)
    gradient = fitted_gradient(columns, sphere_normals(mesh).T, regions, values)
    along = columns[:, head] - columns[:, tail]
    lift = (along * (gradient[:, tail] - gradient[:, head])).sum(axis=0) / 8.0
    around, ends = values[regions.member], mesh.topology.edges
    low = np.minimum.reduceat(around, regions.start[:-1])[ends].min(axis=1)
    high = np.maximum.reduceat(around, regions.start[:-1])[ends].max(axis=1)
    room = MAX_OVERSHOOT * (high - low)
    return np.clip(0.5 * (values[tail] + values[head]) + lift, low - room, high + room)


def is_plain_surface(mesh: TriangleMesh) -> bool:
    """Whether every edge has at most two faces, and the faces are oriented alike.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    bool
    """
    return bool(mesh.topology.is_oriented and not len(mesh.topology.nonmanifold_edges))


def smooth_answer(mesh: TriangleMesh, answer: Callable[[TriangleMesh], NDArray]) -> NDArray[np.float64]:
    """Estimate an answer on the smooth surface through the vertices of a mesh.

    The mesh and one of half its edge lengths on that surface give the limit of errors of second order.

    Parameters
    ----------
    mesh : TriangleMesh
    answer : callable
        Answer on a mesh whose first vertices are those of `mesh`.

    Returns
    -------
    ndarray of float64
    """
    coarse, fine = answer(mesh), answer(smoothly_subdivided(mesh))
    with np.errstate(invalid="ignore"):  # infinite distances
        return np.asarray(fine + (fine - coarse) / 3.0)
