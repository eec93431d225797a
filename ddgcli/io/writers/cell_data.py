"""What a writer is given: one kind of cell over points, with arrays sorted by the place they live in."""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import OutputError
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.tet_mesh import TetMesh

log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False)
class Sheet:
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


def sheet_of(annotated: AnnotatedMesh) -> Sheet:
    """Sort an annotated mesh into what writers need; the gluing of an IntrinsicMesh becomes arrays."""
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
            **cell,
        }
    if edge and "edges" not in edge:
        edge = {"edges": mesh.topology.edges, **edge}  # type: ignore[union-attr]
    sheet = Sheet(points, kind, cells, vertex, cell, edge, dict(annotated.whole), annotated.metadata)
    _check(sheet)
    return sheet


def neighbors(side_twin: NDArray) -> NDArray[np.int64]:
    """(m, 3, 2) face and side glued to side j, -1 on the boundary."""
    twin = np.asarray(side_twin)[..., None]
    return np.where(twin < 0, -1, np.concatenate([twin // 3, twin % 3], axis=-1))


def _check(sheet: Sheet) -> None:
    """An array of a wrong length is a bug of the caller, and must not become a damaged file."""
    places = ((sheet.vertex, len(sheet.points)), (sheet.cell, len(sheet.cells)))
    for arrays, length in (*places, (sheet.edge, len(sheet.edge.get("edges", ())))):
        for name, value in arrays.items():
            if len(value) != length:
                raise ValueError(f"array {name} has {len(value)} entries where the mesh has {length}")


def two_dimensional(value: NDArray) -> NDArray:
    """(n, k) contiguous numeric array; booleans as uint8, longer shapes flattened."""
    value = np.asarray(value)
    if value.dtype == bool:
        value = value.astype(np.uint8)
    if value.dtype == np.float16:
        value = value.astype(np.float32)
    return np.ascontiguousarray(value.reshape(len(value), -1) if value.ndim != 1 else value)


def short_integers(value: NDArray) -> NDArray:
    """The array without 8-byte integers, for formats that have none: int32 where it fits, else float64."""
    if value.dtype.kind not in "iu" or value.dtype.itemsize < 8:
        return value
    if value.size == 0 or np.abs(value).max() < 2**31:
        return value.astype(np.int32)
    return value.astype(np.float64)


def without_arrays(sheet: Sheet, suffix: str) -> None:
    """Warn of arrays that a format cannot hold."""
    lost = [*sheet.vertex, *sheet.cell]
    if lost:
        shown = ", ".join(lost[:4]) + (", ..." if len(lost) > 4 else "")
        log.warning(f"{suffix} cannot hold arrays ({shown}); write .vtu, .ply or .npz to keep them")


def surface_only(sheet: Sheet, suffix: str) -> Sheet:
    """A sheet of triangles for formats of surfaces: tetrahedra give their boundary, curves are refused."""
    if sheet.kind == "lines":
        raise OutputError(f"{suffix} cannot hold curves; write .vtp, .vtu, .ply, .obj or .npz")
    if sheet.kind == "faces":
        return sheet
    boundary = TetMesh.from_arrays(sheet.points, sheet.cells).boundary
    log.warning(
        f"{suffix} holds surfaces: the boundary of the tetrahedra is written; write .vtu to keep them"
    )
    return Sheet(sheet.points, "faces", boundary.faces, sheet.vertex, {}, {}, sheet.whole, sheet.metadata)
