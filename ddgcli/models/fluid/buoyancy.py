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

from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.force import GAUSS_SHARES, BoundarySides, accelerated
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Phase, PhaseRequest, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.tracer import Source, TracerPhase
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
    object: str | None = Field(None, description="fluid; by default all")


class TemperaturePhase(TracerPhase):
    """The temperature: it diffuses and is heated for half of the step, before it is carried and after."""

    def __init__(self, setting: FluidSetting, parameters: BuoyancySection, tracer: Any) -> None:
        source = None if parameters.source is None else Source(setting.context.points, parameters.source)
        super().__init__("buoyancy", setting.context.scalar(parameters.temperature, ARRAY), tracer, source)
        self.mass = setting.space.mass
        self.free = np.setdiff1d(np.flatnonzero(self.mass > 0), tracer.entering)
        self.conduction: Decay | None = None
        if parameters.diffusivity > 0 and len(self.free):
            self.conduction = self._conduction(setting, parameters.diffusivity)

    def start(self) -> dict[str, NDArray]:
        return {ARRAY: self.amount}

    def advance(self, step: Step, state: FluidState) -> FluidState:
        values = self._conducted(state[ARRAY], 0.5 * step.dt)
        values = self.carried(step, state, values)
        return state.with_passive(**{ARRAY: self._conducted(values, 0.5 * step.dt)})

    def _conduction(self, setting: FluidSetting, diffusivity: float) -> Decay:
        """Diffusion at the vertices at which no fluid enters; the others have the values of the start."""
        from ddgcli.models.fluid.diffusion import Decay
        from ddgcli.models.fluid.volume_effects import vertex_stiffness

        stiffness = vertex_stiffness(setting.volume) if setting.context.is_volume else setting.space.stiffness
        rows, entering = (diffusivity * stiffness).tocsr()[self.free], np.array(self.amount)
        entering[self.free] = 0.0
        return Decay(diags_array(self.mass[self.free]).tocsr(), rows[:, self.free], rows @ entering)

    def _conducted(self, values: NDArray, dt: float) -> NDArray[np.float64]:
        if self.conduction is None:
            return values
        after = np.array(values)
        after[self.free] = self.conduction.step(values[self.free], dt)
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
        self.boundary = BoundarySides(setting)

    def advance(self, step: Step, state: FluidState) -> FluidState:
        warmth = state[ARRAY][self.boundary.ends] @ GAUSS_SHARES.T
        along = self.boundary.integrals(warmth[:, :, None] * self.push)
        change = self.cell_acceleration(state, step.time)
        return accelerated(self.setting, state, step.dt * change, step.dt * along)

    def cell_acceleration(self, state: FluidState, time: float) -> NDArray[np.float64]:
        """(m, 3) what it adds to the velocity of the cells a second."""
        warmth = state[ARRAY][self.setting.context.cells].mean(axis=1)
        return warmth[:, None] * self.push


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
