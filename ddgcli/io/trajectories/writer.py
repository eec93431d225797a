"""Writing trajectories: a file that is whole at every moment, renamed when the run is complete.

While the run lasts the file is `PATH.part`, readable by anyone at any moment (see `row_file`): a frame counts
when `NSteps` is raised, the last write of the frame.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import OutputError, excerpt
from ddgcli.io.temporary import StagedOutputs, temporary_name
from ddgcli.io.trajectories.layout import (
    BY_FACE,
    EFFECT_DTYPE,
    LOG_DTYPE,
    NSTEPS_MARK,
    STATUS_MARK,
    Header,
    RowCount,
    by_face,
    checkpoint_name,
    frame_rows,
    room_for,
    shapes_of,
    static,
    static_bytes,
)
from ddgcli.io.trajectories.row_file import RowFile, RowLayout
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh.fields import TrajectoryFrame


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

    def __init__(self, path: str, header: Header, n_frames: int) -> None:
        folder = Path(path).parent
        if not folder.is_dir():
            raise OutputError(f"{path}: folder {folder} does not exist; create it")
        self.path, self.partial_path = path, part_path(path)
        self.header, self.expected = header, max(n_frames, 1)
        self.n_frames = 0
        self._rows = RowCount()  # of the frames so far
        self._file: RowFile | None = None
        self._log: list[tuple] = [(0, 0.0, b"start", b"", math.nan, b"")]
        self._logged = 0  # rows of it that the present file holds
        self._whole = 1  # rows of it that belong to the last whole frame or an earlier one
        self._shapes: tuple = ()

    def append(
        self,
        trajectory_frame: TrajectoryFrame,
        checkpoint: dict[str, NDArray] | None = None,
        effects: Iterable[tuple[str, int, float]] = (),
        log: Iterable[tuple] = (),
    ) -> None:
        """Add one frame; it counts, with its checkpoint, when this returns.

        Parameters
        ----------
        trajectory_frame : TrajectoryFrame
            The names and shapes of its arrays are those of the first frame, but for the number of vertices
            where the header states that it changes.
        checkpoint : dict of str to ndarray
        effects : rows (name, calls, seconds)
        log : rows (step, time, kind, place, value, detail)
        """
        checkpoint = checkpoint or {}
        effect_rows = np.array([(n.encode()[:48], c, s) for n, c, s in effects], dtype=EFFECT_DTYPE)
        self._log += _log_rows(log)
        self._whole = len(self._log)
        shapes = shapes_of(trajectory_frame, checkpoint, effect_rows)
        if self._file is None:
            self.header = replace(self.header, changing_cell=tuple(trajectory_frame.face))
        if self._file is not None and shapes == self._shapes and self._has_capacity(trajectory_frame):
            self._write_frame(trajectory_frame, checkpoint, effect_rows)
            return
        n_frames = self.expected if self._file is None else max(self.expected, 2 * self.n_frames + 16)
        whole = self._rows.plus(trajectory_frame, self.header, n_frames - self.n_frames)
        rows = room_for(
            trajectory_frame,
            checkpoint,
            len(effect_rows),
            n_frames,
            2 * len(self._log) + 64,
            self.header,
            whole,
        )
        self._lay_out(rows, lambda: self._write_frame(trajectory_frame, checkpoint, effect_rows))
        self._shapes = shapes

    def _has_capacity(self, trajectory_frame: TrajectoryFrame) -> bool:
        rows = self._file.rows  # type: ignore[union-attr]
        after = self._rows.plus(trajectory_frame, self.header)
        names = {"ddgcli/time", "VTKHDF/Points", *BY_FACE, *filter(by_face, rows)} & set(rows)
        whole = all(after.of(name, self.header) <= rows[name].capacity for name in names)
        return whole and len(self._log) <= rows["ddgcli/log"].capacity

    def _write_frame(
        self, trajectory_frame: TrajectoryFrame, checkpoint: dict[str, NDArray], effects: NDArray
    ) -> None:
        file, k = self._file, self.n_frames
        if file is None:
            raise OutputError("the trajectory is closed")
        for name, values in frame_rows(trajectory_frame, self.header, self._rows).items():
            file.write(name, self._rows.of(name, self.header), values)
        self._rows = self._rows.plus(trajectory_frame, self.header)
        self._put_log()
        slot = f"ddgcli/checkpoint/slot_{k % 2}"
        for name, values in checkpoint.items():
            file.write(f"{slot}/{checkpoint_name(name, values)}", 0, np.atleast_1d(values))
        file.write(f"{slot}/frame", 0, np.array([k, self._whole], dtype=np.int64))
        if len(effects):
            file.write("ddgcli/effects", 0, effects)
        self._show(k + 1)

    def _put_log(self) -> None:
        self._file.write(  # type: ignore[union-attr]
            "ddgcli/log", self._logged, np.array(self._log[self._logged :], dtype=LOG_DTYPE)
        )
        self._logged = len(self._log)

    def _show(self, count: int) -> None:
        """Move every row count, and `NSteps` last: what counts is decided by one write of eight bytes."""
        file = self._file
        if file is None:
            raise OutputError("the trajectory is closed")
        for name, row in file.rows.items():
            if name == "ddgcli/log":
                file.show(name, len(self._log))
            elif name.startswith("ddgcli/checkpoint/") or name == "ddgcli/effects":
                file.show(name, row.capacity)
            else:
                file.show(name, self._rows.of(name, self.header))
        file.set_mark("NSteps", np.int64(count).tobytes())
        self.n_frames = count

    def _lay_out(self, rows: dict[str, RowLayout], write_rows: Callable[[], None]) -> None:
        """Write a new file: the old one's rows, then those of `write_rows`. It then replaces the old one."""
        before = self._file, self._rows, self.n_frames, self._logged
        old, temporary = self._file, temporary_name(Path(self.partial_path))
        marks = {"NSteps": np.int64(NSTEPS_MARK).tobytes(), "status": STATUS_MARK.encode()}
        try:
            self._file = new = RowFile(
                temporary, rows, marks, lambda file: static(file, self.header), static_bytes(self.header)
            )
            new.set_mark("status", _status_bytes("running"))
            for name in set(rows) & set(old.rows if old else ()) - {"ddgcli/log", "ddgcli/effects"}:
                if old is not None and old.rows[name].row_bytes == rows[name].row_bytes:
                    new.copy_rows(name, old, min(old.rows[name].count, rows[name].capacity))
            self._logged = 0
            write_rows()
            for row_file in filter(None, (old, new)):  # Windows moves no open file
                row_file.file.close()
            os.replace(temporary, self.partial_path)
            new.file.reopen(self.partial_path)
        except BaseException as error:
            new_file = self._file
            # a signal may come after it took its place
            moved = new_file is not None and new_file is not old and new_file.file.is_at(self.partial_path)
            if new_file is not None:
                new_file.file.close()
            if not moved:
                self._file, self._rows, self.n_frames, self._logged = before
                with contextlib.suppress(OSError):
                    os.unlink(temporary)
            if self._file is not None:
                self._file.file.reopen(self.partial_path)
            if isinstance(error, OSError):
                why = os.strerror(error.errno) if error.errno else excerpt(error)
                raise OutputError(f"{self.path}: cannot be written ({why}); free some disk space") from error
            raise

    def close(
        self, status: str, log: Iterable[tuple] = (), staged: StagedOutputs | None = None, keep: bool = True
    ) -> str | None:
        """End the file with its status; a complete one takes its own name, which is returned.

        `log` are rows of what came after the last frame: a resumed run drops them, and makes its own. With
        `staged` it takes its name together with the other outputs; where these fail it stays, if `keep`.
        """
        if self._file is None:
            return None
        if not self._file.file.is_at(self.partial_path):
            raise OutputError(
                f"{self.partial_path}: another run took this place; give each run its own output"
            )
        complete = status == "complete"
        self._log += _log_rows(log)
        rows = self._file.rows
        if len(self._log) > rows["ddgcli/log"].capacity or (
            complete and rows["ddgcli/time"].capacity != self.n_frames
        ):
            self._tighten()
        elif len(self._log) > self._logged:
            self._put_log()
            self._file.show("ddgcli/log", self._logged)
        self._file.set_mark("status", _status_bytes(status))
        self._file.file.sync()
        self._file.file.close()
        self._file = None
        if complete:
            if staged is None:
                os.replace(self.partial_path, self.path)
            else:
                staged.add(self.partial_path, Path(self.path), keep=keep)
            return self.path
        return self.partial_path

    def _tighten(self) -> None:
        """Lay the file out again without the room that was not used."""
        with Trajectory(self.partial_path) as whole:
            trajectory_frame, checkpoint, effects = (
                whole.read_frame(self.n_frames - 1),
                whole.checkpoint(),
                whole.effect_rows,
            )
        rows = room_for(
            trajectory_frame,
            checkpoint,
            len(effects),
            self.n_frames,
            len(self._log),
            self.header,
            self._rows,
        )

        def write_frames() -> None:
            self.n_frames -= 1
            self._rows = self._rows.plus(trajectory_frame, self.header, -1)
            self._write_frame(trajectory_frame, checkpoint, effects)

        self._lay_out(rows, write_frames)

    @classmethod
    def resume(cls, partial_path: str, path: str, header: Header, n_frames: int) -> TrajectoryWriter:
        """Continue after the last whole frame of `partial_path`; what follows it is dropped."""
        writer = cls(path, header, n_frames)
        with Trajectory(partial_path) as old:
            first, checkpoint, effects = old.read_frame(0), old.checkpoint(), old.effect_rows
            last, capacity = old.n_frames - 1, max(n_frames, old.n_frames)
            writer._log = [tuple(row) for row in old.log[: old.log_rows]]
            writer._whole = len(writer._log)
            writer.header = header = replace(header, changing_cell=tuple(first.face))
            writer._shapes = shapes_of(first, checkpoint, effects)
            whole = RowCount(old.n_frames, sum(old.n_vertices), sum(old.n_faces))
            whole = whole.plus(old.read_frame(last), header, capacity - old.n_frames)
            rows = room_for(
                first, checkpoint, len(effects), capacity, 2 * len(writer._log) + 64, header, whole
            )

            def write_frames() -> None:
                for k in range(last + 1):
                    writer._write_frame(old.read_frame(k), checkpoint if k == last else {}, effects)
                old.close()

            writer._lay_out(rows, write_frames)
        is_partial = partial_path.endswith(".part")  # a whole trajectory stays
        if is_partial and os.path.abspath(partial_path) != os.path.abspath(writer.partial_path):
            os.unlink(partial_path)
        return writer


def _log_rows(rows: Iterable[tuple]) -> list[tuple]:
    return [
        (step, time, kind.encode()[:24], place.encode()[:32], value, detail.encode()[:160])
        for step, time, kind, place, value, detail in rows
    ]


def _status_bytes(status: str) -> bytes:
    return status.encode().ljust(len(STATUS_MARK), b"\0")
