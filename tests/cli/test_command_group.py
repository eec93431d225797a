"""Command group: streams, exit codes, one-line errors, atomic outputs, fast start."""

import json
import logging
import os
import re
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
from ddgcli.cli.progress import Progress
from ddgcli.cli.run import Run
from ddgcli.errors import MeshError, SolveError
from ddgcli.io.mesh_file import WRITERS, read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

ROOT = Path(__file__).parents[2]
HEAVY = {"numpy", "scipy", "matplotlib", "trimesh", "meshio", "h5py", "pydantic", "vtk"}
SIMULATORS = {"shell-sim", "fluid-sim", "willmore-flow"}  # their help is written from their tables of effects
BUILT = [name for name, (module, _) in COMMANDS.items() if (ROOT / f"ddgcli/cli/{module}.py").exists()]


@pytest.fixture
def torus(tmp_path):
    path = tmp_path / "torus.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.torus(12, 8)))
    return path


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


@pytest.mark.parametrize("words", [[], *([name] for name in BUILT)], ids=lambda w: w[0] if w else "ddgcli")
def test_help_imports_nothing_heavy(words):
    heavy = HEAVY - {"numpy", "scipy"} if SIMULATORS & set(words) else HEAVY
    script = (
        "import sys\nfrom ddgcli.cli.main import main\n"
        f"try: main({[*words, '--help']!r})\nexcept SystemExit as end: assert not end.code\n"
        f"print('HEAVY', sorted({heavy!r} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.splitlines()[-1] == "HEAVY []", done.stderr


@pytest.mark.parametrize("name", BUILT)
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
def test_a_mesh_is_read_from_standard_input(torus, tmp_path, suffix):
    source = tmp_path / f"in{suffix}"
    write_mesh(str(source), AnnotatedMesh(read_mesh(str(torus)).mesh))
    done = process("info", "-", "--input-format", suffix[1:], "--json", input=source.read_bytes())
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["input"]["genus"] == 1


def test_standard_input_needs_a_format(run):
    refused(run("info", "-"), "--input-format")


@pytest.mark.parametrize("suffix", sorted(set(WRITERS) - {".csv"}))
def test_a_mesh_is_written_to_standard_output(torus, tmp_path, suffix):
    done = process("info", torus, "-o", "-", "--output-format", suffix[1:])
    assert done.returncode == 0, done.stderr
    again = tmp_path / f"again{suffix}"
    again.write_bytes(done.stdout)
    assert read_mesh(str(again)).mesh.n_faces == 192


def test_wrong_outputs_are_refused_before_reading(run, tmp_path):
    nowhere = tmp_path / "nowhere.ply"  # never read: the output is looked at first
    refused(run("info", nowhere, "-o", tmp_path / "a.foo"), "a.foo", ".vtu")
    refused(run("info", nowhere, "-o", tmp_path / "missing" / "a.vtu"), "missing", "create")
    refused(run("info", nowhere, "-o", tmp_path), str(tmp_path))
    refused(run("info", nowhere, "-o", "-"), "--output-format")
    refused(run("info", nowhere, "-o", "-", "--output-format", "ply", "--json"), "--json")
    refused(run("info", nowhere, "--plot", tmp_path / "a.gif"), ".png")
    refused(run("info", nowhere, "-q", "-v"), "-q")
    refused(run("info", nowhere), "no such file")
    refused(run("info", tmp_path), "is a folder")


def test_too_many_subdivided_faces_are_an_error(run, tmp_path, monkeypatch):
    monkeypatch.setattr("ddgcli.cli.run.MAX_SUBDIVIDED_FACES", 1000)
    sphere = tmp_path / "sphere.ply"
    write_mesh(str(sphere), AnnotatedMesh(shapes.icosphere(1)))
    assert run("laplacian", sphere, "--subdivide", 1).exit_code == 0
    refused(run("laplacian", sphere, "--subdivide", 2), "1,280 faces", "use a smaller number")


def test_two_outputs_with_one_name_are_an_error(run, torus, tmp_path):
    one, same = tmp_path / "a.npz", f"{tmp_path}/./a.npz"
    refused(run("delaunay", torus, "-o", one, "--overlay", same), "a.npz", "two outputs")
    refused(run("laplacian", torus, "--matrix", one, "--mass-matrix", one), "a.npz", "two outputs")
    refused(run("info", torus, "-o", one, "-o", same), "a.npz", "two outputs")
    lines = ("geodesic", torus, "--source", 0, "--isolines", 2)
    refused(run(*lines, "-o", one, "--paths-output", same), "a.npz", "two outputs")
    link = tmp_path / "link.npz"
    link.symlink_to(one)
    refused(run("info", torus, "-o", one, "-o", link), "link.npz", "two outputs")
    assert not one.exists()


def test_plot_without_matplotlib_names_the_extra(run, torus, tmp_path, monkeypatch):
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n, *a: None if n == "matplotlib" else find(n, *a))
    refused(run("info", torus, "--plot", tmp_path / "a.png"), "ddgcli[plot]")


