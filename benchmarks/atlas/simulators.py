"""Known truths of the simulators, for the atlas: sequences of meshes or of steps (the table is at the end).

Every trial is a problem whose candidates run as a user would run them: scenes through the one time loop. In
the mesh classes named `steps` the mesh is fixed and the step decreases; h of their rows is the step.
The cantilever on `right` and `alternating` grids tuned a default: the constant of the hinges. The other
truths tuned none.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.atlas.trial import Case, Trial, known_truth, last_frame
from benchmarks.atlas.willmore import WILLMORE
from benchmarks.common.mesh_classes import SPHERES, strips
from benchmarks.common.scenes import CANTILEVER, FREE_SCENE, RIGIDITY
from ddgcli.io.scene_file import parse_scene
from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid import model as fluid_model
from ddgcli.models.fluid.scene import KIND as FLUID
from ddgcli.models.shell import model as shell_model
from ddgcli.models.shell.scene import KIND as SHELL
from ddgcli.operators.laplacian import lumped_vertex_area
from ddgcli.scenes.scene import resolve
from ddgcli.scenes.shapes import Grid, grid_mesh, periodic_grid
from ddgcli.simulation.account import Account
from ddgcli.tradeoff.candidates import Candidate, relative_to_rms

Pattern = Literal["right", "alternating", "cross"]

# --- fluid-sim ---

FLUID_SCENE = """
[time]
{integrator}
step = {step}
duration = {duration}
frame_every = {duration}
[[object]]
name = "s"
role = "fluid"
{shape}
[effects]
initial = {{ vorticity = "{vorticity}" }}
{effects}
"""
HAURWITZ = "2*z + 2*(x**2 - y**2)*z"  # rigid rotation and a mode l = 3, m = 2
HAURWITZ_SPEED, HAURWITZ_SPAN = 5 / 6, 0.4
GREEN, NU, GREEN_SPAN = "2*sin(x)*sin(y)", 0.05, 1.0
CIRCLE = 6.283185307179586
# line in the plot -> values of the scene's [time]
FLUIDS = {
    "conservative": 'integrator = "conservative"',
    "energy": 'integrator = "energy"',
    "circulation": 'integrator = "circulation"',
    "covector": 'integrator = "covector"',
}


def _fluid(name: str, mesh: TriangleMesh | None, **words: Any) -> Callable[[], Any]:
    """A fluid scene ready to run."""
    text = FLUID_SCENE.format(**({"effects": "", "shape": 'mesh = "given"'} | words), integrator=FLUIDS[name])

    def prepared() -> Any:
        scene = resolve(parse_scene(text), FLUID, {})
        account = Account()
        contexts = {
            n: c for n, (c, _) in fluid_model.contexts(scene, lambda _: _mesh_source(mesh), np.load).items()
        }
        built = fluid_model.build(scene, contexts, account)
        return {n: fluid.model() for n, fluid in built.items()}, scene.schedule(), account

    return prepared


def _mesh_source(mesh: TriangleMesh | None) -> Any:
    """What reading the scene's mesh file would give."""
    return SimpleNamespace(mesh=mesh, vertex={}, face={}, sha256="", notes=())


def _haurwitz(sphere: Callable[[int], TriangleMesh], level: int) -> Trial:
    """Angular speed of the pattern."""
    mesh = sphere(level)
    x, y, z = mesh.points.T
    mass = np.asarray(lumped_vertex_area(mesh))

    def speed(ready: Any) -> NDArray[np.float64]:
        omega = last_frame(ready).vertex["vorticity"] * mass
        turned = np.arctan2(omega @ (2 * x * y * z), omega @ ((x**2 - y**2) * z))
        return np.array([turned / 2 / HAURWITZ_SPAN])

    candidates = [
        Candidate(
            name,
            {"dt": step},
            _fluid(name, mesh, step=step, duration=HAURWITZ_SPAN, vorticity=HAURWITZ),
            speed,
            {"integrator": name, "dt": f"{step:g}"},
            _fluid_work(name, mesh.n_faces, HAURWITZ_SPAN / step),
        )
        for name in FLUIDS
        for step in (0.1, 0.025)
    ]
    return known_truth(mesh.n_faces, float(mesh.side_length.mean()), HAURWITZ_SPEED, candidates)


def _fluid_work(name: str, faces: int, steps: float) -> float:
    return steps * (
        2e-3 + faces * {"conservative": 1e-6, "circulation": 1e-5, "covector": 2e-5}.get(name, 5e-6)
    )


def _taylor_green(pattern: Pattern, level: int) -> Trial:
    """Vorticity at the end, at every vertex."""
    n = 8 * 2**level
    mesh = periodic_grid(Grid(size=[CIRCLE, CIRCLE], cells=[n, n], periodic="xy", pattern=pattern))
    cells = f'size = [{CIRCLE}, {CIRCLE}], cells = [{n}, {n}], periodic = "xy", pattern = "{pattern}"'
    words = {
        "duration": GREEN_SPAN,
        "vorticity": GREEN,
        "shape": f"grid = {{ {cells} }}",
        "effects": f"viscosity = {{ nu = {NU} }}\nharmonic = {{}}",
    }
    candidates = [
        Candidate(
            name,
            {"dt": step},
            _fluid(name, None, step=step, **words),
            lambda ready: last_frame(ready).vertex["vorticity"],
            {"integrator": name, "dt": f"{step:g}"},
            _fluid_work(name, mesh.n_faces, GREEN_SPAN / step),
        )
        for name in FLUIDS
        for step in (0.2, 0.05)
    ]
    assert mesh.points is not None
    x, y = mesh.points[:, :2].T
    truth = np.exp(-2 * NU * GREEN_SPAN) * 2 * np.sin(x) * np.sin(y)
    return known_truth(mesh.n_faces, CIRCLE / n, truth, candidates, relative_to_rms)


