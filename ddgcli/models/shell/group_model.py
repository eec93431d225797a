"""Model of a group of coupled shells for the time loop: its initial motion and its steps."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError, SolveError
from ddgcli.mechanics.driving import driving_work
from ddgcli.mechanics.integrators import ARC_LENGTH, INTEGRATORS, Integrator, Step
from ddgcli.mechanics.rounding import least_tolerance
from ddgcli.mechanics.stability import stable_step
from ddgcli.mechanics.system import LINEAR_SOLVER, Motion, System
from ddgcli.mechanics.terms import ActsAt, PlasticMemory
from ddgcli.mesh.vectors import row_cross
from ddgcli.models.shell.checkpoint import packed, unpacked
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.equilibrium_advice import load_advice, needle_advice
from ddgcli.models.shell.groups import Group
from ddgcli.models.shell.observations import observed
from ddgcli.models.shell.stretch_limit import StretchLimit, has_stretch_limit
from ddgcli.scenes.scene import Scene
from ddgcli.simulation.model import Ending, Model


def group_model(scene: Scene, group: Group, system: System) -> Model[Motion]:
    """Model of a group of shells for the time loop.

    Parameters
    ----------
    scene : Scene
    group : Group
    system : System
        Masses and terms of the shells of the group.

    Returns
    -------
    Model
    """
    integrator, parameters = INTEGRATORS[scene.time.integrator], scene.time
    if getattr(parameters, "arc_length", None):
        integrator = ARC_LENGTH
    start, size = _start(scene, group, system, integrator), system.size
    _check_tolerance(scene, scene.time.tolerance, least_tolerance(start.x, size))
    steps, reach = GroupSteps(group, system, integrator, parameters), integrator.reach(parameters)
    return Model(
        start, steps.advance, partial(observed, group, system, scene.schedule().dt), packed,
        partial(unpacked, system, integrator.multistep), stable_step(system, start.x, reach),
        lambda a, b: float(np.abs(a.x - b.x).max()) / size, integrator.order,
        rescue=steps.rescue if integrator.rescue is not None and np.isinf(reach) else None,
        stop=partial(_load_reached, parameters.duration) if integrator.own_time else None,
        clock=(lambda motion: motion.time) if integrator.own_time else None,
        advice=partial(load_advice, system, parameters, steps.meshes) if integrator.order == 0 else None,
        # iterations indicate the difficulty of a step only for held shells: free ones first move rigidly
        iterations=(lambda m: float(m.newton)) if system.support_mask.any() and np.isinf(reach) else None,
        least_tolerance=lambda motion: least_tolerance(motion.x, size),
    )  # fmt: skip


class GroupSteps:
    """Steps of an integrator for a group of shells.

    Parameters
    ----------
    group : Group
    system : System
    integrator : Integrator
    parameters : Any
        The section [time] of the scene.
    """

    def __init__(self, group: Group, system: System, integrator: Integrator, parameters: Any) -> None:
        self.system, self.integrator, self.parameters = system, integrator, parameters
        self.meshes = [context.mesh for context in group.shells.values()]
        self.stretch_limit = StretchLimit(group) if has_stretch_limit(system) else None
        plastic = any(isinstance(term, PlasticMemory) for term in system.memories)
        self._in_balance = integrator.order == 0 and plastic

    def advance(self, motion: Motion, time: float, dt: float) -> Motion:
        """The motion after a step."""
        try:
            return self._advanced(self.integrator.step, motion, time, dt, self.integrator.pushes_at)
        except SolveError as error:
            advice = needle_advice(self.meshes)
            raise SolveError("; ".join(filter(None, [str(error), advice]))) from error

    def rescue(self, motion: Motion, time: float, dt: float) -> Motion:
        """The motion after a step of the integrator's fallback."""
        return self._advanced(self.integrator.rescue or self.integrator.step, motion, time, dt, "ends")

    def _advanced(self, step: Step, motion: Motion, time: float, dt: float, pushes_at: ActsAt) -> Motion:
        integrator, system = self.integrator, self.system
        before = motion if integrator.own_time else replace(motion, time=time)
        current = system.with_memory_at(motion.memory)
        current.begin_step()
        after, memory = self._end_of_step(step, current, before, dt)
        if LINEAR_SOLVER in system.cache:
            system.cache[LINEAR_SOLVER].release()  # the next step has a matrix of its own
        past = (before.x, before.v, np.array([dt])) if integrator.multistep else ()
        end = after.time if integrator.own_time else time + dt
        if self.stretch_limit is not None:
            self.stretch_limit.check(after.x, end)
        work = 0.0
        if system.driven:
            later = system.with_memory_at(memory) if self._in_balance else current
            after = replace(after, time=end)
            work = driving_work(current, before, after, dt, later, integrator.acts_at, pushes_at)
        if not self._in_balance and _has_yielded(memory, motion.memory):
            # the next step starts with the forces after yielding; otherwise their work is lost
            softer = system.with_memory_at(memory).at(end)
            after = replace(after, a=softer.acceleration(after.x, after.v, dt))
        return replace(after, time=end, work=motion.work + work, memory=memory, past=past)

    def _end_of_step(self, step: Step, current: System, before: Motion, dt: float) -> tuple[Motion, Any]:
        """The motion at the end of a step, and the memories there."""
        if self._in_balance:
            from ddgcli.mechanics.yielding import yielding_equilibrium

            return yielding_equilibrium(
                self.system, before, lambda yielded, guess: step(yielded, guess, dt, self.parameters)
            )
        after = step(current, before, dt, self.parameters)
        return after, self.system.committed(after.x, before.memory)


