"""Surfaces with a closed-form distance under a rigid motion: the obstacles that move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.solids import Surface
from ddgcli.models.shell.key_frames import Pose


class PosedSurface:
    """A surface in the pose of a rigid motion; the methods are those of `Surface`."""

    def __init__(self, surface: Surface, pose: Pose) -> None:
        self.surface, self.pose = surface, pose

    def gap(self, x: NDArray) -> tuple[NDArray, NDArray]:
        distance, gradient = self.surface.gap(self.pose.body(x))
        return distance, gradient @ self.pose.rotation.T

    def hessian(self, x: NDArray) -> NDArray[np.float64]:
        turn = self.pose.rotation
        return turn @ self.surface.hessian(self.pose.body(x)) @ turn.T

    def reach(self, x: NDArray, move: NDArray) -> NDArray[np.float64]:
        return self.surface.reach(self.pose.body(x), move @ self.pose.rotation)
