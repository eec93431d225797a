"""VTKHDF (.vtkhdf): surfaces, tetrahedra and curves, and the last step of a trajectory."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError
from ddgcli.io.readers.cells import add_vtk_cells
from ddgcli.io.readers.raw_mesh import RawMesh

TOPOLOGIES = (("Vertices", 1), ("Lines", 4), ("Polygons", 7), ("Strips", 6))


def read_vtkhdf(data: bytes) -> RawMesh:
    """Read one step (the last) of a VTKHDF file of one part a step."""
    import h5py

    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            if "VTKHDF" not in file:
                raise MeshFileError("an HDF5 file without the group VTKHDF; check the file")
            return _read(file["VTKHDF"])
    except MeshFileError:
        raise
    except (OSError, KeyError, ValueError, TypeError, IndexError, RuntimeError) as error:
        raise MeshFileError(f"the VTKHDF file cannot be read ({error}); it is cut or damaged") from None


def _read(root) -> RawMesh:
    kind = root.attrs["Type"]
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if kind not in ("PolyData", "UnstructuredGrid"):
        raise MeshFileError(f"VTKHDF of type {kind}; only PolyData and UnstructuredGrid are meshes")
    steps: Any = root.get("Steps")
    last = int(steps.attrs["NSteps"]) - 1 if steps is not None else -1
    part = int(steps["PartOffsets"][last]) if last >= 0 else 0
    n_points = int(root["NumberOfPoints"][part])
    at = int(steps["PointOffsets"][last]) if last >= 0 else int(root["NumberOfPoints"][:part].sum())
    raw = RawMesh(np.asarray(root["Points"][at : at + n_points], dtype=np.float64))
    raw.vertex = _arrays(root, "PointData", steps, last, at, n_points)
    if kind == "PolyData":
        types, connectivity, sizes = _polydata_cells(root, part)
    else:
        types, connectivity, sizes = _cells(root, root, part)
        types = root["Types"][: len(sizes)].astype(np.int64)
    cells = _arrays(root, "CellData", steps, last, 0, len(types))
    add_vtk_cells(raw, types, connectivity, sizes, cells)
    whole = (
        {name: dataset[()] for name, dataset in root.get("FieldData", {}).items()} if steps is None else {}
    )
    n_edges = len(whole["edges"]) if "edges" in whole else -1
    raw.edge = {name: value for name, value in whole.items() if len(value) == n_edges}
    raw.whole = {name: value for name, value in whole.items() if name not in raw.edge}
    return raw


def _cells(root, group, part: int) -> tuple[NDArray, NDArray, NDArray]:
    counts, ids = group["NumberOfCells"][:], group["NumberOfConnectivityIds"][:]
    first_offset = int((counts[:part] + 1).sum())
    offsets = group["Offsets"][first_offset : first_offset + int(counts[part]) + 1].astype(np.int64)
    start = int(ids[:part].sum())
    connectivity = group["Connectivity"][start : start + int(ids[part])].astype(np.int64)
    return np.zeros(0, dtype=np.int64), connectivity, np.diff(offsets)


def _polydata_cells(root, part: int) -> tuple[NDArray, NDArray, NDArray]:
    types, connectivity, sizes = [], [], []
    for name, code in TOPOLOGIES:
        _, ids, size = _cells(root, root[name], part)
        types.append(np.full(len(size), code, dtype=np.int64))
        connectivity.append(ids)
        sizes.append(size)
    return np.concatenate(types), np.concatenate(connectivity), np.concatenate(sizes)


def _arrays(root, group: str, steps, last: int, at: int, length: int) -> dict[str, NDArray]:
    found = {}
    for name, dataset in root.get(group, {}).items():
        start = at
        if last >= 0 and f"{group}Offsets" in steps and name in steps[f"{group}Offsets"]:
            start = int(steps[f"{group}Offsets"][name][last])
        value = dataset[start : start + length]
        if len(value) != length:
            raise MeshFileError(f"array {name} has {len(value)} entries, not {length}; it is cut or damaged")
        found[name] = value
    return found
