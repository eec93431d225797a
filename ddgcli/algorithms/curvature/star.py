"""Principal curvatures from the star of every vertex: `cotan`, `normal-cycle` and `corrected`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.frames import (
    PrincipalCurvatures,
    eigen_2x2,
    in_tangent_plane,
    tangent_frame,
    turned,
)
from ddgcli.geometry.extrinsic import EDGES_PER_BLOCK
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import PREVIOUS, Topology
from ddgcli.mesh.vectors import cross, dot, ratio

MIN_AREA_SHARE = 1e-9  # of a corrected area over the squared sides of its faces: below, it is rounding


def cotan(
    faces: Faces,
    topology: Topology,
    normal: NDArray,
    area: NDArray,
    defect: NDArray,
    vector: NDArray,
    *,
    directions: bool = True,
) -> PrincipalCurvatures:
    """Principal curvatures of Meyer et al.: H from the area gradient, K from the angle defect.

    Parameters
    ----------
    faces : Faces
    topology : Topology
    normal : (3, n) ndarray
        Unit vertex normals.
    area, defect : (n,) ndarray
        Mixed Voronoi areas and angle defects.
    vector : (3, n) ndarray
        Integrated mean curvature vectors (`vector_of`).
    directions : bool
        Whether to compute the directions; without them their arrays are (3, 0).

    Returns
    -------
    PrincipalCurvatures

    Notes
    -----
    M. Meyer, M. Desbrun, P. Schroder, A. Barr, "Discrete differential-geometry operators for triangulated
    2-manifolds", 2003. kappa = H +- sqrt(H^2 - K), the root of a negative number taken as 0. The directions
    fit the normal curvatures of the edges, weighted as in the Voronoi area, with trace 2 H.
    """
    length = np.sqrt(dot(vector, vector))
    mean = ratio(np.where(dot(vector, normal) <= 0, length, -length), area)
    gaussian = ratio(defect, area)
    reach = np.sqrt(np.maximum(mean * mean - gaussian, 0.0))
    if not directions:
        none = np.zeros((3, 0))
        return PrincipalCurvatures(mean - reach, mean + reach, none, none, gaussian)
    first, second = tangent_frame(normal)
    half_difference, off = _fitted_form(faces, topology, normal, first, second, mean)
    angle = 0.5 * np.arctan2(off, half_difference)
    high, low = turned(first, second, np.cos(angle), np.sin(angle))
    return PrincipalCurvatures(mean - reach, mean + reach, low, high, gaussian)


def _fitted_form(
    faces: Faces, topology: Topology, normal: NDArray, first: NDArray, second: NDArray, mean: NDArray
) -> tuple[NDArray, NDArray]:
    """Half the difference of the diagonal entries, and the other entry, of the fitted form of trace 2 H."""
    sums = np.zeros((5, faces.n_vertices))
    ends = np.ascontiguousarray(topology.edges.T)
    side_edge, n_edges = np.ascontiguousarray(topology.side_edge.T), ends.shape[1]
    weight = np.zeros(n_edges)
    for j in range(3):
        share = np.maximum(faces.cotan[PREVIOUS[j]] * faces.squared_length[j], 0.0)
        weight += sum_by_index(side_edge[j], share, n_edges)
    for begin in range(0, n_edges, EDGES_PER_BLOCK):
        block = slice(begin, begin + EDGES_PER_BLOCK)
        edge = np.take(faces.points, ends[1, block], axis=1) - np.take(faces.points, ends[0, block], axis=1)
        inverse = ratio(-2.0, dot(edge, edge))
        for end, sign in ((0, 1.0), (1, -1.0)):
            vertex = ends[end, block]
            x, y, z = (dot(edge, np.take(axis, vertex, axis=1)) for axis in (normal, first, second))
            rest = weight[block] * (sign * x * inverse - np.take(mean, vertex))
            xx, yy = y * y, z * z
            unit = ratio(1.0, xx + yy)
            c, s = (xx - yy) * unit, 2.0 * y * z * unit
            wc, ws = weight[block] * c, weight[block] * s
            for total, terms in zip(sums, (wc * c, wc * s, ws * s, c * rest, s * rest)):
                np.add.at(total, vertex, terms)
    cc, cs, ss, rc, rs = sums
    determinant = cc * ss - cs * cs
    regular = determinant > 1e-12 * (cc + ss) ** 2
    safe = np.where(regular, determinant, 1.0)
    half = np.where(regular, (ss * rc - cs * rs) / safe, rc)
    off = np.where(regular, (cc * rs - cs * rc) / safe, rs)
    return half, off


def normal_cycle(
    faces: Faces, edges: NDArray, normal: NDArray, area: NDArray, defect: NDArray, dihedral: NDArray
) -> PrincipalCurvatures:
    """Principal curvatures from the normal cycle of half of every incident edge, over the vertex area.

    Parameters
    ----------
    faces : Faces
    edges : (e, 2) ndarray of int64
    normal : (3, n) ndarray of float64
        Unit vertex normals.
    area, defect : (n,) ndarray of float64
        Vertex areas in length^2, angle defects in radians.
    dihedral : (e,) ndarray of float64
        Dihedral angles in radians, positive where convex.

    Returns
    -------
    PrincipalCurvatures

    Notes
    -----
    D. Cohen-Steiner, J.-M. Morvan, "Restricted Delaunay triangulations and normal cycle", 2003. The sum of
    |e| theta e e^T bends across edges, so the eigenvector of one curvature belongs to the other.
    """
    a, b = np.ascontiguousarray(edges.T)
    x, y, z = (np.take(p, b) - np.take(p, a) for p in faces.points)
    length = np.sqrt(x * x + y * y + z * z)
    weight = 0.5 * ratio(dihedral, length)
    wx, wy, wz = weight * x, weight * y, weight * z
    entries, n = (wx * x, wy * y, wz * z, wy * z, wz * x, wx * y), faces.n_vertices
    tensor = np.stack([sum_by_index(a, e, n) + sum_by_index(b, e, n) for e in entries])
    return swapped_principal(ratio(tensor, area), normal, ratio(defect, area))


def swapped_principal(tensor: NDArray, normal: NDArray, gaussian: NDArray) -> PrincipalCurvatures:
    """Principal curvatures from the tensor of a normal cycle, whose two directions are exchanged.

    Parameters
    ----------
    tensor : (6, n) ndarray of float64
        xx, yy, zz, yz, zx, xy, divided by area; in 1/length.
    normal : (3, n) ndarray of float64
        Unit vertex normals.
    gaussian : (n,) ndarray of float64
        In 1/length^2; passed on.

    Returns
    -------
    PrincipalCurvatures
    """
    first, second = tangent_frame(normal)
    low, high, cos, sin = eigen_2x2(*in_tangent_plane(tensor, first, second))
    along_high_eigenvalue, across = turned(first, second, cos, sin)
    return PrincipalCurvatures(low, high, along_high_eigenvalue, across, gaussian)


def corrected(faces: Faces, normal: NDArray) -> PrincipalCurvatures:
    """Principal curvatures from interpolated corrected curvature measures of the star.

    Parameters
    ----------
    faces : Faces
    normal : (3, n) ndarray of float64
        Unit vertex normals.

    Returns
    -------
    PrincipalCurvatures

    Notes
    -----
    J.-O. Lachaud, P. Romon, B. Thibert, "Corrected curvature measures", 2022; J.-O. Lachaud, P. Romon,
    B. Thibert, D. Coeurjolly, "Interpolated corrected curvature measures for polygonal surfaces", 2020.
    """
    (total,) = faces.vertex_sums(lambda block: _on_corners(measures_and_sizes(block, normal)))
    return corrected_principal(total, normal)


def _on_corners(values: NDArray) -> NDArray[np.float64]:
    """(d, 3, m) values of faces (d, m) at each corner."""
    return np.broadcast_to(values[:, None], (len(values), 3, values.shape[1]))


def corrected_measures(faces: Faces, normal: NDArray) -> NDArray[np.float64]:
    """Interpolated corrected curvature measures of every face.

    Parameters
    ----------
    faces : Faces
    normal : (3, n) ndarray of float64
        Unit vertex normals.

    Returns
    -------
    (9, m) ndarray of float64
        Area (length^2), mean measure (length), Gaussian measure, and the tensor xx, yy, zz, yz, zx, xy of the
        second fundamental form (length), positive where convex.

    References
    ----------
    Lachaud2020 in docs/references.bib.
    """
    a, b = faces.side[0], -faces.side[2]
    u0, u1, u2 = faces.at_corners(normal)
    middle = (u0 + u1 + u2) / 3.0
    du, dv = 0.5 * (u1 - u0), 0.5 * (u2 - u0)
    across_a, across_b = cross(a, middle), cross(b, middle)

    def entry(i: int, j: int) -> NDArray[np.float64]:
        return across_b[i] * du[j] - across_a[i] * dv[j]

    return np.stack(
        [
            0.5 * dot(middle, faces.doubled),
            dot(across_b, du) - dot(across_a, dv),
            0.5 * dot(u0, cross(u1, u2)),
            entry(0, 0),
            entry(1, 1),
            entry(2, 2),
            0.5 * (entry(1, 2) + entry(2, 1)),
            0.5 * (entry(2, 0) + entry(0, 2)),
            0.5 * (entry(0, 1) + entry(1, 0)),
        ]
    )


def measures_and_sizes(faces: Faces, normal: NDArray) -> NDArray[np.float64]:
    """Corrected measures of every face, and the size of what cancels in its area.

    Parameters
    ----------
    faces : Faces
    normal : (3, n) ndarray of float64
        Unit vertex normals.

    Returns
    -------
    (10, m) ndarray of float64
        `corrected_measures`, and the sum of the squared sides (length^2).
    """
    size = faces.squared_length[0] + faces.squared_length[1] + faces.squared_length[2]
    return np.concatenate([corrected_measures(faces, normal), size[None]])


def corrected_principal(measures: NDArray, normal: NDArray) -> PrincipalCurvatures:
    """Principal curvatures from sums of corrected measures; their half-sum is that of the mean measure.

    Parameters
    ----------
    measures : (10, n) ndarray of float64
        Sums over faces of `measures_and_sizes`.
    normal : (3, n) ndarray of float64
        Unit vertex normals.

    Returns
    -------
    PrincipalCurvatures
    """
    area, size = measures[0], measures[9]
    area = np.where(area > MIN_AREA_SHARE * size, area, 0.0)  # of its own faces: others may be far larger
    density = ratio(measures[1:9], area)
    first, second = tangent_frame(normal)
    low, high, cos, sin = eigen_2x2(*in_tangent_plane(density[2:], first, second))
    shift = 0.5 * density[0] - 0.5 * (low + high)
    high_direction, low_direction = turned(first, second, cos, sin)
    return PrincipalCurvatures(low + shift, high + shift, low_direction, high_direction, density[1])
