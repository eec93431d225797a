"""Trajectory files on systems without positioned reads and writes, and where no open file can be replaced."""

import os
import sys

import numpy as np
import pytest

from ddgcli.errors import OutputError
from ddgcli.io.trajectories.layout import Header
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.io.trajectories.writer import TrajectoryWriter
from ddgcli.mesh.fields import TrajectoryFrame
from ddgcli.mesh.shapes import grid

MESH = grid(2, 2)
N_FRAMES = 6  # of an expected 2: the file is laid out again


def append(writer, numbers):
    for k in numbers:
        points = MESH.points + k
        checkpoint = {"m/x": points}
        writer.append(TrajectoryFrame(k, 0.5 * k, points, {}, {"energy": 2.0 * k}), checkpoint)


def write_and_resume(folder):
    """A run cut after three frames, and its continuation to the end; the path of the trajectory."""
    path = str(folder / "run.vtkhdf")
    header = Header(MESH, True, {}, {}, {"scene_resolved": "{}"})
    first = TrajectoryWriter(path, header, 2)
    append(first, range(3))
    unfinished = first.close("interrupted")
    second = TrajectoryWriter.resume(unfinished, path, header, 2)
    append(second, range(3, N_FRAMES))
    assert second.close("complete") == path
    assert [entry.name for entry in folder.iterdir()] == ["run.vtkhdf"]
    return path


@pytest.fixture
def replacements(monkeypatch):
    """Check at every `os.replace` that neither path is open in this process; the names that were replaced."""
    if not os.path.isdir("/proc/self/fd"):
        pytest.skip("the system does not list open files")
    replace, replacements = os.replace, []

    def checked(source, target):
        links = [f"/proc/self/fd/{number}" for number in os.listdir("/proc/self/fd")]
        opened = {os.path.realpath(link) for link in links if os.path.lexists(link)}
        paths = {os.path.realpath(source), os.path.realpath(target)}
        assert not opened & paths
        replace(source, target)
        replacements.append(os.path.basename(target))

    monkeypatch.setattr(os, "replace", checked)
    return replacements


def test_no_open_file_is_replaced(tmp_path, replacements):
    write_and_resume(tmp_path)
    # laid out, grown, resumed, grown, without unused room, complete
    assert len(replacements) >= 5 and replacements[-1] == "run.vtkhdf"


def test_without_positioned_reads_and_writes(tmp_path, monkeypatch):
    for name in ("pread", "pwrite"):
        monkeypatch.delattr(os, name, raising=False)
    with Trajectory(write_and_resume(tmp_path)) as run:
        assert run.n_frames == N_FRAMES
        assert all(np.array_equal(run.points(k), MESH.points + k) for k in range(N_FRAMES))
        assert np.array_equal(run.scalars["energy"], 2.0 * np.arange(N_FRAMES))
        assert np.array_equal(run.checkpoint()["m/x"], MESH.points + N_FRAMES - 1)


@pytest.mark.parametrize("moment", ["before", "after"])
def test_a_signal_at_the_replacement_leaves_a_file_that_can_be_continued(tmp_path, monkeypatch, moment):
    """Whichever file is in place then, it holds whole frames, and the writer continues it."""
    path = str(tmp_path / "run.vtkhdf")
    writer = TrajectoryWriter(path, Header(MESH, True), 2)
    append(writer, range(2))
    replace = os.replace

    def interrupted(source, target):
        if moment == "after":
            replace(source, target)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            append(writer, [2])
    assert writer.n_frames == (3 if moment == "after" else 2)
    append(writer, range(writer.n_frames, 4))
    writer.close("complete")
    with Trajectory(path) as run:
        assert np.array_equal(run.scalars["energy"], [0.0, 2.0, 4.0, 6.0])
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.vtkhdf"]


def test_a_file_that_another_run_replaced_is_not_written_to(tmp_path, monkeypatch):
    path = str(tmp_path / "run.vtkhdf")
    writer, other = (TrajectoryWriter(path, Header(MESH, True), 2) for _ in range(2))
    append(writer, range(2))
    replace = os.replace

    def too_late(source, target):
        with monkeypatch.context() as patch:
            patch.setattr(os, "replace", replace)
            append(other, [0])
        raise OSError(5, "refused")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", too_late)
        with pytest.raises(OutputError, match="cannot be written"):
            append(writer, [2])
    with pytest.raises(OutputError, match="another run took this place"):
        append(writer, [2])
    other.close("complete")
    with Trajectory(path) as run:
        assert run.n_frames == 1


@pytest.mark.skipif(sys.platform != "linux", reason="a disk that is always full is a device of Linux")
def test_a_full_disk_is_named(tmp_path):
    from ddgcli.io.trajectories.positioned_file import PositionedFile

    file = PositionedFile("/dev/full")
    with pytest.raises(OutputError, match="No space left.*free some disk space"):
        file.write(b"x", 0)
    file.close()
