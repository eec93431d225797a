"""Reading the atlas's tables: observed rates, and the finest rows that pieces of advice speak of."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

Row = dict[str, Any]


def rates(rows: list[Row], error: str = "mean_error") -> dict[tuple[str, str, str], float]:
    """Observed rate of each configuration: the slope of log error over log h on its finest three meshes."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["truth"], row["family"], row["configuration"]), []).append(row)
    found = {}
    for key, group in groups.items():
        finest = sorted(group, key=lambda r: r["h"])[:3]
        errors = np.array([r[error] for r in finest])
        if len(finest) > 1 and (errors > 1e-13).all():
            found[key] = float(np.polyfit(np.log([r["h"] for r in finest]), np.log(errors), 1)[0])
    return found


NUMBERS = ("h", "setup_seconds", "seconds", "peak_mib", "max_error", "mean_error")


def stored(path: Path) -> list[Row]:
    """The rows of a CSV of the atlas."""
    with open(path, newline="", encoding="utf-8") as file:
        return [
            row
            | {name: float(row[name]) for name in NUMBERS}
            | {"level": int(row["level"]), "faces": int(row["faces"]), "on_front": row["on_front"] == "True"}
            for row in csv.DictReader(file)
        ]


class Finest:
    """The finest rung of every ladder of a command's table.

    Attributes
    ----------
    truth : str
        That of the pictures: what the methods speak of unless told otherwise.
    families : list of str
        Of that truth.
    """

    def __init__(self, rows: list[Row]) -> None:
        self._rates = rates(rows)
        last: dict[tuple[str, str], float] = {}
        for row in rows:
            key = (row["truth"], row["family"])
            last[key] = max(last.get(key, 0), row["level"])
        self._rows = {
            (r["truth"], r["family"], r["configuration"]): r
            for r in rows
            if r["level"] == last[r["truth"], r["family"]]
        }
        self.truth = rows[0]["truth"]
        self.families = list(dict.fromkeys(family for truth, family, _ in self._rows if truth == self.truth))

    def row(self, configuration: str, family: str, truth: str | None = None) -> Row:
        """One row."""
        return self._rows[truth or self.truth, family, configuration]

    def having(self, *configurations: str, truth: str | None = None) -> list[str]:
        """Families whose finest rung has all of these rows; at least one, or the claim stands on nothing."""
        found = [
            f
            for f in self.families
            if all((truth or self.truth, f, name) in self._rows for name in configurations)
        ]
        if not found:
            raise KeyError(configurations)
        return found

    def others(self, but: Iterable[str], family: str, truth: str | None = None) -> list[Row]:
        """The rows of a case without those whose configuration begins so."""
        return [
            row
            for (t, f, name), row in self._rows.items()
            if (t, f) == (truth or self.truth, family) and not name.startswith(tuple(but))
        ]

    def error(self, configuration: str, family: str, truth: str | None = None) -> float:
        """Mean error."""
        return self.row(configuration, family, truth)["mean_error"]

    def seconds(self, configuration: str, family: str, truth: str | None = None) -> float:
        """Set-up and one query."""
        row = self.row(configuration, family, truth)
        return row["setup_seconds"] + row["seconds"]

    def query(self, configuration: str, family: str, truth: str | None = None) -> float:
        """One further query."""
        return self.row(configuration, family, truth)["seconds"]

    def rate(self, configuration: str, family: str, truth: str | None = None) -> float:
        """Observed rate of the mean error."""
        return self._rates[truth or self.truth, family, configuration]
