"""Command group: streams, exit codes, one-line errors, atomic outputs, fast start."""

import json
import logging
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import click
import numpy as np
import pytest

from ddgcli.cli.main import COMMANDS
from ddgcli.cli.run import Run
from ddgcli.errors import MeshError, SolveError
from ddgcli.io.mesh_file import WRITERS, read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

ROOT = Path(__file__).parents[2]
HEAVY = {"numpy", "scipy", "matplotlib", "trimesh", "meshio", "h5py", "pydantic", "vtk"}


def process(*words, **kwargs):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-m", "ddgcli", *map(str, words)], capture_output=True, env=environment, **kwargs
    )


def refused(result, *words_of_message):
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert len(result.stderr.splitlines()) == 1, result.stderr
    assert result.stderr.startswith("Error: ")
    for words in words_of_message:
        assert words in result.stderr


# -- starting ---------------------------------------------------------------------------------------------


def test_help_imports_nothing_heavy():
    script = (
        "import sys\nfrom ddgcli.cli.main import COMMANDS, main\n"
        "for words in ([], *([name] for name in COMMANDS)):\n"
        "    main([*words, '--help'], standalone_mode=False)\n"
        f"    print('HEAVY', words, sorted({HEAVY!r} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    heavy = [line for line in done.stdout.splitlines() if line.startswith("HEAVY")]
    assert heavy == [f"HEAVY {words} []" for words in ([], *([name] for name in COMMANDS))], done.stderr


def test_advice_names_the_script_where_python_runs_the_module():
    assert b"see ddgcli curvature --help" in process("curvature", "a.ply", "--schem", "x").stderr


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_with_an_example(run, name):
    result = run(name, "--help")
    assert result.exit_code == 0
    assert "Example" in result.stdout
    assert "--json" in result.stdout and "--output" in result.stdout


def test_unknown_command_names_the_nearest(run):
    refused(run("curvatur", "x.ply"), "curvature")


def test_unknown_option_and_missing_argument_are_one_line(run, torus):
    refused(run("info", torus, "--jsno"), "--json")
    refused(run("info"), "MESH")
    refused(run("--nonsense"), "--nonsense")


# -- the summary ------------------------------------------------------------------------------------------


def test_summary_has_the_promised_keys(summary, torus):
    document = summary("info", torus)
    assert list(document) == [
        "command", "version", "input", "options", "results", "accuracy", "seconds", "warnings", "outputs",
    ]  # fmt: skip
    assert list(document["input"]) == [
        "path", "vertices", "faces", "components", "boundary_loops", "euler_characteristic", "genus",
        "manifold", "oriented", "closed",
    ]  # fmt: skip


def test_seconds_cover_the_run(torus, tmp_path):
    began = time.perf_counter()
    done = process("info", torus, "--json", "-o", tmp_path / "a.vtu")
    wall = time.perf_counter() - began
    seconds = json.loads(done.stdout)["seconds"]
    assert seconds["read"] + seconds["compute"] + seconds["write"] == pytest.approx(seconds["total"])
    assert min(seconds.values()) >= 0 and seconds["write"] > 0
    assert seconds["total"] + seconds["start"] <= wall
    assert seconds["start"] > 0.01  # numpy and scipy are imported


def test_a_run_with_a_k_d_tree_imports_nothing_else_of_spatial_algorithms_which_work_later(torus):
    code = (
        "import sys\n"
        "from ddgcli.cli.main import main\n"
        f"try: main(['curvature', {str(torus)!r}, '--radius', '1', '-q'])\nexcept SystemExit: pass\n"
        "from ddgcli.cli.imports import _tree_class\n"
        "others = {'scipy.special', 'scipy.spatial._qhull'} & set(sys.modules)\n"
        "print(_tree_class.cache_info().currsize, others)\n"
        "import scipy.spatial as spatial\n"
        "print(spatial.ConvexHull([[0, 0], [1, 0], [0, 1]]).volume)\n"
        "from scipy.spatial import cKDTree\n"
        "print(cKDTree is spatial.cKDTree, type(sys.modules['scipy.spatial']).__name__)\n"
    )
    call = [sys.executable, "-c", code]
    printed = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    assert printed.split("\n")[:3] == ["1 set()", "0.5", "True module"]


def test_a_run_imports_no_test_tools_and_no_wrapper_generator_of_numpy(torus):
    code = (
        "import sys\n"
        "from ddgcli.cli.main import main\n"
        f"main(['curvature', {str(torus)!r}, '-q'], standalone_mode=False)\n"
        "loaded = {'numpy.f2py.crackfortran', 'numpy.testing._private.utils'} & set(sys.modules)\n"
        "import numpy.testing\n"
        "print(loaded, numpy.testing.assert_allclose.__name__, numpy.polynomial.Polynomial([1, 2])(3))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[0] == "set() assert_allclose 7.0"


@pytest.mark.parametrize(
    "words",
    [
        "curvature CUBE",
        "delaunay CUBE",
        "geodesic CUBE --source 0",
        "geodesic CUBE --source 0 --method fast-marching",
    ],
)
def test_a_small_run_imports_neither_scipy_nor_masked_arrays_and_these_work_later(words):
    cube = str(ROOT / "sample_meshes" / "cube.obj")
    code = (
        "import sys\n"
        "from ddgcli.cli.main import main\n"
        f"main({[*words.replace('CUBE', cube).split(), '-q']}, standalone_mode=False)\n"
        "print({'scipy', 'numpy.ma.core', 'numpy.random.mtrand'} & set(sys.modules))\n"
        "import numpy as np\n"
        "print(np.unique([2, 1, 2]), np.median([1, 3]), np.ma.isMaskedArray(np.zeros(2)))\n"
        "masked = np.ma.masked_array([1, 2, 2], [True, False, False])\n"
        "print(np.ma.isMaskedArray(masked), np.unique(masked), np.random.default_rng(0).random() < 1)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["set()", "[1 2] 2.0 False", "True [2 --] True"]


def test_json_is_alone_on_standard_output(torus):
    done = process("info", torus, "--json")
    assert done.stdout.count(b"\n") == 1 and done.stderr == b""


def test_values_that_are_not_finite_become_null_with_a_warning(run, monkeypatch, torus):
    code, document, _ = fake_run(
        run, monkeypatch, lambda r, _: r.finish({"a": np.nan, "b": [1.0, np.inf]}, {}), torus
    )
    assert code == 0
    assert document["results"] == {"a": None, "b": [1.0, None]}
    assert "results.a" in document["warnings"][-1] and "results.b[1]" in document["warnings"][-1]


def fake_run(run, monkeypatch, body, *words):
    """Run `body(run, path)` as the command `info`; (exit code, summary or None, stderr)."""
    from ddgcli.cli import options

    @click.command("info")
    @options.mesh_arg
    @options.common
    def command(mesh_path, common):
        """A command of the test."""
        body(Run("info", common), mesh_path)

    monkeypatch.setitem(sys.modules, "ddgcli.cli.commands.info", SimpleNamespace(command=command))
    result = run("info", *words, "--json")
    return result.exit_code, json.loads(result.stdout) if result.stdout else None, result.stderr


# -- exit codes -------------------------------------------------------------------------------------------


def test_not_converged_is_exit_1_with_outputs_marked(run, monkeypatch, torus, tmp_path):
    def body(r, path):
        source = r.read(path)
        r.write(AnnotatedMesh(source.mesh), converged=False)
        r.finish({}, {"residual": 1.0}, converged=False)

    output = tmp_path / "a.npz"
    code, document, _ = fake_run(run, monkeypatch, body, torus, "-o", output)
    assert code == 1
    assert document["results"]["converged"] is False
    with np.load(output) as archive:
        assert json.loads(str(archive["metadata"]))["converged"] is False


@pytest.mark.parametrize(
    "error, code, message",
    [
        (MeshError("vertex 3 is bad; repair it"), 2, "Error: {path}: vertex 3 is bad; repair it"),
        (SolveError("no convergence\nat step 2"), 1, "Error: {path}: no convergence at step 2"),
        (
            ZeroDivisionError("x"),
            1,
            "Error: internal error: ZeroDivisionError: x; ddgcli --debug shows the traceback",
        ),
        (KeyboardInterrupt(), 130, "Interrupted"),
        (MemoryError("too much"), 1, "Error: out of memory (too much); use a smaller mesh or fewer outputs"),
    ],
)  # fmt: skip
def test_errors_become_one_line_and_a_code(run, monkeypatch, torus, tmp_path, error, code, message):
    def body(r, path):
        r.read(path)
        logging.getLogger("ddgcli").warning("a warning that a run with an error does not print")
        raise error

    output = tmp_path / "out.vtu"
    output.write_text("old")
    outcome = fake_run(run, monkeypatch, body, torus, "-o", output)
    assert outcome == (code, None, message.format(path=torus) + "\n")
    assert output.read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.vtu", "torus.ply"]


def test_debug_shows_the_traceback(torus, tmp_path):
    script = (
        "import ddgcli.algorithms.inspection.inspect_mesh as i\ndef bug(mesh): raise ZeroDivisionError('x')\n"
        "i.inspect_mesh = bug\nfrom ddgcli.cli.main import main\nimport sys\nmain(sys.argv[1:])"
    )
    for words, expected in ((["info"], False), (["--debug", "info"], True)):
        done = subprocess.run(
            [sys.executable, "-c", script, *words, str(torus)], capture_output=True, text=True, cwd=ROOT
        )
        assert ("Traceback" in done.stderr) == expected
        assert done.returncode == 1


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_interrupt_is_130():
    with subprocess.Popen(
        [sys.executable, "-m", "ddgcli", "info", "-", "--input-format", "ply"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT,
    ) as child:  # fmt: skip
        assert child.stdin is not None
        # more than a pipe holds: once it is written, the command is reading its standard input
        child.stdin.write(b"ply\ncomment " + b"x" * 1_000_000)
        child.stdin.flush()
        child.send_signal(signal.SIGINT)
        child.stdin.close()
        out, err = child.stdout.read(), child.stderr.read()
        child.wait(timeout=60)
    assert (child.returncode, out, err) == (130, b"", b"Interrupted\n")


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_a_closed_pipe_ends_quietly(torus):
    for words in ("-q -o - --output-format vtu", "--json", ""):
        command = f'"{sys.executable}" -m ddgcli info "{torus}" {words} | true'
        done = subprocess.run(["bash", "-c", command], capture_output=True, cwd=ROOT)
        assert done.stderr == b"", words


# -- inputs and outputs -----------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off", ".vtu", ".vtk", ".npz", ".xdmf"])
def test_a_mesh_is_read_from_standard_input(run, torus, tmp_path, suffix):
    source = tmp_path / f"in{suffix}"
    write_mesh(str(source), AnnotatedMesh(read_mesh(str(torus)).mesh))
    result = run("info", "-", "--input-format", suffix[1:], "--json", input=source.read_bytes())
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["input"]["genus"] == 1


def test_standard_input_needs_a_format(run):
    refused(run("info", "-"), "--input-format")


@pytest.mark.parametrize("suffix", sorted(set(WRITERS) - {".csv"}))
def test_a_mesh_is_written_to_standard_output(run, torus, tmp_path, suffix):
    result = run("info", torus, "-o", "-", "--output-format", suffix[1:])
    assert result.exit_code == 0, result.stderr
    again = tmp_path / f"again{suffix}"
    again.write_bytes(result.stdout_bytes)
    assert read_mesh(str(again)).mesh.n_faces == 192


@pytest.mark.parametrize("suffix", [".ply", ".vtkhdf"])  # written as one stream, and as a file that is copied
def test_a_mesh_passes_from_process_to_process(torus, suffix):
    written = process("info", torus, "-o", "-", "--output-format", suffix[1:])
    assert written.returncode == 0, written.stderr
    done = process("info", "-", "--input-format", suffix[1:], "--json", input=written.stdout)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["input"]["genus"] == 1


def test_too_many_subdivided_faces_are_an_error(run, tmp_path, monkeypatch):
    monkeypatch.setattr("ddgcli.mesh.midpoint_subdivision.MAX_SUBDIVIDED_FACES", 1000)
    sphere = tmp_path / "sphere.ply"
    write_mesh(str(sphere), AnnotatedMesh(shapes.icosphere(1)))
    assert run("laplacian", sphere, "--subdivide", 1).exit_code == 0
    refused(run("laplacian", sphere, "--subdivide", 2), "1,280 faces", "use a smaller number")


def test_plot_without_matplotlib_names_the_extra(run, torus, tmp_path, monkeypatch):
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n, *a: None if n == "matplotlib" else find(n, *a))
    refused(run("info", torus, "--plot", tmp_path / "a.png"), "ddgcli[plot]")


def test_stl_keeps_the_map_of_its_merge(summary, tmp_path):
    mesh = shapes.icosphere(1)
    path, output = tmp_path / "a.stl", tmp_path / "a.npz"
    write_mesh(str(path), AnnotatedMesh(mesh))
    document = summary("info", path, "-o", output)
    assert document["input"]["vertices"] == 42 and "input_vertex" in document["warnings"][0]
    with np.load(output) as archive:
        corner = archive["points"][archive["input_vertex"]].reshape(-1, 3, 3)
    np.testing.assert_allclose(corner, mesh.points[mesh.faces], atol=1e-6)


def test_arrays_the_format_cannot_store_give_a_warning(summary, torus, tmp_path):
    document = summary("info", torus, "-o", tmp_path / "a.off")
    assert ".vtu" in document["warnings"][0]


def test_quiet_runs_print_no_warning(torus, tmp_path):
    words = ("info", torus, "-o", tmp_path / "a.off")
    assert b"Warning" in process(*words).stderr
    assert process(*words, "-q").stderr == b""


@pytest.mark.parametrize("words", [["--seed", -1], ["--seed", 1.5]])
def test_an_invalid_seed_is_an_error(run, torus, words):
    result = run("laplacian", torus, "--eigen", 2, *words)
    assert result.exit_code == 2 and "--seed" in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.parametrize("command", ["shell-sim", "fluid-sim"])
def test_a_scene_without_effects_gives_a_warning(summary, torus, command):
    document = summary(command, torus, "--steps", 1, "--dt", 1e-3)
    assert any("nothing acts" in warning for warning in document["warnings"])
