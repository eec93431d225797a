"""Input of the writers: points, one kind of cell, and arrays by element."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import OutputError
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.vectors import row_matrix

SURFACE_FORMATS = (".glb", ".off", ".stl")  # that cannot hold curves
SINGLE_PRECISION_FORMATS = (".glb", ".stl")
NUMBERINGS = {"edges", "triangles", "input_vertex"}  # arrays that only number those with values
MAX_SHARE_OF_ROUNDING = 1e-4  # of the extent, that 32-bit coordinates may be off
# control characters but those of white space, half characters and noncharacters: XML takes none of them
NOT_IN_NAMES = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")

log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False)
class CellData:
    """Content of one output file.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
    kind : {'faces', 'tetrahedra', 'lines'}
        Name of the cells in `.npz`.
    cells : (m, 3), (m, 4) or (m, 2) ndarray of int64
    vertex, cell, edge, whole : dict of str to ndarray
    metadata : dict
        Provenance.
    """

    points: NDArray
    kind: str
    cells: NDArray
    vertex: dict[str, NDArray]
    cell: dict[str, NDArray]
    edge: dict[str, NDArray]
    whole: dict[str, NDArray]
    metadata: dict[str, Any]

    @property
    def provenance(self) -> str:
        """The metadata as one line of JSON."""
        return json.dumps(self.metadata, ensure_ascii=True, default=str)


def cell_data_of(annotated: AnnotatedMesh) -> CellData:
    """Cell data of an annotated mesh; the gluing of an IntrinsicMesh becomes arrays.

    Parameters
    ----------
    annotated : AnnotatedMesh

    Returns
    -------
    CellData
        Points of an intrinsic mesh without coordinates are zero.

    Raises
    ------
    ValueError
        An array whose length is not the number of its elements.
    """
    mesh = annotated.mesh
    vertex, cell, edge = dict(annotated.vertex), dict(annotated.face), dict(annotated.edge)
    if isinstance(mesh, TetMesh):
        kind, cells = "tetrahedra", mesh.tetrahedra
    elif isinstance(mesh, CurveSet):
        kind, cells = "lines", mesh.lines
        vertex = {**mesh.point_arrays, **vertex}
    else:
        kind, cells = "faces", mesh.faces
    points = mesh.points if mesh.points is not None else np.zeros((mesh.n_vertices, 3))
    if isinstance(mesh, IntrinsicMesh):
        cell = {
            "face_edge_lengths": mesh.side_length,
            "neighbors": neighbors(mesh.topology.side_twin),
            **({} if mesh.topology.twisted is None else {"twisted": mesh.topology.twisted.astype(np.uint8)}),
            **cell,
        }
    if edge and "edges" not in edge:
        edge = {"edges": mesh.topology.edges, **edge}  # type: ignore[union-attr]
    vertex, cell = _with_columns(vertex), _with_columns(cell)
    vertex, cell, edge, whole = map(_with_plain_names, (vertex, cell, edge, annotated.whole))
    data = CellData(points, kind, cells, vertex, cell, edge, whole, annotated.metadata)
    _check(data)
    return data


def _with_columns(arrays: dict[str, NDArray]) -> dict[str, NDArray]:
    """The arrays but for those without a name or a column, which formats cannot hold, with a warning."""
    missing = [n for n, values in arrays.items() if not n.strip() or (len(values) and not np.size(values))]
    if missing:
        log.warning(f"arrays without a name or a column are not written: {', '.join(map(repr, missing))}")
    return {name: values for name, values in arrays.items() if name not in missing}


def _with_plain_names(arrays: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """The arrays, with `_` for the characters of their names that end or damage files, with a warning."""
    plain = {name: NOT_IN_NAMES.sub("_", name) for name in arrays}
    used_names = {name for name in arrays if plain[name] == name}
    out = {}
    for name, values in arrays.items():
        other = name if name in used_names else free_name(name, used_names, "a file", plain[name])
        out[other] = values
    return out


def neighbors(side_twin: NDArray) -> NDArray[np.int64]:
    """(m, 3, 2) face and side glued to side j, -1 on the boundary."""
    twin = np.asarray(side_twin)[..., None]
    return np.where(twin < 0, -1, np.concatenate([twin // 3, twin % 3], axis=-1))


def _check(data: CellData) -> None:
    """Raise ValueError for an array of wrong length, before it becomes a damaged file."""
    places = ((data.vertex, len(data.points)), (data.cell, len(data.cells)))
    for arrays, length in (*places, (data.edge, len(data.edge.get("edges", ())))):
        for name, value in arrays.items():
            if len(value) != length:
                raise ValueError(f"array {name} has {len(value)} entries where the mesh has {length}")


def free_name(name: str, used_names: set[str], suffix: str, admissible: str | None = None) -> str:
    """Name of an array in the file: `name`, else with a warning `name_2`, `name_3` and so on.

    Parameters
    ----------
    name : str
    used_names : set of str
        Gains the result.
    suffix : str
        Extension of the file, for the warning.
    admissible : str, optional
        The name without the characters that the format does not take; a warning where it differs.

    Returns
    -------
    str
    """
    admissible = name if admissible is None else admissible
    free, number = admissible, 1
    while free in used_names:
        number += 1
        free = f"{admissible}_{number}"
    if free != admissible:
        log.warning(f"{suffix} has another meaning or array for the name {admissible!r}: written as {free!r}")
    elif free != name:
        log.warning(f"{suffix} does not take the name {name!r}: written as {free!r}")
    used_names.add(free)
    return free


def two_dimensional(value: NDArray) -> NDArray:
    """Contiguous numeric array of one or two dimensions.

    Parameters
    ----------
    value : (n, ...) ndarray

    Returns
    -------
    (n,) or (n, k) ndarray
        Further dimensions become columns; booleans become uint8, half precision single
        precision, and more than double precision double precision.
    """
    value = np.asarray(value)
    if value.dtype == bool:
        value = value.astype(np.uint8)
    if value.dtype.kind == "f" and value.dtype.itemsize not in (4, 8):
        value = value.astype(np.float32 if value.dtype.itemsize < 4 else np.float64)
    return np.ascontiguousarray(row_matrix(value) if value.ndim != 1 else value)


def columns_of(name: str, value: NDArray) -> list[tuple[str, NDArray]]:
    """Columns of an array with their names, for formats whose arrays are numbers.

    Parameters
    ----------
    name : str
    value : (n,) or (n, k) ndarray

    Returns
    -------
    list of (str, (n,) ndarray)
        One column keeps the name `a` of the array; others are `a_x`, `a_y`, `a_z` or `a_0`, `a_1` and so on.
    """
    columns = row_matrix(value).T
    if len(columns) == 1:
        return [(name, columns[0])]
    ends = "xyz" if len(columns) == 3 else map(str, range(len(columns)))
    return [(f"{name}_{end}", column) for end, column in zip(ends, columns)]


def short_integers(value: NDArray, name: str, suffix: str) -> NDArray:
    """The array without 8-byte integers, for formats that have none.

    Parameters
    ----------
    value : ndarray
    name : str
        Of the array, for the warning.
    suffix : str
        Extension of the file, for the warning.

    Returns
    -------
    ndarray
        8-byte integers become int32 where all fit, else float64, with a warning where that changes a value;
        other arrays are returned as they are.
    """
    if value.dtype.kind not in "iu" or value.dtype.itemsize < 8:
        return value
    size = np.abs(value).astype(np.uint64)
    if size.max(initial=0) < 2**31:
        return value.astype(np.int32)
    lowest_bit = size & (~size + np.uint64(1))
    if (size // np.maximum(lowest_bit, 1) >= 2**53).any():
        log.warning(
            f"{suffix} rounds the integers of {name!r} beyond 2^53; "
            "write .vtu, .vtp, .xdmf, .vtkhdf or .npz to keep them"
        )
    return value.astype(np.float64)


def warn_of_lost_arrays(
    data: CellData, suffix: str, *, writable_names: tuple[str, ...] = (), what: str = "arrays"
) -> None:
    """Warn about arrays on vertices and cells that a format cannot hold.

    Parameters
    ----------
    data : CellData
    suffix : str
        Extension of the format.
    writable_names : tuple of str
        Arrays that it can hold.
    what : str
        Name of the arrays in the warning.
    """
    missing = [name for name in (*data.vertex, *data.cell) if name not in writable_names]
    if missing:
        names = _first_names(missing)
        log.warning(f"{suffix} cannot hold {what} ({names}); write .vtu, .ply or .npz to keep them")


def warn_of_lost_edge_arrays(data: CellData, suffix: str) -> None:
    """Warn about arrays on edges, on faces of tetrahedra and of the whole mesh, which few formats hold.

    Parameters
    ----------
    data : CellData
    suffix : str
        Extension of a format without them.
    """
    whole = "on faces of tetrahedra" if data.kind == "tetrahedra" else "of the whole mesh"
    names = {"on edges": [*data.edge], whole: [*data.whole]}
    missing = {place: [n for n in arrays if n not in NUMBERINGS] for place, arrays in names.items()}
    places = " and ".join(place for place, arrays in missing.items() if arrays)
    if places:
        shown = _first_names([name for arrays in missing.values() for name in arrays])
        log.warning(f"{suffix} holds no arrays {places} ({shown}); write .npz or .vtkhdf to keep them")


def _first_names(names: list[str]) -> str:
    return ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")


def require_surface(kind: str, suffix: str) -> None:
    """Raise an error for curves in a format of surfaces.

    Parameters
    ----------
    kind : {'faces', 'tetrahedra', 'lines'}
    suffix : str
        Extension of the format.

    Raises
    ------
    OutputError
        `kind` is 'lines' and the format is one of `SURFACE_FORMATS`.
    """
    if kind == "lines" and suffix in SURFACE_FORMATS:
        raise OutputError(f"{suffix} cannot hold curves; write .vtp, .vtu, .ply, .obj or .npz")


def require_single_precision(points: NDArray, suffix: str) -> None:
    """Raise an error for coordinates that are infinite in a format with 32-bit numbers.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
    suffix : str
        Extension of the format.

    Raises
    ------
    OutputError
        A coordinate exceeds float32, and the format is one of `SINGLE_PRECISION_FORMATS`.
    """
    if suffix not in SINGLE_PRECISION_FORMATS or points.size == 0:
        return
    largest = max(float(points.max()), -float(points.min()))
    if largest > float(np.finfo(np.float32).max):
        raise OutputError(
            f"{suffix} holds 32-bit coordinates, and the largest is {largest:.3g}; write .vtu, .ply or .npz"
        )


def _warn_of_rounding(points: NDArray, suffix: str) -> None:
    """Warn where 32-bit coordinates, far from the origin, hold a shape coarsely."""
    if suffix not in SINGLE_PRECISION_FORMATS or points.size == 0:
        return
    rounding = 2.0**-24 * float(np.abs(points).max())
    if rounding > MAX_SHARE_OF_ROUNDING * float(np.ptp(points, axis=0).max()):
        log.warning(
            f"{suffix} holds 32-bit coordinates, here up to {rounding:.2g} off; write .vtu, .ply or .npz"
        )


def surface_only(data: CellData, suffix: str) -> CellData:
    """Cell data of triangles, for formats of surfaces.

    Parameters
    ----------
    data : CellData
    suffix : str
        Extension of the format.

    Returns
    -------
    CellData
        The same for triangles. Of tetrahedra, with a warning, the boundary and the arrays of its vertices.

    Raises
    ------
    OutputError
        Curves in one of `SURFACE_FORMATS`, or coordinates too large for one of `SINGLE_PRECISION_FORMATS`.
    """
    require_surface(data.kind, suffix)
    require_single_precision(data.points, suffix)
    _warn_of_rounding(data.points, suffix)
    if data.kind == "faces":
        return data
    boundary = TetMesh.from_arrays(data.points, data.cells).boundary
    log.warning(
        f"{suffix} holds surfaces: the boundary of the tetrahedra is written; write .vtu to keep them"
    )
    is_outer = boundary.topology.referenced_vertex
    number, outer = np.cumsum(is_outer) - 1, {name: values[is_outer] for name, values in data.vertex.items()}
    faces = number[boundary.faces]
    return CellData(data.points[is_outer], "faces", faces, outer, {}, {}, data.whole, data.metadata)
