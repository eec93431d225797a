"""Masked arrays, whose masks numpy drops on conversion."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.errors import MeshError


def unmasked(values: ArrayLike, what: str) -> NDArray:
    """Array of values; a masked entry is an error, since the array would have the value behind the mask.

    Parameters
    ----------
    values : array_like
    what : str
        Subject of the message.

    Returns
    -------
    ndarray

    Raises
    ------
    MeshError
    """
    if np.ma.is_masked(values):
        raise MeshError(f"{what} has masked entries; give them values first, as numpy.ma.filled does")
    return np.asarray(values)