def test_the_input_is_never_overwritten(run, torus, tmp_path):
    before = torus.read_bytes()
    refused(run("info", torus, "-o", torus), "input")
    link = tmp_path / "link.ply"
    link.symlink_to(torus)
    refused(run("info", torus, "-o", link), "input")
    for place in (torus, link):  # outputs that are not -o
        refused(run("geodesic", torus, "--source", 0, "--isolines", 2, "--paths-output", place), "input")
        refused(run("delaunay", torus, "--overlay", place), "input")
    assert torus.read_bytes() == before


def test_an_array_that_is_read_is_never_overwritten(run, torus, tmp_path):
    array = tmp_path / "array.npz"
    np.savez(array, np.cross([0, 0, 1.0], read_mesh(str(torus)).mesh.points))
    before = array.read_bytes()
    refused(run("geodesic", torus, "--field", array, "--paths-output", array), "input")
    refused(run("hodge", torus, "--field-file", array, "-o", array), "input")
    refused(run("laplacian", torus, "--poisson", array, "--matrix", array), "input")
    assert array.read_bytes() == before


def test_an_unplanned_output_cannot_overwrite_the_input(run, torus, monkeypatch):
    """A command that does not plan an output cannot write it over the input either."""
    monkeypatch.setattr("ddgcli.cli.run.Run.plan_output", lambda *words: None)
    before = torus.read_bytes()
    refused(run("geodesic", torus, "--source", 0, "--isolines", 2, "--paths-output", torus), "input")
    assert torus.read_bytes() == before


def test_two_outputs_are_written_and_replaced(summary, torus, tmp_path):
    paths = [tmp_path / "a.vtu", tmp_path / "b.npz"]
    for _ in range(2):
        document = summary("info", torus, "-o", paths[0], "-o", paths[1])
        assert document["outputs"] == [str(p) for p in paths]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.vtu", "b.npz", "torus.ply"]


