"""Pareto front, cheapest row within an error, verdicts, and the break-even of set-ups."""

from __future__ import annotations

import math
from typing import Any

from ddgcli.choices import NO_VERDICT
from ddgcli.tradeoff.candidates import ROUNDING, Row, Table

MAX_ERROR_RATIO = 2.0  # of two rows of like error
MIN_SETUP_RATIO = 2.0  # of their set-ups: a few measurements show smaller ones by accident
MIN_REPEATS = 3  # of queries, without which nothing is known of the spread of their seconds


def mark_pareto_front(rows: list[Row], norm: str = "max") -> None:
    """Set `on_front` of the rows on the Pareto front of total seconds and error.

    A row is on it if its error is surely below that of every faster row on it. Rows of other laws are not.
    """
    best: Row | None = None
    own = [row for row in rows if not row.is_other_law]
    for row in sorted(own, key=lambda r: (r.total_seconds, r.error(norm))):
        row.on_front = best is None or row.is_surely_better(best, norm)
        best = row if row.on_front else best


def cheapest_within(rows: list[Row], within: float, norm: str = "max") -> Row | None:
    """The row of least total seconds whose error and uncertainty are at most `within`; None if none is."""
    good = [row for row in rows if is_within(row, within, norm) and not row.is_other_law]
    return min(good, key=lambda r: r.total_seconds) if good else None


def is_within(row: Row, within: float, norm: str = "max") -> bool | None:
    """Whether the error of a row is at most `within`; None where its uncertainty leaves that open."""
    if row.is_reference:  # its error is anything up to the uncertainty
        return row.error(norm) <= within or None
    error, uncertainty = row.error(norm), row.significant_uncertainty(norm)
    if error + uncertainty <= within:
        return True
    return None if error - uncertainty <= within else False


def assign_verdicts(table: Table, within: float | None, norm: str = "max") -> Row | None:
    """Set the verdict of every row, and choose the cheapest row within an error.

    Sets `table.undecided` to the reason where the uncertainty hides all differences between rows, or leaves
    open whether any row is within.

    Parameters
    ----------
    table : Table
    within : float or None
        Largest error.
    norm : {'max', 'mean'}

    Returns
    -------
    Row or None
        None where no row is within.
    """
    limit = table.uncertainty(norm)
    limit = limit if limit > ROUNDING else 0.0
    mark_pareto_front(table.rows, norm)
    cheapest = cheapest_within(table.rows, within, norm) if within is not None else None
    table.undecided = _no_ranking(table, norm, limit)
    ranked = not table.undecided
    if (
        within is not None
        and cheapest is None
        and any(is_within(r, within, norm) is None for r in table.rows)
    ):
        table.undecided = table.undecided or f"the errors are uncertain by {limit:.1e}"
    for row in table.rows:
        row.on_front &= ranked
        row.verdict = _verdict(row, table, cheapest, within, norm, limit, ranked)
        if row.is_reference:
            row.verdict += "; its answer is the reference, and its error the uncertainty"
        elif row.error(norm) <= table.uncertainty(norm) < math.inf:
            row.verdict += "; within the error of the reference"
    return cheapest


def _no_ranking(table: Table, norm: str, limit: float) -> str:
    """Reason why no two rows are distinguished, or ""."""
    own = [row for row in table.rows if not row.is_other_law]
    errors = [row.error(norm) for row in own]
    if table.mesh_failure and math.isinf(limit):
        why = table.mesh_failure
        return f"the mesh error is not known ({why}); use `error=time` for the error in time alone"
    if len(errors) > 1 and limit > 0 and not _ranks_any(own, norm):
        return (
            f"the reference is uncertain by {limit:.1e}, which may hide the order of the rows, whose errors "
            f"differ by at most {max(errors) - min(errors):.1e}"
        )
    return ""


