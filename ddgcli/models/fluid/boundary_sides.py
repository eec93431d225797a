"""Integrals along the boundary sides of a surface, which close the cells of its vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.phases import FluidSetting

GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(2)
GAUSS_SHARES = 0.5 + 0.5 * np.stack([-GAUSS_POINTS, GAUSS_POINTS], axis=1)  # of tail and head, (2, 2)


class BoundarySides:
    """Integrals of a velocity or an acceleration along the boundary sides of a surface.

    A cell at the boundary is closed by its halves of them. With the vectors of the faces there, which are
    off by half a cell, a gradient makes vorticity in the corners of walls that no mesh lowers.

    Parameters
    ----------
    context : FluidContext
    ends : (s, 2) ndarray of int64
        Tail and head of every side.
    """

    def __init__(self, context: FluidContext, ends: NDArray[np.int64]) -> None:
        self.ends = ends
        start = context.points[self.ends[:, 0]]
        self.side = context.unwrapped(context.points[self.ends[:, 1]] - start)
        self.points = start[:, None] + GAUSS_SHARES[:, 1, None] * self.side[:, None]  # (s, 2, 3)

    @classmethod
    def of(cls, setting: FluidSetting) -> BoundarySides:
        """Those of a surface; none of a volume."""
        volume = setting.context.is_volume
        return cls(
            setting.context, np.zeros((0, 2), dtype=np.int64) if volume else setting.space.boundary_sides[2]
        )

    def integrals(self, vectors: NDArray) -> NDArray[np.float64]:
        """(s, 2) of vectors (s, 2, 3) at the points, weighted by the hat functions of tail and head."""
        weight = 0.5 * GAUSS_WEIGHTS[:, None] * GAUSS_SHARES
        return np.einsum("sgk,sk,gj->sj", vectors, self.side, weight)
