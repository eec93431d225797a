"""Hodge stars on every degree (chapters 7 and 8).

Three stars: `circumcentric` (diagonal, signed dual volumes: entries may be zero or negative where a mesh is
not Delaunay), `barycentric` (diagonal, positive, not exact on constant forms of degree 1 and 2, so that
spectra do not converge) and `galerkin` (the mass matrix of Whitney forms: sparse, positive definite, exact on
forms that are constant in cells). `diagonal_star` is the one to invert in place of the latter.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array

from ddgcli.choices import HODGE_STARS
from ddgcli.errors import ParameterError
from ddgcli.geometry.cells import TET_EDGES, TRIANGLE_EDGES
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.operators.dec import Complex

Star = str  # one of HODGE_STARS
MIN_ENTRY_SHARE = 0.02  # of the barycentric entries, to which smaller circumcentric ones are raised


def hodge_star(complex_: Complex, degree: int, kind: Star = "galerkin") -> csr_array:
    """Hodge star of k-forms as a symmetric matrix: the inner product of two forms is a' star b.

    Parameters
    ----------
    complex_ : Complex
    degree : int
        0 .. dimension.
    kind : {'circumcentric', 'barycentric', 'galerkin'}

    Returns
    -------
    (n_k, n_k) csr_array
        Diagonal for the first two kinds: dual measure / primal measure, in length^(dimension - 2 degree).
    """
    if not 0 <= degree <= complex_.dimension:
        raise ParameterError(f"{degree} is outside 0..{complex_.dimension}", parameter="degree")
    if kind not in HODGE_STARS:
        raise ParameterError(f"{kind!r} is not one of {', '.join(HODGE_STARS)}", parameter="kind")
    if degree == complex_.dimension:
        return diags_array(1.0 / complex_.metric.measure).tocsr()
    if kind == "galerkin":
        return _galerkin(complex_, degree)
    return diags_array(diagonal_star(complex_, degree, kind)).tocsr()


def diagonal_star(complex_: Complex, degree: int, kind: Star) -> NDArray[np.float64]:
    """Diagonal of a star; of `galerkin` of the one to invert in its place, whose inverse is sparse.

    That is the barycentric star of functions. Of other forms it is the circumcentric one, which is exact on
    constant forms, with entries of at least `MIN_ENTRY_SHARE` of the barycentric ones: no diagonal star is
    positive and exact where a mesh is not Delaunay.

    Parameters
    ----------
    complex_ : Complex
    degree : int
        0 .. dimension - 1.
    kind : {'circumcentric', 'barycentric', 'galerkin'}

    Returns
    -------
    (n_k,) ndarray of float64
    """
    if kind == "galerkin":
        barycentric = diagonal_star(complex_, degree, "barycentric")
        if degree == 0:
            return barycentric
        return np.maximum(diagonal_star(complex_, degree, "circumcentric"), MIN_ENTRY_SHARE * barycentric)
    local = _DIAGONAL[complex_.dimension, degree](complex_, kind)
    index = (complex_.corners, complex_.cell_edge, complex_.cell_face)[degree]
    return sum_by_index(index, local, complex_.counts[degree])


# --- diagonal stars: contribution of each cell to dual measure / primal measure ---------------------------


def _triangle_star0(c: Complex, kind: str) -> NDArray:
    area = c.metric.measure
    if kind == "barycentric":
        return np.repeat(area[:, None] / 3.0, 3, axis=1)
    return _vertex_from_edges(c, _triangle_star1(c, kind), TRIANGLE_EDGES, 4.0)


def _triangle_star1(c: Complex, kind: str) -> NDArray:
    metric, star = c.metric, np.zeros((len(c.corners), 3))
    for j, (a, b) in enumerate(TRIANGLE_EDGES):
        if kind == "circumcentric":
            star[:, j] = -metric.gradient_product[:, a, b] * metric.measure
        else:
            opposite = 3 - a - b
            median = _midpoint_distance_squared(metric.squared_distance, a, b, opposite)
            star[:, j] = np.sqrt(median / metric.squared_distance[:, a, b]) / 3.0
    return star


def _tet_star0(c: Complex, kind: str) -> NDArray:
    if kind == "barycentric":
        return np.repeat(c.metric.measure[:, None] / 4.0, 4, axis=1)
    return _vertex_from_edges(c, _tet_star1(c, kind), TET_EDGES, 6.0)


def _tet_star1(c: Complex, kind: str) -> NDArray:
    """Dual area of edge j within each cell, over its length."""
    metric, star = c.metric, np.zeros((len(c.corners), 6))
    s = metric.squared_distance
    height = _dual_height(c)
    for j, (a, b) in enumerate(TET_EDGES):
        k, l = (x for x in range(4) if x not in (a, b))
        if kind == "circumcentric":
            for third, other in ((k, l), (l, k)):  # the face a, b, third is opposite `other`
                cotan = metric.dot(third, a, third, b) / (2.0 * _triangle_area(s, a, b, third))
                star[:, j] += 0.25 * cotan * height[:, other]
        else:
            u, v = _midpoint_distance_squared(s, a, b, k), _midpoint_distance_squared(s, a, b, l)
            dot = 0.5 * (u + v - s[:, k, l])
            star[:, j] = np.sqrt(np.maximum(u * v - dot**2, 0.0) / s[:, a, b]) / 12.0
    return star


def _tet_star2(c: Complex, kind: str) -> NDArray:
    """Dual length of face i (opposite corner i) within each cell, over its area."""
    area = np.stack([_opposite_area(c, i) for i in range(4)], axis=1)
    if kind == "circumcentric":
        return _dual_height(c) / area
    s = c.metric.squared_distance
    length = np.zeros_like(area)
    for i in range(4):
        a, b, d = (x for x in range(4) if x != i)
        variance = (s[:, a, b] + s[:, b, d] + s[:, d, a]) / 9.0
        length[:, i] = np.sqrt((s[:, i, a] + s[:, i, b] + s[:, i, d]) / 3.0 - variance) / 4.0
    return length / area


_DIAGONAL: dict[tuple[int, int], Callable[[Complex, str], NDArray]] = {
    (2, 0): _triangle_star0,
    (2, 1): _triangle_star1,
    (3, 0): _tet_star0,
    (3, 1): _tet_star1,
    (3, 2): _tet_star2,
}


def _vertex_from_edges(c: Complex, star1: NDArray, edges: NDArray, divisor: float) -> NDArray:
    """Dual measure of corners: each half edge carries a pyramid of height |e|/2 over its dual cell."""
    volume = np.zeros(c.corners.shape)
    for j, (a, b) in enumerate(edges):
        pyramid = star1[:, j] * c.metric.squared_distance[:, a, b] / divisor
        volume[:, a] += pyramid
        volume[:, b] += pyramid
    return volume


def _midpoint_distance_squared(s: NDArray, a: int, b: int, k: int) -> NDArray:
    """(m,) squared distance from the middle of a, b to corner k."""
    return 0.5 * (s[:, a, k] + s[:, b, k]) - 0.25 * s[:, a, b]


def _triangle_area(s: NDArray, a: int, b: int, k: int) -> NDArray:
    dot = 0.5 * (s[:, k, a] + s[:, k, b] - s[:, a, b])
    return 0.5 * np.sqrt(np.maximum(s[:, k, a] * s[:, k, b] - dot**2, 0.0))


def _opposite_area(c: Complex, i: int) -> NDArray:
    """(m,) area of the face opposite corner i: |grad| = area / (3 volume)."""
    return 3.0 * c.metric.measure * np.sqrt(c.metric.gradient_product[:, i, i])


def _dual_height(c: Complex) -> NDArray:
    """(m, 4) signed distance of the circumcentre from the face opposite corner i."""
    gradient = np.sqrt(np.einsum("mii->mi", c.metric.gradient_product))
    return c.metric.circumcentre / gradient


# --- Galerkin stars: mass matrices of Whitney forms --------------------------------------------------------


def _galerkin(c: Complex, degree: int) -> csr_array:
    local = (_whitney_mass0, _whitney_mass1, _whitney_mass2)[degree](c)
    index = matrix_indices((c.corners, c.cell_edge, c.cell_face)[degree], c.counts[degree], local.size)
    sign = (None, c.cell_edge_sign, c.cell_face_sign)[degree]
    if sign is not None:
        local = local * sign[:, :, None] * sign[:, None, :]
    size = index.shape[1]
    rows = np.repeat(index, size, axis=1).ravel()
    cols = np.tile(index, (1, size)).ravel()
    return coo_array((local.ravel(), (rows, cols)), shape=(c.counts[degree],) * 2).tocsr()


def _coordinate_products(c: Complex) -> NDArray:
    """(m, c, c) integrals of products of barycentric coordinates."""
    size = c.dimension + 1
    return c.metric.measure[:, None, None] * (1.0 + np.eye(size)) / (size * (size + 1))


def _whitney_mass0(c: Complex) -> NDArray:
    return _coordinate_products(c)


def _whitney_mass1(c: Complex) -> NDArray:
    edges = TRIANGLE_EDGES if c.dimension == 2 else TET_EDGES
    i, j = edges.T
    w, p = _coordinate_products(c), c.metric.gradient_product
    return (
        w[:, i[:, None], i] * p[:, j[:, None], j]
        - w[:, i[:, None], j] * p[:, j[:, None], i]
        - w[:, j[:, None], i] * p[:, i[:, None], j]
        + w[:, j[:, None], j] * p[:, i[:, None], i]
    )


def _whitney_mass2(c: Complex) -> NDArray:
    """Flux form of the face opposite corner a is (x - x_a) / (3 volume)."""
    # a mean, because an integral over the squared volume has powers of lengths that over- or underflow
    w = _coordinate_products(c) / c.metric.measure[:, None, None]
    mass = np.zeros_like(w)
    for a in range(4):
        for b in range(4):
            dots = sum(w[:, i, j] * c.metric.dot(a, i, b, j) for i in range(4) for j in range(4))
            mass[:, a, b] = dots / (9.0 * c.metric.measure)
    return mass
