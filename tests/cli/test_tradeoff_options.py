"""`ddgcli tradeoff` takes every option that it names, and the command it prints reproduces the error."""

import json
import shlex

import numpy as np
import pytest

from ddgcli.cli.commands.tradeoff_options import COMPARABLE_OPTIONS
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from tests.simulate import HANGING_CLOTH

SHELL = ["--effect", "stretching", "--effect", "gravity acceleration=[0,0,-9.81]", "--pin", 0]
FLUID = ["--vorticity", "3*z+x*y"]
SHELL_TIME = ["--dt", 4e-3, "--steps", 2, "--tolerance", 1e-2, "--error", "time"]
FLUID_TIME = ["--dt", 0.05, "--steps", 2, "--tolerance", 1e-2, "--error", "time"]
FLOW_TIME = ["--steps", 3, "--tolerance", 1e-2, "--error", "time"]
FLOW_REFERENCE_STEPS = 16


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """One small input for each command."""
    folder = tmp_path_factory.mktemp("inputs")
    sphere, even = shapes.random_sphere(80), shapes.icosphere(1)
    meshes = {
        "sphere": sphere,
        "egg": even.moved(even.points * [1.0, 1.0, 1.2]),
        "sheet": shapes.grid(2, 2),
    }
    paths = {}
    for name, mesh in meshes.items():
        paths[name] = str(folder / f"{name} mesh.ply")  # a name that needs quotes in a shell
        write_mesh(paths[name], AnnotatedMesh(mesh))
    scene = folder / "sheet.toml"
    scene.write_text(HANGING_CLOTH.format(cells=2))
    return {
        "curvature": paths["sphere"],
        "delaunay": paths["sphere"],
        "laplacian": paths["sphere"],
        "geodesic": paths["sphere"],
        "willmore-flow": paths["egg"],
        "shell-sim": paths["sheet"],
        "fluid-sim": paths["sphere"],
    }


# command -> words of every call
COMMON_WORDS = {
    "shell-sim": [*SHELL, *SHELL_TIME],
    "fluid-sim": [*FLUID, *FLUID_TIME],
    "willmore-flow": FLOW_TIME,
    "delaunay": ["--refine", 15],  # the finer ones take their time
}


def every(rows, key, value):
    return bool(rows) and all(row["parameters"].get(key) == value for row in rows)


def methods(rows):
    return {row["method"] for row in rows}


def names(option):
    return lambda rows: all(option in row["command"] for row in rows)


def steps_of(row):
    words = shlex.split(row["command"])
    return round(float(words[words.index("--duration") + 1]) / row["parameters"]["dt"])


