"""A full disk, a read-only folder, closed streams, signals in every command: one line, nothing left."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(os.name != "posix", reason="POSIX files, signals and mounts")
SHORT_RUN = ("--steps", "4", "--dt", "1e-3")
# words of a command, {input} and {output} to fill in; all write into the folder of the output
CALLS = {
    "curvature": ("{input}", "-o", "{output}.ply"),
    "laplacian": ("{input}", "--eigen", "3", "--matrix", "{output}.npz"),
    "dec": ("{input}", "-o", "{output}.npz"),
    "hodge": ("{input}", "--basis", "-o", "{output}.vtkhdf"),
    "geodesic": ("{input}", "--source", "0", "-o", "{output}.vtu"),
    "delaunay": ("{input}", "--overlay", "{output}.ply"),
    "repair": ("{input}", "--orient", "-o", "{output}.obj"),
    "view": ("{input}", "-o", "{output}.html"),
    "shell-sim": ("{input}", "--effect", "bending", *SHORT_RUN, "-o", "{output}.vtkhdf"),
    "fluid-sim": ("{input}", "--vorticity", "z", *SHORT_RUN, "-o", "{output}.vtkhdf"),
    "willmore-flow": ("{input}", "--steps", "3", "-o", "{output}.ply"),
}


def words_of(command: str, mesh: Path, folder: Path) -> list[str]:
    places = {"input": str(mesh), "output": str(folder / "o")}
    return [sys.executable, "-m", "ddgcli", command, *(word.format(**places) for word in CALLS[command])]


@pytest.fixture
def ball(tmp_path):
    path = tmp_path / "ball.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(3)))
    return path


@pytest.fixture
def disk(tmp_path):
    """A file system of 4 KiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=4k", "tmpfs", str(folder)]
    if os.geteuid() or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("only root mounts file systems")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def run_in_process(run, command, mesh, folder):
    return run(*words_of(command, mesh, folder)[3:])


@pytest.mark.parametrize("command", CALLS)
def test_a_full_disk_is_one_line_and_leaves_nothing(run, ball, disk, command):
    result = run_in_process(run, command, ball, disk)
    assert result.exit_code == 2, result.stderr
    assert "No space left on device" in result.stderr.splitlines()[-1]
    assert list(disk.iterdir()) == []


@pytest.mark.parametrize("command", ["curvature", "shell-sim"])
def test_a_read_only_folder_is_refused_before_any_work(run, ball, disk, command):
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
    result = run_in_process(run, command, ball, disk)
    assert result.exit_code == 2 and result.stderr.count("\n") == 1
    assert "cannot be written to" in result.stderr


def with_closed(words: list[str], closed: tuple[int, ...]) -> subprocess.CompletedProcess:
    """The command with some standard streams closed; the others are captured."""
    shell = " ".join(f"{fd}>&-" if fd else "<&-" for fd in closed)
    return subprocess.run(
        ["sh", "-c", f'exec "$@" {shell}', "sh", *words], capture_output=True, text=True, timeout=120,
        env={**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
    )  # fmt: skip


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (0, 1, 2)])
def test_closed_streams_do_not_spoil_the_output(ball, tmp_path, closed):
    done = with_closed(words_of("curvature", ball, tmp_path), closed)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "o.ply").read_bytes().startswith(b"ply")
    assert done.stderr == ""


def test_a_closed_stream_that_is_needed_is_refused_in_one_line(ball):
    call = [sys.executable, "-m", "ddgcli"]
    reading = with_closed([*call, "info", "-", "--input-format", "ply"], (0,))
    writing = with_closed([*call, "repair", str(ball), "--orient", "-o", "-", "--output-format", "ply"], (1,))
    assert (reading.returncode, writing.returncode) == (2, 2)
    assert "standard input is closed; name a file" in reading.stderr
    assert "standard output (-) is closed; name a file" in writing.stderr
    assert reading.stderr.count("\n") == writing.stderr.count("\n") == 1


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("command", CALLS)
def test_signals_at_random_moments_leave_the_output_whole_or_absent(ball, tmp_path, command):
    rng, folder = random.Random(command), tmp_path / "out"
    folder.mkdir()
    words = words_of(command, ball, folder)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    began = time.monotonic()
    assert subprocess.run(words, capture_output=True, env=environment, timeout=120).returncode == 0
    seconds = time.monotonic() - began
    (whole,) = folder.iterdir()
    size, name = whole.stat().st_size, whole.name
    whole.unlink()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL):
        for _ in range(3):
            process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment)
            time.sleep(rng.uniform(0.3, 1.0) * seconds)
            process.send_signal(number)
            process.communicate(timeout=120)
            left = {p.name for p in folder.iterdir()}
            # SIGKILL cannot be caught: a hidden temporary file may stay
            seen = {entry for entry in left if number != signal.SIGKILL or not entry.startswith(".")}
            assert process.returncode in (0, 128 + number, -number, 1 if number == signal.SIGINT else 0)
            assert seen <= {name, f"{name}.part"}
            if name in left and command not in ("shell-sim", "fluid-sim"):
                assert abs((folder / name).stat().st_size - size) < 200  # recorded seconds differ in length
            for entry in left:
                (folder / entry).unlink()
