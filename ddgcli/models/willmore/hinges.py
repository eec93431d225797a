"""Dihedral angles at the inner edges, and how they change with the vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.hinges import HingeFrame, angle_slopes, hinge_frame, hinge_sides, hinges
from ddgcli.mesh.scatter import sum_columns_by_index
from ddgcli.mesh.topology import Topology


@dataclass(frozen=True, eq=False)
class Hinges:
    """The inner edges of a surface with their two faces.

    Parameters
    ----------
    face : (h, 2) ndarray of int
    vertex : (h, 4) ndarray of int
        Tail, head, apex of each face.
    """

    face: NDArray[np.int64]
    vertex: NDArray[np.int64]

    @classmethod
    def of(cls, topology: Topology) -> Hinges:
        """All inner edges."""
        side, other = hinge_sides(topology)
        return cls(np.stack([side // 3, other // 3], axis=1), hinges(topology))

    def bent(self, points: NDArray) -> BentHinges:
        """Lengths and angles at given positions."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return BentHinges(self, len(points), hinge_frame(points, self.vertex))


@dataclass(frozen=True, eq=False)
class BentHinges:
    """Hinges at given positions.

    Parameters
    ----------
    hinges : Hinges
    n_vertices : int
    shape : HingeFrame
    """

    hinges: Hinges
    n_vertices: int
    shape: HingeFrame

    def gradient(self, by_angle: NDArray, by_length: NDArray) -> NDArray[np.float64]:
        """(n, 3) derivative by the points of a function of angles and lengths with these derivatives."""
        tail, head, *apex = (by_angle * slope for slope in angle_slopes(self.shape))
        stretch = by_length * self.shape.u
        columns = [tail - stretch, head + stretch, *apex]
        return sum_columns_by_index(self.hinges.vertex, columns, self.n_vertices)
