"""MuJoCo's flex beside shell-sim: seconds a step of a hanging cloth, and error against seconds of one motion.

The motion is that of a strip clamped at one end, which begins to bend under a weak gravity: by less than
3 % of its length, so that the truth is the sum of the modes of an Euler-Bernoulli beam; Poisson's ratio is 0.
Both programs have the same grid of right triangles, the same masses of the vertices and the same two held
rows, between which the beam begins. MuJoCo integrates by `discrete` (implicit in the elasticity of the flex;
elastic2d="both": StVK membrane and quadratic bending), shell-sim by `newmark` with StVK and hinges. The error
is the root mean square over one period of the mean height of the free end, relative to that of the truth;
beside it that of the step alone, against the same program and mesh with the smallest step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from benchmarks.common.measure import cpu_seconds, print_table
from ddgcli.io.scene_file import parse_scene
from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.mechanics.system import Motion
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account

STABLE_STEP = 0.002  # s; the longest of MuJoCo on the hanging cloth
LENGTH, WIDTH, THICKNESS, YOUNG, DENSITY = 0.1, 0.02, 1e-3, 1e8, 1.0  # m, m, m, Pa, kg/m^2
RIGIDITY = YOUNG * THICKNESS**3 / 12
GRAVITY = 8 * RIGIDITY * 0.01 / (DENSITY * LENGTH**3)  # the strip sags by a hundredth of its length
FLEX = """<mujoco><option timestep="{dt}" gravity="0 0 {g}" integrator="discrete" solver="CG"/>
<worldbody><flexcomp name="c" type="grid" dim="2" count="{count} 1" spacing="{h} {h} {h}" mass="{mass}"
  radius="0.0005" pos="0 0 1">
  <elasticity young="{young}" poisson="{poisson}" thickness="1e-3" elastic2d="both"/>
  <contact contype="0" conaffinity="0" selfcollide="none"/><pin {pin}/>
</flexcomp></worldbody></mujoco>"""
STRIP = """
[time]
step = 0.001
integrator = "newmark"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [{length}, {width}], cells = [{nx}, {ny}] }}
density = {density}
thickness = {thickness}
young = {young}
poisson = 0.0
[effects]
stretching = {{}}
bending = {{}}
gravity = {{ acceleration = [0, 0, -{g}] }}
pin = {{ vertices = {pins} }}
"""


def mujoco_step(n: int) -> float:
    """Milliseconds a step of MuJoCo on the cloth of `benchmarks.peers.shell` with n cells a side, or nan."""
    try:
        import mujoco
    except ImportError:
        return float("nan")
    text = FLEX.format(
        dt=STABLE_STEP, g=-9.81, count=f"{n + 1} {n + 1}", h=1 / n, mass=0.2, young=1e5, poisson=0.3,
        pin=f'id="0 {n}"',
    )  # fmt: skip
    try:
        compiled = mujoco.MjModel.from_xml_string(text)
    except Exception as error:
        print("MuJoCo:", str(error).split("\n")[0])
        return float("nan")
    data = mujoco.MjData(compiled)
    mujoco.mj_step(compiled, data)
    began = cpu_seconds()
    for _ in range(5):
        mujoco.mj_step(compiled, data)
    return 1e3 * (cpu_seconds() - began) / 5


def wave_numbers(count: int = 8) -> NDArray[np.float64]:
    """Solutions z of cos z cosh z = -1, the first ones."""
    begin = np.pi * np.arange(count)
    return np.array([brentq(lambda z: np.cos(z) + 1 / np.cosh(z), b, b + np.pi) for b in begin])


def frequencies() -> NDArray[np.float64]:
    """Radians a second of the modes of the clamped beam."""
    return wave_numbers() ** 2 * np.sqrt(RIGIDITY / DENSITY) / LENGTH**2


def beam_end(time: NDArray) -> NDArray[np.float64]:
    """Height in m of the free end of the beam at rest at time 0."""
    height, s = np.zeros_like(time), np.linspace(0.0, 1.0, 4001)
    for z, omega in zip(wave_numbers(), frequencies()):
        ratio = (np.sinh(z) - np.sin(z)) / (np.cosh(z) + np.cos(z))
        mode = np.cosh(z * s) - np.cos(z * s) - ratio * (np.sinh(z * s) - np.sin(z * s))
        share = np.trapezoid(mode, s) / np.trapezoid(mode**2, s)
        height -= share * mode[-1] * GRAVITY / omega**2 * (1 - np.cos(omega * time))
    return height


def period() -> float:
    """Seconds of the first mode."""
    return float(2 * np.pi / frequencies()[0])


def difference(height: NDArray, truth: NDArray) -> float:
    """Root mean square of the difference of two courses of the end, over that of the second."""
    return float(np.sqrt(np.mean((height - truth) ** 2) / np.mean(truth**2)))


def strip_cells(nx: int) -> tuple[int, float]:
    """Cells across, and their size: nx of them and a half are as long as the beam."""
    h = LENGTH / (nx + 0.5)
    return round(WIDTH / h), h


def vertex_masses(nx: int) -> NDArray[np.float64]:
    """(nx + 2, ny + 1) masses in kg of the grid's vertices, by the area of the cells around them."""
    ny, h = strip_cells(nx)
    along, across = np.ones(nx + 2), np.ones(ny + 1)
    along[[0, -1]] = across[[0, -1]] = 0.5
    return DENSITY * h * h * np.outer(along, across)


