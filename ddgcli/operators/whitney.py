"""Whitney forms on the cells of a mesh in space: fields from forms, forms from fields, products.

Sharp and flat go between 1-forms (numbers on edges) and vectors on cells; wedge, interior product and Lie
derivative act on forms. Chapter 7 of the notes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError
from ddgcli.geometry.cells import TET_EDGES, TRIANGLE_EDGES
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import ratio, row_dot
from ddgcli.operators.dec import Complex, complex_of

SpaceMesh = TriangleMesh | TetMesh


def barycentric_gradients(mesh: SpaceMesh) -> NDArray[np.float64]:
    """(m, c, 3) gradients of the barycentric coordinates of each cell, in 1/length; c = 3 or 4."""
    corners = mesh.points[mesh.tetrahedra if isinstance(mesh, TetMesh) else mesh.faces]
    edges = corners[:, 1:] - corners[:, :1]
    inverse = np.linalg.pinv(edges)  # (m, 3, c-1): columns are the gradients of corners 1 ...
    rest = np.swapaxes(inverse, 1, 2)
    return np.concatenate([-rest.sum(axis=1, keepdims=True), rest], axis=1)


def whitney_vectors(
    mesh: SpaceMesh, form: NDArray, barycentric: NDArray | None = None
) -> NDArray[np.float64]:
    """Vector proxy of a 1-form by Whitney interpolation at one point of each cell.

    Parameters
    ----------
    form : (e,) ndarray
        Integrals along the edges of the complex.
    barycentric : (m, c) ndarray, optional
        Where in each cell; default the barycentre, where the value is the mean over the cell.

    Returns
    -------
    (m, 3) ndarray
        Constant fields are reproduced from their edge integrals exactly.
    """
    complex_ = complex_of(mesh)
    local = local_edges(complex_)
    gradient = barycentric_gradients(mesh)
    value = complex_.cell_edge_sign * np.asarray(form)[complex_.cell_edge]
    if barycentric is None:
        barycentric = np.full(complex_.corners.shape, 1.0 / complex_.corners.shape[1])
    tail, head = local.T
    w = barycentric[:, tail, None] * gradient[:, head] - barycentric[:, head, None] * gradient[:, tail]
    return np.einsum("mj,mjd->md", value, w)


def sharp(mesh: SpaceMesh, form: NDArray) -> NDArray[np.float64]:
    """(m, 3) vectors on cells from a 1-form: the mean of its Whitney interpolation."""
    return whitney_vectors(mesh, form)


def flat(mesh: SpaceMesh, vectors: NDArray) -> NDArray[np.float64]:
    """(e,) 1-form from vectors: the integral along each edge.

    Parameters
    ----------
    vectors : (n, 3) or (m, 3) ndarray
        On vertices (linear along edges) or on cells (an edge takes the mean over its cells).
    """
    complex_ = complex_of(mesh)
    vectors = np.asarray(vectors, dtype=np.float64)
    along = mesh.points[complex_.edges[:, 1]] - mesh.points[complex_.edges[:, 0]]
    if len(vectors) == complex_.counts[0]:
        mean = 0.5 * (vectors[complex_.edges[:, 0]] + vectors[complex_.edges[:, 1]])
    elif len(vectors) == len(complex_.corners):
        mean = _mean_over_cells(complex_, vectors)
    else:
        raise ParameterError(
            f"{len(vectors)} vectors fit neither the {complex_.counts[0]} vertices nor the "
            f"{len(complex_.corners)} cells"
        )
    return row_dot(mean, along)


def _mean_over_cells(complex_: Complex, vectors: NDArray) -> NDArray[np.float64]:
    per_cell = complex_.cell_edge.shape[1]
    index = complex_.cell_edge.ravel()
    count = np.bincount(index, minlength=complex_.counts[1])
    total = sum_by_index(index, np.repeat(vectors, per_cell, axis=0), complex_.counts[1])
    return total / np.maximum(count, 1)[:, None]


def whitney_load(mesh: SpaceMesh, vectors: NDArray) -> NDArray:
    """(e,) integral of a cell-wise constant (m, 3) field against the Whitney form of every edge."""
    complex_ = complex_of(mesh)
    tail, head = local_edges(complex_).T
    gradient = barycentric_gradients(mesh)
    mean = (gradient[:, head] - gradient[:, tail]) / complex_.corners.shape[1]
    value = np.einsum("mjd,md->mj", mean, vectors) * complex_.metric.measure[:, None]
    return sum_by_index(complex_.cell_edge, value * complex_.cell_edge_sign, complex_.counts[1])


def local_edges(complex_: Complex) -> NDArray:
    """Local edges of a cell, as in `Complex.cell_edge`."""
    return TRIANGLE_EDGES if complex_.dimension == 2 else TET_EDGES


def wedge(complex_: Complex, a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Wedge of forms on a triangle complex, after averaging over corners; antisymmetric, exact Leibniz rule.

    Parameters
    ----------
    a, b : ndarray
        Their lengths determine the degrees: (n,) vertex, (e,) edge or (m,) face values.

    Returns
    -------
    ndarray
        Form of the summed degree; d (f w) = df ^ w + f dw and d (f g) = f dg + g df hold to round-off.
    """
    p, q = degree_of(complex_, a), degree_of(complex_, b)
    if p > q:
        return (-1.0) ** (p * q) * wedge(complex_, b, a)
    if p == 0 and q == 0:
        return a * b
    if p == 0 and q == 1:
        return a[complex_.edges].mean(axis=1) * b
    if p == 0 and q == 2:
        return a[complex_.corners].mean(axis=1) * b
    if p == 1 and q == 1 and complex_.dimension == 2:
        return _wedge_of_one_forms(complex_, a, b)
    raise ParameterError(f"the wedge of a {p}-form and a {q}-form is not available in dimension "
                         f"{complex_.dimension}")  # fmt: skip


