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
from ddgcli.mesh.vectors import ratio, row_cross, row_dot
from ddgcli.operators.dec import Complex, complex_of

SpaceMesh = TriangleMesh | TetMesh


def barycentric_gradients(mesh: SpaceMesh) -> NDArray[np.float64]:
    """Gradients of the barycentric coordinates of each cell.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh

    Returns
    -------
    (m, c, 3) ndarray of float64
        In 1/length; c = 3 corners of a triangle or 4 of a tetrahedron. They sum to zero over the corners.
    """
    corners = mesh.points[mesh.tetrahedra if isinstance(mesh, TetMesh) else mesh.faces]
    edges = corners[:, 1:] - corners[:, :1]
    inverse = np.linalg.pinv(edges)  # (m, 3, c-1): columns are the gradients of corners 1 ...
    rest = np.swapaxes(inverse, 1, 2)
    return np.concatenate([-rest.sum(axis=1, keepdims=True), rest], axis=1)


def whitney_fields(mesh: SpaceMesh) -> NDArray[np.float64]:
    """Whitney form of each edge of each cell, as a vector at the barycentre: its mean over the cell.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh

    Returns
    -------
    (m, s, 3) ndarray of float64
        In 1/length, for the edges of `Complex.cell_edge` in their own direction. A constant field is the sum
        of its edge integrals times these.
    """
    complex_ = complex_of(mesh)
    tail, head = local_edges(complex_).T
    gradient = barycentric_gradients(mesh)
    mean = (gradient[:, head] - gradient[:, tail]) / complex_.corners.shape[1]
    return mean * complex_.cell_edge_sign[:, :, None]


def sharp(mesh: SpaceMesh, form: NDArray) -> NDArray[np.float64]:
    """Vectors on cells from 1-forms: the mean of their Whitney interpolation over each cell.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    form : (e,) or (k, e) ndarray of float64
        Integral along each edge.

    Returns
    -------
    (m, 3) or (k, m, 3) ndarray of float64
        In the unit of the form divided by length.
    """
    fields, cell_edge = whitney_fields(mesh), complex_of(mesh).cell_edge
    vectors = [np.einsum("mj,mjd->md", values[cell_edge], fields) for values in np.atleast_2d(form)]
    return np.stack(vectors) if np.ndim(form) == 2 else vectors[0]


def flat(mesh: SpaceMesh, vectors: NDArray) -> NDArray[np.float64]:
    """1-form of a vector field: its integral along each edge.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    vectors : (n, 3) or (m, 3) ndarray
        On vertices (linear along edges) or on cells (an edge takes the mean over its cells).

    Returns
    -------
    (e,) ndarray of float64
        In the unit of the vectors times length, for edges from tail to head.

    Raises
    ------
    ParameterError
        For another number of vectors.
    """
    complex_ = complex_of(mesh)
    vectors = np.asarray(vectors, dtype=np.float64)
    along = mesh.points[complex_.edges[:, 1]] - mesh.points[complex_.edges[:, 0]]
    if len(vectors) == complex_.counts[0]:
        mean = 0.5 * (vectors[complex_.edges[:, 0]] + vectors[complex_.edges[:, 1]])
    elif len(vectors) == len(complex_.corners):
        mean = _mean_over_cells(complex_.cell_edge, vectors, complex_.counts[1])
    else:
        raise ParameterError(
            f"{len(vectors)} vectors fit neither the {complex_.counts[0]} vertices nor the "
            f"{len(complex_.corners)} cells"
        )
    return row_dot(mean, along)


def _mean_over_cells(index: NDArray, vectors: NDArray, count: int) -> NDArray[np.float64]:
    """(count, 3) mean of cell vectors over the cells around each simplex of `index`, (m, s)."""
    cells = np.bincount(index.ravel(), minlength=count)
    total = sum_by_index(index.ravel(), np.repeat(vectors, index.shape[1], axis=0), count)
    return total / np.maximum(cells, 1)[:, None]


