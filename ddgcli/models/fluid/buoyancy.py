"""Effect `buoyancy`: a temperature carried by the flow drives it (Boussinesq approximation).

The excess temperature T is carried like dye, diffuses and has sources; the fluid is accelerated by
- expansion * T * gravity.
"""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.sparse import diags_array

from ddgcli.models.fluid.boundary_sides import GAUSS_SHARES, BoundarySides
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.force import accelerated
from ddgcli.models.fluid.lost_forces import LostForceWarning
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Phase, PhaseRequest, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.tracer import Source, TracerPhase
from ddgcli.scenes.expressions import evaluate
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity, vector
from ddgcli.simulation.effects import Effect
from ddgcli.simulation.model import Observation

if TYPE_CHECKING:
    from ddgcli.models.fluid.diffusion import Decay

ARRAY = "temperature"


class BuoyancySection(Section):
    """Excess temperature at the start, and how it drives the flow."""

    temperature: str = Field("0", description="at the start: array, .npy, or expression in x, y, z [K]")
    expansion: quantity("", "relative change of density per kelvin") = 3.4e-3
    gravity: vector("m/s^2", "acceleration of gravity") = (0.0, 0.0, -9.81)
    diffusivity: quantity("m^2/s", "of the temperature", ge=0) = 0.0
    source: str | None = Field(None, description="heating: expression in x, y, z, t [K/s]")
    fixed: str | None = Field(
        None, description="expression in x, y, z: where it is not 0 the temperature is that of the start"
    )
    object: str | None = Field(None, description="fluid; by default all")


class TemperaturePhase(TracerPhase):
    """The temperature: it diffuses and is heated for half of the step, before it is carried and after.

    Both are one implicit step, so that where they are in balance the temperature does not depend on the step.
    """

    def __init__(self, setting: FluidSetting, parameters: BuoyancySection, tracer: Any) -> None:
        source = None if parameters.source is None else Source(setting.context, parameters.source)
        super().__init__("buoyancy", setting.context.scalar(parameters.temperature, ARRAY), tracer, source)
        self.mass = setting.space.mass
        if len(tracer.turning):
            raise ValueError(
                f"fluid enters and leaves in turn at vertex {tracer.turning[0]} of the boundary, where a "
                "temperature comes in with it: give that boundary a velocity that keeps its sign, or take dye"
            )
        fixed = np.zeros(len(self.mass), dtype=bool)
        fixed[tracer.entering] = True
        if parameters.fixed is not None:
            fixed |= _fixed_vertices(setting.context, parameters.fixed)
        self.fixed = np.flatnonzero(fixed)
        self.free = np.flatnonzero((self.mass > 0) & ~fixed)
        self.conduction: Decay | None = None
        if parameters.diffusivity > 0 and len(self.free):
            self.conduction = self._conduction(setting, parameters.diffusivity)

    @property
    def array(self) -> str:
        return ARRAY

    def advance(self, step: Step, state: FluidState) -> FluidState:
        half = 0.5 * step.dt
        if self.conduction is None:
            values = self.carried(step, state, state[ARRAY])
        else:
            values = self._conducted(self.conduction, state[ARRAY], step.time, half)
            values = self.tracer.carried(step.before, state, values, step.dt)
            values = self._conducted(self.conduction, values, step.time + half, half)
        values[self.fixed] = self.amount[self.fixed]
        return state.with_passive(**{ARRAY: values})

    def _conduction(self, setting: FluidSetting, diffusivity: float) -> Decay:
        """Diffusion at the free vertices; the others have the values of the start."""
        from ddgcli.models.fluid.diffusion import Decay
        from ddgcli.models.fluid.volume_effects import vertex_stiffness

        stiffness = vertex_stiffness(setting.volume) if setting.context.is_volume else setting.space.stiffness
        rows = (diffusivity * stiffness).tocsr()[self.free]
        constant = rows[:, self.fixed] @ self.amount[self.fixed]
        return Decay(diags_array(self.mass[self.free]).tocsr(), rows[:, self.free], constant)

    def _conducted(self, conduction: Decay, values: NDArray, time: float, dt: float) -> NDArray[np.float64]:
        """(n,) values after dt of conduction and heating."""
        heat = 0.0 if self.source is None else (self.mass * self.source.rate(time + 0.5 * dt))[self.free]
        after = np.array(values)
        after[self.free] = conduction.step(values[self.free], dt, heat)
        return after

    def observed(self, state: FluidState) -> Observation:
        return Observation(
            None, {ARRAY: state[ARRAY]}, {"total_temperature": float(state[ARRAY] @ self.mass)}
        )


class BuoyancyPhase(FlowPhase):
    """Acceleration of the flow by its temperature."""

    effect = "buoyancy"
    is_force = True

    def __init__(self, setting: FluidSetting, parameters: BuoyancySection) -> None:
        self.setting = setting
        self.push = -parameters.expansion * np.array(parameters.gravity)
        self.boundary = BoundarySides.of(setting)
        self.lost = LostForceWarning(setting, self.effect)

    def advance(self, step: Step, state: FluidState) -> FluidState:
        along = self.boundary_integrals(state, step.time)
        change = self.cell_acceleration(state, step.time)
        self.lost.check(change)
        return accelerated(self.setting, state, step.dt * change, step.dt * along)

    def cell_acceleration(self, state: FluidState, time: float) -> NDArray[np.float64]:
        """(m, 3) what it adds to the velocity of the cells a second."""
        warmth = state[ARRAY][self.setting.context.cells].mean(axis=1)
        return warmth[:, None] * self.push

    def boundary_integrals(self, state: FluidState, time: float) -> NDArray[np.float64]:
        """(s, 2) its integrals along the boundary sides of a surface, for tail and head."""
        warmth = state[ARRAY][self.boundary.ends] @ GAUSS_SHARES.T
        return self.boundary.integrals(warmth[:, :, None] * self.push)


def _fixed_vertices(context: FluidContext, expression: str) -> NDArray[np.bool_]:
    """(n,) vertices at which an expression is not 0."""
    fixed = context.used & (evaluate(expression, dict(zip("xyz", context.points.T))) != 0)
    if not fixed.any():
        raise ValueError(f"no vertex lies where {expression!r} holds; check `fixed`")
    return fixed


def build(parameters: BuoyancySection, context: FluidContext) -> list[PhaseRequest]:
    def temperature(setting: FluidSetting) -> Phase:
        if context.is_volume:
            from ddgcli.models.fluid.volume_effects import VolumeTracer

            return TemperaturePhase(setting, parameters, VolumeTracer(setting))
        from ddgcli.models.fluid.tracer import SurfaceTracer

        return TemperaturePhase(setting, parameters, SurfaceTracer(setting.space, setting.tracing))

    def push(setting: FluidSetting) -> Phase:
        return BuoyancyPhase(setting, parameters)

    return [PhaseRequest(temperature), PhaseRequest(push)]


EFFECT = Effect("buoyancy", BuoyancySection, build, "a tracer, and two solves per step", ("fluid",))
