"""Seconds a step of `fluid-sim` by integrator and effect, beside the feasibility figures of a survey.

The survey's figures were taken on another machine with CHOLMOD; they are scaled here by the time of one
Poisson factorisation, measured in the same run. Run: python -m benchmarks.peers.fluid [FACES...]
"""

from __future__ import annotations

import sys
from functools import partial

import numpy as np

from benchmarks.common.measure import interleaved, machine, print_commands, print_table
from benchmarks.fluids.steps import CELLS, FACES, HEADER
from benchmarks.fluids.steps import rows as steps
from ddgcli.linalg.factor import Factor
from ddgcli.mesh import shapes
from ddgcli.models.fluid.circulation import CirculationAdvection
from ddgcli.models.fluid.conservative import RK4_LIMIT, StageRates, advection_rate, midpoint, runge_kutta
from ddgcli.models.fluid.diffusion import CURVATURE_SHARE, VelocityDiffusion, VorticityDiffusion
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.models.fluid.tracer import SurfaceTracer
from ddgcli.operators.laplacian import lumped_mass, stiffness

# faces -> seconds of the survey: factorisation, P1 Jacobian RK4 step, backtraced step at CFL about 1
SURVEY = {20_000: (0.031, 0.0037, 0.034), 80_000: (0.136, 0.035, 0.143), 50_000: (0.080, 0.019, 0.090)}
SPHERES = {3_000: 1_502, 12_000: 6_002, 50_000: 25_002}


def carried(tracer: SurfaceTracer, space: SurfaceSpace, omega: np.ndarray, dt: float) -> np.ndarray:
    """Dye after a step."""
    return tracer.advance(omega, space.side_flux(space.stream_function(omega), np.zeros(0)), dt)


def rows(faces: int) -> list[list]:
    mesh = shapes.random_sphere(SPHERES[faces])
    space = SurfaceSpace(mesh, np.zeros((0, mesh.topology.n_edges)))
    x, y, z = mesh.points.T
    omega = (5 * z + np.sin(3 * x) * y) * space.mass
    omega -= space.mass * omega.sum() / space.mass.sum()
    none = np.zeros(0)
    matrix = (stiffness(mesh) + lumped_mass(mesh)).tocsc()
    speed = np.abs(space.face_velocity(space.side_flux(space.stream_function(omega), none)))
    dt = float(np.median(np.sqrt(space.area) / np.maximum(speed, 1e-12)))
    # a longer step would be refused before it is made
    stable = 0.9 * RK4_LIMIT / advection_rate(space, space.side_flux(space.stream_function(omega), none))
    carry = CirculationAdvection(space)
    calls = {
        "factorisation (once)": lambda: Factor(matrix),
        "set-up of circulation (once)": lambda: CirculationAdvection(space),
        "conservative, rk4": lambda: runge_kutta(StageRates(space, False), omega, none, stable),
        "conservative, midpoint": lambda: midpoint(StageRates(space, False), omega, none, stable),
        "circulation, CFL 1": lambda: carry.step(omega, none, dt, False),
        "circulation, CFL 5": lambda: carry.step(omega, none, 5 * dt, False),
        "dye": partial(carried, SurfaceTracer(space, carry.transport), space, omega, dt),
    }
    for kind in CURVATURE_SHARE:
        decay = VelocityDiffusion(space, 1e-3, kind)
        calls[f"viscosity, {kind}, of the velocity"] = partial(decay.step, omega, none, dt)
    calls["viscosity, hodge"] = partial(VorticityDiffusion(space, 1e-3).step, omega, none, dt)
    times = interleaved(calls, repeat=3)
    factor = times["factorisation (once)"].median
    base = _survey(mesh.n_faces)
    table_rows = []
    for name, timing in times.items():
        column = {"conservative, rk4": 1, "circulation, CFL 1": 2}.get(name)
        scaled = base[column] / base[0] * factor if column else None
        table_rows.append(
            [mesh.n_faces, name, timing.median, scaled or "-", timing.median / scaled if scaled else "-"]
        )
    return table_rows


def _survey(faces: int) -> tuple[float, ...]:
    """The survey's figures at a number of faces, interpolated between powers."""
    known = sorted(SURVEY)
    logs = np.log(known)
    return tuple(
        float(np.exp(np.interp(np.log(faces), logs, np.log([SURVEY[k][column] for k in known]))))
        * (faces / known[0] if faces < known[0] else 1.0)
        for column in range(3)
    )


# whole commands, timed as a user starts them
COMMANDS = ("fluid-sim sphere.ply --flow vortex-pair --steps 20 --dt 0.05 -o out.vtkhdf",)


if __name__ == "__main__":
    print(machine())
    sizes = [int(word) for word in sys.argv[1:]] or list(SPHERES)
    table = [row for faces in sizes for row in rows(faces)]
    print_table(
        "fluid-sim: seconds a step, irregular sphere, one thread",
        ["faces", "part", "seconds", "survey, scaled", "ours / survey"],
        table,
    )
    print_table("fluid-sim: steps at CFL 1", HEADER, steps([*FACES], [*CELLS]))
    print_commands(*COMMANDS)
