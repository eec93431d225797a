"""Arrays by name: of the input mesh, or of a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, ParameterError, excerpt
from ddgcli.io.readers.numpy_file import npy_array, npz_arrays, text_array
from ddgcli.mesh.edge_lookup import edge_indices
from ddgcli.mesh.tet_mesh import parity

ELEMENTS = ("vertex", "face", "edge")


def input_array(source: Any, name: str, *, parameter: str | None = None) -> tuple[NDArray, str]:
    """Array of the input by its name, or of a file by its path.

    Parameters
    ----------
    source : MeshInput
    name : str
        An array of the input, or a file (`.npy`, `.npz` with one array, `.csv`, `.txt`).
    parameter : str, optional
        The parameter that names it, for errors.

    Returns
    -------
    array : ndarray
    place : {'vertex', 'face', 'edge', ''}
        Elements of the array; empty where its length decides: for a file, and an array of the input without
        elements, such as values on edges where it has no array `edges`.
    """
    for place in ELEMENTS:
        if name in getattr(source, place):
            return np.asarray(getattr(source, place)[name]), place
    if name in source.whole:
        return np.asarray(source.whole[name]), ""
    if Path(name).suffix.lower() in READERS:
        return read_array(name), ""
    names = [f"{array} ({place})" for place in ELEMENTS for array in getattr(source, place)]
    names += [f"{array} (whole mesh)" for array in source.whole]
    raise ParameterError(
        f"no array {name!r} in the input (its arrays: {', '.join(names) or 'none'}), and no such file; "
        f"name one of these, or a {', '.join(READERS)} file",
        parameter=parameter,
    )


def read_array(path: str) -> NDArray:
    """Numbers of a `.npy`, `.npz`, `.csv` or `.txt` file.

    Parameters
    ----------
    path : str
        A `.npz` holds one array.

    Returns
    -------
    ndarray of real numbers
        Of `.csv` and `.txt`, (n,) or (n, k) float64.

    Raises
    ------
    MeshFileError
        One line that begins with the path: no such file, another format, a damaged file, or no real numbers.
    """
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
    arrays, _ = npz_arrays(data)
    if len(arrays) != 1:
        raise MeshFileError(f"holds {len(arrays)} arrays ({excerpt(', '.join(arrays))}); store one")
    return next(iter(arrays.values()))


READERS: dict[str, Any] = {
    ".npy": npy_array,
    ".npz": _read_npz,
    ".csv": lambda data: text_array(data, ","),
    ".txt": lambda data: text_array(data, None),
}


def input_form(source: Any, name: str) -> NDArray:
    """Array of the input in the numbering and orientation of the mesh, or array of a file by its path.

    Values on the faces of tetrahedra belong to the array `triangles` of the input, (f, 3) vertex indices,
    each in the order of its orientation. The array of a file is in the numbering of `mesh.triangles`.

    Parameters
    ----------
    source : MeshInput
    name : str
        An array of the input, or a file as for `input_array`.

    Returns
    -------
    ndarray
        Values of edges and triangles in the order of the mesh, with its signs.

    Raises
    ------
    ParameterError
        No such array, or `edges` or `triangles` of the input do not list those of the mesh.
    MeshFileError
        A file that cannot be read.
    """
    if name in source.whole and "triangles" in source.whole and source.kind == "tetrahedra":
        values, triangles = (np.asarray(source.whole[key]) for key in (name, "triangles"))
        if len(values) == len(triangles):
            return aligned_triangle_values(source.mesh.triangles, triangles, values)
    return _aligned_array(source, name)[0]


def aligned_triangle_values(
    triangles: NDArray, file_triangles: NDArray, values: NDArray
) -> NDArray[np.float64]:
    """Values on the faces of tetrahedra in the order and orientation of `triangles`; see aligned_edge_values.

    Parameters
    ----------
    triangles : (f, 3) ndarray of int64
        Faces of the mesh, vertex indices ascending, in sorted order.
    file_triangles : (f, 3) ndarray of int
        In any order; an odd permutation of the ascending order changes the sign.
    values : (f,) ndarray
    """
    corners = np.asarray(file_triangles)
    order = np.lexsort(np.sort(corners, axis=1).T[::-1])
    if corners.shape != triangles.shape or (np.sort(corners, axis=1)[order] != triangles).any():
        raise ParameterError(
            "the array `triangles` of the input does not list the faces of its tetrahedra; leave it out"
        )
    return parity(corners[order]) * np.asarray(values)[order]


def aligned_edge_values(edges: NDArray, file_edges: NDArray, values: NDArray) -> NDArray[np.float64]:
    """Edge values of a file in the order and orientation of `edges`.

    Parameters
    ----------
    edges : (e, 2) ndarray of int64
        Edges of the mesh, lower number first.
    file_edges : (e, 2) ndarray of int
        Edges of the file, in any order and orientation; a reversed edge changes the sign.
    values : (e,) ndarray

    Returns
    -------
    (e,) ndarray of float64

    Raises
    ------
    ParameterError
        The edges of the file are not those of the mesh.
    """
    edge = edge_indices(edges, file_edges)
    if len(file_edges) != len(edges) or not np.array_equal(np.sort(edge), np.arange(len(edges))):
        raise ParameterError(
            "the array `edges` of the input does not list the edges of its faces; leave it out"
        )
    result = np.zeros(len(edges))
    result[edge] = np.where(file_edges[:, 0] <= file_edges[:, 1], values, -np.asarray(values))
    return result


def input_field(source: Any, name: str | None, path: str | None) -> tuple[NDArray, str] | None:
    """The field of an array of the input or of a file.

    Parameters
    ----------
    source : MeshInput
    name : str or None
        An array of the input; a file too, as for `input_array`.
    path : str or None
        A file.

    Returns
    -------
    (ndarray, str) or None
        The array, with edge values in the order and orientation of the mesh, and its elements as of
        `input_array`; None if `name` and `path` are None.

    Raises
    ------
    ParameterError
        Both a name and a path, no such array, or `edges` of the input do not list those of the mesh.
    MeshFileError
        A file that cannot be read.
    """
    if name is not None and path is not None:
        raise ParameterError("`field` and `field_file` exclude each other; give one")
    if name is None and path is None:
        return None
    if path is not None:
        return read_array(path), ""
    return _aligned_array(source, str(name))


def _aligned_array(source: Any, name: str) -> tuple[NDArray, str]:
    """`input_array`, with edge values in the order and orientation of the mesh's edges."""
    array, place = input_array(source, name, parameter="name")
    if place == "edge" and "edges" in source.edge:
        mesh_edges = source.mesh.edges if source.kind == "tetrahedra" else source.mesh.topology.edges
        array = aligned_edge_values(mesh_edges, source.edge["edges"], array)
    return array, place
