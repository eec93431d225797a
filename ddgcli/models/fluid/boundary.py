"""Effect `boundary`: what the fluid meets at the edge of the surface; nothing crosses it."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import logging
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ddgcli.errors import MeshError
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.parts import Walls
from ddgcli.models.fluid.phases import Declared, FluidSetting
from ddgcli.models.fluid.surface_space import harmonic_count
from ddgcli.scenes.expressions import evaluate
from ddgcli.scenes.scene import Section
from ddgcli.simulation.effects import Effect

log = logging.getLogger("ddgcli")


class BoundarySection(Section):
    """Walls along every boundary loop."""

    kind: Literal["free-slip", "no-slip"] = Field("free-slip", description="no friction, or no speed, there")
    velocity: list[str | float] | None = Field(
        None, description="of a no-slip wall [m/s]: three numbers or expressions in x, y, z; along the wall"
    )
    where: str | None = Field(
        None, description="expression in x, y, z: the wall moves where it is not 0; by default everywhere"
    )
    object: str | None = Field(None, description="fluid; by default all")

    @model_validator(mode="after")
    def _moving(self) -> BoundarySection:
        if self.velocity is not None and len(self.velocity) != 3:
            raise ValueError("velocity takes three numbers or expressions")
        if self.velocity is not None and self.kind != "no-slip":
            raise ValueError("velocity is that of a no-slip wall; a free-slip wall moves nothing")
        if self.where is not None and self.velocity is None:
            raise ValueError("where says which part of the wall moves; give its velocity")
        return self


def build(parameters: BoundarySection, context: FluidContext) -> list[Walls | Declared]:
    if context.mesh.topology.is_closed:
        raise MeshError("the surface has no boundary; take the effect out")
    moving = None
    if parameters.velocity is not None:
        moving = wall_circulation(context, [str(text) for text in parameters.velocity], parameters.where)
    no_slip = parameters.kind == "no-slip"
    return [Walls(no_slip, moving), *([Declared(require_friction)] if no_slip else [])]


def require_friction(setting: FluidSetting) -> None:
    """Refuse walls without slip in a fluid without friction; report harmonic flows that they would drive."""
    if "viscosity" not in setting.effects:
        raise ValueError("kind no-slip needs the effect viscosity with nu > 0; without it there is free slip")
    count = harmonic_count(setting.space.mesh)
    if count and not len(setting.space.harmonic):
        log.warning(
            "%s has %d harmonic flows (round its handles and holes), which walls without slip drive; the "
            "scene leaves them out, and the flow is wrong: add the effect harmonic = {}",
            setting.context.name, count,
        )  # fmt: skip


def wall_circulation(context: FluidContext, velocity: list[str], where: str | None) -> NDArray[np.float64]:
    """(n,) what the moving wall adds to the circulation around the cells of its vertices.

    Half of every boundary side belongs to either end; the surface lies on the left.
    """
    mesh, points = context.mesh, context.points
    face, k = np.nonzero(mesh.topology.side_twin < 0)
    tail, head = mesh.faces[face, k], mesh.faces[face, NEXT[k]]
    side = context.unwrapped(points[head] - points[tail])
    place = dict(zip("xyz", (points[tail] + 0.5 * side).T))
    speed = np.stack([evaluate(text, place) for text in velocity], axis=1)
    if where is not None:
        speed = np.where(evaluate(where, place)[:, None] != 0, speed, 0.0)
    if not np.isfinite(speed).all():
        raise ValueError("the velocity of the wall is not finite everywhere on it")
    along = 0.5 * np.einsum("ij,ij->i", speed, side)
    if not along.any():
        log.warning("no part of the wall moves along itself: velocity or where is 0 at every boundary side")
    return sum_by_index(np.concatenate([tail, head]), np.tile(along, 2), mesh.n_vertices)


EFFECT = Effect("boundary", BoundarySection, build, "none; no-slip a larger viscous system", ("fluid",))
