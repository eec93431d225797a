"""docs/hard-cases.md from the stored verdicts: tables of cells, breaking points, wrong cells, peers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

from benchmarks.fuzz.ledger import ledger
from benchmarks.hardcases.catalogue import PUSHED_CALLS, ROOT, Case, catalogue
from benchmarks.hardcases.judge import DEGRADED_VERDICT, REFUSED_VERDICT, RIGHT_VERDICT, WRONG_VERDICT
from benchmarks.hardcases.stored import PEER_RESULTS, stored_results
from ddgcli.cli.main import COMMANDS

PAGE = ROOT / "docs" / "hard-cases.md"
MARKS = {RIGHT_VERDICT: "✓", DEGRADED_VERDICT: "~", REFUSED_VERDICT: "–", WRONG_VERDICT: "**✗**"}
PEER_COUNTS = ("right", "refused", "crashed", "hung", "over memory", "silently wrong")
FUZZ_COLUMNS = (
    "kind", "runs", "inputs", "coverage-guided", "accepted", "refused", "escapes", "lines", "processor s",
    "since an escape s", "slowest s",
)  # fmt: skip
UNKNOWN_MARK, BLANK_MARK, TOO_LARGE_MARK = "?", "", "▫"

HEAD = """# Hard cases

Every command on a catalogue of hard inputs, each in a process of its own, as a user starts it. This page is
written by `make hardcases` from `benchmarks/hardcases/results.json`; do not edit it.

| mark | meaning |
| --- | --- |
| ✓ | right: exit 0, and the answer agrees with a truth or an invariant |
| ~ | degraded and reported: exit 1, or exit 0 with a warning that names what is lost |
| – | refused: exit 2 and one line with the reason |
| **✗** | wrong: a traceback, NaN, a violated truth with exit 0, over the limit of time or memory |
| ? | not run yet |
| ▫ | not run: a file of 400 kB or more, which is given to the cheap commands alone |

The truths are area, Euler characteristic, components, Betti numbers, Gauss–Bonnet, straight line ≤ distance ≤
path along edges, closed distances, zero eigenvalues, conserved metric of flips, energy that may not grow,
bodies that may not move. Limits: 120 s of processor time and 4 GiB of memory a command (`ulimit -v 4194304`).

