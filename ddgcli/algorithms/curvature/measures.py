"""Curvature measures that are exact on the polyhedron (chapters 1 to 3 of the notes).

Angle defects and dihedral angles integrate curvature over the surface.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.faces import Faces
from ddgcli.geometry.intrinsic import corner_angle, mixed_voronoi_share
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS, Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import cross, dot, ratio

# The force balance of each star is checked along one direction: three would cost three times as much.
BALANCE_DIRECTION = np.array([0.48, 0.6, 0.64])


def angle_defect(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Integrated Gaussian curvature of the vertices: 2 pi - sum of angles inside, pi - sum on the boundary.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n,) ndarray of float64
        In radians; zero at vertices that no face uses. On manifolds the sum is 2 pi chi (chapter 3, 2.1).

    Examples
    --------
    >>> from ddgcli.mesh.shapes import box
    >>> defect = angle_defect(box())
    >>> bool(np.isclose(defect.sum(), 4 * np.pi)), bool(np.isclose(defect.max(), np.pi / 2))
    (True, True)
    """
    if isinstance(mesh, TriangleMesh):
        return defect_of(Faces.of(mesh), mesh.topology)
    angle = corner_angle(mesh.side_length).ravel()
    return _defect(sum_by_index(mesh.faces.ravel(), angle, mesh.n_vertices), mesh.topology)


def defect_of(faces: Faces, topology: Topology) -> NDArray[np.float64]:
    """`angle_defect` from `Faces`."""
    return _defect_of(faces.vertex_sums(_angle)[0], faces, topology)


def star_measures(
    faces: Faces, topology: Topology, *further: Callable[[Faces], NDArray]
) -> list[NDArray[np.float64]]:
    """Areas, angle defects and curvature vectors of the vertices, and sums of further terms, in one pass.

    The sums of `Faces.doubled_star` are stored in `faces`.

    Parameters
    ----------
    faces : Faces
    topology : Topology
    *further : callable
        Further terms on the corners of a block of faces.

    Returns
    -------
    list of ndarray of float64
        `vertex_area` (n,), `angle_defect` (n,), `curvature_vector` as (3, n), then the sum of each further
        term.
    """
    area, angle, pull, doubled, *sums = faces.vertex_sums(
        _share, _angle, _pull, lambda block: block.on_corners, *further
    )
    faces.store(doubled_star=doubled)
    return [area, _defect_of(angle, faces, topology), _without_tension(pull, faces, topology), *sums]


def _angle(faces: Faces) -> NDArray[np.float64]:
    return faces.angle


def _share(faces: Faces) -> NDArray[np.float64]:
    return mixed_voronoi_share(faces.squared_length, faces.cotan, faces.area)


def _defect_of(total: NDArray, faces: Faces, topology: Topology) -> NDArray[np.float64]:
    """`angle_defect` from the (n,) sums of angles."""
    if "_edge_numbering" not in topology.__dict__ and _surely_closed(faces):
        return np.where(topology.referenced_vertex, 2 * np.pi - total, 0.0)
    return _defect(total, topology)


def _defect(total: NDArray, topology: Topology) -> NDArray[np.float64]:
    full = np.where(topology.boundary_vertex, np.pi, 2 * np.pi)
    return np.where(topology.referenced_vertex, full - total, 0.0)


def _surely_closed(faces: Faces) -> bool:
    """Whether the surface has no boundary edge: every neighbour of a vertex follows and precedes it in faces.

    Compares sums of random 40-bit labels, which are exact, at an eighth of the cost of numbering the edges.
    """
    n = faces.n_vertices
    label = np.random.default_rng(0).integers(0, 1 << 40, n).astype(np.float64)
    a, b, c = (np.take(label, corner) for corner in faces.corner)
    total = np.zeros(n)
    for corner, ahead, behind in zip(faces.corner, (b, c, a), (c, a, b)):
        total += sum_by_index(corner, ahead - behind, n)
    return not total.any()


def gauss_bonnet_total(mesh: SurfaceMesh) -> float:
    """Sum of the angle defects of any complex: 2 pi chi, plus pi for each surplus boundary corner.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    float
        In radians.

    Notes
    -----
    At a vertex with k boundary edges the defect that makes the sum 2 pi chi is 2 pi - k pi / 2 - sum of
    angles; k is 0 or 2 on a manifold. Edges with three or more faces count as -(faces - 2) boundary edges.
    """
    topology = mesh.topology
    missing = 2 - topology.edge_face_count
    ends = topology.edges[missing != 0].ravel()
    at_vertex = sum_by_index(ends, np.repeat(missing[missing != 0], 2), mesh.n_vertices)
    excess = np.where(topology.boundary_vertex, at_vertex - 2, at_vertex)
    return float(2 * np.pi * topology.euler_characteristic + np.pi / 2 * excess.sum())


