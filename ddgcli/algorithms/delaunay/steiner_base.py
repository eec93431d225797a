"""The input triangulation with Steiner points inserted into its faces and boundary edges.

Edges inside an input face are auxiliary: the common subdivision keeps only those on input edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from ddgcli.algorithms.delaunay.common_subdivision import BaseTriangulation
from ddgcli.algorithms.delaunay.gluing import Gluing, around
from ddgcli.geometry.surface_points import SurfacePoints, interpolated
from ddgcli.geometry.unfolding import corner_position, unfold
from ddgcli.mesh.topology import NEXT, Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh

MAX_FLIP_ROUNDS = 200  # of planar flips after one round of insertions


@dataclass(frozen=True, eq=False)
class SteinerPoints:
    """Points on an input surface.

    Parameters
    ----------
    face : (s,) ndarray of int64
    barycentric : (s, 3) ndarray of float64
    edge : (s,) ndarray of int64
        Input side of each point on the boundary; -1 for the others.
    edge_share : (s,) ndarray of float64
        Position on that side, as a fraction of its length from the tail.
    """

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    edge: NDArray[np.int64]
    edge_share: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.face)

    def after_vertices(self, mesh: TriangleMesh) -> SurfacePoints:
        """The vertices of the input followed by these points; face -1 at vertices that no face uses."""
        face, barycentric = np.full(mesh.n_vertices, -1), np.zeros((mesh.n_vertices, 3))
        corner = np.arange(3 * mesh.n_faces)[::-1]  # reversed, so that the first face of a vertex counts
        face[mesh.faces.ravel()[corner]] = corner // 3
        barycentric[mesh.faces.ravel()[corner]] = np.eye(3)[corner % 3]
        return SurfacePoints(
            np.concatenate([face, self.face]), np.concatenate([barycentric, self.barycentric])
        )


def with_steiner_points(mesh: TriangleMesh, steiner: SteinerPoints) -> BaseTriangulation:
    """Insert points into the input triangulation.

    Parameters
    ----------
    mesh : TriangleMesh
    steiner : SteinerPoints

    Returns
    -------
    BaseTriangulation
        Input vertices come first; every face lies inside one input face.
    """
    work = _Insertion(mesh, steiner)
    work.cut_boundary()
    work.cut_faces()
    n, s = mesh.n_vertices, len(steiner)
    row = np.concatenate([np.arange(n), n + np.repeat(np.arange(s), 3)])
    column = np.concatenate([np.arange(n), mesh.faces[steiner.face].ravel()])
    value = np.concatenate([np.ones(n), steiner.barycentric.ravel()])
    interpolation = coo_array((value, (row, column)), shape=(n + s, n)).tocsr()
    position = interpolated(mesh.points, mesh.faces[steiner.face], steiner.barycentric)
    points = np.concatenate([mesh.points, position])
    faces, twin = work.gluing.tail.reshape(-1, 3), work.gluing.twin[:-1].reshape(-1, 3)
    refined = TriangleMesh(points, Topology(faces, len(points), twin))
    return BaseTriangulation(mesh, refined, work.input_face, interpolation)


class _Insertion:
    """Insertion in rounds of at most one point per face, with planar Delaunay flips in the input faces.

    Positions are complex numbers in the planar frames of the input faces: lengths are computed from them, not
    from other lengths, so that even needles keep their shape.
    """

    def __init__(self, mesh: TriangleMesh, steiner: SteinerPoints) -> None:
        self.steiner, self.n = steiner, mesh.n_vertices
        self.gluing = Gluing(mesh.faces.ravel().copy(), np.append(mesh.topology.side_twin.ravel(), -1))
        self.input_face = np.arange(mesh.n_faces)
        layout = corner_position(unfold(mesh))
        places = layout[..., 0] + 1j * layout[..., 1]
        self.corner = places.ravel()
        self.place = (steiner.barycentric * places[steiner.face]).sum(axis=1)

    def _grow(self, source: NDArray) -> None:
        self.input_face = np.append(self.input_face, self.input_face[source])
        self.corner = np.append(self.corner, np.zeros(3 * len(source)))

    def cut_boundary(self) -> None:
        """Insert points on boundary edges, from the far end of every edge, and track the sides that move."""
        waiting = np.flatnonzero(self.steiner.edge >= 0)
        waiting = waiting[np.lexsort((-self.steiner.edge_share[waiting], self.steiner.edge[waiting]))]
        where = np.arange(len(self.gluing.tail))  # current index of each input side
        while len(waiting):
            edge = self.steiner.edge[waiting]
            first = np.append(True, edge[1:] != edge[:-1])
            rows = np.flatnonzero(first)
            _, alone = np.unique(where[edge[rows]] // 3, return_index=True)
            rows = rows[np.sort(alone)]
            point = waiting[rows]
            side = where[edge[rows]]
            face, jk, ki = around(side)
            new = self.gluing.split_boundary(side, self.n + point)
            self._grow(face)
            p = 3 * new
            self.corner[p], self.corner[p + 1] = self.place[point], self.corner[jk]
            self.corner[p + 2], self.corner[jk] = self.corner[ki], self.place[point]
            standing = np.full(len(self.gluing.tail), -1)
            standing[where] = np.arange(len(where))
            moved = standing[jk]
            where[moved[moved >= 0]] = (p + 1)[moved >= 0]
            waiting = np.delete(waiting, rows)
        self._flip(np.arange(len(self.gluing.tail)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))

    def cut_faces(self) -> None:
        """Insert points inside faces: in every round the one nearest the centre of its face."""
        waiting = np.flatnonzero(self.steiner.edge < 0)
        face = self._containing_face(waiting)
        while len(waiting):
            depth = self._depth(waiting, face)
            order = np.lexsort((-depth, face))
            first = np.append(True, face[order][1:] != face[order][:-1])
            rows = order[first]
            point, cut = waiting[rows], face[rows]
            new = self.gluing.split_faces(cut, self.n + point)
            self._grow(np.tile(cut, 2))
            a, b, c = (self.corner[3 * cut + k].copy() for k in range(3))
            middle = self.place[point]
            for face_rows, corners in (
                (cut, (a, b, middle)),
                (new[0], (b, c, middle)),
                (new[1], (c, a, middle)),
            ):
                for k in range(3):
                    self.corner[3 * face_rows + k] = corners[k]
            rest = np.ones(len(waiting), dtype=bool)
            rest[rows] = False
            thirds = np.full((len(self.input_face), 3), -1)
            thirds[cut] = np.stack([cut, new[0], new[1]], axis=1)
            waiting, face = waiting[rest], face[rest]
            face = self._deepest(waiting, thirds[face])
            halves = np.concatenate([cut, new[0], new[1]])
            face = self._flip((3 * halves[:, None] + np.arange(3)).ravel(), waiting, face)

    def _flip(self, active: NDArray, waiting: NDArray, face: NDArray) -> NDArray[np.int64]:
        """Flip auxiliary edges that are not Delaunay; returns the faces that contain the waiting points."""
        gluing, corner = self.gluing, self.corner
        for _ in range(MAX_FLIP_ROUNDS):
            h = self._flippable(active)
            if len(h) == 0:
                break
            here = np.stack([h, gluing.twin[h]])
            pair, after, before = around(here)
            gluing.flip_sides(here, after, before)
            corner[after] = corner[before[::-1]]
            partner = np.full(gluing.n_faces, -1)
            partner[pair] = pair[::-1]
            glued_face = np.flatnonzero(partner[face] >= 0)
            pair = np.stack([face[glued_face], partner[face[glued_face]]], axis=1)
            face[glued_face] = self._deepest(waiting[glued_face], pair)
            active = np.concatenate([here.ravel(), before.ravel(), active])
        return face

    def _flippable(self, side: NDArray) -> NDArray[np.int64]:
        """Auxiliary edges whose opposite angles sum to more than pi, no two in one face."""
        twin = self.gluing.twin[side]
        inner = (twin >= 0) & (self.input_face[side // 3] == self.input_face[twin // 3])
        side = np.sort(np.minimum(side, twin)[inner])
        side = side[np.append(True, side[1:] != side[:-1])[: len(side)]]
        twin = self.gluing.twin[side]
        excess = np.full(len(side), -np.pi)
        for s in (side, twin):
            _, following, previous = around(s)
            to_tail = self.corner[s] - self.corner[previous]
            to_head = self.corner[following] - self.corner[previous]
            product = np.conj(to_tail) * to_head
            excess += np.arctan2(np.maximum(product.imag, 0.0), product.real)
        bad = np.flatnonzero(excess > 1e-12)
        bad = bad[np.argsort(-excess[bad])]
        pair = np.stack([side[bad], twin[bad]], axis=1) // 3
        claim = np.full(self.gluing.n_faces, -1)
        claim[pair[::-1].ravel()] = np.repeat(np.arange(len(bad))[::-1], 2)
        alone = (claim[pair] == np.arange(len(bad))[:, None]).all(axis=1)
        return side[bad[alone]]

    def _containing_face(self, point: NDArray) -> NDArray[np.int64]:
        """The face that contains each point, among those inside its input face."""
        order = np.argsort(self.input_face, kind="stable")
        start = np.searchsorted(self.input_face[order], np.arange(self.input_face.max() + 2))
        input_face = self.steiner.face[point]
        count = np.diff(start)[input_face]
        best, depth = np.full(len(point), -1), np.full(len(point), -np.inf)
        for k in range(int(count.max(initial=0))):
            has = np.flatnonzero(k < count)
            candidate = order[start[input_face[has]] + k]
            here = self._depth(point[has], candidate)
            better = here > depth[has]
            best[has[better]], depth[has[better]] = candidate[better], here[better]
        return best

    def _depth(self, point: NDArray, face: NDArray) -> NDArray[np.float64]:
        """Least barycentric coordinate of points in faces: negative outside, at most a third."""
        away = self.corner[3 * face[:, None] + np.arange(3)] - self.place[point][:, None]
        corner_area = (np.conj(away) * away[:, NEXT]).imag
        total = np.abs(corner_area).sum(axis=1)
        return corner_area.min(axis=1) / np.where(total > 0, total, 1.0)

    def _deepest(self, point: NDArray, faces: NDArray) -> NDArray[np.int64]:
        """The face of (k, c) candidates in which each point is deepest."""
        if len(point) == 0:
            return np.zeros(0, dtype=np.int64)
        depth = np.stack([self._depth(point, column) for column in faces.T], axis=1)
        return faces[np.arange(len(point)), depth.argmax(axis=1)]
