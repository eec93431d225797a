"""Quasi-Newton equations of limited memory: an approximate inverse Hessian, corrected by the last steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray


def secant_solve(
    rhs: NDArray,
    pairs: Sequence[tuple[NDArray, NDArray]],
    solve: Callable[[NDArray], NDArray],
    *,
    scaled: bool = False,
) -> NDArray[np.float64]:
    """Inverse Hessian of limited-memory BFGS on a vector: the two-loop recursion.

    Parameters
    ----------
    rhs : ndarray of float64
        Right-hand side, of any shape.
    pairs : sequence of (motion, change)
        Motions and the changes of the gradient over them, of the shape of `rhs`, the oldest first; their
        products are positive.
    solve : callable
        Approximate inverse Hessian, positive definite: it acts where no pair does. Its result is changed.
    scaled : bool
        Whether `solve` is made smaller where it exceeds the last pair.

    Returns
    -------
    ndarray of float64
        Solution, with the shape of `rhs`.

    References
    ----------
    J. Nocedal, S. Wright, "Numerical optimization", 2006, section 7.2.

    Examples
    --------
    The last change is the image of the last motion:

    >>> motion, change = np.array([1.0, 0.0]), np.array([4.0, 1.0])
    >>> secant_solve(change, [(motion, change)], np.copy).tolist()
    [1.0, 0.0]
    """
    rest, shares = np.array(rhs), []
    inner = [_product(motion, change) for motion, change in pairs]
    for (motion, change), size in zip(reversed(pairs), reversed(inner), strict=True):
        shares.append(_product(motion, rest) / size)
        rest -= shares[-1] * change
    x = solve(rest)
    if scaled and len(pairs):
        x *= min(1.0, inner[-1] / _product(pairs[-1][1], solve(pairs[-1][1])))
    for (motion, change), size, share in zip(pairs, inner, reversed(shares), strict=True):
        x += (share - _product(change, x) / size) * motion
    return x


def _product(a: NDArray, b: NDArray) -> float:
    return float(np.vdot(a, b))
