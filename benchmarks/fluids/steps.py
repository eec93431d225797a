"""Seconds, solves, shares of tracing and solving of one step of every integrator, and memory a cell.

The step is that at which the fluid crosses one cell (CFL 1), divided where the integrator must; the figures
are of one step taken. CPU seconds; shares are of the loop's time.
Memory is the peak of the whole run above that before the mesh (Linux), over the number of cells.
Run: python -m benchmarks.fluids.steps [FACES ... [--cells N]]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common.measure import machine, print_table
from benchmarks.fluids.runs import run_fluid
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.mesh import shapes
from ddgcli.models.fluid.scene import TRANSPORTS
from ddgcli.models.fluid.volume_paths import VolumePaths
from ddgcli.simulation.account import Account

HEADER = [
    "mesh", "integrator", "divided into", "s a step", "solves a step", "of them seconds", "tracing",
    "bytes a cell",
]  # fmt: skip
STEPS = 2
FACES, CELLS = (10_000, 50_000, 200_000), (18, 32)  # 35k and 197k tetrahedra
SURFACE_START = 'initial = { vorticity = "5*z + sin(3*x)*y" }'
VOLUME_START = 'initial = { velocity = ["sin(x)*cos(y)", "-cos(x)*sin(y)", 0] }'


@contextmanager
def booked_tracing(account: Account) -> Iterator[None]:
    """Book every trace of points to "tracing"."""
    originals = Tracer.trace_checked, VolumePaths.moved

    def surface(self: Tracer, *arguments: Any) -> Any:
        with account.within("tracing"):
            return originals[0](self, *arguments)

    def volume(self: VolumePaths, *arguments: Any) -> Any:
        with account.within("tracing"):
            return originals[1](self, *arguments)

    Tracer.trace_checked, VolumePaths.moved = surface, volume  # type: ignore[method-assign, assignment]
    try:
        yield
    finally:
        Tracer.trace_checked, VolumePaths.moved = originals  # type: ignore[method-assign, assignment]


def resident(what: str) -> float:
    """Resident memory of this process now (`VmRSS`) or at most (`VmHWM`) [bytes]; NaN where unknown."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return float("nan")
    return next((1024.0 * int(line.split()[1]) for line in lines if line.startswith(what)), float("nan"))


def row(integrator: str, faces: int, cells: int) -> list[Any]:
    """Row of the table: an irregular sphere of `faces` triangles, or with 0 a box of 6 cells^3 tetrahedra."""
    account, cell_count = Account(), faces or 6 * cells**3
    before = resident("VmRSS")
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
    solves = (account.calls["solver"] - run.solves_of_start) / run.steps
    shares = [f"{100 * account.seconds.get(kind, 0.0) / loop:.0f} %" for kind in ("solver", "tracing")]
    memory = round((resident("VmHWM") - before) / cell_count)
    return [name, integrator, run.steps / STEPS, run.seconds / run.steps, solves, *shares, memory]


def rows(faces: list[int], cells: list[int]) -> list[list[Any]]:
    """Rows of all integrators where they exist, each from a process of its own, whose memory is its alone."""
    cases = [(2, count, 0) for count in faces] + [(3, 0, count) for count in cells]
    calls = [
        (integrator, triangles, across)
        for dimension, triangles, across in cases
        for integrator, modules in TRANSPORTS.items()
        if dimension in modules
    ]
    spawned = get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawned, max_tasks_per_child=1) as pool:
        return list(pool.map(row, *zip(*calls)))


if __name__ == "__main__":
    words = sys.argv[1:]
    split = words.index("--cells") if "--cells" in words else len(words)
    print(machine())
    sizes = [int(word) for word in words[:split]], [int(word) for word in words[split + 1 :]]
    print_table("fluid-sim: steps at CFL 1", HEADER, rows(*sizes) if words else rows([*FACES], [*CELLS]))
