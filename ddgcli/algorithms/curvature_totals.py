"""Integrals of curvature, Minkowski's volumes, and the balances that hold on every polyhedron."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature import pointwise
from ddgcli.geometry.extrinsic import face_area_vector, face_normal
from ddgcli.geometry.intrinsic import corner_cotan, face_area
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.mesh.triangle_mesh import TriangleMesh, vector_length


def edge_length(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(e,) lengths of the edges."""
    return vector_length(mesh.points[mesh.topology.edges[:, 1]] - mesh.points[mesh.topology.edges[:, 0]])


def intrinsic_volumes(
    euler: int, total_mean_curvature: float | None, area: float, volume: float | None
) -> list[float | None]:
    """[V0, V1, V2, V3] of the body inside (chapter 2, 5): chi/2, sum |e| theta / (2 pi), area/2, volume."""
    mean_width = None if total_mean_curvature is None else total_mean_curvature / np.pi
    return [euler / 2, mean_width, area / 2, volume]


def steiner_polynomial(volumes: list[float | None]) -> list[float | None]:
    """[c0..c3] with V(eps) = c0 + c1 eps + c2 eps^2 + c3 eps^3: V3, 2 V2, pi V1, 4 pi / 3 V0."""
    ball = (4 * np.pi / 3, np.pi, 2.0, 1.0)
    return [None if v is None else b * v for b, v in zip(ball[::-1], volumes[::-1])]


