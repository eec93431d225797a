"""Check of the structure of a trajectory file, in a guarded process."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.choices import PARTICLES
from ddgcli.errors import MeshFileError, excerpt
from ddgcli.io.readers.guarded import guarded

TOPOLOGIES = ("Vertices", "Lines", "Polygons", "Strips")
CHANGING_CELL = "face_arrays"  # attribute: names of the arrays on faces that every frame has of its own
PERIODS = "periods"  # attribute: lengths after which each object repeats, by name in the order of `object_id`
OBSTACLE_POSE = "obstacle_pose_"  # field data of a frame: that and the obstacle's name
MAX_METADATA_BYTES = 1 << 20  # bound of the check, which reads texts and shapes, no frames


def check_trajectory(path: str) -> None:
    """Raise an error for a file that is not a trajectory, is damaged, or refers to other files.

    Parameters
    ----------
    path : str

    Raises
    ------
    MeshFileError
        One line that begins with the path.
    """
    size = min(os.path.getsize(path), MAX_METADATA_BYTES)
    folder = str(Path(path).resolve().parent)
    try:
        guarded("trajectories.layout_check", "check_layout", path, size=size, needs=("h5py",), folder=folder)
    except MeshFileError as error:
        raise MeshFileError(
            f"{path}: not a ddgcli trajectory ({error}); give a .vtkhdf of a simulator"
        ) from None


def check_layout(path: str) -> None:
    """The same in this process, without a bound on time and memory."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            _check(file)
    except (MeshFileError, MemoryError):
        raise
    except Exception as error:  # h5py raises whatever the damaged place leads to
        raise MeshFileError(excerpt(error)) from None


def _check(file: Any) -> None:
    count = _frame_count(file)
    point_counts, cell_counts = _check_cells(file, count)
    _check_arrays(file, count, point_counts, cell_counts)
    for obstacle in file["ddgcli"].get("obstacles", {}).values():
        _check_obstacle(obstacle, file["VTKHDF/FieldData"], count)
    _check_texts(file["ddgcli"])
    _check_periods(file)


def _frame_count(file: Any) -> int:
    """Number of frames, each with a time and a step."""
    _, ours, steps = (_group(file, name) for name in ("VTKHDF", "ddgcli", "VTKHDF/Steps"))
    count = int(steps.attrs["NSteps"])
    if count < 1:
        raise MeshFileError(f"it holds {count} frames")
    for name in ("time", "step"):
        _rows(ours, name, count, "fi")
    return count