def vertex_area(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Mixed Voronoi areas of the vertices.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n,) ndarray of float64
        In length^2; they sum to the area of the surface.

    Notes
    -----
    Meyer et al. 2003: the Voronoi part of acute triangles; half the triangle at an obtuse corner and a
    quarter at the other two.
    """
    if isinstance(mesh, TriangleMesh):
        return area_of(Faces.of(mesh))
    from ddgcli.operators.laplacian import voronoi_vertex_area  # imports scipy.sparse

    return voronoi_vertex_area(mesh)


def area_of(faces: Faces) -> NDArray[np.float64]:
    """`vertex_area` from `Faces`."""
    return faces.vertex_sums(_share)[0]


def volume_of(faces: Faces) -> float:
    """Signed volume of a closed surface.

    Parameters
    ----------
    faces : Faces
        Closed, oriented; the origin should lie near, as the volume is summed from cones over the faces with
        their apex there.

    Returns
    -------
    float
        In length^3, positive for outward orientation.
    """
    first = faces.corner[0]
    return float(sum(np.take(p, first) @ normal for p, normal in zip(faces.points, faces.doubled)) / 6.0)


def boundary_length(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """(n,) half the length of the boundary edges at each vertex."""
    topology = mesh.topology
    length = np.zeros(topology.n_edges)
    length[topology.side_edge.ravel()] = mesh.side_length.ravel()
    edges = topology.edges[topology.boundary_edges]
    half = np.repeat(0.5 * length[topology.boundary_edges], 2)
    return sum_by_index(edges.ravel(), half, mesh.n_vertices)


def geodesic_curvature(mesh: SurfaceMesh, defect: NDArray | None = None) -> NDArray[np.float64]:
    """Geodesic curvature of the boundary: angle defect over boundary length.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    defect : (n,) ndarray of float64, optional
        Angle defects, if known.

    Returns
    -------
    (n,) ndarray of float64
        In 1/length; 0 at vertices inside.
    """
    defect = angle_defect(mesh) if defect is None else defect
    length = boundary_length(mesh)
    return ratio(defect, length)


def combinatorial_curvature(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Angle defect of equilateral triangles with the same connectivity.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n,) ndarray of float64
        In radians: pi/3 (6 - degree) inside, pi/3 (4 - degree) on the boundary (chapter 3, 2.1).
    """
    topology = mesh.topology
    faces = np.bincount(mesh.faces.ravel(), minlength=mesh.n_vertices)
    full = np.where(topology.boundary_vertex, 3, 6)
    return np.where(topology.referenced_vertex, np.pi / 3 * (full - faces), 0.0)


def curvature_vector(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Integrated mean curvature vector of the vertices: minus half the area gradient.

    Half of H_p in chapter 3, because H is half the sum of the principal curvatures here. On the boundary the
    tension along the boundary edges, which is not curvature of the surface, is subtracted: the sum over the
    edges with two faces remains. Flat faces add nothing.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    (n, 3) ndarray of float64
        A length; inward where convex.
    """
    return np.ascontiguousarray(vector_of(Faces.of(mesh), mesh.topology).T)


def vector_of(faces: Faces, topology: Topology) -> NDArray[np.float64]:
    """Integrated mean curvature vectors as columns; see `curvature_vector`.

    Parameters
    ----------
    faces : Faces
    topology : Topology

    Returns
    -------
    (3, n) ndarray of float64
        A length; inward where convex.
    """
    return _without_tension(faces.vertex_sums(_pull)[0], faces, topology)


def _pull(faces: Faces) -> NDArray[np.float64]:
    """(3, 3, m) share of each corner in the curvature vector, component first."""
    quarter, side = 0.25 * faces.cotan, faces.side
    pull = np.empty((3, *faces.corner.shape))
    for k in range(3):
        for i in range(3):
            np.multiply(quarter[PREVIOUS[k]], side[k, i], out=pull[i, k])
            pull[i, k] -= quarter[NEXT[k]] * side[PREVIOUS[k], i]
    return pull


def _without_tension(total: NDArray, faces: Faces, topology: Topology) -> NDArray[np.float64]:
    """Curvature vectors from the (3, n) sums, which on the boundary hold the tension of its edges too."""
    if len(topology.boundary_edges):
        rim = np.flatnonzero(topology.edge_face_count[topology.side_edge.ravel()] == 1)
        face, j = np.divmod(rim, 3)
        tension = 0.25 * cross(faces.side_vectors(j, face), faces.normal[:, face])
        for ends in (faces.corner[j, face], faces.corner[NEXT[j], face]):
            total += sum_by_index(ends, tension.T, faces.n_vertices).T
    return total


def link_conormal(faces: Faces) -> NDArray[np.float64]:
    """Integral of the outward conormal over the side opposite each corner, along `BALANCE_DIRECTION`.

    From face normals alone. Its sum over the star of an interior vertex, the integral over the link, equals
    the integral of the mean curvature vector (sum of the principal curvatures) along that direction: the
    force balance of chapter 3, 1.4.

    Parameters
    ----------
    faces : Faces

    Returns
    -------
    (3, m) ndarray of float64
        A length.
    """
    # (side x normal) . direction = side . (normal x direction)
    across = cross(faces.normal, BALANCE_DIRECTION[:, None])
    return np.stack([dot(faces.side[NEXT[k]], across) for k in range(3)])


def link_length(faces: Faces) -> NDArray[np.float64]:
    """Length of the side opposite each corner.

    Parameters
    ----------
    faces : Faces

    Returns
    -------
    (3, m) ndarray of float64
    """
    return faces.length[NEXT]
