"""Obstacles of shells: planes, balls, boxes, cylinders and meshes, at rest or in rigid motion."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from ddgcli.models.shell.key_frames import Pose, RigidKeyFrames, require_ascending, require_from_rest, turns
from ddgcli.models.shell.surfaces import BoxGap, CylinderGap, PlaneGap, SphereGap, Surface
from ddgcli.scenes.scene import ObjectSection
from ddgcli.scenes.shapes import Box, Cylinder, Plane, Rotation, Sphere, require_one_shape, rotation_matrix
from ddgcli.scenes.units import quantity, vector

SHAPES = ("plane", "sphere", "box", "cylinder", "mesh")


class Obstacle(ObjectSection):
    """A rigid body that no shell moves: it stands still, follows key frames or moves steadily."""

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
    def _sound(self) -> Obstacle:
        require_one_shape(self, SHAPES)
        if self.scale is not None and self.mesh is None:
            raise ValueError("scale is for a mesh; write the size of the shape itself")
        if self.times is not None:
            require_from_rest(self.times, self.positions, self.rotations)
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
        """Whether it ever moves."""
        steady = (self.velocity or (0.0,)), (self.angular_velocity or (0.0,))
        return self.times is not None or any(any(v) for v in steady)


@dataclass(frozen=True, eq=False)
class SteadyMotion:
    """Constant velocity of the centre and constant angular velocity about it, from time 0."""

    center: NDArray[np.float64]
    velocity: NDArray[np.float64]
    spin: NDArray[np.float64]

    def pose(self, time: float) -> Pose:
        """Placement at a time in s."""
        rate = float(np.linalg.norm(self.spin))
        turn = rotation_matrix(self.spin, rate * time) if rate > 0 else np.eye(3)
        center = self.center + time * self.velocity
        return Pose(turn, center - turn @ self.center, self.velocity, self.spin, center)


@dataclass(frozen=True, eq=False)
class PlacedMotion:
    """Motion of an obstacle from the coordinates in which its shape is written.

    Parameters
    ----------
    rotation : (3, 3) ndarray
    shift : (3,) ndarray
        Place the shape at the start.
    motion : RigidKeyFrames or SteadyMotion, optional
        Moves the placed shape.
    """

    rotation: NDArray[np.float64]
    shift: NDArray[np.float64]
    motion: Any = None

    def pose(self, time: float) -> Pose:
        """Placement at a time in s."""
        if self.motion is None:
            return Pose(self.rotation, self.shift, np.zeros(3), np.zeros(3), self.shift)
        pose = self.motion.pose(time)
        return replace(
            pose, rotation=pose.rotation @ self.rotation, shift=pose.rotation @ self.shift + pose.shift
        )


def surface_of(obstacle: Obstacle) -> Surface:
    """The closed-form surface of an obstacle that has one, as written."""
    if obstacle.plane is not None:
        return PlaneGap(obstacle.plane.point, obstacle.plane.normal)
    if obstacle.sphere is not None:
        return SphereGap(obstacle.sphere.center, obstacle.sphere.radius)
    if obstacle.box is not None:
        return BoxGap(obstacle.box.corner, obstacle.box.size)
    cylinder: Any = obstacle.cylinder
    return CylinderGap(cylinder.start, cylinder.end, cylinder.radius)


def motion_of(obstacle: Obstacle, middle: NDArray) -> PlacedMotion:
    """Motion of an obstacle whose middle, in the coordinates as written, is given."""
    turn = np.eye(3)
    if obstacle.rotation is not None:
        turn = rotation_matrix(obstacle.rotation.axis, np.radians(obstacle.rotation.degrees))
    shift = np.array(obstacle.position, dtype=float)
    if not obstacle.moving:
        return PlacedMotion(turn, shift)
    center = turn @ middle + shift if obstacle.center is None else np.array(obstacle.center, dtype=float)
    if obstacle.times is None:
        velocity = np.array(obstacle.velocity or (0.0, 0.0, 0.0), dtype=float)
        spin = np.array(obstacle.angular_velocity or (0.0, 0.0, 0.0), dtype=float)
        return PlacedMotion(turn, shift, SteadyMotion(center, velocity, spin))
    count = len(obstacle.times)
    still = [Rotation(axis=(0.0, 0.0, 1.0), degrees=0.0)] * count
    displacements = np.zeros((count, 3)) if obstacle.positions is None else np.array(obstacle.positions)
    frames = RigidKeyFrames(
        np.zeros((0, 3)), center, np.array(obstacle.times), displacements,
        turns(obstacle.rotations or still), obstacle.interpolation != "linear",
    )  # fmt: skip
    return PlacedMotion(turn, shift, frames)


def middle_of(obstacle: Obstacle) -> NDArray[np.float64]:
    """Middle of a closed-form obstacle as written: of a plane, its point."""
    if obstacle.plane is not None:
        return np.array(obstacle.plane.point, dtype=float)
    if obstacle.sphere is not None:
        return np.array(obstacle.sphere.center, dtype=float)
    if obstacle.box is not None:
        return np.array(obstacle.box.corner) + 0.5 * np.array(obstacle.box.size)
    cylinder: Any = obstacle.cylinder
    return 0.5 * (np.array(cylinder.start) + np.array(cylinder.end))


def displacement_row(obstacle: Obstacle, middle: NDArray, time: float) -> NDArray[np.float64]:
    """(12,) rotation by rows, then translation, that take the obstacle from its start to a time in s."""
    motion = motion_of(obstacle, middle).motion
    if motion is None:
        return np.concatenate([np.eye(3).ravel(), np.zeros(3)])
    pose = motion.pose(time)
    return np.concatenate([pose.rotation.ravel(), pose.shift])