def test_a_failed_write_leaves_the_old_file(run, torus, tmp_path, monkeypatch):
    output = tmp_path / "a.vtu"
    output.write_text("old")

    def full(source, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    refused(run("info", torus, "-o", output), "No space left")
    assert output.read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.vtu", "torus.ply"]


def test_the_same_run_writes_the_same_bytes(run, torus, tmp_path):
    output, written = tmp_path / "a.vtu", []
    for _ in range(2):
        assert run("info", torus, "-o", output, "--units-note", "mm").exit_code == 0
        written.append(output.read_bytes())
    assert written[0] == written[1]
    for word in (b"ddgcli info", b"input_sha256", b"units_note", b"converged"):
        assert word in written[0]


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


# -- progress ---------------------------------------------------------------------------------------------


def test_progress_bar_follows_terminal_and_option(capsys):
    for terminal, option, drawn in (
        (False, None, False),
        (True, False, False),
        (True, None, False),
        (None, True, True),
    ):
        bar = Progress("work", terminal, option)
        bar(1, 4)
        bar.clear()
        assert ("work" in capsys.readouterr().err) == drawn


def test_bar_appears_when_work_is_long(capsys):
    bar = Progress("work", True, None)
    bar.due = 0.0
    bar(1, 4)
    assert "25 %" in capsys.readouterr().err
    bar.clear()
    bar(2, 4)
    assert "50 %" not in capsys.readouterr().err


def test_time_left_is_shown_from_the_first_measurable_share(capsys):
    for done, has_estimate in ((0, False), (1e-9, False), (1e-3, False), (0.1, True), (1, True)):
        bar = Progress("work", None, True)
        bar(done)
        assert ("s left" in capsys.readouterr().err) == has_estimate


def test_the_estimate_of_the_time_left_only_falls(capsys):
    bar, seconds = Progress("work", None, True), []
    for elapsed, done in ((1.0, 0.1), (2.0, 0.5), (30.0, 0.55), (40.0, 0.99)):
        bar.began, bar.due = time.perf_counter() - elapsed, 0.0
        bar(done)
        seconds.append(int(re.search(r"(\d+) s left", capsys.readouterr().err)[1]))
    assert seconds == [9, 2, 2, 0]  # the third step alone would say 25


def test_progress_bar_is_redrawn_during_silent_work(capsys, monkeypatch):
    monkeypatch.setattr("ddgcli.cli.progress.IDLE_INTERVAL", 0.05)
    bars = [Progress(name, True, None, since=time.perf_counter() - 10) for name in ("silent", "quarter")]
    bars[1](1, 4)
    output, until = "", time.perf_counter() + 60
    while time.perf_counter() < until and (output.count("silent: 0 s") < 2 or output.count("25 %") < 3):
        time.sleep(0.02)
        output += capsys.readouterr().err
    assert output.count("silent: 0 s") >= 2 and output.count("25 %") >= 3
    for bar in bars:
        bar.clear()
    capsys.readouterr()
    time.sleep(0.3)
    assert capsys.readouterr().err == ""


def test_no_command_is_silent_for_long_on_a_terminal(torus):
    """Whatever it does, and without a word of the core: here reading, slowed."""
    code = (
        "import time\nfrom ddgcli.io import mesh_file\nfrom ddgcli.cli.main import main\n"
        "read = mesh_file.read_mesh\n"
        "mesh_file.read_mesh = lambda *words: (time.sleep(3), read(*words))[1]\n"
        f"main(['info', {str(torus)!r}], standalone_mode=False)\n"
    )
    pty = pytest.importorskip("pty")
    master, slave = pty.openpty()
    run = subprocess.Popen([sys.executable, "-c", code], stderr=slave, stdout=subprocess.DEVNULL)
    assert run.wait(timeout=300) == 0
    output = os.read(master, 10_000).decode()
    os.close(slave), os.close(master)
    assert "info: " in output and " s" in output and output.endswith("\r")


@pytest.mark.parametrize("name", COMMANDS)
def test_help_imports_no_numpy(name):
    code = (
        "import sys\nfrom ddgcli.cli.main import main\n"
        f"main([{name!r}, '--help'], standalone_mode=False)\n"
        "sys.exit(str([m for m in ('numpy', 'scipy', 'pydantic', 'h5py') if m in sys.modules] or ''))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stderr.strip() == "" and done.stdout.startswith("Usage:")


@pytest.mark.parametrize("words", [["--seed", -1], ["--seed", 1.5]])
def test_an_invalid_seed_is_an_error(run, torus, words):
    result = run("laplacian", torus, "--eigen", 2, *words)
    assert result.exit_code == 2 and "--seed" in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.parametrize("command", ["shell-sim", "fluid-sim"])
def test_a_scene_without_effects_gives_a_warning(summary, torus, command):
    document = summary(command, torus, "--steps", 1, "--dt", 1e-3)
    assert any("nothing acts" in warning for warning in document["warnings"])
