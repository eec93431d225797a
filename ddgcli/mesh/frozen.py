"""Read-only arrays, and objects whose copies keep them read-only."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def frozen(array: NDArray) -> NDArray:
    """Make an array contiguous and read-only.

    Parameters
    ----------
    array : ndarray

    Returns
    -------
    ndarray
        The array itself where it is contiguous already.
    """
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array


class FrozenArrays:
    """Base of objects with read-only arrays: numpy makes those of deep copies and of pickles writable."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        _freeze(tuple(state.values()))
        self.__dict__.update(state)


def _freeze(value: object) -> None:
    """Make an array, or the arrays of a tuple, read-only."""
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif isinstance(value, tuple):
        for item in value:
            _freeze(item)
