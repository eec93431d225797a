"""A dry run checks what the run checks: the same refusals, and the names of arrays known before."""

import json

import numpy as np
import pytest

from ddgcli.cli.simulation import first_steps
from ddgcli.mesh import shapes


@pytest.mark.parametrize(
    "words",
    ["hodge {fin}", "dec {fin}", "willmore-flow {fin} --steps 1", "laplacian {grid} --fix 0=1",
     "curve-flow {grid}", "laplacian {grid} --harmonic", "laplacian {grid} --poisson missing",
     "curvature {grid} --resample 9", "curvature {grid} --map missing",
     "dec {grid} --wedge missing missing", "hodge {grid} --field missing",
     "geodesic {grid} --field missing", "delaunay {grid} --transfer missing",
     "repair {grid} --for frames", "willmore-flow {grid} --integrator missing",
     "repair {grid}", "repair {fin} --cut-to-disk", "info {line} -o {out}.off",
     "info {grid} --plot {out}.png --show missing", "info {grid} --colors missing -o {out}.ply",
     "curvature {grid} --plot {out}.png --show geodesic_distance", "curvature {grid} --offset 1",
     "curvature {grid} --region v", "geodesic {grid} --source 999999",
     "geodesic {grid} --source 0 --path-to -1",
     "geodesic {grid} --source-face 99:1,0,0", "geodesic {grid} --straighten 0,99",
     "geodesic {grid} --loop 3,3", "geodesic {grid} --curve 0", "geodesic {grid} --trace 9:1,0,0:1,0,0:1",
     "geodesic {grid} --trace 0:1,0,0:0,0,1:1", "geodesic {grid} --source 0 --spread-vector 0,0,1",
     "geodesic {grid} --source 0,1 --log-map", "geodesic {grid} --source 0,1 --fan 4 --fan-length 1",
     "geodesic {grid} --source 0 --target 99 --distance-matrix {out}.npz", "geodesic {grid} --field v",
     "geodesic {grid} --source 0 --plot {out}.png --show distance_gradient",
     "laplacian {grid} --eigen 99", "laplacian {grid} --harmonic --fix 99=1",
     "laplacian {grid} --heat 99 --duration 1",
     "laplacian {grid} --parameterize discrete-conformal --cone 0=90",
     "laplacian {fin} --parameterize harmonic",
     "laplacian {grid} --form-eigen 99", "hodge {grid} --plot {out}.png --show exact",
     "dec {grid} --interior-product v missing", "delaunay {grid} --refine 40",
     "delaunay {fin}", "willmore-flow {grid} --fix-volume", "willmore-flow {grid} --remesh-adaptive",
     "willmore-flow {grid} --region 99", "willmore-flow {grid} --fill 99",
     "willmore-flow {grid} -o {out}.vtkhdf -o {out}.h5", "curve-flow {line} --flow area-preserving",
     "shell-sim {grid} --pin 99 --effect stretching --set thickness=1e-3 --set young=1e6 --set density=1",
     "shell-sim {grid} --effect stretching --set thickness=1e-3 --set young=1e6 --set density=1 --dt 1e-3 "
     "--steps 1 --plot {out}.png --show missing",
     "dec {grid} --star circumcentric", "delaunay {flat}", "delaunay {flat} --refine 20",
     "laplacian {flat}", "laplacian {flat} --operator cotan", "laplacian {flat} --operator tufted",
     "hodge {flat} --basis", "geodesic {flat} --source 0 --method heat",
     "geodesic {flat} --source 0 --compare heat", "tradeoff shell-sim pendulum --conserved momentum",
     "geodesic {loose} --source 0 --field missing", "geodesic {pair} --source 1 --log-map --method heat",
     "geodesic {fin} --source 0 --method heat --operator intrinsic-delaunay",
     "geodesic {twice} --source 0 --method heat", "geodesic {flat} --source 0 --spread-vector 1,0,0",
     "geodesic {tiny} --source 0 --method heat", "geodesic {ball} --trace 0:1,0,0:1,0,0:1e12",
     "geodesic {ball} --source 0 --fan 4 --fan-length 1e12",
     "geodesic {grid} --trace 0:1,0,0:1,1,0:1e12 --at-boundary reflect"],
)  # fmt: skip
def test_a_dry_run_refuses_what_the_run_refuses(run, tmp_path, words):
    grid = shapes.grid(2, 2)
    fin = np.concatenate([grid.faces, [[*grid.faces[0, :2], 0]], grid.faces[:1]])
    field = np.zeros((len(grid.points), 3))
    np.savez(tmp_path / "grid.npz", points=grid.points, faces=grid.faces, v=field)
    np.savez(tmp_path / "fin.npz", points=grid.points, faces=fin)
    np.savez(tmp_path / "line.npz", points=grid.points[:3], lines=[[0, 1], [1, 2]])
    on_a_line = np.outer([0.3, 0.6, 0.9, 1.2], [1.0, 1.0, 0.0])
    np.savez(tmp_path / "flat.npz", points=on_a_line, faces=[[0, 1, 2], [1, 3, 2]])
    far = np.vstack([grid.points + 9, grid.points])  # vertex 0 belongs to no face
    np.savez(tmp_path / "loose.npz", points=far, faces=grid.faces + len(grid.points))
    np.savez(tmp_path / "pair.npz", points=grid.points, faces=[[0, 1, 4], [4, 7, 8], [0, 4, 3]])
    np.savez(tmp_path / "twice.npz", points=grid.points, faces=[*grid.faces, [0, 0, 1]])
    np.savez(tmp_path / "tiny.npz", points=1e-200 * grid.points, faces=grid.faces)
    ball = shapes.icosphere(0)
    np.savez(tmp_path / "ball.npz", points=ball.points, faces=ball.faces)
    names = ("grid", "fin", "line", "flat", "loose", "pair", "twice", "tiny", "ball")
    paths = {name: tmp_path / f"{name}.npz" for name in names}
    call = words.format(**paths, out=tmp_path / "out").split()
    errors = [run(*call, *more) for more in ((), ("--dry-run",))]
    assert [error.exit_code for error in errors] == [2, 2]
    assert errors[0].stderr == errors[1].stderr