def whitney_load(mesh: SpaceMesh, vectors: NDArray) -> NDArray:
    """Integral of a field that is constant on each cell against the Whitney form of every edge.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    vectors : (m, 3) ndarray of float64

    Returns
    -------
    (e,) ndarray of float64
        Right-hand side of a projection to 1-forms: in the unit of the field times length (surfaces) or
        length^2 (volumes).
    """
    complex_ = complex_of(mesh)
    value = np.einsum("mjd,md->mj", whitney_fields(mesh), vectors) * complex_.metric.measure[:, None]
    return sum_by_index(complex_.cell_edge, value, complex_.counts[1])


def local_edges(complex_: Complex) -> NDArray:
    """Local edges of a cell, as in `Complex.cell_edge`."""
    return TRIANGLE_EDGES if complex_.dimension == 2 else TET_EDGES


def check_degrees(complex_: Complex, p: int, q: int) -> None:
    """Raise an error for degrees whose wedge is zero.

    Parameters
    ----------
    complex_ : Complex
    p, q : int

    Raises
    ------
    ParameterError
        When p + q exceeds the dimension.
    """
    if p + q > complex_.dimension:
        raise ParameterError(
            f"a {p}-form and a {q}-form have no wedge in dimension {complex_.dimension}: it is zero"
        )


