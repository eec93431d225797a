"""`--dry-run` of every command: nothing is written, cost is predicted, and what cannot fit is refused."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.common.process import measured_command
from ddgcli import memory
from ddgcli.cli.forecast import check_cost, prediction
from ddgcli.cli.forecast.coefficients import COEFFICIENTS, PROBE_SECONDS
from ddgcli.cli.forecast.kernels import (
    CONTACT_STEPS,
    ITERATIONS_PER_LOAD_STEP,
    ITERATIONS_TO_REST,
    NOISY_MEMORY_SHARE,
    NOISY_SECONDS_SHARE,
    InputSize,
    Use,
    kernels_of,
)
from ddgcli.cli.forecast.prediction import predict
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh

MIB = 2.0**20
MEASURED_KERNELS = {name.removesuffix(" curve").removesuffix(" tetrahedra") for name in COEFFICIENTS}
SHELL = "--effect stretching --effect bending --effect gravity --material felt --set thickness=1e-3 --dt 1e-3"
CALLS = [
    "info {mesh} -o {out}.vtu",
    "curvature {mesh} -o {out}.vtu",
    "curvature {curve} -o {out}.vtu",
    "delaunay {mesh} -o {out}.npz",
    "laplacian {mesh} --poisson f -o {out}.vtu",
    "hodge {mesh} -o {out}.vtu",
    "dec {mesh} -o {out}.npz",
    "geodesic {mesh} --source 0 -o {out}.vtu",
    "repair {mesh} --for curvature -o {out}.ply",
    "willmore-flow {mesh} --steps 2 --dt 1e-9 -o {out}.vtkhdf",
    "curve-flow {curve} --steps 2 --dt 1e-9 -o {out}.vtkhdf",
    f"shell-sim {{mesh}} {SHELL} --steps 3 -o {{out}}.vtkhdf",
    "fluid-sim {mesh} --vorticity f --dt 1e-2 --steps 2 -o {out}.vtkhdf",
    "tradeoff geodesic {mesh} --source 0 -o {out}.csv",
    "view {mesh} -o {out}.html",
    "examples {out}",
]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return write_inputs(tmp_path_factory.mktemp("inputs"), shapes.random_sphere(120, 0), 60)


def write_inputs(folder, mesh, n_points):
    paths = {"mesh": folder / "mesh.npz", "curve": folder / "curve.npz"}
    write_mesh(str(paths["mesh"]), AnnotatedMesh(mesh, vertex={"f": mesh.points[:, 2].copy()}))
    angle = np.linspace(0, 2 * np.pi, n_points + 1)
    ellipse = np.stack([2 * np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    write_mesh(str(paths["curve"]), AnnotatedMesh(CurveSet.from_paths([ellipse])))
    return paths


def facts_of(summary):
    return summary.get("prediction") or summary["results"]


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.split()[0] + call.split()[1][:7])
def test_a_dry_run_predicts_and_writes_nothing(call, inputs, tmp_path, summary):
    words = call.format(**inputs, out=tmp_path / "out").split()
    facts = facts_of(summary(*words, "--dry-run"))
    assert list(tmp_path.iterdir()) == []
    assert facts["dry_run"] and facts["read_mib"] <= facts["peak_mib"] < facts["available_mib"]
    assert facts["seconds"] >= facts["read_seconds"] > 0
    assert all((row["mib"] is None) == (row["kernel"] not in MEASURED_KERNELS) for row in facts["kernels"])


def test_a_batch_and_a_check_predict_the_command_that_they_run(inputs, tmp_path, run, summary):
    def cost(*words):
        return json.loads(run("batch", inputs["mesh"], "--dry-run", "--json", *words).stdout)["results"]

    one = cost("--", "info")
    assert one["runs"] == 1 and one["peak_mib"] == one["largest_run"]["peak_mib"]
    many = cost("--jobs", 3, "--sweep", "radius=0.1,0.2,0.3,0.4", "--", "curvature")
    assert many["runs"] == 4 and many["peak_mib"] == 3 * many["largest_run"]["peak_mib"]
    (tmp_path / "a.json").write_text(json.dumps({"summary": {}, "run": ["info", str(inputs["mesh"])]}))
    checked = summary("check", tmp_path / "a.json", "--dry-run")["results"]
    assert [row["kernel"] for row in checked["kernels"]] == ["info"]


def test_memory_taken_after_a_prediction_counts_as_available(monkeypatch):
    size = InputSize("surface", 1000)
    cost = predict([Use("info")], size)
    monkeypatch.setattr(prediction, "available_memory", lambda: 600 * MIB)
    monkeypatch.setattr(prediction, "resident_memory", lambda: (400 * MIB, 500 * MIB))
    assert prediction.as_results(cost, size)["available_mib"] == 1000.0


def test_frames_predict_by_the_number_of_frames(inputs, tmp_path, summary):
    run = tmp_path / "run.vtkhdf"
    summary("curve-flow", inputs["curve"], "--steps", 4, "--dt", 1e-6, "--frame-every", 1e-6, "-o", run)
    rows = [
        summary("frames", run, "-o", tmp_path / "f_{:02d}.vtu", "--dry-run", *more)["results"]["kernels"]
        for more in ((), ("--every", 5))
    ]
    assert [row[0]["times"] for row in rows] == [5, 1]
    assert len(list(tmp_path.iterdir())) == 1


def test_a_run_that_cannot_fit_is_refused_in_one_line_before_it_starts(inputs, tmp_path, run, monkeypatch):
    monkeypatch.setattr(prediction, "available_memory", lambda: 0.1 * MIB)
    result = run("curvature", inputs["mesh"], "-o", tmp_path / "d.ply", "--dry-run")
    assert result.exit_code == 2 and result.stdout == ""
    assert result.stderr.startswith(f"Error: {inputs['mesh']}: curvature on 236 elements needs about")
    assert "use --scheme cotan" in result.stderr and result.stderr.count("\n") == 1
    assert not (tmp_path / "d.ply").exists()


@pytest.mark.parametrize(
    "call",
    [f"shell-sim {{mesh}} {SHELL}", "fluid-sim {mesh} --vorticity f --dt 1e-2"],
    ids=["shell", "fluid"],
)
def test_a_scene_that_cannot_fit_is_refused_in_one_line_before_it_starts(
    call, inputs, tmp_path, run, monkeypatch
):
    monkeypatch.setattr(prediction, "available_memory", lambda: 0.01 * MIB)
    # the process grows between the two runs, and the message says what is available
    monkeypatch.setattr(prediction, "resident_memory", lambda: (MIB, 2 * MIB))
    words = [*call.format(**inputs).split(), "--steps", 1, "-o", tmp_path / "a.vtkhdf"]
    refusal = run(*words, "--dry-run")
    assert refusal.exit_code == 2 and refusal.stdout == "" and refusal.stderr.count("\n") == 1
    assert refusal.stderr.startswith(f"Error: {inputs['mesh']}: {words[0]} on 236 elements needs about")
    monkeypatch.setattr(check_cost, "MIN_CHECKED_ELEMENTS", 1)
    assert run(*words).stderr == refusal.stderr and list(tmp_path.iterdir()) == []


def test_shell_steps_whose_factors_do_not_fit_are_predicted_with_conjugate_gradients(
    tmp_path, run, summary, monkeypatch
):
    path = tmp_path / "sheet.npz"
    write_mesh(str(path), AnnotatedMesh(shapes.grid(110, 110)))
    words = ("shell-sim", path, *SHELL.split(), "--steps", 3, "--dry-run")
    # without the peak of the tests before in this process
    monkeypatch.setattr(prediction, "resident_memory", lambda: (100 * MIB, 100 * MIB))

    def kernel(mib):
        monkeypatch.setattr(prediction, "available_memory", lambda: mib * MIB)
        return facts_of(summary(*words))["kernels"][-1]

    direct, iterative = kernel(1e4), kernel(200)
    assert direct["kernel"] == "shell-sim implicit step" and direct["mib"] > 200
    assert iterative["kernel"] == "shell-sim iterative implicit step" and iterative["mib"] < 200
    monkeypatch.setattr(prediction, "available_memory", lambda: 50 * MIB)
    monkeypatch.setattr(check_cost, "MIN_CHECKED_ELEMENTS", 1)
    refusal = run(*words[:-1])
    assert refusal.exit_code == 2 and "needs about" in refusal.stderr
    monkeypatch.setenv("DDGCLI_SOLVER", "conjugate-gradients")
    assert kernel(1e4)["kernel"] == iterative["kernel"]


def test_without_a_dry_run_only_large_inputs_are_checked(inputs, run, monkeypatch):
    monkeypatch.setattr(prediction, "available_memory", lambda: 0.1 * MIB)
    assert run("info", inputs["mesh"]).exit_code == 0
    monkeypatch.setattr(check_cost, "MIN_CHECKED_ELEMENTS", 200)
    assert run("info", inputs["mesh"]).exit_code == 2


def test_available_memory_follows_ulimit_and_the_container(tmp_path, monkeypatch):
    most, current = tmp_path / "max", tmp_path / "current"
    most.write_text(f"{3 * 2**20}\n")
    current.write_text(f"{2**20}\n")
    monkeypatch.setattr(memory, "CGROUP_FILES", ((str(most), str(current)),))
    assert memory.available_memory() == 2 * 2**20
    most.write_text("max\n")
    assert memory.available_memory() > 2**24
    if memory.resource is not None:
        size = memory._proc_value("/proc/self/status", "VmSize:") or 0.0
        monkeypatch.setattr(memory.resource, "getrlimit", lambda kind: (int(size + 7 * MIB), -1))
        assert memory.available_memory() <= 8 * MIB
        with pytest.raises(Exception, match="above"):
            memory.check_memory(9 * MIB, "rows", "use fewer")


def test_seconds_scale_with_the_probe_and_memory_does_not(monkeypatch):
    uses, size = [Use("delaunay")], InputSize("surface", 50_000)
    costs = []
    for factor in (1.0, 3.0):
        monkeypatch.setattr(prediction, "probe", lambda factor=factor: factor * PROBE_SECONDS)
        costs.append(predict(uses, size))
    seconds, mib = ([cost.kernels[0][key] for cost in costs] for key in ("seconds", "mib"))
    assert math.isclose(seconds[1], 3 * seconds[0]) and mib[0] == mib[1]


def test_options_change_what_is_predicted():
    size = InputSize("surface", 10_000, edge_length=0.1)

    def names(command, **options):
        return [use.kernel for use in kernels_of(command, options, size)]

    assert names("laplacian", eigen=8) == ["laplacian", "laplacian eigen"]
    assert names("laplacian", eigen=9)[-1] == "laplacian eigenpair"
    assert names("delaunay", refine=25.0, overlay="x") == ["delaunay", "delaunay refine", "delaunay overlay"]
    *_, ball, further = kernels_of("curvature", {"scheme": "quadric", "radius": 0.5}, size)
    assert further.kernel == "curvature further results"
    noise = Use("curvature noise", NOISY_SECONDS_SHARE, added=NOISY_MEMORY_SHARE)
    assert kernels_of("curvature", {"scheme": "cotan"}, size, full=False) == [noise, Use("curvature cotan")]
    assert ball.kernel == "curvature quadric radius" and math.isclose(ball.times, 25)
    loaded = InputSize("surface", 10_000, steps=11)
    rest = kernels_of("shell-sim", {"integrator": "static"}, loaded)[1:]
    assert [use.times for use in rest] == [ITERATIONS_TO_REST, 10 * ITERATIONS_PER_LOAD_STEP]
    assert kernels_of("shell-sim", {"integrator": "static"}, replace(loaded, steps=1))[1:] == rest[:1]
    analysed = kernels_of("shell-sim", {"modes": 20}, replace(loaded, steps=0))
    assert analysed == [Use("shell-sim"), Use("shell-sim modes", 2)]
    many = kernels_of("geodesic", {"method": "heat", "source": [1, 2], "each_source": True}, size)
    assert many[-1] == Use("geodesic heat solve", 2)


def test_a_run_of_unknown_length_has_a_range_of_seconds_and_others_have_none():
    def seconds(command, steps=None, adaptive=False, **options):
        kind = "curve" if command == "curve-flow" else "surface"
        size = InputSize(kind, 50_000, steps=steps, adaptive=adaptive)
        cost = predict(kernels_of(command, options, size), size)
        return (cost.seconds_range[0], cost.seconds, cost.seconds_range[1]), cost.kernels[-1]

    for known in (seconds("geodesic"), seconds("willmore-flow", 5, step=1e-6), seconds("fluid-sim", 5)):
        assert len(set(known[0])) == 1 and "times_range" not in known[1]
    for unknown in (
        seconds("shell-sim", 1, integrator="static"),
        seconds("willmore-flow"),
        seconds("willmore-flow", 5),
        seconds("curve-flow"),
        seconds("shell-sim", 5, contact=True),
        seconds("delaunay", refine=25.0),
    ):
        assert unknown[0][0] < unknown[0][1] < unknown[0][2]
        assert unknown[1]["times_range"][0] < unknown[1]["times"] < unknown[1]["times_range"][1]
    cost, step = seconds("fluid-sim", 5, adaptive=True)
    assert step["times"] == 5 and cost[1] < cost[2]


def test_the_range_of_seconds_is_printed_where_it_is_wide():
    facts = {"peak_mib": 1.0, "available_mib": 9.0, "seconds": 10.0}
    assert prediction.as_text({**facts, "seconds_range": [9.0, 12.0]})[1].endswith("10 s")
    assert "(1 to 50 s:" in prediction.as_text({**facts, "seconds_range": [1.0, 50.0]})[1]


def test_refinement_is_predicted_by_the_faces_with_small_angles(tmp_path, summary, monkeypatch):
    monkeypatch.setattr(prediction, "probe", lambda: PROBE_SECONDS)  # whatever else runs
    seconds = []
    for name, mesh in (("good", shapes.icosphere(3)), ("bad", shapes.random_sphere(642, 0))):
        write_mesh(str(tmp_path / f"{name}.npz"), AnnotatedMesh(mesh))
        rows = summary("delaunay", tmp_path / f"{name}.npz", "--refine", 25, "--dry-run")["results"][
            "kernels"
        ]
        seconds.append(rows[1]["seconds"])
    assert rows[1]["kernel"] == "delaunay refine" and seconds[0] < seconds[1]


def test_models_and_contact_of_a_shell_change_what_is_predicted(inputs, tmp_path, summary):
    scene = """
        [time]
        duration = 0.01
        step = 1e-3
        [[object]]
        name = "sheet"
        role = "shell"
        grid = {{ size = [1, 1], cells = [8, 8] }}
        position = [0, 0, 3]
        [[object]]
        name = "ball"
        role = "obstacle"
        {ball}
        [effects]
        bending = {{ model = "{model}" }}
        {contact}
    """
    pair = 'pairs = [["sheet", "ball"]]'
    sphere, mesh = "sphere = { center = [0, 0, 0], radius = 1 }", f'mesh = "{inputs["mesh"]}"'

    def times(ball, contact, model="hinge"):
        (tmp_path / "a.toml").write_text("\n".join(
            line.strip() for line in scene.format(ball=ball, contact=contact, model=model).splitlines()
        ))  # fmt: skip
        rows = facts_of(summary("shell-sim", tmp_path / "a.toml", "--dry-run"))["kernels"][1:]
        return {row["kernel"].removeprefix("shell-sim "): row["times"] for row in rows if row["seconds"]}

    assert times(sphere, "") == {"implicit step": 10}
    assert times(sphere, "", "midedge") == {"midedge step": 10}
    assert times(sphere, f"contact = {{ {pair} }}") == {"implicit step": 10 * CONTACT_STEPS}
    assert times(sphere, "contact = { self_contact = true }") == {"implicit step": 10, "pairs step": 10}
    both = times(mesh, f"contact = {{ {pair} }}")  # 128 faces meet 236
    assert both["pairs step"] == pytest.approx(10 * (128 + 236) / 128)


def test_a_mesh_of_many_parts_needs_smaller_factors_than_one_part():
    def mib(component, kernel="shell-sim implicit step"):
        size = InputSize("surface", 100_000, component_elements=component)
        return predict([Use(kernel)], size).kernels[0]["mib"]

    assert mib(4) < 0.6 * mib(100_000) and mib(None) == mib(100_000) < mib(10**6)
    assert mib(4, "shell-sim") == mib(None, "shell-sim")


@pytest.mark.parametrize(
    "call",
    [
        "fluid-sim {mesh} --vorticity f --dt 3",
        f"shell-sim {{mesh}} {SHELL.replace('--dt 1e-3', '--dt 1e-2')} --integrator verlet",
        f"shell-sim {{mesh}} {SHELL.replace('--dt 1e-3', '--dt 1e-2')} --integrator verlet --tolerance 1",
    ],
)
def test_a_dry_run_counts_the_divided_steps_of_explicit_schemes(call, inputs, summary):
    """The run itself takes as many, but for a change of the limit on the way."""
    words = [*call.format(**inputs).split(), "--steps", 1]
    step = facts_of(summary(*words, "--dry-run"))["kernels"][-1]
    n_steps = summary(*words)["results"]["steps"]
    assert step["kernel"].endswith(" step") and n_steps > 3
    assert n_steps / 2 <= step["times"] <= 2 * n_steps


MEASURED = {
    "info": "info {mesh} -o {out}.vtu",
    "curvature": "curvature {mesh} -o {out}.vtu",
    "delaunay": "delaunay {mesh}",
    "laplacian": "laplacian {mesh} --eigen 12",
    "poisson": "laplacian {mesh} --poisson f",
    "hodge": "hodge {mesh}",
    "dec": "dec {mesh} -o {out}.npz",
    "exact": "geodesic {mesh} --source 0",
    "heat": "geodesic {mesh} --source 0 --method heat",
    "fast-marching": "geodesic {mesh} --source 0 --method fast-marching",
    "repair": "repair {mesh} --for curvature",
    "willmore-flow": "willmore-flow {mesh} --steps 4 --dt 1e-9",
    "curve-flow": "curve-flow {curve} --steps 10 --dt 1e-9",
    "shell-sim": f"shell-sim {{mesh}} {SHELL} --pin 0 --steps 5",  # a free fall needs no factors
    "fluid-sim": "fluid-sim {mesh} --vorticity f --dt 1e-2 --steps 5",
    "view": "view {mesh} -o {out}.html",
}
MESHES = {
    "noisy sphere": (lambda: shapes.random_sphere(12_000, 3), 24_000),
    "torus": (lambda: shapes.torus(220, 100), 9_000),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MEASURED)
@pytest.mark.parametrize("shape", MESHES)
def test_peak_memory_and_seconds_are_within_half_of_the_prediction(name, shape, tmp_path):
    make, n_points = MESHES[shape]
    paths = write_inputs(tmp_path, make(), n_points)
    words = MEASURED[name].format(**paths, out=tmp_path / "out").split()
    dry, real = (measured_command([*words, "--json", *more], tmp_path) for more in (["--dry-run"], []))
    facts = facts_of(dry.summary)
    assert 0.5 <= facts["peak_mib"] / real.mib <= 1.5
    assert 0.5 <= facts["seconds"] / real.seconds <= 1.5


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
     "geodesic {flat} --source 0 --compare heat"],
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
    paths = {name: tmp_path / f"{name}.npz" for name in ("grid", "fin", "line", "flat")}
    call = words.format(**paths, out=tmp_path / "out").split()
    errors = [run(*call, *more) for more in ((), ("--dry-run",))]
    assert [error.exit_code for error in errors] == [2, 2]
    assert errors[0].stderr == errors[1].stderr


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
