"""Trajectories: one HDF5 file a run, in the VTKHDF layout (2.2, transient PolyData) that ParaView plays.

What is ours stands in the sibling group `ddgcli`. While the run lasts the file is `PATH.part`, readable by
anyone at any moment (see `row_file`): a frame counts when `NSteps` is raised, the last write of the frame.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any
from xml.sax.saxutils import escape

import h5py
import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshFileError, OutputError
from ddgcli.io.row_file import RowFile, Rows
from ddgcli.mesh.fields import Frame
from ddgcli.mesh.triangle_mesh import TriangleMesh

SCHEMA = "ddgcli-trajectory/1"
TOPOLOGIES = ("Vertices", "Lines", "Polygons", "Strips")
STATUSES = ("running", "complete", "interrupted", "failed")
LOG_DTYPE = np.dtype(
    [("step", "i8"), ("time", "f8"), ("kind", "S24"), ("place", "S32"), ("value", "f8"), ("detail", "S160")]
)
EFFECT_DTYPE = np.dtype([("name", "S48"), ("calls", "i8"), ("seconds", "f8")])
LARGEST_ROOM = 1 << 40  # bytes of holes in a file; beyond, the file is laid out again as it grows
_NSTEPS = 0x5E7_0F_57E95_C0DE  # replaced in place once the file is laid out
_STATUS = "@status@@@@"


@dataclass(frozen=True, eq=False)
class Header:
    """What is known before the first frame.

    Parameters
    ----------
    mesh : TriangleMesh
        Connectivity, and the points of a surface that does not move.
    moving : bool
        Whether frames carry points.
    cell : dict of str to (m, ...) ndarray
        Arrays on faces that do not change, such as `object_id`.
    attributes : dict of str to str or number
        `version`, `command_line`, `input_sha256`, ...
    texts : dict of str to str
        `scene_source`, `scene_resolved`, ...
    """

    mesh: TriangleMesh
    moving: bool
    cell: dict[str, NDArray] = field(default_factory=dict)
    attributes: dict[str, Any] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)


def part_path(path: str) -> str:
    """Where a trajectory is written while the run lasts."""
    return path if path.endswith(".part") else path + ".part"


class TrajectoryWriter:
    """Writes frames to `PATH.part` and renames it when the run is complete.

    Parameters
    ----------
    path : str
        Of the complete trajectory.
    header : Header
    frames : int
        How many are expected; more may come, fewer leave no gap.
    """

    def __init__(self, path: str, header: Header, frames: int) -> None:
        folder = Path(path).parent
        if not folder.is_dir():
            raise OutputError(f"{path}: folder {folder} does not exist; create it")
        self.path, self.part = path, part_path(path)
        self.header, self.expected = header, max(frames, 1)
        self.n_frames = 0
        self._file: RowFile | None = None
        self._log: list[tuple] = [(0, 0.0, b"start", b"", math.nan, b"")]
        self._shapes: tuple = ()

    def append(
        self,
        frame: Frame,
        checkpoint: dict[str, NDArray] | None = None,
        effects: Iterable[tuple[str, int, float]] = (),
        log: Iterable[tuple] = (),
    ) -> None:
        """Add one frame; it counts, with its checkpoint, when this returns.

        Parameters
        ----------
        frame : Frame
            The names and shapes of its arrays are those of the first frame.
        checkpoint : dict of str to ndarray
        effects : rows (name, calls, seconds)
        log : rows (step, time, kind, place, value, detail)
        """
        checkpoint = checkpoint or {}
        effect_rows = np.array([(n.encode()[:48], c, s) for n, c, s in effects], dtype=EFFECT_DTYPE)
        self._log += [
            (step, time, kind.encode()[:24], place.encode()[:32], value, detail.encode()[:160])
            for step, time, kind, place, value, detail in log
        ]
        shapes = _shapes_of(frame, checkpoint, effect_rows)
        if self._file is not None and shapes == self._shapes and self._room():
            self._put(frame, checkpoint, effect_rows)
            return
        frames = self.expected if self._file is None else max(self.expected, 2 * self.n_frames + 16)
        rows = _room_for(frame, checkpoint, len(effect_rows), frames, 2 * len(self._log) + 64, self.header)
        self._lay_out(rows, lambda: self._put(frame, checkpoint, effect_rows))
        self._shapes = shapes

    def _room(self) -> bool:
        rows = self._file.rows  # type: ignore[union-attr]
        return self.n_frames < rows["ddgcli/time"].capacity and len(self._log) <= rows["ddgcli/log"].capacity

    def _put(self, frame: Frame, checkpoint: dict[str, NDArray], effects: NDArray) -> None:
        file, k = self._file, self.n_frames
        if file is None:
            raise OutputError("the trajectory is closed")
        n = self.header.mesh.n_vertices
        per_frame = _frame_rows(frame, self.header, k)
        for name, values in per_frame.items():
            width = n if name.startswith("VTKHDF/PointData/") or name == "VTKHDF/Points" else 1
            file.write(name, k * width, values)
        file.write("ddgcli/log", 0, np.array(self._log, dtype=LOG_DTYPE))
        slot = f"ddgcli/checkpoint/slot_{k % 2}"
        for name, values in checkpoint.items():
            file.write(f"{slot}/{name.replace('/', '.')}", 0, np.atleast_1d(values))
        file.write(f"{slot}/frame", 0, np.array([k, len(self._log)], dtype=np.int64))
        if len(effects):
            file.write("ddgcli/effects", 0, effects)
        self._show(k + 1)

    def _show(self, count: int) -> None:
        """Move every row count, and `NSteps` last: what counts is decided by one write of eight bytes."""
        file = self._file
        if file is None:
            raise OutputError("the trajectory is closed")
        for name, row in file.rows.items():
            if name == "ddgcli/log":
                file.show(name, len(self._log))
            elif name in ("VTKHDF/Points",) or name.startswith("VTKHDF/PointData/"):
                file.show(name, count * self.header.mesh.n_vertices)
            elif name.startswith("ddgcli/checkpoint/") or name == "ddgcli/effects":
                file.show(name, row.capacity)
            else:
                file.show(name, count)
        file.set_mark("NSteps", np.int64(count).tobytes())
        self.n_frames = count

    def _lay_out(self, rows: dict[str, Rows], put: Callable[[], None]) -> None:
        """A new file: the old one's rows, then what `put` adds; only then it takes the old one's place."""
        old, temporary = self._file, self._temporary()
        marks = {"NSteps": np.int64(_NSTEPS).tobytes(), "status": _STATUS.encode()}
        try:
            self._file = new = RowFile(temporary, rows, marks, lambda file: _static(file, self.header))
            new.set_mark("status", _status_bytes("running"))
            for name in set(rows) & set(old.rows if old else ()) - {"ddgcli/log", "ddgcli/effects"}:
                if old is not None and old.rows[name].row_bytes == rows[name].row_bytes:
                    new.copy_rows(name, old, min(old.rows[name].count, rows[name].capacity))
            put()
            os.replace(temporary, self.part)
            new.path = self.part
        except BaseException:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary)
            raise
        if old is not None:
            old.close()

    def _temporary(self) -> str:
        target = Path(self.part)
        handle, name = tempfile.mkstemp(prefix=f".{target.name}-", dir=target.parent)
        os.close(handle)
        os.chmod(name, 0o644)
        return name

    def close(self, status: str) -> str | None:
        """End the file with its status; a complete one takes its own name, which is returned."""
        if self._file is None:
            return None
        complete = status == "complete"
        if complete and self._file.rows["ddgcli/time"].capacity != self.n_frames:
            self._tighten()
        self._file.set_mark("status", _status_bytes(status))
        self._file.sync()
        self._file.close()
        self._file = None
        if complete:
            os.replace(self.part, self.path)
            return self.path
        return self.part

    def _tighten(self) -> None:
        """Lay the file out again without the room that was not used."""
        with Trajectory(self.part) as whole:
            frame, checkpoint, effects = whole.frame(self.n_frames - 1), whole.checkpoint(), whole.effect_rows
        rows = _room_for(frame, checkpoint, len(effects), self.n_frames, len(self._log), self.header)

        def put() -> None:
            self.n_frames -= 1
            self._put(frame, checkpoint, effects)

        self._lay_out(rows, put)

    @classmethod
    def resume(cls, part: str, path: str, header: Header, frames: int) -> TrajectoryWriter:
        """Go on behind the last whole frame of `part`; what stood behind it is dropped."""
        writer = cls(path, header, frames)
        with Trajectory(part) as old:
            first, checkpoint, effects = old.frame(0), old.checkpoint(), old.effect_rows
            last, room = old.n_frames - 1, max(frames, old.n_frames)
            writer._log = [tuple(row) for row in old.log[: old.log_rows]]
            writer._shapes = _shapes_of(first, checkpoint, effects)
            rows = _room_for(first, checkpoint, len(effects), room, 2 * len(writer._log) + 64, header)

            def put() -> None:
                for k in range(last + 1):
                    writer._put(old.frame(k), checkpoint if k == last else {}, effects)

            writer._lay_out(rows, put)
        if os.path.abspath(part) != os.path.abspath(writer.part):
            os.unlink(part)
        return writer


def _status_bytes(status: str) -> bytes:
    return status.encode().ljust(len(_STATUS), b"\0")


def _shapes_of(frame: Frame, checkpoint: dict[str, NDArray], effects: NDArray) -> tuple:
    return (
        tuple((name, np.shape(a)) for name, a in frame.vertex.items()),
        tuple((name, np.shape(a)) for name, a in frame.scalar.items()),
        tuple((name, np.shape(a), str(np.asarray(a).dtype)) for name, a in checkpoint.items()),
        len(effects),
    )


def _frame_rows(frame: Frame, header: Header, k: int) -> dict[str, NDArray]:
    """Values of every growing dataset for frame k."""
    n = header.mesh.n_vertices
    one = np.array
    rows: dict[str, NDArray] = {
        "VTKHDF/Steps/Values": one([frame.time]),
        "VTKHDF/Steps/PartOffsets": one([0]),
        "VTKHDF/Steps/NumberOfParts": one([1]),
        "VTKHDF/Steps/PointOffsets": one([k * n if header.moving else 0]),
        "VTKHDF/Steps/CellOffsets": np.zeros((1, 4), dtype=np.int64),
        "VTKHDF/Steps/ConnectivityIdOffsets": np.zeros((1, 4), dtype=np.int64),
        "ddgcli/time": one([frame.time]),
        "ddgcli/step": one([frame.step]),
    }
    if header.moving:
        rows["VTKHDF/Points"] = frame.points  # type: ignore[assignment]
    for name, values in frame.vertex.items():
        rows[f"VTKHDF/PointData/{name}"] = values
        rows[f"VTKHDF/Steps/PointDataOffsets/{name}"] = one([k * n])
    for name in header.cell:
        rows[f"VTKHDF/Steps/CellDataOffsets/{name}"] = one([0])
    for name, value in frame.scalar.items():
        row = np.atleast_1d(np.asarray(value, dtype=np.float64))
        rows[f"VTKHDF/FieldData/{name}"] = row[None]
        rows[f"VTKHDF/Steps/FieldDataOffsets/{name}"] = one([k])
        rows[f"VTKHDF/Steps/FieldDataSizes/{name}"] = one([[len(row), 1]])
    return rows


def _room_for(
    frame: Frame, checkpoint: dict[str, NDArray], n_effects: int, frames: int, log: int, header: Header
) -> dict[str, Rows]:
    """Growing datasets with room for `frames` frames (fewer where that would be more than a disk)."""
    n = header.mesh.n_vertices
    sample = _frame_rows(frame, header, 0)
    bytes_each = sum(np.asarray(v).size * 8 for v in sample.values())
    frames = max(1, min(frames, LARGEST_ROOM // max(bytes_each, 1)))
    rows = {}
    for name, values in sample.items():
        values = np.asarray(values)
        dtype = np.dtype(np.int64) if values.dtype.kind in "iub" else np.dtype(np.float64)
        width = n if name.startswith("VTKHDF/PointData/") or name == "VTKHDF/Points" else 1
        rows[name] = Rows(dtype, values.shape[1:], frames * width)
    for slot in ("slot_0", "slot_1"):
        for name, array in checkpoint.items():
            array = np.atleast_1d(array)
            rows[f"ddgcli/checkpoint/{slot}/{name.replace('/', '.')}"] = Rows(
                array.dtype, array.shape[1:], max(len(array), 1)
            )
        rows[f"ddgcli/checkpoint/{slot}/frame"] = Rows(np.dtype(np.int64), (), 2)
    rows["ddgcli/log"] = Rows(LOG_DTYPE, (), log)
    if n_effects:
        rows["ddgcli/effects"] = Rows(EFFECT_DTYPE, (), n_effects)
    return rows


def _static(file: h5py.File, header: Header) -> None:
    """Groups, attributes and everything that does not grow; the marks first, near the file's head."""
    root = file.create_group("VTKHDF")
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = np.int64(_NSTEPS)
    ours = file.create_group("ddgcli")
    ours.attrs["status"] = _STATUS
    root.attrs["Version"] = np.array([2, 2], dtype=np.int64)
    root.attrs["Type"] = np.bytes_("PolyData")
    ours.attrs["schema"] = SCHEMA
    for name, value in header.attributes.items():
        ours.attrs[name] = value if isinstance(value, (int, float, str)) else json.dumps(value)
    for name, text in header.texts.items():
        ours.create_dataset(name, data=text, dtype=h5py.string_dtype("utf-8"))
    mesh = header.mesh
    root.create_dataset("NumberOfPoints", data=np.array([mesh.n_vertices], dtype=np.int64))
    if not header.moving:
        root.create_dataset("Points", data=np.asarray(mesh.points))
    for kind in TOPOLOGIES:
        faces = mesh.faces if kind == "Polygons" else np.zeros((0, 3), dtype=np.int64)
        group = root.create_group(kind)
        group.create_dataset("NumberOfCells", data=np.array([len(faces)], dtype=np.int64))
        group.create_dataset("NumberOfConnectivityIds", data=np.array([faces.size], dtype=np.int64))
        group.create_dataset("Offsets", data=np.arange(0, faces.size + 1, 3, dtype=np.int64))
        group.create_dataset("Connectivity", data=faces.ravel().astype(np.int64))
    for kind in ("PointData", "CellData", "FieldData"):
        root.create_group(kind)
    for name, values in header.cell.items():
        root["CellData"].create_dataset(name, data=values)


