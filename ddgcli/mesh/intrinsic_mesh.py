"""Intrinsic triangulation: a surface given by its edge lengths."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.frozen import FrozenArrays, frozen
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class IntrinsicMesh(FrozenArrays):
    """Triangulation with side lengths; intrinsic operators accept it like a TriangleMesh.

    Parameters
    ----------
    topology : Topology
        May be a Delta-complex (self-edges, several edges between two vertices).
    side_length : (m, 3) ndarray of float64
        Length of side j, from corner j to corner j+1; the two sides of an edge hold the same number.
    points : (n, 3) ndarray of float64, optional
        Positions of the vertices on the input surface, for output only; operators never read them.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> intrinsic = ddg.intrinsic_delaunay(ddg.torus(12, 6))
    >>> isinstance(intrinsic, ddg.IntrinsicMesh), intrinsic.side_length.shape
    (True, (144, 3))
    """

    topology: Topology
    side_length: NDArray[np.float64]
    points: NDArray[np.float64] | None = field(default=None)

    def __repr__(self) -> str:
        return f"IntrinsicMesh({self.n_vertices} vertices, {self.n_faces} faces)"

    def __post_init__(self) -> None:
        object.__setattr__(self, "side_length", frozen(np.asarray(self.side_length, dtype=np.float64)))
        if self.points is not None:
            object.__setattr__(self, "points", frozen(self.points))

    @property
    def faces(self) -> NDArray[np.int64]:
        """(m, 3) corners of the faces."""
        return self.topology.faces

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return self.topology.n_vertices

    @property
    def n_faces(self) -> int:
        """Number of faces."""
        return self.topology.n_faces


SurfaceMesh = TriangleMesh | IntrinsicMesh  # meshes with a topology and side lengths
