"""Discrete forms: fields to forms and back, products, derivative along a field, eigenforms."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.algorithms.laplacian.form_spectrum import FormSpectrum, form_spectrum
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.mesh.fields import finite_values
from ddgcli.mesh.require import require
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators import whitney
from ddgcli.operators.dec import complex_of
from ddgcli.operators.form_products import form_values, operands

__all__ = ["eigenforms", "flat", "interior_product", "lie_derivative", "sharp", "wedge"]

SpaceMesh = TriangleMesh | TetMesh


@accepts_arrays("surface", "tetrahedra")
def eigenforms(mesh: SpaceMesh, k: int = 10, *, seed: int = 0) -> FormSpectrum:
    """Smallest eigenpairs of the Hodge Laplacian of 1-forms, (d delta + delta d) a = lambda a.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
        A surface is an oriented manifold. Forms are tangential to the boundary.
    k : int
        Number of pairs, from 1 to the number of edges.
    seed : int
        Seed of the starting block.

    Returns
    -------
    FormSpectrum
        `pairs.values` (k,) ascending, in 1/length^2; `pairs.vectors` (e, k), integrals along the `edges`;
        `fields` (k, m, 3), the forms as vectors on cells; `kernel`, how many of the k values are zero.

    Raises
    ------
    MeshError, ParameterError

    References
    ----------
    D. Arnold, R. Falk, R. Winther, "Finite element exterior calculus, homological techniques, and
    applications", 2006.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> forms = ddg.eigenforms(ddg.torus(24, 12), 3)
    >>> forms.kernel  # the first Betti number
    2
    """
    return form_spectrum(mesh, k, seed=seed)


@accepts_arrays("surface", "tetrahedra")
def flat(mesh: SpaceMesh, vectors: ArrayLike) -> NDArray[np.float64]:
    """1-form of a vector field: its integral along every edge.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
    vectors : (n, 3) or (m, 3) array_like of float
        On vertices (linear along the edges) or on cells (an edge takes the mean over its cells); on vertices
        where there are as many of both.

    Returns
    -------
    (e,) ndarray of float64
        In the unit of the vectors times length, for edges from tail to head.

    Raises
    ------
    MeshError
        For a surface that is not an oriented manifold.
    ParameterError
        For an array of another shape, or a number that is not finite.

    References
    ----------
    A. Hirani, "Discrete exterior calculus", 2003, chapter 5.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.grid(4, 4)
    >>> a = ddg.flat(mesh, [[1, 2, 0]] * mesh.n_faces)
    >>> bool(abs(ddg.sharp(mesh, a) - [1, 2, 0]).max() < 1e-12)
    True
    """
    _require_forms(mesh, "flat")
    values = np.asarray(vectors, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != 3:
        raise ParameterError(
            f"an array of shape {values.shape} is not a field; give (n, 3) vectors", parameter="vectors"
        )
    with renamed_parameters("vectors"):
        return whitney.flat(mesh, finite_values(values, "row", what="the field"))


@accepts_arrays("surface", "tetrahedra")
def sharp(mesh: SpaceMesh, form: ArrayLike) -> NDArray[np.float64]:
    """Vector field of a 1-form: the mean of its Whitney interpolation over each cell.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
    form : (e,) array_like of float
        Integrals along the edges, from tail to head.

    Returns
    -------
    (m, 3) ndarray of float64
        In the unit of the form divided by length.

    Raises
    ------
    MeshError
        For a surface that is not an oriented manifold.
    ParameterError
        For an array of another length.

    References
    ----------
    A. Hirani, "Discrete exterior calculus", 2003, chapter 5.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.grid(4, 4)
    >>> x = mesh.points[:, 0]
    >>> bool(abs(ddg.sharp(mesh, ddg.d0(mesh) @ x) - [1, 0, 0]).max() < 1e-12)  # the gradient of x
    True
    """
    _require_forms(mesh, "sharp")
    complex_ = complex_of(mesh)
    with renamed_parameters("form"):
        values = form_values(complex_, form)
    if len(values) != complex_.counts[1]:
        raise ParameterError(
            f"{len(values)} numbers for {complex_.counts[1]} edges; a 1-form has one on each edge",
            parameter="form",
        )
    return whitney.sharp(mesh, values)


@accepts_arrays("surface", "tetrahedra")
def wedge(mesh: SpaceMesh, a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Wedge of two forms: the cup product, averaged over the orders of the corners of each simplex.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
    a, b : array_like of float
        Forms; their lengths (numbers of vertices, edges, faces, tetrahedra) determine the degrees p and q.

    Returns
    -------
    ndarray of float64
        (p+q)-form. a ^ b = (-1)^(pq) b ^ a and d (a ^ b) = da ^ b + (-1)^p a ^ db to rounding.

    Raises
    ------
    MeshError
        For a surface that is not an oriented manifold.
    ParameterError
        For arrays that are not forms, or p + q above the dimension.

    References
    ----------
    A. Hirani, "Discrete exterior calculus", 2003, section 7.1.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.grid(4, 4)
    >>> dx, dy = (ddg.d0(mesh) @ mesh.points[:, i] for i in range(2))
    >>> round(float(ddg.wedge(mesh, dx, dy).sum()), 12)  # the area
    1.0
    """
    _require_forms(mesh, "wedge")
    complex_ = complex_of(mesh)
    with renamed_parameters(first="a", form="b"):
        return whitney.wedge(complex_, *operands(complex_, "wedge", a, b))


