"""Do `stvk` and `midedge` converge on the benchmark shells of Sze, Liu and Lo (2004), and on linear ones?

Run: `python -m benchmarks.peers.shell_problems [WORDS OF A PROBLEM] [--quick] [--ledger FILE] [--stored]`.
Displacements at every load fraction against the published tables, on regular (alternating) and irregular
(random Delaunay) meshes; hinges beside them. Errors are in per cent of the largest displacement of the point
under the whole load, and of its displacement under the same load. A run of thousands of triangles takes
minutes: `--ledger` appends each to a file of JSON lines and takes from it what it holds; `--stored` prints
what it holds and computes nothing more. Linear problems: deflection over the reference value.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.linear_shells import LINEAR_PROBLEMS, deflection
from benchmarks.common.measure import cpu_seconds, machine, print_commands, print_table
from benchmarks.common.shell_problems import PROBLEMS, displacements
from ddgcli.errors import SolveError

STEPS = {"slit annular plate": 40, "pinched cylinder": 40}
FACES, QUICK_FACES = (600, 1800, 4800), (300, 600)
COMMANDS = ("shell-sim strip_buckling.toml --buckling 3",)


def nonlinear(word: str, sizes: tuple[int, ...], path: str, stored: bool) -> None:
    """One table for each problem whose name contains a word."""
    for name, problem in PROBLEMS.items():
        if word not in name:
            continue
        rows = []
        for pattern in ("alternating", "irregular"):
            for bending in ("midedge", "hinge"):
                for faces in sizes if bending == "midedge" else sizes[1:2]:
                    run = ledger(path).get((name, pattern, bending, faces))
                    if run is None and not stored:
                        run = displacement_run(name, pattern, bending, faces)
                        append(path, run)
                    if run is not None:
                        rows.append([pattern, bending, *figures(run, np.array(problem.reference).T)])
        header = [
            "mesh", "bending", "triangles", "largest error, % of the whole path", "at the whole load, %",
            "largest error, % of the displacement", "CPU s",
        ]  # fmt: skip
        if rows:
            print_table(f"{name}: {len(problem.fractions)} load fractions", header, rows)


def displacement_run(name: str, pattern: str, bending: str, faces: int) -> dict[str, Any]:
    """Row of the ledger: displacements of one problem on one mesh, or why it failed."""
    begin = cpu_seconds()
    run: dict[str, Any] = {"key": [name, pattern, bending, faces]}
    try:
        run["faces"], moves = displacements(PROBLEMS[name], faces, pattern, bending, STEPS.get(name, 20))
        run["moves"] = moves.tolist()
    except SolveError as error:
        run["error"] = str(error)
    return run | {"cpu": cpu_seconds() - begin}


def figures(run: dict[str, Any], truth: NDArray) -> list[Any]:
    """Triangles, errors in per cent, seconds."""
    if "moves" not in run:
        return [run["key"][3], run["error"][:40], "", "", f"{run['cpu']:.0f}"]
    difference = np.abs(np.array(run["moves"]) - truth)
    whole = 100 * difference / np.abs(truth).max(axis=0)
    # where a point returns to its place there is no displacement to compare with
    moved = np.abs(truth) > 0.02 * np.abs(truth).max(axis=0)
    own = 100 * difference[moved] / np.abs(truth[moved])
    return [
        run["faces"], f"{np.nanmax(whole):.2f}", " ".join(f"{e:.2f}" for e in whole[-1]),
        f"{np.nanmax(own):.2f}", f"{run['cpu']:.0f}",
    ]  # fmt: skip


def ledger(path: str) -> dict[tuple[str, str, str, int], dict[str, Any]]:
    """Rows of a ledger by problem, mesh, bending and number of triangles."""
    if not path or not Path(path).exists():
        return {}
    rows = [json.loads(line) for line in Path(path).read_text(encoding="utf-8").splitlines()]
    return {tuple(row["key"]): row for row in rows}


def append(path: str, run: dict[str, Any]) -> None:
    """Add a row to a ledger."""
    if path:
        with open(path, "a", encoding="utf-8") as file:
            file.write(json.dumps(run) + "\n")


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
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("words", nargs="*")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--ledger", default="")
    parser.add_argument("--stored", action="store_true")
    options = parser.parse_args()
    word, sizes = " ".join(options.words), QUICK_FACES if options.quick else FACES
    print(machine())
    if not options.stored:
        linear(word, sizes)
    nonlinear(word, sizes, options.ledger, options.stored)
    if not options.stored:
        print_commands(*COMMANDS)


if __name__ == "__main__":
    main()
