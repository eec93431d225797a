"""Curvature measures of triangle surfaces (chapters 1 to 3 of the notes): what is exact on the polyhedron.

Angle defects and edge angles integrate curvature over the surface; nothing here is an estimate but for
`mean_curvature_normal`, which divides by an area.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import corner_angle, corner_cotan, face_area
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh, vector_length
from ddgcli.operators.laplacian import SurfaceMesh


def face_angles(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """(m, 3) corner angles that sum to pi in every face, in radians.

    A face with a side of no length has two right angles at that side's ends (the limit of an isosceles
    needle); a face that is a point has three equal ones.
    """
    length = mesh.side_length
    angle = corner_angle(length)
    none = length == 0
    bad = np.flatnonzero(none.any(axis=1))
    if len(bad):
        ends = none[bad] | none[bad][:, PREVIOUS]
        right = np.where(ends, np.pi / 2, 0.0)
        point = none[bad].all(axis=1)
        angle[bad] = np.where(point[:, None], np.pi / 3, right)
    return angle


def angle_defect(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """(n,) integrated Gaussian curvature: 2 pi - sum of angles inside, pi - sum on the boundary, in radians.

    Zero at vertices that no face uses. Chapter 3, 2.1; on manifolds the sum is 2 pi chi.
    """
    topology = mesh.topology
    total = np.bincount(mesh.faces.ravel(), weights=face_angles(mesh).ravel(), minlength=mesh.n_vertices)
    full = np.where(topology.boundary_vertex, np.pi, 2 * np.pi)
    return np.where(topology.referenced_vertex, full - total, 0.0)


def gauss_bonnet_total(mesh: SurfaceMesh) -> float:
    """What the angle defects of any complex sum to: 2 pi chi, and pi for each boundary corner too many.

    At a vertex with k boundary edges the defect that makes the sum 2 pi chi is 2 pi - k pi / 2 - sum of
    angles; k is 0 or 2 on a manifold. Edges with three or more faces count as -(faces - 2) boundary edges.
    """
    topology = mesh.topology
    missing = 2 - topology.edge_face_count
    at_vertex = np.zeros(mesh.n_vertices)
    np.add.at(at_vertex, topology.edges[missing != 0].ravel(), np.repeat(missing[missing != 0], 2))
    excess = np.where(topology.boundary_vertex, at_vertex - 2, at_vertex)
    return float(2 * np.pi * topology.euler_characteristic + np.pi / 2 * excess.sum())


def vertex_area(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """(n,) mixed Voronoi areas, in length^2: they sum to the area of the surface.

    Notes
    -----
    Meyer et al. 2003: the Voronoi part of acute triangles; half the triangle at an obtuse corner and a
    quarter at the other two.
    """
    return _mixed_area(mesh.side_length, corner_cotan(mesh.side_length), mesh.faces, mesh.n_vertices)


def _mixed_area(length: NDArray, cotan: NDArray, faces: NDArray, n: int) -> NDArray[np.float64]:
    area = face_area(length)
    with np.errstate(invalid="ignore"):
        half = 0.125 * length * length * cotan[:, PREVIOUS]  # of side j, for each of its two ends
        voronoi = half + half[:, PREVIOUS]
    obtuse = cotan < 0
    plain = ~obtuse.any(axis=1) & np.isfinite(voronoi).all(axis=1)
    shared = np.where(obtuse, 0.5, 0.25) * area[:, None]
    needs_thirds = ~plain & ~obtuse.any(axis=1)
    shared[needs_thirds] = area[needs_thirds, None] / 3
    share = np.where(plain[:, None], voronoi, shared)
    return np.bincount(faces.ravel(), share.ravel(), n).astype(np.float64)


def boundary_length(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """(n,) half the length of the boundary edges at each vertex."""
    topology = mesh.topology
    length = np.zeros(topology.n_edges)
    length[topology.side_edge.ravel()] = mesh.side_length.ravel()
    edges = topology.edges[topology.boundary_edges]
    half = np.repeat(0.5 * length[topology.boundary_edges], 2)
    return np.bincount(edges.ravel(), half, mesh.n_vertices).astype(np.float64)


def geodesic_curvature(mesh: SurfaceMesh, defect: NDArray | None = None) -> NDArray[np.float64]:
    """(n,) angle defect / boundary length at boundary vertices, in 1/length; 0 inside."""
    defect = angle_defect(mesh) if defect is None else defect
    length = boundary_length(mesh)
    return np.divide(defect, length, out=np.zeros_like(defect), where=length > 0)


def combinatorial_curvature(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """(n,) the angle defect that equilateral triangles would have, in radians: pi/3 (6 - degree) inside.

    Chapter 3, 2.1. On the boundary pi - pi/3 for each face, that is pi/3 (4 - degree).
    """
    topology = mesh.topology
    faces = np.bincount(mesh.faces.ravel(), minlength=mesh.n_vertices)
    full = np.where(topology.boundary_vertex, 3, 6)
    return np.where(topology.referenced_vertex, np.pi / 3 * (full - faces), 0.0)


def pointwise(integrated: NDArray, area: NDArray) -> NDArray[np.float64]:
    """Integrated values over areas; 0 where a vertex has no area."""
    area = area if integrated.ndim == 1 else area[:, None]
    return np.divide(integrated, area, out=np.zeros_like(integrated), where=area > 0)


def curvature_vector(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(n, 3) integrated mean curvature vector, minus half the area gradient: inward where convex.

    Half of what chapter 3 calls H_p, for H is half the sum of the principal curvatures here. On the
    boundary the tension along the boundary edges, which is no curvature of the surface, is taken off: the
    sum over the edges with two faces stays. Faces without area add nothing.
    """
    topology = mesh.topology
    cotan = corner_cotan(mesh.side_length)[:, PREVIOUS]
    weight = 0.25 * np.where(np.isfinite(cotan), cotan, 0.0).ravel()
    tail, head = topology.side_tail, topology.side_head
    total = np.zeros((3, mesh.n_vertices))
    for i, x in enumerate(np.ascontiguousarray(mesh.points.T)):
        pull = weight * (x[head] - x[tail])
        total[i] = np.bincount(tail, pull, mesh.n_vertices) - np.bincount(head, pull, mesh.n_vertices)
    rim = np.flatnonzero(topology.edge_face_count[topology.side_edge.ravel()] == 1)
    if len(rim):
        face = rim // 3
        side = mesh.side_vector.reshape(-1, 3)
        normal = np.cross(mesh.side_vector[face, 0], mesh.side_vector[face, 1])
        size = vector_length(normal)[:, None]
        normal = np.divide(normal, size, out=np.zeros_like(normal), where=size > 0)
        tension = 0.25 * np.cross(side[rim], normal)
        ends = np.concatenate([tail[rim], head[rim]])
        for i in range(3):
            total[i] += np.bincount(ends, np.tile(tension[:, i], 2), mesh.n_vertices)
    return np.ascontiguousarray(total.T)


def link_integral(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(n, 3) integral of the outward conormal over the link of every vertex, from face normals alone.

    Equals the integral of the mean curvature vector (sum of the principal curvatures) over an interior
    vertex's star: the force balance of chapter 3, 1.4.
    """
    side, corner = mesh.side_vector, mesh.faces.ravel()
    area_vector = np.cross(side[:, 0], side[:, 1])
    size = vector_length(area_vector)[:, None]
    normal = np.divide(area_vector, size, out=np.zeros_like(area_vector), where=size > 0)
    conormal = np.cross(side[:, NEXT], normal[:, None, :])  # of the side opposite each corner, outward
    return np.stack(
        [np.bincount(corner, conormal[..., i].ravel(), mesh.n_vertices) for i in range(3)], axis=1
    )
