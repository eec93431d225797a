"""Circumcentric dual of an intrinsic triangulation: circumcentres, signed dual lengths, dual areas.

Interior dual edges of a Delaunay triangulation are not negative: its dual is the Voronoi diagram of the
vertices wherever the circumdisks of the faces are flat (chapter 10).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.common_subdivision import CommonSubdivision
from ddgcli.algorithms.delaunay.point_location import PointMap
from ddgcli.algorithms.delaunay.triangulation import length_scale
from ddgcli.algorithms.tracing.trace import trace
from ddgcli.errors import MeshError
from ddgcli.geometry.intrinsic import corner_cotan, face_area, half_angle_tangent
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh, SurfaceMesh
from ddgcli.mesh.require import check_size
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import PREVIOUS
from ddgcli.representation import short_repr

NEGATIVE_LENGTH_TOLERANCE = 1e-9  # of the primal length; a dual edge of a tie has length zero


@dataclass(frozen=True, eq=False)
class CircumcentricDual:
    """Dual cells at the circumcentres of faces.

    Parameters
    ----------
    circumcentre : (m, 3) ndarray of float64
        Barycentric coordinates of the circumcentre in its face; negative where it lies beyond a side.
    circumradius : (m,) ndarray of float64
    side_distance : (m, 3) ndarray of float64
        Distance of the circumcentre from side j, negative where it lies beyond.
    edge_faces : (e, 2) ndarray of int64
        Faces beside each edge; -1 beyond the boundary.
    edge_length, dual_length : (e,) ndarray of float64
        Length of an edge and of its dual: the distance between the circumcentres of its faces, negative where
        they lie in the wrong order; at the boundary the distance of the one circumcentre.
    dual_area : (n,) ndarray of float64
        Signed area of the dual cell of each vertex; sums to the area.
    area_residual, length_residual : float
        Difference of the sum of the dual areas from the area, relative to it; largest difference of a dual
        length from edge length times cotangent weight, relative to the larger of both circumradii.
    """

    circumcentre: NDArray[np.float64]
    circumradius: NDArray[np.float64]
    side_distance: NDArray[np.float64]
    edge_faces: NDArray[np.int64]
    edge_length: NDArray[np.float64]
    dual_length: NDArray[np.float64]
    dual_area: NDArray[np.float64]
    area_residual: float
    length_residual: float

    __repr__ = short_repr

    @property
    def negative_edges(self) -> int:
        """Number of edges with a dual of negative length, beyond rounding."""
        return int((self.dual_length < -NEGATIVE_LENGTH_TOLERANCE * self.edge_length).sum())


@np.errstate(divide="ignore", invalid="ignore", over="ignore")  # faces almost without area
def circumcentric_dual(mesh: SurfaceMesh) -> CircumcentricDual:
    """Circumcentric dual of a triangulation, by its side lengths alone.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Every face with area.

    Returns
    -------
    CircumcentricDual

    Raises
    ------
    MeshError
        For a mesh without faces, or lengths whose squares leave the floating-point range.

    Notes
    -----
    With circumradius R = abc / (4 area), the circumcentre lies R cos(opposite angle) from a side.
    """
    if mesh.topology.n_faces == 0:
        raise MeshError("no triangles; a circumcentric dual needs a surface")
    check_size(float(mesh.side_length.max()))  # areas are squares of lengths
    unit, topology = length_scale(mesh.side_length), mesh.topology
    length = mesh.side_length / unit  # squares of tiny and huge lengths leave the range of float64
    area, tangent = face_area(length), half_angle_tangent(length)
    sine, cosine = np.sin(2.0 * np.arctan(tangent)), np.cos(2.0 * np.arctan(tangent))  # of the corners
    radius = length.prod(axis=1) / (4.0 * area)
    centre = cosine / (2.0 * np.roll(sine, 1, axis=1) * np.roll(sine, 2, axis=1))
    distance = radius[:, None] * cosine[:, PREVIOUS]
    edge, n_edges = topology.side_edge.ravel(), topology.n_edges
    edge_length = np.empty(n_edges)
    edge_length[edge] = length.ravel()
    dual_length = sum_by_index(edge, distance.ravel(), n_edges)
    corner_area = 0.25 * (length * distance + np.roll(length * distance, 1, axis=1))
    dual_area = sum_by_index(mesh.faces, corner_area, mesh.n_vertices)
    weight = sum_by_index(edge, 0.5 * corner_cotan(length)[:, PREVIOUS].ravel(), n_edges)
    largest = np.zeros(n_edges)
    np.maximum.at(largest, edge, np.repeat(radius, 3))
    return CircumcentricDual(
        centre,
        radius * unit,
        distance * unit,
        _edge_faces(edge, n_edges),
        edge_length * unit,
        dual_length * unit,
        dual_area * unit**2,
        float(abs(dual_area.sum() - area.sum()) / area.sum()),
        float((np.abs(dual_length - weight * edge_length) / largest).max(initial=0.0)),
    )


def _edge_faces(edge: NDArray, n_edges: int) -> NDArray[np.int64]:
    """(e, 2) faces beside edges with at most two sides, from the edge of each side."""
    faces = np.full((n_edges, 2), -1, dtype=np.int64)
    order = np.argsort(edge, kind="stable")
    first = np.append(True, edge[order][1:] != edge[order][:-1])
    faces[edge[order[first]], 0] = order[first] // 3
    faces[edge[order[~first]], 1] = order[~first] // 3
    return faces


def dual_lines(dual: CircumcentricDual, cut: CommonSubdivision) -> CurveSet:
    """Dual edges as lines on the input surface, each as two halves from the middle of its edge.

    Parameters
    ----------
    dual : CircumcentricDual
        Dual of `cut.intrinsic`.
    cut : CommonSubdivision

    Returns
    -------
    CurveSet
        Array `edge`: the edge whose dual a point belongs to. The lines bend where they cross intrinsic edges.
        Dual edges of negative length, and what lies beyond the boundary, are left out.
    """
    topology = cut.intrinsic.topology
    if cut.lifted is not None:  # lines over the double cover, from the sides of its first half
        cut = cut.lifted
        dual = circumcentric_dual(cut.intrinsic)
    mesh = cut.intrinsic
    side, start, length = _half_edges(dual, mesh)
    own = side < len(topology.side_tail)
    side, start, length = side[own], start[own], length[own]
    face, k = np.divmod(side, 3)
    middle = np.zeros((len(side), 3))
    rows = np.arange(len(side))
    middle[rows, k] = middle[rows, (k + 1) % 3] = 0.5
    inward = 1j * _side_vectors(mesh.side_length)[face, k]
    first = trace(mesh, face, middle, np.stack([inward.real, inward.imag], axis=1), start)
    lines = trace(mesh, first.face, first.barycentric, first.direction, length, record=True)
    where = PointMap(cut).to_input(SurfacePoints(lines.path_face, lines.path_barycentric))
    n_points = np.diff(lines.path_start)
    tail = np.delete(np.arange(len(where)), lines.path_start[1:] - 1)
    edge = np.repeat(topology.side_edge.ravel()[side], n_points)
    return CurveSet(where.positions(cut.input), np.stack([tail, tail + 1], axis=1), {"edge": edge})


def _half_edges(dual: CircumcentricDual, mesh: IntrinsicMesh) -> tuple[NDArray, NDArray, NDArray]:
    """Sides from whose middles dual edges run into their faces, the distances to their starts, their lengths.

    Where the circumcentre of the other face lies on the same side of the edge, the dual edge starts there.
    The circumcentre of a face without area may lie at infinity: its dual edges have no end.
    """
    twin, distance = mesh.topology.side_twin.ravel(), dual.side_distance.ravel()
    start = np.where(twin >= 0, np.maximum(-distance[twin], 0.0), 0.0)
    side = np.flatnonzero((distance > start) & np.isfinite(distance))
    return side, start[side], (distance - start)[side]


@np.errstate(invalid="ignore")
def _side_vectors(length: NDArray) -> NDArray[np.complex128]:
    """(m, 3) sides as complex numbers, in the plane with corner 0 at 0 and corner 1 on the real axis."""
    cotan = corner_cotan(length)
    height = 2.0 * face_area(length) / length[:, 0]
    apex = height * (cotan[:, 0] + 1j)
    return np.stack([length[:, 0] + 0j, apex - length[:, 0], -apex], axis=1)
