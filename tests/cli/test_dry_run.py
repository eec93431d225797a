"""`--dry-run` of every command: nothing is written, cost is predicted, and what cannot fit is refused."""

import json
import re

import numpy as np
import pytest

from ddgcli.choices import ITERATIVE_SOLVERS
from ddgcli.cli.batch.tasks import Task
from ddgcli.cli.forecast import batch_cost, check_cost, prediction
from ddgcli.cli.forecast.coefficients import COEFFICIENTS, PROBE_SECONDS
from ddgcli.cli.forecast.simulator_kernels import CONTACT_STEPS, DAMPED_EXPLICIT_STEPS
from ddgcli.errors import ParameterError
from ddgcli.io.mesh_file import write_mesh
from ddgcli.linalg import backends
from ddgcli.mesh import shapes
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh
from tests.simulate import HANGING_CLOTH

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


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.split()[0] + call.split()[1][:7])
def test_a_dry_run_predicts_and_writes_nothing(call, inputs, tmp_path, summary):
    words = call.format(**inputs, out=tmp_path / "out").split()
    facts = summary(*words, "--dry-run")["results"]
    assert list(tmp_path.iterdir()) == []
    assert facts["dry_run"] and facts["read_mib"] <= facts["peak_mib"] < facts["available_mib"]
    assert facts["seconds"] >= facts["read_seconds"] > 0
    kernels = facts["kernels"]
    assert bool(kernels) == (words[0] != "examples")
    assert all((row["mib"] is None) == (row["kernel"] not in MEASURED_KERNELS) for row in kernels)


def test_a_batch_and_a_check_predict_the_command_that_they_run(inputs, tmp_path, run, summary):
    def cost(*words):
        return json.loads(run("batch", inputs["mesh"], "--dry-run", "--json", *words).stdout)["results"]

    one = cost("--", "info")
    assert one["runs"] == 1 and one["peak_mib"] == one["largest_run"]["peak_mib"]
    (tmp_path / "a.json").write_text(json.dumps({"summary": {}, "run": ["info", str(inputs["mesh"])]}))
    checked = summary("check", tmp_path / "a.json", "--dry-run")["results"]
    assert [row["kernel"] for row in checked["kernels"]] == ["info"]


@pytest.mark.parametrize("accepted", [1, 0])
def test_a_dry_run_of_a_batch_names_the_refused_runs_and_exits_as_the_run(accepted, inputs, tmp_path, run):
    """Two triangles of a book with a third page: `hodge` refuses the edge that three faces share."""
    book = tmp_path / "book.obj"
    book.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 -1 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n")
    words = ("batch", *[inputs["mesh"]] * accepted, book, "--jobs", 2, "--json")
    real = run(*words, "--", "hodge")
    row = json.loads(real.stdout)["results"]["rows"][accepted]
    dry = run(*words, "--dry-run", "--", "hodge")
    results = json.loads(dry.stdout)["results"]
    assert dry.exit_code == real.exit_code == 1
    assert results["runs"] == results["checked"] == accepted + 1 and results["refused"] == 1
    assert [(r["index"], r["input"]) for r in results["refused_runs"]] == [(accepted, str(book))]
    assert row["status"] == "failed" and row["message"] == f"Error: {results['refused_runs'][0]['message']}"
    assert ("seconds" in results) == bool(accepted)


