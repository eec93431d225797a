"""Every command ends at a signal at any moment: its outputs are whole or absent, nothing else stays.

`pytest -m slow tests/cli/test_random_signals.py` sends each command many signals.
"""

import csv
import io
import json
import random
import re
import shutil
import signal
import sys

import numpy as np
import pytest

from benchmarks.hardcases.run import preload
from ddgcli.cli.main import COMMANDS
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from tests.cli.children import ended, ended_after, forked
from tests.cli.test_shell_resume import assert_equal_bits, frames_of
from tests.simulate import FALLING_CLOTH, scene_file

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads the processor clock of a child")

SIMULATORS = {
    "shell-sim": "scene.toml",
    "fluid-sim": "s.ply --vorticity 5*z+x*y --steps 8 --dt 0.02",
    "willmore-flow": "s.ply --steps 3",
    "curve-flow": "c.csv --steps 30 --dt 1e-3",
}
CALLS = {
    "info": "s.ply -o o.ply",
    "repair": "s.ply --weld -o o.stl -o o.obj",
    "curvature": "s.ply -o o.ply -o o.xdmf",
    "delaunay": "s.ply --refine 25 -o o.npz",
    "laplacian": "s.ply --eigen 5 -o o_.vtkhdf",
    "dec": "s.ply -o o.npz",
    "hodge": "t.npz --field wind --basis -o o.vtu",
    "geodesic": "s.ply --source 0 -o o.vtp --plot o.png --size 200x200",
    **{name: f"{words} -o o.vtkhdf" for name, words in SIMULATORS.items()},
    "tradeoff": "curvature tiny.ply --truth sphere:1 --budget 10000 -o o.csv",
    "frames": "run.vtkhdf -o o_{:02d}.ply",
    "view": "s.ply -o o.html",
    "batch": "s.ply --table o.jsonl -o o_{stem}.ply -- info",
    "examples": "o",
    "check": "o.json --update -- info s.ply",
}
NUMBERS = (signal.SIGINT, signal.SIGTERM)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    preload()
    folder = tmp_path_factory.mktemp("inputs")
    write_mesh(str(folder / "s.ply"), AnnotatedMesh(shapes.icosphere(2)))
    write_mesh(str(folder / "tiny.ply"), AnnotatedMesh(shapes.icosphere(0)))
    torus = shapes.torus(10, 6)
    wind = np.cross(torus.points[torus.faces].mean(axis=1), [0, 0, 1.0])
    write_mesh(str(folder / "t.npz"), AnnotatedMesh(torus, face={"wind": wind}))
    angle = np.linspace(0, 2 * np.pi, 41)
    np.savetxt(folder / "c.csv", np.column_stack([np.cos(angle), 2 * np.sin(angle)]), delimiter=",")
    scene = FALLING_CLOTH.replace("[5, 5]", "[3, 3]").replace("duration = 0.1", "duration = 0.03")
    scene_file(folder, text=scene)
    assert ended(forked(folder, ["shell-sim", "scene.toml", "-o", "run.vtkhdf"])) == 0
    (folder / "streams").unlink()
    return folder


def content(path):
    """What a file holds, without what differs between two runs, such as seconds; fails on a torn file."""
    data = path.read_bytes()
    if path.parent.name.startswith("sample_"):
        return data
    kind = path.name.removesuffix(".part").rpartition(".")[2]
    if kind == "vtkhdf" and not path.name.startswith("o_"):
        return frames_of(path)
    if kind in ("json", "jsonl"):
        return [sorted(json.loads(line)) for line in ([data] if kind == "json" else data.splitlines())]
    if kind == "csv":  # an interrupted `tradeoff` keeps its rows
        rows = list(csv.reader(io.StringIO(data.decode())))
        assert data.endswith(b"\n") and {len(row) for row in rows} == {len(rows[0])}
        return rows[0]
    if kind == "npz":
        with np.load(path) as arrays:
            return {name: arrays[name].shape for name in arrays.files}
    ends = {"png": b"IEND\xaeB`\x82", "html": b"</html>\n"}
    if kind in ends:
        assert data.endswith(ends[kind])
        return kind
    mesh = read_mesh(str(path))
    return mesh.mesh.points.tobytes(), mesh.mesh.faces.tobytes(), sorted(mesh.vertex), sorted(mesh.face)


def files_of(folder):
    return {str(p.relative_to(folder)): p for p in folder.rglob("*") if p.is_file() and p.name != "streams"}


def fault_of(folder, code, number, inputs, whole):
    """What is wrong with the folder after a run that got a signal; empty where nothing is."""
    streams = folder / "streams"
    text = streams.read_text() if streams.exists() else ""
    if code not in (0, 1, 128 + number, -number) or "Traceback" in text or "ignored" in text:
        return f"exit code {code}: {text[-500:]}"
    if code == 1 and not re.search(r"^(Error|Warning): ", text, re.M):
        return f"exit code 1 without a reason: {text[-500:]}"
    for name, path in files_of(folder).items():
        if name in inputs:
            continue
        if name.endswith(".part"):
            if name == "o.jsonl.part":
                content(path)
            else:
                rows = content(path)
                assert_equal_bits(rows, whole["o.vtkhdf"][: len(rows)])
        elif name not in whole:
            return f"{name} is left"
        elif name == "o.vtkhdf":
            assert_equal_bits(content(path), whole[name])
        elif content(path) != whole[name]:
            return f"{name} is not whole"
    return ""


def test_every_command_is_tested():
    assert set(CALLS) == set(COMMANDS)


@pytest.mark.parametrize(
    "moments", [2, pytest.param(30, marks=[pytest.mark.slow, pytest.mark.timeout(1800)])]
)
@pytest.mark.parametrize("command", CALLS)
def test_signals_at_any_moment_leave_whole_files_only(inputs, tmp_path, command, moments, record_property):
    words = [command, *CALLS[command].split()]
    folder = tmp_path / "whole"
    shutil.copytree(inputs, folder)
    names_of_inputs = set(files_of(folder))
    code, seconds = ended_after(forked(folder, words))
    assert code == 0, (folder / "streams").read_text()
    whole = {name: content(path) for name, path in files_of(folder).items() if name not in names_of_inputs}
    assert whole
    rng, codes = random.Random(f"{command} {moments}"), []
    for k in range(moments):
        folder = tmp_path / str(k)
        shutil.copytree(inputs, folder)
        number, at = NUMBERS[k % 2], rng.uniform(0, seconds)
        code = ended(forked(folder, words), at, number)
        assert not (fault := fault_of(folder, code, number, names_of_inputs, whole)), (
            f"moment {k}, at {at:.4f} s: {fault}"
        )
        codes.append(code)
        shutil.rmtree(folder)
    record_property("codes", f"{command}: {codes} in {seconds:.2f} s")
    if moments > 10:
        assert sum(code > 128 for code in codes) > moments / 4  # else the moments are beside the run
