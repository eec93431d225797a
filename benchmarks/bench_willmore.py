"""Seconds a step of `willmore-flow` and steps to rest, beside the feasibility figures of a survey.

The survey's true-gradient step (with CHOLMOD, another machine) is scaled by the time of one factorisation of
the same fourth-order matrix, measured in the same run. Run: python benchmarks/bench_willmore.py
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from measure import interleaved, machine, print_table, timed

from ddgcli.evolve.account import Account
from ddgcli.evolve.loop import evolve
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import setup
from ddgcli.models.willmore.constraints import Constraints
from ddgcli.models.willmore.descent import accurate_step, fourth_order, metric, robust_step, slope
from ddgcli.models.willmore.energies import ENERGIES
from ddgcli.models.willmore.flow import DEFAULT_STOP
from ddgcli.models.willmore.setup import Wishes

SURVEY = {5_120: (0.019, 0.031), 20_480: (0.072, 0.140)}  # faces -> factorisation, whole step


def ellipsoid(level: int) -> TriangleMesh:
    mesh = shapes.icosphere(level)
    return mesh.moved(mesh.points * [1.0, 1.0, 2.0])


def calls(mesh: TriangleMesh) -> dict[str, Callable[[], Any]]:
    free, none = np.arange(mesh.n_vertices), Constraints()
    energies = {name: kind.build(mesh.topology) for name, kind in ENERGIES.items()}
    best = energies["sullivan"]
    at = slope(mesh, best, free, none)
    gradients = {
        f"gradient, {name}": partial(energy.value_and_gradient, mesh.points)
        for name, energy in energies.items()
    }
    return {
        "factorisation": lambda: fourth_order(at.mesh, free, 0.05),
        **gradients,
        "step, first order": lambda: robust_step(metric(slope(mesh, best, free, none), 0.05), 0.05, none),
        "step, second order": lambda: accurate_step(slope(mesh, best, free, none), 0.01, best, none),
    }


def steps() -> list[list]:
    found = []
    for level in (4, 5):
        mesh = ellipsoid(level)
        times = interleaved(calls(mesh), repeat=3)
        factor, whole = SURVEY[mesh.n_faces]
        scaled = whole / factor * times["factorisation"].median
        for name, timing in times.items():
            beside = [scaled, timing.median / scaled] if name == "step, first order" else ["-", "-"]
            found.append([mesh.n_faces, name, timing.median, *beside])
    return found


def to_rest() -> list[list]:
    found = []
    for name, mesh, least in (
        ("ellipsoid (1, 1, 2)", ellipsoid(4), 4 * np.pi),
        ("torus of aspect 2", shapes.torus(96, 48, 2.0, 1.0), 2 * np.pi**2),
    ):

        def run(mesh: TriangleMesh = mesh) -> list:
            flow, model = setup.build(mesh, Wishes(stop=DEFAULT_STOP))
            return list(evolve({"s": model}, setup.schedule(flow, {}), Account()))

        timing = timed(run, repeat=1, warm_up=False)
        energy = timing.value[-1].observations["s"].scalar["energy"]
        found.append([name, mesh.n_faces, len(timing.value) - 1, timing.median, energy / least - 1])
    return found


if __name__ == "__main__":
    print(machine())
    print_table(
        "willmore-flow: seconds", ["faces", "part", "seconds", "survey, scaled", "ours / survey"], steps()
    )
    print_table(
        "To rest by default options",
        ["surface", "faces", "steps", "seconds", "energy / least - 1"],
        to_rest(),
    )