`make hardcases ONLY=FAMILY` runs a part, `make hardcases MISSING=1` what has not been run.
"""


def page(results: dict[str, dict[str, dict[str, Any]]], cases: list[Case]) -> str:
    """The page as text."""
    cells = [results.get(case.name, {}).get(name) for case in cases for name in case.calls]
    counts = Counter(cell["kind"] if cell else "not run" for cell in cells)
    summary = ", ".join(f"{counts[kind]} {kind}" for kind in (*MARKS, "not run"))
    forked = sum(bool(cell and cell.get("preloaded")) for cell in cells)
    note = f" {forked} of them ran with `--preloaded`, forked from a process that had imported the program."
    sections = [HEAD, f"{len(cells)} cells: {summary}.{note if forked else ''}\n"]
    sections += [_breaking_points(results, cases), _wrong_cells(results, cases)]
    for family in dict.fromkeys(_section(case) for case in cases):
        rows = [case for case in cases if _section(case) == family]
        sections.append(_table(family, rows, results))
    sections.append(_peers(stored_results(PEER_RESULTS), results))
    sections.append(_fuzz(ledger()))
    return "\n".join(sections).rstrip() + "\n"


def _section(case: Case) -> str:
    if case.family in PUSHED_CALLS:
        return "generated families"
    return "simulators" if case.parameter is not None or case.family == "restarts" else case.family


def _row(values: Iterable[Any]) -> str:
    return "| " + " | ".join(str(value) for value in values) + " |"


def _table(title: str, cases: list[Case], results: dict) -> str:
    columns = [name for name in COMMANDS if any(name in case.calls for case in cases)]
    lines = [f"## {title.capitalize()}\n", _row(["case", *columns]), _row(["---"] * (len(columns) + 1))]
    for case in cases:
        done = results.get(case.name)
        if not done:
            continue
        lines.append(_row([case.name, *(_mark(case, name, done.get(name)) for name in columns)]))
    left_out = sum(not results.get(case.name) for case in cases)
    if left_out:
        lines.append(f"\n{left_out} further cases have not been run yet.")
    return "\n".join(lines) + "\n"


def _mark(case: Case, command: str, cell: dict[str, Any] | None) -> str:
    if command not in case.calls:
        return TOO_LARGE_MARK if command in case.too_large else BLANK_MARK
    return MARKS[cell["kind"]] if cell else UNKNOWN_MARK


def breaking_point(cells: list[tuple[float, str | None]]) -> str:
    """Up to which parameter the cells of a family are right, and what comes after.

    Parameters
    ----------
    cells : list of tuple
        Parameter and kind (None where it was not run), in the order in which the family gets harder.
    """
    run = [(value, kind) for value, kind in cells if kind]
    if not run:
        return UNKNOWN_MARK
    for place, (value, kind) in enumerate(run):
        if kind != RIGHT_VERDICT:
            before = f"✓ to {run[place - 1][0]:.10g}; " if place else ""
            return f"{before}{MARKS[kind]} at {value:.10g}"
    return f"✓ to {run[-1][0]:.10g}"


def _breaking_points(results: dict, cases: list[Case]) -> str:
    families = list(dict.fromkeys(case.family for case in cases if case.parameter is not None))
    pushed = [case for case in cases if case.parameter is not None]
    columns = [name for name in COMMANDS if any(name in case.calls for case in pushed)]
    lines = ["## Breaking points\n", "The first parameter of a family whose cell is not right.\n"]
    lines += [_row(["family", *columns]), _row(["---"] * (len(columns) + 1))]
    for family in families:
        rows = [case for case in pushed if case.family == family]
        entries = []
        for name in columns:
            kinds = [(case.parameter, results.get(case.name, {}).get(name, {}).get("kind")) for case in rows]
            entries.append(breaking_point(kinds) if any(name in case.calls for case in rows) else BLANK_MARK)
        lines.append(_row([family, *entries]))
    return "\n".join(lines) + "\n"


def _wrong_cells(results: dict, cases: list[Case]) -> str:
    lines = ["## Wrong and degraded cells\n"]
    for case in cases:
        for name, cell in results.get(case.name, {}).items():
            if name in case.calls and cell["kind"] in (WRONG_VERDICT, DEGRADED_VERDICT):
                note = cell["note"].replace("|", "\\|").replace("\n", " ")
                lines.append(f"- {MARKS[cell['kind']]} {case.name}, `{name}`: {note}")
    return "\n".join([*lines, "none"] if len(lines) == 1 else lines) + "\n"


def _peers(results: dict[str, dict[str, dict[str, Any]]], ours: dict[str, dict[str, dict[str, Any]]]) -> str:
    """Counts of the peers' cells beside those of our commands on the same cases, and what each one did."""
    lines = ["## Peers on the same meshes\n"]
    lines.append(
        "Written by `make hardcases-peers`: each call in a process of its own, 20 s of processor time, the "
        "same checks of distances (within 1e-6), total curvature and eigenvalues as above. Readers get the "
        "file itself, other calls what our reader makes of it; a cell is blank where there is no file, or "
        "our reader refuses it. A "
        "refusal is an exception that Python reports; a crash ends the process; a reader is silently wrong "
        "where it reads a broken file, or names vertices that there are not. The last rows are our commands "
        "on the same cases; wrong ones of any kind, of which there are none, count as silently wrong.\n"
    )
    if not results:
        return "\n".join([*lines, "Not run yet."])
    lines += [
        _row(["peer, task", *PEER_COUNTS, "degraded and reported"]),
        _row(["---"] * (len(PEER_COUNTS) + 2)),
    ]
    tasks = list(dict.fromkeys(name for row in results.values() for name in row))
    for task in tasks:
        counts = Counter(row[task]["kind"] for row in results.values() if task in row)
        lines.append(_row([task, *(counts[kind] for kind in PEER_COUNTS), 0]))
    for name in ("geodesic", "curvature", "laplacian", "info"):
        counts = Counter(ours[case][name]["kind"] for case in results if name in ours.get(case, {}))
        cells = [counts[RIGHT_VERDICT], counts[REFUSED_VERDICT], 0, 0, 0, counts[WRONG_VERDICT]]
        lines.append(_row([f"`ddgcli {name}`", *cells, counts[DEGRADED_VERDICT]]))
    lines += ["", _row(["case", *tasks]), _row(["---"] * (len(tasks) + 1))]
    for case, row in results.items():
        lines.append(_row([case, *(row[name]["kind"] if name in row else BLANK_MARK for name in tasks)]))
    return "\n".join(lines)


