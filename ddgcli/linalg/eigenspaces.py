"""Bases of eigenspaces that depend on the eigenspace only, not on rounding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

EQUAL_TO_ROUNDING = 1e-9  # relative difference of copies: 1e-10 at most; others differ by 1e-6 and more


def canonical_vectors(
    values: NDArray, X: NDArray, MX: NDArray, *, n_single: int = 0, rounding: float = 0.0
) -> NDArray[np.float64]:
    """Eigenvectors with a unique basis for every group of equal eigenvalues, and unique signs.

    The vectors of a group, projections of fixed pseudo-random vectors, are orthonormalised one after another.
    A group from which vectors are missing has no unique basis.

    Parameters
    ----------
    values : (k,) ndarray of float64
        In order.
    X : (n, k) ndarray of float64
        M-orthonormal.
    MX : (n, k) ndarray of float64
        M X.
    n_single : int
        The first vectors, of which only the signs are chosen.
    rounding : float
        Difference of values that are equal, beside `EQUAL_TO_ROUNDING`.

    Returns
    -------
    (n, k) ndarray of float64
        M-orthonormal; each scalar product with its random vector is positive.
    """
    groups = np.split(np.arange(len(values)), 1 + np.flatnonzero(_differ(values, n_single, rounding)))
    probes = np.random.default_rng(0).random((max(map(len, groups)), len(X)))
    probes[1:] -= 0.5  # the first is positive, as constants are to be
    basis = np.empty_like(X)
    for group in groups:
        Q, R = np.linalg.qr(MX[:, group].T @ probes[: len(group)].T)
        basis[:, group] = X[:, group] @ (Q * np.where(np.diag(R) < 0, -1.0, 1.0))
    return basis


def _differ(values: NDArray, n_single: int, rounding: float) -> NDArray[np.bool_]:
    """(k - 1,) whether each value differs from the next one by more than rounding."""
    size = np.maximum(np.abs(values[1:]), np.abs(values[:-1]))
    differ = np.abs(np.diff(values)) > EQUAL_TO_ROUNDING * size + rounding
    differ[:n_single] = True
    return np.asarray(differ, dtype=bool)
