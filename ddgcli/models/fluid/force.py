"""Effect `force`: an acceleration of the fluid, as a function of space and time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from ddgcli.models.fluid.boundary_sides import BoundarySides
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.lost_forces import LostForceWarning
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Phase, PhaseRequest, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.scenes.expressions import evaluate
from ddgcli.scenes.sections import Section
from ddgcli.simulation.effects import Effect


class ForceSection(Section):
    """Force per mass; its part normal to the surface and its gradient part move nothing."""

    acceleration: list[str | float] = Field(
        description="three numbers or expressions in x, y, z, t [m/s^2]; along the surface"
    )
    object: str | None = Field(None, description="fluid; by default all")

    @field_validator("acceleration")
    @classmethod
    def _check_length(cls, texts: list[str | float]) -> list[str | float]:
        if len(texts) != 3:
            raise ValueError("takes three numbers or expressions")
        return texts


class ForcePhase(FlowPhase):
    """Circulation of the force around the vertices' cells, and its share in the harmonic flows."""

    effect = "force"
    is_force = True

    def __init__(self, setting: FluidSetting, acceleration: list[str]) -> None:
        self.setting, self.acceleration = setting, acceleration
        self.place = setting.context.face_points()
        self.boundary = BoundarySides.of(setting)
        self.lost = LostForceWarning(setting, self.effect)
        self.vectors(self.place, 0.0)  # refuses what cannot be evaluated

    def vectors(self, place: NDArray, time: float) -> NDArray[np.float64]:
        """(k, 3) acceleration at points (k, 3)."""
        variables = {**dict(zip("xyz", place.T)), "t": np.full(len(place), time)}
        return np.stack([evaluate(text, variables) for text in self.acceleration], axis=1)

    def advance(self, step: Step, state: FluidState) -> FluidState:
        time = step.time + 0.5 * step.dt
        along, change = self.boundary_integrals(state, time), self.vectors(self.place, time)
        self.lost.check(change)
        return accelerated(self.setting, state, step.dt * change, step.dt * along)

    def cell_acceleration(self, state: FluidState, time: float) -> NDArray[np.float64]:
        """(m, 3) what it adds to the velocity of the cells a second."""
        return self.vectors(self.place, time)

    def boundary_integrals(self, state: FluidState, time: float) -> NDArray[np.float64]:
        """(s, 2) its integrals along the boundary sides of a surface, for tail and head."""
        points = self.boundary.points
        return self.boundary.integrals(self.vectors(points.reshape(-1, 3), time).reshape(points.shape))


def accelerated(
    setting: FluidSetting, state: FluidState, change: NDArray, along_boundary: NDArray
) -> FluidState:
    """State of a flow with changes of velocity added, without their gradient component.

    Parameters
    ----------
    setting : FluidSetting
    state : FluidState
    change : (m, 3) ndarray of float64
        On cells.
    along_boundary : (s, 2) ndarray of float64
        Its integrals along the boundary sides of a surface. Where it is singular there, those of the cells.

    Returns
    -------
    FluidState
    """
    if setting.context.is_volume:
        return setting.volume.accelerated(state, change)
    space = setting.space
    velocity = setting.context.to_frames(space, change)
    finite = along_boundary if np.isfinite(along_boundary).all() else None
    vorticity, coefficients = space.of_face_velocity(velocity, finite)
    if not setting.evolve_harmonic:
        coefficients = np.zeros_like(coefficients)
    return state.replaced(
        vorticity=state["vorticity"] + vorticity, coefficients=state["coefficients"] + coefficients
    )


def build(parameters: ForceSection, context: FluidContext) -> list[PhaseRequest]:
    texts = [str(text) for text in parameters.acceleration]

    def make(setting: FluidSetting) -> Phase:
        return ForcePhase(setting, texts)

    return [PhaseRequest(make)]


EFFECT = Effect("force", ForceSection, build, "three expressions on the faces, twice a step", ("fluid",))