def _wedge_of_one_forms(complex_: Complex, a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """(1/6) sum over pairs of sides of a_i b_j - a_j b_i, for sides i before j around the face."""
    u = complex_.cell_edge_sign * a[complex_.cell_edge]
    v = complex_.cell_edge_sign * b[complex_.cell_edge]
    following = [1, 2, 0]
    return (u * v[:, following] - u[:, following] * v).sum(axis=1) / 6.0


def degree_of(complex_: Complex, form: NDArray) -> int:
    """Degree of a form, determined by its length.

    Raises
    ------
    ParameterError
        When the length fits no degree, or more than one.
    """
    fits = [k for k, count in enumerate(complex_.counts) if count == len(form)]
    if len(fits) != 1:
        raise ParameterError(
            f"a form of {len(form)} values has no degree here: {list(complex_.counts)} are the counts"
        )
    return fits[0]


def interior_product(mesh: TriangleMesh, vectors: NDArray, form: NDArray) -> NDArray[np.float64]:
    """Interior product of cell vectors with a 1-form (to vertices) or a 2-form (to edges) on a surface.

    The pairing of Whitney forms is exact in each face; the mean over the faces around a lower simplex,
    weighted with area for vertices, gives its value there.

    Parameters
    ----------
    vectors : (m, 3) ndarray
        Tangent vectors on faces.
    form : (e,) or (m,) ndarray
    """
    complex_ = complex_of(mesh)
    if degree_of(complex_, form) == 1:
        pairing = row_dot(sharp(mesh, form), vectors) * complex_.metric.measure
        weights = np.repeat(complex_.metric.measure, 3)
        corner = complex_.corners.ravel()
        total = sum_by_index(corner, np.repeat(pairing, 3), complex_.counts[0])
        area = sum_by_index(corner, weights, complex_.counts[0])
        return ratio(total, area)
    normal = np.cross(mesh.side_vector[:, 0], mesh.side_vector[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    density = form / complex_.metric.measure
    return flat_of_cells(complex_, mesh, np.cross(normal, vectors) * density[:, None])


def flat_of_cells(complex_: Complex, mesh: SpaceMesh, vectors: NDArray) -> NDArray[np.float64]:
    """(e,) 1-form from cell vectors, also where cells and vertices have the same number; see `flat`."""
    along = mesh.points[complex_.edges[:, 1]] - mesh.points[complex_.edges[:, 0]]
    return row_dot(_mean_over_cells(complex_, vectors), along)


def lie_derivative(mesh: TriangleMesh, vectors: NDArray, form: NDArray) -> NDArray[np.float64]:
    """Lie derivative of a form along cell vectors, Cartan's i_X d + d i_X; commutes with d exactly."""
    complex_ = complex_of(mesh)
    degree = degree_of(complex_, form)
    result = np.zeros(len(form))
    if degree < 2:
        result = result + interior_product(mesh, vectors, complex_.derivatives[degree] @ form)
    if degree > 0:
        result = result + complex_.derivatives[degree - 1] @ interior_product(mesh, vectors, form)
    return result