def test_a_batch_adds_up_its_inputs_and_swept_values(tmp_path, monkeypatch):
    """Runs of one file size cost the same, runs between two sizes in proportion, a refused run none."""
    for name, size in (("a", 1000), ("b", 2000), ("c", 5000), ("refused", 9000)):
        (tmp_path / name).write_bytes(bytes(size))

    def facts(words):
        command, path, *option = words
        if path.endswith("refused"):
            raise ParameterError("not a manifold")
        mib, factor = (tmp_path / path).stat().st_size / 100, 10 if "--eigen" in option else 1
        return {
            "peak_mib": mib,
            "available_mib": 100.0,
            "seconds": factor * mib,
            "seconds_range": [0.0, 2 * mib],
        }

    monkeypatch.setattr(batch_cost, "dry_run_of", facts)
    monkeypatch.setattr(batch_cost.time, "process_time", lambda: 0.0)

    def cost(names, jobs=1, values=((),)):
        return batch_cost.batch_cost(
            [
                Task(0, str(tmp_path / name), dict.fromkeys(value, "9"), None, ("info", name, *value))
                for name in names
                for value in values
            ],
            jobs,
        )

    assert cost("abc")["seconds"] == pytest.approx(10 + 20 + 50)
    assert cost("abc")["seconds_range"] == pytest.approx([0, 2 * (10 + 20 + 50)])
    assert cost("abc")["peak_mib"] == 50 and cost("abc", 2)["peak_mib"] == pytest.approx(50 + 20)
    assert cost("aab", 8, [(), ("--eigen",)])["seconds"] == pytest.approx(11 * (10 + 10 + 20))
    assert cost(["a", "refused"])["largest_run"]["peak_mib"] == 10
    with pytest.raises(ParameterError, match="manifold"):
        cost(["refused"])
    monkeypatch.setattr(batch_cost, "MAX_DRY_RUNS", 2)
    tasks = [
        Task(i, f"{tmp_path / name}", {}, None, ("info", name))
        for i, name in enumerate(("a", "b", "refused", "c"))
    ]
    checked = batch_cost.dry_runs(tasks, 2)
    results, text = batch_cost.with_refused_runs(batch_cost.batch_cost(tasks, 1, checked), tasks, checked)
    assert (
        results["runs"] == 4 and results["refused"] == 1 and results["seconds"] == pytest.approx(10 + 20 + 50)
    )
    assert text[0].split() == ["refused", "1", "of", "2", "checked"]
    batch_cost.refuse_batch(cost("ccc", 3), 3)
    with pytest.raises(ParameterError, match="4 runs at a time need about 0.195 GiB.* use fewer --jobs"):
        batch_cost.refuse_batch(cost("cccc", 4), 4)


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
    monkeypatch.setattr(prediction, "available_memory", lambda enough=0: 0.1 * MIB)
    result = run("curvature", inputs["mesh"], "-o", tmp_path / "d.ply", "--dry-run")
    assert result.exit_code == 2 and result.stdout == ""
    assert result.stderr.startswith(f"Error: {inputs['mesh']}: curvature on 236 elements needs about")
    assert "use --scheme cotan" in result.stderr and result.stderr.count("\n") == 1
    assert not (tmp_path / "d.ply").exists()


@pytest.mark.parametrize("scheme", ["quadric", "normal-voting", "corrected"])
@pytest.mark.parametrize("radius", [9.0, 1e300])
def test_a_dry_run_refuses_a_radius_beyond_the_surface_as_the_run_does(scheme, radius, inputs, run):
    words = ["curvature", inputs["mesh"], "--scheme", scheme, "--radius", radius]
    refusal = run(*words)
    assert refusal.exit_code == 2 and "holds the whole surface" in refusal.stderr
    assert run(*words, "--dry-run").stderr == refusal.stderr


@pytest.mark.parametrize(
    "call", [call for call in CALLS if not call.startswith("examples")], ids=lambda call: call.split()[0]
)
def test_every_command_refuses_what_cannot_fit(call, inputs, tmp_path, run, monkeypatch):
    monkeypatch.setattr(prediction, "available_memory", lambda enough=0: 1e-6 * MIB)
    monkeypatch.setattr(prediction, "resident_memory", lambda: (MIB, 2 * MIB))
    monkeypatch.setattr(check_cost, "MIN_CHECKED_ELEMENTS", 1)
    words = call.format(**inputs, out=tmp_path / "out").split()
    refusal = run(*words)
    assert refusal.exit_code == 2 and refusal.stdout == "" and refusal.stderr.count("\n") == 1
    assert f"{words[0]} on " in refusal.stderr and " needs about " in refusal.stderr
    assert run(*words, "--dry-run").stderr == refusal.stderr and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "call",
    [f"shell-sim {{mesh}} {SHELL}", "fluid-sim {mesh} --vorticity f --dt 1e-2"],
    ids=["shell", "fluid"],
)
def test_a_scene_that_cannot_fit_is_refused_in_one_line_before_it_starts(
    call, inputs, tmp_path, run, monkeypatch
):
    monkeypatch.setattr(prediction, "available_memory", lambda enough=0: 0.01 * MIB)
    # the process grows between the two runs, and the message states what is available
    monkeypatch.setattr(prediction, "resident_memory", lambda: (MIB, 2 * MIB))
    words = [*call.format(**inputs).split(), "--steps", 1, "-o", tmp_path / "a.vtkhdf"]
    refusal = run(*words, "--dry-run")
    assert refusal.exit_code == 2 and refusal.stdout == "" and refusal.stderr.count("\n") == 1
    assert refusal.stderr.startswith(f"Error: {inputs['mesh']}: {words[0]} on 236 elements needs about")
    monkeypatch.setattr(check_cost, "MIN_CHECKED_ELEMENTS", 1)
    assert run(*words).stderr == refusal.stderr and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("analysis", ["--buckling", "--modes"])
