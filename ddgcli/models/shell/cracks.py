"""Surfaces that have come apart: which edges open, and the vertices that split with them."""

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
    """Faces of a surface some of whose edges have opened.

    Parameters
    ----------
    faces : (m, 3) ndarray of int
        In the order of the whole surface.
    origin : (k,) ndarray of int
        Vertex of the whole surface that each vertex was; the first n are those of the whole surface itself.
    corner : (k,) ndarray of int
        A corner, 3 face + place, of each vertex.
    """

    faces: NDArray[np.int64]
    origin: NDArray[np.int64]
    corner: NDArray[np.int64]

    @property
    def pieces(self) -> int:
        """Number of parts that hang together."""
        tail, head = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        return connected_labels(tail, head, len(self.origin))[0]


def split_surface(topology: Topology, opened: NDArray[np.bool_]) -> SplitSurface:
    """The surface with some of its interior edges open.

    The faces around a vertex stay together as far as edges between them are closed; each such fan has a
    vertex of its own, so a vertex splits where two open edges meet in it, or one at the boundary. The fan of
    the first corner keeps the index of the vertex, those that come new follow in the order of their corners.

    Parameters
    ----------
    topology : Topology
        Of a surface whose interior edges have two faces of the same orientation.
    opened : (h,) ndarray of bool
        Over the interior edges, in the order of `hinge_sides`.

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
    """Limits of strain and angle of the interior edges of a surface.

    Parameters
    ----------
    mesh : TriangleMesh
        The whole surface at rest.
    strain, angle : float or None
    flat : bool
        Whether angles count from zero, not from those of the rest shape.
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
        """(h,) edges beyond a limit at positions x of the vertices of some faces; those open count too."""
        stencil = faces.ravel()[self._corners]
        beyond = np.zeros(len(stencil), dtype=bool)
        if self._strain is not None:
            length = vector_length(x[stencil[:, 1]] - x[stencil[:, 0]])
            beyond |= length > (1 + self._strain) * self._length
        if self._angle is not None:
            beyond |= np.abs(wrapped(hinge_frame(x, stencil).angle - self._rest)) > self._angle
        return beyond