def mujoco_strip(nx: int, dt: float) -> tuple[float, NDArray]:
    """CPU seconds of one period of the strip in MuJoCo, and the heights of its end after each step."""
    import mujoco

    ny, h = strip_cells(nx)
    text = FLEX.format(
        dt=dt, g=-GRAVITY, count=f"{nx + 2} {ny + 1}", h=h, mass=vertex_masses(nx).sum(), young=YOUNG,
        poisson=0.0, pin=f'gridrange="0 0 1 {ny}"',
    )  # fmt: skip
    compiled = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(compiled)
    body, mass = compiled.flex_vertbodyid, vertex_masses(nx).ravel()
    free = np.arange(len(mass)) >= 2 * (ny + 1)
    compiled.body_mass[body[free]] = mass[free]
    mujoco.mj_setConst(compiled, data)
    mujoco.mj_resetData(compiled, data)
    mujoco.mj_forward(compiled, data)
    heights = []
    began = cpu_seconds()
    for _ in range(round(period() / dt)):
        mujoco.mj_step(compiled, data)
        heights.append(data.flexvert_xpos[-(ny + 1) :, 2].mean() - 1.0)
    return cpu_seconds() - began, np.array(heights)


def own_strip(nx: int, dt: float) -> tuple[float, NDArray]:
    """CPU seconds of one period of the strip in shell-sim, and the heights of its end after each step."""
    ny, h = strip_cells(nx)
    text = STRIP.format(
        length=(nx + 1) * h, width=ny * h, nx=nx + 1, ny=ny, density=DENSITY, thickness=THICKNESS,
        young=YOUNG, g=GRAVITY, pins=list(range(2 * (ny + 1))),
    )  # fmt: skip
    scene = resolve(parse_scene(text), KIND, {})
    context, _ = model.contexts(scene, None)["s"]
    system, x = model.make_system(scene, context, Account()), np.array(context.mesh.points)
    motion, heights = Motion(x, np.zeros_like(x), system.acceleration(x, 0 * x, dt)), []
    began = cpu_seconds()
    for _ in range(round(period() / dt)):
        motion = INTEGRATORS["newmark"].step(system, motion, dt, scene.time)
        heights.append(motion.x[-(ny + 1) :, 2].mean())
    return cpu_seconds() - began, np.array(heights)


def print_strips() -> None:
    """Table of the error against seconds."""
    rows = []
    for name, strip, steps in (
        ("MuJoCo", mujoco_strip, (1e-4, 5e-4, 2e-3, 5e-3)),
        ("shell-sim", own_strip, (5e-4, 2e-3, 5e-3, 1e-2)),
    ):
        for nx in (10, 20):
            runs = [(dt, *strip(nx, dt)) for dt in steps]
            smallest, _, finest = runs[0]
            cells = f"{nx + 1} x {strip_cells(nx)[0]}"
            for dt, seconds, height in runs:
                time = dt * np.arange(1, len(height) + 1)
                own = np.interp(time, smallest * np.arange(len(finest) + 1), np.append(0.0, finest))
                of_step = f"{100 * difference(height, own):.2f}" if dt > smallest else ""
                error = f"{100 * difference(height, beam_end(time)):.2f}"
                rows.append([name, cells, f"{1e3 * dt:g}", f"{seconds:.3f}", error, of_step])
    print_table(
        f"error against seconds: a clamped strip sags and swings for its period of {period():.3f} s",
        ["program", "cells", "step [ms]", "CPU s", "error [%]", "of the step alone [%]"],
        rows,
    )
