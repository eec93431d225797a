"""External work and forces on a system: handles, time-dependent loads, wind, obstacles, supports."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.system import Motion, System
from ddgcli.mechanics.terms import ActsAt, Dissipation, Potential
from ddgcli.mesh.vectors import row_cross


def driving_work(
    system: System,
    before: Motion,
    after: Motion,
    dt: float,
    later: System | None = None,
    acts_at: ActsAt = "ends",
    pushes_at: ActsAt = "ends",
) -> float:
    """External work of a step on the kinetic and potential energy, by the trapezoidal rule.

    The sum of three terms: the work of the reaction forces of prescribed vertices, with the change of their
    kinetic energy; the change of potentials in time at fixed positions; and the work of moving air.

    Parameters
    ----------
    system : System
    before, after : Motion
        At both ends of the step.
    dt : float
        In s.
    later : System, optional
        The system with the memory at the end of the step; by default `system`.
    acts_at : {'ends', 'end', 'middle'}
        Where the scheme evaluates forces. Those of friction, which change abruptly when a body lands, are
        evaluated there.
    pushes_at : {'ends', 'end', 'middle'}
        Where the forces of moving obstacles are evaluated, see `obstacle_work`.

    Returns
    -------
    float
        In J.
    """
    start, end, move = system.at(before.time), (later or system).at(after.time), after.x - before.x
    work = 0.0
    if system.prescribed:
        rows = np.logical_or.reduce([term.mask[:, 0] for term in system.prescribed])
        force = start.full_gradient(before.x) + end.full_gradient(after.x)
        if system.dissipations:
            force += start.full_drag(before.x, before.v, dt) + end.full_drag(after.x, after.v, dt)
        work += 0.5 * float(np.vdot(force[rows], move[rows]))
        speed = np.sum(after.v[rows] ** 2, axis=1) - np.sum(before.v[rows] ** 2, axis=1)
        work += 0.5 * float(system.mass[rows] @ speed)
    work += obstacle_work(system, before, after, pushes_at)
    for term in system.terms:
        if term.at is not None and term.travel_work is None:
            then, now = term.at(before.time), term.at(after.time)
            if isinstance(then, Potential):
                work += 0.5 * (now.energy(before.x) - then.energy(before.x))
                work += 0.5 * (now.energy(after.x) - then.energy(after.x))
    middle, halfway = before.x + 0.5 * dt * before.v, system.at(0.5 * (before.time + after.time))
    terms = zip(end.dissipations, halfway.dissipations, start.dissipations, strict=True)
    for dissipation, at_half, at_start in terms:
        if dissipation.active:
            with system.account.within(dissipation.name):
                if dissipation.smooth:
                    drag = at_half.frozen(middle, dt).gradient(move / dt)
                elif acts_at == "middle":
                    drag = at_half.frozen(before.x + 0.5 * move, dt).gradient(move / dt)
                else:
                    drag = dissipation.frozen(after.x, dt).gradient(after.v)
                    if acts_at == "ends":
                        drag = 0.5 * (drag + at_start.frozen(before.x, dt).gradient(before.v))
            work -= float(np.vdot(system.only_free(drag), move))
    return work


def reactions(system: System, motion: Motion, dt: float) -> dict[str, tuple[NDArray, NDArray]]:
    """Force and moment that each pin and handle exerts on the object.

    The force is mass times acceleration plus the gradients of the potentials and of the dissipation, summed
    over the coordinates of the support; a coordinate of two supports counts for the first one.

    Parameters
    ----------
    system : System
    motion : Motion
    dt : float
        Of the last step, in s.

    Returns
    -------
    dict of str to ((3,) ndarray, (3,) ndarray)
        By name: force in N, and moment about the origin in N m.
    """
    system = system.at(motion.time)
    if not system.supports:
        return {}
    force = system.full_gradient(motion.x)
    if system.has_drag(motion.v):
        force = force + system.full_drag(motion.x, motion.v, dt)
    acceleration = system.prescribed_state(motion.x, motion.v, np.zeros_like(motion.a))[2]
    force = force + system.mass[:, None] * acceleration
    for edges in system.constraints:
        force = force - edges.pull(motion.x, motion.multipliers)
    ends, couples = _couples(system, motion.x)
    fixed, counted, forces = np.zeros_like(system.free), np.zeros(len(ends), dtype=bool), {}
    for term in system.supports:
        own = np.where(term.mask & ~fixed, force, 0.0)
        fixed |= term.mask
        in_term = np.asarray(term.mask.any(axis=1))[ends].all(axis=1) & ~counted
        couple, counted = couples[in_term], counted | in_term
        forces[term.name] = own.sum(axis=0), row_cross(motion.x, own).sum(axis=0) + couple.sum(axis=0)
    return forces


def _couples(system: System, x: NDArray) -> tuple[NDArray, NDArray]:
    """Edges (c, 2) whose direction supports hold, and moments (c, 3) of the supports on them."""
    couples = [p.couples(x) for p in system.potentials if p.couples is not None]
    ends = [np.zeros((0, 2), dtype=np.int64), *(e for e, _ in couples)]
    return np.concatenate(ends), np.concatenate([np.zeros((0, 3)), *(moment for _, moment in couples)])


def obstacle_work(system: System, before: Motion, after: Motion, pushes_at: ActsAt = "ends") -> float:
    """Work that moving obstacles add to the stored energy in a step: their forces times their travel.

    The change of a barrier's energy in time at fixed positions may be infinite.

    Parameters
    ----------
    system : System
    before, after : Motion
        At both ends of the step.
    pushes_at : {'ends', 'end', 'middle'}
        Where the forces are taken. With those of the end the balance of implicit Euler does not rise, because
        a convex barrier lies above its tangent there.

    Returns
    -------
    float
        In J.
    """
    if not system.pushed:
        return 0.0
    start, end = (before.time, before.x), (after.time, after.x)
    middle = (0.5 * (before.time + after.time), 0.5 * (before.x + after.x))
    places = {"ends": (start, end), "end": (end,), "middle": (middle,)}[pushes_at]
    work = 0.0
    for term in system.terms:
        if term.travel_work is not None:
            work += sum(term.at(time).travel_work(x, start, end) for time, x in places)
    return work / len(places)


def contact_forces(system: System, motion: Motion, dt: float) -> dict[str, tuple[NDArray, NDArray]]:
    """Force and moment that shells exert on each obstacle.

    Parameters
    ----------
    system : System
    motion : Motion
    dt : float
        Of the last step, in s.

    Returns
    -------
    dict of str to ((3,) ndarray, (3,) ndarray)
        By name: force in N, and moment about the origin in N m.
    """
    system = system.at(motion.time)
    forces: dict[str, tuple[NDArray, NDArray]] = {}
    terms: list[Any] = [*system.potentials, *system.dissipations]
    for term in terms:
        if not term.obstacle:
            continue
        with system.account.within(term.name):
            if isinstance(term, Dissipation):
                push = term.frozen(motion.x, dt).gradient(motion.v)
            else:
                push = term.gradient(motion.x)
        force, moment = forces.get(term.obstacle, (np.zeros(3), np.zeros(3)))
        forces[term.obstacle] = force + push.sum(axis=0), moment + row_cross(motion.x, push).sum(axis=0)
    return forces
