"""The part of a surface in the ball around every vertex: faces inside, and faces that the sphere cuts.

The balls grow over vertices along edges inside them; sparse products then give the faces. Balls grow face by
face only where the sphere cuts a side with both ends outside.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.algorithms.curvature.clip import FacePlanes
from ddgcli.mesh.ragged import contains, expand_lists, group_by_key, unique_keys
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh

_MAX_TABLE_CELLS = 4_000_000  # entries of the table of vertices and fans
_MAX_PAIRS = 100_000  # pairs of a vertex and a face handled at once
_OUTSIDE_STATE, _INSIDE_STATE = 1, 2  # state of a fan; 0 is unknown


@dataclass(frozen=True, eq=False)
class Ball:
    """Contents of the balls around a range of vertices.

    Parameters
    ----------
    begin, end : int
        The range; owners count from begin.
    fans : (end - begin, n_fans) csr_array
        Ones at the vertices inside, each counted once a fan of faces that is inside.
    whole : (end - begin, m) csr_array
        Ones at the faces that are wholly inside (zeros may be stored).
    owner, face : (k,) ndarray
        Faces that the sphere cuts, by owner.
    area : (k,) ndarray
        Their areas inside.
    chord : (3, k) ndarray
        Lengths of their sides inside.
    """

    begin: int
    end: int
    fans: csr_array
    whole: csr_array
    owner: NDArray[np.int64]
    face: NDArray[np.int64]
    area: NDArray[np.float64]
    chord: NDArray[np.float64]


class FaceBalls:
    """Balls in space around the vertices, each restricted to the part connected to its vertex inside it.

    Parameters
    ----------
    mesh : TriangleMesh
    radius : float

    Attributes
    ----------
    max_balls : int
        That the table of their fans has room for at once.
    n_tested, n_clipped : int
        Pairs of a ball with a vertex, and with a face, that were computed so far: the work.
    """

    def __init__(self, mesh: TriangleMesh, radius: float) -> None:
        self.mesh, self.radius = mesh, radius
        self.n_tested = self.n_clipped = 0
        # a vertex with several fans counts once for each fan: other fans count only where they are connected
        fan = mesh.topology.corner_fans
        self.n_fans = n = int(fan.max(initial=-1)) + 1
        self._fan, self._columns = fan, np.ascontiguousarray(mesh.points.T)
        self.fan_vertex = np.zeros(n, dtype=np.int64)
        self.fan_vertex[fan.ravel()] = mesh.faces.ravel()
        self._fan_point = np.take(self._columns, self.fan_vertex, axis=1)
        self._fans_of_vertex = group_by_key(self.fan_vertex, np.arange(n), mesh.n_vertices)
        self._faces_of_edge = group_by_key(
            mesh.topology.side_edge.ravel(), np.arange(fan.size) // 3, mesh.topology.n_edges
        )
        tail, head = fan.ravel(), fan[:, NEXT].ravel()
        ones = np.ones(2 * len(tail), dtype=np.int8)
        ends = np.concatenate([tail, head]), np.concatenate([head, tail])
        joined = csr_array((ones, ends), shape=(n, n))
        self._neighbours = joined.indptr.astype(np.int64), joined.indices.astype(np.int64)
        self._faces_of_fan = csr_array(
            (np.ones(fan.size, dtype=np.int32), (fan.ravel(), np.arange(fan.size) // 3)),
            shape=(n, mesh.n_faces),
        )
        self._planes = FacePlanes.of(self._columns[:, mesh.faces].transpose(2, 0, 1))
        self.face_area = self._planes.area
        self.max_balls = max(8, _MAX_TABLE_CELLS // max(n, 1))
        self._state = np.zeros(min(self.max_balls, mesh.n_vertices) * n, dtype=np.int8)
        self._stamp = np.empty(len(self._state), dtype=np.int32)

    def __iter__(self) -> Iterator[Ball]:
        begin, step = 0, 64
        while begin < self.mesh.n_vertices:
            end = min(begin + min(step, self.max_balls), self.mesh.n_vertices)
            ball = self.around(begin, end)
            yield ball
            step = max(1, int((end - begin) * _MAX_PAIRS / max(ball.whole.nnz + len(ball.face), 1)))
            begin = end

    def around(self, begin: int, end: int) -> Ball:
        """Balls around a range of vertices.

        Parameters
        ----------
        begin, end : int
            The range [begin, end), of at most `max_balls`.

        Returns
        -------
        Ball
        """
        self._state.fill(0)
        owner, fan = expand_lists(np.arange(end - begin), np.arange(begin, end), self._fans_of_vertex)
        self._state[owner * self.n_fans + fan] = _INSIDE_STATE
        owners, fans = [owner[:0]], [fan[:0]]  # none where no vertex of the range belongs to a face
        while True:
            for ring_owner, ring_fan in self._growth(begin, owner, fan):
                owners.append(ring_owner)
                fans.append(ring_fan)
            inside = np.concatenate(owners), np.concatenate(fans)
            ball, owner, fan = self._faces(begin, end, *inside)
            if not len(owner):
                return ball

    def _growth(self, begin: int, owner: NDArray, fan: NDArray) -> Iterator[tuple[NDArray, NDArray]]:
        """Yield the starting fans and those connected to them by edges inside, ring by ring."""
        while len(owner):
            yield owner, fan
            owner, fan = expand_lists(owner, fan, self._neighbours)
            key = owner * self.n_fans + fan
            unseen = np.flatnonzero(self._state[key] == 0)
            key = key[unseen]
            number = np.arange(len(key), dtype=np.int32)
            self._stamp[key] = number
            once = np.flatnonzero(self._stamp[key] == number)
            key, owner, fan = key[once], owner[unseen[once]], fan[unseen[once]]
            inside = self._within(begin + owner, fan)
            self._state[key] = np.where(inside, _INSIDE_STATE, _OUTSIDE_STATE)
            owner, fan = owner[inside], fan[inside]

    def _within(self, vertex: NDArray, fan: NDArray) -> NDArray[np.bool_]:
        self.n_tested += len(fan)
        squared = np.zeros(len(fan))
        for column, place in zip(self._columns, self._fan_point):
            squared += (np.take(place, fan) - np.take(column, vertex)) ** 2
        return squared <= self.radius * self.radius

    def _faces(self, begin: int, end: int, owner: NDArray, fan: NDArray) -> tuple[Ball, NDArray, NDArray]:
        """The balls with these fans inside, and further fans connected to them by cut faces."""
        ones = np.ones(len(fan), dtype=np.int32)
        fans = csr_array((ones, (owner, fan)), shape=(end - begin, self.n_fans))
        count = (fans @ self._faces_of_fan).tocsr()
        row = np.repeat(np.arange(end - begin), np.diff(count.indptr))
        cut = np.flatnonzero(count.data < 3)
        whole = csr_array(((count.data >= 3).astype(np.float64), count.indices, count.indptr), count.shape)
        owner, face = row[cut], count.indices[cut].astype(np.int64)
        pieces = [(owner, face, *self._clip(begin, owner, face))]
        few = np.flatnonzero(count.data[cut] == 1)
        outermost = owner[few], face[few], pieces[0][3][:, few]
        visited = np.zeros(0, dtype=np.int64)
        while True:
            beyond = self._beyond(*outermost)
            beyond = beyond[~contains(visited, beyond)]
            if not len(beyond):
                break
            visited = np.sort(np.concatenate([visited, beyond]))
            owner, face = np.divmod(beyond, self.mesh.n_faces)
            corner = self._fan[face]
            inside = self._within(np.repeat(begin + owner, 3), corner.ravel()).reshape(-1, 3)
            if inside.any():
                key = unique_keys((owner[:, None] * self.n_fans + corner)[inside])
                self._state[key] = _INSIDE_STATE
                return self._ball(begin, end, fans, whole, pieces), *np.divmod(key, self.n_fans)
            pieces.append((owner, face, *self._clip(begin, owner, face)))
            outermost = owner, face, pieces[-1][3]
        return self._ball(begin, end, fans, whole, pieces), visited[:0], visited[:0]

    def _clip(self, begin: int, owner: NDArray, face: NDArray) -> tuple[NDArray, NDArray]:
        self.n_clipped += len(face)
        return self._planes.clip(face, np.take(self._columns, begin + owner, axis=1), self.radius)

    def _beyond(self, owner: NDArray, face: NDArray, chord: NDArray) -> NDArray[np.int64]:
        """Faces without corners inside, across sides whose ends are outside but some part is not."""
        out = self._state[owner[:, None] * self.n_fans + self._fan[face]] != _INSIDE_STATE
        row, side = np.nonzero(out & out[:, NEXT] & (chord.T > 0))
        owner, face = expand_lists(
            owner[row], self.mesh.topology.side_edge[face[row], side], self._faces_of_edge
        )
        unknown = (self._state[owner[:, None] * self.n_fans + self._fan[face]] != _INSIDE_STATE).all(axis=1)
        return unique_keys(owner[unknown] * self.mesh.n_faces + face[unknown])

    def _ball(self, begin: int, end: int, fans: csr_array, whole: csr_array, pieces: list) -> Ball:
        owner, face, area, chord = (np.concatenate(p, axis=-1) for p in zip(*pieces))
        if len(pieces) > 1:
            order = np.argsort(owner, kind="stable")
            owner, face, area, chord = owner[order], face[order], area[order], chord[:, order]
        return Ball(begin, end, fans, whole, owner, face, area, chord)
