"""Pareto front, cheapest row within an error, verdicts, and where a set-up pays off."""

from __future__ import annotations

import math
from typing import Any

from ddgcli.tradeoff.candidates import Row, Table


def mark_pareto_front(rows: list[Row], norm: str = "max") -> None:
    """Set `on_front` of the rows on the Pareto front of total seconds and error."""
    best = math.inf
    for row in sorted(rows, key=lambda r: (r.total_seconds, r.error(norm))):
        row.on_front = row.error(norm) < best
        best = min(best, row.error(norm))


def cheapest_within(rows: list[Row], within: float, norm: str = "max") -> Row | None:
    """The row of least total seconds whose measured error is at most `within`; None where no row is."""
    good = [row for row in rows if row.error(norm) <= within]
    return min(good, key=lambda r: r.total_seconds) if good else None


def assign_verdicts(table: Table, within: float | None, norm: str = "max") -> Row | None:
    """Set the verdict of every row; return the cheapest row whose error is at most `within`."""
    mark_pareto_front(table.rows, norm)
    chosen = cheapest_within(table.rows, within, norm) if within is not None else None
    uncertainty = table.reference.error_bound(norm) if table.reference else 0.0
    for row in table.rows:
        if row is chosen:
            row.verdict = f"cheapest within {within:g}"
        elif within is not None and row.error(norm) > within:
            row.verdict = f"misses {within:g}"
        elif row.on_front:
            row.verdict = "no other beats it"
        else:
            other = _dominating_row(row, table.rows, norm)
            relation = "level with" if _equal_up_to_noise(row, other, norm) else "beaten by"
            row.verdict = f"{relation} {other.label}"
        if row.error(norm) <= uncertainty:
            row.verdict += "; as exact as the reference can tell"
    return chosen


def _dominating_row(row: Row, rows: list[Row], norm: str) -> Row:
    better = [
        r
        for r in rows
        if r is not row and r.total_seconds <= row.total_seconds and r.error(norm) <= row.error(norm)
    ]
    return min(better, key=lambda r: r.total_seconds)


def _equal_up_to_noise(row: Row, other: Row, norm: str) -> bool:
    """Whether two rows of the same error differ by less than the spread of their seconds."""
    spread = max(high - low for low, high in (row.seconds_spread, other.seconds_spread))
    return row.error(norm) == other.error(norm) and abs(row.total_seconds - other.total_seconds) <= spread


def break_even(rows: list[Row], norm: str = "max") -> list[dict[str, Any]]:
    """Number of queries from which a set-up pays off against an equally accurate row of less set-up."""
    pairs = []
    for row in rows:
        rivals = [
            r
            for r in rows
            if r.error(norm) <= row.error(norm) * (1 + 1e-9)
            and r.setup_seconds < row.setup_seconds
            and r.seconds > row.seconds
        ]
        if not rivals or row.setup_seconds < row.seconds:  # a set-up below one query does not matter
            continue
        rival = min(rivals, key=lambda r: r.seconds)
        count = math.ceil((row.setup_seconds - rival.setup_seconds) / (rival.seconds - row.seconds))
        if count > 1:  # else the set-up pays off within one query
            pairs.append({"row": row.label, "against": rival.label, "queries": count})
    return pairs
