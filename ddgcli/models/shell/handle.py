"""Effect `handle`: vertices that follow key frames."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from ddgcli.mechanics.terms import FixedCoordinates, PrescribedMotion
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.key_frames import RigidKeyFrames, turns
from ddgcli.scenes.key_frames import require_ascending, require_from_rest
from ddgcli.scenes.sections import Section
from ddgcli.scenes.shapes import Rotation
from ddgcli.scenes.units import quantity, vector
from ddgcli.simulation.effects import Effect


class Handle(Section):
    """Move vertices as a rigid body along key frames."""

    object: str | None = Field(None, description="shell; needed where the scene has several")
    name: str | None = Field(None, description="key in results.reaction_forces; default handle")
    vertices: list[int] | None = Field(None, description="vertex indices")
    box: list[vector("m")] | None = Field(
        None, min_length=2, max_length=2, description="two opposite corners, [[x, y, z], [x, y, z]]"
    )
    times: list[quantity("s")] = Field(min_length=2, description="of the key frames, ascending")
    positions: list[vector("m")] | None = Field(
        None, description="displacement of the centre at each key frame; the first is [0, 0, 0]"
    )
    rotations: list[Rotation] | None = Field(
        None, description="orientation at each key frame about the centre; the first has degrees = 0"
    )
    center: vector("m", "centre of the rotations; default: mean of the vertices") | None = None
    interpolation: Literal["linear", "smooth"] = Field(
        "smooth", description="smooth: velocity and acceleration vanish at the key frames"
    )

    @field_validator("times")
    @classmethod
    def _ascending(cls, times: list[float]) -> list[float]:
        require_ascending(times)
        return times

    @model_validator(mode="after")
    def _complete(self) -> Handle:
        require_from_rest(self.times, self.positions, self.rotations)
        if self.center is not None and self.rotations is None:
            raise ValueError("center needs rotations")
        return self


def build(parameters: Handle, context: ShellContext) -> list[PrescribedMotion]:
    vertices = context.selection(parameters.vertices, parameters.box, ("effects", "handle"))
    for name, terms in context.terms.items():
        for term in terms:
            if isinstance(term, FixedCoordinates | PrescribedMotion):
                shared = vertices[term.mask[vertices].any(axis=1)]
                if len(shared):
                    raise ValueError(
                        f"vertex {shared[0]} already belongs to a {name}; leave it out of one of them"
                    )
    points = np.asarray(context.mesh.points)[vertices]
    count = len(parameters.times)
    still = [Rotation(axis=(0.0, 0.0, 1.0), degrees=0.0)] * count
    center = _middle(vertices, context) if parameters.center is None else np.array(parameters.center)
    motion = RigidKeyFrames(
        points, center, np.array(parameters.times),
        np.zeros((count, 3)) if parameters.positions is None else np.array(parameters.positions),
        turns(parameters.rotations or still), parameters.interpolation == "smooth",
    )  # fmt: skip
    mask = np.zeros((context.mesh.n_vertices, 3), dtype=bool)
    mask[vertices] = True
    return [PrescribedMotion(mask, motion)]


def _middle(vertices: NDArray, context: ShellContext) -> NDArray[np.float64]:
    """Mean of the vertices at the start; copies of a split vertex count once."""
    if context.input_vertex is not None:
        _, first = np.unique(context.input_vertex[vertices], return_index=True)
        vertices = vertices[first]
    return np.asarray(context.mesh.points)[vertices].mean(axis=0)


EFFECT = Effect(
    "handle", Handle, build, "none: moved coordinates leave the system", ("shell",), repeatable=True
)
