"""Do `stvk` and `midedge` converge on the benchmark shells of Sze, Liu and Lo (2004), and on linear ones?

Run: `python -m benchmarks.peers.shell_problems [WORDS OF A PROBLEM] [--quick]`. Displacements at every load
fraction against the published tables, on regular (alternating) and irregular (random Delaunay) meshes; hinges
beside them. Errors are in per cent of the largest displacement of the point under the whole load; a step that
fails leaves the rest of its row empty. Linear problems: deflection over the reference value.
"""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.common.linear_shells import LINEAR_PROBLEMS, deflection
from benchmarks.common.measure import cpu_seconds, machine, print_commands, print_table
from benchmarks.common.shell_problems import PROBLEMS, displacements
from ddgcli.errors import SolveError

STEPS = {"slit annular plate": 40, "pinched cylinder": 40}
FACES, QUICK_FACES = (600, 1800, 4800), (300, 600)
COMMANDS = ("shell-sim sample_scenes/strip_buckling.toml --buckling 3",)


def nonlinear(word: str, sizes: tuple[int, ...]) -> None:
    """One table for each problem whose name contains a word."""
    for name, problem in PROBLEMS.items():
        if word not in name:
            continue
        truth = np.array(problem.reference).T
        largest = np.abs(truth).max(axis=0)
        rows = []
        for pattern in ("alternating", "irregular"):
            for bending in ("midedge", "hinge"):
                for faces in sizes if bending == "midedge" else sizes[1:2]:
                    begin = cpu_seconds()
                    try:
                        m, moves = displacements(problem, faces, pattern, bending, STEPS.get(name, 20))
                    except SolveError as error:
                        rows.append([pattern, bending, faces, str(error)[:40], "", ""])
                        continue
                    errors = 100 * np.abs(moves - truth) / largest
                    seconds = cpu_seconds() - begin
                    rows.append(
                        [pattern, bending, m, f"{np.nanmax(errors):.2f}",
                         " ".join(f"{e:.2f}" for e in errors[-1]), f"{seconds:.0f}"]
                    )  # fmt: skip
        header = ["mesh", "bending", "triangles", "largest error, %", "at the whole load, %", "CPU s"]
        print_table(f"{name}: {len(problem.fractions)} load fractions", header, rows)


def linear(word: str, sizes: tuple[int, ...]) -> None:
    """Deflections over the reference values."""
    for name, problem in LINEAR_PROBLEMS.items():
        if word not in name:
            continue
        rows = []
        for pattern in ("alternating", "irregular"):
            for bending in ("midedge", "hinge"):
                ratios = [deflection(problem, faces, pattern, bending) for faces in sizes]
                rows.append([pattern, bending, *(f"{m}: {ratio:.4f}" for m, ratio in ratios)])
        print_table(f"{name} (linear): deflection / {problem.reference:g}", ["mesh", "bending", *sizes], rows)


def main() -> None:
    """Tables of the problems whose names contain the words of the command line."""
    words = [word for word in sys.argv[1:] if not word.startswith("-")]
    quick = "--quick" in sys.argv
    print(machine())
    linear(" ".join(words), QUICK_FACES if quick else FACES)
    nonlinear(" ".join(words), QUICK_FACES if quick else FACES)


if __name__ == "__main__":
    main()
    print_commands(*COMMANDS)
