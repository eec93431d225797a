"""Every operator of discrete exterior calculus on a mesh as a sparse matrix, by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from ddgcli.errors import MeshError, counted, renamed_parameters
from ddgcli.geometry.remedies import warn_of_solid
from ddgcli.linalg.indices import compact
from ddgcli.memory import check_memory
from ddgcli.mesh.requirements import require_sized_cells
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.dec import Complex, SimplicialMesh, complex_of
from ddgcli.operators.stars import Star, diagonal_star, hodge_star

BYTES_PER_ENTRY = 12  # of a sparse matrix: a float64 and an int32
COPIES_AT_PEAK = 2.15  # a sum and its term; later the matrix and its transpose (2.09)
COPIES_TO_FACTORISE = 9  # measured: 8.9 on a fan of valence 2200, 12 on tetrahedra, 26 on a sphere
LEAST_STAR_ENTRY = 1e-14  # of the largest entry in the cells around: a smaller one has no inverse


@dataclass(frozen=True, eq=False)
class DecMatrices:
    """Operators of a complex of dimension n.

    Parameters
    ----------
    complex_ : Complex
    star : {'circumcentric', 'barycentric', 'galerkin'}
    matrices : dict of str to csr_array
        `d0` … `d(n-1)` (integers), `star0` … `starn` (symmetric), `codifferential1` … `codifferentialn`
        (k-forms to (k-1)-forms, D^-1 d' star with D of `diagonal_star`) and `laplacian0` … `laplaciann`
        (symmetric, positive semidefinite where the stars are: star d delta + d' star d).
    negative_entries : int
        Negative entries on the diagonals of the stars.
    """

    complex_: Complex
    star: Star
    matrices: dict[str, csr_array]
    negative_entries: int

    def derivative_residual(self) -> int:
        """Largest entry of d d, which is zero: a boundary has no boundary."""
        d = self.complex_.derivatives
        return max(int(abs(after.astype(int) @ before.astype(int)).max()) for before, after in zip(d, d[1:]))

    def symmetry_residual(self) -> float:
        """Largest difference of a Laplacian from its transpose, relative to its largest entry."""
        laplacians = [m for name, m in self.matrices.items() if name.startswith("laplacian")]
        return max(_asymmetry(m) for m in laplacians)

    def constant_residual(self) -> float:
        """Largest value of laplacian0 on the constant 1, relative to its largest entry."""
        laplacian = self.matrices["laplacian0"]
        value = np.abs(laplacian @ np.ones(laplacian.shape[0])).max(initial=0.0)
        return float(value / (abs(laplacian).max() or 1.0))


def dec_matrices(complex_: Complex, star: Star = "galerkin") -> DecMatrices:
    """Derivatives, stars, codifferentials and Laplacians of every degree.

    The codifferential of k-forms needs the inverse of the star of (k-1)-forms. That of a `galerkin` star is
    dense, so a diagonal star is inverted in its place (`diagonal_star`): codifferentials are adjoint to
    derivatives in its inner product of (k-1)-forms.

    Parameters
    ----------
    complex_ : Complex
    star : {'circumcentric', 'barycentric', 'galerkin'}

    Returns
    -------
    DecMatrices
        Sparse matrices by name: `d0`, `star0`, `codifferential1`, `laplacian0`, ...

    Raises
    ------
    MeshError
        A circumcentric star has a zero entry, so that it has no inverse (right angles, co-circular pairs);
        or a product of stars overflows (lengths of 1e-100).
    ParameterError
        A vertex of high valence makes a Laplacian of 1-forms too large for the memory.
    """
    n = complex_.dimension
    derivative = [compact(csr_array(d.astype(np.int64))) for d in complex_.derivatives]
    with renamed_parameters(kind="star"):
        stars = [compact(csr_array(hodge_star(complex_, k, star))) for k in range(n + 1)]
    inverse = [_inverse(complex_, k, star) for k in range(n)]
    matrices = {f"d{k}": d for k, d in enumerate(derivative)}
    matrices |= {f"star{k}": matrix for k, matrix in enumerate(stars)}
    delta = [csr_array(inverse[k] @ derivative[k].T @ stars[k + 1]) for k in range(n)]
    matrices |= {f"codifferential{k + 1}": matrix for k, matrix in enumerate(delta)}
    matrices |= {f"laplacian{k}": _laplacian(k, derivative, stars, inverse) for k in range(n + 1)}
    for name, matrix in matrices.items():
        if not np.isfinite(matrix.data).all():
            raise MeshError(f"entries of {name} leave the floating-point range; rescale the coordinates")
    negative = sum(int((matrix.diagonal() < 0).sum()) for matrix in stars)
    return DecMatrices(complex_, star, matrices, negative)


def check_cells(mesh: SimplicialMesh) -> None:
    """Raise an error for cells that no complex has, and warn of those that overlap or lie on each other.

    Parameters
    ----------
    mesh : TriangleMesh, IntrinsicMesh or TetMesh

    Raises
    ------
    MeshError
    """
    if isinstance(mesh, TetMesh | TriangleMesh):
        require_sized_cells(mesh, "dec")
    if isinstance(mesh, TetMesh):
        warn_of_solid(mesh)


def check_star(mesh: TriangleMesh | TetMesh, star: Star) -> None:
    """Raise the errors of `dec_matrices` about the entries of its star, before it computes.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    star : {'circumcentric', 'barycentric', 'galerkin'}

    Raises
    ------
    MeshError
        For a cell without area or volume, or a zero entry of the circumcentric star.
    """
    check_cells(mesh)
    if star == "circumcentric":  # the others are positive
        complex_ = complex_of(mesh)
        for degree in range(complex_.dimension):
            _inverse(complex_, degree, star)


def form_laplacian(complex_: Complex, degree: int) -> tuple[csr_array, csr_array]:
    """Laplacian and Galerkin star of k-forms, as `dec_matrices` has them, without the other degrees.

    They are to be factorised: what the factor of a Laplacian that fills up needs is checked too.

    Parameters
    ----------
    complex_ : Complex
    degree : int

    Returns
    -------
    laplacian : (n_k, n_k) csr_array
        Symmetric positive semidefinite: the star times the Laplace-de Rham operator.
    star : (n_k, n_k) csr_array

    Raises
    ------
    ParameterError
        A vertex of high valence makes the Laplacian and its factor too large for the memory.
    """
    degrees = range(degree, min(degree + 1, complex_.dimension) + 1)
    stars = {k: compact(csr_array(hodge_star(complex_, k, "galerkin"))) for k in degrees}
    inverse = {degree - 1: _inverse(complex_, degree - 1, "galerkin")} if degree else {}
    derivative = [compact(csr_array(d.astype(np.int64))) for d in complex_.derivatives]
    return _laplacian(degree, derivative, stars, inverse, factorised=True), stars[degree]


def _laplacian(
    k: int, derivative: list[csr_array], stars: Any, inverse: Any, factorised: bool = False
) -> csr_array:
    """star d delta + d' star d on k-forms, from stars and inverse stars by degree."""
    terms = []
    if k < len(derivative):
        terms.append(csr_array(derivative[k].T @ stars[k + 1] @ derivative[k]))
    if k > 0:
        weak = csr_array(derivative[k - 1].T @ stars[k])
        _check_fill(weak, k, factorised)
        terms.append(csr_array(weak.T) @ inverse[k - 1] @ weak)
    return csr_array(sum(terms[1:], terms[0]))


def _asymmetry(matrix: csr_array) -> float:
    """Largest difference from the transpose, relative to the largest entry."""
    transpose = csr_array(matrix.T)  # its columns are in order
    largest = max(float(matrix.data.max(initial=0.0)), -float(matrix.data.min(initial=0.0)))
    matrix.sort_indices()
    if np.array_equal(matrix.indices, transpose.indices) and np.array_equal(matrix.indptr, transpose.indptr):
        # the same pattern: a third of the memory and time of a difference of matrices
        np.subtract(transpose.data, matrix.data, out=transpose.data)
        difference = float(np.abs(transpose.data, out=transpose.data).max(initial=0.0))
    else:
        difference = float(abs(matrix - transpose).max())
    return difference / (largest or 1.0)


def _check_fill(weak: csr_array, degree: int, factorised: bool) -> None:
    """Refuse products that fill up: all simplices around one of lower degree couple with each other."""
    copies, what = (COPIES_TO_FACTORISE, "factors") if factorised else (COPIES_AT_PEAK, "matrices")
    row_sizes = np.diff(weak.indptr).astype(np.float64)
    largest = int(row_sizes.argmax()) if len(row_sizes) else 0
    check_memory(
        copies * BYTES_PER_ENTRY * float((row_sizes**2).sum()),
        f"{what} of {degree}-forms",
        f"remesh around {('vertex', 'edge', 'face')[degree - 1]} {largest}, which couples "
        f"{int(row_sizes.max(initial=0))} {degree}-simplices",
    )


def _inverse(complex_: Complex, degree: int, star: Star) -> csr_array:
    """Inverse of `diagonal_star` of a degree below the dimension."""
    diagonal = diagonal_star(complex_, degree, star)
    simplices = (complex_.corners, complex_.cell_edge, complex_.cell_face)[degree]
    is_referenced = np.bincount(simplices.ravel(), minlength=len(diagonal)) > 0
    if star == "circumcentric":  # the entries of others are positive where cells have a size
        _require_inverse(diagonal, simplices, is_referenced, ("vertex", "edge", "face")[degree])
    reciprocal = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=is_referenced)
    return compact(csr_array(diags_array(reciprocal)))


def _require_inverse(diagonal: NDArray, simplices: NDArray, is_referenced: NDArray, simplex: str) -> None:
    """Raise MeshError for entries that are zero beside those of the same cells (meshes have many scales)."""
    size = np.abs(diagonal)
    scale = np.zeros_like(size)
    np.maximum.at(scale, simplices, size[simplices].max(axis=1, keepdims=True))
    bad = np.flatnonzero(is_referenced & (size <= LEAST_STAR_ENTRY * scale))
    if len(bad):
        where = f"{counted(len(bad), 'simplex', 'simplices')} (first: {simplex} {bad[0]})"
        raise MeshError(f"the circumcentric star is zero at {where} and has no inverse: use `star=galerkin`")
