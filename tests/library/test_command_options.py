"""Every option of a command that changes results has an equivalent in the library.

`docs/library.md` names the functions of each command, and the options whose parameters have another name.
"""

import dataclasses
import inspect
import json
import re
from pathlib import Path

import click
import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.cli.main import main
from ddgcli.cli.options import CommonOptions

PAGE = (Path(ddg.__file__).parent.parent / "docs" / "library.md").read_text(encoding="utf-8")
WITHOUT_RESULTS = {"frames", "view", "batch", "examples", "check"}  # of files, pictures and other runs
# with what all commands have: a seed, which is a parameter wherever a result depends on it
FILES_AND_PICTURES = {field.name for field in dataclasses.fields(CommonOptions)} | {
    "help_all", "matrix", "mass_matrix", "mtx", "forms", "offset_output", "paths_output", "glyphs",
    "resume", "list_effects", "schema",
}  # fmt: skip
# solvers, which change no result, and an option that only `ddgcli tradeoff` has for scenes
OTHERS = {"solver", "conserved"}


def table():
    """Command -> names of its functions, and names of the library by option."""
    section = PAGE.split("## Options of the commands")[1].split("\n## ")[0]
    rows = [line.strip("| ").split("|") for line in section.splitlines() if line.startswith("| `")]
    entries = {}
    for row in rows:
        commands, functions = (re.findall("`([^`]+)`", cell) for cell in row[:2])
        others = {}
        for entry in (row[2] if len(row) > 2 else "").split(";"):
            names = re.findall("`([^`]+)`", entry)
            options = [name for name in names if name.startswith("--")]
            others |= dict.fromkeys(options, names[len(options) :])
        entries |= dict.fromkeys(commands, (functions, others))
    return entries


TABLE = table()


def parameters(functions):
    """Names of functions and of their parameters; those that a solver takes as options too."""
    names = set(functions)
    for name in functions:
        names |= set(inspect.signature(getattr(ddg, name)).parameters)
    return names | ({"tolerance"} if "measure_distance" in functions else set())


def missing(command, functions, others):
    """Options of a command without an equivalent, and names of the page that are none of the functions'."""
    known = parameters(functions)
    wrong = [name for names in others.values() for name in names if name not in known]
    for option in (p for p in command.params if isinstance(p, click.Option)):
        if option.name not in FILES_AND_PICTURES | OTHERS | known and not set(option.opts) & set(others):
            wrong.append(option.opts[-1])
    return wrong


def test_every_option_of_the_page_exists():
    commands = [main.get_command(click.Context(main), name) for name in TABLE]
    existing = {name for command in commands for option in command.params for name in option.opts}
    assert {name for _, others in TABLE.values() for name in others} <= existing


def test_the_page_has_a_row_for_every_command_with_results():
    assert set(TABLE) == set(main.list_commands(click.Context(main))) - WITHOUT_RESULTS


@pytest.mark.parametrize("name", TABLE)
def test_every_option_that_changes_results_is_in_the_library(name):
    assert missing(main.get_command(click.Context(main), name), *TABLE[name]) == []


def test_an_option_that_the_library_lacks_is_seen():
    @click.command()
    @click.option("--radius")
    @click.option("--colour-of-noise")
    def command(): ...

    assert missing(command, ["curvature"], {}) == ["--colour-of-noise"]
    assert missing(command, ["curvature"], {"--colour-of-noise": ["tint"]}) == ["tint"]


def bent():
    """A curved square with a boundary, and a function on its vertices."""
    square = ddg.grid(8, 8, pattern="alternating")
    x, y, _ = np.array(square.points).T
    return square.moved(np.stack([x, y, 0.3 * x * (1 - x) + 0.2 * x * y], axis=1)), np.cos(3 * x + y)


MESH, WAVE = bent()
PAIRS = {  # words of a command -> the arrays that the library returns
    "laplacian --smooth 0.02 --smooth-flow conformalized -o out.npz": lambda: {
        "points": ddg.mean_curvature_flow(MESH, 0.02, flow="conformalized").mesh.points
    },
    "curvature --vertex-vectors -o out.npz": lambda: ddg.curvature(MESH, vertex_vectors=True).vertex,
    "delaunay --refine 28 --transfer wave -o out.npz": lambda: (
        ddg.delaunay_refinement(MESH, 28, transfer={"wave": WAVE}).vertex
    ),
    "delaunay --transfer wave --overlay out.npz": lambda: (
        ddg.delaunay_refinement(MESH, None, transfer={"wave": WAVE}).overlay().vertex
    ),
    "geodesic --source-boundary -o out.npz": lambda: {
        "geodesic_distance": ddg.geodesic_distance(MESH, source_boundary=True)
    },
    "geodesic --source 0 --subdivide 1 -o out.npz": lambda: {
        "geodesic_distance": ddg.geodesic_distance(ddg.subdivide(MESH), 0)
    },
    "geodesic --curve 0,4,76 --darboux --transport --paths-output out.npz": lambda: (
        ddg.edge_paths(MESH, [[0, 4, 76]], darboux=True, transport=True).vertex
    ),
    "geodesic --source 0 --path-to 75 --darboux --paths-output out.npz": lambda: (
        ddg.shortest_paths(MESH, 0, 75, darboux=True).vertex
    ),
    "geodesic --vertex-types -o out.npz": lambda: {"vertex_type": ddg.vertex_types(MESH)},
}


@pytest.mark.parametrize("words", PAIRS)
def test_the_library_returns_the_arrays_of_the_command(words, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ddg.write_mesh("mesh.npz", MESH, vertex={"wave": WAVE})
    command, *options = words.split()
    done = run(command, "mesh.npz", *options)
    assert done.exit_code == 0, done.stderr
    arrays, stored = PAIRS[words](), np.load("out.npz")
    assert arrays
    for name, values in arrays.items():
        np.testing.assert_array_equal(stored[name], values)


def test_the_library_returns_the_numbers_of_the_command(run, tmp_path):
    path = tmp_path / "mesh.npz"
    ddg.write_mesh(path, MESH, vertex={"plane": MESH.points[:, :2]})

    def summary(*words):
        return json.loads(run(*words, "--json").stdout)

    mapped = summary("curvature", path, "--map", "plane")["results"]
    flat = ddg.curvature(MESH, image=MESH.points[:, :2]).results
    own = set(flat) - set(ddg.curvature(MESH).results)
    assert own and all(mapped[name] == flat[name] for name in own)
    measured = summary("geodesic", path, "--source", 0, "--certify", "--target-point", "0.3,0.4,0.1")
    distance = ddg.measure_distance(MESH, 0, certify=True, target_points=[0.3, 0.4, 0.1])
    assert measured["results"]["targets"] == json.loads(json.dumps(distance.results["targets"]))
    assert measured["accuracy"]["symmetry_residual"] == distance.accuracy["symmetry_residual"]
    numbers = summary("delaunay", path, "--condition")["results"]["before"]
    flipped = ddg.delaunay_refinement(MESH, None, condition=True).results["before"]
    (name,) = set(flipped) - set(ddg.delaunay_refinement(MESH, None).results["before"])
    assert numbers[name] == flipped[name]
    assert ddg.tradeoff_table("maps", MESH, repeat=1, subdivide=0).rows[0].method == "harmonic"
