"""Condition number of a semidefinite matrix on the complement of its null space, component by component."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, eye_array, sparray

from ddgcli.errors import SolveError
from ddgcli.linalg.factor import Factor
from ddgcli.linalg.indices import compact

DENSE_SIZE = 200  # unknowns of a component up to which all its eigenvalues are computed
BATCH_ENTRIES = 4_000_000  # entries of the dense blocks that are held at a time
LANCZOS_STEPS = 10  # restarts for the largest eigenvalue before it is computed by inversion


def condition_number(matrix: sparray) -> float | None:
    """Largest over smallest non-zero eigenvalue of a stiffness matrix, whose null space is the constants.

    The matrix falls into components, each with the constants as null space: the extremes over the components
    are those of the whole. Small components of one size are solved together.

    Parameters
    ----------
    matrix : (n, n) sparse array
        Symmetric; unknowns without a diagonal entry are left out.

    Returns
    -------
    float or None
        None where no component has two unknowns; nan where the matrix is singular to working precision.
    """
    from scipy.sparse.csgraph import connected_components

    nonzero = np.flatnonzero(matrix.diagonal() != 0.0)
    inner = compact(csr_array(matrix)[nonzero][:, nonzero])
    count, label = connected_components(inner, directed=False)
    size = np.bincount(label, minlength=count)
    extremes = [_small_extremes(inner, label, size, int(s)) for s in np.unique(size) if 1 < s <= DENSE_SIZE]
    order = np.argsort(label, kind="stable")
    start = np.concatenate([[0], np.cumsum(size)])
    for component in np.flatnonzero(size > DENSE_SIZE):
        rows = order[start[component] : start[component + 1]]
        extremes.append(_extremes(csr_array(inner[rows][:, rows])))
    if not extremes:
        return None
    smallest, largest = (
        float(pick(np.array(values))) for pick, values in zip((np.min, np.max), zip(*extremes))
    )
    return largest / smallest if smallest > 0 else float("nan")


def _small_extremes(matrix: csr_array, label: NDArray, size: NDArray, s: int) -> tuple[float, float]:
    """Smallest non-zero and largest eigenvalue among the components of `s` unknowns, by dense blocks."""
    number = np.cumsum(size == s) - 1  # of each such component among them
    rank = np.empty(len(label), dtype=np.int64)  # of each unknown in its component
    order = np.argsort(label, kind="stable")
    rank[order] = np.arange(len(label)) - np.repeat(np.cumsum(size) - size, size)
    entries = coo_array(matrix)
    row, column = entries.coords
    inside = np.flatnonzero(size[label[row]] == s)
    row, column, value = row[inside], column[inside], entries.data[inside]
    block = number[label[row]]
    smallest, largest = np.inf, 0.0
    step = max(BATCH_ENTRIES // s**2, 1)
    for first in range(0, int(number[-1]) + 1, step):
        these = np.flatnonzero((block >= first) & (block < first + step))
        dense = np.zeros((min(step, int(number[-1]) + 1 - first), s, s))
        np.add.at(dense, (block[these] - first, rank[row[these]], rank[column[these]]), value[these])
        values = np.linalg.eigvalsh(dense)
        if (values[:, 1] <= s * np.finfo(float).eps * values[:, -1]).any():
            return float("nan"), float("nan")
        smallest, largest = min(smallest, float(values[:, 1].min())), max(largest, float(values[:, -1].max()))
    return smallest, largest


def _extremes(matrix: csr_array) -> tuple[float, float]:
    """Smallest non-zero and largest eigenvalue of one component; nan where it is singular."""
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

    n = matrix.shape[0]
    start = np.random.default_rng(0).normal(size=n)
    shift = 1e-9 * float(np.median(matrix.diagonal()))
    try:
        factor = Factor(matrix + shift * eye_array(n))
        inverse = LinearOperator((n, n), matvec=lambda x: factor.solve(x, refine=False), dtype=np.float64)
        smallest = eigsh(
            matrix, 2, sigma=-shift, OPinv=inverse, return_eigenvectors=False, v0=start, tol=1e-6
        ).max()
        return float(smallest), _largest(matrix, start)
    except (SolveError, ArpackError):
        return float("nan"), float("nan")


def _largest(matrix: csr_array, start: NDArray) -> float:
    """Largest eigenvalue; where the upper end is dense, by inversion at Gershgorin's bound."""
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

    try:
        values = eigsh(
            matrix, 1, which="LA", return_eigenvectors=False, v0=start, tol=1e-6, maxiter=LANCZOS_STEPS
        )
        return float(values[0])
    except ArpackNoConvergence:
        n = matrix.shape[0]
        bound = float(np.asarray(abs(matrix).sum(axis=1)).max()) * (1 + 1e-9)
        factor = Factor(bound * eye_array(n) - matrix)
        inverse = LinearOperator((n, n), matvec=lambda x: -factor.solve(x, refine=False), dtype=np.float64)
        values = eigsh(matrix, 1, sigma=bound, OPinv=inverse, return_eigenvectors=False, v0=start, tol=1e-6)
        return float(values[0])
