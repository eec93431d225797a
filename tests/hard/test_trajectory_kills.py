"""A trajectory is whole at every moment: writers are killed at random and the file is read."""

import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from ddgcli.io.trajectories.trajectory import Trajectory

WRITER = """
import sys
import numpy as np
from ddgcli.io.trajectories.layout import Header
from ddgcli.io.trajectories.writer import TrajectoryWriter
from ddgcli.mesh.fields import TrajectoryFrame
from ddgcli.mesh.shapes import grid
mesh = grid(12, 12)
writer = TrajectoryWriter(sys.argv[1], Header(mesh, True, {}, {}, {"scene_resolved": "{}"}), 40)
for k in range(100000):
    points = mesh.points + k
    scalars = {"energy": k * 1.5, "momentum": np.full(3, k)}
    frame = TrajectoryFrame(k, 0.5 * k, points, {"velocity": points * 2}, scalars)
    checkpoint = {"m/x": points, "m/v": np.arange(1000.0) + k, "m/none": np.zeros((0, 2))}
    writer.append(frame, checkpoint, [("solver", k, 0.1)], [(k, 0.5 * k, "event", "", float(k), "")])
    print(k, flush=True)
"""


def killed_once(path, rng, signals):
    child = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE)
    for _ in range(rng.randrange(1, 100)):  # counted in frames: a busy machine is no excuse
        child.stdout.readline()
    time.sleep(rng.random() * 0.005)
    child.send_signal(rng.choice(signals))
    child.stdout.close()
    child.wait()


def check_whole(partial_file):
    """Every frame that the file counts is there to the last number, and so is its checkpoint."""
    with Trajectory(str(partial_file)) as run:
        base = run.points(0)
        assert run.n_frames >= 1
        assert len(run.times) == run.n_frames
        for k in {0, run.n_frames // 2, run.n_frames - 1}:
            assert np.array_equal(run.points(k), base + k)
            assert np.array_equal(run.vertex(k)["velocity"], 2 * (base + k))
            assert run.scalars["energy"][k] == 1.5 * k
            assert run.times[k] == 0.5 * k
        last = run.n_frames - 1
        checkpoint = run.checkpoint()
        assert np.array_equal(checkpoint["m/x"], base + last)
        assert np.array_equal(checkpoint["m/v"], np.arange(1000.0) + last)
        assert checkpoint["m/none"].shape == (0, 2)
        assert run.log_rows == last + 2
        assert run.log["value"][run.log_rows - 1] == last
        return run.n_frames


@pytest.mark.parametrize("kills", [8, pytest.param(100, marks=[pytest.mark.slow, pytest.mark.timeout(1800)])])
def test_every_frame_is_whole_after_kills(tmp_path, kills):
    rng = random.Random(kills)
    counts = []
    for k in range(kills):
        path = tmp_path / f"run{k}.vtkhdf"
        killed_once(path, rng, [signal.SIGKILL, signal.SIGKILL, signal.SIGTERM])
        assert not path.exists()
        counts.append(check_whole(f"{path}.part"))
        os.unlink(f"{path}.part")
    assert max(counts) > 40  # some exceeded their first capacity and were laid out again
