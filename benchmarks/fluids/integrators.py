"""Error against seconds by integrator after a fixed time, beside a standard semi-Lagrangian solver.

The wave is Rossby and Haurwitz's (a rigid turn and a harmonic of degree 3, which travels round the sphere as
it is) and Taylor and Green's cells in a box, both without friction: vorticity and velocity at the end against
the exact ones, relative to their root mean squares, and changes of energy and enstrophy.
Run: python -m benchmarks.fluids.integrators [LEVEL ...]      (1,280 faces at level 3)
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.measure import cpu_seconds, machine, print_table
from benchmarks.fluids.runs import run_fluid
from benchmarks.fluids.semi_lagrangian import SemiLagrangian
from ddgcli.mesh import shapes
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.scenes.shapes import Grid, grid_mesh

INTEGRATORS = ("conservative", "energy", "circulation", "covector")
PEER = "semi-Lagrangian (peer)"
WAVE = "2*z + 2*(x**2 - y**2)*z"
WAVE_SPEED, SPAN = 5 / 6, 2.0
CELLS = "2*sin(x)*sin(y)"
STEPS = (0.1, 0.025)


def wave(points: NDArray, time: float) -> NDArray[np.float64]:
    """Vorticity of the wave."""
    x, y, z = points.T
    angle = WAVE_SPEED * time
    x, y = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    return 2 * z + 2 * (x**2 - y**2) * z


def cells(points: NDArray, time: float) -> NDArray[np.float64]:
    """Vorticity of the steady cells."""
    return 2 * np.sin(points[:, 0]) * np.sin(points[:, 1])


def box(level: int) -> Any:
    """[0, 2 pi]^2 with walls where the cells' own stream lines are, of as many faces as the sphere."""
    n = round((10 * 4**level) ** 0.5)
    return grid_mesh(Grid(size=[2 * np.pi, 2 * np.pi], cells=[n, n], pattern="alternating"))


PROBLEMS: dict[str, tuple[Callable[[int], Any], str, Callable[[NDArray, float], NDArray]]] = {
    "wave, icosphere": (shapes.icosphere, WAVE, wave),
    "wave, irregular sphere": (lambda level: shapes.random_sphere(10 * 4**level + 2), WAVE, wave),
    "cells, box": (box, CELLS, cells),
}


def end_of(name: str, mesh: Any, vorticity: str, step: float) -> tuple[SurfaceSpace, NDArray, NDArray, float]:
    """Space, integrated vorticity at start and end, and seconds of all steps."""
    time = f"duration = {SPAN}\nframe_every = {SPAN}\nstep = {step}"
    start = f'initial = {{ vorticity = "{vorticity}" }}'
    if name == PEER:
        run = run_fluid(start, "duration = 1e-9\nstep = 1e-9", mesh=mesh)
        solver, began = SemiLagrangian(run.fluid.space), cpu_seconds()
        flow = run.fluid.start["vorticity"], run.fluid.start["coefficients"]
        for _ in range(round(SPAN / step)):
            flow = solver.step(*flow, step)
        return run.fluid.space, run.fluid.start["vorticity"], flow[0], cpu_seconds() - began
    run = run_fluid(start, f'integrator = "{name}"\n{time}', mesh=mesh)
    space = run.fluid.space
    return (
        space,
        run.fluid.start["vorticity"],
        run.observations[-1].vertex["vorticity"] * space.mass,
        run.seconds,
    )


def row(problem: str, level: int, name: str, step: float) -> list[Any]:
    """Row of the table."""
    make, vorticity, truth = PROBLEMS[problem]
    mesh = make(level)
    space, start, end, seconds = end_of(name, mesh, vorticity, step)
    exact = truth(mesh.points, SPAN) * space.mass
    if mesh.topology.is_closed:
        exact -= space.mass * exact.sum() / space.mass.sum()
    error = (space.enstrophy(end - exact) / space.enstrophy(exact)) ** 0.5

    def energy(omega: NDArray) -> float:
        return space.kinetic_energy(space.stream_function(omega), np.zeros(0))

    astray = (energy(end - exact) / energy(exact)) ** 0.5
    losses = 1.0 - energy(end) / energy(start), 1.0 - space.enstrophy(end) / space.enstrophy(start)
    return [problem, mesh.n_faces, name, step, error, astray, *losses, seconds]


def order_row(name: str, level: int) -> list[Any]:
    """Row of the table of orders: of the step, of mesh and step together, what changes, seconds a step.

    The order in the step is that of the vorticity on one mesh, by the differences of runs with steps of which
    each is half of the one before.
    """
    problem = "wave, icosphere"
    make, vorticity, _ = PROBLEMS[problem]
    mesh, ends = make(level - 1), []
    for halves in range(3):
        space, start, end, _ = end_of(name, mesh, vorticity, STEPS[0] / 2**halves)
        ends.append(end)
    apart = [space.enstrophy(a - b) ** 0.5 for a, b in zip(ends, ends[1:])]
    coarse, fine = row(problem, level - 1, name, 2 * STEPS[0]), row(problem, level, name, STEPS[0])
    total = float(abs(ends[-1].sum() - start.sum()) / np.abs(start).sum())
    return [
        name, np.log2(apart[0] / apart[1]), np.log2(coarse[5] / fine[5]), fine[6], fine[7], total,
        fine[8] / round(SPAN / STEPS[0]),
    ]  # fmt: skip


def main(words: list[str]) -> None:
    print(machine())
    level = int(words[0]) if words else 3
    print_table(
        f"orders, what is kept, and seconds: the wave on {20 * 4**level} faces, steps of {STEPS[0]:g}",
        ["integrator", "order in the step", "of the velocity in mesh and step", "energy lost",
         "enstrophy lost", "change of the total vorticity", "s a step"],
        [order_row(name, level) for name in (*INTEGRATORS, PEER)],
    )  # fmt: skip
    for level in [int(word) for word in words] or (3, 4):
        rows = [
            row(problem, level, name, step)
            for problem in PROBLEMS
            for step in STEPS
            for name in (*INTEGRATORS, PEER)
        ]
        header = [
            "problem", "faces", "integrator", "step", "error of the vorticity", "of the velocity",
            "energy lost", "enstrophy lost", "s",
        ]  # fmt: skip
        print_table(f"inviscid flow after time {SPAN:g}", header, rows)


if __name__ == "__main__":
    main(sys.argv[1:])
