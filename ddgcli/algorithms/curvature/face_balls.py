"""The part of a surface in the ball around every vertex: faces inside, and faces that the sphere cuts.

The balls grow over vertices along edges inside them; the bits of the corners then give the faces. Balls grow
face by face only where the sphere cuts a side with both ends outside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array

from ddgcli.algorithms.curvature.ball_blocks import (
    connected,
    lists_of,
    neighbours_among,
    packed,
    point_tree,
    unpacked,
    within,
)
from ddgcli.algorithms.curvature.clip import FacePlanes
from ddgcli.mesh.ragged import contains, expand_lists, group_by_key, unique_keys
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


@dataclass(frozen=True, eq=False)
class Ball:
    """Contents of the balls around some vertices.

    Parameters
    ----------
    vertex : (b,) ndarray of int64
        Centres, ascending; owners are their places.
    fans : (b, n_fans) csr_array
        Ones at the vertices inside, each counted once a fan of faces that is inside.
    whole : (b, m) csr_array
        Ones at the faces that are wholly inside.
    owner, face : (k,) ndarray
        Faces that the sphere cuts, by owner.
    area : (k,) ndarray
        Their areas inside.
    chord : (3, k) ndarray
        Lengths of their sides inside.
    """

    vertex: NDArray[np.int64]
    fans: csr_array
    whole: csr_array
    owner: NDArray[np.int64]
    face: NDArray[np.int64]
    area: NDArray[np.float64]
    chord: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Block:
    """What the balls of a block may hold, by local indices; fans elsewhere have the index -1.

    `inside` holds the bits of the fans (`packed`), with a last row of zeros for those elsewhere.
    """

    vertex: NDArray[np.int64]
    centres: NDArray[np.float64]
    fan: NDArray[np.int64]
    face: NDArray[np.int64]
    corner: NDArray[np.int64]  # (k, 3) local fans of the faces
    inside: NDArray[np.uint64]
    lists: tuple[NDArray[np.int64], NDArray[np.int64]]


class FaceBalls:
    """Balls in space around the vertices, each restricted to the part connected to its vertex inside it.

    Parameters
    ----------
    mesh : TriangleMesh
    radius : float
    tree : cKDTree, optional
        As returned by `point_tree(mesh.points)`.

    Attributes
    ----------
    n_inside, n_clipped : int
        Pairs of a ball with a face that it contains, and with a face that was clipped, so far: the work.
    """

    def __init__(self, mesh: TriangleMesh, radius: float, tree: cKDTree | None = None) -> None:
        self.mesh, self.radius = mesh, radius
        self.tree = point_tree(mesh.points) if tree is None else tree
        self.radii = np.broadcast_to(radius, mesh.n_vertices)
        self.n_inside = self.n_clipped = 0
        # a vertex with several fans counts once for each fan: other fans count only where they are connected
        fan = mesh.topology.corner_fans
        self.n_fans = n = int(fan.max(initial=-1)) + 1
        self._fan, self._columns = fan, np.ascontiguousarray(mesh.points.T)
        self.fan_vertex = np.zeros(n, dtype=np.int64)
        self.fan_vertex[fan.ravel()] = mesh.faces.ravel()
        self._fan_point = np.take(self._columns, self.fan_vertex, axis=1)
        self._fans_of_vertex = group_by_key(self.fan_vertex, np.arange(n), mesh.n_vertices)
        corner_face = np.arange(fan.size) // 3
        self._faces_of_edge = group_by_key(
            mesh.topology.side_edge.ravel(), corner_face, mesh.topology.n_edges
        )
        self._faces_of_fan = group_by_key(fan.ravel(), corner_face, n)
        tail, head = fan.ravel(), fan[:, NEXT].ravel()
        ones = np.ones(2 * len(tail), dtype=np.int8)
        ends = np.concatenate([tail, head]), np.concatenate([head, tail])
        joined = csr_array(csr_array((ones, ends), shape=(n, n)) + eye_array(n, dtype=np.int8, format="csr"))
        self._neighbours = joined.indptr.astype(np.int64), joined.indices.astype(np.int64)
        self._planes = FacePlanes.of(self._columns[:, mesh.faces].transpose(2, 0, 1))
        self.face_area = self._planes.area
        self._place = np.full(n, -1)

    def around(self, vertex: NDArray, near: NDArray) -> Ball:
        """Balls around some vertices.

        Parameters
        ----------
        vertex : (b,) ndarray of int64
        near : (k,) ndarray of int64
            All vertices that may lie in these balls, ascending.

        Returns
        -------
        Ball
        """
        block = self._block(vertex, near)
        owner, fan = expand_lists(np.arange(len(vertex)), vertex, self._fans_of_vertex)
        seed = np.zeros((len(block.fan) + 1, len(vertex)), dtype=bool)
        try:
            while True:
                seed[self._place[fan], owner] = True
                words = block.inside.copy()
                words[:-1] = connected(packed(seed)[:-1], block.inside[:-1], *block.lists)
                reached = unpacked(words, len(vertex))
                ball, owner, fan = self._faces(block, words, reached)
                if not len(owner):
                    return ball
        finally:
            self._place[block.fan] = -1

    def _block(self, vertex: NDArray, near: NDArray) -> _Block:
        fan = np.sort(expand_lists(near, near, self._fans_of_vertex)[1])
        self._place[fan] = np.arange(len(fan))
        face = unique_keys(expand_lists(fan, fan, self._faces_of_fan)[1])
        centres = np.take(self._columns, vertex, axis=1)
        flags = np.zeros((len(fan) + 1, len(vertex)), dtype=bool)
        flags[:-1] = within(self._fan_point, fan, centres, self.radius)
        corner = self._place[self._fan[face]]
        lists = neighbours_among(fan, *self._neighbours)
        return _Block(vertex, centres, fan, face, corner, packed(flags), lists)

    def _faces(self, block: _Block, words: NDArray, reached: NDArray) -> tuple[Ball, NDArray, NDArray]:
        """The balls with these fans inside, and further fans connected to them by cut faces.

        `words` are the bits of the fans, `reached` (b, k + 1) the same as flags.
        """
        count = len(block.vertex)
        first, second, third = (np.take(words, corner, axis=0) for corner in block.corner.T)
        all_inside = first & second & third
        some_inside = (first | second | third) & ~all_inside
        start, place = lists_of(unpacked(some_inside, count))
        owner = np.repeat(np.arange(count), np.diff(start))
        face = block.face[place]
        pieces = [(owner, face, *self._clip(block, owner, face))]
        few = np.flatnonzero(reached[owner[:, None], block.corner[place]].sum(axis=1) == 1)
        outermost = owner[few], face[few], pieces[0][3][:, few]
        visited = np.zeros(0, dtype=np.int64)
        while True:
            beyond = self._beyond(reached, *outermost)
            beyond = beyond[~contains(visited, beyond)]
            if not len(beyond):
                break
            visited = np.sort(np.concatenate([visited, beyond]))
            owner, face = np.divmod(beyond, self.mesh.n_faces)
            corner = self._fan[face]
            inside = self._within(block, np.repeat(owner, 3), corner.ravel()).reshape(-1, 3)
            if inside.any():
                key = unique_keys((owner[:, None] * self.n_fans + corner)[inside])
                return self._ball(block, all_inside, reached, pieces), *np.divmod(key, self.n_fans)
            pieces.append((owner, face, *self._clip(block, owner, face)))
            outermost = owner, face, pieces[-1][3]
        return self._ball(block, all_inside, reached, pieces), visited[:0], visited[:0]

    def _within(self, block: _Block, owner: NDArray, fan: NDArray) -> NDArray[np.bool_]:
        offset = np.take(self._fan_point, fan, axis=1) - np.take(block.centres, owner, axis=1)
        offset *= offset
        return offset[0] + offset[1] + offset[2] <= self.radius * self.radius

    def _clip(self, block: _Block, owner: NDArray, face: NDArray) -> tuple[NDArray, NDArray]:
        self.n_clipped += len(face)
        return self._planes.clip(face, np.take(block.centres, owner, axis=1), self.radius)

    def _beyond(self, reached: NDArray, owner: NDArray, face: NDArray, chord: NDArray) -> NDArray[np.int64]:
        """Faces without corners inside, across sides whose ends are outside but some part is not."""
        out = ~reached[owner[:, None], self._place[self._fan[face]]]
        row, side = np.nonzero(out & out[:, NEXT] & (chord.T > 0))
        owner, face = expand_lists(
            owner[row], self.mesh.topology.side_edge[face[row], side], self._faces_of_edge
        )
        unknown = ~reached[owner[:, None], self._place[self._fan[face]]].any(axis=1)
        return unique_keys(owner[unknown] * self.mesh.n_faces + face[unknown])

    def _ball(self, block: _Block, all_inside: NDArray, reached: NDArray, pieces: list) -> Ball:
        owner, face, area, chord = (np.concatenate(p, axis=-1) for p in zip(*pieces))
        if len(pieces) > 1:
            order = np.argsort(owner, kind="stable")
            owner, face, area, chord = owner[order], face[order], area[order], chord[:, order]
        fans = _ones(reached[:, :-1], block.fan, self.n_fans)
        whole = _ones(unpacked(all_inside, len(block.vertex)), block.face, self.mesh.n_faces)
        self.n_inside += whole.nnz
        return Ball(block.vertex, fans, whole, owner, face, area, chord)


def _ones(flags: NDArray, column: NDArray, n_columns: int) -> csr_array:
    """(b, n_columns) ones where flags (b, k) are set; column k of these has the number `column[k]`."""
    start, place = lists_of(flags)
    return csr_array((np.ones(len(place)), column[place], start), shape=(len(flags), n_columns))
