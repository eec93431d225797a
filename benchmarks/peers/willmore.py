"""Seconds a step of `willmore-flow` and steps to rest, beside the feasibility figures of a survey.

The survey's true-gradient step (with CHOLMOD, another machine) is scaled by the time of one factorisation of
the same fourth-order matrix, measured in the same run.
Run: python -m benchmarks.peers.willmore [FACES...]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.common.measure import interleaved, machine, print_commands, print_table, timed
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.linalg.factor import Factor
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import setup
from ddgcli.models.willmore.area_energy import AreaEnergy
from ddgcli.models.willmore.conformal import conformal_step
from ddgcli.models.willmore.constraints import Constraints, area
from ddgcli.models.willmore.descent import (
    descent_motion,
    energy_gradient,
    fourth_order_matrix,
    mean_curvature_step,
    moved_along,
    preconditioner_at,
    rosenbrock_step,
)
from ddgcli.models.willmore.energies import DEFAULT_ENERGY, ENERGIES
from ddgcli.models.willmore.flow_options import FlowOptions, with_stop
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

# faces -> factorisation, whole step by the true gradient (the last one an estimate of the survey's)
SURVEY = {5_120: (0.019, 0.031), 20_480: (0.072, 0.140), 100_000: (0.5, 0.6)}
TORI = {3_000: (56, 28), 12_000: (110, 55), 50_000: (224, 112)}


def ellipsoid(level: int) -> TriangleMesh:
    mesh = shapes.icosphere(level)
    return mesh.moved(mesh.points * [1.0, 1.0, 2.0])


def calls(mesh: TriangleMesh) -> dict[str, Callable[[], Any]]:
    free, none = np.arange(mesh.n_vertices), Constraints()
    energies = {name: kind.of(mesh) for name, kind in ENERGIES.items()}
    best = energies[DEFAULT_ENERGY]
    at = energy_gradient(mesh, best, free, none)
    constrained = Constraints(area(mesh), enclosed_volume(mesh))
    like = Factor(fourth_order_matrix(at.mesh, free, 0.05))
    reached = {none: mesh, constrained: mesh}

    def step(constraints: Constraints) -> None:
        ready = preconditioner_at(energy_gradient(reached[constraints], best, free, constraints), 0.05, like)
        ready.descent_power()  # what decides whether it is near rest
        moved = moved_along(ready, descent_motion(ready, 0.05, constraints), 1.0, constraints)
        best.value(moved.points)  # what decides whether the step is taken, and what the next gradient uses
        reached[constraints] = moved

    gradients = {
        f"gradient, {name}": lambda energy=energy: energy.value_and_gradient(np.array(mesh.points))
        for name, energy in energies.items()
    }
    return {
        "factorisation": lambda: Factor(fourth_order_matrix(at.mesh, free, 0.05)),
        **gradients,
        "quadratic, to rest": lambda: step(none),
        "quadratic, to rest, area and volume kept": lambda: step(constrained),
        "quadratic, in time": lambda: rosenbrock_step(
            preconditioner_at(energy_gradient(mesh, best, free, none), 0.003, like), 0.01, best, none
        ),
        "mean-curvature": lambda: mean_curvature_step(mesh, free, 0.01),
        "film": lambda: film_step(mesh),
        "conformal": lambda: conformal_step(mesh, 0.5),
    }


def film_step(mesh: TriangleMesh) -> TriangleMesh:
    """A step of the area with the volume kept."""
    free, kept = np.arange(mesh.n_vertices), Constraints(volume=enclosed_volume(mesh), in_place=True)
    ready = preconditioner_at(
        energy_gradient(mesh, AreaEnergy(mesh.topology), free, kept), 0.01, of_area=True
    )
    return moved_along(ready, descent_motion(ready, 0.01, kept), 1.0, kept)


def survey(faces: int) -> tuple[float, float]:
    """The survey's figures at a number of faces, interpolated between powers; in proportion below them."""
    known = sorted(SURVEY)
    factor, whole = (
        float(np.exp(np.interp(np.log(faces), np.log(known), np.log([SURVEY[k][column] for k in known]))))
        for column in range(2)
    )
    less = min(1.0, faces / known[0])
    return factor * less, whole * less


def steps(sizes: list[int]) -> list[list]:
    table_rows = []
    for size in sizes:
        mesh = shapes.torus(*TORI[size], 2.0, 1.0)
        times = interleaved(calls(mesh), repeat=3)
        factor, whole = survey(mesh.n_faces)
        scaled = whole / factor * times["factorisation"].median
        for name, timing in times.items():
            beside = [scaled, timing.median / scaled] if name == "quadratic, to rest" else ["-", "-"]
            table_rows.append([mesh.n_faces, name, timing.median, *beside])
    return table_rows


def to_rest() -> list[list]:
    table_rows = []
    cell = shapes.icosphere(4)
    bubble = (36 * np.pi * enclosed_volume(ellipsoid(4)) ** 2) ** (1 / 3)
    catenoid = 6.9996426  # between rings of radius 1, 1.2 apart
    for name, mesh, least, options in (
        ("ellipsoid (1, 1, 2)", ellipsoid(4), 4 * np.pi, {}),
        ("the same, newton", ellipsoid(4), 4 * np.pi, {"flow": "newton"}),
        ("the same, conformal", ellipsoid(4), 4 * np.pi, {"flow": "conformal"}),
        ("torus of aspect 2", shapes.torus(96, 48, 2.0, 1.0), 2 * np.pi**2, {}),
        (
            "red blood cell, reduced volume 0.6",
            cell.moved(cell.points * [1.0, 1.0, 0.25838477]),
            1.95568026705 * 4 * np.pi,
            {"fix_area": True, "fix_volume": True},
        ),
        ("bubble (area)", ellipsoid(4), bubble, {"flow": "mean-curvature", "fix_volume": True}),
        ("catenoid (area)", shapes.cylinder(96, 48, 1.0, 1.2), catenoid, {"flow": "mean-curvature"}),
    ):
        chosen = with_stop(FlowOptions(**options), mesh.topology, False)

        def run(mesh: TriangleMesh = mesh, chosen: FlowOptions = chosen) -> list:
            flow, model = setup.build(mesh, chosen)
            return list(evolve({"s": model}, setup.schedule(flow, {}), Account()))

        timing = timed(run, repeat=1, warm_up=False)
        energy = timing.value[-1].observations["s"].scalar["energy"]
        table_rows.append([name, mesh.n_faces, len(timing.value) - 1, timing.median, energy / least - 1])
    return table_rows


# whole commands, timed as a user starts them
COMMANDS = ("willmore-flow ellipsoid.ply --steps 10 --dt 1e-3 -o out.vtkhdf",)


if __name__ == "__main__":
    print(machine())
    sizes = [int(word) for word in sys.argv[1:]] or list(TORI)
    print_table(
        "willmore-flow: seconds a step, torus of aspect 2, one thread",
        ["faces", "part", "seconds", "survey, scaled", "ours / survey"],
        steps(sizes),
    )
    print_table(
        "To rest",
        ["surface", "faces", "steps", "seconds", "energy / least - 1"],
        to_rest(),
    )
    print_commands(*COMMANDS)
