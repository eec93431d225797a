"""NumPy's own files, .npy and .npz: arrays without pickled objects, within the bounds of `inflate`."""

from __future__ import annotations

import io
import warnings

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, excerpt
from ddgcli.io.readers.inflate import check_zip


def npz_arrays(data: bytes) -> tuple[dict[str, NDArray], list[str]]:
    """Arrays of a .npz by name, and the names of members that are not arrays.

    Parameters
    ----------
    data : bytes
        Content of the file.

    Returns
    -------
    arrays : dict of str to ndarray
    others : list of str

    Raises
    ------
    MeshFileError
        A damaged archive, pickled objects, or members that unpack to too much.
    """
    if not data.startswith(b"PK"):
        raise MeshFileError("not a NumPy archive: it is truncated or of another format")
    check_zip(data)
    arrays: dict[str, NDArray] = {}
    others: list[str] = []
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            for name in archive.files:
                value = archive[name]
                if isinstance(value, np.ndarray):
                    arrays[name] = value
                else:
                    others.append(name)
    except Exception as error:  # zipfile, zlib, struct, tokenize and numpy each raise their own
        raise MeshFileError(f"the NumPy archive cannot be read ({excerpt(error)}); it is damaged") from None
    return arrays, others


def npy_array(data: bytes) -> NDArray:
    """Array of a .npy file.

    Parameters
    ----------
    data : bytes
        Content of the file.

    Returns
    -------
    ndarray

    Raises
    ------
    MeshFileError
        A damaged file, or pickled objects.
    """
    if not data.startswith(b"\x93NUMPY"):
        raise MeshFileError("not a .npy file: it is truncated or of another format")
    try:
        return np.asarray(np.load(io.BytesIO(data), allow_pickle=False))
    except Exception as error:  # tokenize, ast and numpy each raise their own
        raise MeshFileError(f"the .npy file cannot be read ({excerpt(error)}); it is damaged") from None


def text_array(data: bytes, separator: str | None) -> NDArray:
    """Table of numbers, one element a row; one number a row, or one row of more than three, is a list.

    Parameters
    ----------
    data : bytes
        Content of the file, in UTF-8.
    separator : str or None
        Between the numbers of a row; None is white space.

    Returns
    -------
    (n, k) or (n,) ndarray of float64

    Raises
    ------
    MeshFileError
        A row with something else than numbers, or of another length.
    """
    text = data.decode("utf-8-sig", "replace")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a file without rows, which the caller rejects by its length
        try:
            table = np.loadtxt(io.StringIO(text), delimiter=separator, ndmin=2)
        except (ValueError, OverflowError) as error:
            raise MeshFileError(f"no table of numbers ({excerpt(error)}); correct that row") from None
    rows, columns = table.shape
    is_vector = rows == 1 and 1 < columns <= 3  # a pair of vertices, or coordinates
    return table if is_vector or min(rows, columns) > 1 else table.ravel()
