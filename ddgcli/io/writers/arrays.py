"""Bytes of .npz and .vtkhdf files: the formats that hold everything. Equal content gives equal bytes."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from ddgcli.errors import encodable
from ddgcli.io.writers.cell_data import CellData, free_name, two_dimensional


def npz_bytes(data: CellData) -> bytes:
    """NumPy archive: points, cells, every array by its name, and `metadata` as JSON text."""
    arrays: dict[str, Any] = {"points": data.points, data.kind: data.cells}
    if data.kind == "tetrahedra":
        arrays["faces"] = _boundary_faces(data)
    used_names = {"points", "faces", "tetrahedra", "lines", "metadata", "edges"}
    if "edges" in data.edge:
        arrays["edges"] = data.edge["edges"]
    for group in (data.vertex, data.cell, data.edge, data.whole):
        own = {name: value for name, value in group.items() if group is not data.edge or name != "edges"}
        arrays |= {free_name(name, used_names, ".npz"): value for name, value in own.items()}
    arrays["metadata"] = np.array(data.provenance)
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def _boundary_faces(data: CellData):
    from ddgcli.mesh.tet_mesh import TetMesh

    return TetMesh.from_arrays(data.points, data.cells).boundary.faces


def vtkhdf_bytes(data: CellData) -> bytes:
    """VTKHDF 2.2: PolyData of triangles or lines, UnstructuredGrid of tetrahedra.

    Edge arrays and what belongs to the whole are in FieldData; provenance in the attributes of the sibling
    group `ddgcli`.
    """
    import h5py

    out = io.BytesIO()
    with h5py.File(out, "w", libver=("earliest", "v110")) as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 2], dtype=np.int64)
        root.attrs["Type"] = np.bytes_(b"UnstructuredGrid" if data.kind == "tetrahedra" else b"PolyData")
        root["NumberOfPoints"] = np.array([len(data.points)], dtype=np.int64)
        root["Points"] = np.ascontiguousarray(data.points, dtype=np.float64)
        if data.kind == "tetrahedra":
            _connect(root, data.cells, 4)
            root["Types"] = np.full(len(data.cells), 10, dtype=np.uint8)
        else:
            for name, kind, width in (
                ("Vertices", "", 1),
                ("Lines", "lines", 2),
                ("Polygons", "faces", 3),
                ("Strips", "", 3),
            ):
                cells = data.cells if data.kind == kind else np.zeros((0, width), dtype=np.int64)
                _connect(root.create_group(name), cells, width)
        for name, arrays in (
            ("PointData", data.vertex),
            ("CellData", data.cell),
            ("FieldData", data.edge | data.whole),
        ):
            group = root.create_group(name)
            used_names: set[str] = set()
            for key, value in arrays.items():
                name = free_name(key, used_names, ".vtkhdf", key.replace("/", "_").replace(".", "_"))
                group[name] = two_dimensional(np.atleast_1d(value))
        own = file.create_group("ddgcli")
        own.attrs["schema"] = "ddgcli-mesh/1"
        own.attrs["metadata"] = encodable(data.provenance)
        for key, value in data.metadata.items():
            text = value if isinstance(value, str) else _json(value)
            own.attrs[key] = value if isinstance(value, (int, float)) else encodable(text)
    return out.getvalue()


def _connect(group: Any, cells: Any, width: int) -> None:
    group["NumberOfCells"] = np.array([len(cells)], dtype=np.int64)
    group["NumberOfConnectivityIds"] = np.array([cells.size], dtype=np.int64)
    group["Offsets"] = np.arange(len(cells) + 1, dtype=np.int64) * width
    group["Connectivity"] = np.ascontiguousarray(cells, dtype=np.int64).ravel()


def _json(value: Any) -> str:
    import json

    return json.dumps(value, default=str)
