"""Outputs that cannot be, ends at any moment: the file is whole or absent, and nothing is left beside it."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ddgcli.io import mesh_file, output_file
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

ROOT = Path(__file__).parents[2]
needs_posix = pytest.mark.skipif(os.name != "posix", reason="POSIX files, signals and limits")


@pytest.fixture
def ball(tmp_path):
    path = tmp_path / "ball.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(2)))
    return path


def start(*words, **more) -> subprocess.Popen:
    # where the size of files is limited, Python would keep truncated bytecode of modules
    env = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    call = [sys.executable, "-m", "ddgcli", *map(str, words)]
    return subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env, **more)


def one_line(result, words: str) -> None:
    assert result.exit_code == 2, result.stderr
    assert words in result.stderr and result.stderr.count("\n") == 1


@needs_posix
def test_names_that_no_file_can_have_are_one_short_line(run, ball, tmp_path):
    name = "x" * 5000
    for words in (
        ["info", f"{name}.obj"],
        ["curvature", ball, "-o", f"{name}.vtu"],
        ["shell-sim", f"{name}.toml"],
        ["frames", f"{name}.vtkhdf", "-o", tmp_path / "all.ply"],
        ["check", name],
        ["laplacian", ball, "--poisson", name],
        ["examples", name],
    ):
        result = run(*words)
        one_line(result, "file name too long")
        assert len(result.stderr) < 400
    assert list(tmp_path.iterdir()) == [ball]


def test_a_message_repeats_no_long_value(run, ball):
    for value in ("x" * 5000, "1 + " * 2000 + "q"):
        result = run("laplacian", ball, "--operator", value)
        one_line(result, "is not one of 'cotan'")
        assert len(result.stderr) < 400


def without_permissions(*words) -> subprocess.CompletedProcess:
    """A run that may not open what its user may not open, also by root."""
    prefix = []
    if os.geteuid() == 0:  # which reads everything: give up that capability
        if shutil.which("setpriv") is None:
            pytest.skip("run by root, without setpriv")
        less = "-dac_override,-dac_read_search"
        prefix = ["setpriv", f"--bounding-set={less}", f"--inh-caps={less}"]
    call = [*prefix, sys.executable, "-m", "ddgcli", *map(str, words)]
    return subprocess.run(call, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(ROOT)})


@needs_posix
@pytest.mark.parametrize(
    ("command", "name"), [("info", "a.ply"), ("shell-sim", "a.toml"), ("view", "a.vtkhdf")]
)
def test_a_file_that_may_not_be_read_is_one_line(tmp_path, command, name):
    """Once a line of click about 'MESH'."""
    path, output = tmp_path / name, ["-o", tmp_path / "a.html"] if command == "view" else []
    path.touch(mode=0)
    result = without_permissions(command, path, *output)
    assert result.returncode == 2
    assert result.stderr == f"Error: {path}: permission denied; check the path\n"


@needs_posix
@pytest.mark.parametrize(
    "words", [["info", "ball.ply"], ["shell-sim", "a.toml"], ["check", "a"], ["examples", "q"]]
)
def test_files_of_a_closed_folder_are_one_line(ball, tmp_path, words):
    closed = tmp_path / "closed"
    closed.mkdir()
    ball.rename(closed / ball.name)
    closed.chmod(0)
    result = without_permissions(words[0], closed / words[1])
    closed.chmod(0o700)
    assert result.returncode == 2 and result.stderr.count("\n") == 1
    assert result.stderr.endswith("permission denied; check the path\n")


@needs_posix
@pytest.mark.parametrize("kind", ["folder", "fifo", "device", "link to a device"])
@pytest.mark.parametrize("words", [["curvature"], ["shell-sim", "--effect", "bending", "--steps", "1"]])
def test_an_output_that_is_no_file_is_left_as_it_is(run, ball, tmp_path, kind, words):
    target = tmp_path / ("o.ply" if words[0] == "curvature" else "o.vtkhdf")
    if kind == "folder":
        target.mkdir()
    elif kind == "fifo":
        os.mkfifo(target)
    elif kind == "device":
        try:
            os.mknod(target, 0o666 | 0o020000, os.makedev(1, 3))
        except PermissionError:
            pytest.skip("devices are made by root only")
    else:
        target.symlink_to(os.devnull)
    before = os.lstat(target)
    one_line(run(words[0], ball, *words[1:], "-o", target), "is a ")
    assert (os.lstat(target).st_mode, os.lstat(target).st_ino) == (before.st_mode, before.st_ino)
    assert {p.name for p in tmp_path.iterdir()} == {ball.name, target.name}


def test_a_link_to_a_file_is_written_through(run, ball, tmp_path):
    (tmp_path / "real.ply").write_bytes(b"old")
    (tmp_path / "o.ply").symlink_to(tmp_path / "real.ply")
    assert run("curvature", ball, "-o", tmp_path / "o.ply").exit_code == 0
    assert (tmp_path / "o.ply").is_symlink()
    assert read_mesh(str(tmp_path / "real.ply")).mesh.n_faces == 320


def test_a_folder_that_vanishes_during_the_run(run, ball, tmp_path, monkeypatch):
    folder = tmp_path / "out"
    folder.mkdir()
    monkeypatch.setattr(output_file, "_check_regular", lambda path: folder.exists() and folder.rmdir())
    result = run("curvature", ball, "-o", folder / "o.ply")
    assert result.exit_code == 2 and result.stderr.count("\n") == 1


@needs_posix
@pytest.mark.parametrize(
    "words",
    [["curvature", "-o", "o.ply"], ["shell-sim", "--effect", "bending", "--steps", "2", "-o", "o.vtkhdf"]],
)
def test_a_full_disk_leaves_nothing_but_one_line(ball, tmp_path, words):
    import resource

    def limit() -> None:  # as on a full disk, writing fails; the old file stays
        resource.setrlimit(resource.RLIMIT_FSIZE, (8192, 8192))

    (tmp_path / words[-1]).write_bytes(b"old")
    process = start(words[0], ball, *words[1:], cwd=tmp_path, preexec_fn=limit)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 2, errors
    assert "cannot be written (File too large)" in errors and errors.count("Error") == 1
    assert (tmp_path / words[-1]).read_bytes() == b"old"
    assert {p.name for p in tmp_path.iterdir()} == {ball.name, words[-1]}


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@needs_posix
def test_a_current_folder_that_was_deleted_is_one_line(run, ball, tmp_path, monkeypatch):
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path / "folder")
    (tmp_path / "folder").rmdir()
    one_line(run("curvature", ball, "-o", "a.vtu"), "the current folder was deleted")


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (ImportError("x.so: failed to map segment from shared object"), " (a library does not fit)"),
        (MemoryError(), ""),
        (MemoryError("3 GiB"), " (3 GiB)"),
    ],
)
def test_a_limit_of_memory_is_one_line_wherever_it_is_met(run, ball, monkeypatch, error, reason):
    """`ulimit -v` of 160 MB: the system cannot load a library of scipy."""

    def fail(*words, **options):
        raise error

    monkeypatch.setattr(mesh_file, "read_mesh", fail)
    result = run("info", ball)
    assert (result.exit_code, result.stderr) == (
        1,
        f"Error: out of memory{reason}; use a smaller mesh or fewer outputs\n",
    )


def test_a_file_on_a_full_standard_output_is_an_error_of_the_call(ball):
    """Once exit 1, which means that the outputs are complete."""
    with open("/dev/full", "w") as full:
        call = [sys.executable, "-m", "ddgcli", "curvature", str(ball), "-o", "-", "--output-format", "ply"]
        done = subprocess.run(call, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr == "Error: -: cannot be written (No space left on device); the output is cut\n"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_standard_output_is_one_line(ball):
    with open("/dev/full", "w") as full:
        env = {**os.environ, "PYTHONPATH": str(ROOT)}
        call = [sys.executable, "-m", "ddgcli", "info", str(ball)]
        done = subprocess.run(call, stdout=full, stderr=subprocess.PIPE, text=True, env=env, timeout=120)
    assert done.returncode == 1
    assert "No space left" in done.stderr and done.stderr.count("\n") == 1


@needs_posix
@pytest.mark.parametrize("moment", ["before", "during"])
def test_a_signal_at_the_write_leaves_nothing(ball, tmp_path, monkeypatch, run, moment):
    """In this process, so that the moment is sure: SIGTERM just before, and in the middle of, the write."""

    def write(file, content):
        if moment == "during":
            file.write(content[: len(content) // 2])
            file.flush()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)  # the signal ends it

    monkeypatch.setattr(output_file, "write_content", write)
    result = run("curvature", ball, "-o", tmp_path / "o.ply")
    assert result.exit_code == 128 + signal.SIGTERM
    assert [p.name for p in tmp_path.iterdir()] == [ball.name]
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


@needs_posix
def test_the_leftover_of_a_killed_run_is_removed_and_that_of_a_living_one_is_not(tmp_path, ball):
    from ddgcli.io.temporary import temporary_name

    with subprocess.Popen([sys.executable, "-c", "pass"]) as dead:
        dead.wait()
    own = Path(temporary_name(tmp_path / "o.ply", ".ply"))
    own.touch()
    leftover = own.with_name(own.name.replace(f"-{os.getpid()}-", f"-{dead.pid}-"))
    leftover.touch()
    (tmp_path / "other.ply").touch()
    write_mesh(str(tmp_path / "o.ply"), AnnotatedMesh(shapes.icosphere(1)))
    assert {p.name for p in tmp_path.iterdir()} == {ball.name, own.name, "other.ply", "o.ply"}
    assert own.suffix == ".ply" and own.name.startswith(".o-")


def test_two_runs_on_one_output(tmp_path, ball):
    from ddgcli.errors import OutputError
    from ddgcli.io.trajectories.layout import Header
    from ddgcli.io.trajectories.writer import TrajectoryWriter
    from ddgcli.mesh.fields import TrajectoryFrame

    mesh = shapes.icosphere(1)
    path = str(tmp_path / "o.vtkhdf")
    writers = [TrajectoryWriter(path, Header(mesh, True), 2) for _ in range(2)]
    for writer in writers:
        writer.append(TrajectoryFrame(0, 0.0, mesh.points, {}, {}))
    with pytest.raises(OutputError, match="another run took this place"):
        writers[0].close("complete")
    assert writers[1].close("complete") == path
    assert {p.name for p in tmp_path.iterdir()} == {ball.name, "o.vtkhdf"}


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_run_ends_where_python_drops_the_exception_of_a_signal(tmp_path, name):
    """Exceptions in destructors and callbacks are dropped; the signal comes again, and nothing is printed."""
    (tmp_path / "scene.toml").write_text(
        "[time]\nduration = 1000\nstep = 1e-3\nframe_every = 1e-3\n[[object]]\nname = 's'\nrole = 'shell'\n"
        "grid = { size = [1, 1], cells = [2, 2] }\nmaterial = 'rubber'\n[effects]\nstretching = {}\n"
    )
    program = (
        "import os, signal, sys\n"
        "from ddgcli.cli import main\n"
        "from ddgcli.simulation import recording\n"
        "class Interrupted:\n"
        "    def __del__(self):\n"
        f"        os.kill(os.getpid(), signal.{name})\n"
        "joined = recording.joined_frame\n"
        "def drop(snapshot):\n"
        "    if snapshot.frame_number == 3:\n"
        "        Interrupted()\n"
        "    return joined(snapshot)\n"
        "recording.joined_frame = drop\n"
        "main.main(['shell-sim', 'scene.toml', '-o', 'run.vtkhdf'])\n"
    )
    child = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path, timeout=100,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert child.returncode == 128 + getattr(signal, name)
    assert name == "SIGTERM" or "whole frames; continue with --resume run.vtkhdf.part" in child.stderr
    assert "ignored" not in child.stderr and "Traceback" not in child.stderr


INTERRUPTED = """
import os, signal, sys
from ddgcli.cli import main
from ddgcli.io import mesh_file
def read(*words, **more):
    {body}
