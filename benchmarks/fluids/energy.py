"""Long runs of the integrator `energy`: drift of the kinetic energy, and how well time turns back.

Run: python -m benchmarks.fluids.energy [STEPS [STEPS THERE AND BACK]]
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.measure import cpu_seconds, machine, print_table
from ddgcli.algorithms.hodge.harmonic import harmonic_basis
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid.conservative import StageRates, midpoint
from ddgcli.models.fluid.midpoint import implicit_midpoint
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.models.fluid.volume_space import VolumeSpace
from ddgcli.models.fluid.volume_transport import rate

STEP, REVERSED_STEP = 0.1, 0.02
Advance = Callable[[NDArray, float], NDArray]


def plate_with_holes(holes: int = 3) -> TriangleMesh:
    """Surface of a plate of unit cubes with square holes: closed, genus `holes`."""
    solid = np.ones((2 * holes + 1, 3), dtype=bool)
    solid[1::2, 1] = False
    points: dict[tuple, int] = {}
    faces = []

    def quad(corners: list[tuple]) -> None:
        a, b, c, d = (points.setdefault(corner, len(points)) for corner in corners)
        faces.extend([(a, b, c), (a, c, d)])

    for i, j in np.argwhere(solid):
        quad([(i, j, 1), (i + 1, j, 1), (i + 1, j + 1, 1), (i, j + 1, 1)])
        quad([(i, j, 0), (i, j + 1, 0), (i + 1, j + 1, 0), (i + 1, j, 0)])
        for (di, dj), (p, q) in {
            (1, 0): ((1, 0), (1, 1)), (-1, 0): ((0, 1), (0, 0)), (0, 1): ((1, 1), (0, 1)),
            (0, -1): ((0, 0), (1, 0)),
        }.items():  # fmt: skip
            near = (i + di, j + dj)
            if not (0 <= near[0] < len(solid) and 0 <= near[1] < 3 and solid[near]):
                low, high = (i + p[0], j + p[1]), (i + q[0], j + q[1])
                quad([(*low, 0), (*high, 0), (*high, 1), (*low, 1)])
    mesh = TriangleMesh.from_arrays(np.array(list(points), dtype=float), np.array(faces))
    return mesh.moved(mesh.points / 3.0)


def surface(mesh: TriangleMesh) -> tuple[NDArray, Advance, Callable[[NDArray], float]]:
    """Some flow on a surface, one step, and its kinetic energy."""
    space = SurfaceSpace(mesh, harmonic_basis(mesh, "normal").forms)
    x, y, z = mesh.points.T
    vorticity = (np.sin(3 * x + 1) * np.cos(2 * z + 1) + y + x * z) * space.mass
    if mesh.topology.is_closed:
        vorticity -= space.mass * vorticity.sum() / space.mass.sum()
    n = space.n

    def advance(state: NDArray, dt: float) -> NDArray:
        return np.concatenate(midpoint(StageRates(space, True), state[:n], state[n:], dt)[:2])

    def energy(state: NDArray) -> float:
        return space.kinetic_energy(space.stream_function(state[:n]), state[n:])

    return np.concatenate([vorticity, np.full(len(space.harmonic), 0.3)]), advance, energy


def volume() -> tuple[NDArray, Advance, Callable[[NDArray], float]]:
    """Some flow in an irregular box of tetrahedra."""
    mesh = shapes.box_tetrahedra(3, 3, 3)
    inside = ((mesh.points > 0) & (mesh.points < 1)).all(axis=1)
    shift = 0.05 * np.random.default_rng(0).normal(size=mesh.points.shape)
    space = VolumeSpace(mesh.moved(mesh.points + np.where(inside[:, None], shift, 0.0)))
    x, y, z = space.centre.T
    start = space.projected(0.3 * np.stack([np.sin(3 * y + z), np.cos(2 * x) * z, np.sin(x + 2 * y)], axis=1))

    def advance(flux: NDArray, dt: float) -> NDArray:
        return implicit_midpoint(lambda middle: rate(space, middle), flux, dt)[0]

    return start, advance, lambda flux: space.kinetic_energy(space.velocity(flux))


CASES = {
    "closed: irregular sphere": lambda: surface(shapes.random_sphere(80)),
    "bounded: square": lambda: surface(shapes.grid(6, 6)),
    "genus 3: plate with holes": lambda: surface(plate_with_holes(3)),
    "volume: 162 tetrahedra": volume,
}


def long_run(name: str, steps: int, there_and_back: int) -> list:
    """Row of the table: drift of the energy over `steps`, and what a run there and back leaves."""
    began = cpu_seconds()
    start, advance, energy = CASES[name]()
    first, state, drift = energy(start), start, 0.0
    for _ in range(steps):
        state = advance(state, STEP)
        drift = max(drift, abs(energy(state) / first - 1.0))
    moved = float(np.abs(state - start).max() / np.abs(start).max())
    state = start
    for sign in (1.0, -1.0):
        state = sign * state
        for _ in range(there_and_back):
            state = advance(state, REVERSED_STEP)
    return_error = float(np.abs(state + start).max() / np.abs(start).max())
    return [name, steps, drift, moved, there_and_back, return_error, cpu_seconds() - began]


def main(words: list[str]) -> None:
    steps, there_and_back = (*map(int, words), *(10_000, 1_000)[len(words) :])
    print(machine())
    header = ["mesh", "steps of 0.1", "energy drift", "change of the flow", "steps of 0.02 there and back",
              "departure", "s"]  # fmt: skip
    rows = [long_run(name, steps, there_and_back) for name in CASES]
    print_table("integrator energy", header, rows)


if __name__ == "__main__":
    main(sys.argv[1:])
