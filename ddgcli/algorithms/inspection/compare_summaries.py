"""Compare two summaries: which values differ by more than a tolerance."""

from __future__ import annotations

import fnmatch
import math
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

RTOL, ATOL = 1e-6, 1e-12
ACCURACY_ATOL = 1e-9  # smaller residuals are rounding
# keys that differ from run to run, or name files
VOLATILE_FIELDS = (
    "seconds", "seconds.*", "*.seconds", "*_seconds", "*.seconds_by_part*", "*.share", "*peak_mib", "version",
    "input.path", "outputs", "outputs*", "tolerances*",
)  # fmt: skip
WARNING_OF_A_FORMAT = re.compile(r"\.[a-z0-9]+ ")  # about an output: it begins with the extension


@dataclass(frozen=True)
class Tolerances:
    """Largest allowed change of a number: |actual - expected| <= atol + rtol |expected|.

    Parameters
    ----------
    rtol, atol : float
    accuracy_atol : float
        Least `atol` of keys below `accuracy`, which are residuals.
    keys : mapping of str to mapping
        `rtol` and `atol` of dotted names (`*` and `?` match as in a shell); the last match counts.
    ignore : sequence of str
        Dotted names left out, beside `VOLATILE_FIELDS`.
    """

    rtol: float = RTOL
    atol: float = ATOL
    accuracy_atol: float = ACCURACY_ATOL
    keys: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    ignore: Sequence[str] = ()

    def of(self, name: str) -> tuple[float, float]:
        """(rtol, atol) of a dotted name."""
        rtol, atol = self.rtol, self.atol
        if name.startswith("accuracy."):
            atol = max(atol, self.accuracy_atol)
        for pattern, stated in self.keys.items():
            if _matches(name, pattern):
                rtol, atol = stated.get("rtol", rtol), stated.get("atol", atol)
        return rtol, atol

    def leaves_out(self, name: str) -> bool:
        """Whether a dotted name is not compared."""
        return any(_matches(name, pattern) for pattern in (*VOLATILE_FIELDS, *self.ignore))

    def unmatched(self, names: Iterable[str]) -> list[str]:
        """Keys of `keys` that match none of these dotted names."""
        names = list(names)
        return [pattern for pattern in self.keys if not any(_matches(name, pattern) for name in names)]


def _matches(name: str, pattern: str) -> bool:
    """Whether a dotted name has a pattern of `*` and `?`; brackets are those of numbers in lists."""
    return fnmatch.fnmatchcase(name, pattern.replace("[", "[[]"))


def flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of nested dicts and lists; an empty one is a leaf.

    Parameters
    ----------
    value : object
    name : str
        Name of `value`.

    Yields
    ------
    (str, object)
        Dotted name and leaf.
    """
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from flat(inner, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list) and value:
        for number, inner in enumerate(value):
            yield from flat(inner, f"{name}[{number}]")
    else:
        yield name, value


def compare(
    expected: dict[str, Any], actual: dict[str, Any], tolerances: Tolerances
) -> tuple[list[dict[str, Any]], int]:
    """Compare every leaf of two summaries, but for warnings about the formats of outputs.

    Parameters
    ----------
    expected, actual : dict
        Summaries.
    tolerances : Tolerances

    Returns
    -------
    moved : list of dict
        `key`, `expected`, `found`, and for numbers `difference` and `allowed`; 'missing' stands for a value
        that only the other summary has, and the number of entries for a list that is empty in one of them.
    compared : int
    """
    before, after = _leaves(expected), _leaves(actual)
    for own, other in ((before, after), (after, before)):
        _count_entries_of_empty_lists(own, other)
    names = [name for name in {**before, **after} if not tolerances.leaves_out(name)]
    moved = []
    for name in names:
        a, b = before.get(name, "missing"), after.get(name, "missing")
        entry = {"key": name, "expected": a, "found": b}
        if _number(a) and _number(b):
            rtol, atol = tolerances.of(name)
            a, b = float(a), float(b)
            allowed = atol + rtol * abs(a)
            difference = abs(b - a)
            if not difference <= allowed:
                moved.append({**entry, "difference": difference, "allowed": allowed})
        elif a != b or isinstance(a, bool) != isinstance(b, bool):
            moved.append(entry)
    return moved, len(names)


def _leaves(summary: dict[str, Any]) -> dict[str, Any]:
    """Compared leaves by dotted name."""
    warnings = summary.get("warnings")
    if isinstance(warnings, list):
        others = [w for w in warnings if not (isinstance(w, str) and WARNING_OF_A_FORMAT.match(w))]
        summary = {**summary, "warnings": others}
    return dict(flat(summary))


def _count_entries_of_empty_lists(own: dict[str, Any], other: dict[str, Any]) -> None:
    """Replace empty lists of `own` that have entries in `other` by the number of entries, in both."""
    for name in [name for name, value in own.items() if value == [] and name not in other]:
        numbers = {key[len(name) + 1 :].partition("]")[0] for key in other if key.startswith(f"{name}[")}
        if numbers:
            own[name] = "0 entries"
            other[name] = f"{len(numbers)} entr{'y' if len(numbers) == 1 else 'ies'}"


def _number(value: Any) -> bool:
    """Whether a value is a number that a double can hold."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return math.isfinite(value) if isinstance(value, float) else abs(value) <= sys.float_info.max