def vector_area(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(3,) integral of the normal: half the integral of x cross dx over the boundary; zero when closed."""
    return face_area_vector(mesh).sum(axis=0)


def willmore_energies(
    mesh: TriangleMesh, dihedral: NDArray, area: NDArray, vector: NDArray, defect: NDArray
) -> dict[str, float | None]:
    """Discrete integrals of H^2 with H half the sum of the principal curvatures, by name.

    `cotan`: |integrated vector|^2 / vertex area. `sullivan`: (h_p / 2)^2 a third of the star, with
    h_p = |grad Area| / |grad Vol| (chapter 3, 2.5). `hinge`: 3/4 theta^2 |e|^2 / (A1 + A2). `circle-angle`:
    half the sum of (sum of the angles between circumcircles - 2 pi), which measures the integral of
    H^2 - K and is zero on every mesh inscribed in a sphere (Bobenko).
    """
    squared = np.einsum("ij,ij->i", vector, vector)
    inside = ~mesh.topology.boundary_vertex
    return {
        "cotan": float(pointwise(squared, area).sum()),
        "sullivan": _sullivan(mesh, squared, inside),
        "hinge": _hinge(mesh, dihedral),
        "circle-angle": _circle_angle(mesh),
        "cotan-minus-gauss": float((pointwise(squared, area) - defect)[inside].sum()),
    }


def _sullivan(mesh: TriangleMesh, squared: NDArray, inside: NDArray) -> float | None:
    corner = mesh.faces.ravel()
    n = mesh.n_vertices
    third = np.bincount(corner, np.repeat(face_area(mesh.side_length) / 3, 3), n)
    normal = face_area_vector(mesh)
    gradient = np.stack([np.bincount(corner, np.repeat(normal[:, i] / 3, 3), n) for i in range(3)])
    volume_squared = (gradient * gradient).sum(axis=0)
    usable = inside & (third > 0)
    # a vertex between two coincident sheets has no volume gradient: the ratio is not defined
    if (volume_squared[usable] <= 1e-24 * third[usable] ** 2).any():
        return None
    ratio = np.divide(squared, volume_squared, out=np.zeros(n), where=usable)
    return float((ratio * third)[usable].sum())


def _hinge(mesh: TriangleMesh, dihedral: NDArray) -> float:
    topology = mesh.topology
    area = np.repeat(face_area(mesh.side_length), 3)
    around = np.bincount(topology.side_edge.ravel(), area, topology.n_edges)
    moment = dihedral * edge_length(mesh)
    return float(0.75 * pointwise(moment * moment, around).sum())


def _circle_angle(mesh: TriangleMesh) -> float | None:
    """Sum over interior vertices of (sum of circle angles - 2 pi) / 2; None where points coincide."""
    topology = mesh.topology
    twin = topology.side_twin.ravel()
    side = np.flatnonzero((twin >= 0) & (np.arange(len(twin)) < twin))
    other = twin[side]
    flat = mesh.faces.ravel()
    i, j = topology.side_tail[side], topology.side_head[side]
    k = flat[side // 3 * 3 + PREVIOUS[side % 3]]
    l = flat[other // 3 * 3 + PREVIOUS[other % 3]]
    p = mesh.points
    # the angle between the circles through i, k, j and j, l, i, from the cross-ratio of quaternions
    a, b, c, d = p[k] - p[i], p[j] - p[k], p[l] - p[j], p[i] - p[l]
    real = _dot(a, c) * _dot(b, d) - _dot(a, b) * _dot(c, d) - _dot(b, c) * _dot(d, a)
    size = vector_length(a) * vector_length(b) * vector_length(c) * vector_length(d)
    if len(size) and size.min() <= 0:
        return None
    angle = np.arccos(np.clip(real / np.where(size > 0, size, 1.0), -1.0, 1.0))
    total = np.bincount(i, angle, mesh.n_vertices) + np.bincount(j, angle, mesh.n_vertices)
    inside = topology.referenced_vertex & ~topology.boundary_vertex
    return float(0.5 * (total[inside] - 2 * np.pi).sum())


def _dot(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    return np.einsum("ij,ij->i", a, b)


def balances(mesh: TriangleMesh, dihedral: NDArray, region: NDArray) -> dict[str, float]:
    """How far force, torque and area balance are from closing around a region of faces (chapter 3, 1.4).

    The outward conormal eta over the boundary of a region D and the mean curvature vector H nu (sum of the
    principal curvatures) inside it obey, on polyhedra too: int eta = int H nu, int x cross eta =
    int x cross H nu, int x . eta = int (H nu . x + 2). On an edge H nu integrates to 2 |e| sin(theta / 2)
    against the mean of its two normals, which is computed here from the dihedral angle; the left sides come
    from the faces beside the region's boundary.

    Parameters
    ----------
    dihedral : (e,) ndarray
    region : (m,) ndarray of bool
        Faces of the region D.

    Returns
    -------
    dict
        `force`, `torque`, `area`: relative to the sum of the absolute values of the terms.
    """
    topology = mesh.topology
    twin = topology.side_twin.ravel()
    owner = np.arange(len(twin)) // 3
    inner = (twin >= 0) & region[owner] & region[np.maximum(twin, 0) // 3]
    rim = np.flatnonzero(region[owner] & ~inner)
    edge_side = np.flatnonzero(inner & (np.arange(len(twin)) < twin))
    centre = mesh.points.mean(axis=0)
    side, start = mesh.side_vector.reshape(-1, 3), mesh.points[topology.side_tail] - centre
    middle = start + side / 2
    normal = face_normal(mesh)

    conormal = np.cross(side[rim], normal[rim // 3])
    bisector = normal[edge_side // 3] + normal[twin[edge_side] // 3]
    size = vector_length(bisector)[:, None]
    bisector = np.divide(bisector, size, out=np.zeros_like(bisector), where=size > 0)
    angle = dihedral[topology.side_edge.ravel()[edge_side]]
    force = -2.0 * (np.sin(angle / 2) * vector_length(side[edge_side]))[:, None] * bisector
    area = float(face_area(mesh.side_length)[region].sum())
    return {
        "force": _residual([conormal, -force]),
        "torque": _residual([np.cross(middle[rim], conormal), -np.cross(middle[edge_side], force)]),
        "area": _residual(
            [
                np.einsum("ij,ij->i", middle[rim], conormal),
                -np.einsum("ij,ij->i", middle[edge_side], force),
                np.array([-2.0 * area]),
            ]
        ),
    }


def _residual(parts: list[NDArray]) -> float:
    """Largest component of the sum of all rows, relative to the sum of their absolute values."""
    total = np.abs(sum(part.sum(axis=0) for part in parts)).max()
    scale = np.abs(sum(np.abs(part).sum(axis=0) for part in parts)).max()
    return float(total / scale) if scale > 0 else 0.0


def nonconformality(mesh: TriangleMesh, image: NDArray) -> dict[str, float]:
    """Dirichlet energy minus area of the image of a map given at vertices, 0 for the identity (ch. 3, 2.6).

    Parameters
    ----------
    image : (n, 2) or (n, 3) ndarray
        Where each vertex goes.

    Returns
    -------
    dict
        `dirichlet_energy` = 1/4 sum (cot + cot) |f_i - f_j|^2, `map_area` and their difference
        `nonconformality`, never negative but for rounding; in the image's length unit squared.
    """
    image = np.column_stack([image, np.zeros((len(image), 3 - image.shape[1]))])
    cotan = corner_cotan(mesh.side_length)[:, PREVIOUS]
    corner = image[mesh.faces]
    stretch = corner[:, NEXT] - corner
    squared = np.einsum("fki,fki->fk", stretch, stretch)
    with np.errstate(invalid="ignore"):
        dirichlet = float(np.nansum(0.25 * cotan * squared))
    moved = TriangleMesh(image, mesh.topology)
    area = float(face_area(moved.side_length).sum())
    return {"dirichlet_energy": dirichlet, "map_area": area, "nonconformality": dirichlet - area}