def test_vertices_without_faces_change_no_dry_run(run, tmp_path):
    """Once a dry run began at the nearest of all vertices, and refused one without faces."""
    grid = shapes.grid(2, 2)
    points = np.vstack([[[0.1, 0.1, 0]], grid.points])
    np.savez(tmp_path / "a.npz", points=points, faces=grid.faces + 1)
    for words in ("--source-point 0.1,0.1,0 --tolerance 0.01 --certify", "--trace 0:1,0,0:1,1,0:1e12"):
        call = ("geodesic", tmp_path / "a.npz", *words.split())
        assert [run(*call, *more).exit_code for more in ((), ("--dry-run",))] == [0, 0]


@pytest.mark.parametrize(
    "words",
    ["info {grid} -o {out}.vtu --plot {out}.png",
     "curvature {grid} -o {out}.vtu --plot {out}.png --vertex-vectors",
     "curvature {line} --frames --resample 9 -o {out}.npz --plot {out}.png",
     "laplacian {grid} --eigen 2 --hks 1 --form-eigen 1 --smooth 1e-3 -o {out}.npz --plot {out}.png",
     "laplacian {grid} --parameterize discrete-conformal -o {out}.npz --plot {out}.png",
     "laplacian {grid} --wave 0 --duration 1 -o {out}.npz --plot {out}.png",
     "hodge {grid} --field w --basis -o {out}.npz --plot {out}.png",
     "hodge {grid} --field v -o {out}.npz --plot {out}.png",
     "geodesic {grid} --source 0 --each-source --gradient --voronoi --vertex-types --log-map --spread-vector "
     "1,0,0 -o {out}.npz --plot {out}.png",
     "repair {grid} --weld -o {out}.npz --plot {out}.png"],
)  # fmt: skip
def test_the_names_of_arrays_before_the_run_are_those_after_it(run, tmp_path, monkeypatch, words):
    from ddgcli.cli.run import Run

    names: dict[str, set[str]] = {}
    begin, array, write = Run.begin, Run.picture_array, Run.write_file

    def noted_begin(self, shown=None, written=None):
        names.update(shown=set(shown), written=set(written))
        begin(self, shown, written)

    def noted_array(self, arrays, default):
        names["of the picture"] = set(arrays)
        return array(self, arrays, default)

    def noted_write(self, path, annotated, **options):
        names["of the output"] = {*annotated.vertex, *annotated.face}
        write(self, path, annotated, **options)

    monkeypatch.setattr(Run, "begin", noted_begin)
    monkeypatch.setattr(Run, "picture_array", noted_array)
    monkeypatch.setattr(Run, "write_file", noted_write)
    grid = shapes.grid(3, 3)
    np.savez(tmp_path / "grid.npz", points=grid.points, faces=grid.faces, v=grid.points, f=grid.points[:, 0],
             w=np.ones(grid.topology.n_edges), edges=grid.topology.edges)  # fmt: skip
    np.savez(tmp_path / "line.npz", points=grid.points[:3], lines=[[0, 1], [1, 2]])
    paths = {name: tmp_path / f"{name}.npz" for name in ("grid", "line")}
    assert run(*words.format(**paths, out=tmp_path / "out").split()).exit_code in (0, 1)
    assert names["shown"] == names["of the picture"]
    assert names["written"] == names["of the output"]


BURST = """format = "ddgcli-scene/1"
[time]
step = 0.01
duration = 0.1
[[object]]
name = "balloon"
role = "shell"
sphere = { radius = 0.1, subdivisions = 0 }
young = 1e5
poisson = 0.3
thickness = 0.01
density = 10
[effects]
stretching = {}
gravity = { acceleration = [0, 0, 0] }
pressure = { value = 1e7 }
"""


def test_a_dry_run_of_a_scene_gives_its_warnings_and_one_of_long_first_steps(tmp_path, run, monkeypatch):
    """It collected them, and printed none."""
    monkeypatch.setattr(first_steps, "MAX_TRIAL_SECONDS", 0.0)
    path = tmp_path / "burst.toml"
    path.write_text(BURST)
    result = run("shell-sim", path, "--dry-run", "--json")
    strength, length = json.loads(result.stdout)["warnings"]
    assert "gravity on balloon has no strength" in strength and "first steps take long" in length
    assert result.stderr.splitlines() == [f"Warning: {strength}", f"Warning: {length}"]
