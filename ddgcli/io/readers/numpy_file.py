"""NumPy's own files, .npy and .npz: arrays without pickled objects, within the bounds of `inflate`."""

from __future__ import annotations

import io
import warnings

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, excerpt
from ddgcli.io.readers.inflate import check_zip


def npz_arrays(data: bytes) -> tuple[dict[str, NDArray], list[str]]:
    """Arrays of a .npz by name, and the names of members that are none.

    Raises
    ------
    MeshFileError
        A damaged archive, pickled objects, or members that unpack to too much.
    """
    if not data.startswith(b"PK"):
        raise MeshFileError("not a NumPy archive: it is cut or of another format")
    check_zip(data)
    found: dict[str, NDArray] = {}
    others: list[str] = []
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            for name in archive.files:
                value = archive[name]
                if isinstance(value, np.ndarray):
                    found[name] = value
                else:
                    others.append(name)
    except Exception as error:  # zipfile, zlib, struct, tokenize and numpy each raise their own
        raise MeshFileError(f"the NumPy archive cannot be read ({excerpt(error)}); it is damaged") from None
    return found, others


def npy_array(data: bytes) -> NDArray:
    """The array of a .npy file; MeshFileError where it is damaged or holds objects."""
    if not data.startswith(b"\x93NUMPY"):
        raise MeshFileError("not a .npy file: it is cut or of another format")
    try:
        return np.asarray(np.load(io.BytesIO(data), allow_pickle=False))
    except Exception as error:  # tokenize, ast and numpy each raise their own
        raise MeshFileError(f"the .npy file cannot be read ({excerpt(error)}); it is damaged") from None


def text_array(data: bytes, separator: str | None) -> NDArray:
    """Rows of numbers; `separator` None is white space."""
    text = data.decode("utf-8-sig", "replace")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a file without rows, which the caller refuses by its length
        try:
            return np.loadtxt(io.StringIO(text), delimiter=separator)
        except (ValueError, OverflowError) as error:
            raise MeshFileError(f"no table of numbers ({excerpt(error)}); mend that row") from None