STEPS_SPAN = 0.8


@lru_cache
def _limit(name: str, level: int = 7) -> NDArray[np.float64]:
    """A scheme's own limit of small steps on 320 faces (second-order schemes extrapolated)."""
    ends = [
        last_frame(_by_step_setup(name, STEPS_SPAN / 2**k)()).vertex["vorticity"] for k in (level, level + 1)
    ]
    return ends[1] if name == "conservative" else (4 * ends[1] - ends[0]) / 3


def _by_step_setup(name: str, step: float) -> Callable[[], Any]:
    vorticity = "sin(3*x + 1)*cos(2*z + 1) + y + x*z"
    return _fluid(name, shapes.icosphere(2), step=step, duration=STEPS_SPAN, vorticity=vorticity)


def _fluid_by_step(level: int) -> Trial:
    """Vorticity against the same scheme's limit of small steps: the error in time alone."""
    step = STEPS_SPAN / 2 ** (level + 2)
    scale = _limit("conservative")

    def end(name: str, ready: Any) -> NDArray[np.float64]:
        return scale + last_frame(ready).vertex["vorticity"] - _limit(name)

    candidates = [
        Candidate(
            name,
            {},
            _by_step_setup(name, step),
            partial(end, name),
            {"integrator": name, "dt": f"{step:g}"},
            _fluid_work(name, 320, STEPS_SPAN / step),
        )
        for name in FLUIDS
        if name != "covector"  # every step interpolates: it has no limit of small steps on one mesh
    ]
    return known_truth(320, step, scale, candidates, relative_to_rms)


# --- shell-sim ---

ELASTICA = {2: 0.238507, 10: 0.700200}  # weight length^3 / rigidity -> drop of the tip over length


def _shell(text: str, mesh: TriangleMesh | None = None) -> Any:
    scene = resolve(parse_scene(text), SHELL, {})
    account = Account()
    contexts = {n: c for n, (c, _) in shell_model.contexts(scene, lambda _: _mesh_source(mesh)).items()}
    return shell_model.build(scene, contexts, account), scene.schedule(), account


def _cantilever(weight: int, pattern: Pattern, level: int) -> Trial:
    n, across = 10 * 2**level, 2 * 2**level
    return _cantilever_trial(weight, grid_mesh(Grid(size=[1, 0.2], cells=[n, across], pattern=pattern)), n)


def _cantilever_on(weight: int, strip: Callable[[int], TriangleMesh], level: int) -> Trial:
    return _cantilever_trial(weight, strip(level), 10 * 2**level)


def _cantilever_trial(weight: int, rest: TriangleMesh, n: int) -> Trial:
    """Drop of the tip under its own weight; the first of n columns of cells is clamped."""
    tip = rest.points[:, 0] > 1 - 1e-9

    def drop(ready: Any) -> NDArray[np.float64]:
        return np.array([-last_frame(ready).points[tip, 2].mean()])

    def prepared(model: str) -> Any:
        density, shape = weight * RIGIDITY / 9.81, 'mesh = "given"'
        text = CANTILEVER.format(density=density, shape=shape, model=model, clamp=1.01 / n)
        return _shell(text, rest)

    candidates = [
        Candidate(
            model,
            {},
            partial(prepared, model),
            drop,
            {"effect": f"'bending model={model}'"},
            0.02 + 4e-4 * rest.n_faces,
        )
        for model in ("hinge", "quadratic")
    ]
    return known_truth(rest.n_faces, 1 / n, ELASTICA[weight], candidates)


def _free(integrator: str, step: float) -> Any:
    return _shell(FREE_SCENE.format(integrator=integrator, step=step, duration=0.2))


def _free_end(integrator: str, step: float) -> NDArray[np.float64]:
    return last_frame(_free(integrator, step)).vertex["velocity"].ravel()


@lru_cache
def _free_truth() -> NDArray[np.float64]:
    return _free_end("verlet", 0.2 / 4096)


def _free_by_step(level: int) -> Trial:
    """Velocities of a spinning, ringing sheet against verlet with a small step."""
    step = 0.2 / 2 ** (level + 6)
    candidates = [
        Candidate(
            name,
            {},
            partial(_free, name, step),
            lambda ready: last_frame(ready).vertex["velocity"].ravel(),
            {"integrator": name, "dt": f"{step:g}"},
            0.2 / step * 5e-4,
        )
        for name in INTEGRATORS
        if name != "static"
    ]
    return known_truth(18, step, _free_truth(), candidates, relative_to_rms)


# --- the table ---

SIMULATIONS: dict[str, list[Case]] = {
    "willmore-flow": WILLMORE,
    "fluid-sim": [
        *(Case("Rossby-Haurwitz speed", mesh_class, partial(_haurwitz, sphere))
          for mesh_class, sphere in SPHERES.items()),
        Case("Taylor-Green decay", "alternating", partial(_taylor_green, "alternating")),
        Case("Taylor-Green decay", "right", partial(_taylor_green, "right")),
        Case("limit of small steps", "steps", _fluid_by_step),
    ],
    "shell-sim": [
        *(Case(f"cantilever, weight {weight}", pattern, partial(_cantilever, weight, pattern))
          for weight in (2, 10) for pattern in ("alternating", "right", "cross")),
        *(Case("cantilever, weight 2", mesh_class, partial(_cantilever_on, 2, strip))
          for mesh_class, strip in strips().items()),
        Case("verlet with a small step", "steps", _free_by_step),
    ],
}  # fmt: skip
