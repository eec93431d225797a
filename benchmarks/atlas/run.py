"""The atlas: error against seconds on known truths, with observed rates (`make accuracy`).

For every command and mesh class: each method with its parameters, and peers, on a sequence of meshes.
Writes docs/accuracy/COMMAND.csv (all rows), .png (the picture) and .md (rates and errors), and check.json,
which `make accuracy-check` (a part of `make test`) compares a rerun of the small meshes with: errors and
rates only, never seconds.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.atlas.advice import ADVICE
from benchmarks.atlas.peers import peers_of
from benchmarks.atlas.simulators import SIMULATIONS
from benchmarks.atlas.tables import rates
from benchmarks.atlas.tables import stored as read
from benchmarks.atlas.theory import SOURCES, theory
from benchmarks.atlas.trial import Case, Trial
from benchmarks.common.measure import cpu_seconds
from benchmarks.common.mesh_classes import STUDIES, MeshSequence
from ddgcli.plots.chart import draw_chart
from ddgcli.tradeoff.candidates import Candidate, Problem, Row, label_of
from ddgcli.tradeoff.measure import run_problem
from ddgcli.tradeoff.pareto import mark_pareto_front
from ddgcli.tradeoff.problems.table import mesh_problem
from ddgcli.tradeoff.report import machine
from ddgcli.tradeoff.truths import parse_truth

ATLAS_FOLDER = Path(__file__).parents[2] / "docs" / "accuracy"
LEVELS = (0, 1, 2, 3)
CHECK_LEVELS = (0, 1)
# an error may rise by this factor, a rate fall by this much, before the check fails
ERROR_SLACK, RATE_SLACK = 1.05, 0.1
# refined meshes are results themselves: another order of insertions makes other meshes, no worse ones
REFINED_SLACK, REFINED_RATE_SLACK = 1.5, 0.5
# guess of the seconds above which the check leaves a configuration to the atlas
MAX_CHECK_SECONDS, MAX_CHECK_RUN_SECONDS = 0.15, 0.05
MAX_LINES = 10
# slow, and never better than other rows
SKIPPED_CONFIGURATIONS = (
    "normal-cycle radius=4 edges",
    "intrinsic-delaunay mass=voronoi subdivide=1",
    "intrinsic-delaunay mass=galerkin subdivide=1",
)
PEER_NAMES = ("libigl", "potpourri3d", "pygeodesic", "robust_laplacian", "pymeshlab")


def measured(
    problem: Problem, *, repeat: int, peers: Sequence[Candidate] | None, cheap: float = MAX_CHECK_SECONDS
) -> list[Row]:
    """Rows of a problem with a known truth; without peers, the cheap ones only (the check)."""
    if peers is None:
        problem = replace(problem, candidates=[c for c in problem.candidates if c.work <= cheap])
    else:
        problem = replace(problem, candidates=[*problem.candidates, *peers])
    table = run_problem(problem, repeat=repeat, clock=cpu_seconds)
    for name, why in table.left_out:
        if peers is not None:
            print(f"left out: {name}: {why}", file=sys.stderr, flush=True)
    rows = table.rows
    mark_pareto_front(rows)
    return rows


def study(command: str, levels: tuple[int, ...], *, peers: bool = True) -> list[dict[str, Any]]:
    """All rows of a command, as plain dictionaries."""
    rows_of_command = []
    for case in cases(command):
        for level in levels:
            trial = case.trial(level)
            head = {"truth": case.truth, "mesh_class": case.mesh_class, "level": level, "faces": trial.faces}
            head["h"] = trial.h
            others = trial.peers() if peers else None
            cheap = MAX_CHECK_RUN_SECONDS if command in SIMULATIONS else MAX_CHECK_SECONDS
            repeat = repeats(command, level) if peers else 0
            rows = measured(trial.problem, repeat=repeat, peers=others, cheap=cheap)
            rows_of_command += [head | as_row(row) for row in rows]
            print(f"{command} {case.truth} {case.mesh_class} {trial.faces}", file=sys.stderr, flush=True)
    return rows_of_command


def repeats(command: str, level: int) -> int:
    """Timed queries a row, after a warm-up; CPU seconds of what takes long spread little."""
    return 1 if command in SIMULATIONS or level == LEVELS[-1] else 3


def cases(command: str) -> list[Case]:
    """Truths and mesh classes of a command, the plotted ones first."""
    if command in SIMULATIONS:
        return SIMULATIONS[command]
    return [
        Case(truth, mesh_class, partial(mesh_trial, command, truth, make))
        for truth, sequences in STUDIES[command]
        for mesh_class, make in sequences.items()
    ]


def mesh_trial(command: str, truth: str, make: MeshSequence, level: int) -> Trial:
    """A command on the mesh of one level."""
    mesh = make(level)
    problem = mesh_problem(command, mesh, truth=parse_truth(truth, mesh.points))
    candidates = [
        candidate for candidate in problem.candidates if label_of(candidate) not in SKIPPED_CONFIGURATIONS
    ]
    problem = replace(problem, candidates=candidates)
    return Trial(mesh.n_faces, float(mesh.side_length.mean()), problem, lambda: list(peers_of(command, mesh)))


def as_row(row: Row) -> dict[str, Any]:
    """Columns of a row in the table."""
    return {
        "configuration": row.label,
        "setup_seconds": row.setup_seconds,
        "seconds": row.seconds,
        "peak_mib": row.peak_mib,
        "max_error": row.max_error,
        "mean_error": row.mean_error,
        "on_front": row.on_front,
    }


def write(command: str, rows: list[dict[str, Any]]) -> None:
    """CSV, picture and page of one command."""
    ATLAS_FOLDER.mkdir(parents=True, exist_ok=True)
    with open(ATLAS_FOLDER / f"{command}.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(
            {k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows
        )
    charts = {
        case: drawn_lines([r for r in rows if (r["truth"], r["mesh_class"]) == (case.truth, case.mesh_class)])
        for case in drawn(command)
    }
    names = dict.fromkeys(name for lines in charts.values() for name in lines)
    styles = {name: k for k, name in enumerate(names)}  # a configuration has one style in all charts
    for case, lines in charts.items():
        picture(command, case, lines, styles)
    (ATLAS_FOLDER / f"{command}.md").write_text(page(command, rows), encoding="utf-8")


def drawn(command: str) -> list[Case]:
    """Cases that have a picture: all of a simulator, the first truth of the others."""
    all_cases = cases(command)
    return all_cases if command in SIMULATIONS else [c for c in all_cases if c.truth == all_cases[0].truth]


def picture_name(command: str, case: Case) -> str:
    """File of a picture."""
    words = [command, case.truth if command in SIMULATIONS else "", case.mesh_class]
    return re.sub(r"[^a-z0-9]+", "-", " ".join(words).lower()) + ".png"


def drawn_lines(rows: list[dict[str, Any]]) -> dict[str, tuple[list[float], list[float]]]:
    """Seconds and errors of all peers and of our best configurations, at most `MAX_LINES` lines."""
    lines: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        lines.setdefault(row["configuration"], []).append(row)
    ours = [name for name in lines if not name.startswith(PEER_NAMES)]
    best = sorted(ours, key=lambda name: -sum(r["on_front"] for r in lines[name]))
    heads = list({name.split()[0]: name for name in reversed(best)}.values())  # each method's best line first
    best = sorted(best, key=lambda name: name not in heads)
    best = best[: MAX_LINES - len(lines) + len(ours)]
    return {name: points(line) for name, line in lines.items() if name in best or name not in ours}


def picture(
    command: str, case: Case, lines: dict[str, tuple[list[float], list[float]]], styles: dict[str, int]
) -> None:
    """Error against seconds: a line per configuration, a point per mesh (or a step)."""
    draw_chart(
        str(ATLAS_FOLDER / picture_name(command, case)),
        lines,
        pareto_front=pareto_front(lines),
        styles=styles,
        xlabel="CPU seconds (set-up and one query)",
        ylabel="mean relative error",
        log="xy",
        title=f"{command}: {case.truth}, {case.mesh_class}"
        + ("" if command in SIMULATIONS else " triangulations"),
        caption=f"One point per {'step' if case.mesh_class == 'steps' else 'mesh'} of the sequence. "
        f"Grey: Pareto front. CPU seconds, one thread.\n{machine()}",
    )


def points(line: list[dict[str, Any]]) -> tuple[list[float], list[float]]:
    """Seconds and errors of a configuration."""
    return [r["setup_seconds"] + r["seconds"] for r in line], [max(r["mean_error"], 1e-15) for r in line]


def pareto_front(lines: dict[str, tuple[list[float], list[float]]]) -> tuple[list[float], list[float]]:
    """Pareto front of the points of a plot in seconds and error."""
    best: list[tuple[float, float]] = []
    for x, y in sorted(pair for line in lines.values() for pair in zip(*line)):
        if not best or y < best[-1][1]:
            best.append((x, y))
    return [x for x, _ in best], [y for _, y in best]


def page(command: str, rows: list[dict[str, Any]]) -> str:
    """Tables of errors and rates, for every truth and mesh class."""
    observed = rates(rows)
    text = [f"# {command}: error against seconds\n", ADVICE[command].strip(), ""]
    text += ["Rates that theory gives:", SOURCES[command].strip(), ""]
    text += [f"![{case.truth}, {case.mesh_class}]({picture_name(command, case)})" for case in drawn(command)]
    for case in cases(command):
        group = [r for r in rows if (r["truth"], r["mesh_class"]) == (case.truth, case.mesh_class)]
        finest = max(r["level"] for r in group)
        last = [r for r in group if r["level"] == finest]
        step = f", step {last[0]['h']:.3g}" if case.mesh_class == "steps" else ""
        text += [f"\n## {case.truth}, {case.mesh_class}: {last[0]['faces']} faces{step}\n"]
        text += [
            "| configuration | mean error | max error | rate | theory | set-up s | query s | MiB | front |"
        ]
        text += ["| --- | --- | --- | --- | --- | --- | --- | --- | --- |"]
        for r in sorted(last, key=lambda r: r["setup_seconds"] + r["seconds"]):
            rate = observed.get((case.truth, case.mesh_class, r["configuration"]))
            text.append(
                f"| {r['configuration']} | {r['mean_error']:.1e} | {r['max_error']:.1e} | "
                f"{'-' if rate is None else f'{rate:.1f}'} | "
                f"{theory(command, case.mesh_class, r['configuration'])} | "
                f"{r['setup_seconds']:.2g} | {r['seconds']:.2g} | "
                f"{mib(r['peak_mib'])} | {'*' if r['on_front'] else ''} |"
            )
    note = "CPU seconds, one thread. `make accuracy` measures again."
    return "\n".join([*text, "", f"{machine()}. {note}", ""])


def mib(size: float) -> str:
    """Peak memory, where it was measured."""
    return f"{size:.0f}" if np.isfinite(size) else "-"


def summary_of(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What the check compares: errors of ours on the small meshes, and their rates."""
    small = [r for r in rows if r["level"] in CHECK_LEVELS]
    errors = {name_of(r): [r["max_error"], r["mean_error"]] for r in small}
    return {"errors": errors, "rates": {"|".join(k): v for k, v in rates(small).items()}}