def test_an_analysis_predicts_no_steps_of_the_integrator(analysis, inputs, tmp_path, summary):
    path = tmp_path / "scene.toml"
    path.write_text(
        '[time]\nstep = 1e-3\nintegrator = "symplectic-euler"\n[[object]]\nname = "s"\nrole = "shell"\n'
        f'mesh = "{inputs["mesh"]}"\nmaterial = "felt"\n'
        "[effects]\nstretching = {}\nbending = {}\ngravity = {}\npin = { vertices = [0, 1, 2] }\n"
    )
    rows = {
        row["kernel"]: row
        for row in summary("shell-sim", path, analysis, 2, "--dry-run")["results"]["kernels"]
    }
    assert rows["shell-sim explicit step"]["seconds"] == 0 < rows[f"shell-sim {analysis[2:]}"]["seconds"]


def test_the_text_of_a_simulators_dry_run_ends_with_its_memory_and_time(inputs, run):
    text = run("shell-sim", inputs["mesh"], *SHELL.split(), "--steps", 1, "--dry-run").stdout
    scene, end = text.split("\nassembled\n")
    assert json.loads(scene)["object"][0]["role"] == "shell"
    assert re.search(r"\n  integrator  \S+\n", "\n" + end) and "{" not in end
    assert re.search(r"\nresults\n  peak memory  \d+ MiB of \d+ MiB available\n  CPU time     \S+ s", end)


@pytest.mark.parametrize("command", ["curvature", "shell-sim"])
def test_the_full_text_of_a_dry_run_has_the_kernels(command, inputs, run, summary):
    words = [command, inputs["mesh"], *(SHELL.split() if command == "shell-sim" else ()), "--dry-run"]
    names = [row["kernel"] for row in summary(*words)["results"]["kernels"]]
    short, full = run(*words).stdout, run(*words, "--full").stdout
    rows = re.findall(r"^ +(\S.*?)  +[\d.e-]+ s +[\d.e+]+ MiB", full.split("\n  kernels\n")[1], re.MULTILINE)
    assert rows == names and "kernels" not in short


def test_a_dry_run_of_shells_predicts_the_solver_that_the_run_chooses(tmp_path, run, summary, monkeypatch):
    """Both decide by the pattern of the Hessians and the memory that is available."""
    path = tmp_path / "sheet.npz"
    write_mesh(str(path), AnnotatedMesh(shapes.grid(110, 110)))
    words = ("shell-sim", path, *SHELL.split(), "--pin", 0, "--steps", 1)
    # without the peak of the tests before in this process
    monkeypatch.setattr(prediction, "resident_memory", lambda: (100 * MIB, 100 * MIB))

    def kernel(mib):
        for module in (prediction, backends):
            monkeypatch.setattr(module, "available_memory", lambda enough=0: mib * MIB)
        return summary(*words, "--dry-run")["results"]["kernels"][-1]

    # the measured peak of factors, 270 MiB, fits into both; the run's estimate with the matrix is 338 MiB
    direct, iterative = kernel(360), kernel(320)
    assert direct["kernel"] == "shell-sim implicit step" and 250 < direct["mib"] < 320
    assert iterative["kernel"] == "shell-sim iterative implicit step" and iterative["mib"] < 200
    low, high = (row["times_range"][0] for row in (iterative, direct))
    assert low < 0.2 * high  # by the length of the step
    assert summary(*words)["accuracy"]["step_solver"] in ITERATIVE_SOLVERS
    kernel(360)
    assert "step_solver" not in summary(*words)["accuracy"]
    monkeypatch.setattr(prediction, "available_memory", lambda enough=0: 50 * MIB)
    monkeypatch.setattr(check_cost, "MIN_CHECKED_ELEMENTS", 1)
    refusal = run(*words)
    assert refusal.exit_code == 2 and "needs about" in refusal.stderr
    monkeypatch.setenv("DDGCLI_SOLVER", "conjugate-gradients")
    assert kernel(1e4)["kernel"] == iterative["kernel"]


def test_without_a_dry_run_only_large_inputs_are_checked(inputs, run, monkeypatch):
    monkeypatch.setattr(prediction, "available_memory", lambda enough=0: 0.1 * MIB)
    assert run("info", inputs["mesh"]).exit_code == 0
    monkeypatch.setattr(check_cost, "MIN_CHECKED_ELEMENTS", 200)
    assert run("info", inputs["mesh"]).exit_code == 2


