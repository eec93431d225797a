"""Orientation double cover of a surface: every face twice, in both orientations.

Face f + m of the cover is face f of the surface with reversed corners: corner k is corner 2 - k.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import Topology


def reversed_sides(side: NDArray, n_faces: int) -> NDArray[np.int64]:
    """Side over the same edge in the other copy of its face; its own inverse.

    Parameters
    ----------
    side : (k,) ndarray of int64
        Flat side indices 3*face + j of the cover.
    n_faces : int
        Faces of the surface, m.

    Returns
    -------
    (k,) ndarray of int64
    """
    face, j = np.divmod(side, 3)
    return 3 * ((face + n_faces) % (2 * n_faces)) + (1 - j) % 3


def covering_faces(corner: NDArray, mirrored: NDArray | None = None) -> NDArray:
    """(2m, 3) corners of the cover, from those of the faces and of their copies before the reversal."""
    return np.concatenate([corner, (corner if mirrored is None else mirrored)[:, ::-1]])


def covering_sides(values: NDArray) -> NDArray:
    """Values on the sides of the double cover from values on the sides of the surface.

    Parameters
    ----------
    values : (m, 3) ndarray

    Returns
    -------
    (2m, 3) ndarray
    """
    return np.concatenate([values, values[:, [1, 0, 2]]])


def double_cover(topology: Topology) -> Topology:
    """Orientation double cover of a surface, over the same vertices.

    Sides are glued to sides of opposite direction, so that the cover is oriented.

    Parameters
    ----------
    topology : Topology
        Edges with at most two sides; faces may be turned at will.

    Returns
    -------
    Topology
        2m faces: those of the surface, then the same with reversed corners.
    """
    m = topology.n_faces
    side = np.arange(3 * m)
    over = reversed_sides(side, m)
    twin, sign = topology.side_twin.ravel(), topology.side_sign.ravel()
    clash = sign == sign[twin]
    beyond = over[twin]
    gluing = np.full(6 * m, -1, dtype=np.int64)
    gluing[side] = np.where(twin < 0, -1, np.where(clash, beyond, twin))
    gluing[over] = np.where(twin < 0, -1, np.where(clash, twin, beyond))
    return Topology(covering_faces(topology.faces), topology.n_vertices, gluing.reshape(-1, 3))


@dataclass(frozen=True, eq=False)
class CoverVertices:
    """Vertices of a cover in which each fan of a vertex has two copies, so that the cover is simplicial.

    Parameters
    ----------
    corner : (m, 3) ndarray of int64
        Vertex of the cover at each corner of the surface's faces.
    below : (c,) ndarray of int64
        Vertex of the surface under each vertex of the cover.
    mirror : (c,) ndarray of int64
        The other copy of the same fan.
    """

    corner: NDArray[np.int64]
    below: NDArray[np.int64]
    mirror: NDArray[np.int64]

    @property
    def faces(self) -> NDArray[np.int64]:
        """(2m, 3) faces of the cover."""
        return covering_faces(self.corner, self.mirror[self.corner])


def cover_vertices(topology: Topology) -> CoverVertices:
    """Number the vertices of the double cover: two for each fan of faces around a vertex.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    CoverVertices
    """
    m = topology.n_faces
    fan = double_cover(topology).corner_fans
    corner, mirrored = fan[:m], fan[m:, ::-1]
    below, mirror = (np.empty(fan.max(initial=-1) + 1, dtype=np.int64) for _ in range(2))
    for here, there in ((corner, mirrored), (mirrored, corner)):
        below[here], mirror[here] = topology.faces, there
    return CoverVertices(corner, below, mirror)
