"""Section of an obstacle: plane, ball, box, cylinder or mesh, at rest or in rigid motion."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator, model_validator

from ddgcli.scenes.key_frames import require_ascending, require_from_rest
from ddgcli.scenes.scene import ObjectSection
from ddgcli.scenes.shapes import Box, Cylinder, Plane, Rotation, Sphere, require_one_shape
from ddgcli.scenes.units import quantity, vector

SHAPES = ("plane", "sphere", "box", "cylinder", "mesh")


class Obstacle(ObjectSection):
    """A rigid body that no shell moves: it is at rest, follows key frames or moves steadily."""

    role: Literal["obstacle"]
    plane: Plane | None = None
    sphere: Sphere | None = None
    box: Box | None = None
    cylinder: Cylinder | None = None
    mesh: str | None = Field(None, description="mesh file, relative to the scene; needs the extra contact")
    scale: quantity("", "of a mesh: factor before rotation", gt=0) | None = None
    rotation: Rotation | None = None
    position: vector("m", "where the obstacle's origin goes") = (0.0, 0.0, 0.0)
    times: list[quantity("s")] | None = Field(None, min_length=2, description="of key frames, ascending")
    positions: list[vector("m")] | None = Field(
        None, description="displacement at each key frame; the first is [0, 0, 0]"
    )
    rotations: list[Rotation] | None = Field(
        None, description="orientation at each key frame about the centre; the first has degrees = 0"
    )
    center: vector("m", "centre of the rotations; default: the middle of the obstacle") | None = None
    interpolation: Literal["linear", "smooth"] | None = Field(
        None, description="smooth (default): velocity and acceleration vanish at the key frames"
    )
    velocity: vector("m/s", "steady velocity of the centre") | None = None
    angular_velocity: vector("rad/s", "steady rotation about the centre") | None = None

    @field_validator("times")
    @classmethod
    def _ascending(cls, times: list[float] | None) -> list[float] | None:
        if times is not None:
            require_ascending(times)
        return times

    @model_validator(mode="after")
    def _checked(self) -> Obstacle:
        require_one_shape(self, SHAPES)
        if self.scale is not None and self.mesh is None:
            raise ValueError("scale is for a mesh; write the size of the shape itself")
        if self.times is not None:
            require_from_rest(self.times, self.positions, self.rotations)
            if self.center is not None and self.rotations is None:
                raise ValueError("center needs rotations or angular_velocity")
            if self.velocity is not None or self.angular_velocity is not None:
                raise ValueError("give either key frames (times) or velocity and angular_velocity")
            return self
        unused = [k for k in ("positions", "rotations", "interpolation") if getattr(self, k) is not None]
        if unused:
            raise ValueError(f"{unused[0]} needs times")
        if self.center is not None and self.angular_velocity is None:
            raise ValueError("center needs rotations or angular_velocity")
        return self

    @property
    def moving(self) -> bool:
        """Whether the obstacle ever moves."""
        steady = (self.velocity or (0.0,)), (self.angular_velocity or (0.0,))
        return self.times is not None or any(any(v) for v in steady)