@accepts_arrays("surface", "tetrahedra")
def interior_product(mesh: SpaceMesh, vectors: ArrayLike, form: ArrayLike) -> NDArray[np.float64]:
    """Interior product of a vector field and a form of degree k >= 1.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
    vectors : (n, 3) or (m, 3) array_like of float
        On vertices or cells; tangent on a surface.
    form : array_like of float
        Its length determines the degree.

    Returns
    -------
    ndarray of float64
        (k-1)-form.

    Raises
    ------
    MeshError
        For a surface that is not an oriented manifold.
    ParameterError
        For arrays that are not a form or a field, or a 0-form.

    References
    ----------
    A. Hirani, "Discrete exterior calculus", 2003, chapter 8.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.grid(4, 4)
    >>> dx = ddg.d0(mesh) @ mesh.points[:, 0]
    >>> ddg.interior_product(mesh, [[3, 1, 0]] * mesh.n_faces, dx)[0].round(12).item()
    3.0
    """
    _require_forms(mesh, "interior_product")
    with renamed_parameters(first="vectors"):
        return whitney.interior_product(mesh, *operands(complex_of(mesh), "interior_product", vectors, form))


@accepts_arrays("surface", "tetrahedra")
def lie_derivative(mesh: SpaceMesh, vectors: ArrayLike, form: ArrayLike) -> NDArray[np.float64]:
    """Lie derivative of a form along a vector field, i_X d + d i_X.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
    vectors : (n, 3) or (m, 3) array_like of float
        On vertices or cells; tangent on a surface.
    form : array_like of float
        Its length determines the degree.

    Returns
    -------
    ndarray of float64
        A form of the same degree; commutes with d to rounding.

    Raises
    ------
    MeshError
        For a surface that is not an oriented manifold.
    ParameterError
        For arrays that are not a form or a field.

    References
    ----------
    P. Mullen, A. McKenzie, D. Pavlov, L. Durant, Y. Tong, E. Kanso, J. Marsden, M. Desbrun, "Discrete Lie
    advection of differential forms", 2011.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> mesh = ddg.grid(4, 4)
    >>> wind = [[3, 0, 0]] * mesh.n_faces
    >>> ddg.lie_derivative(mesh, wind, mesh.points[:, 0])[5].round(12).item()
    3.0
    """
    _require_forms(mesh, "lie_derivative")
    with renamed_parameters(first="vectors"):
        return whitney.lie_derivative(mesh, *operands(complex_of(mesh), "lie_derivative", vectors, form))


def _require_forms(mesh: SpaceMesh, subject: str) -> None:
    if isinstance(mesh, TriangleMesh):
        require(mesh, subject, manifold=True, oriented=True)
