"""Effect `dye`: a passive amount carried by the flow."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from pydantic import Field

from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.parts import Dye
from ddgcli.scenes.scene import Section
from ddgcli.simulation.effects import Effect


class DyeSection(Section):
    """Dye, followed backwards along the flow: it never leaves the bounds that it starts with."""

    amount: str = Field(description="at the start: vertex array of the mesh, .npy, or expression in x, y, z")
    object: str | None = Field(None, description="fluid; by default all")


def build(parameters: DyeSection, context: FluidContext) -> list[Dye]:
    return [Dye(context.scalar(parameters.amount, "dye"))]


EFFECT = Effect("dye", DyeSection, build, "two traces a vertex and step", ("fluid",))