mesh_file.read_mesh = read
sys.exit(main.main(["info", sys.argv[1]]))
"""


def info_with_reader(path, body, *folders):
    """The process of `info` on a file, with this body in place of the reader of meshes."""
    return subprocess.run(
        [sys.executable, "-c", INTERRUPTED.format(body=body), path],
        capture_output=True, text=True, timeout=60,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([*map(str, folders), *sys.path])},
    )  # fmt: skip


@needs_posix
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_command_without_steps_ends_where_python_drops_the_exception_of_a_signal(ball, name):
    child = info_with_reader(
        ball,
        f"""import time
    class Signalled:
        def __del__(self):
            os.kill(os.getpid(), signal.{name})
    Signalled()
    for _ in range(1000):
        time.sleep(0.05)""",
    )
    text = {"SIGINT": "Interrupted\n", "SIGTERM": "Ended by SIGTERM\n"}[name]
    assert (child.returncode, child.stderr) == (128 + getattr(signal, name), text)


@needs_posix
def test_a_signal_that_comes_again_before_python_has_dropped_it_prints_nothing(ball):
    """On a busy machine the thread that delivers it runs before the hook has returned; it starts no other."""
    child = info_with_reader(
        ball,
        """import _thread, threading, time
    def slow(start):
        starts = []
        def call(*words):
            starts.append(words)
            if len(starts) > 1:
                os._exit(99)
            start(*words)
            time.sleep(0.1)
        return call
    threading.Thread.start = slow(threading.Thread.start)
    _thread.start_new_thread = slow(_thread.start_new_thread)
    class Signalled:
        def __del__(self):
            os.kill(os.getpid(), signal.SIGINT)
    Signalled()
    for _ in range(1000):
        time.sleep(0.05)""",
    )
    assert (child.returncode, child.stderr) == (130, "Interrupted\n")


@needs_posix
def test_sigterm_that_a_library_makes_another_error_ends_with_its_code(ball):
    body = (
        "try:\n        os.kill(os.getpid(), signal.SIGTERM)\n"
        "    except BaseException:\n        raise RuntimeError('failed') from None"
    )
    child = info_with_reader(ball, body)
    assert (child.returncode, child.stderr) == (128 + signal.SIGTERM, "Ended by SIGTERM\n")


@pytest.mark.parametrize(
    "body",
    [
        "exec('os.kill(os.getpid(), signal.SIGINT)')",
        "import interrupted_library",
        "from interrupted_library import anything",
    ],
)
def test_an_interrupt_that_python_or_a_library_changes_ends_with_130(tmp_path, ball, body):
    """In the text of `exec` Python would end with the signal; an extension module makes it an ImportError."""
    (tmp_path / "interrupted_library.py").write_text(
        "import os, signal, sys\n"
        "try:\n    os.kill(os.getpid(), signal.SIGINT)\n"
        "except KeyboardInterrupt:\n"
        "    sys.excepthook(*sys.exc_info())\n"
        "    raise ImportError('failed to import') from None\n"
    )
    child = info_with_reader(ball, body, tmp_path)
    assert (child.returncode, child.stderr) == (130, "Interrupted\n")


def redirected(words: str, folder: Path, more: str) -> subprocess.CompletedProcess:
    """The program in a shell, with its streams redirected."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    call = f"'{sys.executable}' -m ddgcli {words} {more}"
    return subprocess.run(call, shell=True, cwd=folder, capture_output=True, text=True, env=env, timeout=120)


