"""Steady flow of a lid-driven cavity on the operators of `fluid-sim`, against Botella and Peyret (1998).

Extrema of the velocity on the middle lines. Newton's method (`benchmarks.fluids.steady`) solves for the flow
at which runs of `fluid-sim` end; the second table has what such runs take.

Run: python -m benchmarks.fluids.cavity [CELLS...]
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from benchmarks.common.measure import cpu_seconds, machine, print_table
from benchmarks.fluids.steady import SteadyFlow, model_of

# Reynolds number -> u_min on the vertical middle line, v_max and v_min on the horizontal one
TRUTH = {100: (-0.21404, 0.1795728, -0.2538030), 1000: (-0.3885698, 0.3769447, -0.5270771)}
GRIDS = (("right", 0.0), ("right", 0.9), ("alternating", 0.85))
EXTREMA = ("u_min", "v_max", "v_min")
NEWTON_SECONDS = "s of Newton's method"
RUN_CELLS = (32, 64)
RUN_STEP = 0.32  # times the speed of the lid, over the size of a cell
STEADY_DISTANCE = 1e-3  # root mean square of the difference of velocities, over that of the steady one
SCENE = """format = "ddgcli-scene/1"
[time]
duration = 1
step = {step}
[[object]]
name = "cavity"
role = "fluid"
grid = {{ size = [1, 1], cells = [{n}, {n}], pattern = "{pattern}", grading = {grading} }}
[effects]
viscosity = {{ nu = {nu} }}
[[effects.boundary]]
kind = "wall"
velocity = [1, 0, 0]
where = "y > 1 - 1e-6"
[[effects.boundary]]
kind = "no-slip"
"""


def extrema(phi: NDArray, spacing: NDArray) -> NDArray[np.float64]:
    """u_min, v_max and v_min of the splines through the stream function on the middle lines."""
    n = len(spacing) - 1
    at, phi = np.linspace(0.0, 1.0, 20 * n + 1), phi.reshape(n + 1, n + 1)
    u = CubicSpline(spacing, phi[n // 2])(at, 1)
    v = -CubicSpline(spacing, phi[:, n // 2])(at, 1)
    return np.array([u.min(), v.max(), v.min()])


def errors(n: int, reynolds: int, pattern: str, grading: float) -> tuple[NDArray[np.float64], float]:
    """Departures from the truth, and the relative change of the vorticity over one step of `fluid-sim`."""
    step = 1.0 / (5 * n if not grading else n * n)
    text = SCENE.format(n=n, pattern=pattern, grading=grading, nu=1.0 / reynolds, step=step)
    flow = SteadyFlow(model_of(text))
    x = None
    for reynolds_step in [r for r in (100, 400) if r < reynolds] + [reynolds]:
        x = flow.solve(1.0 / reynolds_step, x)
    assert x is not None
    state = flow.state(x)
    after = flow.model.advance(state, 0.0, step)
    moved = flow.space.enstrophy(after["vorticity"] - state["vorticity"]) / flow.space.enstrophy(
        state["vorticity"]
    )
    spacing = np.asarray(flow.space.mesh.points)[: n + 1, 1]  # type: ignore[union-attr]
    return extrema(flow.stream_function(x), spacing) - TRUTH[reynolds], float(np.sqrt(moved))


def run_to_steady(n: int) -> list[float]:
    """Step, time, steps and CPU seconds of `fluid-sim` from rest, and CPU seconds of Newton's method."""
    step = RUN_STEP / n
    text = SCENE.format(n=n, pattern="right", grading=0.0, nu=1.0 / 100, step=step)
    began = cpu_seconds()
    flow = SteadyFlow(model_of(text))
    steady = flow.state(flow.solve(1.0 / 100))
    newton = cpu_seconds() - began
    began = cpu_seconds()
    model = model_of(text)
    state, count, energy = model.start, 0, flow.model.flows.energy(steady)
    while True:
        apart = model.flows.energy(state.replaced(vorticity=state["vorticity"] - steady["vorticity"]))
        if apart < STEADY_DISTANCE**2 * energy:
            return [step, count * step, count, cpu_seconds() - began, newton]
        state, count = model.advance(state, count * step, step), count + 1


def main(cells: list[int]) -> None:
    print(machine())
    for reynolds in TRUTH:
        rows = []
        for pattern, grading in GRIDS:
            for n in cells:
                began = cpu_seconds()
                apart, moved = errors(n, reynolds, pattern, grading)
                rows.append([pattern, grading, n, *map(float, apart), moved, cpu_seconds() - began])
        print_table(
            f"lid-driven cavity, Re {reynolds}: computed minus Botella and Peyret",
            ["pattern", "grading", "cells", *EXTREMA, "change over a step", NEWTON_SECONDS], rows,
        )  # fmt: skip
    print_table(
        f"fluid-sim at Re 100 (right, grading 0), from rest to within {STEADY_DISTANCE:g} of the steady flow",
        ["cells", "step", "time", "steps", "s of fluid-sim", NEWTON_SECONDS],
        [[n, *run_to_steady(n)] for n in RUN_CELLS],
    )


if __name__ == "__main__":
    main([int(n) for n in sys.argv[1:]] or [64, 128])
