"""Sources of a step of a fluid: forces and viscosity as one implicit step, the others one after the other.

Where forces and viscosity act in turn, a fluid at a wall without slip gains `dt / 2` times the force after
the wall has stopped it, and a steady flow errs by the step. As the right-hand side of the implicit step they
are in balance at any step.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol, cast

from ddgcli.models.fluid.phases import Acceleration, Phase, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.simulation.account import Account


class ViscousPhase(Phase, Protocol):
    """Phase of the viscosity."""

    def advance_forced(self, step: Step, state: FluidState, forced: FluidState) -> FluidState:
        """The state after the span; `forced` is the state with what forces add in it."""
        ...


class SourceSequence:
    """The sources of a fluid, in an order that does not depend on that of the scene.

    Where a step has a `balance`, the viscosity has it as a source as it has forces.

    Parameters
    ----------
    phases : iterable of Phase
    effect_names : sequence of str
        Of all effects, in the order in which sources act. Viscosity acts first and last.
    account : Account

    Attributes
    ----------
    phases : list of Phase
        Without the forces where there is viscosity.
    """

    def __init__(self, phases: Iterable[Phase], effect_names: Sequence[str], account: Account) -> None:
        rank = {name: number for number, name in enumerate(effect_names)}
        in_order = sorted(
            (phase for phase in phases if phase.step_stage == "source"), key=lambda phase: rank[phase.effect]
        )
        self.account = account
        viscous = (phase for phase in in_order if hasattr(phase, "advance_forced"))
        self.friction = cast("ViscousPhase | None", next(viscous, None))
        forces = [phase for phase in in_order if getattr(phase, "is_force", False)]
        self.forces = cast("list[Acceleration]", forces)
        self.phases: list[Phase] = in_order
        if self.friction is not None:
            others = [phase for phase in in_order if phase not in (self.friction, *self.forces)]
            self.phases = [self.friction, *others]

    def advanced(self, phase: Phase, step: Step, state: FluidState) -> FluidState:
        """The state after one source."""
        if self.friction is None or phase is not self.friction:
            with self.account.within(phase.effect):
                return phase.advance(step, state)
        forced = state
        for force in self.forces:
            with self.account.within(force.effect):
                forced = force.advance(step, forced)
        if step.balance is not None:
            vorticity, coefficients = step.balance
            forced = forced.replaced(
                vorticity=forced["vorticity"] + step.dt * vorticity,
                coefficients=forced["coefficients"] + step.dt * coefficients,
            )
        with self.account.within(phase.effect):
            return self.friction.advance_forced(step, state, forced)
