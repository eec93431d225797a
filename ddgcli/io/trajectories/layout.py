"""The layout of a trajectory: one HDF5 file in the VTKHDF form (2.2, transient), and what is ours.

Surfaces are PolyData, tetrahedra an UnstructuredGrid.

Every growing dataset has rows for one frame, or for its vertices; everything else is written once.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import encodable
from ddgcli.io.trajectories.layout_check import CHANGING_CELL, TOPOLOGIES
from ddgcli.io.trajectories.row_file import RowLayout
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import TrajectoryFrame
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

SCHEMA = "ddgcli-trajectory/1"
VTK_TETRA = 10  # cell type of VTK
LOG_DTYPE = np.dtype(
    [("step", "i8"), ("time", "f8"), ("kind", "S24"), ("place", "S32"), ("value", "f8"), ("detail", "S160")]
)
EFFECT_DTYPE = np.dtype([("name", "S48"), ("calls", "i8"), ("seconds", "f8")])
LARGEST_ROOM = 1 << 40  # bytes of holes in a file; beyond, the file is laid out again as it grows
NSTEPS_MARK = 0x5E7_0F_57E95_C0DE  # replaced in place once the file is laid out
STATUS_MARK = "@status@@@@"
EMPTY = ".empty"  # suffix of the name of an array without rows, whose dataset has one


def checkpoint_name(name: str, array: NDArray) -> str:
    """Name of the dataset of an array in a checkpoint.

    Parameters
    ----------
    name : str
        With at most one slash.
    array : ndarray

    Returns
    -------
    str
    """
    return name.replace("/", ".") + (EMPTY if np.size(array) == 0 else "")


def checkpoint_array(dataset_name: str, values: NDArray) -> tuple[str, NDArray]:
    """Name and array of a dataset in a checkpoint.

    Parameters
    ----------
    dataset_name : str
        As returned by `checkpoint_name`.
    values : ndarray

    Returns
    -------
    name : str
    array : ndarray
    """
    name = dataset_name.removesuffix(EMPTY)
    return name.replace(".", "/", 1), values if name == dataset_name else values[:0]


@dataclass(frozen=True, eq=False)
class Header:
    """What is known before the first frame.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or CurveSet
        Connectivity, and the points of a surface that does not move.
    moving : bool
        Whether frames carry points.
    cell : dict of str to (m, ...) ndarray
        Arrays on faces that do not change, such as `object_id`.
    attributes : dict of str to str or number
        `version`, `command_line`, `input_sha256`, ...
    texts : dict of str to str
        `scene_source`, `scene_resolved`, ...
    obstacles : dict of str to TriangleMesh
        Bodies around the moving ones, at the start; `OBSTACLE_POSE` of the frames moves them.
    changing_faces : bool
        Whether every frame has its own faces; always as many, unless `changing_vertices`.
    changing_vertices : bool
        Whether every frame also has its own number of vertices, and of faces; each is then a part of the
        file. `cell` has then one value for each face of every frame.
    changing_cell : tuple of str
        Arrays on faces that every frame has of its own.
    """

    mesh: TriangleMesh | TetMesh | CurveSet
    moving: bool
    cell: dict[str, NDArray] = field(default_factory=dict)
    attributes: dict[str, Any] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    obstacles: dict[str, TriangleMesh] = field(default_factory=dict)
    changing_faces: bool = False
    changing_vertices: bool = False
    changing_cell: tuple[str, ...] = ()


CONNECTIVITY = "VTKHDF/Polygons/Connectivity"
FACE_ENDS = "VTKHDF/Polygons/Offsets"
BY_FACE = (CONNECTIVITY, FACE_ENDS)


def by_vertex(name: str) -> bool:
    """Whether a growing dataset has a row for each vertex of each frame."""
    return name.startswith(("VTKHDF/PointData/", "VTKHDF/Points"))


def by_face(name: str) -> bool:
    """Whether a growing dataset has a row for each face of each frame.

    Parameters
    ----------
    name : str
        Path of the dataset in the file.

    Returns
    -------
    bool
    """
    return name.startswith("VTKHDF/CellData/")


@dataclass(frozen=True)
class RowCount:
    """Vertices and faces of frames, all together.

    Parameters
    ----------
    n_frames, vertices, faces : int
    """

    n_frames: int = 0
    vertices: int = 0
    faces: int = 0

    def plus(self, trajectory_frame: TrajectoryFrame, header: Header, count: int = 1) -> RowCount:
        """Row counts with `count` more frames like this one; a negative `count` subtracts them."""
        return RowCount(
            self.n_frames + count,
            self.vertices + count * vertices_of(trajectory_frame, header),
            self.faces + count * len(faces_of(trajectory_frame, header)),
        )

    def of(self, name: str, header: Header) -> int:
        """How many rows of a growing dataset they have."""
        if by_vertex(name):
            return self.vertices
        if by_face(name):
            return self.faces
        if header.changing_vertices and name in BY_FACE:
            return 3 * self.faces if name == CONNECTIVITY else self.faces + self.n_frames
        return self.n_frames * rows_per_frame(name, header)


def faces_of(trajectory_frame: TrajectoryFrame, header: Header) -> NDArray[np.int64]:
    """(m, 3) faces of a frame, or the cells of the mesh."""
    return cells_of(header.mesh) if trajectory_frame.faces is None else trajectory_frame.faces


def rows_per_frame(name: str, header: Header) -> int:
    """How many rows of a growing dataset a frame has; of datasets by vertex, the first frame."""
    if name == CONNECTIVITY:
        return cells_of(header.mesh).size
    if name == FACE_ENDS:
        return len(cells_of(header.mesh)) + 1
    if by_face(name):
        return len(cells_of(header.mesh))
    return header.mesh.n_vertices if by_vertex(name) else 1


def vertices_of(trajectory_frame: TrajectoryFrame, header: Header) -> int:
    """Number of vertices of a frame."""
    return header.mesh.n_vertices if trajectory_frame.points is None else len(trajectory_frame.points)


def shapes_of(trajectory_frame: TrajectoryFrame, checkpoint: dict[str, NDArray], effects: NDArray) -> tuple:
    """Names and shapes of what a frame writes; frames with equal ones fit the same file.

    Parameters
    ----------
    trajectory_frame : TrajectoryFrame
    checkpoint : dict of str to ndarray
    effects : (k,) ndarray of EFFECT_DTYPE

    Returns
    -------
    tuple
        For comparison only. Lengths of arrays on vertices and faces are omitted.
    """
    return (
        tuple((name, np.shape(a)[1:]) for name, a in trajectory_frame.vertex.items()),
        tuple((name, np.shape(a)[1:]) for name, a in trajectory_frame.face.items()),
        tuple((name, np.shape(a)) for name, a in trajectory_frame.scalar.items()),
        tuple((name, np.shape(a), str(np.asarray(a).dtype)) for name, a in checkpoint.items()),
        len(effects),
    )


def frame_rows(trajectory_frame: TrajectoryFrame, header: Header, before: RowCount) -> dict[str, NDArray]:
    """Values of every growing dataset for the frame after those of `before`.

    Parameters
    ----------
    trajectory_frame : TrajectoryFrame
    header : Header
    before : RowCount
        Of the frames in the file.

    Returns
    -------
    dict of str to (r, ...) ndarray
        New rows by the path of the dataset in the file.
    """
    one, k, first = np.array, before.n_frames, before.vertices
    topologies = 1 if isinstance(header.mesh, TetMesh) else len(TOPOLOGIES)
    rows: dict[str, NDArray] = {
        "VTKHDF/Steps/Values": one([trajectory_frame.time]),
        "VTKHDF/Steps/PartOffsets": one([k if header.changing_vertices else 0]),
        "VTKHDF/Steps/NumberOfParts": one([1]),
        "VTKHDF/Steps/PointOffsets": one([first if header.moving else 0]),
        "VTKHDF/Steps/CellOffsets": np.zeros((1, topologies), dtype=np.int64),
        "VTKHDF/Steps/ConnectivityIdOffsets": np.zeros((1, topologies), dtype=np.int64),
        "ddgcli/time": one([trajectory_frame.time]),
        "ddgcli/step": one([trajectory_frame.step]),
    }
    if header.moving:
        rows["VTKHDF/Points"] = trajectory_frame.points  # type: ignore[assignment]
    if header.changing_faces:
        offset = np.where(np.array(TOPOLOGIES) == "Polygons", 3 * before.faces, 0)
        rows["VTKHDF/Steps/ConnectivityIdOffsets"] = offset[None]
        rows[CONNECTIVITY] = faces_of(trajectory_frame, header).ravel()
    if header.changing_vertices:
        rows |= _part_rows(trajectory_frame, header, before.faces)
    for name, values in trajectory_frame.vertex.items():
        rows[f"VTKHDF/PointData/{name}"] = values
        rows[f"VTKHDF/Steps/PointDataOffsets/{name}"] = one([first])
    for name, values in trajectory_frame.face.items():
        rows[f"VTKHDF/CellData/{name}"] = values
        rows[f"VTKHDF/Steps/CellDataOffsets/{name}"] = one([before.faces])
    for name in header.cell:
        rows[f"VTKHDF/Steps/CellDataOffsets/{name}"] = one([0])
    for name, value in trajectory_frame.scalar.items():
        row = np.atleast_1d(np.asarray(value, dtype=np.float64))
        rows[f"VTKHDF/FieldData/{name}"] = row[None]
        rows[f"VTKHDF/Steps/FieldDataOffsets/{name}"] = one([k])
        rows[f"VTKHDF/Steps/FieldDataSizes/{name}"] = one([[len(row), 1]])
    return rows


def _part_rows(trajectory_frame: TrajectoryFrame, header: Header, earlier: int) -> dict[str, NDArray]:
    """Counts and cell ends of the part that a frame is; a reader counts the cells of `earlier` parts."""
    n_faces, one = len(faces_of(trajectory_frame, header)), np.array
    faces = np.array(TOPOLOGIES) == "Polygons"
    rows = {
        "VTKHDF/NumberOfPoints": one([vertices_of(trajectory_frame, header)]),
        "VTKHDF/Steps/CellOffsets": np.where(faces, earlier, 0)[None],
    }
    for kind in TOPOLOGIES:
        count = n_faces if kind == "Polygons" else 0
        rows[f"VTKHDF/{kind}/NumberOfCells"] = one([count])
        rows[f"VTKHDF/{kind}/NumberOfConnectivityIds"] = one([3 * count])
        rows[f"VTKHDF/{kind}/Offsets"] = np.arange(0, 3 * count + 1, 3)
    return rows


def room_for(
    trajectory_frame: TrajectoryFrame,
    checkpoint: dict[str, NDArray],
    n_effects: int,
    n_frames: int,
    log: int,
    header: Header,
    whole: RowCount | None = None,
) -> dict[str, RowLayout]:
    """Growing datasets with room for `n_frames` frames (fewer where that would be more than a disk).

    Parameters
    ----------
    trajectory_frame : TrajectoryFrame
        Any frame; all have its names and shapes.
    checkpoint : dict of str to ndarray
    n_effects, n_frames, log : int
        Rows of the effects, frames, and rows of the log.
    header : Header
    whole : RowCount, optional
        The frames to expect, where the number of vertices changes.

    Returns
    -------
    dict of str to RowLayout
        By the path of the dataset in the file.
    """
    sample = frame_rows(trajectory_frame, header, RowCount())
    bytes_each = sum(np.asarray(v).size * 8 for v in sample.values())
    n_frames = max(1, min(n_frames, LARGEST_ROOM // max(bytes_each, 1)))
    rows = {}
    for name, values in sample.items():
        values = np.asarray(values)
        dtype = np.dtype(np.int64) if values.dtype.kind in "iub" else np.dtype(np.float64)
        count = n_frames * rows_per_frame(name, header)
        own = by_vertex(name) or by_face(name) or name in BY_FACE
        if whole is not None and header.changing_vertices and own:
            count = whole.of(name, header)
        rows[name] = RowLayout(dtype, values.shape[1:], count)
    for slot in ("slot_0", "slot_1"):
        for name, array in checkpoint.items():
            array = np.atleast_1d(array)
            rows[f"ddgcli/checkpoint/{slot}/{checkpoint_name(name, array)}"] = RowLayout(
                array.dtype, array.shape[1:], max(len(array), 1)
            )
        rows[f"ddgcli/checkpoint/{slot}/frame"] = RowLayout(np.dtype(np.int64), (), 2)
    rows["ddgcli/log"] = RowLayout(LOG_DTYPE, (), log)
    if n_effects:
        rows["ddgcli/effects"] = RowLayout(EFFECT_DTYPE, (), n_effects)
    return rows


def static_bytes(header: Header) -> int:
    """About how much `static` writes.

    Parameters
    ----------
    header : Header

    Returns
    -------
    int
        In bytes.
    """
    obstacles = [array for mesh in header.obstacles.values() for array in (mesh.points, mesh.faces)]
    arrays = (header.mesh.points, cells_of(header.mesh), *header.cell.values(), *obstacles)
    texts = (*header.texts.values(), *map(str, header.attributes.values()))
    return sum(np.asarray(a).size * 8 for a in arrays) + sum(len(text) * 4 for text in texts)


def cells_of(mesh: TriangleMesh | TetMesh | CurveSet) -> NDArray[np.int64]:
    """(m, 2, 3 or 4) corners of the cells: segments, triangles or tetrahedra."""
    if isinstance(mesh, CurveSet):
        return mesh.lines
    return mesh.tetrahedra if isinstance(mesh, TetMesh) else mesh.faces


def _connectivity(group: h5py.Group, cells: NDArray, changing: bool = False, own_parts: bool = False) -> None:
    """Cells of the whole file; without what every frame has of its own."""
    if not changing:
        group.create_dataset("Connectivity", data=cells.ravel().astype(np.int64))
    if own_parts:
        return
    group.create_dataset("NumberOfCells", data=np.array([len(cells)], dtype=np.int64))
    group.create_dataset("NumberOfConnectivityIds", data=np.array([cells.size], dtype=np.int64))
    group.create_dataset("Offsets", data=np.arange(0, cells.size + 1, cells.shape[1], dtype=np.int64))


def static(file: h5py.File, header: Header) -> None:
    """Write groups, attributes and everything that does not grow; the marks first, near the file's head.

    Parameters
    ----------
    file : h5py.File
        New and empty.
    header : Header
    """
    root = file.create_group("VTKHDF")
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = np.int64(NSTEPS_MARK)
    ours = file.create_group("ddgcli")
    ours.attrs["status"] = STATUS_MARK
    root.attrs["Version"] = np.array([2, 2], dtype=np.int64)
    solid = isinstance(header.mesh, TetMesh)
    root.attrs["Type"] = np.bytes_("UnstructuredGrid" if solid else "PolyData")
    ours.attrs["schema"] = SCHEMA
    for name, value in header.attributes.items():
        text = value if isinstance(value, str) else json.dumps(value)
        ours.attrs[name] = value if isinstance(value, (int, float)) else encodable(text)
    if header.changing_cell:
        ours.attrs[CHANGING_CELL] = json.dumps(header.changing_cell)
    for name, text in header.texts.items():
        ours.create_dataset(name, data=encodable(text), dtype=h5py.string_dtype("utf-8"))
    for number, (name, obstacle) in enumerate(header.obstacles.items()):
        group = ours.create_group(f"obstacles/{number:03d}")
        group.attrs["name"] = encodable(name)
        group.create_dataset("points", data=np.asarray(obstacle.points))
        group.create_dataset("faces", data=np.asarray(obstacle.faces))
    mesh = header.mesh
    if not header.changing_vertices:
        root.create_dataset("NumberOfPoints", data=np.array([mesh.n_vertices], dtype=np.int64))
    if not header.moving:
        root.create_dataset("Points", data=np.asarray(mesh.points))
    if solid:
        _connectivity(root, cells_of(mesh))
        root.create_dataset("Types", data=np.full(len(cells_of(mesh)), VTK_TETRA, dtype=np.uint8))
    own_kind = "Lines" if isinstance(mesh, CurveSet) else "Polygons"
    for kind in () if solid else TOPOLOGIES:
        cells = cells_of(mesh) if kind == own_kind else np.zeros((0, 3), dtype=np.int64)
        changing = header.changing_faces and kind == own_kind
        _connectivity(root.create_group(kind), cells, changing, header.changing_vertices)
    for kind in ("PointData", "CellData", "FieldData"):
        root.create_group(kind)
    for name, values in header.cell.items():
        root["CellData"].create_dataset(name, data=values)
