"""Smoothed aggregation for matrices with blocks, in about twice the memory of the matrix.

A level has the nodes of the one below in groups of neighbours, and represents its vectors of little energy
exactly. The levels are those of pyamg's `smoothed_aggregation_solver` with every block a node; that
function copies the matrix several times.

P. Vanek, J. Mandel, M. Brezina, "Algebraic multigrid by smoothed aggregation for second and fourth order
elliptic problems", 1996.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix, csr_matrix

__all__ = ["aggregation_cycle"]

SMOOTHING = 4.0 / 3.0  # damping of the prolongation smoother, over the largest eigenvalue of D^-1 A
LANCZOS_STEPS = 12  # for that eigenvalue
MAX_COARSE = 80  # nodes that are solved densely
MAX_LEVELS = 12
MAX_TRANSPOSE = 1 << 28  # bytes of a prolongation whose transpose is stored; it saves a tenth of a cycle
PIECE_ENTRIES = 1 << 24  # entries of a matrix whose coarse matrix is computed at a time


def aggregation_cycle(matrix: Any, modes: NDArray) -> Callable[[NDArray], NDArray]:
    """One symmetric V-cycle from zero; the same bits each time.

    Parameters
    ----------
    matrix : (n, n) bsr_array or csr_array
        Symmetric, positive definite.
    modes : (n, k) ndarray
        Vectors that every level represents.

    Returns
    -------
    callable
        Preconditioner: takes and returns an (n,) ndarray; symmetric and positive definite.
    """
    from pyamg.multilevel import MultilevelSolver
    from pyamg.relaxation.smoothing import change_smoothers

    block = matrix.blocksize if matrix.format == "bsr" else (1, 1)
    data = matrix.data.reshape(-1, *block)
    a = bsr_matrix((data, matrix.indices, matrix.indptr), shape=matrix.shape)
    levels = []
    while True:
        level = MultilevelSolver.Level()
        level.A = a
        levels.append(level)
        if len(a.indptr) - 1 <= MAX_COARSE or len(levels) == MAX_LEVELS:
            break
        level.P, modes = _prolongation(a, modes)
        level.R = _Restriction(level.P) if level.P.data.nbytes > MAX_TRANSPOSE else level.P.T.tobsr()
        a = _coarse(a, level.P)
    hierarchy = MultilevelSolver(levels)
    sweep = ("gauss_seidel", {"sweep": "symmetric"})
    change_smoothers(hierarchy, sweep, sweep)
    return hierarchy.aspreconditioner(cycle="V").matvec


class _Restriction:
    """The transpose of a prolongation, made for each product some rows at a time."""

    def __init__(self, prolongation: bsr_matrix) -> None:
        self._prolongation = prolongation

    def __matmul__(self, r: NDArray) -> NDArray[np.float64]:
        p, size = self._prolongation, self._prolongation.blocksize[0]
        total = np.zeros(p.shape[1])
        for rows in _row_pieces(p):
            total += _rows(p, rows).T @ r[size * rows.start : size * rows.stop]
        return total

    __mul__ = __matmul__  # pyamg before 5.2


def _prolongation(a: bsr_matrix, modes: NDArray) -> tuple[bsr_matrix, NDArray]:
    """From the next level to this one, (1 - w D^-1 A) T with piecewise modes T; and modes there."""
    from pyamg.aggregation.aggregate import standard_aggregation
    from pyamg.aggregation.tentative import fit_candidates

    nodes = len(a.indptr) - 1
    unread = np.broadcast_to(np.int8(1), len(a.indices))
    groups, _ = standard_aggregation(csr_matrix((unread, a.indices, a.indptr), shape=(nodes, nodes)))
    pieces, modes = fit_candidates(csr_matrix(groups), modes)
    smooth = bsr_matrix(a @ pieces)
    inverse = np.linalg.pinv(_diagonal(a), hermitian=True)  # aggregates of few nodes lack some modes
    weight = -SMOOTHING / _largest_eigenvalue(a, inverse)
    counts = np.diff(smooth.indptr)
    group = np.full(nodes, -1, dtype=smooth.indices.dtype)  # of a node; isolated ones have none
    group[np.diff(pieces.indptr) > 0] = pieces.indices
    for rows in _row_pieces(smooth):
        entries = slice(smooth.indptr[rows.start], smooth.indptr[rows.stop])
        row = np.repeat(np.arange(rows.start, rows.stop), counts[rows])
        smooth.data[entries] = weight * (inverse[row] @ smooth.data[entries])
        own = np.flatnonzero(smooth.indices[entries] == group[row])
        smooth.data[entries.start + own] += pieces.data[pieces.indptr[row[own]]]
    return smooth, modes


def _coarse(a: bsr_matrix, p: bsr_matrix) -> bsr_matrix:
    """P^T A P, some rows of A at a time."""
    coarse: Any = 0
    for rows in _row_pieces(a):
        coarse = coarse + bsr_matrix(_rows(p, rows).T @ (_rows(a, rows) @ p))
    coarse = bsr_matrix(coarse)
    coarse.sort_indices()  # groups depend on the order of neighbours
    return coarse


def _row_pieces(a: bsr_matrix) -> Iterator[slice]:
    """Blocks of rows with about PIECE_ENTRIES entries each."""
    nodes = len(a.indptr) - 1
    count = max(1, -(-a.data.size // PIECE_ENTRIES))
    ends = np.linspace(0, nodes, count + 1).astype(int)
    return (slice(begin, end) for begin, end in zip(ends[:-1], ends[1:]))


def _rows(a: bsr_matrix, rows: slice) -> bsr_matrix:
    """Rows of blocks."""
    begin, end = a.indptr[rows.start], a.indptr[rows.stop]
    start = a.indptr[rows.start : rows.stop + 1] - begin
    shape = ((rows.stop - rows.start) * a.blocksize[0], a.shape[1])
    return bsr_matrix((a.data[begin:end], a.indices[begin:end], start), shape=shape)


def _diagonal(a: bsr_matrix) -> NDArray[np.float64]:
    """(nodes, b, b) blocks on the diagonal."""
    row = np.repeat(np.arange(len(a.indptr) - 1, dtype=a.indices.dtype), np.diff(a.indptr))
    return a.data[a.indices == row]


def _largest_eigenvalue(a: bsr_matrix, inverse: NDArray) -> float:
    """Estimate of the largest eigenvalue of D^-1 A, from below, by the coefficients of conjugate gradients.

    Y. Saad, "Iterative methods for sparse linear systems", 2003, section 6.7.3.
    """
    size = inverse.shape[-1]
    r = np.random.default_rng(0).normal(size=a.shape[0])
    p, before, share = np.zeros(len(r)), 0.0, 0.0
    diagonal, off = [], []
    for _ in range(min(LANCZOS_STEPS, len(r))):
        z = (inverse @ r.reshape(-1, size, 1)).ravel()
        rz = float(r @ z)
        beta = rz / before if before else 0.0
        p = z + beta * p
        ap = a @ p
        curvature = float(p @ ap)
        if not curvature > 0:
            break
        diagonal.append(curvature / rz + beta * share)
        off.append(np.sqrt(beta) * share)
        share, before = curvature / rz, rz
        r -= rz / curvature * ap
    if not diagonal:
        return np.inf  # not definite: conjugate gradients report it
    return float(np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off[1:], 1) + np.diag(off[1:], -1))[-1])
