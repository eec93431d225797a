"""Time integrators of mechanical systems, with their orders, which a test measures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.mechanics.system import Motion, System
from ddgcli.simulation.model import Cause, StepRejected

if TYPE_CHECKING:
    from ddgcli.mechanics.increment import Increment, Point
    from ddgcli.mechanics.terms import ActsAt, Potential

Step = Callable[[System, Motion, float, Any], Motion]

FRICTION_TOLERANCE = 0.05  # error of the friction forces over their sum, due to lagged normal forces
MAX_FRICTION_PASSES = 3  # solves of a step with updated normal forces


@dataclass(frozen=True)
class Integrator:
    """A time integration scheme.

    Parameters
    ----------
    name : str
    order : int
    step : callable (system, motion, dt, parameters) -> Motion
    reach : callable parameters -> float
        Largest stable product of step and angular frequency.
    rescue : callable like `step`, optional
        Fallback scheme, tried before a rejected step is halved; only for unconditionally stable schemes.
    multistep : bool
        Whether the scheme uses `Motion.past`.
    own_time : bool
        Whether a step itself sets the time of its end: the load factor of a path.
    acts_at : {'ends', 'end', 'middle'}
        Positions and velocities of a step at which the scheme evaluates forces.
    pushes_at : {'ends', 'end', 'middle'}
        Those whose forces give the work of moving obstacles to the order of the scheme.
    """

    name: str
    order: int
    step: Step
    reach: Callable[[Any], float]
    rescue: Step | None = None
    multistep: bool = False
    own_time: bool = False
    acts_at: ActsAt = "ends"
    pushes_at: ActsAt = "ends"


def _symplectic_euler(system: System, motion: Motion, dt: float, parameters: Any) -> Motion:
    a = system.at(motion.time).acceleration(motion.x, motion.v, dt)
    v = motion.v + dt * a
    end = system.at(motion.time + dt)
    return checked(end, Motion(*end.prescribed_state(motion.x + dt * v, v, a), motion.newton))


def _verlet(system: System, motion: Motion, dt: float, parameters: Any) -> Motion:
    """Velocity Verlet (kick, drift, kick); with drag the second kick is corrected once, for order 2."""
    system = system.at(motion.time + dt)
    if system.constraints:
        from ddgcli.mechanics.constraints import rattle

        x, v, a, multipliers = rattle(system, motion, dt)
        return checked(system, Motion(x, v, a, motion.newton, multipliers=multipliers))
    half = motion.v + 0.5 * dt * motion.a
    x = system.prescribed_state(motion.x + dt * half, half, half)[0]
    checked(system, Motion(x, half, motion.a))
    a = system.acceleration(x, half if not system.dissipations else motion.v + dt * motion.a, dt)
    v = half + 0.5 * dt * a
    if system.dissipations:
        a = system.acceleration(x, v, dt)
        v = half + 0.5 * dt * a
    return checked(system, _after(system, x, v, a, motion.newton))


def _avi(system: System, motion: Motion, dt: float, parameters: Any) -> Motion:
    """Asynchronous variational integrator; it does not use accelerations."""
    from ddgcli.mechanics.asynchronous import step

    x, v = step(system, motion, dt)
    end = system.at(motion.time + dt)
    return checked(end, _after(end, x, v, np.zeros_like(v), motion.newton))


def _after(system: System, x: NDArray, v: NDArray, a: NDArray, newton: int) -> Motion:
    """The motion at the end of a step, with the prescribed positions and velocities.

    Prescribed accelerations are not set, because no scheme uses them.
    """
    x, v, _ = system.prescribed_state(x, v, a)
    return Motion(x, v, a, newton)


def checked(system: System, motion: Motion, before: NDArray | None = None) -> Motion:
    """The motion; StepRejected if it is not finite or crossed a barrier.

    `before` (n, 3) are positions from which the vertices moved straight to the end; by default barriers
    between are not checked.
    """
    for array in (motion.x, motion.v):
        if not np.isfinite(array).all():
            bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
            raise StepRejected(Cause.NOT_FINITE, f"vertex {bad[0]}", float("nan"))
    for barrier in system.barriers:
        crossed = barrier.outside(motion.x)
        if crossed is None and before is not None and barrier.crosses is not None:
            crossed = (0, 0.0) if barrier.crosses(before, motion.x) else None
        if crossed is not None:
            raise StepRejected("barrier crossed", f"vertex {crossed[0]}", crossed[1], solved=True)
    return motion


def _obstacles_at(system: System, time: float) -> System:
    """The system with its moving obstacles at their positions at a time."""
    return system.with_obstacles_at(time) if system.pushed else system


def _obstacle_work(
    system: System, before: Motion, after: Motion, dt: float, pushes_at: ActsAt = "ends"
) -> float:
    """Energy in J that moving obstacles add to the stored energy in a step."""
    if not system.pushed:
        return 0.0
    from ddgcli.mechanics.driving import obstacle_work

    return obstacle_work(system, before, replace(after, time=before.time + dt), pushes_at)


def _solved(
    system: System, increment: Increment, guess: Point, dt: float, ahead: NDArray | None = None
) -> tuple[NDArray, int, Increment]:
    """Minimiser of an increment, the number of Newton iterations, and the increment with the final friction.

    At first, friction has the normal forces of the start of the step. If those at the minimiser differ, as
    when a body lands, the increment is minimised again with them, unless that moves the minimiser by less
    than Newton's method resolves, as for a body that falls straight or moves with its floor. Smooth
    dissipation stays frozen at `ahead`; by default it is updated at the minimiser, too.
    """
    from ddgcli.mechanics.newton import is_significant, minimise
    from ddgcli.mechanics.objective import Objective

    y, count = minimise(system, increment, guess)
    if not (increment.frozen and system.barriers):
        return y, count, increment
    for _ in range(MAX_FRICTION_PASSES - 1):
        frozen = system.frozen(y, dt, ahead=y if ahead is None else ahead)
        before, after = (system.drag_of(f, increment.velocity(y)) for f in (increment.frozen, frozen))
        if np.abs(after - before).sum() <= FRICTION_TOLERANCE * np.abs(after).sum():
            break
        increment = replace(increment, frozen=frozen)
        if not is_significant(system, increment, y, after - before):
            break
        y, more = minimise(system, increment, Objective(system).at(increment, y))
        count += more
    return y, count, increment


def _undamped_guess(system: System, increment: Increment, motion: Motion) -> Point:
    """First guess of the undamped schemes.

    The acceleration of motions slower than the step stays nearly the same, that of faster motions changes its
    sign in every step; the guess with the smaller value of the incremental potential is taken.
    """
    from ddgcli.mechanics.newton import first_guess
    from ddgcli.mechanics.objective import Objective

    change = motion.a * (1 / increment.a)
    guesses = [increment.target + change]
    if not Objective(system).is_linear(increment):
        guesses.append(increment.target - change)
    return first_guess(system, increment, motion.x, guesses, motion.time)


def _implicit_euler(system: System, motion: Motion, dt: float, parameters: Any) -> Motion:
    from ddgcli.mechanics.energy_balance import StoredEnergy, without_gain
    from ddgcli.mechanics.increment import Increment
    from ddgcli.mechanics.newton import first_guess

    system = system.at(motion.time + dt)
    # before anything else, because terms have cached their values at the end of the last step
    start = None if system.linear else StoredEnergy.at(_obstacles_at(system, motion.time), motion.x)
    target = motion.x + dt * motion.v
    ahead = motion.x + 0.5 * dt * motion.v
    increment = Increment(
        1 / dt**2, target, 1 / dt, motion.x, system.frozen(motion.x, dt, motion.time, ahead)
    )
    guesses = (target + dt**2 * motion.a, target)
    guess = first_guess(system, increment, motion.x, guesses, motion.time)
    y, count, _ = _solved(system, increment, guess, dt, ahead)
    v = (y - motion.x) / dt
    after = _after(system, y, v, system.only_free((v - motion.v) / dt), motion.newton + count)
    checked(system, after)
    if start is None:
        return after
    pushed = _obstacle_work(system, motion, after, dt, "end")
    return without_gain(system, motion, after, start, StoredEnergy.at(system, after.x), pushed, dt)


def _implicit_midpoint(system: System, motion: Motion, dt: float, parameters: Any) -> Motion:
    """Implicit midpoint rule: the unknown is the middle position y, and the end is 2 y - x."""
    from ddgcli.mechanics.energy_balance import StoredEnergy, balanced
    from ddgcli.mechanics.increment import Increment

    system, end = system.at(motion.time + 0.5 * dt), system.at(motion.time + dt)
    # before anything else, because terms have cached their values at the end of the last step
    start = None if system.linear else StoredEnergy.at(_obstacles_at(system, motion.time), motion.x)
    target = motion.x + 0.5 * dt * motion.v
    frozen = system.frozen(motion.x, dt, motion.time, target)
    increment = Increment(4 / dt**2, target, 2 / dt, motion.x, frozen)
    # barriers act at the middle, so friction has their forces there; at the ends they are 6 % larger, because
    # stiff contact vibrates
    middle, count, _ = _solved(system, increment, _undamped_guess(system, increment, motion), dt)
    x = end.prescribed_state(2 * middle - motion.x, middle, middle)[0]
    v = 2 * (x - motion.x) / dt - motion.v
    a = system.only_free((v - motion.v) / dt)
    after = checked(end, _after(end, x, v, a, motion.newton + count), middle)
    if start is None:
        return after
    work = -float(np.vdot(StoredEnergy.at(system, middle).gradient, x - motion.x))
    work -= _obstacle_work(system, motion, after, dt, "middle")
    last = StoredEnergy.at(_obstacles_at(system, end.time), x)
    return balanced(system, motion, after, start, last, work, dt)


def _newmark(system: System, motion: Motion, dt: float, parameters: Any) -> Motion:
    beta, gamma = parameters.beta, parameters.gamma
    system = system.at(motion.time + dt)
    x, v, a = motion.x, motion.v, motion.a
    if beta == 0:
        target = system.prescribed_state(x + dt * v + dt**2 * 0.5 * a, v, a)[0]
        checked(system, Motion(target, v, a))
        new = system.acceleration(target, v + dt * a, dt)
        speed = v + dt * ((1 - gamma) * a + gamma * new)
        return checked(system, _after(system, target, speed, new, motion.newton))
    if system.linear or np.isfinite(_newmark_reach(parameters)):
        return _implicit_newmark(system, motion, dt, beta, gamma)[0]
    from ddgcli.mechanics.energy_balance import StoredEnergy, balanced, kinetic

    # before anything else, because terms have cached their values at the end of the last step
    start = StoredEnergy.at(_obstacles_at(system, motion.time), x)
    after, _ = _implicit_newmark(system, motion, dt, beta, gamma)
    end = StoredEnergy.at(system, after.x)
    path = after.x - x
    work = -0.5 * float(np.vdot(start.gradient + end.gradient, path))
    # zero for beta = 1/4 and gamma = 1/2, where the trapezoidal work of all forces changes the kinetic energy
    changed = kinetic(system, after.v) - kinetic(system, v)
    work += changed - 0.5 * float(np.vdot(system.mass[:, None] * (a + after.a), path))
    work -= _obstacle_work(system, motion, after, dt)
    return balanced(system, motion, after, start, end, work, dt)


def _implicit_newmark(
    system: System, motion: Motion, dt: float, beta: float, gamma: float
) -> tuple[Motion, Increment]:
    """A Newmark step without a check of its energy, and its incremental potential."""
    from ddgcli.mechanics.increment import Increment

    x, v, a = motion.x, motion.v, motion.a
    target = (dt**2 * (0.5 - beta)) * a
    target += dt * v
    target += x
    speed = (dt * (1 - gamma)) * a
    speed += v
    c = gamma / (beta * dt)
    ahead = x + dt * v
    frozen = system.frozen(x, dt, motion.time, ahead)
    increment = Increment(1 / (beta * dt**2), target, c, target - speed / c if frozen else None, frozen)
    guess = _undamped_guess(system, increment, motion)
    y, count, increment = _solved(system, increment, guess, dt, ahead)
    new = system.only_free(y - target)
    new *= increment.a
    speed += (dt * gamma) * new
    return checked(system, _after(system, y, speed, new, motion.newton + count)), increment


def _composite(system: System, motion: Motion, dt: float, parameters: Any) -> Motion:
    """Composite scheme: half a step by the trapezoidal rule, half by BDF2; order 2, L-stable.

    It dissipates waves faster than the step, and preserves slower motion [K.-J. Bathe, "Conserving energy and
    momentum in nonlinear dynamics: a simple implicit time integration scheme", 2007]. At a barrier it can
    also add energy, so its energy balance is checked: it may dissipate a tenth of the kinetic energy.
    """
    from ddgcli.mechanics.energy_balance import MAX_ENERGY_FALL, StoredEnergy, balanced, kinetic
    from ddgcli.mechanics.increment import Increment

    x, v = motion.x, motion.v
    begin = Motion(x, v, system.at(motion.time).acceleration(x, v, dt), motion.newton, time=motion.time)
    half, system = system.at(motion.time + 0.5 * dt), system.at(motion.time + dt)
    start = StoredEnergy.at(_obstacles_at(system, motion.time), x)
    middle, first = _implicit_newmark(half, begin, 0.5 * dt, 0.25, 0.5)
    at_start = system.at(motion.time).frozen(x, 0.5 * dt)
    middle = replace(middle, time=half.time)
    target = (12 * middle.x - 3 * x + dt * (4 * middle.v - v)) / 9
    ahead = middle.x + 0.5 * dt * middle.v
    frozen = system.frozen(middle.x, 0.5 * dt, half.time, ahead)
    increment = Increment(9 / dt**2, target, 3 / dt, (4 * middle.x - x) / 3, frozen)
    guess = _undamped_guess(system, increment, middle)
    y, count, increment = _solved(system, increment, guess, 0.5 * dt, ahead)
    speed = (x - 4 * middle.x + 3 * y) / dt
    a = np.where(system.free, (v - 4 * middle.v + 3 * speed) / dt, 0.0)
    after = checked(system, _after(system, y, speed, a, middle.newton + count))
    change = kinetic(system, speed) - kinetic(system, v)
    # friction at both ends of both halves, because BDF2 turns 2/3 of a friction that begins into velocity
    acting = pairwise([(at_start, v), (first.frozen, middle.v), (increment.frozen, speed)])
    work = change - half.external_work((x, middle.x, y), 0.5 * dt, list(acting))
    work -= _obstacle_work(system, motion, after, dt) + system.later_work(motion.time, x, y)
    most = MAX_ENERGY_FALL * max(kinetic(system, v), kinetic(system, speed))
    # without the excess of earlier steps: once that is at its limit, every further step would be rejected
    fresh = replace(motion, balance_excess=0.0)
    accepted = balanced(system, fresh, after, start, StoredEnergy.at(system, y), work, dt, most)
    return replace(accepted, balance_excess=motion.balance_excess + accepted.balance_excess)


def _bdf2(system: System, motion: Motion, dt: float, parameters: Any) -> Motion:
    """BDF2 with variable steps; the first step is trapezoidal.

    It may dissipate any energy. At a barrier it can also add some, so its energy balance is checked.
    """
    from ddgcli.mechanics.energy_balance import StoredEnergy, balanced, kinetic, without_excess

    system, x, v = system.at(motion.time + dt), motion.x, motion.v
    # before anything else, because terms have cached their values at the end of the last step
    start = None if system.linear else StoredEnergy.at(_obstacles_at(system, motion.time), x)
    after, acting = _backward_difference(system, motion, dt)
    if start is None:
        return after
    end = StoredEnergy.at(system, after.x)
    half = system.at(motion.time + 0.5 * dt)
    work = kinetic(system, after.v) - kinetic(system, v) - half.external_work((x, after.x), dt, [acting])
    work -= _obstacle_work(system, motion, after, dt) + system.later_work(motion.time, x, after.x)
    after = balanced(system, motion, after, start, end, work, dt, np.inf)
    return without_excess(system, motion, after, end, dt)


def _backward_difference(
    system: System, motion: Motion, dt: float
) -> tuple[Motion, list[tuple[tuple[Potential, ...], NDArray]]]:
    """A BDF2 step without a check of its energy; and the dissipation that acted, with its velocities.

    For the first step, the dissipation at both ends is returned.
    """
    from ddgcli.mechanics.increment import Increment

    x, v = motion.x, motion.v
    if not motion.past or not motion.past[2][0] > 0:
        first, increment = _implicit_newmark(system, motion, dt, 0.25, 0.5)
        return first, [(system.at(motion.time).frozen(x, dt), v), (increment.frozen, first.v)]
    past_x, past_v, past_dt = motion.past
    ratio = dt / float(past_dt[0])
    new, now, old = (1 + 2 * ratio) / (1 + ratio), -(1 + ratio), ratio**2 / (1 + ratio)
    origin, speed = -(now * x + old * past_x) / new, -(now * v + old * past_v) / new
    c = new / dt
    ahead = x + dt * v
    frozen = system.frozen(x, dt, motion.time, ahead)
    increment = Increment(c * c, origin + speed / c, c, origin, frozen)
    guess = _undamped_guess(system, increment, motion)
    y, count, increment = _solved(system, increment, guess, dt, ahead)
    after = c * (y - origin)
    a = system.only_free(c * (after - speed))
    return checked(system, _after(system, y, after, a, motion.newton + count)), [(increment.frozen, after)]


def _static(system: System, motion: Motion, dt: float, parameters: Any) -> Motion:
    """One equilibrium: a stationary point of the potential energy, by descent."""
    from ddgcli.mechanics.admissible import admissible_start
    from ddgcli.mechanics.equilibrium import Equilibrium

    system = system.at(motion.time + dt)
    try:
        start = admissible_start(system, motion.x, motion.time)
        y, count = Equilibrium(system).find(start)
    except StepRejected as rejected:
        if getattr(parameters, "load_steps", 1) > 1:
            raise  # the time loop halves the load step
        from ddgcli.mechanics.rigid_motions import unheld_motions
        from ddgcli.mechanics.small_loads import force_rounding, larger_loads, largest_load

        unheld = unheld_motions(system)
        cause, remedy = f"{rejected}; {unheld}" if unheld else str(rejected), "hold the shell by pins"
        if rejected.cause == Cause.NOT_FINITE:  # the first move leads too far
            remedy = "apply the load in steps (`load_steps=10`)"
        load, least = largest_load(system, motion.x), force_rounding(system)
        # pinned shells reach equilibrium under any small load, unless their faces are needles
        other = larger_loads(load, least) if unheld and 0.0 < load < least else "lessen the load"
        raise SolveError(f"no equilibrium was found ({cause}): {remedy} or {other}") from rejected
    still = np.zeros_like(y)
    return checked(system, Motion(y, still, still, motion.newton + count))


def _arc_length(system: System, motion: Motion, dt: float, parameters: Any) -> Motion:
    """The next equilibrium along the load path."""
    from ddgcli.mechanics.arc_length import arc_step

    return checked(system, arc_step(system, motion, dt, parameters))


def _reach_of_leapfrog(parameters: Any) -> float:
    return 2.0


def _any_step(parameters: Any) -> float:
    return np.inf


def _newmark_reach(parameters: Any) -> float:
    """Stability limit of Newmark's scheme (T. J. R. Hughes, "The finite element method", 1987, 9.1)."""
    lacking = 0.5 * parameters.gamma - parameters.beta
    return lacking**-0.5 if lacking > 0 else np.inf


INTEGRATORS: dict[str, Integrator] = {
    "symplectic-euler": Integrator("symplectic-euler", 1, _symplectic_euler, _reach_of_leapfrog),
    "verlet": Integrator("verlet", 2, _verlet, _reach_of_leapfrog),
    "avi": Integrator("avi", 2, _avi, _any_step),
    "newmark": Integrator("newmark", 2, _newmark, _newmark_reach, _composite),
    "implicit-midpoint": Integrator(
        "implicit-midpoint",
        2,
        _implicit_midpoint,
        _any_step,
        _composite,
        acts_at="middle",
        pushes_at="middle",
    ),
    "implicit-euler": Integrator(
        "implicit-euler", 1, _implicit_euler, _any_step, acts_at="end", pushes_at="end"
    ),
    "bdf2": Integrator("bdf2", 2, _bdf2, _any_step, _composite, multistep=True, acts_at="end"),
    "static": Integrator("static", 0, _static, _any_step),
}

ARC_LENGTH = Integrator("static", 0, _arc_length, _any_step, multistep=True, own_time=True)