def _check_cells(file: Any, count: int) -> tuple[NDArray, NDArray]:
    """Check points and cells; the numbers of both in every frame."""
    root, steps = file["VTKHDF"], file["VTKHDF/Steps"]
    counts = np.array(part_counts(_rows(root, "NumberOfPoints", 1, "iu"), count))
    n = int(counts[0])
    offsets = _rows(steps, "PointOffsets", count, "iu")[:count]
    points = _rows(root, "Points", n, "f", (3,))
    if (counts < 0).any() or (offsets < 0).any() or (offsets > len(points) - counts).any():
        raise MeshFileError("a frame's points are outside the file's")
    solid = "Types" in root
    width = 4 if solid else 3
    corners = _rows(root, "Connectivity" if solid else "Polygons/Connectivity", 0, "iu")
    cells = root if solid else _group(root, "Polygons")
    sizes = np.array(part_counts(_rows(cells, "NumberOfConnectivityIds", 1, "iu"), count))
    n_corners = int(sizes[0])
    if len(corners) > n_corners:
        starts = _rows(steps, "ConnectivityIdOffsets", count, "iu", (len(TOPOLOGIES),))[:count]
        beyond = (starts > len(corners) - sizes[:, None]).any()
        if (sizes < 1).any() or (starts < 0).any() or beyond:
            raise MeshFileError("a frame's faces are outside the file's")
    if (sizes % width).any() or len(corners) < n_corners:
        raise MeshFileError(f"its cells are no {'tetrahedra' if solid else 'triangles'}")
    ends = np.zeros(0) if solid else _rows(root, "Lines/Connectivity", 0, "iu")
    if len(ends) % 2 or (len(ends) and len(corners)):
        raise MeshFileError("its lines are not segments, or it also has faces")
    return counts, np.full(count, len(ends) // 2) if len(ends) else sizes // width


def _check_arrays(file: Any, count: int, point_counts: NDArray, cell_counts: NDArray) -> None:
    """Arrays of points, cells and frames, and those on faces that every frame has of its own."""
    root, ours, steps = file["VTKHDF"], file["ddgcli"], file["VTKHDF/Steps"]
    lengths = {"PointData": int(point_counts.sum()), "CellData": int(cell_counts[0]), "FieldData": count}
    changing = [str(name) for name in json.loads(ours.attrs.get(CHANGING_CELL, "[]"))]
    for name, length in lengths.items():
        for array in _group(root, name):
            rows = _rows(_group(root, name), array, length, "fiub", None)
            if name == "FieldData" and rows.ndim != 2:
                raise MeshFileError(f"'{excerpt(array, 40)}' is not a table of numbers of every frame")
            if name == "CellData" and array not in changing and len(rows) != length:
                raise MeshFileError(f"'{excerpt(array, 40)}' has {len(rows)} rows for {length} cells")
    for name in changing:
        starts = _rows(_group(steps, "CellDataOffsets"), name, count, "iu")[:count]
        rows = _rows(_group(root, "CellData"), name, int(cell_counts.sum()), "f", None)
        if (starts < 0).any() or (starts > len(rows) - cell_counts).any():
            raise MeshFileError("a frame's arrays on faces are outside the file's")


def _check_obstacle(obstacle: Any, poses: Any, count: int) -> None:
    """Faces, name and, where it moves, the poses of an obstacle."""
    points, faces = _rows(obstacle, "points", 0, "f", (3,)), _rows(obstacle, "faces", 0, "iu", (3,))
    if len(faces) and not 0 <= int(faces[...].min()) <= int(faces[...].max()) < len(points):
        raise MeshFileError("an obstacle names a point that it does not have")
    name = obstacle.attrs.get("name")
    if not isinstance(name, (str, bytes)):
        raise MeshFileError("an obstacle has no name")
    pose = OBSTACLE_POSE + (name.decode() if isinstance(name, bytes) else name)
    if pose in poses:
        _rows(poses, pose, count, "f", (12,))


def _check_periods(file: Any) -> None:
    """Three lengths of every object that a face or particles belong to, where the trajectory has periods."""
    text = file["ddgcli"].attrs.get(PERIODS)
    if text is None:
        return
    periods = {name: np.array(lengths, dtype=np.float64) for name, lengths in json.loads(text).items()}
    particles = {name for name in file["VTKHDF/FieldData"] if name.startswith(PARTICLES)}
    number = file["VTKHDF/CellData"].get("object_id")
    valid = all(p.shape == (3,) and np.isfinite(p).all() and (p >= 0).all() for p in periods.values())
    valid = valid and bool(periods) and particles <= {PARTICLES + name for name in periods}
    if number is not None and len(number):
        valid = valid and 0 <= int(number[...].min()) <= int(number[...].max()) < len(periods)
    if not valid or "Polygons" not in file["VTKHDF"]:
        raise MeshFileError("its periods are not those of its objects")


def _check_texts(ours: Any) -> None:
    """Attributes and texts that are no UTF-8 raise UnicodeDecodeError."""
    import h5py

    for value in ours.attrs.values():
        if isinstance(value, bytes):
            value.decode()
    if not isinstance(json.loads(ours.attrs.get("overrides", "{}")), dict):
        raise MeshFileError("its recorded options are not a table")
    for name, value in ours.items():
        if isinstance(value, h5py.Dataset) and value.dtype.kind == "O":
            text = value[()]
            if not isinstance(text, bytes):
                raise MeshFileError(f"'{excerpt(name, 40)}' is not a text")
            text.decode()


def part_counts(stored: Any, n_frames: int) -> list[int]:
    """Number of vertices or corners of every frame; a file whose number does not change has it once.

    Parameters
    ----------
    stored : (k,) array or dataset of int
    n_frames : int

    Returns
    -------
    list of int
        `n_frames` numbers.

    Raises
    ------
    MeshFileError
        There are several numbers, but not one for each frame.
    """
    if len(stored) == 1:
        return [int(stored[0])] * n_frames
    if len(stored) < n_frames:
        raise MeshFileError(f"it has {len(stored)} counts for {n_frames} frames")
    return [int(count) for count in stored[:n_frames]]


def _group(parent: Any, name: str) -> Any:
    item = parent.get(name)
    if item is None or not hasattr(item, "items"):
        raise MeshFileError(f"no group '{name}'")
    if not all(isinstance(member, str) for member in item):  # h5py gives names that are no UTF-8 as bytes
        raise MeshFileError(f"a name in the group '{name}' is not UTF-8")
    return item


def _rows(parent: Any, name: str, count: int, kinds: str, shape: tuple[int, ...] | None = ()) -> Any:
    """A dataset of numbers with at least `count` rows; `shape` that of a row (None: any)."""
    item = parent.get(name)
    if item is None or hasattr(item, "items") or item.ndim < 1:
        raise MeshFileError(f"no array '{excerpt(name, 40)}'")
    right = item.dtype.kind in kinds and (shape is None or item.shape[1:] == shape)
    if not right or len(item) < count:
        raise MeshFileError(
            f"array '{excerpt(name, 40)}' is {item.shape} {excerpt(item.dtype, 20)}, with fewer or other "
            "rows than its frames need"
        )
    return item
