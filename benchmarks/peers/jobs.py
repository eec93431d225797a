"""How much faster is `--jobs 2` where tasks are independent, with the same bytes as one?

python -m benchmarks.peers.jobs [NAME OF A CASE ...]

Wall-clock seconds of a loaded machine mean little, so the speed-up is that of the longest chain of work: CPU
seconds of the run with one job, over the CPU seconds of the main thread and of the busiest worker with two
(or half of all workers, if that is more: a batch has a process for each task).
It is what two quiet cores show, up to waiting for locks; a further column has the wall-clock speed-up.
Workers are the threads and processes below the command; their CPU seconds are sampled from /proc as they run.
Start-up, reading and writing are included. Of three pairs of runs that of the median speed-up counts.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.common.measure import print_commands, print_table
from benchmarks.common.process import ROOT

POLL_SECONDS = 0.02
AIM = 1.6  # 0.8 of two cores
PAIRS, SPEED_UP = 3, 4  # of runs, of which that of the median speed-up counts; its column
CASES = {
    "sources": (
        "geodesic {sphere} --source {sources} --target {sources} --distance-matrix {out}.npz", ".npz"
    ),
    "curvature blocks": ("curvature {large} --radius {radius} -o {out}.npz", ".npz"),
    "curvature blocks of a small mesh": ("curvature {sphere} --radius {small_radius} -o {out}.npz", ".npz"),
    "frames": ("frames {run} -o {out}.gif", ".gif"),
    "batch": ("batch {sphere} --sweep heat-time=0.01,0.02,0.03,0.04,0.05,0.06 --table {out}.jsonl -- "
              "geodesic --source 0 --method heat --heat-refine 0", ""),
}  # fmt: skip
COMMANDS = ("curvature sphere.ply --jobs 2",)
MAKE = """
import sys
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
for path, n_vertices in zip(sys.argv[1:], (20_002, 80_002)):
    sphere = shapes.random_sphere(n_vertices, 0)
    write_mesh(path, AnnotatedMesh(sphere))
    print(12 * float(sphere.side_length.mean()))
"""


def cpu_of_threads(root: int) -> dict[tuple[int, int], float]:
    """CPU seconds of each running thread of a process and of the processes below it, by (process, thread)."""
    tick, seconds, waiting = os.sysconf("SC_CLK_TCK"), {}, [root]
    while waiting:
        process = waiting.pop()
        try:
            threads = os.listdir(f"/proc/{process}/task")
        except OSError:
            continue
        for thread in threads:
            try:
                fields = Path(f"/proc/{process}/task/{thread}/stat").read_text().rsplit(")", 1)[1].split()
                waiting += map(int, Path(f"/proc/{process}/task/{thread}/children").read_text().split())
            except OSError:
                continue
            seconds[process, int(thread)] = (int(fields[11]) + int(fields[12])) / tick
    return seconds


def measured(words: list[str]) -> tuple[float, float, float]:
    """Seconds of `ddgcli WORDS`: CPU of all, CPU of the longest chain of work on two cores, wall-clock."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "ddgcli", *words]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    seconds: dict[tuple[int, int], float] = {}
    began = time.perf_counter()
    while True:
        seconds |= cpu_of_threads(process.pid)
        done, status, usage = os.wait4(process.pid, os.WNOHANG)
        if done:
            break
        time.sleep(POLL_SECONDS)
    wall = time.perf_counter() - began
    if os.waitstatus_to_exitcode(status):
        raise SystemExit(f"failed: {' '.join(words)}")
    main = seconds.pop((process.pid, process.pid), 0.0)
    of_workers = sum(seconds.values())
    longest = max(max(seconds.values(), default=0.0), of_workers / 2)
    # workers that are copies of another process are not among the children that the usage counts
    return max(usage.ru_utime + usage.ru_stime, main + of_workers), main + longest, wall


def content(path: Path) -> bytes:
    """Bytes of a file; of archives those of their arrays, without the record of the call."""
    if path.suffix != ".npz":
        return path.read_bytes()
    with np.load(path) as arrays:
        return b"".join(arrays[name].tobytes() for name in sorted(arrays) if arrays[name].dtype.kind in "fi")


def make_inputs(folder: Path) -> dict[str, str]:
    """Files and numbers that the calls name."""
    sphere, large, run = folder / "sphere.ply", folder / "large.ply", folder / "run.vtkhdf"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    call = [sys.executable, "-c", MAKE, str(sphere), str(large)]
    radii = subprocess.run(call, env=environment, check=True, capture_output=True, text=True).stdout.split()
    scene = ROOT / "sample_scenes" / "twisted_strip.toml"
    words = ["shell-sim", str(scene), "--steps", "24", "--frame-every", "1e-9", "-o", str(run)]
    subprocess.run([sys.executable, "-m", "ddgcli", *words], env=environment, check=True, capture_output=True)
    sources = " ".join(str(200 * k) for k in range(24))
    files = {"sphere": str(sphere), "large": str(large), "run": str(run), "sources": sources}
    return files | {"small_radius": radii[0], "radius": radii[1]}


def pair(name: str, inputs: dict[str, str], folder: Path) -> list[object]:
    """Row of a case: one job, then two."""
    call, suffix = CASES[name]
    chains, files = [], []
    for jobs in (1, 2):
        out = folder / f"{name.replace(' ', '-')}-{jobs}"
        first, *rest = call.format(**inputs, out=out).split()
        words = [first, rest[0], "--jobs", str(jobs), *rest[1:]]
        chains.append(measured(words))
        files.append(content(folder / (out.name + suffix)) if suffix else b"")
    (serial, _, serial_wall), (both, longest, wall) = chains
    same = "yes" if files[0] == files[1] else ("-" if not suffix else "no")
    fast = "yes" if serial / longest >= AIM else "no"
    return [name, serial, both, longest, serial / longest, fast, serial_wall / wall, same]


def main() -> None:
    """Measure the cases and print the table."""
    names = sys.argv[1:] or list(CASES)
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        inputs = make_inputs(folder)
        for name in names:
            pairs = [pair(name, inputs, folder) for _ in range(PAIRS)]
            rows.append(sorted(pairs, key=lambda row: row[SPEED_UP])[PAIRS // 2])
            print(rows[-1], file=sys.stderr, flush=True)
    print_table(
        "Two jobs",
        [
            "case",
            "CPU s, one job",
            "CPU s, two jobs",
            "longest chain s",
            "speed-up",
            f"at least {AIM}",
            "of wall-clock",
            "same bytes",
        ],
        rows,
    )


if __name__ == "__main__":
    main()
    print_commands(*COMMANDS)
