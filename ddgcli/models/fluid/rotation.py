"""Effect `rotation`: the Coriolis force in a frame that turns with the surface.

The force - f n x u with f = 2 Omega . n, n the unit normal: on a sphere that turns about its axis f grows
with the sine of the latitude. It does no work: integrators that conserve energy have it in their own rate of
change; for the others it is a step of its own. The centrifugal force is a gradient and moves nothing.
"""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid.conservative import (
    RK4_LIMIT,
    Rates,
    coriolis_along_boundary,
    fourth_order_step,
    rotational_rates,
)
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Phase, PhaseRequest, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import vector
from ddgcli.simulation.effects import Effect
from ddgcli.simulation.model import StepRejected


class RotationSection(Section):
    """Turning of the frame in which the surface is at rest."""

    angular_velocity: vector("rad/s", "of the frame, along its axis")
    object: str | None = Field(None, description="fluid; by default all")


MAX_ANGLE = 0.25  # of a wave in one Runge-Kutta step: it loses 3e-6 of its energy at most


class Coriolis(FlowPhase):
    """Runge-Kutta steps of order 4 of the Coriolis force alone, where the transport does not have it."""

    effect = "rotation"

    def __init__(self, setting: FluidSetting, angular_velocity: NDArray) -> None:
        self.setting = setting
        self.parameter = setting.coriolis = 2.0 * vertex_normals(setting.context) @ angular_velocity

    def _rate(self, vorticity: NDArray, coefficients: NDArray, _: float = 0.0) -> Rates:
        space = self.setting.space
        flux = space.side_flux(space.stream_function(vorticity), coefficients)
        return *rotational_rates(space, self.parameter, flux, self.setting.evolve_harmonic), flux

    def boundary_integrals(self, state: FluidState, time: float) -> NDArray[np.float64]:
        """(s, 2) its integrals along the boundary sides, for tail and head."""
        space = self.setting.space
        return coriolis_along_boundary(space, self.parameter, space.flow(state).side_flux)

    def advance(self, step: Step, state: FluidState) -> FluidState:
        if self.setting.transport_takes_coriolis:
            return state
        fastest = step.dt * float(np.abs(self.parameter).max(initial=0.0))  # no wave turns faster than f
        if not fastest <= RK4_LIMIT:
            raise StepRejected("rotation", value=fastest)
        flow, count = (state["vorticity"], state["coefficients"]), max(1, math.ceil(fastest / MAX_ANGLE))
        for _ in range(count):
            flow = fourth_order_step(self._rate, *flow, step.dt / count, self._rate(*flow))
        return state.replaced(vorticity=flow[0], coefficients=flow[1])


def vertex_normals(context: FluidContext) -> NDArray[np.float64]:
    """(n, 3) unit normals: of polynomial fits, so that slopes of f converge; the z axis on periodic grids."""
    mesh = context.mesh
    if context.period.any():
        return np.tile([0.0, 0.0, 1.0], (mesh.n_vertices, 1))
    from ddgcli.algorithms.curvature.quadric import fitted_normals

    if not isinstance(mesh, TriangleMesh):  # flipped edges: fits only take the vertices, joined by chords
        mesh = TriangleMesh.from_arrays(context.points, mesh.faces)
    return fitted_normals(mesh)


def build(parameters: RotationSection, context: FluidContext) -> list[PhaseRequest]:
    def make(setting: FluidSetting) -> Phase:
        return Coriolis(setting, np.array(parameters.angular_velocity))

    return [PhaseRequest(make)]


EFFECT = Effect(
    "rotation",
    RotationSection,
    build,
    "none with conservative and energy, else eight solves per step or more",
    ("fluid",),
)
