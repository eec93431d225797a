"""Tables of the atlas: observed rates, and the rows of the finest meshes."""

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
        groups.setdefault((row["truth"], row["mesh_class"], row["configuration"]), []).append(row)
    observed = {}
    for key, group in groups.items():
        finest = sorted(group, key=lambda r: r["h"])[:3]
        errors = np.array([r[error] for r in finest])
        if len(finest) > 1 and (errors > 1e-13).all():
            observed[key] = float(np.polyfit(np.log([r["h"] for r in finest]), np.log(errors), 1)[0])
    return observed


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
    """The finest level of every mesh sequence of a command's table.

    Attributes
    ----------
    truth : str
        Truth of the plots; the default of all methods.
    mesh_classes : list of str
        Of that truth.
    """

    def __init__(self, rows: list[Row]) -> None:
        self._rates = rates(rows)
        last: dict[tuple[str, str], float] = {}
        for row in rows:
            key = (row["truth"], row["mesh_class"])
            last[key] = max(last.get(key, 0), row["level"])
        self._rows = {
            (r["truth"], r["mesh_class"], r["configuration"]): r
            for r in rows
            if r["level"] == last[r["truth"], r["mesh_class"]]
        }
        self.truth = rows[0]["truth"]
        self.mesh_classes = list(
            dict.fromkeys(mesh_class for truth, mesh_class, _ in self._rows if truth == self.truth)
        )

    def row(self, configuration: str, mesh_class: str, truth: str | None = None) -> Row:
        """One row."""
        return self._rows[truth or self.truth, mesh_class, configuration]

    def having(self, *configurations: str, truth: str | None = None) -> list[str]:
        """Mesh classes whose finest level has all of these rows; KeyError if there is none."""
        classes = [
            f
            for f in self.mesh_classes
            if all((truth or self.truth, f, name) in self._rows for name in configurations)
        ]
        if not classes:
            raise KeyError(configurations)
        return classes

    def others(self, but: Iterable[str], mesh_class: str, truth: str | None = None) -> list[Row]:
        """The rows of a case without those whose configuration begins so."""
        return [
            row
            for (t, f, name), row in self._rows.items()
            if (t, f) == (truth or self.truth, mesh_class) and not name.startswith(tuple(but))
        ]

    def error(self, configuration: str, mesh_class: str, truth: str | None = None) -> float:
        """Mean error."""
        return self.row(configuration, mesh_class, truth)["mean_error"]

    def seconds(self, configuration: str, mesh_class: str, truth: str | None = None) -> float:
        """Set-up and one query."""
        row = self.row(configuration, mesh_class, truth)
        return row["setup_seconds"] + row["seconds"]

    def query(self, configuration: str, mesh_class: str, truth: str | None = None) -> float:
        """One further query."""
        return self.row(configuration, mesh_class, truth)["seconds"]

    def rate(self, configuration: str, mesh_class: str, truth: str | None = None) -> float:
        """Observed rate of the mean error."""
        return self._rates[truth or self.truth, mesh_class, configuration]
