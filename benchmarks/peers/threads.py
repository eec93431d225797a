"""Ten commands as a user starts them, with the default number of threads, with one, and with two.

    python -m benchmarks.peers.threads [PAIRS]

Whole processes, started in turn in an environment without thread variables. Every ratio is that of the least
CPU seconds, or seconds by the clock, of the repetitions: other load on the machine only adds. The default is
one thread, so its ratio to `--threads 1` is 1 up to noise.
"""

from __future__ import annotations

import sys

from benchmarks.common import measure
from benchmarks.common.mesh_sequences import SHARED_MESHES

TEN = (
    "info spot.obj",
    "curvature spot.obj",
    "laplacian spot.obj --hks 0.01 0.1",
    "geodesic spot.obj --source 0 --method heat",
    "delaunay spot.obj",
    "hodge torus.ply",
    "dec sphere.ply",
    "willmore-flow sphere.ply --steps 3",
    "fluid-sim sphere.ply --vorticity 5*z --steps 5 --dt 0.01",
    "shell-sim hat.toml --steps 20",
)
COUNTS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("default", ()),
    ("one", ("--threads", "1")),
    ("two", ("--threads", "2")),
)
COMMANDS = TEN[-2:]
PAIRS = 5
HEADER = [
    "command",
    "default CPU s",
    "default / one",
    "two / one",
    "default / one, clock",
    "two / one, clock",
]


def bench(pairs: int) -> None:
    """Print the ratios of every command."""
    rows: list[list[object]] = []
    for command in TEN:
        runs: dict[str, list[measure.CommandSeconds]] = {name: [] for name, _ in COUNTS}
        spot = str(SHARED_MESHES / "spot.obj")
        for _ in range(pairs):
            for name, words in COUNTS:
                runs[name].append(measure.command_seconds(*command.replace("spot.obj", spot).split(), *words))
        if any(run.exit_code for every in runs.values() for run in every):
            raise RuntimeError(f"ddgcli {command} failed")
        cpu = {name: min(run.cpu for run in every) for name, every in runs.items()}
        wall = {name: min(run.wall for run in every) for name, every in runs.items()}
        ratios = [times[name] / times["one"] for times in (cpu, wall) for name in ("default", "two")]
        rows.append([f"`{command}`", cpu["default"], *ratios])
    measure.print_table(f"Threads, the least of {pairs} runs", HEADER, rows)


if __name__ == "__main__":
    bench(int(sys.argv[1]) if len(sys.argv) > 1 else PAIRS)
    measure.print_commands(*COMMANDS)
