"""What a scene of `fluid-sim` may hold."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from ddgcli.scenes.scene import ObjectSection, SceneKind
from ddgcli.scenes.sections import Section
from ddgcli.scenes.shapes import Box, Cylinder, Sphere, SurfaceObject, require_one_shape
from ddgcli.scenes.units import vector
from ddgcli.simulation.effects import EffectTable

EFFECTS = EffectTable(
    "fluid-sim",
    {
        "initial": ("ddgcli.models.fluid.initial", "The flow at the start."),
        "viscosity": ("ddgcli.models.fluid.viscosity", "Friction within the fluid."),
        "harmonic": (
            "ddgcli.models.fluid.harmonic",
            "Harmonic flow around handles and holes, without vorticity.",
        ),
        "boundary": ("ddgcli.models.fluid.boundary", "Slip or friction at the edge of the surface."),
        "force": ("ddgcli.models.fluid.force", "An acceleration given by expressions in x, y, z, t."),
        "rotation": (
            "ddgcli.models.fluid.rotation",
            "Coriolis force of a rotating frame; depends on the latitude.",
        ),
        "buoyancy": (
            "ddgcli.models.fluid.buoyancy",
            "A temperature that drives the flow.",
        ),
        "pressure": ("ddgcli.models.fluid.pressure", "The pressure in every frame."),
        "dye": ("ddgcli.models.fluid.dye", "A passive concentration carried by the flow."),
        "particles": ("ddgcli.models.fluid.particles", "Points that move with the flow, and their paths."),
    },
)


# integrator -> dimension of the space -> module whose `transport(setting, parameters)` makes the phase
TRANSPORTS = {
    "circulation": {2: "ddgcli.models.fluid.circulation", 3: "ddgcli.models.fluid.volume_transport"},
    "conservative": {2: "ddgcli.models.fluid.conservative"},
    "covector": {2: "ddgcli.models.fluid.covector", 3: "ddgcli.models.fluid.volume_covector"},
    "energy": {2: "ddgcli.models.fluid.energy", 3: "ddgcli.models.fluid.volume_transport"},
}


# of volumes: as `conservative` on surfaces it keeps the energy and lets fluid cross the boundary
DEFAULT_VOLUME_INTEGRATOR = "energy"


# integrators that let fluid cross the boundary
OPEN_TRANSPORTS = ("conservative", "energy")


class Fluid(SurfaceObject):
    """An incompressible fluid on a surface, of unit density."""

    role: Literal["fluid"]
    triangulation: Literal["auto", "input", "delaunay"] = Field(
        "auto",
        description="of surfaces: auto flips edges towards Delaunay where many are far from it",
    )


class FluidObstacle(ObjectSection):
    """A solid that is cut out of the fluids."""

    role: Literal["obstacle"]
    mesh: str | None = Field(None, description="closed surface, relative to the scene")
    sphere: Sphere | None = None
    cylinder: Cylinder | None = None
    box: Box | None = None
    position: vector("m", "added to the shape's place") = (0.0, 0.0, 0.0)  # type: ignore[valid-type]
    refine: int = Field(0, ge=0, le=8, description="times that the cells near it are halved before the cut")

    @model_validator(mode="after")
    def _one_shape(self) -> FluidObstacle:
        require_one_shape(self, ("mesh", "sphere", "cylinder", "box"))
        if self.refine and self.mesh is not None:
            raise ValueError("refine takes sphere, cylinder or box; refine the fluid's mesh instead")
        return self


class CirculationParameters(Section):
    """Dual loops carried backwards: any step, some smoothing at each."""


class ConservativeParameters(Section):
    """Galerkin transport: energy, enstrophy and circulation kept up to the error in time."""

    scheme: Literal["rk4", "midpoint"] = Field(
        "rk4", description="explicit of order 4, or the implicit midpoint rule, which keeps both invariants"
    )


class EnergyParameters(Section):
    """Implicit midpoint rule: kinetic energy kept to round-off, reversible in time."""


class CovectorParameters(Section):
    """Velocity pulled back as a covector: the least error of waves and vortices at long steps."""


KIND = SceneKind(
    "fluid-sim",
    {"fluid": Fluid, "obstacle": FluidObstacle},
    {"circulation": CirculationParameters, "conservative": ConservativeParameters,
     "covector": CovectorParameters, "energy": EnergyParameters},
    "conservative",
    EFFECTS,
    elsewhere=dict.fromkeys(
        ("stretching", "bending", "gravity", "load", "wind", "damping", "pin", "handle",
         "plasticity", "fracture", "contact", "self_contact", "shell"), "shell-sim",
    ),
)  # fmt: skip