def _ranks_any(rows: list[Row], norm: str) -> bool:
    """Whether some row is surely better than another."""
    ordered = sorted(rows, key=lambda row: row.error(norm))  # the first pairs are the most likely ones
    return any(near.is_surely_better(far, norm) for near in ordered for far in reversed(ordered))


def _verdict(
    row: Row, table: Table, cheapest: Row | None, within: float | None, norm: str, limit: float, ranked: bool
) -> str:
    if row.is_other_law:
        return "another law: not ranked"
    if row is cheapest:
        return f"cheapest within {within:g}"
    inside = is_within(row, within, norm) if within is not None else True
    if inside is False:
        return f"misses {within:g}"
    if inside is None and not math.isinf(limit):
        return f"{NO_VERDICT}: {within:g} is within its uncertainty"
    if not ranked:
        return NO_VERDICT
    if row.on_front:
        return "no other beats it"
    other = _dominating_row(row, table.rows, norm)
    if _equal_up_to_noise(row, other, norm):
        return f"level with {other.label}"
    if other.is_surely_better(row, norm) or other.has_same_error(row, norm):
        return f"beaten by {other.label}"
    return f"{NO_VERDICT}: the uncertainty may hide the difference from {other.label}"


def _dominating_row(row: Row, rows: list[Row], norm: str) -> Row:
    """Fastest row that is surely not worse, else the fastest that is not surely worse."""
    own = [r for r in rows if r is not row and not r.is_other_law]
    faster = [r for r in own if r.total_seconds <= row.total_seconds]
    sure = [r for r in faster if r.is_surely_better(row, norm) or r.has_same_error(row, norm)]
    better = sure or [r for r in faster if not row.is_surely_better(r, norm)]
    return min(better, key=lambda r: r.total_seconds)


def _equal_up_to_noise(row: Row, other: Row, norm: str) -> bool:
    """Whether two rows of the same error differ by less than the spread of their seconds."""
    timing_noise = max(high - low for low, high in (row.seconds_spread, other.seconds_spread))
    is_level = abs(row.total_seconds - other.total_seconds) <= timing_noise
    return is_level and row.has_same_error(other, norm)


def _like(other: float, error: float) -> bool:
    return (
        max(other, ROUNDING)
        <= max(error, ROUNDING) * (1 + 1e-9)
        <= MAX_ERROR_RATIO * max(other, ROUNDING) * (1 + 2e-9)
    )


def _shortest_setup(row: Row) -> float:
    return row.setup_spread[0] if row.setup_spread else row.setup_seconds


def _longest_setup(row: Row) -> float:
    return row.setup_spread[1] if row.setup_spread else row.setup_seconds


def break_even(rows: list[Row], norm: str = "max") -> list[dict[str, Any]]:
    """Number of queries from which a set-up saves time against a row of less set-up and like error.

    The other row is at least as accurate, and at most `MAX_ERROR_RATIO` times as accurate. In all repetitions
    it is slower, and its set-up takes less than half of the time.

    Parameters
    ----------
    rows : list of Row
    norm : {'max', 'mean'}

    Returns
    -------
    list of dict
    """
    pairs = []
    own = [row for row in rows if not row.is_other_law]
    for row in own:
        others = [
            r
            for r in own
            if _like(r.error(norm), row.error(norm))
            and MIN_SETUP_RATIO * _longest_setup(r) <= _shortest_setup(row)
            and r.seconds_spread[0] > row.seconds_spread[1]
            and min(r.repeats, row.repeats) >= MIN_REPEATS
        ]
        if not others or row.setup_seconds < row.seconds:  # a set-up below one query does not matter
            continue
        cheapest = min(others, key=lambda r: r.seconds)
        count = math.ceil((row.setup_seconds - cheapest.setup_seconds) / (cheapest.seconds - row.seconds))
        if count > 1:  # else the set-up saves time within one query
            pairs.append({"row": row.label, "against": cheapest.label, "queries": count})
    return pairs
