"""Next and previous side of a face, by flat side indices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def next_side(side: NDArray) -> NDArray[np.int64]:
    """Next side of the same face.

    Parameters
    ----------
    side : (k,) ndarray of int64
        Flat side indices 3*face + j; side j runs from corner j to corner j+1.

    Returns
    -------
    (k,) ndarray of int64
        As corner indices they name the heads of the sides.

    Examples
    --------
    >>> next_side(np.array([0, 1, 2, 5])).tolist()
    [1, 2, 0, 3]
    """
    return side + np.where(side % 3 == 2, -2, 1)


def previous_side(side: NDArray) -> NDArray[np.int64]:
    """Previous side of the same face.

    Parameters
    ----------
    side : (k,) ndarray of int64
        Flat side indices 3*face + j.

    Returns
    -------
    (k,) ndarray of int64

    Examples
    --------
    >>> previous_side(np.array([0, 1, 2, 3])).tolist()
    [2, 0, 1, 5]
    """
    return side + np.where(side % 3 == 0, 2, -1)
