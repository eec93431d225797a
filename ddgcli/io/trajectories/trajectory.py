"""Reading trajectories, complete or still growing."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn
from xml.sax.saxutils import escape

import h5py
import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, excerpt
from ddgcli.io.trajectories.layout import EFFECT_DTYPE, TOPOLOGIES, checkpoint_array
from ddgcli.io.trajectories.layout_check import (
    CHANGING_CELL,
    OBSTACLE_POSE,
    PERIODS,
    check_trajectory,
    part_counts,
)
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import TrajectoryFrame
from ddgcli.mesh.periodic import Periods
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import moved_rigidly


class Trajectory:
    """A trajectory for reading, complete or still growing.

    Parameters
    ----------
    path : str

    Attributes
    ----------
    n_vertices : list of int
        Of every frame.

    Raises
    ------
    MeshFileError
        Not a trajectory of ours, or without a frame.
    """

    def __init__(self, path: str) -> None:
        if Path(path).exists() and not Path(path).is_file():
            kind = "a folder" if Path(path).is_dir() else "not a regular file"
            raise MeshFileError(f"{path}: is {kind}; name a .vtkhdf of a simulator")
        if not Path(path).is_file():
            complete = path.removesuffix(".part")
            is_complete = complete != path and Path(complete).is_file()
            advice = f"the run is complete: {complete}" if is_complete else "check the path"
            raise MeshFileError(f"{path}: no such file; {advice}")
        if not os.access(path, os.R_OK):
            raise MeshFileError(f"{path}: permission denied; check the path")
        check_trajectory(path)
        try:
            self._file = h5py.File(path, "r")
            self._root, self._ours = self._file["VTKHDF"], self._file["ddgcli"]
            self.n_frames = int(self._root["Steps"].attrs["NSteps"])
            self.times: NDArray = self._ours["time"][: self.n_frames]
            self.steps: NDArray = self._ours["step"][: self.n_frames]
            solid = "Types" in self._root
            cells = self._root if solid else self._root["Polygons"]
            self._corners = part_counts(cells["NumberOfConnectivityIds"], self.n_frames)
            corners = cells["Connectivity"][: self._corners[0]]
            self.changing_faces = len(cells["Connectivity"]) > self._corners[0]
            ends = np.zeros(0, np.int64) if solid else self._root["Lines/Connectivity"][...]
            self.n_vertices = part_counts(self._root["NumberOfPoints"], self.n_frames)
        except (OSError, KeyError, ValueError) as error:
            raise MeshFileError(
                f"{path}: not a ddgcli trajectory ({excerpt(error)}); give a .vtkhdf of a simulator"
            ) from error
        self.path = path
        self.moving = (
            len(self._root["Points"]) > self.n_vertices[0] or "PointOffsets" not in self._root["Steps"]
        )
        self.moving = self.moving or bool(np.any(self._root["Steps/PointOffsets"][: self.n_frames]))
        self.mesh = _mesh_of_cells(self.points(0), corners, ends, solid)

    def __repr__(self) -> str:
        return f"Trajectory({self.path!r}, {self.n_frames} frames)"

    def __reduce__(self) -> NoReturn:
        raise TypeError("a Trajectory is an open file and is not pickled; open its path")

    def __enter__(self) -> Trajectory:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __iter__(self) -> Iterator[TrajectoryFrame]:
        return (self.read_frame(k) for k in range(self.n_frames))

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes of the group `ddgcli`."""
        return {name: _plain(value) for name, value in self._ours.attrs.items()}

    def text(self, name: str) -> str:
        """A text such as `scene_resolved`."""
        return self._ours[name][()].decode()

    def points(self, k: int) -> NDArray[np.float64]:
        """(n, 3) positions of frame k."""
        start = int(self._root["Steps/PointOffsets"][k])
        return self._root["Points"][start : start + self.n_vertices[k]]

    @property
    def n_faces(self) -> list[int]:
        """Number of triangles of every frame."""
        return [count // 3 for count in self._corners]

    def faces(self, k: int) -> NDArray[np.int64] | None:
        """(m, 3) faces of frame k where they change during the run, else None."""
        if not self.changing_faces:
            return None
        start = int(self._root["Steps/ConnectivityIdOffsets"][k, TOPOLOGIES.index("Polygons")])
        return self._root["Polygons/Connectivity"][start : start + self._corners[k]].reshape(-1, 3)

    def mesh_at(self, k: int) -> TriangleMesh | TetMesh | CurveSet:
        """The mesh of frame k."""
        faces = self.faces(k)
        return (
            self.mesh.moved_unchecked(self.points(k))
            if faces is None
            else TriangleMesh.from_arrays(self.points(k), faces)
        )

    def vertex(self, k: int) -> dict[str, NDArray]:
        """Arrays on vertices of frame k."""
        data, first = self._root["PointData"], sum(self.n_vertices[:k])
        return {name: data[name][first : first + self.n_vertices[k]] for name in data}

    def face(self, k: int) -> dict[str, NDArray]:
        """Arrays on faces of frame k, those that are the same in every frame too."""
        own, data = self._own_face(k), self._root["CellData"]
        return {name: own[name] if name in own else values[...] for name, values in data.items()}

    def _own_face(self, k: int) -> dict[str, NDArray]:
        """Arrays on faces that frame k has of its own."""
        names = json.loads(self.attributes.get(CHANGING_CELL, "[]"))
        first = {name: int(self._root[f"Steps/CellDataOffsets/{name}"][k]) for name in names}
        data, count = self._root["CellData"], self._corners[k] // 3
        return {name: data[name][start : start + count] for name, start in first.items()}

    def obstacles(self, k: int = 0) -> dict[str, TriangleMesh]:
        """Bodies around the moving ones in frame k, by name."""
        obstacles = {}
        for group in self._ours.get("obstacles", {}).values():
            name = str(_plain(group.attrs["name"]))
            points, pose = group["points"][...], self._root["FieldData"].get(OBSTACLE_POSE + name)
            if pose is not None:
                points = moved_rigidly(points, pose[k])
            obstacles[name] = TriangleMesh.from_arrays(points, group["faces"][...])
        return obstacles

    @property
    def scalars(self) -> dict[str, NDArray]:
        """(T, k) or (T,) numbers of every frame, by name."""
        columns = {name: values[: self.n_frames] for name, values in self._root["FieldData"].items()}
        return {name: v[:, 0] if v.shape[1] == 1 else v for name, v in columns.items()}

    @property
    def periods(self) -> Periods | None:
        """Periods of the objects; None where no grid is periodic."""
        if PERIODS not in self.attributes:
            return None
        lengths = json.loads(self.attributes[PERIODS])
        of_object = {name: np.array(period, dtype=np.float64) for name, period in lengths.items()}
        return Periods(of_object, self.face(0).get("object_id", np.zeros(self.n_faces[0], dtype=np.int64)))

    def read_frame(self, k: int) -> TrajectoryFrame:
        """Frame k."""
        scalar = {name: values[k] for name, values in self.scalars.items()}
        step, time = int(self.steps[k]), float(self.times[k])
        return TrajectoryFrame(
            step, time, self.points(k), self.vertex(k), scalar, self.faces(k), self._own_face(k)
        )

    def frame_at(self, time: float) -> int:
        """Number of the frame nearest to a time."""
        return int(np.argmin(np.abs(self.times - time)))

    @property
    def effect_rows(self) -> NDArray:
        """Rows of `EFFECT_DTYPE`."""
        return self._ours["effects"][...] if "effects" in self._ours else np.zeros(0, dtype=EFFECT_DTYPE)

    @property
    def effects(self) -> dict[str, tuple[int, float]]:
        """name -> (calls, seconds)."""
        return {row["name"].decode(): (int(row["calls"]), float(row["seconds"])) for row in self.effect_rows}

    @property
    def log(self) -> NDArray:
        """Rows of `LOG_DTYPE`."""
        return self._ours["log"][...]

    @property
    def log_rows(self) -> int:
        """Rows of the log that belong to the last whole frame or an earlier one."""
        return int(self._slot()["frame"][1])

    def _slot(self) -> h5py.Group:
        last = self.n_frames - 1
        slot = self._ours.get(f"checkpoint/slot_{last % 2}")
        frame_and_log = None if slot is None else slot.get("frame")
        if (
            frame_and_log is None
            or getattr(frame_and_log, "shape", ()) != (2,)
            or int(frame_and_log[0]) != last
        ):
            raise MeshFileError(
                f"{self.path}: the checkpoint of frame {last} is missing; start the run again"
            )
        return slot

    def checkpoint(self) -> dict[str, NDArray]:
        """State after the last whole frame."""
        rows = self._slot().items()
        return dict(checkpoint_array(name, values[...]) for name, values in rows if name != "frame")


def _mesh_of_cells(
    points: NDArray, corners: NDArray, ends: NDArray, solid: bool
) -> TriangleMesh | TetMesh | CurveSet:
    """Tetrahedra, segments or triangles over points, by which cells a trajectory has."""
    if solid:
        return TetMesh.from_arrays(points, corners.reshape(-1, 4))
    if len(ends):
        return CurveSet.from_arrays(points, ends.reshape(-1, 2))
    return TriangleMesh.from_arrays(points, corners.reshape(-1, 3))


def pvd_text(files: list[tuple[float, int, str]]) -> str:
    """Content of a ParaView series.

    Parameters
    ----------
    files : list of (float, int, str)
        Time, number of the part, and path of each file.

    Returns
    -------
    str
        XML of a `.pvd` file.
    """
    lines = [
        f'    <DataSet timestep="{time!r}" part="{part_number}" file="{escape(name)}"/>'
        for time, part_number, name in files
    ]
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
    return head + "\n".join(lines) + "\n  </Collection>\n</VTKFile>\n"


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode().rstrip("\0")
    return value.item() if isinstance(value, np.generic) else value
