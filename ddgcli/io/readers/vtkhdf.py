"""VTKHDF (.vtkhdf): surfaces, tetrahedra and curves, and the last step of a trajectory."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, excerpt
from ddgcli.io.readers.cells import add_vtk_cells
from ddgcli.io.readers.guarded import guarded
from ddgcli.io.readers.hdf5_links import refuse_outside
from ddgcli.io.readers.raw_mesh import RawMesh

TOPOLOGIES = (("Vertices", 1), ("Lines", 4), ("Polygons", 7), ("Strips", 6))


def read_vtkhdf(data: bytes) -> RawMesh:
    """Read one step (the last) of a VTKHDF file of one part per step."""
    return guarded("readers.vtkhdf", "content_of_vtkhdf", data, size=len(data), needs=("h5py",))


def content_of_vtkhdf(data: bytes) -> RawMesh:
    """The same in this process, without a bound on time and memory."""
    import h5py

    if not data.startswith(b"\x89HDF"):
        raise MeshFileError("not an HDF5 file: it does not begin like one; check the file")
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            refuse_outside(file)
            root = file.get("VTKHDF")
            if not isinstance(root, h5py.Group):
                raise MeshFileError("an HDF5 file without the group VTKHDF; check the file")
            return _read(root)
    except (MeshFileError, MemoryError):
        raise
    except Exception as error:  # h5py raises whatever the damaged place leads to
        raise MeshFileError(
            f"the VTKHDF file cannot be read ({excerpt(error)}); it is truncated or damaged"
        ) from None


def _read(root) -> RawMesh:
    kind = root.attrs["Type"]
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if kind not in ("PolyData", "UnstructuredGrid"):
        raise MeshFileError(
            f"VTKHDF of type {excerpt(kind, 40)}; only PolyData and UnstructuredGrid are meshes"
        )
    steps: Any = root.get("Steps")
    last = int(steps.attrs["NSteps"]) - 1 if steps is not None else -1
    part_number = int(steps["PartOffsets"][last]) if last >= 0 else 0
    n_points = int(_numbers(root, "NumberOfPoints", "iu")[part_number])
    if n_points < 0 or len(root["Points"]) < n_points:
        raise MeshFileError(
            f"the file announces {n_points} points and holds {len(root['Points'])}; it is damaged"
        )
    at = (
        int(steps["PointOffsets"][last])
        if last >= 0
        else int(_numbers(root, "NumberOfPoints", "iu")[:part_number].sum())
    )
    raw = RawMesh(np.asarray(_numbers(root, "Points", "fiu")[at : at + n_points], dtype=np.float64))
    raw.vertex = _arrays(root, "PointData", steps, last, at, n_points)
    if kind == "PolyData":
        types, connectivity, sizes = _polydata_cells(root, part_number)
    else:
        types, connectivity, sizes = _cells(root, part_number)
        types = _numbers(root, "Types", "iu")[: len(sizes)].astype(np.int64)
    cells = _arrays(root, "CellData", steps, last, 0, len(types))
    add_vtk_cells(raw, types, connectivity, sizes, cells)
    fields = {} if steps is not None else _datasets(root, "FieldData")
    whole = {name: np.atleast_1d(dataset[()]) for name, dataset in fields.items()}
    n_edges = len(whole["edges"]) if "edges" in whole else -1
    raw.edge = {name: value for name, value in whole.items() if len(value) == n_edges}
    raw.whole = {name: value for name, value in whole.items() if name not in raw.edge}
    return raw


def _numbers(group, name: str, kinds: str) -> Any:
    """The array of a name, whose type must be one of `kinds`: fractions are not indices."""
    dataset = group[name]
    if dataset.dtype.kind not in kinds:
        raise MeshFileError(
            f"'{name}' holds {excerpt(dataset.dtype, 40)}, not "
            f"{'numbers' if 'f' in kinds else 'whole numbers'}; the file is damaged"
        )
    return dataset


def _datasets(root, name: str) -> dict[str, Any]:
    """The arrays of a group by name; none where the group is missing."""
    group = root.get(name)
    if group is None:
        return {}
    if not hasattr(group, "items"):
        raise MeshFileError(f"'{name}' of the VTKHDF file is not a group; it is damaged")
    return {key: value for key, value in group.items() if hasattr(value, "shape")}


def _cells(group, part_number: int) -> tuple[NDArray, NDArray, NDArray]:
    counts, ids = (_numbers(group, name, "iu")[:] for name in ("NumberOfCells", "NumberOfConnectivityIds"))
    first_offset = int((counts[:part_number] + 1).sum())
    end_offset = first_offset + int(counts[part_number]) + 1
    offsets = _numbers(group, "Offsets", "iu")[first_offset:end_offset].astype(np.int64)
    start = int(ids[:part_number].sum())
    end = start + int(ids[part_number])
    connectivity = _numbers(group, "Connectivity", "iu")[start:end].astype(np.int64)
    return np.zeros(0, dtype=np.int64), connectivity, np.diff(offsets)


def _polydata_cells(root, part_number: int) -> tuple[NDArray, NDArray, NDArray]:
    types, connectivity, sizes = [], [], []
    for name, code in TOPOLOGIES:
        _, ids, size = _cells(root[name], part_number)
        types.append(np.full(len(size), code, dtype=np.int64))
        connectivity.append(ids)
        sizes.append(size)
    return np.concatenate(types), np.concatenate(connectivity), np.concatenate(sizes)


def _arrays(root, group: str, steps, last: int, at: int, length: int) -> dict[str, NDArray]:
    arrays = {}
    for name, dataset in _datasets(root, group).items():
        start = at
        if last >= 0 and f"{group}Offsets" in steps and name in steps[f"{group}Offsets"]:
            start = int(steps[f"{group}Offsets"][name][last])
        value = dataset[start : start + length]
        if len(value) != length:
            raise MeshFileError(
                f"array {excerpt(name, 40)} has {len(value)} entries, not {length}; the file is damaged"
            )
        arrays[name] = value
    return arrays