def name_of(row: dict[str, Any]) -> str:
    """Truth, mesh class, level and configuration in one key."""
    return "|".join((row["truth"], row["mesh_class"], str(row["level"]), row["configuration"]))


def worse(stored: dict[str, Any], current: dict[str, Any]) -> list[str]:
    """One line for each error or rate that is worse than the stored one."""
    lines = []
    for name, errors in stored["errors"].items():
        now = current["errors"].get(name)
        slack = REFINED_SLACK if "|refined|" in name else ERROR_SLACK
        if now is None:
            lines.append(f"{name}: no longer measured")
        elif any(b > a * slack + 1e-11 for a, b in zip(errors, now)):
            lines.append(f"{name}: errors {errors} -> {now}")
    for name, rate in stored["rates"].items():
        now = current["rates"].get(name)
        slack = REFINED_RATE_SLACK if "|refined|" in name else RATE_SLACK
        if now is not None and now < rate - slack:
            lines.append(f"{name}: rate {rate:.2f} -> {now:.2f}")
    return lines


def main() -> int:
    """Regenerate the atlas, or check against it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "commands", nargs="*", default=[*STUDIES, *SIMULATIONS], help="commands (default: all)"
    )
    parser.add_argument("--levels", type=int, default=len(LEVELS), help="only the coarsest so many")
    parser.add_argument("--pages", action="store_true", help="rewrite pages and pictures from the tables")
    parser.add_argument("--check", action="store_true", help="rerun the small meshes and compare")
    options = parser.parse_args()
    store = ATLAS_FOLDER / "check.json"
    stored = json.loads(store.read_text()) if store.exists() else {}
    if options.check:
        lines = []
        for command in options.commands:
            summary = summary_of(study(command, CHECK_LEVELS, peers=False))
            lines += [f"{command}: {line}" for line in worse(stored[command], summary)]
        print("\n".join(lines) or "accuracy: nothing has become worse")
        return 1 if lines else 0
    if options.pages:
        for command in options.commands:
            write(command, read(ATLAS_FOLDER / f"{command}.csv"))
        return 0
    for command in options.commands:
        rows = study(command, LEVELS[: options.levels])
        write(command, rows)
        ours = [r for r in rows if not r["configuration"].startswith(PEER_NAMES)]
        again = study(command, CHECK_LEVELS, peers=False)
        names = set(summary_of(again)["errors"])
        stored[command] = summary_of([r for r in ours if name_of(r) in names])
        store.write_text(json.dumps(stored, indent=1, sort_keys=True) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
