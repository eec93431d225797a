"""First (co)homology of solids: closed 1-forms in independent classes, and generator loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import cg

from ddgcli.algorithms.hodge.homology import Boundary, betti_numbers, loops_with_periods
from ddgcli.errors import SolveError
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.operators.dec import Complex, complex_of


def solid_cochains(complex_: Complex, count: int, boundary: Boundary) -> csr_array:
    """Closed 1-forms of a solid in independent classes: random forms minus their coexact parts.

    The coexact part c of w solves d' d c = d' d w, a consistent singular system without lengths, by conjugate
    gradients. What rounding leaves of it is removed in the same way.

    Parameters
    ----------
    complex_ : Complex
        Of tetrahedra.
    count : int
        Number of classes.
    boundary : {'tangential', 'normal'}
        With 'normal' the forms vanish on boundary edges.

    Returns
    -------
    (e, count) csr_array

    Raises
    ------
    SolveError
        When the iteration does not reach 1e-13.
    """
    n_edges = complex_.counts[1]
    if count == 0:
        return csr_array((n_edges, 0))
    free = ~complex_.boundary_edge if boundary == "normal" else np.ones(n_edges, dtype=bool)
    curl = complex_.derivatives[1].astype(np.float64)[:, np.flatnonzero(free)]
    stiffness = (curl.T @ curl).tocsr()
    diagonal = stiffness.diagonal()
    jacobi = diags_array(1.0 / np.where(diagonal > 0, diagonal, 1.0))
    result = np.zeros((n_edges, count))
    for column in range(count):
        form = np.random.default_rng([0, column]).normal(size=int(free.sum()))
        for tolerance in (1e-13, 1e-2):
            coexact, failed = cg(stiffness, curl.T @ (curl @ form), rtol=tolerance, maxiter=20_000, M=jacobi)
            if failed:
                raise SolveError("harmonic forms: conjugate gradients did not converge in 20000 steps")
            form = form - coexact
        result[free, column] = form
    return csr_array(result)


def solid_generator_loops(mesh: TetMesh) -> list[NDArray[np.int64]]:
    """Closed edge loops that generate the first homology of a solid over the rationals.

    Parameters
    ----------
    mesh : TetMesh

    Returns
    -------
    list of (k,) ndarray of int64
        Vertices of each loop in order; the start is not repeated.
    """
    complex_ = complex_of(mesh)
    forms = solid_cochains(complex_, betti_numbers(mesh).absolute[1], "tangential").toarray()
    ends = mesh.points[complex_.edges]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return loops_with_periods(complex_.edges, length, forms, mesh.n_vertices)