# command -> option's parameter -> (words, what must hold of the rows then, and does not without)
CASES = {
    "curvature": {
        "scheme": (["--scheme", "corrected"], lambda rows: methods(rows) == {"corrected"}),
        "radius": (["--radius", 0.5], names("--radius 0.5")),
    },
    "delaunay": {
        "refine": (
            ["--refine", 20],
            lambda rows: {r["parameters"].get("degrees") for r in rows} == {None, 20.0},
        ),
        "max_points": (["--max-points", 1], lambda rows: "refine" not in methods(rows)),
        "subdivide": (["--subdivide", 1], lambda rows: every(rows[1:], "subdivide", 1)),
    },
    "laplacian": {
        "eigen": (["--eigen", 3], names("--eigen 3")),
        "operator": (["--operator", "tufted"], lambda rows: methods(rows) == {"tufted"}),
        "mass": (["--mass", "voronoi"], lambda rows: every(rows, "mass", "voronoi")),
        "subdivide": (["--subdivide", 1], lambda rows: every(rows, "subdivide", 1)),
    },
    "geodesic": {
        "source": (["--source", 3, 9], names("--source 3 --source 9")),
        "source_point": (["--source-point", "0,0,1"], names("--source-point 0,0,1")),
        "source_face": (["--source-face", "3:0.2,0.3,0.5"], names("--source-face 3:0.2,0.3,0.5")),
        "method": (["--method", "heat"], lambda rows: methods(rows) == {"heat"}),
        "tolerance": (["--tolerance", 0.2], lambda rows: any(every([r], "tolerance", 0.2) for r in rows)),
        "operator": (["--operator", "tufted", "--method", "heat"], names("--operator tufted")),
        "heat_time": (["--heat-time", 2.0, "--method", "heat"], lambda rows: every(rows, "heat_time", 2.0)),
        "heat_refine": (["--heat-refine", 1, "--method", "heat"], lambda rows: every(rows, "heat_refine", 1)),
        "subdivide": (["--subdivide", 1], lambda rows: every(rows, "subdivide", 1)),
    },
    "shell-sim": {
        "effect_lines": (["--effect", "damping mass=9.0"], names("damping mass=9.0")),
        "pinned": (["--pin", 1], names("--pin 1")),
        "material": (["--material", "silk"], names("--material silk")),
        "settings": (["--set", "thickness='1 mm'"], names("--set")),
        "steps": (["--steps", 4], names("--duration 0.016")),
        "duration": (["--duration", 0.02], names("--duration 0.02")),
        "step": (["--dt", 8e-3], names("--duration 0.016")),
        "tolerance": (["--tolerance", 2e-3], lambda rows: rows[-1]["parameters"] == {"tolerance": 2e-3}),
        "integrator": (
            ["--integrator", "verlet"],
            lambda rows: methods(rows) == {"verlet", "verlet adaptive"},
        ),
        "model": (["--model", "stretching=edges"], names("--model stretching=edges")),
    },
    "fluid-sim": {
        "effect_lines": (["--effect", "viscosity nu=0.1"], names("--effect 'viscosity nu=0.1'")),
        "vorticity": (["--vorticity", "2*z"], names("'2*z'")),
        "flow": (["--flow", "vortex-pair"], names("--flow vortex-pair")),
        "viscosity": (["--viscosity", 0.2], names("--viscosity 0.2")),
        "steps": (["--steps", 4], names("--duration 0.2")),
        "duration": (["--duration", 0.15], names("--duration 0.15")),
        "step": (["--dt", 0.1], names("--duration 0.2")),
        "tolerance": (["--tolerance", 2e-3], lambda rows: rows[-1]["parameters"] == {"tolerance": 2e-3}),
        "integrator": (["--integrator", "circulation"], lambda rows: "conservative" not in methods(rows)),
        "model": (
            ["--viscosity", 0.2, "--model", "viscosity=bochner"], names("--model viscosity=bochner"),
        ),
    },
    "willmore-flow": {
        "flow": (["--flow", "mean-curvature"], names("--flow mean-curvature")),
        "energy": (["--energy", "cotan"], names("--energy cotan")),
        "boundary": (["--boundary", "fixed"], names("--boundary fixed")),
        "fix_area": (["--fix-area"], names("--fix-area")),
        "fix_volume": (["--fix-volume"], names("--fix-volume")),
        "steps": (["--steps", 5], lambda rows: steps_of(rows[0]) == 5),
        "duration": (["--duration", 2e-3], names("--duration 0.002")),
        "step": (["--dt", 1e-4], lambda rows: {1e-4, 5e-5} < {r["parameters"].get("dt") for r in rows}),
        "tolerance": (["--tolerance", 2e-3], lambda rows: rows[-1]["parameters"] == {"tolerance": 2e-3}),
        "integrator": (
            ["--integrator", "semi-implicit", "--budget", "300"], names("--integrator semi-implicit"),
        ),
    },
}  # fmt: skip
PAIRS = [(command, name) for command, cases in CASES.items() for name in cases]


def always(command, words):
    """The words of every call, without what this call replaces."""
    words_of_call = list(COMMON_WORDS.get(command, []))
    replaced = {"--duration": ["--steps"], "--flow": ["--vorticity"] if command == "fluid-sim" else []}
    for option in [w for w in words if str(w).startswith("--") and w != "--effect"]:
        for name in (option, *replaced.get(option, [])):
            while name in words_of_call:
                at = words_of_call.index(name)
                del words_of_call[at : at + 2]
    return words_of_call


@pytest.fixture(scope="module")
def compare(inputs):
    """Summary of a comparison; cached, so that calls without options run once.

    With a shorter reference of the flow, and each row once (`rows_run_once`).
    """
    from click.testing import CliRunner

    from ddgcli.cli.main import main
    from ddgcli.tradeoff.problems import willmore_flow

    cache = {}

    def call(command, *words):
        key = (command, *map(str, words))
        if key not in cache:
            line = ["tradeoff", command, inputs[command], *words, "--repeat", 1, "--json"]
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(willmore_flow, "REFERENCE_STEPS", (FLOW_REFERENCE_STEPS,))
                result = CliRunner().invoke(main, [str(w) for w in line], prog_name="ddgcli")
            assert result.exit_code == 0, result.output + result.stderr
            cache[key] = json.loads(result.stdout)
        return cache[key]

    return call


