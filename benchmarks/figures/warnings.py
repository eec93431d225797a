"""Warnings of noise by `curvature`: are they right, and is the proposed radius near the best one?

Errors of H in per cent, means over the mean size; the sweep is over six radii of `quadric`.
Words: tables, of `voxels`, `noise`, `clean` and `real` (default: these four), and `fitted`, the surfaces that
most limits were fitted on; `sweep`: also the best radius. Run:
python -m benchmarks.figures.warnings [TABLE ...] [sweep]
"""

from __future__ import annotations

import logging
import re
import sys
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from benchmarks.common import further_surfaces, noisy_surfaces
from benchmarks.common.known_surfaces import KnownSurface, error_as_stated
from benchmarks.common.measure import print_table
from benchmarks.common.mesh_sequences import SHARED_MESHES, real
from ddgcli.algorithms.curvature.surface_curvature import measure_curvature

LARGE_ERROR = 0.15
SWEPT_EDGES = 1.6 * 2 ** (np.arange(6) / 2)  # radii in mean edges
PROPOSAL = re.compile(r"use (?:`scheme=(\S+)` with )?`radius=(\w+|[\d.e+-]+)`.*about (\d+) %")


class _Messages(logging.Handler):
    """Warnings of a run."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(record.getMessage())


Radius: TypeAlias = float | Literal["auto"] | None


@dataclass
class Outcome:
    """Errors of one surface: true and stated ones."""

    default: float
    stated: float | None
    scheme: str
    radius: Radius
    proposed: float | None
    proposed_stated: float | None
    automatic: float
    best: float | None


def outcome(surface: KnownSurface, messages: _Messages, sweep: bool) -> Outcome:
    """Run the default, what it proposes, `auto` and a sweep."""

    def error(scheme: str, radius: Radius) -> float:
        result = measure_curvature(surface.mesh, scheme, radius, full=False)
        return error_as_stated(surface, result.vertex["mean_curvature"])

    messages.texts.clear()
    result = measure_curvature(surface.mesh, full=False)
    default = error_as_stated(surface, result.vertex["mean_curvature"])
    match = next(filter(None, map(PROPOSAL.search, messages.texts)), None)
    automatic = error("quadric", "auto")
    best = None
    if sweep and (default > LARGE_ERROR or match):
        radii = SWEPT_EDGES * float(surface.mesh.side_length.mean())
        best = min(default, *(error("quadric", float(radius)) for radius in radii))
    if not match:
        return Outcome(default, None, "", None, None, None, automatic, best)
    scheme = match[1] or "quadric"
    radius: Radius = "auto" if match[2] == "auto" else float(match[2])
    stated, proposed = result.results["expected_error"], error(scheme, radius)
    return Outcome(default, stated, scheme, radius, proposed, int(match[3]) / 100, automatic, best)


def known_table(title: str, cases: further_surfaces.Cases, sweep: bool, messages: _Messages) -> None:
    """Print the outcomes of surfaces with known curvature, and a summary of them."""
    rows, outcomes = [], []
    for name, make in cases:
        o = outcome(make(), messages, sweep)
        outcomes.append(o)
        shown = (o.default, o.stated, o.proposed, o.proposed_stated, o.automatic, o.best)
        percents = ["-" if x is None else round(100 * x, 1) for x in shown]
        rows.append([name, *percents[:2], o.scheme or "-", o.radius or "-", *percents[2:]])
    header = ["surface", "default", "stated", "proposed scheme", "radius", "error there", "stated"]
    print_table(title, [*header, "`--radius auto`", "best of a sweep"], rows)
    print_table(f"{title}: summary", ["", ""], summary(outcomes))


def summary(outcomes: list[Outcome]) -> list[list]:
    """Rows of counts."""
    large = [o for o in outcomes if o.default > LARGE_ERROR]
    warned = [o for o in outcomes if o.stated is not None]

    def within(pairs: list[tuple[float, float]], factor: float) -> str:
        good = sum(b / factor <= a <= factor * b for a, b in pairs)
        return f"{good} of {len(pairs)}"

    stated = [(o.default, o.stated or 0.0) for o in warned]
    cured = [(max(o.proposed or 0.0, 0.01), max(o.proposed_stated or 0.0, 0.01)) for o in warned]
    worst = max((o.automatic / max(o.default, 0.02) for o in outcomes), default=0.0)
    rows: list[list] = [
        ["surfaces", len(outcomes)],
        ["default above 15 %", len(large)],
        ["of these warned", sum(o.stated is not None for o in large)],
        ["warned below 8 %", sum(o.default < 0.08 for o in warned)],
        ["error of the default within a factor of 2 of the stated one", within(stated, 2)],
        ["error at the proposal within a factor of 2 of the stated one", within(cured, 2)],
        ["within 1.5", within(cured, 1.5)],
        ["proposal worse than the default", sum((o.proposed or 0) > o.default for o in warned)],
        ["largest ratio of auto to the default", worst],
    ]
    near = [(o.proposed or 0.0) <= 1.5 * o.best for o in warned if o.best is not None]
    return [*rows, ["proposal at most 1.5 times the best of the sweep", sum(near)]] if near else rows


def real_table(messages: _Messages) -> None:
    """Print the warnings about real surfaces, whose curvature is not known."""
    rows = []
    for path in sorted(SHARED_MESHES.glob("*")):
        if path.suffix not in (".obj", ".off", ".ply", ".STL"):
            continue
        messages.texts.clear()
        measure_curvature(real(path.name), full=False)
        text = next((t for t in messages.texts if "at the default region" in t), "-")
        rows.append([path.name, text.split(":")[0]])
    print_table("Real surfaces: warnings", ["file", "the surface"], rows)


def main() -> None:
    """Print the tables."""
    messages, sweep = _Messages(), "sweep" in sys.argv
    logger = logging.getLogger("ddgcli")
    logger.addHandler(messages)
    logger.propagate = False
    tables = set(sys.argv[1:]) - {"sweep"} or {"voxels", "noise", "clean", "real"}
    if "voxels" in tables:
        known_table("Voxels and images", further_surfaces.voxel_cases(), sweep, messages)
    if "noise" in tables:
        known_table("Noise", further_surfaces.noise_cases(), sweep, messages)
    if "clean" in tables:
        known_table("Clean", further_surfaces.clean_cases(), sweep, messages)
    if "real" in tables:
        real_table(messages)
    if "fitted" in tables:
        known_table("Fitted on: voxels", noisy_surfaces.voxel_cases(), sweep, messages)
        known_table("Fitted on: noise", noisy_surfaces.noise_cases(), sweep, messages)
        known_table("Fitted on: clean", noisy_surfaces.clean_cases(), sweep, messages)


if __name__ == "__main__":
    main()
