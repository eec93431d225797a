"""Principal curvatures from the star of every vertex: `cotan`, `normal-cycle` and `corrected`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature import pointwise
from ddgcli.algorithms.curvature_frames import (
    Principal,
    cross,
    dot,
    eigen_2x2,
    in_tangent_plane,
    tangent_frame,
    turned,
    vertex_sum_of_faces,
)
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh


def cotan(
    mesh: TriangleMesh, normal: NDArray, area: NDArray, defect: NDArray, vector: NDArray, cotangent: NDArray
) -> Principal:
    """Meyer et al.: H from the area gradient, K from the angle defect, directions by least squares.

    Parameters
    ----------
    normal : (n, 3) ndarray
        Unit vertex normals.
    area, defect : (n,) ndarray
        Mixed Voronoi areas and angle defects.
    vector : (n, 3) ndarray
        Integrated mean curvature vectors (`curvature_vector`).
    cotangent : (m, 3) ndarray
        Of the corner angles.

    Notes
    -----
    M. Meyer, M. Desbrun, P. Schroder, A. Barr, "Discrete differential-geometry operators for triangulated
    2-manifolds", 2003. kappa = H +- sqrt(H^2 - K), the root of a negative number taken as 0. The directions
    fit the normal curvatures of the edges, weighted as in the Voronoi area, with trace 2 H.
    """
    length = np.sqrt(np.einsum("ij,ij->i", vector, vector))
    outward = np.einsum("ij,ij->i", vector, normal)
    mean = pointwise(np.where(outward <= 0, length, -length), area)
    gaussian = pointwise(defect, area)
    reach = np.sqrt(np.maximum(mean * mean - gaussian, 0.0))
    first, second = tangent_frame(normal)
    half_difference, off = _fitted_form(mesh, normal, first, second, mean, cotangent)
    angle = 0.5 * np.arctan2(off, half_difference)
    high, low = turned(first, second, np.cos(angle), np.sin(angle))
    return Principal(mean - reach, mean + reach, low, high, gaussian)


def _fitted_form(
    mesh: TriangleMesh, normal: NDArray, first: NDArray, second: NDArray, mean: NDArray, cotangent: NDArray
) -> tuple[NDArray, NDArray]:
    """Half the difference of the diagonal entries, and the other entry, of the fitted form of trace 2 H."""
    weight = np.where(np.isfinite(cotangent), cotangent, 0.0)[:, PREVIOUS]
    side = mesh.side_vector
    squared = np.einsum("fki,fki->fk", side, side)
    weight = np.maximum(weight * squared, 0.0)
    inverse = np.divide(1.0, squared, out=np.zeros_like(squared), where=squared > 0)
    faces, sums = mesh.faces, np.zeros((5, mesh.n_vertices))
    frame = np.concatenate([normal, first, second, mean[:, None]], axis=1)
    for corners, sign in ((faces, 1.0), (faces[:, NEXT], -1.0)):
        at = frame[corners]
        n, u, v = (sign * np.einsum("fki,fki->fk", side, at[..., 3 * i : 3 * i + 3]) for i in range(3))
        curve = -2.0 * n * inverse
        tangent = u * u + v * v
        unit = np.divide(1.0, tangent, out=np.zeros_like(tangent), where=tangent > 0)
        c, s = (u * u - v * v) * unit, 2.0 * u * v * unit
        rest = weight * (curve - at[..., 9])
        rows = np.stack([weight * c * c, weight * c * s, weight * s * s, c * rest, s * rest])
        corner = corners.ravel()
        sums += np.stack([np.bincount(corner, row.ravel(), mesh.n_vertices) for row in rows])
    cc, cs, ss, rc, rs = sums
    determinant = cc * ss - cs * cs
    regular = determinant > 1e-12 * (cc + ss) ** 2
    safe = np.where(regular, determinant, 1.0)
    half = np.where(regular, (ss * rc - cs * rs) / safe, rc)
    off = np.where(regular, (cc * rs - cs * rc) / safe, rs)
    return half, off


def normal_cycle(
    mesh: TriangleMesh, normal: NDArray, area: NDArray, defect: NDArray, dihedral: NDArray
) -> Principal:
    """Cohen-Steiner and Morvan's tensor over the star: half of every incident edge, over the vertex area.

    Notes
    -----
    D. Cohen-Steiner, J.-M. Morvan, "Restricted Delaunay triangulations and normal cycle", 2003. The sum of
    |e| theta e e^T bends across edges, so the eigenvector of one curvature belongs to the other.
    """
    topology = mesh.topology
    vector = mesh.points[topology.edges[:, 1]] - mesh.points[topology.edges[:, 0]]
    x, y, z = vector.T
    length = np.sqrt(x * x + y * y + z * z)
    weight = 0.5 * np.divide(dihedral, length, out=np.zeros_like(length), where=length > 0)
    wx, wy, wz = weight * x, weight * y, weight * z
    entries = (wx * x, wy * y, wz * z, wy * z, wz * x, wx * y)
    ends, n = topology.edges.T, mesh.n_vertices
    tensor = np.stack([np.bincount(ends[0], e, n) + np.bincount(ends[1], e, n) for e in entries])
    return swapped_principal(pointwise_rows(tensor, area), normal, pointwise(defect, area))


def pointwise_rows(integrated: NDArray, area: NDArray) -> NDArray[np.float64]:
    """(k, n) integrated values over (n,) areas; 0 where there is no area."""
    return np.divide(integrated, area, out=np.zeros_like(integrated), where=area > 0)


def swapped_principal(tensor: NDArray, normal: NDArray, gaussian: NDArray) -> Principal:
    """Principal curvatures of a normal-cycle tensor density, its directions put right."""
    first, second = tangent_frame(normal)
    low, high, cos, sin = eigen_2x2(*in_tangent_plane(tensor, first, second))
    along_high_eigenvalue, across = turned(first, second, cos, sin)
    return Principal(low, high, along_high_eigenvalue, across, gaussian)


def corrected(mesh: TriangleMesh, normal: NDArray) -> Principal:
    """Interpolated corrected curvature measures of the star.

    Notes
    -----
    J.-O. Lachaud, P. Romon, B. Thibert, "Corrected curvature measures", 2022; J.-O. Lachaud, P. Romon,
    B. Thibert, D. Coeurjolly, "Interpolated corrected curvature measures for polygonal surfaces", 2020.
    """
    measures = vertex_sum_of_faces(mesh, corrected_measures(mesh, normal))
    return corrected_principal(measures, normal)


def corrected_measures(mesh: TriangleMesh, normal: NDArray) -> NDArray[np.float64]:
    """(9, m) area, mean, Gaussian measure and the tensor (xx, yy, zz, yz, zx, xy) of every face.

    The tensor is that of the second fundamental form, positive where convex.
    """
    side = np.ascontiguousarray(mesh.side_vector.transpose(1, 2, 0))
    a, b = side[0], -side[2]
    u0, u1, u2 = np.ascontiguousarray(normal[mesh.faces].transpose(1, 2, 0))
    middle = (u0 + u1 + u2) / 3.0
    du, dv = u1 - u0, u2 - u0
    across_a, across_b = cross(a, middle), cross(b, middle)
    mean = dot(across_b, du) - dot(across_a, dv)

    def entry(i: int, j: int) -> NDArray[np.float64]:
        return across_b[i] * du[j] - across_a[i] * dv[j]

    return np.stack(
        [
            0.5 * dot(middle, cross(a, b)),
            0.5 * mean,
            0.5 * dot(u0, cross(u1, u2)),
            0.5 * entry(0, 0),
            0.5 * entry(1, 1),
            0.5 * entry(2, 2),
            0.25 * (entry(1, 2) + entry(2, 1)),
            0.25 * (entry(2, 0) + entry(0, 2)),
            0.25 * (entry(0, 1) + entry(1, 0)),
        ]
    )


def corrected_principal(measures: NDArray, normal: NDArray) -> Principal:
    """Densities of summed measures; the tensor's half-sum is set to the mean measure's."""
    area = measures[0]
    usable = area > 1e-9 * np.abs(measures[0]).max(initial=0.0)
    density = np.divide(measures[1:], area, out=np.zeros_like(measures[1:]), where=usable)
    first, second = tangent_frame(normal)
    low, high, cos, sin = eigen_2x2(*in_tangent_plane(density[2:], first, second))
    shift = 0.5 * density[0] - 0.5 * (low + high)
    high_direction, low_direction = turned(first, second, cos, sin)
    return Principal(low + shift, high + shift, low_direction, high_direction, density[1])
