"""Carried flows beside walls and in thin layers: `circulation` and `covector` beside `conservative`.

Steady cells between walls of free slip and on a periodic grid; a wall that starts to move in a channel (the
flow is parallel, so that nothing carries it) and a cavity at Re 100, beside `conservative` on the same mesh;
the growth of a shear layer of Kelvin and Helmholtz (0.1897 of speed over half width: A. Michalke, Journal of
Fluid Mechanics, 1964). Run: python -m benchmarks.fluids.walls
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.measure import machine, print_table
from benchmarks.fluids.integrators import CELLS, SPAN, cells
from benchmarks.fluids.runs import FluidRun, run_fluid

CARRIED = ("circulation", "covector")
PATTERNS = ("right", "alternating")
LID = '[[effects.boundary]]\nkind = "wall"\nvelocity = [1, 0, 0]\nwhere = "y > 0.999"\n'
NO_SLIP = f'viscosity = {{ nu = 0.01 }}\nharmonic = {{}}\n{LID}[[effects.boundary]]\nkind = "no-slip"'
SCENES = {
    "channel, wall starts to move": ("size = [1, 1], cells = [8, 8], periodic = 'x'", 0.5),
    "cavity": ("size = [1, 1], cells = [20, 20]", 4.0),
}
GROWTH, WAVE_NUMBER, HALF_HEIGHT, START, END = 0.1897, 0.4446, 7.0, 12.0, 20.0


def run(integrator: str, grid: str, pattern: str, effects: str, step: float, duration: float) -> FluidRun:
    """Run on a grid; two frames."""
    time = f'integrator = "{integrator}"\nstep = {step}\nduration = {duration}\nframe_every = {duration}'
    return run_fluid(effects, time, f'grid = {{ {grid}, pattern = "{pattern}" }}')


def apart(fluid_run: FluidRun, vorticity: NDArray, exact: NDArray) -> float:
    """Difference of vorticities, relative in the root mean square."""
    space = fluid_run.fluid.space
    return float(
        (space.enstrophy((vorticity - exact) * space.mass) / space.enstrophy(exact * space.mass)) ** 0.5
    )


def cell_rows() -> list[list[Any]]:
    """Errors of the vorticity of steady cells."""
    rows = []
    for periodic in ("", "xy"):
        for pattern in PATTERNS:
            for n in (32, 64) if not periodic else (32,):
                grid = f"size = [{2 * np.pi}, {2 * np.pi}], cells = [{n}, {n}], periodic = '{periodic}'"
                row: list[Any] = ["periodic" if periodic else "walls", pattern, n]
                for name in ("conservative", *CARRIED):
                    ended = run(name, grid, pattern, f'initial = {{ vorticity = "{CELLS}" }}', 0.1, SPAN)
                    exact = cells(ended.fluid.context.points, SPAN)
                    row.append(apart(ended, ended.observations[-1].vertex["vorticity"], exact))
                rows.append(row)
    return rows


def wall_rows() -> list[list[Any]]:
    """Differences to `conservative` where walls drive the flow."""
    rows = []
    for name, (grid, duration) in SCENES.items():
        for pattern in PATTERNS:
            exact = run("conservative", grid, pattern, NO_SLIP, 0.0125, duration).observations[-1].vertex
            for integrator in CARRIED:
                for step in (0.1, 0.025):
                    ended = run(integrator, grid, pattern, NO_SLIP, step, duration)
                    error = apart(ended, ended.observations[-1].vertex["vorticity"], exact["vorticity"])
                    scalar = ended.observations[-1].scalar["corrections"][4]
                    rows.append([name, pattern, integrator, step, ended.steps, error, scalar])
    return rows


def growth(integrator: str, pattern: str, cells_per_width: float) -> float:
    """Growth rate of a layer with velocity tanh(y)."""
    length = 2 * np.pi / WAVE_NUMBER
    n, m = (2 * round(side * cells_per_width / 2) for side in (length, 2 * HALF_HEIGHT))
    grid = f"size = [{length}, {2 * HALF_HEIGHT}], cells = [{n}, {m}], periodic = 'x'"
    layer = f"-(1 + 0.001*sin({WAVE_NUMBER}*x))/cosh(y - {HALF_HEIGHT})**2"
    ended = run_fluid(
        f'initial = {{ vorticity = "{layer}" }}\nharmonic = {{}}',
        f'integrator = "{integrator}"\nstep = 0.1\nduration = {END}\nframe_every = 4',
        f'grid = {{ {grid}, pattern = "{pattern}" }}',
    )
    wave = ended.fluid.space.mass * np.exp(1j * WAVE_NUMBER * ended.fluid.context.points[:, 0])
    first, last = (abs(wave @ ended.observations[k].vertex["vorticity"]) for k in (-3, -1))
    return float(np.log(last / first) / (END - START))


def main() -> None:
    print(machine())
    print_table(
        f"steady cells after time {SPAN:g}: error of the vorticity",
        ["boundary", "pattern", "cells along a side", "conservative", *CARRIED],
        cell_rows(),
    )
    print_table(
        "walls without slip: difference of the vorticity to that of conservative",
        ["flow", "pattern", "integrator", "step", "steps", "difference", "energy that scaling took"],
        wall_rows(),
    )
    print_table(
        f"growth of a shear layer (exact: {GROWTH:g})",
        ["cells to the half width", "pattern", "conservative", *CARRIED],
        [
            [width, pattern, *(growth(name, pattern, width) for name in ("conservative", *CARRIED))]
            for width in (1.7, 3.0)
            for pattern in PATTERNS
        ],
    )


if __name__ == "__main__":
    main()