def test_a_dry_run_of_curves_counts_them_and_the_steps_of_the_field(inputs, tmp_path, summary):
    words = ("geodesic", inputs["mesh"], "--source", "0,5", "--path-to", "3,4", "--isolines", 7)
    steps = ("--field", "wind", "--field-time", 2, "--field-step", 0.1, "--paths-output", tmp_path / "a.vtp")
    np.save(tmp_path / "wind.npy", np.tile([1.0, 0.0, 0.0], (120, 1)))
    steps = [str(tmp_path / "wind.npy") if word == "wind" else word for word in steps]
    rows = {row["kernel"]: row for row in summary(*words, *steps, "--dry-run")["results"]["kernels"]}
    assert rows["geodesic path"]["times"] == 2 and rows["geodesic level"]["times"] == 7
    assert rows["geodesic field round"]["times"] == 30 and rows["geodesic field step"]["elements"] == 60
    assert rows["write curves"]["added"] < 1 and not (tmp_path / "a.vtp").exists()


def test_refinement_is_predicted_by_the_faces_with_small_angles(tmp_path, summary, monkeypatch):
    monkeypatch.setattr(prediction, "probe", lambda: PROBE_SECONDS)  # whatever else runs
    seconds = []
    for name, mesh in (("good", shapes.icosphere(3)), ("bad", shapes.random_sphere(642, 0))):
        write_mesh(str(tmp_path / f"{name}.npz"), AnnotatedMesh(mesh))
        rows = summary("delaunay", tmp_path / f"{name}.npz", "--refine", 25, "--dry-run")["results"][
            "kernels"
        ]
        seconds.append(rows[2]["seconds"])
    assert rows[2]["kernel"] == "delaunay refine" and seconds[0] < seconds[1]


def test_triangulations_compared_are_predicted_by_the_faces_with_small_angles(tmp_path, summary, monkeypatch):
    """They took 3 s of a random sphere of 2,000 faces and 0.8 of a torus; both were predicted alike."""
    monkeypatch.setattr(prediction, "probe", lambda: PROBE_SECONDS)  # whatever else runs
    seconds = []
    for name, mesh in (("sphere", shapes.random_sphere(1000)), ("torus", shapes.torus(40, 25))):
        write_mesh(str(tmp_path / f"{name}.npz"), AnnotatedMesh(mesh))
        call = ("tradeoff", "delaunay", tmp_path / f"{name}.npz", "--budget", "20", "--dry-run")
        rows = {row["kernel"]: row for row in summary(*call)["results"]["kernels"]}
        seconds.append(rows["tradeoff delaunay"]["seconds"])
    assert 3.0 < seconds[0] / seconds[1] < 4.5


def test_flows_compared_are_predicted_as_runs_in_time_within_the_budget(tmp_path, summary, monkeypatch):
    """They counted flips, as of flows to rest; a short budget leaves fine meshes out: less memory."""
    monkeypatch.setattr(prediction, "probe", lambda: PROBE_SECONDS)  # whatever else runs
    monkeypatch.setattr(prediction.time, "process_time", lambda: 0.5)  # of a process that has just begun
    write_mesh(str(tmp_path / "sphere.npz"), AnnotatedMesh(shapes.icosphere(4)))
    short, long = (
        summary("tradeoff", "willmore-flow", tmp_path / "sphere.npz", "--budget", seconds, "--dry-run")
        for seconds in (10, 1000)
    )
    assert [row["kernel"] for row in long["results"]["kernels"]] == [
        "willmore-flow", "willmore-flow quadratic step", "tradeoff willmore-flow",
    ]  # fmt: skip
    memory = [call["results"]["kernels"][2]["mib"] for call in (short, long)]
    assert memory[0] < 0.7 * memory[1]
    assert short["results"]["seconds"] == pytest.approx(10, abs=3)
    assert long["results"]["seconds"] > 50


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
        rows = summary("shell-sim", tmp_path / "a.toml", "--dry-run")["results"]["kernels"]
        rows = [row for row in rows if row["kernel"].endswith(" step") and row["seconds"]]
        return {row["kernel"].removeprefix("shell-sim "): row["times"] for row in rows}

    (steps,) = times(sphere, "").values()  # in those of the first, whose iterations are fewer
    assert 10 < steps < 20
    assert times(sphere, "", "midedge") == {"midedge step": steps}
    assert times(sphere, f"contact = {{ {pair} }}") == {"implicit step": 10 * CONTACT_STEPS}
    assert times(sphere, "contact = { self_contact = true }") == {"implicit step": steps, "pairs step": 10}
    ranges = []  # of limp shells, which collapse where they strike, the upper end is far
    for limp in (True, False):
        times(sphere, f"contact = {{ {pair} }}" + "\nstretching = {}" * (not limp))
        row = summary("shell-sim", tmp_path / "a.toml", "--dry-run")["results"]["kernels"][-1]
        assert ("resists collapse" in row["assumes"]) == limp
        ranges.append(row["times_range"][1] / row["times"])
    assert ranges[0] > 10 * ranges[1]
    both = times(mesh, f"contact = {{ {pair} }}")  # 128 faces meet 236
    row = summary("shell-sim", tmp_path / "a.toml", "--dry-run")["results"]["kernels"][-1]
    low, high = np.divide(row["times_range"], row["times"])
    assert row["kernel"].endswith("pairs step") and low < 0.5 and high > 7  # plates that collide: 7 times
    assert both["pairs step"] == pytest.approx(10 * (128 + 236) / 128)


