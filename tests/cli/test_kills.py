"""Every simulator is killed at random moments and resumed: its trajectory has the bits of an unbroken run.

`pytest -m slow tests/cli/test_kills.py` kills each simulator a hundred times.
"""

import os
import random
import shutil
import signal
import sys

import pytest

from benchmarks.hardcases.run import preload
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from tests.cli.children import ended, forked
from tests.cli.test_shell_resume import assert_equal_bits, frames_of
from tests.conftest import ROOT
from tests.simulate import FALLING_CLOTH, scene_file

RUNS = {  # each takes some tenths of a second
    "shell-sim": ("scene.toml",),
    "fluid-sim": ("ball.ply", "--vorticity", "5*z+x*y", "--steps", "8", "--dt", "0.02"),
    "willmore-flow": ("ball.ply", "--steps", "6"),
    "curve-flow": (ROOT / "sample_meshes" / "trefoil.obj", "--steps", "15"),
}

FAILED_RUNS = ROOT / "build" / "kills"  # folders of runs that failed

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads the processor clock of a child")


@pytest.mark.parametrize("kills", [2, pytest.param(100, marks=[pytest.mark.slow, pytest.mark.timeout(3600)])])
@pytest.mark.parametrize("command", RUNS)
def test_a_simulator_killed_at_random_moments_and_resumed_ends_with_the_same_bits(
    tmp_path, command, kills, record_property
):
    preload()
    scene = FALLING_CLOTH.replace("[5, 5]", "[3, 3]").replace("duration = 0.1", "duration = 0.05")
    scene_file(tmp_path, text=scene)
    ball = shapes.icosphere(2)
    write_mesh(str(tmp_path / "ball.ply"), AnnotatedMesh(ball.moved(ball.points * [1, 1.2, 0.8])))
    call = [command, *RUNS[command]]
    whole, broken, partial_file = (
        tmp_path / name for name in ("whole.vtkhdf", "run.vtkhdf", "run.vtkhdf.part")
    )
    rng = random.Random(f"{command} {kills}")
    first = forked(tmp_path, [*call, "-o", whole])
    _, status, usage = os.wait4(first, 0)
    assert status == 0
    cpu = usage.ru_utime + usage.ru_stime
    expected, killed, resumed, runs = frames_of(whole), 0, 0, 0
    while killed < kills:
        broken.unlink(missing_ok=True)
        again, longest = [], 1.1 * cpu
        while not broken.exists():
            at = rng.uniform(0, longest) if killed < kills else float("inf")
            longest *= (
                1.1  # a resumed run reads and assembles too: it may never end within the time of a whole one
            )
            code = ended(forked(tmp_path, [*call, *(again or ["-o", broken])]), at)
            if code not in (0, -signal.SIGKILL):
                copy = (
                    FAILED_RUNS / f"{command}-{os.getpid()}"
                )  # for this does not come again under another load
                shutil.copytree(tmp_path, copy, dirs_exist_ok=True)
                words = (tmp_path / "streams").read_text()[-2000:]
                pytest.fail(f"kill {killed}, at {at:.4f} of {cpu:.4f} s: exit code {code}; {copy}: {words}")
            killed += code != 0
            resumed += bool(again)
            again = ["--resume", partial_file] if partial_file.exists() else []
        assert_equal_bits(expected, frames_of(broken))
        runs += 1
    if kills >= 100:
        assert resumed > kills / 4  # kills before the first frame start again
        assert runs > kills / 25  # else one run is all that is compared
        record_property("kills", f"{command}: {killed}, {resumed} resumes, {runs} runs of {cpu:.2f} s")
    assert not list(tmp_path.glob(".*"))
