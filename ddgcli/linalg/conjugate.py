"""Conjugate gradients for one Newton step, preconditioned by the factors of a nearby matrix."""

from __future__ import annotations

import math
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
        Whether no direction of negative curvature was met.
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
    """Approximate solution of a symmetric system, which is a descent direction if rhs = -gradient.

    Parameters
    ----------
    apply, precondition : callables (n,) -> (n,)
        The matrix, and the inverse of a positive definite one near it.
    rhs : (n,) ndarray
    tolerance : callable float -> float
        Allowed error as a function of the largest entry of the first guess.
    max_iterations : int
    continue_past : callable float -> bool
        Whether to continue past negative curvature, as a function of the same entry: to a stationary point of
        any kind, as long as the path descends.

    Returns
    -------
    NewtonStep, or None if the preconditioner turns out not to be positive definite.

    Notes
    -----
    The iteration ends at the first direction of negative curvature, with the iterate before it or the first
    guess (T. Steihaug, "The conjugate gradient method and trust regions in large scale optimization", 1983).
    If the length of the preconditioner's first guess is about right, the whole guess is taken before the
    conjugate directions start. The residual then has no component along vectors on which matrix and
    preconditioner agree, such as translations, and their balance is exact up to rounding. (Later steps may
    then increase the objective; if they do, the first guess is returned.)
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


@dataclass(frozen=True, eq=False)
class TrustRegionMinimum:
    """Result of `trust_region_conjugate_gradients`.

    Parameters
    ----------
    x : ndarray
    fall : float
        Decrease of the quadratic model from zero to x.
    at_boundary : bool
        Whether the iteration ended at the trust region or at a direction of negative curvature.
    """

    x: NDArray[np.float64]
    fall: float
    at_boundary: bool


def trust_region_conjugate_gradients(
    gradient: NDArray, apply: Operator, precondition: Operator, radius: float, max_iterations: int
) -> TrustRegionMinimum:
    """Minimise g.d + d.Hd/2 for |d| <= radius, in the norm of the preconditioner's matrix.

    Parameters
    ----------
    gradient : (...) ndarray
    apply, precondition : callables of such arrays
        The matrix H, and the inverse of a positive definite one near it.
    radius : float
    max_iterations : int

    Returns
    -------
    TrustRegionMinimum

    Notes
    -----
    T. Steihaug, "The conjugate gradient method and trust regions in large scale optimization", 1983.
    """
    d, r = np.zeros_like(gradient), np.array(gradient)
    z = precondition(r)
    p, rz = -z, float(np.sum(r * z))
    aim = min(0.25, rz**0.25) * math.sqrt(max(rz, 0.0))
    dd, dp, pp, fall = 0.0, 0.0, rz, 0.0
    for _ in range(max_iterations):
        hp = apply(p)
        curvature = float(np.sum(p * hp))
        alpha = rz / curvature if curvature > 0.0 else math.inf
        if alpha == math.inf or dd + 2.0 * alpha * dp + alpha**2 * pp >= radius**2:
            tau = (-dp + math.sqrt(max(dp**2 + pp * (radius**2 - dd), 0.0))) / pp
            fall += tau * rz - 0.5 * tau**2 * curvature
            return TrustRegionMinimum(d + tau * p, fall, True)
        d, r = d + alpha * p, r + alpha * hp
        fall += 0.5 * alpha * rz
        dd += 2.0 * alpha * dp + alpha**2 * pp
        z = precondition(r)
        after = float(np.sum(r * z))
        if math.sqrt(max(after, 0.0)) <= aim:
            break
        beta, rz = after / rz, after
        dp, pp = beta * (dp + alpha * pp), after + beta**2 * pp
        p = -z + beta * p
    return TrustRegionMinimum(d, fall, False)
