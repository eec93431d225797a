"""Normal coordinates: how often each edge of a triangulation crosses the edges of the input, as integers.

An edge that is an input edge has coordinate -1. No geometry enters, so none can break the correspondence.
After Gillespie, Sharp, Crane, "Integer Coordinates for Intrinsic Geometry Processing", 2021.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def corner_arcs(opposite: NDArray, left: NDArray, right: NDArray) -> tuple[NDArray, NDArray]:
    """Arcs at the corner of a triangle that faces the side `opposite`.

    Parameters
    ----------
    opposite, left, right : (k,) ndarray of int64
        Coordinates of the three sides, at least zero.

    Returns
    -------
    leaving : (k,) ndarray of int64
        Arcs that end at the corner and cross the opposite side.
    surplus : (k,) ndarray of int64
        left + right - opposite where that is positive: twice the arcs that cut the corner off, and the arcs
        that leave the two other corners.
    """
    difference = opposite - left - right
    return np.maximum(difference, 0), np.maximum(-difference, 0)


def flipped_crossings(ij: NDArray, jk: NDArray, ki: NDArray, il: NDArray, lj: NDArray) -> NDArray[np.int64]:
    """Coordinate of kl after the flip of ij between the faces (i, j, k) and (j, i, l)."""
    along = np.maximum(-ij, 0)
    ij, jk, ki, il, lj = (np.maximum(n, 0) for n in (ij, jk, ki, il, lj))
    leave_k, cut_k = corner_arcs(ij, jk, ki)
    leave_i1, cut_i1 = corner_arcs(jk, ki, ij)
    leave_j1, cut_j1 = corner_arcs(ki, ij, jk)
    leave_l, cut_l = corner_arcs(ij, il, lj)
    leave_i2, cut_i2 = corner_arcs(lj, ij, il)
    leave_j2, cut_j2 = corner_arcs(il, lj, ij)
    cut_k, cut_i1, cut_j1 = (
        (cut_k - leave_i1 - leave_j1) // 2,
        (cut_i1 - leave_j1 - leave_k) // 2,
        (cut_j1 - leave_k - leave_i1) // 2,
    )
    cut_l, cut_i2, cut_j2 = (
        (cut_l - leave_i2 - leave_j2) // 2,
        (cut_i2 - leave_j2 - leave_l) // 2,
        (cut_j2 - leave_l - leave_i2) // 2,
    )
    twice = (
        2 * (cut_l + cut_k)
        + np.abs(cut_j2 - cut_j1)
        + np.abs(cut_i2 - cut_i1)
        - leave_l
        - leave_k
        + 2 * (leave_i1 + leave_i2 + leave_j1 + leave_j2)
    )
    return twice // 2 + along
