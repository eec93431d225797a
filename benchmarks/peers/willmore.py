"""Seconds a step of `willmore-flow`, steps to rest, scans, beside Surface Evolver, pymeshlab and libigl.

The true-gradient step of a survey (with CHOLMOD, another machine) is scaled by the time of one factorisation
of the same fourth-order matrix, measured in the same run.
Run: python -m benchmarks.peers.willmore [FACES... | NAMES OF SCANS...]; without words everything
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.common.measure import (
    Timing,
    cpu_seconds,
    interleaved,
    machine,
    print_commands,
    print_table,
    timed,
)
from benchmarks.common.willmore_scans import print_peers, print_scans
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
TORI = {3_000: (56, 28), 20_000: (142, 71), 100_000: (316, 158), 300_000: (548, 274)}
SIZES = (20_000, 100_000, 300_000)
LARGE = 50_000  # faces from which a step is measured once, without a warm-up
TIME_STEP = 5e-3  # default length of steps in time, of the radius to the fourth power


def ellipsoid(level: int) -> TriangleMesh:
    mesh = shapes.icosphere(level)
    return mesh.moved(mesh.points * [1.0, 1.0, 2.0])


def calls(mesh: TriangleMesh) -> dict[str, Callable[[], Any]]:
    free, none = np.arange(mesh.n_vertices), Constraints()
    energies = {name: kind.of(mesh) for name, kind in ENERGIES.items()}
    best = energies[DEFAULT_ENERGY]
    at = energy_gradient(mesh, best, free, none)
    constrained = Constraints(np.array([area(mesh)]), np.array([enclosed_volume(mesh)]))
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
    free, constraints = (
        np.arange(mesh.n_vertices),
        Constraints(volume=np.array([enclosed_volume(mesh)]), in_place=True),
    )
    ready = preconditioner_at(
        energy_gradient(mesh, AreaEnergy(mesh.topology), free, constraints), 0.01, of_area=True
    )
    return moved_along(ready, descent_motion(ready, 0.01, constraints), 1.0, constraints)


def survey(faces: int) -> tuple[float, float]:
    """The survey's figures at a number of faces, interpolated between powers; in proportion below them."""
    known = sorted(SURVEY)
    factor, whole = (
        float(np.exp(np.interp(np.log(faces), np.log(known), np.log([SURVEY[k][column] for k in known]))))
        for column in range(2)
    )
    less = min(1.0, faces / known[0])
    return factor * less, whole * less


def step_times(mesh: TriangleMesh) -> dict[str, Timing]:
    if mesh.n_faces < LARGE:
        return interleaved(calls(mesh), repeat=3)
    return {name: timed(call, repeat=1, warm_up=False) for name, call in calls(mesh).items()}


def steps(sizes: list[int]) -> list[list]:
    table_rows = []
    for size in sizes:
        mesh = shapes.torus(*TORI[size], 2.0, 1.0)
        times = step_times(mesh)
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
        flow_options = with_stop(FlowOptions(**options), mesh.topology, False)

        def run(mesh: TriangleMesh = mesh, flow_options: FlowOptions = flow_options) -> list:
            flow, model = setup.build(mesh, flow_options)
            return list(evolve({"s": model}, setup.schedule(flow, {}), Account()))

        timing = timed(run, repeat=1, warm_up=False)
        energy = timing.value[-1].observations["s"].scalar["energy"]
        table_rows.append([name, mesh.n_faces, len(timing.value) - 1, timing.median, energy / least - 1])
    return table_rows


def bumpy_ball() -> TriangleMesh:
    ball = shapes.icosphere(3)
    x, _, z = ball.points.T
    return ball.moved(ball.points * (1 + 0.3 * x * z + 0.2 * z**3)[:, None] * [1.0, 1.2, 1.6])


def steps_until(mesh: TriangleMesh, shares: tuple[float, ...], options: FlowOptions, **times: float) -> list:
    """Steps of a flow of a sphere until shares of the start's energy above 4 pi are left, seconds, end."""
    flow, model = setup.build(mesh, options)
    began = cpu_seconds()
    shots = [s.observations["s"] for s in evolve({"s": model}, setup.schedule(flow, times), Account())]
    seconds = cpu_seconds() - began
    above = np.array([shot.scalar["energy"] for shot in shots]) / (4 * np.pi) - 1
    left = [np.flatnonzero(above < share * above[0]) for share in shares]
    reached = [int(shots[at[0]].scalar["steps"]) if len(at) else "-" for at in left]
    return [*reached, seconds, above[-1] / above[0], shots[-1].scalar.get("log_ratio_change_max", "-")]


def conformal_beside_others() -> list[list]:
    table_rows, shares = [], (0.1, 0.01)
    for name, mesh in (("ellipsoid (1, 1, 2)", ellipsoid(3)), ("bumpy ball", bumpy_ball())):
        radius = (area(mesh) / (4 * np.pi)) ** 0.5
        for flow in ("conformal", "quadratic", "newton"):
            options = with_stop(FlowOptions(flow=flow), mesh.topology, False)
            words = f"{flow}, to rest"
            table_rows.append([name, words, *steps_until(mesh, shares, options)])
        for times in (1, 4, 16):
            dt = times * TIME_STEP * radius**4
            words = f"quadratic, --dt {times * TIME_STEP:g} R^4"
            clock = {"step": dt, "duration": 64 * TIME_STEP * radius**4, "frame_every": dt}
            table_rows.append(
                [name, words, *steps_until(mesh, (0.1, 0.01), FlowOptions(timed=True), **clock)]
            )
    return table_rows


def print_own(sizes: list[int]) -> None:
    print_table(
        "willmore-flow: seconds a step, torus of aspect 2, one thread",
        ["faces", "part", "seconds", "survey, scaled", "ours / survey"],
        steps(sizes),
    )


# whole commands, timed as a user starts them
COMMANDS = (
    "willmore-flow ellipsoid.ply --steps 10 --dt 1e-3 -o out.vtkhdf",
    "willmore-flow ellipsoid.ply --flow conformal --json",
)


if __name__ == "__main__":
    print(machine())
    sizes = [int(word) for word in sys.argv[1:] if word.isdecimal()]
    names = [word for word in sys.argv[1:] if not word.isdecimal()]
    if sizes or not names:
        print_own(sizes or list(SIZES))
    if names or not sizes:
        print_scans(names)
    if not (sizes or names):
        print_table(
            "To rest",
            ["surface", "faces", "steps", "seconds", "energy / least - 1"],
            to_rest(),
        )
        print_table(
            "Steps until a tenth and a hundredth of the energy above 4 pi is left, from the same start "
            "(1,280 faces; R: radius of the sphere of the same area; last column: largest change of the "
            "logarithm of the ratio of two sides)",
            ["surface", "flow", "to 0.1", "to 0.01", "s", "left at the end", "change of shape"],
            conformal_beside_others(),
        )
        print_peers()
        print_commands(*COMMANDS)
