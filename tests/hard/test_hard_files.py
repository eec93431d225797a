"""Every defective or extreme file through every command: an answer or one line, never more, never less.

To bring a command in, add a row to COMMANDS.
"""

import contextlib
import json
import math
from pathlib import Path

import numpy as np
import pytest

from ddgcli.cli.main import COMMANDS as PROGRAM_COMMANDS
from ddgcli.errors import InputError
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

SHARED = Path(__file__).parents[3] / "shared" / "meshes"
HARD = SHARED / "hard"
# command -> words after the input (VERTEX is one that a face uses); each also gets an output and --json
COMMANDS: dict[str, list[str]] = {
    "info": [],
    "curvature": [],
    "delaunay": [],
    "laplacian": ["--eigen", "2"],
    "hodge": [],
    "geodesic": ["--source", "VERTEX"],
    "shell-sim": ["--effect", "stretching", "--effect", "bending", "--steps", "2", "--dt", "1e-3"],
    "fluid-sim": ["--vorticity", "x+0.3*y*z", "--steps", "2", "--dt", "1e-3", "--integrator", "circulation"],
    "willmore-flow": ["--steps", "3"],
    "repair": ["--drop-unused"],
    "dec": [],
}
# compared command -> words after the input
COMPARISONS: dict[str, list[str]] = {
    "curvature": [],
    "delaunay": [],
    "laplacian": ["--eigen", "2"],
    "geodesic": ["--source", "VERTEX"],
    "willmore-flow": [],
}
# (command, file) whose result is right but too large for the time limit: 117 million entries of a Laplacian
TOO_LARGE = {("dec", "gen_fan_high_valence.ply")}
pytestmark = pytest.mark.timeout(30)  # a reader that hangs must not hang the suite


def hard_files() -> list[Path]:
    names = sorted(p for p in HARD.glob("*") if p.suffix not in (".md", ".json")) if HARD.is_dir() else []
    return names or [
        pytest.param(Path("missing"), marks=pytest.mark.skip("../shared/meshes/hard is missing"))
    ]


def expectations() -> dict:
    return json.loads((HARD / "EXPECT.json").read_text(encoding="utf-8")) if HARD.is_dir() else {}


def assert_honest(result, path: Path, output: Path) -> None:
    """Exit 0, 1 or 2; one line when refused, strict JSON otherwise; no NaN in what was written."""
    assert result.exit_code in (0, 1, 2), result.stderr
    assert "Traceback" not in result.stderr
    assert "internal error" not in result.stderr
    if result.exit_code == 2:
        lines = result.stderr.splitlines()
        assert len(lines) == 1, result.stderr
        assert lines[0].startswith(f"Error: {path}: "), result.stderr
        assert result.stdout == ""
        assert not output.exists()
        return
    json.loads(result.stdout, parse_constant=lambda word: pytest.fail(f"{word} in the summary"))
    with np.load(output) as archive:
        for name in archive.files:
            value = archive[name]
            assert value.dtype.kind != "f" or not np.isnan(value).any(), f"NaN in {name}"


FLOW_IN_A_BODY = "--flow vortex-ring --integrator energy --dt 0.01 --steps 1"


def words_of(command: str, path: Path, words: list[str] | None = None) -> list[str]:
    """Words of a command, with a vertex of the surface where one is required."""
    words, vertex = COMMANDS[command] if words is None else words, "0"
    with contextlib.suppress(InputError, IndexError, AttributeError):  # the command itself will report it
        if "VERTEX" in words:
            vertex = str(read_mesh(str(path)).mesh.faces[0, 0])
        if command == "fluid-sim" and read_mesh(str(path)).kind == "tetrahedra":
            return FLOW_IN_A_BODY.split()
    return [vertex if word == "VERTEX" else word for word in words]