@needs_posix
@pytest.mark.parametrize("where", ["2>&-", "2>/dev/full"])
def test_a_run_whose_messages_cannot_be_written_has_its_results(ball, tmp_path, where):
    """It ended with exit 1 and no output, although the file was written."""
    done = redirected("laplacian ball.ply --wave 0 --duration 6 --dt 0.5 -o out.npz --json", tmp_path, where)
    assert done.returncode == 0 and '"wave_time_error"' in done.stdout and "errs by" in done.stdout
    assert (tmp_path / "out.npz").read_bytes()[:2] == b"PK"


@needs_posix
@pytest.mark.parametrize(
    "words, where, message",
    [
        ("info ball.ply -o - --output-format ply", ">&-", "standard output is closed; name a file"),
        ("info - --input-format ply", "<&-", "standard input is closed; name a file"),
        ("shell-sim - --input-format toml", "<&-", "standard input is closed; name a file"),
    ],
)
def test_a_closed_stream_is_one_line(ball, tmp_path, words, where, message):
    done = redirected(words, tmp_path, where)
    assert done.returncode == 2 and message in done.stderr and done.stderr.count("\n") == 1


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("words", ["--help", "--version"])
def test_a_help_text_that_cannot_be_written_is_one_line(tmp_path, words):
    done = redirected(words, tmp_path, ">/dev/full")
    assert done.returncode == 1 and "No space left" in done.stderr and done.stderr.count("\n") == 1


@needs_posix
def test_an_interrupt_while_the_program_is_imported_is_one_line():
    code = (
        "import os, signal, sys\n"
        "class Interrupt:\n"
        "    def find_spec(name, *rest):\n"
        "        if name == 'click':\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupt)\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from ddgcli.__main__ import main\n"
        "main()\n"
    )
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    call = [sys.executable, "-c", code]
    done = subprocess.run(call, capture_output=True, text=True, env=env, timeout=120)
    assert (done.returncode, done.stderr) == (130, "Interrupted\n")