def test_every_comparable_option_has_a_case():
    assert {c: {*of_problem, *of_method} for c, (of_problem, of_method) in COMPARABLE_OPTIONS.items()} == {
        c: set(cases) for c, cases in CASES.items()
    }


@pytest.mark.parametrize("command, name", PAIRS)
def test_an_option_makes_its_difference(command, name, compare):
    words, holds = CASES[command][name]
    plain = compare(command, *COMMON_WORDS.get(command, []))["results"]["rows"]
    summary = compare(command, *always(command, words), *words)
    rows = summary["results"]["rows"]
    assert holds(rows) and not holds(plain)
    assert name in summary["options"]
    errors = [(r["method"], r["parameters"], r["max_error"]) for r in rows]
    assert name == "boundary" or errors != [(r["method"], r["parameters"], r["max_error"]) for r in plain]


@pytest.mark.parametrize(
    "command, words, message_part",
    [
        ("geodesic", ["--gradient"], "--gradient changes nothing that tradeoff geodesic compares; it takes"),
        ("geodesic", ["--eigen", 3], "No such option"),
        ("laplacian", ["--source", 3], "No such option"),
        ("laplacian", ["--budgett", 3], "--budget"),
        ("laplacian", ["--operator", "uniform"], "it uses no lengths"),
        ("geodesic", ["--source", 99999], "99999"),
        ("shell-sim", ["--truth", "sphere:1"], "--truth does not apply"),
        ("willmore-flow", ["--truth", "sphere:1"], "--truth does not apply"),
        ("curvature", ["--budget", 0], "0"),
        ("curvature", ["--error", "time"], "simulators and flows"),
    ],
)
def test_other_options_are_refused_in_one_line(command, words, message_part, inputs, run):
    result = run("tradeoff", command, inputs[command], *words)
    assert result.exit_code == 2 and message_part in result.stderr and result.stderr.count("\n") == 1


def test_a_command_without_input_is_refused(run):
    result = run("tradeoff", "geodesic", "--source", 1)
    assert result.exit_code == 2 and "needs an INPUT" in result.stderr


# ---------------------------------------------------------------- --within: run what it prints


def from_npz(path, name, n=None):
    with np.load(path, allow_pickle=False) as arrays:
        return arrays[name][:n]


def matrices(path):
    """Cotangent stiffness and lumped mass of an intrinsic triangulation, assembled here; its points."""
    from scipy.sparse import coo_array

    with np.load(path, allow_pickle=False) as arrays:
        faces, length, points = arrays["faces"], arrays["face_edge_lengths"], arrays["points"]
    a, b, c = length.T
    half = (a + b + c) / 2
    area = np.sqrt(half * (half - a) * (half - b) * (half - c))
    n, rows, columns, values = len(points), [], [], []
    for j in range(3):  # side j joins corners j and j+1; the cotangent of the corner opposite
        one, two, three = length[:, j], length[:, (j + 1) % 3], length[:, (j + 2) % 3]
        w = (two**2 + three**2 - one**2) / (8 * area)
        p, q = faces[:, j], faces[:, (j + 1) % 3]
        rows += [p, q, p, q]
        columns += [q, p, p, q]
        values += [-w, -w, w, w]
    L = coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (n, n)).tocsc()
    return L, np.bincount(faces.ravel(), np.repeat(area / 3, 3), n), points


def poisson_error(L, mass, points):
    """Error of L u = M x on the unit sphere, where u = x / 2, at the input's vertices."""
    from scipy.sparse.linalg import spsolve

    n = len(points)
    first = shapes.random_sphere(80).points
    low, high = first.min(axis=0), first.max(axis=0)
    axis = int((high - low).argmax())
    load = (points[:, axis] - (low + high)[axis] / 2) / (high - low)[axis]
    load, exact = mass * (load - (mass @ load) / mass.sum()), load[:80] / 2
    u = np.zeros(n)
    u[1:] = spsolve(L[1:, 1:], load[1:])
    u = u[:80] - u[:80].mean()
    exact = exact - exact.mean()
    return np.abs(u - exact).max() / np.abs(exact).max()