@pytest.mark.parametrize("path", hard_files(), ids=lambda p: p.name)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_hard_file_has_a_finite_result_or_one_error_line_as_info_reports(run, tmp_path, command, path):
    if (command, path.name) in TOO_LARGE:
        pytest.skip("the result is too large for the time limit")
    output = tmp_path / "out.npz"
    result = run(command, path, *words_of(command, path), "-o", output, "--json")
    assert_honest(result, path, output)
    accepts = accepted_commands(run, path)
    if accepts:
        assert accepts.keys() == PROGRAM_COMMANDS.keys()
        is_refused = accepts.get(command, "").startswith("no: ")
        assert (result.exit_code == 2) == is_refused, accepts[command]


ACCEPTS: dict[Path, dict[str, str]] = {}


def accepted_commands(run, path: Path) -> dict[str, str]:
    """What the commands do with a file as `info` reports it; empty where they may do either."""
    if path not in ACCEPTS:
        result = run("info", path, "--json")
        summary = json.loads(result.stdout) if result.exit_code == 0 else {"input": {}}
        # nothing to measure: an empty result is as correct as an error
        is_measurable = result.exit_code == 0 and summary["input"].get("faces") != 0
        ACCEPTS[path] = summary["results"]["accepts"] if is_measurable else {}
    return ACCEPTS[path]


def of(points, faces) -> TriangleMesh:
    return TriangleMesh.from_arrays(np.array(points, dtype=float), np.array(faces))


def two(first: TriangleMesh, second: TriangleMesh) -> TriangleMesh:
    """Two meshes as one."""
    faces = np.concatenate([first.faces, second.faces + first.n_vertices])
    return TriangleMesh.from_arrays(np.concatenate([first.points, second.points]), faces)


def generated_meshes() -> dict[str, TriangleMesh]:
    """Hard cases that need no file: also where the shared meshes are missing, every command meets them."""
    ball, grid = shapes.icosphere(1), shapes.grid(4, 4)
    corner = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]]
    strip = np.array([[x, y, 0] for x in range(5) for y in (0, 1e-7)])
    moebius = [[k, k + 1, k + 2] if k % 2 == 0 else [k + 1, k, k + 2] for k in range(8)] + [
        [8, 9, 1],
        [1, 9, 0],
    ]
    turned = np.concatenate([ball.faces[:40], ball.faces[40:, ::-1]])
    return {
        "one face": of(corner[:3], [[0, 1, 2]]),
        "no area": of([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]),
        "one place": of(np.ones((3, 3)), [[0, 1, 2]]),
        "a cap": of([[0, 0, 0], [1, 0, 0], [0.5, 1e-13, 0], [0.5, -1, 0]], [[0, 1, 2], [1, 0, 3]]),
        "needles": of(strip, [f for k in range(0, 8, 2) for f in ([k, k + 2, k + 1], [k + 1, k + 2, k + 3])]),
        "three faces on an edge": of(corner, [[0, 1, 2], [1, 0, 3], [0, 1, 4]]),
        "a face twice": of(corner[:3], [[0, 1, 2], [0, 1, 2]]),
        "a vertex twice": of(corner[:3], [[0, 1, 2], [0, 1, 1]]),
        "a pinched vertex": of([*corner, [0, -1, 1]], [[0, 1, 2], [0, 4, 5]]),
        "one-sided": of(np.random.default_rng(0).normal(size=(10, 3)), moebius),
        "turned faces": TriangleMesh.from_arrays(ball.points, turned),
        "an unused vertex": of([*corner[:4], [9, 9, 9]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]),
        "two pieces far apart": two(ball, grid.moved(grid.points + 1e6)),
        "tiny": ball.moved(ball.points * 1e-8),
        "huge": ball.moved(ball.points * 1e8),
        "squares overflow": ball.moved(ball.points * 1e192),
        "fourth powers overflow": ball.moved(ball.points * 1e100),
        "squares underflow": ball.moved(ball.points * 1e-192),
        "flat": grid,
        "no area, a vertex twice": of([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2], [0, 1, 1]]),
        "no face": of(corner, np.zeros((0, 3), dtype=int)),
    }


