"""Start-up of small commands beside Python's import of numpy and scipy.sparse, which each of them needs.

    python -m benchmarks.peers.start

Target: a command on a cube takes at most the CPU seconds of `python -c "import numpy, scipy.sparse"`.
"""

from __future__ import annotations

import statistics

from benchmarks.common import measure

COMMANDS = ("info cube.obj", "curvature cube.obj")
OTHER_CALLS = ("--version", "curvature --help", "geodesic cube.obj --source 0", "delaunay cube.obj")
IMPORTS = "import numpy, scipy.sparse"
REPEAT = 7


def bench() -> None:
    """Print CPU seconds of each command and their ratio to those of the imports, measured in turn."""
    measure.command_seconds("curvature", "cube.obj")  # compiles the modules
    imports: list[float] = []
    seconds: dict[str, list[float]] = {command: [] for command in (*COMMANDS, *OTHER_CALLS)}
    for _ in range(REPEAT):
        imports.append(measure.python_seconds("-c", IMPORTS).cpu)
        for command in (*COMMANDS, *OTHER_CALLS):
            seconds[command].append(measure.command_seconds(*command.split()).cpu)
    base = statistics.median(imports)
    rows = [[f'`python -c "{IMPORTS}"`', base, 1.0]]
    rows += [[f"`ddgcli {c}`", statistics.median(s), statistics.median(s) / base] for c, s in seconds.items()]
    measure.print_table("Start-up", ["process", "CPU s", "ratio"], rows)


if __name__ == "__main__":
    bench()
    measure.print_commands(*COMMANDS)
