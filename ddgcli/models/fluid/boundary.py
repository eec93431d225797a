"""Effect `boundary`: what the fluid meets at the edge of the surface; nothing crosses it."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ddgcli.errors import MeshError
from ddgcli.evolve.effects import Effect
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.parts import Walls
from ddgcli.models.scene import Section


class BoundarySection(Section):
    """Walls along every boundary loop."""

    kind: Literal["free-slip", "no-slip"] = Field("free-slip", description="no friction, or no speed, there")
    object: str | None = Field(None, description="fluid; by default all")


def build(parameters: BoundarySection, context: FluidContext) -> list[Walls]:
    if context.mesh.topology.is_closed:
        raise MeshError("the surface has no boundary; take the effect out")
    return [Walls(parameters.kind == "no-slip")]


EFFECT = Effect("boundary", BoundarySection, build, "none; no-slip a larger viscous system", ("fluid",))
