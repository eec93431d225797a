"""Order, invariants and accounting of the time schemes; parametrised over the table itself."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from time import process_time

import numpy as np
import pytest

from benchmarks.common.scenes import FREE_SCENE
from ddgcli.errors import ParameterError, SceneError, SolveError
from ddgcli.io.scene_file import parse_scene
from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve
from tests.simulate import HANGING_CLOTH, scalar, shell_run

EXPLICIT_INTEGRATORS = ("verlet", "symplectic-euler", "avi")
DYNAMIC = [name for name in INTEGRATORS if name != "static"]


def end(integrator, step, duration=0.2):
    """Last observation of a free shell."""
    run, _, _ = shell_run(FREE_SCENE.format(integrator=integrator, step=step, duration=duration))
    return run[-1].observations["s"]


@cache
def finest_end():
    """The same with steps so short that their error is below 2 % of that of the steps compared."""
    return end("verlet", 0.2 / 1024)


def assert_order(name):
    # velocities: from a start at rest the positions of symplectic Euler gain an order (conjugate to Verlet)
    truth = finest_end().vertex["velocity"]
    coarse = 128 if name in ("implicit-euler", "bdf2") else 64  # their next terms of the error are larger
    steps = [0.2 / coarse, 0.1 / coarse]
    errors = [np.abs(end(name, h).vertex["velocity"] - truth).max() for h in steps]
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates[-1] == pytest.approx(INTEGRATORS[name].order, abs=0.15)
    assert errors[-1] < (0.05 if INTEGRATORS[name].order == 2 else 0.5) * np.abs(truth).max()


@pytest.mark.parametrize("name", DYNAMIC)
def test_integrator_has_its_order(name):
    assert_order(name)


def test_steps_that_rescue_are_of_second_order_and_keep_the_momentum(monkeypatch):
    """All of them taken by the composite scheme."""
    composite = INTEGRATORS["newmark"].rescue
    monkeypatch.setitem(INTEGRATORS, "newmark", replace(INTEGRATORS["newmark"], step=composite))
    assert_order("newmark")
    # a velocity is a quotient of positions below 1 m, rounded to 8 eps / dt each step; 250 add up at random
    rounding = 8 * np.finfo(float).eps / 2e-3 * np.sqrt(250)
    assert_free_shell_keeps_its_momenta("newmark", rounding, None)


@pytest.mark.parametrize(
    "name, step",
    [
        ("newmark", 1e-2),
        pytest.param("implicit-midpoint", 4e-3, marks=pytest.mark.slow),
        ("implicit-midpoint", 1e-2),
    ],
)
def test_no_step_is_so_long_that_it_gives_energy(name, step):
    """A stiff leaf that tumbles, its waves far faster than the step: without the watch over the balance the
    energy grows by 39 %, by 43 % and without end."""
    leaf = (Path(__file__).parents[2] / "sample_scenes" / "leaf.toml").read_text()
    text = leaf.replace('"implicit-midpoint"', f'"{name}"').replace("step = 2e-3", f"step = {step}")
    run, contexts, _ = shell_run(text)
    energy = np.array(scalar(run, "energy", "leaf"))
    assert energy.max() <= 1.01 * energy[0] and energy.min() > 0.99 * energy[0]
    p = np.array(scalar(run, "momentum", "leaf"))
    assert np.abs(p - p[0]).max() <= 1e-12 * contexts["leaf"].mass.sum()
    events = [event for snapshot in run for event in snapshot.events]
    assert {event.kind for event in events} == {"energy rises"}
    assert all(event.value > 0.01 for event in events)


@pytest.mark.parametrize("name", ["newmark", "implicit-midpoint"])
def test_short_steps_do_not_add_up_what_the_solver_leaves(name):
    """Two hundred steps far shorter than the motion needs: as near to Verlet as their order predicts."""
    apart = end(name, 1e-5, 2e-3).vertex["velocity"] - end("verlet", 1e-5, 2e-3).vertex["velocity"]
    assert np.abs(apart).max() < 2e-9


def assert_free_shell_keeps_its_momenta(name, linear, angular):
    text = FREE_SCENE.format(integrator=name, step=2e-3, duration=0.5)
    run, contexts, _ = shell_run(text, frame_every=0.05)
    mass = contexts["s"].mass.sum()
    p = np.array(scalar(run, "momentum"))
    assert len(p) > 10 and np.abs(p[0]).max() > 0.1 * mass
    assert np.abs(p - p[0]).max() <= linear * mass
    if angular is not None:
        spin = np.array(scalar(run, "angular_momentum"))
        assert np.abs(spin - spin[0]).max() <= angular * mass


@pytest.mark.parametrize("name, linear, angular", [
    ("verlet", 1e-12, 1e-12),
    ("symplectic-euler", 1e-12, 1e-12),
    ("avi", 1e-12, 1e-12),
    ("implicit-midpoint", 1e-12, 1e-9),
    ("newmark", 1e-12, None),
    ("implicit-euler", 1e-12, None),
])  # fmt: skip
def test_free_shell_keeps_its_momenta(name, linear, angular):
    assert_free_shell_keeps_its_momenta(name, linear, angular)


@pytest.mark.parametrize("name", ["verlet", "newmark", "implicit-midpoint"])
def test_energy_error_is_of_second_order(name):
    worst = []
    for step in (2e-3, 1e-3):
        run, _, _ = shell_run(FREE_SCENE.format(integrator=name, step=step, duration=0.2), frame_every=0.004)
        energy = np.array(scalar(run, "energy"))
        worst.append(np.abs(energy - energy[0]).max() / energy[0])
    assert np.log2(worst[0] / worst[1]) > 1.6
    assert worst[1] < 2e-3


@pytest.mark.parametrize("name", INTEGRATORS)
def test_rest_stays_at_rest(name):
    text = FREE_SCENE.format(integrator=name, step=1e-3, duration=0.02)
    text = text.replace("grid = { size = [1, 1], cells = [3, 3] }", "sphere = { subdivisions = 1 }")
    text = text.replace("velocity = [0.3, 0.1, -0.2]", "").replace("angular_[", "[")
    text = "\n".join(line for line in text.split("\n") if not line.startswith("angular"))
    run, contexts, _ = shell_run(text)
    moved = run[-1].observations["s"].points - contexts["s"].mesh.points
    assert np.abs(moved).max() <= 1e-14


def test_free_fall_stores_no_elastic_energy():
    text = (
        FREE_SCENE.format(integrator="newmark", step=1e-2, duration=1.0)
        + "gravity = { acceleration = [0, 0, -10] }\n"
    )
    text = "\n".join(line for line in text.split("\n") if "velocity" not in line)
    run, contexts, _ = shell_run(text)
    fall = run[-1].observations["s"].points - contexts["s"].mesh.points
    assert np.allclose(fall, [0, 0, -5], atol=1e-10)
    assert abs(scalar(run, "energy_stretching")[-1]) < 1e-18
    assert abs(scalar(run, "energy_bending")[-1]) < 1e-18


FLOOR = """
[[object]]
name = "floor"
role = "obstacle"
plane = { point = [0, 0, -0.005] }
[effects]
contact = { pairs = [["s", "floor"]], friction = 0.3, gap = 0.01 }
damping = { mass = 1, stiffness = 1e-6 }
pin = { vertices = [0, 14, 210], axes = "xyz" }
"""


def booked_share(integrator="newmark", adaptive=False):
    """(share of the loop's processor time that the account covers, account, seconds), 400 faces."""
    # one step; below the stability limit, explicit steps are divided by 74
    step = 1e-3 if integrator in EXPLICIT_INTEGRATORS else 1e-2
    text = FREE_SCENE.format(integrator=integrator, step=step, duration=step)
    text = text.replace("[3, 3]", "[14, 14]")
    if adaptive:
        text = text.replace("step = 0.01", "tolerance = 1e-3")
    text = text.replace("[effects]", FLOOR)
    scene = resolve(parse_scene(text + "gravity = {}\n"), KIND, {})
    account = Account()
    contexts = {name: context for name, (context, _) in model.contexts(scene, None).items()}
    models = model.build(scene, contexts, account)
    account.restore({})
    began = process_time()
    list(evolve(models, scene.schedule(), account))
    clock = process_time() - began
    return sum(account.seconds.values()) / clock, account, clock


@pytest.mark.parametrize("integrator, adaptive", [*((n, False) for n in INTEGRATORS), ("newmark", True)])
def test_parts_account_for_the_time(integrator, adaptive, processor_clock):
    """Effects, solver, integrator and output add up to the loop's own time, within 5 %."""
    share, account, _ = booked_share(integrator, adaptive)
    solver = set() if integrator in EXPLICIT_INTEGRATORS else {"solver"}
    acting = {"stretching", "bending", "gravity", "contact"}
    if integrator != "static":  # nothing moves in an equilibrium
        acting.add("damping")
    assert set(account.seconds) == {*acting, *solver, "integrator", "output"}
    assert 0.95 <= share <= 1.0


def test_time_that_no_entry_books_is_missing_from_the_sum(monkeypatch, processor_clock):
    """Work in the loop outside every timer is missing from the sum; work in an effect is that effect's."""
    from ddgcli.mechanics.terms import DeadLoad
    from ddgcli.simulation.model import Schedule

    extra_seconds, gradient, step_of_frame = [0.0], DeadLoad.gradient, Schedule.step_of_frame

    def work():
        began = process_time()
        while process_time() < began + 0.001:
            pass
        extra_seconds[0] += process_time() - began

    with monkeypatch.context() as patch:
        patch.setattr(Schedule, "step_of_frame", lambda self, k: (work(), step_of_frame(self, k))[1])
        share, _, clock = booked_share()
        assert (1 - share) * clock >= 0.95 * extra_seconds[0] > 0
    extra_seconds[0] = 0.0
    monkeypatch.setattr(DeadLoad, "gradient", lambda self, x: (work(), gradient(self, x))[1])
    share, account, _ = booked_share()
    assert share >= 0.95
    assert extra_seconds[0] > 0.01 and account.seconds["gravity"] >= 0.9 * extra_seconds[0]


@pytest.mark.parametrize("integrator, adaptive", [*((n, False) for n in INTEGRATORS), ("newmark", True)])
def test_an_object_that_is_not_coupled_changes_no_bit(integrator, adaptive):
    """Not even one that turns fast, lies on a floor of its own and makes steps fail."""
    one = FREE_SCENE.format(integrator=integrator, step=5e-3, duration=0.02 if adaptive else 0.05)
    one += "gravity = {}\n[[effects.pin]]\nobject = 's'\nvertices = [0, 3]\n"
    if adaptive:
        one = one.replace("step = 0.005", "tolerance = 1e-3")
    other = """
[[object]]
name = "other"
role = "shell"
grid = { size = [2, 1], cells = [4, 3] }
position = [0, 0, 0.1]
material = "rubber"
thickness = "1 cm"
angular_velocity = [3, 4, 0]
velocity = [0, 0, -9]
[[object]]
name = "floor"
role = "obstacle"
plane = {}
"""
    both = one.replace("[effects]", other + "[effects]") + (
        "[[effects.pin]]\nobject = 'other'\nvertices = [0, 1, 7]\n"
        "[effects.contact]\npairs = [['other', 'floor']]\n"
    )
    alone, _, _ = shell_run(one, frame_every=0.01)
    together, _, _ = shell_run(both, frame_every=0.01)
    assert len(alone) == len(together) > 1
    for before, after in zip(alone, together):
        a, b = before.observations["s"], after.observations["s"]
        assert before.time == after.time and np.array_equal(a.points, b.points)
        assert all(np.array_equal(a.vertex[name], b.vertex[name]) for name in a.vertex)
        assert set(a.scalar) == set(b.scalar) and all(
            np.array_equal(a.scalar[k], b.scalar[k]) for k in a.scalar
        )


@pytest.mark.parametrize("limit, later", [(0.011, 0.011), (0.011, 1.0), (0.2, 0.005)])
def test_what_failed_is_not_tried_at_every_turn(limit, later):
    """Steps of 1 s of a model that takes parts up to a limit, which changes half-way: the whole time is
    marched, no part is much shorter than it must be, and few are tried in vain."""
    from ddgcli.simulation.model import Model, Observation, Schedule, StepRejected

    def advance(state, time, dt):
        if dt > (limit if time < 5 else later):
            raise StepRejected("too long")
        assert time == pytest.approx(state.sum(), abs=1e-9)
        return np.append(state, dt)

    shown = Observation(None)
    model = Model(np.zeros(0), advance, lambda state: shown, lambda s: {"s": s}, lambda a: a["s"])
    snapshots = list(evolve({"m": model}, Schedule(1.0, 10), Account()))
    step_sizes = snapshots[-1].checkpoint["m/s"]
    n_attempts = sum(len(snapshot.events) for snapshot in snapshots)
    assert step_sizes.sum() == pytest.approx(10)
    when = np.cumsum(step_sizes) - step_sizes
    for some_sizes, bound in ((step_sizes[when < 5], limit), (step_sizes[when >= 7], later)):
        assert np.median(some_sizes) > bound / 4 and some_sizes.max() <= bound
    assert n_attempts < 0.35 * len(step_sizes) + 40


@pytest.mark.parametrize(
    "limit, on_failure, message",
    [
        (4e-4, "shrink", "takes about (2048|4096) shorter ones"),
        (2.2e-3, "shrink", r"\d+ attempts have failed in \d+ steps"),
        (3e-3, "stop", "step of 1 s rejected"),
    ],
)
def test_a_run_whose_steps_need_many_parts_ends_early_and_names_a_step_that_works(limit, on_failure, message):
    """The step divides the one of the run: the time between frames remains a whole number of steps."""
    from ddgcli.simulation.model import Model, Observation, Schedule, StepRejected

    n_parts = 0

    def advance(state, time, dt):
        nonlocal n_parts
        if dt > limit:
            raise StepRejected("too long")
        n_parts += 1
        return state + dt

    shown = Observation(None)
    model = Model(np.zeros(1), advance, lambda state: shown, lambda s: {"s": s}, lambda a: a["s"])
    with pytest.raises(SolveError, match=message) as refusal:
        list(evolve({"m": model}, Schedule(1.0, 100, on_failure=on_failure), Account()))
    assert n_parts <= (64 if limit < 1e-3 else 512 * 100)
    step = float(re.search(r"make the step (\S+) s", str(refusal.value))[1])
    assert step > limit / 5 and 1 / step == pytest.approx(round(1 / step), abs=1e-9)
    end = list(evolve({"m": model}, Schedule(step, 2000), Account()))[-1]
    assert end.checkpoint["m/s"] == pytest.approx(2000 * step) and not end.events


def test_a_failed_adaptive_step_names_a_step_that_works():
    """A quarter of the step, which had not been tried, was advised."""
    from ddgcli.simulation.model import Model, Observation, Schedule, StepRejected

    def advance(state, time, dt):
        if dt > 3e-3:
            raise StepRejected("too long")
        return state + dt

    shown = Observation(None)
    model = Model(
        np.zeros(1), advance, lambda state: shown, lambda s: {"s": s}, lambda a: a["s"],
        distance=lambda a, b: float(np.abs(a - b).max()), order=1,
    )  # fmt: skip
    with pytest.raises(SolveError, match="step of 1 s rejected") as refusal:
        list(evolve({"m": model}, Schedule(1.0, 2, tolerance=0.1, on_failure="stop"), Account()))
    step = float(re.search(r"make the step (\S+) s", str(refusal.value))[1])
    assert 6e-4 < step <= 3e-3


def test_steps_grow_where_the_error_does_not_hang_on_their_length():
    """Interpolation loses as much in any step: just below the tolerance, steps stayed as short as ever."""
    from ddgcli.simulation.model import Model, Observation, Schedule

    shown = Observation(None)
    model = Model(
        np.zeros(1), lambda state, time, dt: state + dt, lambda state: shown,
        lambda s: {"s": s}, lambda a: a["s"], distance=lambda a, b: 0.73e-3, order=2,
    )  # fmt: skip
    ends = list(evolve({"m": model}, Schedule(1.0, 1, tolerance=1e-3, first_dt=1e-4), Account()))
    assert ends[-1].checkpoint["m/s"][0] == pytest.approx(1.0, rel=1e-12)
    assert ends[-1].steps <= 100  # 20,000 of the first length


def test_a_step_whose_error_does_not_fall_with_its_length_ends_the_run():
    """A jump at t > 0 of a size that no step changes: no tolerance below it can be met."""
    from ddgcli.simulation.model import Model, Observation, Schedule

    def advance(state, time, dt):
        return state + dt + (time > 0)

    shown = Observation(None)
    model = Model(
        np.zeros(1), advance, lambda state: shown, lambda s: {"s": s}, lambda a: a["s"],
        distance=lambda a, b: float(np.abs(a - b).max()), order=1,
    )  # fmt: skip
    with pytest.raises(SolveError, match="stays at 1 however short .* instead of the tolerance 0.01"):
        list(evolve({"m": model}, Schedule(1.0, 10, tolerance=0.01), Account()))
    assert len(list(evolve({"m": model}, Schedule(1.0, 10, tolerance=2.0), Account()))) == 11


@pytest.mark.parametrize("overridden", [False, True])
def test_a_tolerance_below_the_rounding_of_positions_is_refused(overridden):
    """Once ever shorter steps, until one step and two halves agreed in every digit."""
    text = HANGING_CLOTH.format(cells=2)
    far = text.replace("material", "position = [1000, 0, 0]\nmaterial")
    least = 2 * np.finfo(float).eps * 1001  # of a size of 1 m

    def run(tolerance):
        if overridden:
            return shell_run(far, tolerance=tolerance, step=None)
        return shell_run(far.replace("step = 4e-3", f"tolerance = {tolerance}"))

    message = "is below 4.4e-13, .* give 9e-13 or more"
    with pytest.raises((ParameterError, SceneError), match=message) as refusal:
        run(0.99 * least)
    assert isinstance(refusal.value, SceneError) != overridden
    if overridden:
        assert refusal.value.parameter == "tolerance"
    assert run(1e-6)[0][-1].time == pytest.approx(0.04)


def test_a_run_ends_where_rounding_comes_to_exceed_the_tolerance():
    """A body that moves away from the origin loses digits on the way."""
    from ddgcli.simulation.model import Model, Observation, Schedule

    lengths, shown = [], Observation(None)

    def advance(state, time, dt):
        lengths.append(dt)
        assert len(lengths) < 1000
        return state + 1e3 * dt

    def distance(one, other):  # steps as short as that agree in every digit
        return float(np.spacing(other).max()) if lengths[-1] > 1e-6 else 0.0

    model = Model(
        np.ones(1), advance, lambda state: shown, lambda s: {"s": s}, lambda a: a["s"],
        distance=distance, order=2, least_tolerance=lambda state: 2 * float(np.spacing(state).max()),
    )  # fmt: skip
    with pytest.raises(SolveError, match="rounding alone .* above that instead of 2e-14, or"):
        list(evolve({"m": model}, Schedule(1.0, 1, tolerance=2e-14, first_dt=1e-3), Account()))


def test_progress_reports_every_part_of_a_step():
    scene = resolve(parse_scene(FREE_SCENE.format(integrator="verlet", step=0.05, duration=0.2)), KIND, {})
    contexts = {name: context for name, (context, _) in model.contexts(scene, None).items()}
    reports = []
    models = model.build(scene, contexts, Account())
    list(evolve(models, scene.schedule(), Account(), progress=lambda *done: reports.append(done)))
    done, whole = np.array(reports).T
    assert (whole == 4).all() and done[-1] == pytest.approx(4)
    assert len(done) > 4 and np.allclose(np.diff(done), done[0])


def test_unstable_steps_are_divided_with_an_event(caplog):
    text = FREE_SCENE.format(integrator="verlet", step=0.05, duration=0.2)
    run, _, _ = shell_run(text)
    events = [event for snapshot in run for event in snapshot.events]
    assert [event.kind for event in events] == ["stability"]
    assert run[-1].smallest_step < 0.05
    energy = scalar(run, "energy")
    assert abs(energy[-1] / energy[0] - 1) < 0.1


def test_adaptive_steps_keep_their_tolerance():
    text = FREE_SCENE.format(integrator="newmark", step=0.05, duration=0.2).replace(
        "step = 0.05", "tolerance = 1e-5"
    )
    run, _, _ = shell_run(text)
    truth = finest_end().points
    error = np.abs(run[-1].observations["s"].points - truth).max()
    assert error < 2e-3
    fine, _, _ = shell_run(text.replace("1e-5", "1e-7"))
    assert np.abs(fine[-1].observations["s"].points - truth).max() < error / 5
    assert fine[-1].steps > run[-1].steps
