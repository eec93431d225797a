"""Surfaces of obstacles and their rigid motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.solids import BoxGap, CylinderGap, PlaneGap, SphereGap, Surface
from ddgcli.mechanics.terms import TimedPositions
from ddgcli.models.shell.key_frames import Pose, RigidKeyFrames, turns
from ddgcli.models.shell.obstacle import Obstacle
from ddgcli.scenes.shapes import Rotation, rotation_matrix


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
    """Motion of an obstacle whose shape has coordinates of its own, those of its section or mesh file.

    Parameters
    ----------
    rotation : (3, 3) ndarray
    shift : (3,) ndarray
        Rotation and translation that place the shape at the start.
    motion : RigidKeyFrames or SteadyMotion, optional
        Motion of the placed shape; by default it rests.
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

    def travel(self, before: TimedPositions, after: TimedPositions) -> NDArray[np.float64]:
        """(n, 3) travel of the body between two times at vertices that are near it, in m.

        The mean of that of the points where the vertices are before, and of those where they are after: of a
        vertex that moves with the body, its own travel; at a vertex at rest on a wheel, along its surface.
        """
        (since, x), (until, y) = before, after
        start, end = self.pose(since), self.pose(until)
        return 0.5 * (end.points(start.body(x)) - x + y - start.points(end.body(y)))


def surface_of(obstacle: Obstacle) -> Surface:
    """Surface with a closed-form distance of a plane, sphere, box or cylinder, before it is placed.

    Parameters
    ----------
    obstacle : Obstacle

    Returns
    -------
    Surface
    """
    if obstacle.plane is not None:
        return PlaneGap(obstacle.plane.point, obstacle.plane.normal)
    if obstacle.sphere is not None:
        return SphereGap(obstacle.sphere.center, obstacle.sphere.radius)
    if obstacle.box is not None:
        return BoxGap(obstacle.box.corner, obstacle.box.size)
    cylinder: Any = obstacle.cylinder
    return CylinderGap(cylinder.start, cylinder.end, cylinder.radius)


def motion_of(obstacle: Obstacle, middle: NDArray) -> PlacedMotion:
    """Motion of an obstacle.

    Parameters
    ----------
    obstacle : Obstacle
    middle : (3,) ndarray
        Middle of the shape in its own coordinates: the default centre of rotation.

    Returns
    -------
    PlacedMotion
    """
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
    key_frames = RigidKeyFrames(
        np.zeros((0, 3)), center, np.array(obstacle.times), displacements,
        turns(obstacle.rotations or still), obstacle.interpolation != "linear",
    )  # fmt: skip
    return PlacedMotion(turn, shift, key_frames)


def middle_of(obstacle: Obstacle) -> NDArray[np.float64]:
    """Middle of a plane (its point), sphere, box or cylinder, before it is placed.

    Parameters
    ----------
    obstacle : Obstacle

    Returns
    -------
    (3,) ndarray of float64
        In m.
    """
    if obstacle.plane is not None:
        return np.array(obstacle.plane.point, dtype=float)
    if obstacle.sphere is not None:
        return np.array(obstacle.sphere.center, dtype=float)
    if obstacle.box is not None:
        return np.array(obstacle.box.corner) + 0.5 * np.array(obstacle.box.size)
    cylinder: Any = obstacle.cylinder
    return 0.5 * (np.array(cylinder.start) + np.array(cylinder.end))


def displacement_row(obstacle: Obstacle, middle: NDArray, time: float) -> NDArray[np.float64]:
    """Rigid displacement of an obstacle between the start and a given time.

    Parameters
    ----------
    obstacle : Obstacle
    middle : (3,) ndarray
        As in `motion_of`.
    time : float
        In s.

    Returns
    -------
    (12,) ndarray of float64
        Rotation by rows, then translation in m.
    """
    motion = motion_of(obstacle, middle).motion
    if motion is None:
        return np.concatenate([np.eye(3).ravel(), np.zeros(3)])
    pose = motion.pose(time)
    return np.concatenate([pose.rotation.ravel(), pose.shift])
