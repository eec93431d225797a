"""Smooth surface through the vertices of a mesh, and answers on it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.darboux import sphere_normals
from ddgcli.geometry.extrinsic import dihedral_angle
from ddgcli.mesh.shapes import midpoint_subdivided
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_dot

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
    return finer.moved(points)


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
