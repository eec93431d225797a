"""Arrays of callers: masks, which numpy drops on conversion, and arrays of objects."""

from __future__ import annotations

import contextlib
import numbers

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.errors import MeshError


def unmasked(values: ArrayLike, what: str) -> NDArray:
    """Array of values; a masked entry is an error, since conversion would expose the value under the mask.

    Objects that are real numbers become integers or floats.

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
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise MeshError(f"{what} has rows of different lengths; give rows of the same length") from error
    return real_objects(array, what) if array.dtype.kind == "O" else array


def indices(values: ArrayLike, what: str) -> NDArray:
    """Array of vertex indices, as `unmasked` returns it; floats that are whole numbers become integers.

    Parameters
    ----------
    values : array_like
    what : str
        Subject of the message.

    Returns
    -------
    ndarray
        Other floats stay as they are.

    Raises
    ------
    MeshError
    """
    array = unmasked(values, what)
    # vertex indices are far below 2^53, up to which floats represent every integer
    if array.dtype.kind == "f" and ((np.rint(array) == array) & (np.abs(array) < 2.0**53)).all():
        return array.astype(np.int64)
    return array


def real_objects(array: NDArray, what: str) -> NDArray:
    """Array of objects, such as fractions, as whole or real numbers; an error for other objects.

    Parameters
    ----------
    array : ndarray of objects
    what : str
        Subject of the message.

    Returns
    -------
    ndarray of int64 or float64

    Raises
    ------
    MeshError
    """
    for kind, dtype in ((numbers.Integral, np.int64), (numbers.Real, np.float64)):
        if all(isinstance(number, kind) for number in array.flat):
            with contextlib.suppress(OverflowError):
                return array.astype(dtype)
    raise MeshError(f"{what} holds objects that are not real numbers")