@pytest.mark.parametrize(
    "call",
    [
        "fluid-sim {mesh} --vorticity f --dt 3 --steps 1",
        f"shell-sim {{mesh}} {SHELL.replace('--dt 1e-3', '--dt 1e-2')} --integrator verlet --steps 1",
        f"shell-sim {{mesh}} {SHELL.replace('--dt 1e-3', '--dt 1e-2')} --integrator verlet "
        "--tolerance 1 --duration 1e-2",
    ],
)
def test_a_dry_run_counts_the_divided_steps_of_explicit_schemes(call, inputs, summary):
    """The run itself takes as many, but for a change of the limit on the way."""
    words = call.format(**inputs).split()
    step = summary(*words, "--dry-run")["results"]["kernels"][-1]
    n_steps = summary(*words)["results"]["steps"]
    assert step["kernel"].endswith(" step") and n_steps > 3
    assert n_steps / 2 <= step["times"] <= 2 * n_steps


def test_a_dry_run_counts_the_damping_by_stiffness_of_explicit_steps(tmp_path, summary):
    """Once free: on 9,800 faces 2.0 s and 90 MiB were predicted, and the run took 4.7 s and 153 MiB."""
    text = HANGING_CLOTH.format(cells=4).replace("step = 4e-3", 'step = 4e-5\nintegrator = "verlet"')

    def times(effect):
        (tmp_path / "a.toml").write_text(text + effect)
        *others, row = summary("shell-sim", tmp_path / "a.toml", "--dry-run")["results"]["kernels"]
        assert row["kernel"] == "shell-sim explicit step"
        kernels = {other["kernel"] for other in others}  # whose matrices are assembled
        assert ("shell-sim assembly" in kernels) == ("stiffness" in effect)
        return row["times"]

    assert times("damping = { mass = 1 }") == times("")
    assert times("damping = { stiffness = 1e-12 }") == pytest.approx(
        DAMPED_EXPLICIT_STEPS * times(""), rel=0.01
    )


def test_a_dry_run_counts_the_evaluations_of_asynchronous_steps(tmp_path, summary):
    """Elements act 2^k times in a step, those of a graded mesh by far not all as often as the smallest."""
    graded = shapes.grid(12, 12)
    path = tmp_path / "graded.npz"
    write_mesh(str(path), AnnotatedMesh(graded.moved(graded.points**2)))
    words = ("shell-sim", path, *SHELL.split(), "--integrator", "avi", "--steps", 2)
    times = summary(*words, "--dry-run")["results"]["kernels"][-1]["times"]
    effects = summary(*words)["results"]["effects"]
    calls = max(effects[name]["evaluations"] for name in ("stretching", "bending"))
    assert 8 < times < 0.8 * calls  # the calls are those of batches of elements


def test_a_flow_of_a_stated_duration_counts_the_steps_of_its_schedule(run, tmp_path):
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    path = tmp_path / "circle.csv"
    np.savetxt(path, np.stack([np.cos(turn), np.sin(turn)], axis=1), delimiter=",", header="x,y", comments="")
    until = ("curve-flow", str(path), "--duration", "0.02")
    steps = json.loads(run(*until, "--json").stdout)["results"]["stopped_because"].split()[0]

    def step(*words):
        rows = json.loads(run(*words, "--dry-run", "--json").stdout)["results"]["kernels"]
        return next(row for row in rows if "step" in row["kernel"])

    assert step(*until)["times"] == int(steps) and "times_range" not in step(*until)
    at_rest = step("curve-flow", str(path))
    assert at_rest["times_range"][1] == 2000 and at_rest["assumes"]
