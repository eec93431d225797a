"""Conjugate gradients for vertex displacements of mechanical systems whose factors do not fit into memory.

The preconditioner is smoothed aggregation (`aggregation`) with the rigid motions on every level (the extra
`multigrid`), or the inverses of the (3, 3) blocks of the vertices, which need no further library but many
more iterations. Iterations end when the error in the norm of the preconditioner is `REDUCTION` times the
first one; Newton's method measures its own residual.

P. Vanek, J. Mandel, M. Brezina, "Algebraic multigrid by smoothed aggregation for second and fourth order
elliptic problems", 1996.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csr_array, sparray
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ddgcli.errors import SolveError
from ddgcli.linalg.aggregation import aggregation_cycle
from ddgcli.linalg.iterative import jacobi, require_multigrid

__all__ = ["BlockIterative", "RigidMotions"]

REDUCTION = 1e-6  # error of a solution over that of zero, in the norm of the preconditioner
MAX_ITERATIONS = 3000
# mean index difference of neighbours over sqrt(n), up to which neighbours are close enough for caches
LOCAL_DISTANCE = 10.0


@dataclass(frozen=True, eq=False)
class RigidMotions:
    """Vectors that the levels of multigrid represent, and the order of the unknowns.

    Parameters
    ----------
    modes : (n, k) ndarray
        Vectors of little energy: rigid motions, and the internal unknowns together.
    by_vertex : bool
        Every vertex has three consecutive unknowns.
    """

    modes: NDArray[np.float64]
    by_vertex: bool


class BlockIterative:
    """Preconditioned conjugate gradients for a definite matrix.

    Parameters
    ----------
    name : {'multigrid', 'conjugate-gradients'}

    Attributes
    ----------
    name : str
    reduction : float
        Factor by which a solve reduces the error, in the norm of the preconditioner.
    most_iterations : int
        Largest number of iterations of a solve since the start.
    residual : float
        Largest |A x - b| / |b| of all solves, Euclidean norms.
    """

    reduction = REDUCTION

    def __init__(self, name: str) -> None:
        require_multigrid(name)
        self.name = name
        self.most_iterations, self.residual = 0, 0.0
        self._matrix: Any = None
        self._precondition: Any = None

    def release(self) -> None:
        """Free the matrix and its preconditioner."""
        self._matrix = self._precondition = None

    def prepare(self, matrix: sparray, motions: RigidMotions) -> None:
        """Preconditioner of a symmetric matrix: BSR with (3, 3) blocks, or any format."""
        rows = _by_rows(matrix, motions.by_vertex)
        self._order = _local_order(rows, 3 if motions.by_vertex else 1)
        self._matrix = rows if self._order is None else _reordered(rows, self._order)
        modes = motions.modes if self._order is None else motions.modes[self._order]
        build = aggregation_cycle if self.name == "multigrid" else _block_jacobi
        self._precondition = build(self._matrix, modes)

    def solve(self, rhs: NDArray) -> NDArray[np.float64]:
        """Solution (n,) to REDUCTION of the error of zero.

        Raises
        ------
        SolveError
            The matrix is not positive definite, or MAX_ITERATIONS are too few.
        """
        order = self._order
        if order is None:
            return self._solve(rhs)
        x = np.empty(len(rhs))
        x[order] = self._solve(rhs[order])
        return x

    def _solve(self, b: NDArray) -> NDArray[np.float64]:
        x, r = np.zeros(len(b)), b.copy()
        z = self._precondition(r)
        rz = first = float(r @ z)
        p, k = z.copy(), 0
        while abs(rz) > REDUCTION**2 * abs(first):
            ap = self._matrix @ p
            curvature = float(p @ ap)
            if not curvature > 0 or not rz > 0:
                raise SolveError(f"{self.name}: the matrix is not positive definite")
            if k == MAX_ITERATIONS:
                raise SolveError(
                    f"{self.name} did not converge in {k} iterations (error {np.sqrt(rz / first):.2g})"
                )
            x += rz / curvature * p
            r -= rz / curvature * ap
            z = self._precondition(r)
            before, rz, k = rz, float(r @ z), k + 1
            p *= rz / before
            p += z
        if not np.isfinite(rz):
            raise SolveError(f"{self.name}: the system holds values that are not finite")
        self.most_iterations = max(self.most_iterations, k)
        size = float(np.linalg.norm(b)) or 1.0
        self.residual = max(self.residual, float(np.linalg.norm(r)) / size)
        return x


def _by_rows(matrix: sparray, by_vertex: bool) -> sparray:
    """The symmetric matrix by rows, with (3, 3) blocks where each vertex has three unknowns."""
    if isinstance(matrix, bsr_array):
        return matrix
    rows = matrix.T if matrix.format == "csc" else matrix  # the same matrix, without a copy
    return rows.tobsr((3, 3)) if by_vertex else csr_array(rows)


def _graph(rows: Any) -> csr_array:
    """Graph of the blocks, with unread values."""
    unread = np.broadcast_to(np.int8(1), len(rows.indices))
    n = len(rows.indptr) - 1
    return csr_array((unread, rows.indices, rows.indptr), shape=(n, n))


def _local_order(rows: Any, block: int) -> NDArray[np.int64] | None:
    """Order in which neighbours are near each other in memory; None where they already are."""
    row = np.repeat(np.arange(len(rows.indptr) - 1, dtype=rows.indices.dtype), np.diff(rows.indptr))
    row -= rows.indices
    distance = float(np.abs(row, out=row).mean(dtype=np.float64)) if len(row) else 0.0
    if distance <= LOCAL_DISTANCE * np.sqrt(len(rows.indptr)):
        return None
    order = reverse_cuthill_mckee(_graph(rows), symmetric_mode=True).astype(np.int64)
    return (block * order[:, None] + np.arange(block)).ravel()


def _reordered(rows: Any, order: NDArray) -> sparray:
    """Rows and columns in an order that keeps the blocks."""
    if rows.format != "bsr":
        return csr_array(rows[order][:, order])
    nodes = order[::3] // 3
    entry = csr_array((np.arange(len(rows.indices)), rows.indices, rows.indptr), shape=_graph(rows).shape)
    entry = csr_array(entry[nodes][:, nodes])
    return bsr_array((rows.data[entry.data], entry.indices, entry.indptr), shape=rows.shape)


def _block_jacobi(rows: Any, modes: NDArray) -> Callable[[NDArray], NDArray]:
    """Inverses of the blocks on the diagonal."""
    if rows.format != "bsr":
        return jacobi(rows)
    row = np.repeat(np.arange(len(rows.indptr) - 1), np.diff(rows.indptr))
    blocks = np.linalg.inv(rows.data[rows.indices == row])
    return lambda r: (blocks @ r.reshape(-1, 3, 1)).ravel()