def delaunay_error(words, run, folder):
    """The error of the triangulation that a printed command makes, or of the input's own matrices."""
    from scipy.sparse import load_npz

    if words[1] == "laplacian":
        L, M = folder / "L.npz", folder / "M.npz"
        assert run(*words[1:], "--matrix", L, "--mass-matrix", M).exit_code == 0
        mass = load_npz(M) @ np.ones(80)
        return poisson_error(load_npz(L).tocsc(), mass, shapes.random_sphere(80).points)
    assert run(*words[1:], "-o", folder / "answer.npz").exit_code == 0
    return poisson_error(*matrices(folder / "answer.npz"))


def test_every_delaunay_row_has_the_error_of_its_command(compare, run, tmp_path):
    rows = compare("delaunay", "--truth", "sphere:1", *COMMON_WORDS["delaunay"])["results"]["rows"]
    assert len(rows) > 2
    for row in rows:
        error = delaunay_error(shlex.split(row["command"]), run, tmp_path)
        assert error == pytest.approx(row["max_error"], rel=1e-6)


def error_of(command, words, reference, run, folder):
    """The largest error of what a printed command writes, derived here."""
    out = folder / "answer.npz"
    target = [] if command in ("laplacian", "willmore-flow") else ["-o", out]

    def results(line):
        done = run(*line, *target, "--json")
        assert done.exit_code == 0, done.output + done.stderr
        return json.loads(done.stdout)["results"]

    if command == "delaunay":
        return delaunay_error(words, run, folder)
    answer = results(words[1:])
    sphere = shapes.random_sphere(80)
    if command == "geodesic":
        expected = np.arccos(np.clip(sphere.points @ sphere.points[0], -1, 1))
        return np.abs(from_npz(out, "geodesic_distance", 80) - expected).max() / expected.max()
    if command == "curvature":
        return np.abs(from_npz(out, "mean_curvature") - 1).max()
    if command == "laplacian":
        expected = np.array([0, 2, 2, 2, 6, 6, 6, 6.0])
        return (np.abs(np.array(answer["eigenvalues"]) - expected) / np.maximum(expected, 1)).max()
    if command == "willmore-flow":
        small = results(reference)["energy"][-1]
        return abs(answer["energy"][-1] - small) / small
    if command == "fluid-sim":
        answer = from_npz(out, "vorticity")
        results(reference)
        expected = from_npz(out, "vorticity")
        return np.abs(answer - expected).max() / np.abs(expected).max()
    answer = from_npz(out, "points")
    results(reference)
    expected = from_npz(out, "points")
    moved = np.linalg.norm(expected - shapes.grid(2, 2).points, axis=1).max()
    return np.linalg.norm(answer - expected, axis=1).max() / moved


# command -> (error bound, words; of a run: the words of the problem, and the steps of the reference)
WITHIN = {
    "curvature": (0.25, ["--truth", "sphere:1"], None),
    "delaunay": (0.07, ["--truth", "sphere:1", *COMMON_WORDS["delaunay"]], None),
    "laplacian": (0.11, ["--truth", "sphere:1"], None),
    "geodesic": (0.04, ["--truth", "sphere:1"], None),
    "shell-sim": (0.02, [*SHELL, *SHELL_TIME], (SHELL, 16)),
    "fluid-sim": (1e-3, [*FLUID, *FLUID_TIME], (FLUID, 16)),
    "willmore-flow": (1e-6, FLOW_TIME, ([], FLOW_REFERENCE_STEPS)),
}


@pytest.mark.parametrize("command", WITHIN)
def test_the_command_printed_for_within_reproduces_its_error(command, inputs, run, compare, tmp_path):
    within, words, small = WITHIN[command]
    results = compare(command, *words, "--within", within)["results"]
    cheapest = results["chosen"]
    good = [row for row in results["rows"] if row["max_error"] <= within]
    assert len(good) < len(results["rows"])  # or the bound excludes nothing
    assert cheapest["setup_seconds"] + cheapest["seconds"] == min(
        r["setup_seconds"] + r["seconds"] for r in good
    )
    line = shlex.split(cheapest["command"])
    reference = None
    if small is not None:
        at = line.index("--duration")
        problem_options, steps = small
        step = repr(float(line[at + 1]) / steps)
        reference = [command, inputs[command], *problem_options, "--dt", step, *line[at : at + 4]]
    error = error_of(command, line, reference, run, tmp_path)
    assert error == pytest.approx(cheapest["max_error"], rel=1e-4, abs=1e-10)
    assert error <= within