def wedge(complex_: Complex, a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Wedge of forms: the cup product of cochains, averaged over the orders of the corners of each simplex.

    Parameters
    ----------
    complex_ : Complex
    a, b : ndarray
        Their lengths determine the degrees: values on vertices, edges, faces (or tetrahedra).

    Returns
    -------
    ndarray
        Form of the summed degree. a ^ b = (-1)^(pq) b ^ a and d (a ^ b) = da ^ b + (-1)^p a ^ db hold to
        round-off; the wedge of Whitney forms of constant fields is exact. It is not associative.

    References
    ----------
    A. Hirani, "Discrete exterior calculus", 2003, section 7.1; S. Wilson, "Cochain algebra on manifolds and
    convergence under refinement", 2007.
    """
    p, q = degree_of(complex_, a), degree_of(complex_, b)
    check_degrees(complex_, p, q)
    if p > q:
        return (-1.0) ** (p * q) * wedge(complex_, b, a)
    if p == 0:
        return a * b if q == 0 else a[_simplices(complex_, q)].mean(axis=1) * b
    return _wedge_of_one_forms(complex_, a, b) if q == 1 else _wedge_with_two_form(complex_, a, b)


def _simplices(complex_: Complex, degree: int) -> NDArray[np.int64]:
    """(n_k, k+1) corners of the simplices of degree 1 or more."""
    if degree == complex_.dimension:
        return complex_.corners
    return complex_.edges if degree == 1 else complex_.faces


def _wedge_of_one_forms(complex_: Complex, a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """(1/6) sum over pairs of sides of a_i b_j - a_j b_i, for sides i before j around the face."""
    u = complex_.face_edge_sign * a[complex_.face_edge]
    v = complex_.face_edge_sign * b[complex_.face_edge]
    following = [1, 2, 0]
    return (u * v[:, following] - u[:, following] * v).sum(axis=1) / 6.0


def _wedge_with_two_form(complex_: Complex, a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """(k,) 1-form and 2-form: (1/12) sum over corners of a on their edges times the outward opposite face."""
    along = complex_.cell_edge_sign * a[complex_.cell_edge]
    leaving = np.zeros(complex_.corners.shape)  # sum of the edges that leave each corner
    for j, (tail, head) in enumerate(TET_EDGES):
        leaving[:, tail] += along[:, j]
        leaving[:, head] -= along[:, j]
    return (leaving * complex_.cell_face_sign * b[complex_.cell_face]).sum(axis=1) / 12.0


def degree_of(complex_: Complex, form: NDArray) -> int:
    """Degree of a form, determined by its length.

    Parameters
    ----------
    complex_ : Complex
    form : ndarray

    Returns
    -------
    int

    Raises
    ------
    ParameterError
        When the length fits no degree, or more than one.
    """
    fits = [k for k, count in enumerate(complex_.counts) if count == len(form)]
    if len(fits) > 1:
        raise ParameterError(
            f"{len(form)} values are a form of degree {fits[0]} and of degree {fits[1]} alike on so small a "
            f"mesh ({list(complex_.counts)} simplices); refine the mesh"
        )
    if not fits:
        raise ParameterError(
            f"a form of {len(form)} values has no degree here: {list(complex_.counts)} are the counts"
        )
    return fits[0]


def interior_product(mesh: SpaceMesh, vectors: NDArray, form: NDArray) -> NDArray[np.float64]:
    """Interior product of cell vectors with a form of degree k >= 1, a form of degree k - 1.

    The pairing of Whitney forms is exact at the barycentre of each cell; the mean over the cells around a
    lower simplex, weighted with their measures for vertices, gives its value there.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    vectors : (m, 3) ndarray
        On cells; on faces of a surface tangent.
    form : ndarray
        Values on edges, faces or tetrahedra.

    Returns
    -------
    ndarray of float64
        A (k-1)-form: values on vertices, edges or faces.
    """
    complex_ = complex_of(mesh)
    degree, measure = degree_of(complex_, form), complex_.metric.measure
    if degree == 1:
        corner, size = complex_.corners.ravel(), complex_.corners.shape[1]
        pairing = row_dot(sharp(mesh, form), vectors) * measure
        total, weight = (
            sum_by_index(corner, np.repeat(values, size), mesh.n_vertices) for values in (pairing, measure)
        )
        return ratio(total, weight)
    if isinstance(mesh, TetMesh):
        if degree == 2:
            return flat_of_cells(complex_, mesh, row_cross(flux_vectors(mesh, form), vectors))
        density = _mean_over_cells(
            complex_.cell_face, vectors * (form / measure)[:, None], complex_.counts[2]
        )
        a, b, c = np.moveaxis(mesh.points[complex_.faces], 1, 0)
        return row_dot(density, 0.5 * row_cross(b - a, c - a))
    normal = row_cross(mesh.side_vector[:, 0], mesh.side_vector[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return flat_of_cells(complex_, mesh, row_cross(normal, vectors) * (form / measure)[:, None])


def flux_vectors(mesh: TetMesh, form: NDArray) -> NDArray[np.float64]:
    """(k, 3) vector proxy of a 2-form at the barycentres of tetrahedra, by Whitney interpolation."""
    complex_ = complex_of(mesh)
    corners = mesh.points[mesh.tetrahedra]
    from_corner = corners.mean(axis=1, keepdims=True) - corners
    outward = complex_.cell_face_sign * np.asarray(form)[complex_.cell_face]
    return np.einsum("mi,mid->md", outward, from_corner) / (3.0 * complex_.metric.measure[:, None])


def flat_of_cells(complex_: Complex, mesh: SpaceMesh, vectors: NDArray) -> NDArray[np.float64]:
    """1-form of a field on cells, also where cells and vertices have the same number.

    Parameters
    ----------
    complex_ : Complex
    mesh : TriangleMesh or TetMesh
    vectors : (m, 3) ndarray
        An edge takes the mean over its cells.

    Returns
    -------
    (e,) ndarray of float64
    """
    along = mesh.points[complex_.edges[:, 1]] - mesh.points[complex_.edges[:, 0]]
    return row_dot(_mean_over_cells(complex_.cell_edge, vectors, complex_.counts[1]), along)


def lie_derivative(mesh: SpaceMesh, vectors: NDArray, form: NDArray) -> NDArray[np.float64]:
    """Lie derivative of a form along vectors on cells: Cartan's formula i_X d + d i_X.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    vectors : (m, 3) ndarray of float64
        On cells; on faces of a surface tangent.
    form : ndarray
        Its length determines the degree.

    Returns
    -------
    ndarray of float64
        A form of the same degree. Commutes with d to round-off.
    """
    complex_ = complex_of(mesh)
    degree = degree_of(complex_, form)
    result = np.zeros(len(form))
    if degree < complex_.dimension:
        result = result + interior_product(mesh, vectors, complex_.derivatives[degree] @ form)
    if degree > 0:
        result = result + complex_.derivatives[degree - 1] @ interior_product(mesh, vectors, form)
    return result
