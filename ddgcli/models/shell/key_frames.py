"""Rigid motions along key frames, with linear or smooth interpolation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.vectors import row_cross
from ddgcli.scenes.shapes import Rotation, rotation_matrix

PARALLEL_TOLERANCE = 1e-12  # 1 - cosine of the angle below which two axes count as the same


@dataclass(frozen=True, eq=False)
class Turn:
    """Rotation between two key frames: by up to `angle` rad about `axis`, after the matrix `start`."""

    axis: NDArray[np.float64]
    angle: float
    start: NDArray[np.float64]


def turns(rotations: list[Rotation]) -> list[Turn]:
    """Rotations between successive key frames.

    If two key frames share an axis (or have opposite ones), the angle is the difference of their degrees,
    which may exceed half a revolution; otherwise it is the shortest rotation between the two orientations.

    Parameters
    ----------
    rotations : list of Rotation

    Returns
    -------
    list of Turn
        One for each pair of successive key frames.
    """
    result = []
    for before, after in zip(rotations, rotations[1:]):
        start = rotation_matrix(before.axis, np.radians(before.degrees))
        a, b = (np.array(r.axis) / np.linalg.norm(r.axis) for r in (before, after))
        if before.degrees == 0 or after.degrees == 0 or 1 - abs(a @ b) <= PARALLEL_TOLERANCE:
            axis = a if after.degrees == 0 else b
            # an angle about the opposite axis is negative
            degrees = np.copysign(before.degrees, before.degrees * (axis @ a))
            result.append(Turn(axis, float(np.radians(after.degrees - degrees)), start))
            continue
        relative = rotation_matrix(after.axis, np.radians(after.degrees)) @ start.T
        sine = 0.5 * np.array([relative[2, 1] - relative[1, 2], relative[0, 2] - relative[2, 0],
                               relative[1, 0] - relative[0, 1]])  # fmt: skip
        angle = float(np.arctan2(np.linalg.norm(sine), 0.5 * (np.trace(relative) - 1)))
        if np.linalg.norm(sine) > 0:
            axis = sine / np.linalg.norm(sine)
        else:  # no rotation, or half a revolution: the axis is the eigenvector of the eigenvalue 1
            axis = np.linalg.svd(relative - np.eye(3))[2][-1]
        result.append(Turn(axis, angle, start))
    return result


@dataclass(frozen=True, eq=False)
class Pose:
    """Position and velocity of a rigid body, whose points p are at x = rotation p + shift.

    Parameters
    ----------
    rotation : (3, 3) ndarray
    shift : (3,) ndarray
        In m.
    velocity, spin : (3,) ndarray
        Velocity of the point `center` in m/s, and angular velocity in rad/s.
    center : (3,) ndarray
        In m.
    """

    rotation: NDArray[np.float64]
    shift: NDArray[np.float64]
    velocity: NDArray[np.float64]
    spin: NDArray[np.float64]
    center: NDArray[np.float64]

    def points(self, p: NDArray) -> NDArray[np.float64]:
        """Positions of (n, 3) points of the body."""
        return p @ self.rotation.T + self.shift

    def body(self, x: NDArray) -> NDArray[np.float64]:
        """(n, 3) coordinates in the body of the points at x."""
        return (x - self.shift) @ self.rotation

    def velocities(self, x: NDArray) -> NDArray[np.float64]:
        """(n, 3) velocities of the body at the positions x."""
        return self.velocity + row_cross(self.spin, x - self.center)


@dataclass(frozen=True, eq=False)
class RigidKeyFrames:
    """Rigid motion of points along key frames; at rest before the first and after the last.

    Parameters
    ----------
    points : (k, 3) ndarray
        Positions at the start.
    center : (3,) ndarray
        Centre of the rotations.
    times : (f,) ndarray
        In s, ascending.
    displacements : (f, 3) ndarray
        Displacement of the centre at each key frame, in m.
    rotations : list of Turn
        One for each pair of successive key frames.
    smooth : bool
        Whether velocity and acceleration vanish at the key frames (interpolation by 10 u^3 - 15 u^4 + 6 u^5).
    """

    points: NDArray[np.float64]
    center: NDArray[np.float64]
    times: NDArray[np.float64]
    displacements: NDArray[np.float64]
    rotations: list[Turn]
    smooth: bool

    def __call__(self, time: float) -> tuple[NDArray, NDArray, NDArray]:
        """(k, 3) positions, velocities and accelerations at a time in s."""
        s, ds, dds, k = self._progress(time)
        step, turn = self.displacements[k + 1] - self.displacements[k], self.rotations[k]
        rotation = rotation_matrix(turn.axis, s * turn.angle) @ turn.start
        arm = (self.points - self.center) @ rotation.T
        omega, alpha = ds * turn.angle * turn.axis, dds * turn.angle * turn.axis
        speed = row_cross(omega, arm)
        x = self.center + self.displacements[k] + s * step + arm
        return x, ds * step + speed, dds * step + row_cross(alpha, arm) + row_cross(omega, speed)

    def pose(self, time: float) -> Pose:
        """Placement of the body at a time in s."""
        s, ds, _, k = self._progress(time)
        step, turn = self.displacements[k + 1] - self.displacements[k], self.rotations[k]
        rotation = rotation_matrix(turn.axis, s * turn.angle) @ turn.start
        center = self.center + self.displacements[k] + s * step
        return Pose(rotation, center - rotation @ self.center, ds * step, ds * turn.angle * turn.axis, center)

    def _progress(self, time: float) -> tuple[float, float, float, int]:
        """Interpolation parameter in the interval k between key frames, its two time derivatives, and k."""
        t = self.times
        k = int(np.clip(np.searchsorted(t, time, side="right") - 1, 0, len(t) - 2))
        span = t[k + 1] - t[k]
        u = float((time - t[k]) / span)
        if not 0 <= u < 1:
            return (0.0 if u < 0 else 1.0), 0.0, 0.0, k
        if not self.smooth:
            return u, float(1 / span), 0.0, k
        s = u**3 * (10 - 15 * u + 6 * u * u)
        return s, float(30 * u**2 * (1 - u) ** 2 / span), float(60 * u * (1 - u) * (1 - 2 * u) / span**2), k
