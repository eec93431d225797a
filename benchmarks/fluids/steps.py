"""Seconds, solves and tracing of one step of every integrator, on surfaces and in volumes.

The step is that at which the fluid crosses one cell (CFL 1). CPU seconds; shares are of the loop's time.
Run: python -m benchmarks.fluids.steps [FACES ... [--cells N]]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from benchmarks.common.measure import machine, print_table
from benchmarks.fluids.runs import run_fluid
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.mesh import shapes
from ddgcli.models.fluid.scene import TRANSPORTS
from ddgcli.models.fluid.volume_paths import VolumePaths
from ddgcli.simulation.account import Account

HEADER = ["mesh", "integrator", "s a step", "solves a step", "of them seconds", "tracing"]
STEPS = 4
SURFACE_START = 'initial = { vorticity = "5*z + sin(3*x)*y" }'
VOLUME_START = 'initial = { velocity = ["sin(x)*cos(y)", "-cos(x)*sin(y)", 0] }'


@contextmanager
def booked_tracing(account: Account) -> Iterator[None]:
    """Book every trace of points to "tracing"."""
    kept = Tracer.trace_checked, VolumePaths.moved

    def surface(self: Tracer, *arguments: Any) -> Any:
        with account.within("tracing"):
            return kept[0](self, *arguments)

    def volume(self: VolumePaths, *arguments: Any) -> Any:
        with account.within("tracing"):
            return kept[1](self, *arguments)

    Tracer.trace_checked, VolumePaths.moved = surface, volume  # type: ignore[method-assign]
    try:
        yield
    finally:
        Tracer.trace_checked, VolumePaths.moved = kept  # type: ignore[method-assign]


def row(integrator: str, faces: int, cells: int) -> list[Any]:
    """Row of the table: an irregular sphere of `faces` triangles, or with 0 a box of 6 cells^3 tetrahedra."""
    account = Account()
    if faces:
        mesh, shape, start = shapes.random_sphere(faces // 2 + 2), 'mesh = "given"', SURFACE_START
        name, dt = f"{faces} triangles", (4.0 * np.pi / faces) ** 0.5 / 2.0
    else:
        size = [float(np.pi)] * 3
        mesh, start = None, VOLUME_START
        shape = f"box = {{ size = {size}, cells = {[cells] * 3} }}"
        name, dt = f"{6 * cells**3} tetrahedra", float(np.pi) / cells
    time = f'integrator = "{integrator}"\nduration = {STEPS * dt}\nstep = {dt}\nframe_every = {STEPS * dt}'
    with booked_tracing(account):
        run = run_fluid(start, time, shape, mesh, account=account)
    loop = account.seconds["integrator"] + account.seconds.get("tracing", 0) + account.seconds["solver"]
    solves = (account.calls["solver"] - run.solves_of_start) / STEPS
    shares = [f"{100 * account.seconds.get(kind, 0.0) / loop:.0f} %" for kind in ("solver", "tracing")]
    return [name, integrator, run.seconds / STEPS, solves, *shares]


def rows(faces: list[int], cells: list[int]) -> list[list[Any]]:
    """Rows of all integrators where they exist."""
    cases = [(2, count, 0) for count in faces] + [(3, 0, count) for count in cells]
    return [
        row(integrator, triangles, across)
        for dimension, triangles, across in cases
        for integrator, modules in TRANSPORTS.items()
        if dimension in modules
    ]


if __name__ == "__main__":
    words = sys.argv[1:]
    split = words.index("--cells") if "--cells" in words else len(words)
    print(machine())
    sizes = [int(word) for word in words[:split]], [int(word) for word in words[split + 1 :]]
    print_table(
        "fluid-sim: steps at CFL 1", HEADER, rows(*sizes) if words else rows([10_000, 50_000], [10, 17])
    )
