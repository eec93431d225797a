"""Insertion of Steiner points into an intrinsic Delaunay triangulation, in batches of disjoint cavities."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.boundary_splits import cut_boundary
from ddgcli.algorithms.delaunay.circumcentres import (
    INSIDE,
    ON_BOUNDARY,
    OUTSIDE,
    Cavity,
    Targets,
    apex_of,
    conflict_cavity,
    pushed_inside,
    seek_circumcentres,
)
from ddgcli.algorithms.delaunay.flips import SideArrays, flip_until_delaunay
from ddgcli.algorithms.delaunay.gluing import around
from ddgcli.algorithms.delaunay.triangulation import glue, length_scale
from ddgcli.algorithms.delaunay.vertex_locations import VertexLocations
from ddgcli.geometry.intrinsic import face_area
from ddgcli.linalg.residual_gate import LARGEST_RESIDUAL
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.mollify import mollify_lengths

SHARP_ANGLE = np.pi / 3  # cones and boundary corners with a smaller total angle are not refined
COINCIDENCE_TOLERANCE = 1e-7  # relative side length in a face without area, below which its ends coincide
# distance of new points from sharp and coincident vertices, over the shortest edge of these before refinement
MIN_PINNED_DISTANCE = 0.1
# bad faces in a batch: least number, and number for each point of the last batch
MIN_BATCH_FACES, BATCH_FACES_PER_POINT = 256, 8


class Refinement:
    """The triangulation under refinement.

    Parameters
    ----------
    mesh : TriangleMesh
        Manifold and oriented.
    angle : float
        Lower bound of the angles, in radians.
    limit : int
        Largest number of Steiner points.
    seed : int
    """

    def __init__(self, mesh: TriangleMesh, angle: float, limit: int, seed: int = 0) -> None:
        self.limit, self.n_input = limit, mesh.n_vertices
        self.bound = np.tan(angle / 2)
        glued = glue(mesh)
        start = mollify_lengths(glued.side_length, glued.topology.side_edge)
        scale = length_scale(start.length)
        self.locations = VertexLocations(mesh, scale)
        fans = self.locations.fans
        self.state = SideArrays.of(glued.faces, glued.topology.side_twin, start.length / scale)
        self.state.direction = fans.angle_before.copy()
        self.flips, self.batches = flip_until_delaunay(self.state)[0], 0
        self.exhausted, self.has_rounded = False, False
        self.start_area = self._area()
        self.checked_faces = self.state.n_faces
        self.random, self.batch_faces = np.random.default_rng(seed), MIN_BATCH_FACES

        self.sharp = np.zeros(self.n_input, dtype=bool)
        self.sharp[fans.vertex] = fans.total_angle < SHARP_ANGLE - 1e-9
        self.coincident = np.zeros(self.n_input, dtype=bool)
        self.coincident[collapsed_ends(mesh, start.faces)] = True
        self.pinned = self.sharp | self.coincident
        self.clearance = self._pinned_clearance()

    def _pinned_clearance(self) -> NDArray[np.float64]:
        """(n,) distance from pinned vertices within which no point is inserted; 0 at the others."""
        state = self.state
        tail, head = state.tail, state.tail[around(np.arange(len(state.tail)))[1]]
        apart = np.flatnonzero(~(self.coincident[tail] & self.coincident[head]))
        nearest = np.full(self.n_input, np.inf)
        for end in (tail, head):
            np.minimum.at(nearest, end[apart], state.length[apart])
        return np.where(self.pinned & np.isfinite(nearest), MIN_PINNED_DISTANCE * nearest, 0.0)

    def advance(self) -> bool:
        """Insert one batch of points and flip to Delaunay; False if nothing was inserted."""
        state = self.state
        t = state.tangent
        smallest = np.minimum(np.minimum(t[0::3], t[1::3]), t[2::3])
        bad = np.flatnonzero(smallest < self.bound)
        bad = bad[~np.any(self._is_pinned(state.tail.reshape(-1, 3)[bad]), axis=1)]
        if len(bad) == 0:
            return False
        if self.locations.n_steiner >= self.limit:
            self.exhausted = True
            return False
        if self._has_lost_area():
            self.has_rounded = True
            return False
        while True:
            some = (
                bad
                if len(bad) <= self.batch_faces
                else self.random.choice(bad, self.batch_faces, replace=False)
            )
            some = some[np.argsort(smallest[some])]
            changed_edges = self._insert_at(some)
            if len(changed_edges) or len(some) == len(bad):
                break
            self.batch_faces *= 8
        if len(changed_edges) == 0:
            return False
        self.flips += flip_until_delaunay(state, changed_edges)[0]
        self.batches += 1
        return True

    def _area(self) -> float:
        return float(face_area(self.state.length.reshape(-1, 3)).sum())

    def _has_lost_area(self) -> bool:
        """Whether rounding has changed the area too much; checked when the number of faces has doubled."""
        n_faces = self.state.n_faces
        if n_faces < 2 * self.checked_faces:
            return False
        self.checked_faces = n_faces
        return not abs(self._area() - self.start_area) <= LARGEST_RESIDUAL * self.start_area

    def _insert_at(self, bad: NDArray) -> NDArray[np.int64]:
        """Insert points for bad faces, worst first; returns the sides whose edges may need a flip."""
        targets = self._independent(*self._proposals(bad))
        # if all points fall into a few cavities, the next batch tries fewer faces
        self.batch_faces = max(MIN_BATCH_FACES, BATCH_FACES_PER_POINT * len(targets.side))
        on_boundary = targets.status == ON_BOUNDARY
        inner = targets[np.flatnonzero(~on_boundary)]
        return np.concatenate([self._split_boundary(targets.side[on_boundary]), self._insert(inner)])

    def _is_pinned(self, vertex: NDArray) -> NDArray:
        return (vertex < self.n_input) & self.pinned[np.minimum(vertex, self.n_input - 1)]

    def _proposals(self, bad: NDArray) -> tuple[Targets, Cavity]:
        """Points to insert for bad faces, worst first: circumcentres, or middles of boundary sides."""
        state = self.state
        targets = seek_circumcentres(state, bad)
        inside = np.flatnonzero(targets.status == INSIDE)
        cavity = conflict_cavity(state, targets[inside])
        edge = np.full(len(bad), -1)
        edge[inside] = cavity.encroached
        beyond = targets.status == OUTSIDE
        edge[beyond] = targets.side[beyond]
        insertable = (targets.status == INSIDE) & (edge < 0)
        insertable[insertable] = self._clear_of_pinned(targets[np.flatnonzero(insertable)])
        split = np.flatnonzero(edge >= 0)
        split = split[np.sort(np.unique(edge[split], return_index=True)[1])]
        split = split[self._may_split(edge[split])]
        targets.status[split], targets.side[split] = ON_BOUNDARY, edge[split]
        self._lay_out(targets, split)
        around_splits = conflict_cavity(state, targets[split])

        still = insertable[inside[cavity.item]]
        item = np.concatenate([split[around_splits.item], inside[cavity.item[still]]])
        face = np.concatenate([around_splits.face, cavity.face[still]])
        insertable[split] = True
        rank = np.cumsum(insertable) - 1
        return targets[np.flatnonzero(insertable)], Cavity(rank[item], face, edge[insertable])

    def _lay_out(self, targets: Targets, split: NDArray) -> None:
        """Lay out the faces of the boundary sides to cut, and the positions of the cuts."""
        side = targets.side[split]
        length = self.state.length[side]
        corners = np.stack([np.zeros(len(side)), length, apex_of(self.state, side) * length], axis=1)
        targets.corners[split] = corners
        targets.centre[split] = self._shell(side) * length

    def _clear_of_pinned(self, targets: Targets) -> NDArray[np.bool_]:
        _, following, previous = around(targets.side)
        clear: NDArray[np.bool_] = np.ones(len(targets.side), dtype=bool)
        for k, side in enumerate((targets.side, following, previous)):
            clearance = self._clearance_at(self.state.tail[side])
            clear &= np.abs(targets.centre - targets.corners[:, k]) >= clearance
        return clear

    def _may_split(self, side: NDArray) -> NDArray:
        clearance = self._clearance_at(self.state.tail[np.stack([side, around(side)[1]])])
        return (0.35 * self.state.length[side] >= clearance).all(axis=0)

    def _clearance_at(self, vertex: NDArray) -> NDArray[np.float64]:
        """Least allowed distance of points from vertices: 0 except for pinned ones."""
        return np.where(
            self._is_pinned(vertex), self.clearance[np.minimum(vertex, len(self.clearance) - 1)], 0.0
        )

    def _independent(self, targets: Targets, cavity: Cavity) -> Targets:
        """Targets whose cavities, with the faces around them, are disjoint from those of earlier targets."""
        claim = self.state.claim
        order = np.argsort(-cavity.item, kind="stable")
        claim[cavity.face[order]] = cavity.item[order]
        overlaps = np.zeros(len(targets.side), dtype=bool)
        overlaps[cavity.item[claim[cavity.face] != cavity.item]] = True
        wins = ~overlaps & (np.cumsum(~overlaps) <= self.limit - self.locations.n_steiner)
        return targets[np.flatnonzero(wins)]

    # boundary edges

    def _split_boundary(self, side: NDArray) -> NDArray[np.int64]:
        """Cut boundary sides ij of faces (i, j, k) at v; returns the sides whose edges may need a flip."""
        state = self.state
        if len(side) == 0:
            return side
        share = self._shell(side)
        edge, at = self.locations.on_boundary(state, side, share)
        vertex = self.locations.add_on_boundary(edge, at)
        return cut_boundary(state, side, vertex, share, self.locations.edge_direction(edge))

    def _shell(self, side: NDArray) -> NDArray[np.float64]:
        """Fraction of a side at which to cut it: 1/2, or Ruppert's shells (powers of two) at sharp ends."""
        state = self.state
        at_tail, at_head = self._is_pinned(state.tail[side]), self._is_pinned(state.tail[around(side)[1]])
        length = state.length[side]
        shell = np.exp2(np.rint(np.log2(0.5 * length))) / length
        share = np.where(at_tail & ~at_head, shell, 0.5)
        return np.where(at_head & ~at_tail, 1.0 - shell, share)

    # circumcentres

    def _insert(self, targets: Targets) -> NDArray[np.int64]:
        """Insert points into their faces (a, b, c); returns the sides whose edges may need a flip."""
        state = self.state
        face, corner = targets.side // 3, targets.side % 3
        if len(face) == 0:
            return face
        place = (np.arange(3) - corner[:, None]) % 3
        corners = np.take_along_axis(targets.corners, place, axis=1)
        point = targets.centre
        point = pushed_inside(corners, point)
        located = self.locations.locate(state, face, corners, point)
        for _ in range(3):  # move points that are too near an input edge towards the middle of the face
            near = np.flatnonzero(~located.clear)
            point[near] += 0.05 * (corners[near].mean(axis=1) - point[near])
            located.replace(near, self.locations.locate(state, face[near], corners[near], point[near]))
        face, corners, located = face[located.valid], corners[located.valid], located[located.valid]
        if len(face) == 0:
            return face
        distance = np.abs(corners - located.point[:, None])
        from_point = located.turn + np.angle(corners[:, 0] - located.point)
        vertex = self.locations.add_inside(located)
        new = state.split_faces(face, vertex)
        a, b, c, p, q = 3 * face, 3 * face + 1, 3 * face + 2, 3 * new[0], 3 * new[1]
        length, (da, db, dc) = state.length, distance.T
        length[p], length[q] = length[b], length[c]
        length[b], length[c] = db, da
        length[p + 1], length[p + 2], length[q + 1], length[q + 2] = dc, db, da, dc
        state.measure(np.concatenate([face, new[0], new[1]]))
        angle_b, angle_p1, angle_q1, angle_a, angle_p = (
            2 * np.arctan(state.tangent.take(side)) for side in (b, p + 1, q + 1, a, p)
        )
        direction = self.direction
        at_a, at_b, at_c = direction[a], direction[b].copy(), direction[c].copy()
        direction[p], direction[q] = at_b, at_c
        direction[q + 1] = at_a + angle_b
        direction[b] = at_b + angle_p1
        direction[p + 1] = at_c + angle_q1
        direction[c] = from_point
        direction[p + 2] = from_point + angle_a
        direction[q + 2] = direction[p + 2] + angle_p
        return np.concatenate([a, b, c, p, p + 1, p + 2, q, q + 1, q + 2])

    @property
    def direction(self) -> NDArray[np.float64]:
        return self.state.direction  # type: ignore[return-value]


def collapsed_ends(mesh: TriangleMesh, flat: NDArray) -> NDArray[np.int64]:
    """Vertices that coincide with another vertex of a face without area."""
    length = mesh.side_length[flat]
    side = (3 * flat[:, None] + np.arange(3))[
        length <= COINCIDENCE_TOLERANCE * length.max(axis=1, keepdims=True)
    ]
    return np.concatenate([mesh.topology.side_tail[side], mesh.topology.side_head[side]])
