"""Arrays that a call names: carried by the input mesh, or in a file of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, ParameterError, excerpt
from ddgcli.io.readers.numpy_file import npy_array, npz_arrays, text_array

PLACES = ("vertex", "face", "edge")


def given_array(source: Any, name: str) -> tuple[NDArray, str]:
    """Array of the input by its name, or of a file by its path.

    Parameters
    ----------
    source : MeshInput
    name : str
        An array that the input carries, or a file (`.npy`, `.npz` with one array, `.csv`, `.txt`).

    Returns
    -------
    array : ndarray
    place : {'vertex', 'face', 'edge', ''}
        Where the input carries it; empty for a file, whose length must tell.
    """
    for place in PLACES:
        if name in getattr(source, place):
            return np.asarray(getattr(source, place)[name]), place
    if Path(name).suffix.lower() in READERS:
        return read_array(name), ""
    known = [f"{array} ({place})" for place in PLACES for array in getattr(source, place)]
    raise ParameterError(
        f"no array {name!r} in the input (it carries: {', '.join(known) or 'none'}), and no such file; "
        f"name one of these, or a {', '.join(READERS)} file"
    )


def read_array(path: str) -> NDArray:
    """Numbers of a `.npy`, one-array `.npz`, `.csv` or `.txt` file; MeshFileError in one line."""
    if not Path(path).is_file():
        raise MeshFileError(f"{path}: no such file; check the path")
    reader = READERS.get(Path(path).suffix.lower())
    if reader is None:
        raise MeshFileError(f"{path}: arrays are read from {', '.join(READERS)} files")
    try:
        array = np.asarray(reader(Path(path).read_bytes()))
    except MeshFileError as error:
        raise MeshFileError(f"{path}: {error}") from None
    except (OSError, MemoryError) as error:
        raise MeshFileError(f"{path}: no array can be read ({error}); write it with numpy.save") from error
    if array.dtype.kind not in "fiub":
        raise MeshFileError(
            f"{path}: holds {excerpt(array.dtype, 40)}, not real numbers; write them with numpy.save"
        )
    return array


def _read_npz(data: bytes) -> NDArray:
    found, _ = npz_arrays(data)
    if len(found) != 1:
        raise MeshFileError(f"holds {len(found)} arrays ({excerpt(', '.join(found))}); store one")
    return next(iter(found.values()))


READERS: dict[str, Any] = {
    ".npy": npy_array,
    ".npz": _read_npz,
    ".csv": lambda data: text_array(data, ","),
    ".txt": lambda data: text_array(data, None),
}


def aligned_edge_values(edges: NDArray, file_edges: NDArray, values: NDArray) -> NDArray[np.float64]:
    """Edge values of a file in the order and orientation of `edges`.

    Parameters
    ----------
    edges : (e, 2) ndarray of int64
        Edges of the mesh, lower number first.
    file_edges : (e, 2) ndarray of int
        Edges of the file, in any order and orientation; a reversed edge changes the sign.
    values : (e,) ndarray
    """
    n = np.int64(max(edges.max(initial=0), file_edges.max(initial=0)) + 1)
    key = edges[:, 0] * n + edges[:, 1]
    low, high = file_edges.min(axis=1), file_edges.max(axis=1)
    order = np.argsort(key)
    place = np.searchsorted(key[order], low * n + high).clip(max=max(len(key) - 1, 0))
    found = order[place]
    if len(file_edges) != len(edges) or (key[found] != low * n + high).any():
        raise ParameterError("the array `edges` of the input does not list the edges of its faces; drop it")
    result = np.zeros(len(edges))
    result[found] = np.where(file_edges[:, 0] <= file_edges[:, 1], values, -np.asarray(values))
    return result


def given_field(source: Any, name: str | None, path: str | None) -> tuple[NDArray, str] | None:
    """The field that `--field` or `--field-file` names, edge values in the mesh's order; None for neither."""
    if name is not None and path is not None:
        raise ParameterError("--field and --field-file name two fields; give one")
    if name is None and path is None:
        return None
    if path is not None:
        return read_array(path), ""
    array, place = given_array(source, str(name))
    if place == "edge" and "edges" in source.edge:
        array = aligned_edge_values(source.mesh.topology.edges, source.edge["edges"], array)
    return array, place