class Trajectory:
    """A trajectory for reading, complete or still growing.

    Parameters
    ----------
    path : str

    Raises
    ------
    MeshFileError
        Not a trajectory of ours, or without a frame.
    """

    def __init__(self, path: str) -> None:
        if not Path(path).is_file():
            raise MeshFileError(f"{path}: no such file; check the path")
        try:
            self._file = h5py.File(path, "r")
            self._root, self._ours = self._file["VTKHDF"], self._file["ddgcli"]
            self.n_frames = int(self._root["Steps"].attrs["NSteps"])
            self.times: NDArray = self._ours["time"][: self.n_frames]
            self.steps: NDArray = self._ours["step"][: self.n_frames]
            faces = self._root["Polygons/Connectivity"][...].reshape(-1, 3)
            self._n = int(self._root["NumberOfPoints"][0])
        except (OSError, KeyError, ValueError) as error:
            raise MeshFileError(
                f"{path}: not a ddgcli trajectory ({error}); give a .vtkhdf of a simulator"
            ) from error
        self.path = path
        self.moving = len(self._root["Points"]) > self._n or "PointOffsets" not in self._root["Steps"]
        self.moving = self.moving or bool(np.any(self._root["Steps/PointOffsets"][: self.n_frames]))
        self.mesh = TriangleMesh.from_arrays(self.points(0), faces)

    def __enter__(self) -> Trajectory:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

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
        return self._root["Points"][start : start + self._n]

    def vertex(self, k: int) -> dict[str, NDArray]:
        """Arrays on vertices of frame k."""
        data = self._root["PointData"]
        return {name: data[name][k * self._n : (k + 1) * self._n] for name in data}

    @property
    def face(self) -> dict[str, NDArray]:
        """Arrays on faces, the same in every frame."""
        return {name: values[...] for name, values in self._root["CellData"].items()}

    @property
    def scalars(self) -> dict[str, NDArray]:
        """(T, k) or (T,) numbers of every frame, by name."""
        found = {name: values[: self.n_frames] for name, values in self._root["FieldData"].items()}
        return {name: v[:, 0] if v.shape[1] == 1 else v for name, v in found.items()}

    def frame(self, k: int) -> Frame:
        """Frame k."""
        scalar = {name: values[k] for name, values in self.scalars.items()}
        return Frame(int(self.steps[k]), float(self.times[k]), self.points(k), self.vertex(k), scalar)

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
        slot = self._ours["checkpoint"][f"slot_{last % 2}"]
        if int(slot["frame"][0]) != last:
            raise MeshFileError(
                f"{self.path}: the checkpoint of frame {last} is missing; start the run afresh"
            )
        return slot

    def checkpoint(self) -> dict[str, NDArray]:
        """State behind the last whole frame."""
        return {
            name.replace(".", "/", 1): values[...] for name, values in self._slot().items() if name != "frame"
        }


def pvd_text(files: list[tuple[float, str]]) -> str:
    """A ParaView series of (time, file)."""
    lines = [f'    <DataSet timestep="{time!r}" part="0" file="{escape(name)}"/>' for time, name in files]
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
    return head + "\n".join(lines) + "\n  </Collection>\n</VTKFile>\n"


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode().rstrip("\0")
    return value.item() if isinstance(value, np.generic) else value
