"""Do `stvk` and `midedge` converge on the benchmark shells of Sze, Liu and Lo (2004), and on linear ones?

Run: `python -m benchmarks.peers.shell_problems [WORDS OF A PROBLEM] [--quick] [--ledger FILE] [--stored]`.
Displacements at every load fraction against the published tables, on regular (alternating, tapered) and
irregular (random Delaunay) meshes; hinges beside them. The tables have three decimals and come from finite
elements of their own, so the displacements are also compared with the limit: the same theory by B-splines, or
in closed form. Errors are in per cent of the largest displacement of the point under the whole load ("of the
path"), and of its displacement under the same load. A run of thousands of triangles takes minutes: `--ledger`
appends each to a file of JSON lines and takes from it what it holds; `--stored` prints what it holds and
computes nothing more. Linear problems: deflection over the reference value.
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
from benchmarks.common.shell_problems import PROBLEMS, displacements, full_circle
from benchmarks.common.spline_shells import spline_displacements
from ddgcli.errors import SolveError

STEPS = {"slit annular plate": 40, "pinched cylinder": 40}
FACES, QUICK_FACES = (600, 1800, 4800), (300, 600)
STRIP_FACES = (160, 600, 1800)  # of the cantilevers, ten times as long as wide
PATTERNS = {"open hemisphere": ("alternating", "tapered", "irregular")}
# elements along both parameters, degree, load steps: a coarse run for the uncertainty, and the limit
SPLINES = {
    "cantilever, shear": ((20, 4, 3, 20), (40, 8, 3, 20)),
    "open hemisphere": ((20, 16, 4, 20), (28, 24, 4, 20)),
    "slit annular plate": ((56, 6, 3, 40), (80, 6, 3, 40)),
    "pinched cylinder": ((28, 24, 3, 20), (36, 32, 3, 20)),
}
COMMANDS = ("shell-sim strip_buckling.toml --buckling 3",)
Key = tuple[str, str, str, int]


def nonlinear(word: str, quick: bool, path: str, stored: bool) -> None:
    """Two tables for each problem whose name contains a word: all meshes, and all rows of the finest."""
    for name in PROBLEMS:
        if word not in name:
            continue
        sizes = QUICK_FACES if quick else STRIP_FACES if "cantilever" in name else FACES
        keys = [
            (name, pattern, bending, faces)
            for pattern in PATTERNS.get(name, ("alternating", "irregular"))
            for bending in ("midedge", "hinge")
            for faces in (sizes if bending == "midedge" else sizes[1:2])
        ]
        runs = [run for key in keys if (run := row_of(key, path, stored)) is not None]
        limit = limit_of(name, path, stored or quick)
        if runs:
            print_meshes(name, runs, limit)
            print_rows(name, [run for run in runs if run["key"][2:] == ["midedge", sizes[-1]]], limit)


def row_of(key: Key, path: str, stored: bool) -> dict[str, Any] | None:
    """Run of a key from the ledger, or a new one; None if only stored ones count."""
    run = ledger(path).get(key)
    if run is None and not stored:
        run = spline_run(*key) if key[1] == "splines" else displacement_run(*key)
        append(path, run)
    return run


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


def spline_run(name: str, pattern: str, bending: str, number: int) -> dict[str, Any]:
    """Row of the ledger: displacements by splines, coarse (0) or fine (1)."""
    begin, (first, second, degree, steps) = cpu_seconds(), SPLINES[name][number]
    moves = spline_displacements(name, (first, second), steps, degree)
    run = {"key": [name, pattern, bending, number], "splines": [first, second, degree]}
    return run | {"moves": moves.tolist(), "cpu": cpu_seconds() - begin}


def limit_of(name: str, path: str, stored: bool) -> tuple[NDArray, NDArray, str] | None:
    """Displacements of the theory, their uncertainty (fractions, measured points), and where from."""
    if name not in SPLINES:
        exact = full_circle(np.array(PROBLEMS[name].fractions))
        return exact, np.zeros_like(exact), "closed form of the circle"
    runs = [row_of((name, "splines", "Kirchhoff-Love", k), path, stored) for k in (0, 1)]
    if runs[0] is None or runs[1] is None:
        return None
    coarse, fine = (np.array(run["moves"]) for run in runs if run is not None)
    first, second, degree = runs[1]["splines"]
    source = f"B-splines of degree {degree} on {first} x {second} elements, {runs[1]['cpu']:.0f} s"
    return fine, np.abs(fine - coarse), source


def print_meshes(name: str, runs: list[dict[str, Any]], limit: tuple[NDArray, NDArray, str] | None) -> None:
    """Largest errors on every mesh."""
    header = [
        "mesh", "bending", "triangles", "of the path, %", "of the displacement, %", "rows outside 1 %",
        "of the limit's displacement, %", "CPU s",
    ]  # fmt: skip
    rows = [figures(run, np.array(PROBLEMS[name].reference).T, limit) for run in runs]
    print_table(f"{name}: largest errors over {len(PROBLEMS[name].fractions)} load fractions", header, rows)


def figures(run: dict[str, Any], truth: NDArray, limit: tuple[NDArray, NDArray, str] | None) -> list[Any]:
    """Mesh, bending, triangles, errors in per cent, rows outside 1 %, seconds."""
    _, pattern, bending, faces = run["key"]
    if "moves" not in run:
        return [pattern, bending, faces, run["error"][:40], "", "", "", f"{run['cpu']:.0f}"]
    moves = np.array(run["moves"])
    whole = 100 * np.abs(moves - truth) / np.abs(truth).max(axis=0)
    own = per_cent(moves, truth)
    outside = f"{np.count_nonzero(np.abs(own) > 1)} of {np.count_nonzero(np.isfinite(own))}"
    beside = "" if limit is None else f"{np.nanmax(np.abs(per_cent(moves, limit[0]))):.2f}"
    return [
        pattern, bending, run["faces"], f"{np.nanmax(whole):.2f}", f"{np.nanmax(np.abs(own)):.2f}", outside,
        beside, f"{run['cpu']:.0f}",
    ]  # fmt: skip


def per_cent(moves: NDArray, truth: NDArray) -> NDArray[np.float64]:
    """Errors of displacements; nan where a point returns to its place."""
    away = np.abs(truth) > 1e-6 * np.abs(truth).max(axis=0)
    return 100 * np.where(away, moves - truth, np.nan) / np.where(away, np.abs(truth), 1.0)


def print_rows(name: str, runs: list[dict[str, Any]], limit: tuple[NDArray, NDArray, str] | None) -> None:
    """Every load fraction: the table, how far it is rounded, the limit, and errors of runs against both."""
    problem = PROBLEMS[name]
    truth = np.array(problem.reference).T
    runs = [run for run in runs if "moves" in run]
    meshes = [f"{run['key'][1]}, {run['faces']}" for run in runs]
    header = ["load", "displacement", "table", "rounding, %", "limit", "doubt, %", "limit - table, %"]
    header += [f"{mesh}: - {other}, %" for other in ("table", "limit") for mesh in meshes]
    errors = [per_cent(np.array(run["moves"]), truth) for run in runs]
    if limit is None:
        nothing = np.full_like(truth, np.nan)
        limit = nothing, nothing, "not computed"
    errors += [per_cent(np.array(run["moves"]), limit[0]) for run in runs]
    beside = per_cent(limit[0], truth)
    rows = []
    for k in range(truth.shape[1]):
        for row, fraction in enumerate(problem.fractions):
            value = truth[row, k]
            rounding = 0.05 / abs(value) if value else np.nan
            doubt = 100 * limit[1][row, k] / abs(value) if value else np.nan
            columns = [rounding, limit[0][row, k], doubt, beside[row, k], *(e[row, k] for e in errors)]
            places = [2, 4, 3, 2] + [2] * len(errors)
            texts = ["" if np.isnan(f) else f"{f:.{n}f}" for f, n in zip(columns, places, strict=True)]
            rows.append([fraction, direction_name(problem.measured[k]), f"{value:.3f}", *texts])
    print_table(f"{name}: every row (limit: {limit[2]})", header, rows)


def direction_name(measured: tuple[tuple[float, float], tuple[float, float, float]]) -> str:
    """Sign and axis of a displacement, and the parameters of its point."""
    place, direction = measured
    axis = int(np.argmax(np.abs(direction)))
    return f"{'-' if direction[axis] < 0 else ''}{'xyz'[axis]} at ({place[0]:.4g}, {place[1]:.4g})"


def ledger(path: str) -> dict[Key, dict[str, Any]]:
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
    nonlinear(word, options.quick, options.ledger, options.stored)
    if not options.stored:
        print_commands(*COMMANDS)


if __name__ == "__main__":
    main()
