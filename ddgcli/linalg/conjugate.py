"""Conjugate gradients for one Newton move: the factorisation of a nearby matrix is the preconditioner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Operator = Callable[[NDArray], NDArray]


@dataclass(frozen=True, eq=False)
class NewtonStep:
    """Result of `truncated_conjugate_gradients`.

    Parameters
    ----------
    x : (n,) ndarray
    error : float
        Estimate of the largest entry of the error.
    rounds : int
    convex : bool
        No direction of negative curvature ended the search.
    """

    x: NDArray[np.float64]
    error: float
    rounds: int
    convex: bool


def truncated_conjugate_gradients(
    apply: Operator,
    precondition: Operator,
    rhs: NDArray,
    tolerance: Callable[[float], float],
    max_iterations: int,
    continue_past: Callable[[float], bool] = lambda first: False,
) -> NewtonStep | None:
    """Approximate solution of a symmetric system; a descent direction if rhs = -gradient, wherever it stops.

    Parameters
    ----------
    apply, precondition : callables (n,) -> (n,)
        The matrix, and the inverse of a positive definite one near it.
    rhs : (n,) ndarray
    tolerance : callable float -> float
        From the largest entry of the first guess: how large the missing part may be.
    max_iterations : int
    continue_past : callable float -> bool
        From the same entry: whether to continue where the curvature is negative, to a stationary point of any
        kind (as long as the way there descends).

    Returns
    -------
    NewtonStep, or None where the preconditioner turns out not to be positive definite.

    Notes
    -----
    Ends at the first direction of negative curvature, with what was found before it or with the first guess
    (T. Steihaug, "The conjugate gradient method and trust regions in large scale optimization", 1983).
    Where the preconditioner's own guess is about as long as it should be, it is taken whole before the
    conjugate directions begin: then what is left has no part along vectors on which matrix and preconditioner
    agree, such as translations, and their balance is kept to rounding. (Later steps may then climb; where
    they do, that guess is the answer.)
    """
    x, r = np.zeros_like(rhs), rhs.copy()
    z = precondition(r)
    rz = float(r @ z)
    first = float(np.abs(z).max(initial=0.0))
    if not rz > 0:
        return NewtonStep(x, 0.0, 0, True) if first == 0.0 else None
    allowed = tolerance(first)
    guess, p, error, truncated = z, z, first, None
    for k in range(1, max_iterations + 1):
        ap = apply(p)
        curvature = float(p @ ap)
        if not curvature > 0 and truncated is None:
            truncated = NewtonStep(x.copy() if float(rhs @ x) > 0 else guess, error, k, False)
            if not continue_past(first) or curvature == 0.0:
                return truncated
        step = rz / curvature
        whole = k == 1 and 0.5 < step < 2.0
        step = 1.0 if whole else step
        x += step * p
        r -= step * ap
        z = precondition(r)
        error = max(float(np.abs(z).max()), abs(step) * float(np.abs(p).max()) if k > 1 else 0.0)
        if error <= allowed:
            break
        before, rz = rz, float(r @ z)
        if not rz > 0:
            return truncated
        p = z if whole else z + rz / before * p
    if not float(rhs @ x) > 0:
        return truncated or NewtonStep(guess, first, k, False)
    return NewtonStep(x, error, k, True)
