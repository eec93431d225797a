"""Summaries: short by default, whole with --full, explained in the docs; help pages of two lengths."""

import contextlib
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

from ddgcli.algorithms.curvature.surface_curvature import measure_curvature
from ddgcli.choices import CURVATURE_SCHEMES
from ddgcli.cli.main import COMMANDS, main
from ddgcli.cli.short_summary import short_body
from ddgcli.cli.summary import LINE_WIDTH, print_summary
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

DOCS = Path(__file__).parent.parent.parent / "docs"
PAGES = {"geodesic": ("geodesic", "geodesic-curves")}
SCENES = {
    "shell.toml": """\
[time]
duration = 0.02
step = 0.01
[[object]]
name = "sheet"
role = "shell"
grid = { size = [1, 1], cells = [3, 3] }
material = "rubber"
[effects]
stretching = {}
gravity = { acceleration = [0, 0, -9.81] }
pin = { vertices = [0] }
""",
    "fluid.toml": """\
[time]
duration = 0.02
step = 0.01
[[object]]
name = "ball"
role = "fluid"
sphere = { subdivisions = 1 }
[effects]
initial = { vorticity = "5*z" }
""",
}
CALLS = [
    "info s.ply",
    "info c.csv",
    "repair s.ply --weld",
    "curvature s.ply",
    "curvature c.csv",
    "delaunay s.ply --refine 25",
    "laplacian s.ply --eigen 30 --hks 0.1",
    "laplacian g.ply --parameterize conformal --harmonic --fix 0=0 --fix 12=1",
    "laplacian s.ply --smooth 0.01",
    "dec s.ply",
    "hodge t.npz --field wind --basis",
    "geodesic s.ply --source 0 --path-to 5 --certify --log-map --compare heat",
    "willmore-flow s.ply --steps 2",
    "curve-flow c.csv --steps 30 --dt 1e-3",
    "shell-sim shell.toml -o run.vtkhdf",
    "fluid-sim fluid.toml",
    "frames run.vtkhdf",
    "view s.ply -o v.html",
    "tradeoff geodesic s.ply --source 0 --budget 20",
]
# tables whose keys are names of the input's or the scene's own, or of commands and methods
OWN_KEYS = {
    "accepts", "arrays", "compare", "effects", "energies", "reaction_forces", "seconds_by_part",
    "triangulation",
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("summaries")
    write_mesh(str(path / "s.ply"), AnnotatedMesh(shapes.icosphere(1)))
    write_mesh(str(path / "g.ply"), AnnotatedMesh(shapes.grid(6, 6)))
    torus = shapes.torus(10, 6)
    wind = np.cross(torus.points[torus.faces].mean(axis=1), [0, 0, 1.0])
    write_mesh(str(path / "t.npz"), AnnotatedMesh(torus, face={"wind": wind}))
    angle = np.linspace(0, 2 * np.pi, 41)
    np.savetxt(path / "c.csv", np.column_stack([np.cos(angle), 2 * np.sin(angle)]), delimiter=",")
    for name, text in SCENES.items():
        (path / name).write_text('format = "ddgcli-scene/1"\n' + text)
    return path


@pytest.fixture(scope="module")
def outputs(folder):
    """(summary, short text, full text) of every call."""
    before = os.getcwd()
    os.chdir(folder)
    try:
        results = {}
        for call in CALLS:
            result = CliRunner().invoke(main, [*call.split(), "--json"])
            assert result.exit_code == 0, result.output + result.stderr
            summary = json.loads(result.stdout)
            results[call] = (summary, printed(summary, full=False), printed(summary, full=True))
        return results
    finally:
        os.chdir(before)


def printed(summary, full):
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        print_summary(summary, False, full=full)
    return text.getvalue()


def code_words(command):
    text = "".join((DOCS / f"{page}.md").read_text("utf-8") for page in PAGES.get(command, (command,)))
    text = re.sub(r"```.*?```", "", text, flags=re.S)
    return set(re.findall(r"[\w-]+", " ".join(re.findall(r"`([^`]+)`", text))))


@pytest.mark.parametrize("call", CALLS)
def test_every_field_is_explained_on_the_page_by_its_name(outputs, call):
    summary, _, _ = outputs[call]
    words, missing = code_words(summary["command"]), []
    for section in ("results", "accuracy"):
        for name, value in summary[section].items():
            inner = value if isinstance(value, dict) and name not in OWN_KEYS else {}
            missing += [word for word in (name, *inner) if word not in words]
    assert missing == []


@pytest.mark.parametrize("call", CALLS)
def test_the_short_summary_is_short_and_the_full_one_has_every_field(outputs, call):
    summary, short, full = outputs[call]
    if summary["command"] == "tradeoff":  # prints a table of rows instead
        return
    assert len(short.splitlines()) <= 30
    assert max(map(len, short.splitlines())) <= LINE_WIDTH
    names = [name for section in ("results", "accuracy") for name in summary[section]]
    assert [name for name in names if not re.search(rf"^ +{re.escape(name)}\b", full, re.M)] == []
    assert len(full.splitlines()) >= len(short.splitlines())


@pytest.mark.parametrize(
    "call, fields",
    [
        ("geodesic s.ply --source 0 --target-point 0,0,1", ["targets", "distance"]),
        ("geodesic s.ply --source 0 --fan 5 --fan-length 0.5", ["fan", "rays_with_caustic"]),
        ("geodesic s.ply --source 0 --source 7 --voronoi --vertex-types", ["regions", "vertex_types"]),
        ("geodesic s.ply --source 0 --tolerance 0.1", ["tolerance_error_estimate"]),
        ("geodesic s.ply --source 0 --certify", ["symmetry_residual", "triangle_residual"]),
        ("curvature s.ply --offset 0.1", ["offset", "volume", "offset_volume_error"]),
        ("curvature s.ply --region 0,0,1:0.9", ["regions", "phi_h"]),
        ("curvature c.csv --frames", ["total_curvature", "bishop_holonomy"]),
        ("laplacian s.ply --form-eigen 3", ["form_eigenvalues", "harmonic_forms", "form_eigen_complete"]),
        ("laplacian s.ply --wave 0 --duration 0.1", ["equation", "energy_drift"]),
    ],
)
def test_the_short_summary_shows_the_answer_to_an_option(folder, monkeypatch, call, fields):
    monkeypatch.chdir(folder)
    result = CliRunner().invoke(main, call.split())
    assert result.exit_code == 0, result.stderr
    assert [name for name in fields if not re.search(rf"^ +(.*, )?{name}\b", result.stdout, re.M)] == []


def test_a_long_list_is_cut_in_the_short_summary_and_wrapped_in_the_full_one(outputs):
    summary, short, full = outputs["laplacian s.ply --eigen 30 --hks 0.1"]
    values = summary["results"]["eigenvalues"]
    assert "(30 values)" in short and f"{values[-1]:.6g}" in short and f"{values[20]:.6g}," not in short
    start = full.index("eigenvalues")
    text = full[start : full.index("]", start)]
    assert text.count(",") == 29 and max(map(len, text.splitlines())) <= LINE_WIDTH


def test_a_short_run_of_curvature_has_the_fields_of_the_full_one_and_leaves_the_rest_out(folder):
    mesh = read_mesh(str(folder / "s.ply")).surface
    for scheme in CURVATURE_SCHEMES:
        short, full = (measure_curvature(mesh, scheme, full=f) for f in (False, True))
        assert set(short.vertex) == {"mean_curvature", "gaussian_curvature"} and not short.edge
        for name, values in short.vertex.items():
            assert np.array_equal(values, full.vertex[name])
        assert short.results == {name: full.results[name] for name in short.results}
        assert short.accuracy == full.accuracy and "willmore_energies" in set(full.results) - set(
            short.results
        )
        bodies = [
            {"command": "curvature", "input": {}, "results": r.results, "accuracy": r.accuracy}
            for r in (short, full)
        ]
        assert short_body(bodies[0])[0] == short_body(bodies[1])[0], "the same short summary"


def test_quiet_prints_nothing_and_json_is_whole_all_the_same(folder):
    path = str(folder / "s.ply")
    lengths = [len(CliRunner().invoke(main, ["curvature", path, *w]).stdout) for w in ([], ["--full"])]
    assert 0 < lengths[0] < lengths[1]
    result = CliRunner().invoke(main, ["curvature", path, "-q"])
    assert result.exit_code == 0 and result.stdout == "" and result.stderr == ""
    assert '"willmore_energies"' in CliRunner().invoke(main, ["curvature", path, "-q", "--json"]).stdout
    refused = CliRunner().invoke(main, ["curvature", path + "x", "-q"])
    assert refused.exit_code == 2 and refused.stderr.startswith("Error: ")


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_fewer_than_60_lines_and_help_all_every_option(name):
    command = main.get_command(click.Context(main), name)
    short = CliRunner().invoke(main, [name, "--help"]).stdout
    whole = CliRunner().invoke(main, [name, "--help-all"]).stdout
    assert len(short.splitlines()) < 60
    options = [option for option in command.params if isinstance(option, click.Option) and not option.hidden]
    shown = [max(option.opts, key=len) for option in options]
    assert [option for option in shown if option not in whole] == []
    listed = {line.strip().split()[0].rstrip(",") for line in short.splitlines() if line.startswith("  -")}
    hidden = [option for option in options if not listed & set(option.opts)]
    assert f"--help-all shows {len(hidden)} more options" in short
    assert "Output:" in short and "Run:" in whole
    assert ("Pictures:" in whole) == ("--plot" in shown)


def test_long_tables_and_long_lists_of_outputs_are_short_by_default(run, tmp_path):
    path = tmp_path / "sphere.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(2)))
    words = ("geodesic", path, "--source", "0", "--isolines", "20")
    short, whole = run(*words).stdout, run(*words, "--full").stdout
    assert "... (20 by --full)" in short and short.count("isoline") == 6 and whole.count("isoline,") == 20
    fall = ("shell-sim", path, "--effect", "gravity", "--steps", "9", "--dt", "0.01", "--frame-every", "0.01")
    assert run(*fall, "-o", tmp_path / "run.vtkhdf").exit_code == 0
    exported = run("frames", tmp_path / "run.vtkhdf", "-o", tmp_path / "f_{:02d}.ply").stdout
    count = len(list(tmp_path.glob("f_*.ply")))
    assert count > 7 and exported.count("wrote  ") == 7 and f"... ({count} by --full)" in exported


def test_the_shell_completes_commands_and_options():
    def completed(words, position):
        environment = {**os.environ, "_DDGCLI_COMPLETE": "bash_complete", "COMP_WORDS": words}
        environment["COMP_CWORD"] = str(position)
        call = [sys.executable, "-c", "from ddgcli.cli.main import main; main(prog_name='ddgcli')"]
        done = subprocess.run(call, env=environment, capture_output=True, text=True, timeout=60)
        return {line.partition(",")[2] for line in done.stdout.splitlines()}

    assert completed("ddgcli cur", 1) == {"curvature", "curve-flow"}
    assert {"--source", "--source-point", "--source-face"} <= completed("ddgcli geodesic --sour", 2)


def test_manual_pages_show_every_command():
    import importlib.util

    spec = importlib.util.spec_from_file_location("make_man", DOCS / "make_man.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    pages = module.pages()
    assert set(pages) == {"ddgcli.1", *(f"ddgcli-{name}.1" for name in COMMANDS)}
    assert all(text.startswith(".TH ") and ".SH NAME" in text for text in pages.values())
    assert r"\-\-field\-tolerance" in pages["ddgcli-geodesic.1"]