def _has_yielded(memory: Any, before: Any) -> bool:
    """Whether a step has changed a plastic memory, which has an array `work`."""
    return any("work" in new and new is not old for new, old in zip(memory, before))


def _start(scene: Scene, group: Group, system: System, integrator: Integrator) -> Motion:
    """The motion at the start."""
    x = np.array(system.start)
    velocities = [_initial_velocity(context) for context in group.shells.values()]
    v = np.where(system.free, np.concatenate(velocities), 0.0)
    x, v, _ = system.prescribed_state(x, v, v)
    if integrator.order == 0:
        v = np.zeros_like(x)  # equilibria have no motion
    with np.errstate(all="ignore"):
        a = system.acceleration(x, v, scene.schedule().dt)
    past = (x, v, np.zeros(1)) if integrator.multistep else ()
    memory = tuple(term.initial() for term in system.memories)
    return _constrained(scene, system, Motion(x, v, a, memory=memory, past=past))


def _initial_velocity(context: ShellContext) -> NDArray[np.float64]:
    shell, x = context.shell, context.mesh.points
    centre = (context.mass[:, None] * x).sum(axis=0) / context.mass.sum()
    return np.array(shell.velocity) + row_cross(np.array(shell.angular_velocity), x - centre)


def _constrained(scene: Scene, system: System, motion: Motion) -> Motion:
    """The initial motion, with multipliers and velocities projected to keep the lengths of rigid edges."""
    if not system.constraints:
        return motion
    from ddgcli.mechanics.constraints import Projection, redundant

    (edges,) = system.constraints
    try:
        count = redundant(system, edges, motion.x)
        if count:
            raise SolveError(
                f"the lengths of {count} of the edges follow from the others (a flat surface with vertices "
                "inside is stiff already); name fewer edges"
            )
        v, _ = Projection(system, edges, motion.x).tangent(motion.v)
    except SolveError as error:
        scene.refuse(("effects", "rigid"), f"rigid: {error}")
    return replace(motion, v=v, multipliers=np.zeros(len(edges.length)))


def _check_tolerance(scene: Scene, tolerance: float | None, least: float) -> None:
    """Raise an error for a tolerance that no step can meet, because positions are rounded."""
    if tolerance is None or scene.time.integrator == "static" or tolerance >= least:
        return
    reason = (
        f"{tolerance:g} is below {least:.2g}, what rounding of the positions leaves of the size in any step; "
        f"give {2 * least:.1g} or more, or `step` without it"
    )
    if scene.document.data.get("time", {}).get("tolerance") == tolerance:
        scene.refuse(("time", "tolerance"), f"tolerance = {reason}")
    raise ParameterError(reason, parameter="tolerance")  # no line of the scene holds it


def _load_reached(duration: float, motion: Motion) -> Ending | None:
    """Ending of an equilibrium path that has reached the full load."""
    return Ending("complete", "the whole load is reached") if motion.time >= duration else None
