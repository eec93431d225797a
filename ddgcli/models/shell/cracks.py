"""Cracks in surfaces: which edges open, and which vertices are split at open edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.hinges import hinge_frame, hinge_sides
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.sides import next_side
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import vector_length
from ddgcli.models.shell.hinge import wrapped


@dataclass(frozen=True, eq=False)
class SplitSurface:
    """Faces of a surface some of whose edges are open.

    Parameters
    ----------
    faces : (m, 3) ndarray of int
        In the order of the faces of the unbroken surface.
    origin : (k,) ndarray of int
        Index in the unbroken surface of each vertex; the first n vertices keep their index.
    corner : (k,) ndarray of int
        Flat index, 3 face + j, of one corner at each vertex.
    """

    faces: NDArray[np.int64]
    origin: NDArray[np.int64]
    corner: NDArray[np.int64]

    @property
    def n_pieces(self) -> int:
        """Number of connected components."""
        tail, head = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        return connected_labels(tail, head, len(self.origin))[0]


def split_surface(topology: Topology, opened: NDArray[np.bool_]) -> SplitSurface:
    """Split the vertices of a surface along some of its interior edges.

    Faces at a vertex stay connected across closed edges. Each such fan of faces has a vertex of its own, so a
    vertex splits where two open edges meet, or where one open edge meets the boundary. The fan of the first
    corner keeps the index of the vertex; new vertices follow in the order of their corners.

    Parameters
    ----------
    topology : Topology
        The surface; each interior edge has two faces of the same orientation.
    opened : (h,) ndarray of bool
        Whether each interior edge is open, in the order of `hinge_sides`.

    Returns
    -------
    SplitSurface
    """
    vertex = topology.faces.ravel()
    side, other = hinge_sides(topology)
    a = np.concatenate([side, next_side(side)])
    b = np.concatenate([next_side(other), other])
    closed = np.tile(~opened, 2)
    # fans that share a vertex of the whole surface already belong together
    whole = connected_labels(a, b, len(vertex))[1]
    first = np.unique(whole, return_index=True)[1]
    first = first[np.argsort(vertex[first], kind="stable")]
    same = vertex[first[1:]] == vertex[first[:-1]]
    a = np.concatenate([a[closed], first[:-1][same]])
    b = np.concatenate([b[closed], first[1:][same]])
    count, fan = connected_labels(a, b, len(vertex))
    first = np.sort(np.unique(fan, return_index=True)[1])
    number = vertex[first]
    new = np.ones(count, dtype=bool)
    new[np.unique(number, return_index=True)[1]] = False
    origin = np.concatenate([np.arange(topology.n_vertices), number[new]])
    number[new] = topology.n_vertices + np.arange(new.sum())
    lookup, corner = np.empty(count, dtype=np.int64), np.empty(len(origin), dtype=np.int64)
    lookup[fan[first]], corner[number] = number, first
    return SplitSurface(lookup[fan].reshape(-1, 3), origin, corner)


class Strength:
    """Limits of strain and angle at which the interior edges of a surface open.

    Parameters
    ----------
    mesh : TriangleMesh
        The unbroken surface at rest.
    strain, angle : float or None
        Largest relative elongation, and largest change of the dihedral angle in radians; None for no limit.
    flat : bool
        Whether angles are measured from zero, not from those of the rest shape.
    """

    def __init__(self, mesh: TriangleMesh, strain: float | None, angle: float | None, flat: bool) -> None:
        side, other = hinge_sides(mesh.topology)
        apex, far = next_side(next_side(side)), next_side(next_side(other))
        self._corners = np.stack([side, next_side(side), apex, far], axis=1)
        self._length = mesh.side_length.ravel()[side]
        self._strain, self._angle = strain, angle
        rest = hinge_frame(np.asarray(mesh.points), mesh.faces.ravel()[self._corners]).angle
        self._rest = np.zeros_like(rest) if flat else rest

    def __len__(self) -> int:
        """Number of interior edges."""
        return len(self._length)

    def exceeded(self, x: NDArray, faces: NDArray) -> NDArray[np.bool_]:
        """(h,) whether each edge, open or not, is beyond a limit, for faces with vertices at positions x."""
        stencil = faces.ravel()[self._corners]
        beyond = np.zeros(len(stencil), dtype=bool)
        if self._strain is not None:
            length = vector_length(x[stencil[:, 1]] - x[stencil[:, 0]])
            beyond |= length > (1 + self._strain) * self._length
        if self._angle is not None:
            beyond |= np.abs(wrapped(hinge_frame(x, stencil).angle - self._rest)) > self._angle
        return beyond
