"""Effect `boundary`: walls, inflow and outflow along the boundary of the mesh."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import logging
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from ddgcli.errors import MeshError, counted
from ddgcli.models.fluid.boundary_motion import depends_on_time
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.effect_parts import BoundaryPart
from ddgcli.models.fluid.flow_mesh import harmonic_count
from ddgcli.models.fluid.phases import FluidSetting, PhaseRequest
from ddgcli.scenes.expressions import parse
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import parse_quantity
from ddgcli.simulation.effects import Effect

log = logging.getLogger("ddgcli")

VELOCITY_KINDS = ("wall", "inflow")


def _flux(value: Any) -> Any:
    """A number in m^2/s, or the text of an expression in t."""
    if isinstance(value, str) and depends_on_time(value):
        parse(value, ("t",))
        return value
    return parse_quantity(value, "m^2/s")


FluxInTime = Annotated[
    float | str,
    BeforeValidator(_flux),
    Field(
        description="leaves through an outflow, spread evenly, a number or an expression in t; default: what "
        "flows in",
        json_schema_extra={"unit": "m^2/s"},
    ),
]


class BoundarySection(Section):
    """Condition on a part of the boundary; the first section whose `where` holds wins."""

    kind: Literal["free-slip", "no-slip", "wall", "inflow", "outflow"] = Field(
        "free-slip", description="no friction, no speed, a wall in motion, or a side that the fluid crosses"
    )
    velocity: list[str | float] | None = Field(
        None, description="of a wall, inflow or outflow [m/s]: three numbers or expressions in x, y, z, t"
    )
    flux: FluxInTime | None = None
    where: str | None = Field(
        None,
        description="expression in x, y, z: the part where it is not 0; default the rest",
    )
    obstacle: str | None = Field(None, description="object of role obstacle: the boundary that it cuts")
    object: str | None = Field(None, description="fluid; by default all")

    @model_validator(mode="after")
    def _check_keys(self) -> BoundarySection:
        if self.velocity is not None and len(self.velocity) != 3:
            raise ValueError("velocity takes three numbers or expressions")
        if self.velocity is not None and self.kind == "free-slip":
            raise ValueError("velocity is that of a no-slip wall; a free-slip wall moves nothing")
        if self.velocity is None and self.kind in VELOCITY_KINDS:
            raise ValueError(f"kind {self.kind} needs velocity: three numbers or expressions")
        if self.flux is not None and (self.kind != "outflow" or self.velocity is not None):
            raise ValueError("flux is that of an outflow without velocity; take it out")
        for text in self.velocity or []:
            parse(str(text), ("x", "y", "z", "t"))
        if self.where is not None and depends_on_time(self.where):
            raise ValueError(
                "parts of the boundary are the same at any time: put t of `where` into `velocity`"
            )
        return self


def build(parameters: BoundarySection, context: FluidContext) -> list[BoundaryPart | PhaseRequest]:
    if not context.is_volume and context.mesh.topology.is_closed:
        raise MeshError("the surface has no boundary; take the effect out")
    if parameters.obstacle is not None and parameters.obstacle not in context.obstacles:
        names = ", ".join(context.obstacles) or "none"
        raise ValueError(f"no obstacle {parameters.obstacle!r} cuts {context.name!r} (there: {names})")
    velocity = None if parameters.velocity is None else [str(text) for text in parameters.velocity]
    boundary_part = BoundaryPart(
        parameters.kind, velocity, parameters.flux, parameters.where, parameters.obstacle
    )
    return [boundary_part, *([PhaseRequest(require_friction)] if parameters.kind != "free-slip" else [])]


def require_friction(setting: FluidSetting) -> None:
    """Refuse walls without slip in a fluid without friction; report harmonic flows that they would drive."""
    if "viscosity" not in setting.effects:
        raise ValueError(
            "kinds other than free-slip need the effect viscosity with nu > 0; without it there is free slip"
        )
    if setting.context.is_volume:
        return
    count = harmonic_count(setting.space.mesh)
    if count and not len(setting.space.harmonic):
        log.warning(
            "%s has %s (round its handles and holes), which walls without slip may drive; the scene leaves "
            "them out, and the flow may be wrong: add the effect harmonic = {}",
            setting.context.name, counted(count, "harmonic flow", "harmonic flows"),
        )  # fmt: skip


EFFECT = Effect(
    "boundary", BoundarySection, build, "none; other than free-slip a larger viscous system", ("fluid",),
    repeatable=True,
)  # fmt: skip
