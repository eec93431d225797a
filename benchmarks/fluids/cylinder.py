"""Flow past a cylinder in a channel (Schaefer and Turek, 1996) against the published figures.

2D-1, Reynolds number 20, steady: drag and lift by Newton's method on the operators of `fluid-sim`.
2D-2, Reynolds number 100: Strouhal number and largest coefficients of a run.
Run: python -m benchmarks.fluids.cylinder [street [CELLS ACROSS, REFINE [DURATION]]]
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.measure import cpu_seconds, machine, print_table
from benchmarks.fluids.steady import SteadyFlow, model_of
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

DRAG, LIFT = 5.57953523384, 0.010618948146
STROUHAL, STREET_DRAG, STREET_LIFT = (0.2950, 0.3050), (3.22, 3.24), (0.99, 1.01)
HEIGHT, LENGTH, DIAMETER = 0.41, 2.2, 0.1
SCENE = """format = "ddgcli-scene/1"
[time]
duration = {duration}
step = {step}
frame_every = {every}
[[object]]
name = "channel"
role = "fluid"
grid = {{ size = [{length}, 0.41], cells = [{nx}, {ny}], pattern = "{pattern}" }}
[[object]]
name = "cylinder"
role = "obstacle"
cylinder = {{ start = [0.2, 0.2, -1], end = [0.2, 0.2, 1], radius = 0.05 }}
refine = {refine}
[effects]
viscosity = {{ nu = 1e-3 }}
harmonic = {{}}
{extra}
[[effects.boundary]]
kind = "inflow"
velocity = ["{speed}*4*y*(0.41-y)/0.1681", 0, 0]
where = "x < 1e-6"
[[effects.boundary]]
kind = "outflow"
{outlet}
where = "x > {length} - 1e-6"
[[effects.boundary]]
kind = "no-slip"
"""


def scene(ny: int, speed: float, pattern: str = "alternating", length: float = LENGTH, **time: float) -> str:
    """The channel with `ny` cells across; at the outlet the profile of the inlet, or none (`free`)."""
    outlet = f'velocity = ["{speed}*4*y*(0.41-y)/0.1681", 0, 0]'
    clock = {"duration": 1, "step": 0.5, "every": 1, "extra": "", "refine": 0, **time}
    if clock.pop("free", False):
        outlet = ""
    nx = round(length / HEIGHT * ny)
    return SCENE.format(ny=ny, nx=nx, speed=speed, pattern=pattern, length=length, outlet=outlet, **clock)


def coefficients(force: NDArray, mean_speed: float) -> NDArray[np.float64]:
    """Drag and lift coefficients of forces along x and y."""
    return 2.0 * force / (mean_speed**2 * DIAMETER)


def steady(ny: int, refine: int = 0, length: float = LENGTH) -> NDArray[np.float64]:
    """Drag and lift of 2D-1."""
    flow = SteadyFlow(model_of(scene(ny, 0.3, length=length, refine=refine)))
    force = flow.model.observe(flow.state(flow.solve(1e-3))).scalar["force_cylinder"]
    return coefficients(force, 0.2)


def street(ny: int, refine: int, duration: float = 6.0) -> tuple[float, float, float]:
    """Strouhal number, largest drag and lift of 2D-2 over the last third of a run."""
    step = round(0.6 * HEIGHT / ny / 2**refine, 4)
    every = max(1, round(0.01 / step)) * step
    nudge = 'initial = { vorticity = "exp(-((x-0.35)^2+(y-0.25)^2)/0.001)*30" }'
    text = scene(
        ny, 1.5, step=step, duration=round(duration / every) * every, every=every, extra=nudge, free=True,
        refine=refine,
    )  # fmt: skip
    model = model_of(text)
    snapshots = evolve({"channel": model.model()}, model.scene.schedule(), Account())
    force = np.array([snapshot.observations["channel"].scalar["force_cylinder"] for snapshot in snapshots])
    drag, lift = coefficients(force, 1.0).T
    late = len(lift) * 2 // 3
    sign = np.flatnonzero((lift[late:-1] < 0) & (lift[late + 1 :] >= 0)) + late
    crossing = (sign + lift[sign] / (lift[sign] - lift[sign + 1])) * every
    period = float((crossing[-1] - crossing[0]) / (len(crossing) - 1))
    return DIAMETER / period, float(drag[late:].max()), float(lift[late:].max())


def main(words: list[str]) -> None:
    print(machine())
    if words[:1] == ["street"]:
        ny, refine = map(int, words[1:3]) if len(words) > 2 else (41, 2)
        duration = float(words[3]) if len(words) > 3 else 6.0
        began = cpu_seconds()
        row = [ny, refine, duration, *street(ny, refine, duration), cpu_seconds() - began]
        print_table(
            f"2D-2, Re 100; published: {STROUHAL}, {STREET_DRAG}, {STREET_LIFT}",
            ["cells across", "refine", "duration", "Strouhal", "largest drag", "largest lift", "s"], [row],
        )  # fmt: skip
        return
    rows = []
    for ny, refine in ((20, 0), (41, 0), (16, 2), (16, 3), (24, 3), (20, 4), (41, 3)):
        began = cpu_seconds()
        drag, lift = steady(ny, refine)
        rows.append([ny, refine, drag, drag / DRAG - 1.0, lift, lift - LIFT, cpu_seconds() - began])
    print_table(
        f"2D-1, Re 20; published: drag {DRAG}, lift {LIFT}",
        ["cells across", "refine", "drag", "relative error", "lift", "error", "s"], rows,
    )  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1:])