@pytest.mark.parametrize("name", generated_meshes())
@pytest.mark.parametrize("command", COMMANDS)
def test_a_generated_hard_mesh_has_a_finite_result_or_one_error_line(run, tmp_path, command, name):
    path, output = tmp_path / "mesh.ply", tmp_path / "out.npz"
    write_mesh(str(path), AnnotatedMesh(generated_meshes()[name]))
    result = run(command, path, *words_of(command, path), "-o", output, "--json")
    assert_honest(result, path, output)


def assert_compared(run, command: str, path: Path, output: Path) -> None:
    """A comparison has finite rows, or one error line."""
    result = run("tradeoff", command, path, *words_of(command, path, COMPARISONS[command]),
                 "--repeat", 1, "--budget", 2, "-o", output, "--json")  # fmt: skip
    assert result.exit_code in (0, 1, 2) and "internal error" not in result.stderr, result.stderr
    errors = [line for line in result.stderr.splitlines() if line.startswith("Error: ")]
    if result.exit_code:
        assert len(errors) == 1 and not output.exists(), result.stderr
        return
    table = output.read_text(encoding="utf-8")
    rows = json.loads(table, parse_constant=lambda word: pytest.fail(f"{word} in the table"))["rows"]
    assert errors == [] and rows


@pytest.mark.parametrize("name", generated_meshes())
@pytest.mark.parametrize("command", COMPARISONS)
def test_a_comparison_on_a_generated_hard_mesh_has_rows_or_one_error_line(run, tmp_path, command, name):
    """Internal errors: `delaunay` without faces, `geodesic` where squares overflow, flows of a plane."""
    path = tmp_path / "mesh.ply"
    write_mesh(str(path), AnnotatedMesh(generated_meshes()[name]))
    assert_compared(run, command, path, tmp_path / "rows.json")


def files_of_comparisons():
    """Every command with every hard file; two thirds of the pairs are slow, by turns."""
    for i, command in enumerate(COMPARISONS):
        for j, path in enumerate(hard_files()):
            marks = [pytest.mark.slow] if (i + j) % 3 else []
            yield pytest.param(command, path, marks=marks, id=f"{command}-{path.name}")


@pytest.mark.parametrize(("command", "path"), list(files_of_comparisons()))
def test_a_comparison_on_a_hard_file_has_rows_or_one_error_line(run, tmp_path, command, path):
    assert_compared(run, command, path, tmp_path / "rows.json")


@pytest.mark.parametrize("name", expectations())
def test_info_equals_the_expected_facts(run, name):
    expected = expectations()[name]
    result = run("info", HARD / name, "--json")
    exit_codes = {"ok": (0,), "error": (2,), "either": (0, 2)}[expected["load"]]
    assert result.exit_code in exit_codes, result.stderr
    if result.exit_code:
        return
    summary = json.loads(result.stdout)
    facts = {**summary["input"], **summary["results"]}
    names_in_info = {
        "orientable": "orientable",
        "consistent": "oriented",
        "euler": "euler_characteristic",
        "boundary_loops": "boundary_loops",
        "components": "components",
        "nonmanifold_edges": "nonmanifold_edges",
        "nonmanifold_vertices": "nonmanifold_vertices",
        "duplicate_faces": "duplicate_faces",
        "coincident_vertices": "coincident_vertices",
        "repeated_index_faces": "repeated_index_faces",
        "unreferenced": "unreferenced_vertices",
        "tets": "tetrahedra",
    }
    for key in expected.keys() - {"load", "what"}:
        assert facts[names_in_info[key]] == expected[key], key


def finite(value) -> bool:
    if isinstance(value, dict):
        return all(finite(v) for v in value.values())
    if isinstance(value, list):
        return all(finite(v) for v in value)
    return not isinstance(value, float) or math.isfinite(value)


def test_strict_json_has_no_constants(run):
    if not HARD.is_dir():
        pytest.skip("../shared/meshes/hard is missing")
    paths = sorted(HARD.glob("gen_*scale*"))
    assert paths
    for path in paths:
        result = run("info", path, "--json")
        assert result.exit_code == 2 or finite(json.loads(result.stdout))
