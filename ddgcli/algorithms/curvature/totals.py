"""Integrals of curvature and intrinsic volumes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.circle_angles import circle_angle, side_product
from ddgcli.geometry.extrinsic import EDGES_PER_BLOCK, hinge_bending
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import PREVIOUS, PREVIOUS_OFFSET, Topology
from ddgcli.mesh.vectors import cross, dot, ratio


def filled_normals(faces: Faces, topology: Topology) -> NDArray[np.float64]:
    """Unit normals of all faces; a flat face takes that of the neighbour across its longest side.

    Any unit vector orthogonal to a flat face's line keeps the sums of |e| theta over edges and all balance
    laws exact; the neighbour's normal makes the flat face invisible.

    Parameters
    ----------
    faces : Faces
    topology : Topology

    Returns
    -------
    (3, m) ndarray of float64
    """
    open_faces = np.flatnonzero(faces.flat)
    if len(open_faces) == 0:
        return faces.normal
    normal = faces.normal.copy()
    longest = np.argmax(faces.squared_length[:, open_faces], axis=0)
    neighbour = topology.side_twin[open_faces, longest] // 3
    for _ in range(8):
        if len(open_faces) == 0:
            return normal
        has_normal = (neighbour >= 0) & (dot(normal[:, neighbour], normal[:, neighbour]) > 0)
        normal[:, open_faces[has_normal]] = normal[:, neighbour[has_normal]]
        open_faces, neighbour = open_faces[~has_normal], neighbour[~has_normal]
    side = faces.side_vectors(np.argmax(faces.squared_length[:, open_faces], axis=0), open_faces)
    axis = np.eye(3)[:, np.argmin(np.abs(side), axis=0)]
    square = cross(side, axis)
    normal[:, open_faces] = ratio(square, np.sqrt(dot(square, square)))
    return normal


def intrinsic_volumes(
    euler: int, total_mean_curvature: float | None, area: float, volume: float | None
) -> list[float | None]:
    """Intrinsic volumes of the body inside a closed surface (chapter 2, 5).

    Parameters
    ----------
    euler : int
        Euler characteristic of the surface.
    total_mean_curvature : float or None
        Sum of |e| theta / 2 over the edges.
    area : float
    volume : float or None

    Returns
    -------
    list of float or None
        [V0, V1, V2, V3]: chi/2, sum |e| theta / (2 pi), area/2, volume.
    """
    mean_width = None if total_mean_curvature is None else total_mean_curvature / np.pi
    return [euler / 2, mean_width, area / 2, volume]


def steiner_polynomial(volumes: list[float | None]) -> list[float | None]:
    """Coefficients of Steiner's polynomial, the volume of the body offset by eps.

    Parameters
    ----------
    volumes : list of float or None
        As returned by `intrinsic_volumes`.

    Returns
    -------
    list of float or None
        [c0..c3] with V(eps) = c0 + c1 eps + c2 eps^2 + c3 eps^3: V3, 2 V2, pi V1, 4 pi / 3 V0.
    """
    ball = (4 * np.pi / 3, np.pi, 2.0, 1.0)
    return [None if v is None else b * v for b, v in zip(ball[::-1], volumes[::-1])]


def vector_area(faces: Faces) -> NDArray[np.float64]:
    """Integral of the normal over a surface: half the integral of x cross dx over its boundary.

    Parameters
    ----------
    faces : Faces

    Returns
    -------
    (3,) ndarray of float64
        In length^2; zero on a closed surface.
    """
    return 0.5 * faces.doubled.sum(axis=1)


def willmore_energies(
    faces: Faces,
    topology: Topology,
    dihedral: NDArray,
    edge_length: NDArray,
    area: NDArray,
    vector: NDArray,
    defect: NDArray,
    area_vector: NDArray | None,
) -> dict[str, float | None]:
    """Discrete integrals of H^2, with H half the sum of the principal curvatures, by name.

    `cotan`: |integrated vector|^2 / vertex area. `sullivan`: (h_p / 2)^2 a third of the star, with
    h_p = |grad Area| / |grad Vol| (chapter 3, 2.5). `hinge`: see `hinge_bending`. Of H^2 - K:
    `circle-angle`, half the sum of (sum of the angles between circumcircles - 2 pi), Moebius invariant,
    zero on Delaunay meshes inscribed in a sphere (Bobenko; an edge that is not Delaunay adds to it even
    there), and `cotan-minus-gauss`, `cotan` less the angle defects; both over
    interior vertices.

    Parameters
    ----------
    faces : Faces
    topology : Topology
    dihedral, edge_length : (e,) ndarray of float64
        Dihedral angles in radians, and lengths.
    area, defect : (n,) ndarray of float64
        Vertex areas and angle defects.
    vector : (3, n) ndarray of float64
        Integrated mean curvature vectors.
    area_vector : (3, n) ndarray of float64 or None
        Sums of face area vectors over the stars, for `sullivan`.

    Returns
    -------
    dict of str to float or None
        Without unit.
    """
    squared = dot(vector, vector)
    inside = topology.referenced_vertex & ~topology.boundary_vertex
    density = ratio(squared, area)
    return {
        "cotan": float(density.sum()),
        "sullivan": _sullivan(faces, squared, inside, area_vector),
        "hinge": _hinge(faces, topology, dihedral, edge_length),
        "circle-angle": _circle_angle(faces, topology, inside),
        "cotan-minus-gauss": float((density - defect)[inside].sum()),
    }


def _sullivan(faces: Faces, squared: NDArray, inside: NDArray, area_vector: NDArray | None) -> float | None:
    if area_vector is None:
        return None
    third = faces.stars(faces.area[None] / 3)[0]
    gradient = area_vector / 6
    volume_squared = dot(gradient, gradient)
    usable = inside & (third > 0)
    # a vertex between two coincident sheets has no volume gradient: the ratio is not defined
    if (volume_squared[usable] <= 1e-24 * third[usable] ** 2).any():
        return None
    return float((ratio(squared, np.where(usable, volume_squared, 0.0)) * third).sum())


def _hinge(faces: Faces, topology: Topology, dihedral: NDArray, edge_length: NDArray) -> float:
    around = sum_by_index(topology.side_edge.ravel(), np.repeat(faces.area, 3), topology.n_edges)
    euler, closed = topology.euler_characteristic, topology.is_closed
    terms, constant = hinge_bending(edge_length**2, dihedral, around, euler, closed)
    return float(terms.sum()) + constant


def _circle_angle(faces: Faces, topology: Topology, inside: NDArray) -> float | None:
    """Sum over interior vertices of (sum of circle angles - 2 pi) / 2; None where points coincide."""
    interior, corner = topology.interior_sides, topology.side_tail
    twin, n = topology.side_twin.ravel(), faces.n_vertices
    i, j = corner[interior], topology.side_head[interior]
    angle = np.zeros(len(interior))
    for begin in range(0, len(interior), EDGES_PER_BLOCK):
        block = slice(begin, begin + EDGES_PER_BLOCK)
        k, l = (corner[s + PREVIOUS_OFFSET[s % 3]] for s in (interior[block], twin[interior[block]]))
        pairs = (i[block], k), (k, j[block]), (j[block], l), (l, i[block])
        quad = [_between(faces.points, *ends) for ends in pairs]
        squared = [dot(v, v) for v in quad]
        if min(size.min() for size in squared) <= 0:
            return None
        product = side_product(*(v / np.sqrt(size) for v, size in zip(quad, squared)))
        angle[block] = circle_angle(*product)
    total = sum_by_index(i, angle, n) + sum_by_index(j, angle, n)
    return max(float(0.5 * (total[inside] - 2 * np.pi).sum()), 0.0)  # below zero is rounding


def _between(points: NDArray, tail: NDArray, head: NDArray) -> NDArray[np.float64]:
    return np.stack([np.take(p, head) - np.take(p, tail) for p in points])


def nonconformality(faces: Faces, image: NDArray) -> dict[str, float]:
    """Dirichlet energy minus area of the image of a map given at vertices, 0 for the identity (ch. 3, 2.6).

    Parameters
    ----------
    faces : Faces
    image : (n, 2) or (n, 3) ndarray
        Image of each vertex.

    Returns
    -------
    dict
        `dirichlet_energy` = 1/4 sum (cot + cot) |f_i - f_j|^2, `map_area` and their difference
        `nonconformality`, not negative up to rounding; in the image's length unit squared.
    """
    points = np.zeros((3, len(image)))
    points[: image.shape[1]] = image.T
    mapped = Faces(faces.corner, points)
    dirichlet = float(
        sum((0.25 * faces.cotan[PREVIOUS[j]] * mapped.squared_length[j]).sum() for j in range(3))
    )
    area = float(mapped.area.sum())
    return {"dirichlet_energy": dirichlet, "map_area": area, "nonconformality": dirichlet - area}