def _fuzz(runs: dict[str, dict[str, Any]]) -> str:
    """What `make fuzz` has tried so far."""
    lines = ["\n## Mutated inputs\n"]
    lines.append(
        "Written by `make fuzz STORE=1`, which adds its counts with a seed that no earlier run had. An input "
        "is accepted, refused by one line of ours, or it escapes: a foreign exception, a message of more "
        "than 600 characters, more than 20 s or 2 GiB, the end of the process. Every escape of an earlier "
        "run is repaired, with a test, but ten: three trajectories that were refused when tried alone, "
        "a rubber balloon under 4 GPa whose implicit steps are divided until they are as short as "
        "explicit ones, "
        "and two shell scenes whose explicit steps are divided into 10,000 parts and more by the limit of "
        "stability; they take 110 and 120 s, as their dry runs now predict; and four runs of 40 s and more "
        "within the range of their dry runs or with exit 1: a static shell with mid-edge bending, a line of "
        "a field with steps of 1e-6, a Willmore flow of 20 s and one whose steps fail.\n\n"
        "Coverage-guided inputs are mutations of the valid files and of inputs that reached a line of the "
        "package first; the others are mutations of the valid files. Lines: of functions of the package, by "
        "the valid files and by all inputs of the latest run that counted them. Processor "
        "seconds since the last run with an escape are a column of their own. The slowest input is in "
        "processor seconds; in runs before 27 November 2026 it is by the clock, with pauses of the run (of "
        "`array.npz` almost all of it).\n\n"
        "Valid scenes and valid calls are not mutated but made from random numbers. A call is a command with "
        "random options, by their types, on a small random mesh: closed and bounded surfaces, handles, "
        "tetrahedra, curves, needles, degenerate, duplicate and turned faces, soups, Möbius bands, scales of "
        "1e±100, far from the origin. It also escapes where a result or a written array is not finite, a "
        "refused run leaves a file, the summary lists other files than there are, an identity is violated "
        "without a warning (area, Gauss-Bonnet, distances along edges, falling energies), a dry run "
        "refuses another call than the run, or in other words, or a refusal names "
        "an option or a repair that does not cure it: the fuzz follows the message and runs again.\n"
    )
    lines += [_row(FUZZ_COLUMNS), _row(["---"] * len(FUZZ_COLUMNS))]
    for name, row in runs.items():
        counts = [row.get(key, 0) for key in ("runs", "inputs", "guided", "accepted", "refused", "escapes")]
        reached = f"{row.get('lines_of_seeds', 0)}, {row['lines']}" if "lines" in row else ""
        lines.append(
            _row(
                [name, *counts, reached, f"{row['cpu_seconds']:.0f}"]
                + [f"{row.get('seconds_without_escape', 0):.0f}", f"{row['slowest']:.2f}"]
            )
        )
    return "\n".join(lines)


def write_page(results: dict[str, dict[str, dict[str, Any]]]) -> None:
    """Write docs/hard-cases.md."""
    PAGE.write_text(page(results, catalogue()), encoding="utf-8")
