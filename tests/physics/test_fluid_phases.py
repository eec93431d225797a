"""The joints of a fluid: boundary values of the stream function, phases, named arrays of the state."""

import sys
from types import ModuleType

import numpy as np
import pytest

from ddgcli.algorithms.hodge.harmonic import harmonic_basis
from ddgcli.errors import SceneError
from ddgcli.io.scene_file import parse_scene
from ddgcli.mesh import shapes
from ddgcli.models.fluid import scene as fluid_scene
from ddgcli.models.fluid.model import build, contexts
from ddgcli.models.fluid.phases import PhaseRequest
from ddgcli.models.fluid.scene import EFFECTS, KIND
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.scenes.scene import resolve
from ddgcli.scenes.sections import Section
from ddgcli.simulation.account import Account
from ddgcli.simulation.effects import Effect
from ddgcli.simulation.model import Model, Observation, Schedule
from ddgcli.simulation.time_loop import evolve

NONE = np.zeros(0)


def without_harmonic(mesh, boundary_values):
    return SurfaceSpace(mesh, np.zeros((0, mesh.topology.n_edges)), boundary_values=boundary_values)


def test_boundary_values_of_a_through_flow_are_lifted():
    """phi = y on the edge of a square without vorticity: the velocity is (1, 0) everywhere."""
    mesh = shapes.grid(7, 5)
    space = without_harmonic(mesh, np.where(mesh.topology.boundary_vertex, mesh.points[:, 1], 99.0))
    phi = space.stream_function(np.zeros(space.n))
    assert np.abs(phi - mesh.points[:, 1]).max() < 1e-14
    velocity = space.face_velocity(space.side_flux(phi, NONE))
    assert np.allclose(np.abs(velocity), 1.0, rtol=0, atol=1e-13)
    area = float(space.area.sum())
    assert space.kinetic_energy(phi, NONE) == pytest.approx(0.5 * area, rel=1e-13)


def test_a_change_of_vorticity_does_not_see_the_boundary_values():
    mesh = shapes.cylinder(20, 8)
    values = np.where(mesh.points[:, 2] > mesh.points[:, 2].mean(), 2.0, -1.0)
    lifted, walls = without_harmonic(mesh, values), without_harmonic(mesh, None)
    omega = np.sin(3 * mesh.points[:, 0]) * lifted.mass
    change = lifted.stream_function(omega) - lifted.stream_function(0 * omega)
    assert np.allclose(change, walls.stream_function(omega), rtol=0, atol=1e-13)
    assert np.array_equal(lifted.stream_function_change(omega), walls.stream_function(omega))
    rim = mesh.topology.boundary_vertex
    assert np.array_equal(lifted.stream_function(omega)[rim], values[rim])


def test_energy_of_lifted_and_harmonic_flow_is_that_of_the_faces():
    mesh = shapes.cylinder(20, 8)
    values = np.where(mesh.points[:, 2] > mesh.points[:, 2].mean(), 2.0, -1.0)
    space = SurfaceSpace(mesh, harmonic_basis(mesh, "normal").forms, boundary_values=values)
    omega, c = np.sin(3 * mesh.points[:, 0]) * space.mass, np.array([0.7])
    phi = space.stream_function(omega)
    faces = 0.5 * np.sum(space.area * np.abs(space.face_velocity(space.side_flux(phi, c))) ** 2)
    assert space.kinetic_energy(phi, c) == pytest.approx(faces, rel=1e-12)


class Spin(Section):
    """A test effect: vorticity z is added at rate 1, and its sum of seconds is kept."""


class SpinPhase:
    effect, step_stage, order = "spin", "source", 2

    def __init__(self, setting):
        self.rate = setting.context.points[:, 2] * setting.space.mass

    def start(self):
        return {"spun": np.zeros(1)}

    def advance(self, step, state):
        vorticity = state["vorticity"] + step.dt * self.rate
        return state.replaced(vorticity=vorticity, spun=state["spun"] + step.dt)

    def observed(self, state):
        return Observation(None, {}, {"spun": float(state["spun"][0])})


def models_of(text):
    scene, account = resolve(parse_scene(text), KIND, {}), Account()
    fluids = {name: context for name, (context, _) in contexts(scene, None, None).items()}
    return build(scene, fluids, account), scene.schedule(), account


SCENE = """[time]
duration = 0.1
step = 0.02
[[object]]
name = "f"
role = "fluid"
sphere = { subdivisions = 2 }
[effects]
spin = {}
dye = { amount = "x" }
"""


@pytest.fixture
def spin(monkeypatch):
    """The effect, as one module and one line of the table add it."""
    module = ModuleType("spin_of_a_test")
    module.EFFECT = Effect("spin", Spin, lambda p, c: [PhaseRequest(SpinPhase)], "nothing", ("fluid",))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setitem(EFFECTS.entries, "spin", (module.__name__, "A test effect."))


def test_an_effect_is_one_module_and_one_line(spin):
    """It acts on the flow, keeps its own array in the checkpoint, shows a scalar and has its time booked."""
    built, schedule, account = models_of(SCENE)
    snapshots = list(evolve({n: m.model() for n, m in built.items()}, schedule, account))
    last, space = snapshots[-1], built["f"].space
    assert last.observations["f"].scalar["spun"] == pytest.approx(0.1, rel=1e-12)
    z = built["f"].context.points[:, 2]
    assert np.allclose(last.observations["f"].vertex["vorticity"], 0.1 * z, atol=1e-4)
    assert set(last.checkpoint) == {
        "f/clock",
        "f/stopped",
        "f/vorticity",
        "f/losses",
        "f/loss_sizes",
        "f/supplies",
        "f/spun",
        "f/dye",
    }
    assert account.calls["spin"] == 10 and account.calls["dye"] == 5
    again = {n: m.model() for n, m in built.items()}
    resumed = list(evolve(again, schedule, Account(), resume=(2, snapshots[2].checkpoint)))
    for name, values in last.checkpoint.items():
        assert np.array_equal(resumed[-1].checkpoint[name], values), name
    assert space.dimension == 2


def test_an_integrator_of_another_dimension_is_refused(monkeypatch):
    monkeypatch.setitem(fluid_scene.TRANSPORTS, "conservative", {3: "nowhere"})
    with pytest.raises(SceneError, match="conservative does not exist in 2-D"):
        models_of(SCENE.replace("spin = {}\n", ""))


def test_adaptive_steps_that_frames_shorten_are_counted():
    """An exact scheme takes steps twice as long as the last, unless a frame ends them."""
    model = Model(
        np.zeros(1), lambda state, time, dt: state + dt, lambda state: Observation(None),
        lambda s: {"s": s}, lambda a: a["s"], distance=lambda a, b: 0.0, order=2,
    )  # fmt: skip

    def counts(n_frames, resume=None):
        schedule = Schedule(8.0 / n_frames, n_frames, tolerance=1e-3, first_dt=1.0)
        return list(evolve({"m": model}, schedule, Account(), resume))

    by_frames = counts(8)  # 1, then 2, 2, ... are allowed; every one is cut to 1
    assert [s.frame_limited_steps for s in by_frames] == [0, 0, *range(2, 16, 2)]
    assert [s.steps for s in by_frames] == [*range(0, 18, 2)]
    resumed = counts(8, (3, by_frames[3].checkpoint))
    assert [s.frame_limited_steps for s in resumed] == [s.frame_limited_steps for s in by_frames[4:]]
    assert counts(1)[-1].frame_limited_steps <= 2  # the last step of the run alone
