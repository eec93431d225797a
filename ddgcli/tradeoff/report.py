"""Report of a comparison: results, CSV, text table, and the series of its plot."""

from __future__ import annotations

import csv
import io
import math
import platform
from collections.abc import Callable
from typing import Any

from ddgcli.choices import NO_VERDICT
from ddgcli.tradeoff.candidates import ROUNDING, Problem, Row, Table
from ddgcli.tradeoff.pareto import break_even
from ddgcli.tradeoff.whole_error import mesh_bound_methods

COLUMNS = (
    "method", "parameters", "setup_seconds", "seconds", "seconds_low", "seconds_high", "repeats", "peak_mib",
    "max_error", "max_error_at", "mean_error", "time_error", "mesh_error", "uncertainty",
    "is_reference", "on_front", "verdict", "command",
)  # fmt: skip


def results_of(
    table: Table,
    problem: Problem,
    command_of: Callable[[Row], str],
    *,
    cheapest: Row | None,
    within: float | None,
    norm: str,
) -> dict[str, Any]:
    """Results block of the summary of a comparison.

    Parameters
    ----------
    table : Table
    problem : Problem
    command_of : callable
        Command that runs a row.
    cheapest : Row or None
        The cheapest row within the error.
    within : float or None
        The error.
    norm : {'max', 'mean'}

    Returns
    -------
    dict
    """
    reference, limit = table.reference, table.mesh_limit
    return {
        "rows": [row_of(row, command_of, norm) for row in table.rows],
        "reference": reference.name if reference else None,
        "reference_uncertainty": _finite(table.uncertainty(norm)) if reference else None,
        "time_uncertainty": _time_uncertainty(table, problem, norm),
        "error_part": problem.error_part or None,
        "mesh_reference": limit.name if limit else None,
        "mesh_uncertainty": limit.uncertainty.at(norm) if limit else None,
        "mesh_failure": table.mesh_failure or None,
        "remark": problem.remark or None,
        "polyhedron_error": table.polyhedron_error.at(norm) if table.polyhedron_error else None,
        "undecided": table.undecided or None,
        "error_scale": problem.error_scale,
        "error_place": problem.place,
        "query": problem.query,
        "norm": norm,
        "within": within,
        "chosen": row_of(cheapest, command_of, norm) if cheapest else None,
        "mesh_bound_methods": mesh_bound_methods(table, norm),
        "break_even": break_even(table.rows, norm),
        "left_out": [{"row": name, "why": why} for name, why in table.left_out],
        "interrupted": table.interrupted,
        "machine": machine(),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _time_uncertainty(table: Table, problem: Problem, norm: str) -> float | None:
    """Uncertainty of the error in time; None where the error has no parts."""
    return table.reference.error_bound(norm) if table.reference and problem.error_part else None


def row_of(row: Row, command_of: Callable[[Row], str], norm: str = "max") -> dict[str, Any]:
    """One row as plain data; missing numbers are None. Parts and uncertainty of the error are in `norm`."""
    low, high = row.seconds_spread
    return {
        "method": row.method,
        "parameters": row.parameters,
        "setup_seconds": row.setup_seconds,
        "seconds": row.seconds,
        "seconds_low": low,
        "seconds_high": high,
        "repeats": row.repeats,
        "peak_mib": _finite(row.peak_mib),
        "max_error": row.max_error,
        "max_error_at": row.max_error_at,
        "mean_error": row.mean_error,
        "time_error": row.time_error.at(norm) if row.time_error else None,
        "mesh_error": row.mesh_error.at(norm) if row.mesh_error else None,
        "uncertainty": _finite(row.uncertainty.at(norm)),
        "is_reference": row.is_reference,
        "on_front": row.on_front,
        "verdict": row.verdict,
        "command": command_of(row),
    }


def csv_of(rows: list[dict[str, Any]]) -> bytes:
    """The rows of a comparison as CSV, one line each; parameters as `name=value` joined by spaces.

    Parameters
    ----------
    rows : list of dict

    Returns
    -------
    bytes
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        parameters = " ".join(f"{k}={v}" for k, v in row["parameters"].items())
        writer.writerow({**row, "parameters": parameters})
    return text.getvalue().encode(errors="backslashreplace")


def machine() -> str:
    """One line with machine and versions, for captions."""
    import os

    import numpy
    import scipy

    from ddgcli import __version__

    return (
        f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()}, ddgcli {__version__}, "
        f"Python {platform.python_version()}, numpy {numpy.__version__}, scipy {scipy.__version__}"
    )


def text_table(table: Table, problem: Problem, results: dict[str, Any]) -> list[str]:
    """Text table of a comparison, cheapest row first, `*` on the Pareto front; remarks below it.

    Parameters
    ----------
    table : Table
    problem : Problem
    results : dict
        As returned by `results_of`.

    Returns
    -------
    list of str
        Lines.
    """
    norm, split = results["norm"], table.mesh_limit is not None
    split_names = ("time error", "mesh error") if split else ()
    errors = ("max error", "mean error", *split_names)
    header = ("", "method", "set-up", f"each {problem.query}", *errors, "memory", "verdict")
    body = [header, *(_cells(row, norm, split) for row in sorted(table.rows, key=lambda r: r.total_seconds))]
    widths = [max(len(line[k]) for line in body) for k in range(len(header))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(line, widths)).rstrip() for line in body]
    return [*lines, *_remarks(results)]


def _cells(row: Row, norm: str, split: bool) -> tuple[str, ...]:
    low, high = row.seconds_spread
    split_errors = (row.time_error, row.mesh_error) if split else ()
    return (
        "*" if row.on_front else "",
        row.label,
        f"{row.setup_seconds:.3g} s",
        f"{row.seconds:.3g} s ({low:.2g}..{high:.2g})",
        f"{row.max_error:.2e}",
        f"{row.mean_error:.2e}",
        *(f"{error.at(norm):.2e}" if error else "-" for error in split_errors),
        f"{row.peak_mib:.0f} MiB" if math.isfinite(row.peak_mib) else "-",
        row.verdict,
    )


def _remarks(results: dict[str, Any]) -> list[str]:
    both, in_time = results["mesh_reference"] is not None, results["error_part"] in ("mesh", "both")
    own = results["time_uncertainty" if in_time else "reference_uncertainty"]
    lines = [
        f"errors relative to {results['error_scale']}",
        f"reference{' in time' * in_time}: {results['reference']}, uncertainty {_number(own)}",
    ]
    if both:
        lines.append(
            f"mesh error: from {results['mesh_reference']}, uncertainty {results['mesh_uncertainty']:.1e}; "
            f"of the errors {_number(results['reference_uncertainty'])}"
        )
    if (results["polyhedron_error"] or 0.0) > max(results["reference_uncertainty"] or 0.0, ROUNDING):
        lines.append(
            "errors are those on the polyhedron; a smooth surface through its vertices differs from it by "
            f"about {results['polyhedron_error']:.1e}"
        )
    if results["remark"]:
        lines.append(results["remark"])
    if results["mesh_bound_methods"]:
        names = ", ".join(results["mesh_bound_methods"])
        lines.append(f"time errors that do not fall with dt are errors of the method on this mesh: {names}")
    if results["undecided"]:
        lines.append(f"{NO_VERDICT}: {results['undecided']}")
    lines += [
        f"break-even: {pair['row']} beats {pair['against']} from {pair['queries']} queries"
        for pair in results["break_even"]
    ]
    lines += _left_out(results["left_out"])
    if results["within"] is not None:
        cheapest = results["chosen"]
        surely = " for certain" if results["undecided"] else ""
        missed = f"no row is within {results['within']:g}{surely}"
        lines.append(f"run: {cheapest['command']}" if cheapest else missed)
    return lines


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.1e}"


def _left_out(left_out: list[dict[str, str]]) -> list[str]:
    """One line for each configuration left out, and one for all that exceed the budget."""
    expensive = dict.fromkeys(one["row"] for one in left_out if one["why"].startswith("estimated"))
    lines = [f"left out: {one['row']}: {one['why']}" for one in left_out if one["row"] not in expensive]
    return lines + [f"left out, estimated above the rest of the budget: {', '.join(expensive)}"] * bool(
        expensive
    )


def chart_of(rows: list[Row], norm: str, within: float | None) -> dict[str, Any]:
    """Series of the plot of a comparison: one for each method, its parameters as labels.

    A line joins rows that differ in numbers alone.

    Bars show the uncertainty of each error, where it is known.

    Parameters
    ----------
    rows : list of Row
    norm : {'max', 'mean'}
    within : float or None
        Error to mark.

    Returns
    -------
    dict
        Arguments of `draw_chart`.
    """
    lines: dict[str, list[Row | None]] = {row.method: [] for row in rows}
    for row in sorted(rows, key=_words_of):
        line = lines[row.method]
        if line and _words_of(line[-1]) != _words_of(row):
            line.append(None)
        line.append(row)
    series = {
        name: (
            [r.total_seconds if r else math.nan for r in line],
            [_drawn_error(r, norm) if r else math.nan for r in line],
        )
        for name, line in lines.items()
    }
    labels = {name: [_parameter_values(row) if row else "" for row in line] for name, line in lines.items()}
    ringed = {name: [k for k, row in enumerate(line) if row and row.on_front] for name, line in lines.items()}
    bars = {
        name: [(row and _finite(row.significant_uncertainty(norm))) or 0.0 for row in line]
        for name, line in lines.items()
    }
    best = sorted((r.total_seconds, _drawn_error(r, norm)) for r in rows if r.on_front)
    pareto_front = ([x for x, _ in best], [y for _, y in best]) if len(best) > 1 else None
    threshold = None if within is None else (f"within {within:g}", within)
    return {
        "series": series,
        "labels": labels,
        "ringed": ringed,
        "bars": bars,
        "pareto_front": pareto_front,
        "threshold": threshold,
    }


def _drawn_error(row: Row, norm: str) -> float:
    """The error; one of 0, which a logarithmic axis has no place for, is drawn at its uncertainty."""
    return row.error(norm) or row.uncertainty.at(norm)


def _words_of(row: Row | None) -> list[str]:
    """Parameters of a row that are no numbers."""
    return [] if row is None else [v for v in row.parameters.values() if isinstance(v, str)]


def _parameter_values(row: Row) -> str:
    return " ".join(f"{v:.3g}" if isinstance(v, float) else str(v) for v in row.parameters.values())
