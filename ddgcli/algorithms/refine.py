"""Intrinsic Delaunay refinement: Steiner points until no angle is smaller than asked (chapter 10, section 4).

L. P. Chew, "Guaranteed-quality mesh generation for curved surfaces", 1993, and J. Ruppert, "A Delaunay
refinement algorithm for quality 2-dimensional mesh generation", 1995, on intrinsic triangulations as in
N. Sharp et al., "Navigating intrinsic triangulations", 2019. Circumcentres of bad triangles are inserted; one
that would come too near a boundary edge, or beyond it, splits that edge instead. Insertions go in batches
that do not meet.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.circumcentres import (
    BEYOND_BOUNDARY,
    INSIDE,
    LEAST_SHARE,
    ON_BOUNDARY,
    Cavity,
    Targets,
    apex_of,
    conflict_cavity,
    pushed_inside,
    seek_circumcentres,
    triangle_share,
)
from ddgcli.algorithms.common_subdivision import Base, sides_between
from ddgcli.algorithms.delaunay import Flipped, flip_to_delaunay, glue, length_scale, working_lengths
from ddgcli.algorithms.flips import SideArrays, flip_until_delaunay
from ddgcli.algorithms.gluing import around
from ddgcli.algorithms.steiner_base import SteinerPoints, with_steiner_points
from ddgcli.algorithms.trace import Tracer
from ddgcli.errors import ParameterError
from ddgcli.geometry.intrinsic import corner_angle, face_area
from ddgcli.geometry.unfolding import corner_position, vertex_fans
from ddgcli.mesh.require import require
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh

log = logging.getLogger("ddgcli")

SHARP = np.pi / 3  # cones and boundary corners of a smaller total angle are left as they are
NEAREST_TO_SHARP = 0.1  # no point comes nearer to them, relative to their shortest edge before refinement
FEWEST_TRIED, TRIED_FOR_EACH = 256, 24  # bad faces in a batch: at least, and for each point of the last one
KEEP_OFF_EDGES = 0.01  # distance from input edges, relative to that from the nearest vertex


@dataclass(frozen=True, eq=False)
class Refined:
    """A refined intrinsic triangulation.

    Parameters
    ----------
    flipped : Flipped
        The intrinsic Delaunay triangulation of input vertices and Steiner points, with normal coordinates.
    base : Base
        The input with the Steiner points inserted, which those coordinates refer to.
    steiner : SteinerPoints
        Where they lie on the input.
    flips : int
        While points were inserted.
    batches : int
    sharp_vertices : int
        Interior vertices and boundary corners of total angle below 60 degrees.
    excepted_faces : int
        Faces at or beside those whose smallest angle stays below the one asked.
    unreached_faces : int
        Other such faces: 0 unless the points ran out.
    reached : bool
    """

    flipped: Flipped
    base: Base
    steiner: SteinerPoints
    flips: int
    batches: int
    sharp_vertices: int
    excepted_faces: int
    unreached_faces: int
    reached: bool


def refine(mesh: TriangleMesh, degrees: float, *, max_points: int | None = None) -> Refined:
    """Insert Steiner points until no intrinsic angle is smaller than `degrees`.

    Parameters
    ----------
    mesh : TriangleMesh
        Manifold and oriented.
    degrees : float
        Above 0 and at most 33; up to 25 the batches end on every surface, up to 30 on nearly every one.
    max_points : int, optional
        At most so many Steiner points; by default ten for each vertex, and 100,000 at least.

    Raises
    ------
    ParameterError, MeshError
    """
    if not 0 < degrees <= 33:
        raise ParameterError(
            f"refinement to {degrees:g} degrees does not end; ask for at most 33 (25 is safe)"
        )
    require(mesh, "refinement", manifold=True, oriented=True)
    limit = max(100_000, 10 * mesh.n_vertices) if max_points is None else max_points
    work = _Refinement(mesh, np.radians(degrees), limit)
    while work.advance():
        pass
    steiner = work.steiner()
    base = with_steiner_points(mesh, steiner)
    flipped = flip_to_delaunay(base.mesh, track=True)
    small = (corner_angle(flipped.mesh.side_length) < np.radians(degrees) * (1 - 1e-6)).any(axis=1)
    beside = work.near_sharp(flipped)
    unreached = int((small & ~beside).sum())
    if work.exhausted:
        log.warning(
            f"refinement stopped at {limit} Steiner points with {unreached} faces still below "
            f"{degrees:g} degrees; raise --max-points"
        )
    return Refined(
        flipped=flipped,
        base=base,
        steiner=steiner,
        flips=work.flips,
        batches=work.batches,
        sharp_vertices=int(work.sharp.sum()),
        excepted_faces=int((small & beside).sum()),
        unreached_faces=unreached,
        reached=unreached == 0,
    )


@dataclass(eq=False)
class _Located:
    """Points of laid-out intrinsic faces and where they lie on the input.

    `turn` is the angle from the layout to the planar frame of the input face; `sound` is False where the line
    to the point left the surface (it does not in exact arithmetic), `clear` where an input edge is too near.
    """

    sound: NDArray[np.bool_]
    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    point: NDArray[np.complex128]
    turn: NDArray[np.float64]
    clear: NDArray[np.bool_]

    def __getitem__(self, chosen: NDArray) -> _Located:
        return _Located(**{name: value[chosen] for name, value in vars(self).items()})

    def replace(self, place: NDArray, other: _Located) -> None:
        for name, value in vars(other).items():
            getattr(self, name)[place] = value


class _Refinement:
    """The triangulation under refinement, and where its vertices lie on the input.

    Directions at input vertices are angles from the first side of the vertex's fan; at Steiner points they
    are angles in the planar frame of the input face that holds the point.
    """

    def __init__(self, mesh: TriangleMesh, angle: float, limit: int) -> None:
        self.mesh, self.limit = mesh, limit
        self.bound = np.tan(angle / 2)
        self.tracer, self.fans = Tracer(mesh), vertex_fans(mesh)
        glued = glue(mesh)
        length = working_lengths(mesh, glued)[0].astype(np.float64)
        self.scale = length_scale(length)
        self.state = SideArrays.of(glued.faces, glued.topology.side_twin, length / self.scale)
        self.state.direction = self.fans.angle_before.copy()
        self.flips, self.batches = flip_until_delaunay(self.state)[0], 0
        self.exhausted = False
        self.random, self.crowd = np.random.default_rng(0), FEWEST_TRIED

        n = mesh.n_vertices
        self.fan = np.full(n, -1, dtype=np.int64)
        self.fan[self.fans.vertex] = np.arange(len(self.fans.vertex))
        self.sharp = np.zeros(n, dtype=bool)
        self.sharp[self.fans.vertex] = self.fans.total_angle < SHARP - 1e-9
        self.keep_off = self._keep_off(n)
        self.face = np.full(n, -1, dtype=np.int64)
        self.barycentric = np.zeros((n, 3))
        self.edge = np.full(n, -1, dtype=np.int64)  # input side of boundary Steiner points
        self.edge_share = np.zeros(n)

    def _keep_off(self, n: int) -> NDArray[np.float64]:
        """(n,) distance from sharp vertices within which no point is inserted; 0 at the others."""
        state = self.state
        nearest = np.full(n, np.inf)
        for end in (state.tail, state.tail[around(np.arange(len(state.tail)))[1]]):
            np.minimum.at(nearest, end, state.length)
        return np.where(self.sharp, NEAREST_TO_SHARP * nearest, 0.0)

    @property
    def n_steiner(self) -> int:
        return len(self.face) - self.mesh.n_vertices

    def steiner(self) -> SteinerPoints:
        """Where the Steiner points lie, in the order of their insertion."""
        n = self.mesh.n_vertices
        return SteinerPoints(self.face[n:], self.barycentric[n:], self.edge[n:], self.edge_share[n:])

    def near_sharp(self, flipped: Flipped) -> NDArray:
        """(m,) faces of the final triangulation with a sharp vertex, or within the reach kept free of one."""
        sharp = np.zeros(flipped.mesh.n_vertices, dtype=bool)
        sharp[: self.mesh.n_vertices] = self.sharp
        faces = flipped.mesh.faces
        at = np.any(sharp[faces], axis=1)
        ring = np.zeros(len(sharp), dtype=bool)
        ring[faces[at]] = True
        return np.any(ring[faces], axis=1)

    def advance(self) -> bool:
        """One batch of insertions and the flips after it; False when there was nothing to insert."""
        state = self.state
        smallest = state.tangent.reshape(-1, 3).min(axis=1)
        bad = np.flatnonzero(smallest < self.bound)
        at_sharp = np.any(self._is_sharp(state.tail.reshape(-1, 3)[bad]), axis=1)
        bad = bad[~at_sharp]
        if len(bad) == 0:
            return False
        if self.n_steiner >= self.limit:
            self.exhausted = True
            return False
        while True:
            some = bad if len(bad) <= self.crowd else self.random.choice(bad, self.crowd, replace=False)
            some = some[np.argsort(smallest[some])]
            touched = self._insert_at(some)
            if len(touched) or len(some) == len(bad):
                break
            self.crowd *= 8
        if len(touched) == 0:
            return False
        self.flips += flip_until_delaunay(state, touched)[0]
        self.batches += 1
        return True

    def _insert_at(self, bad: NDArray) -> NDArray[np.int64]:
        """Insert points for bad faces, worst first; returns the sides whose edges may need a flip."""
        targets = self._independent(*self._proposals(bad))
        # where all points crowd into a few cavities, next time fewer are tried
        self.crowd = max(FEWEST_TRIED, TRIED_FOR_EACH * len(targets.side))
        on_boundary = targets.status == ON_BOUNDARY
        inner = targets[np.flatnonzero(~on_boundary)]
        return np.concatenate([self._split_boundary(targets.side[on_boundary]), self._insert(inner)])

    def _is_sharp(self, vertex: NDArray) -> NDArray:
        return (vertex < self.mesh.n_vertices) & self.sharp[np.minimum(vertex, self.mesh.n_vertices - 1)]

    def _proposals(self, bad: NDArray) -> tuple[Targets, Cavity]:
        """Points to insert for bad faces, worst first: circumcentres, or middles of boundary sides."""
        state = self.state
        targets = seek_circumcentres(state, bad)
        inside = np.flatnonzero(targets.status == INSIDE)
        cavity = conflict_cavity(state, targets[inside])
        edge = np.full(len(bad), -1)
        edge[inside] = cavity.encroached
        beyond = targets.status == BEYOND_BOUNDARY
        edge[beyond] = targets.side[beyond]
        wanted = (targets.status == INSIDE) & (edge < 0)
        wanted[wanted] = self._clear_of_sharp(targets[np.flatnonzero(wanted)])
        split = np.flatnonzero(edge >= 0)
        split = split[np.sort(np.unique(edge[split], return_index=True)[1])]
        split = split[self._may_split(edge[split])]
        targets.status[split], targets.side[split] = ON_BOUNDARY, edge[split]
        self._lay_out(targets, split)
        around_splits = conflict_cavity(state, targets[split])

        still = wanted[inside[cavity.item]]
        item = np.concatenate([split[around_splits.item], inside[cavity.item[still]]])
        face = np.concatenate([around_splits.face, cavity.face[still]])
        wanted[split] = True
        rank = np.cumsum(wanted) - 1
        return targets[np.flatnonzero(wanted)], Cavity(rank[item], face, edge[wanted])

    def _lay_out(self, targets: Targets, split: NDArray) -> None:
        """Lay out the faces of boundary sides that are to be cut, and the places of the cuts."""
        side = targets.side[split]
        length = self.state.length[side]
        corners = np.stack([np.zeros(len(side)), length, apex_of(self.state, side) * length], axis=1)
        targets.corners[split] = corners
        targets.centre[split] = self._shell(side) * length

    def _clear_of_sharp(self, targets: Targets) -> NDArray[np.bool_]:
        _, following, previous = around(targets.side)
        clear: NDArray[np.bool_] = np.ones(len(targets.side), dtype=bool)
        for k, side in enumerate((targets.side, following, previous)):
            reach = self._reach(self.state.tail[side])
            clear &= np.abs(targets.centre - targets.corners[:, k]) >= reach
        return clear

    def _may_split(self, side: NDArray) -> NDArray:
        reach = self._reach(self.state.tail[np.stack([side, around(side)[1]])])
        return (0.35 * self.state.length[side] >= reach).all(axis=0)

    def _reach(self, vertex: NDArray) -> NDArray[np.float64]:
        """Distance to keep from vertices: 0 but for sharp ones."""
        return np.where(
            self._is_sharp(vertex), self.keep_off[np.minimum(vertex, len(self.keep_off) - 1)], 0.0
        )

    def _independent(self, targets: Targets, cavity: Cavity) -> Targets:
        """Those whose cavities and the faces around them meet no earlier one's."""
        claim = self.state.claim
        order = np.argsort(-cavity.item, kind="stable")
        claim[cavity.face[order]] = cavity.item[order]
        lost = np.zeros(len(targets.side), dtype=bool)
        lost[cavity.item[claim[cavity.face] != cavity.item]] = True
        wins = ~lost & (np.cumsum(~lost) <= self.limit - self.n_steiner)
        return targets[np.flatnonzero(wins)]

    def _add_vertices(
        self, face: NDArray, barycentric: NDArray, edge: NDArray, share: NDArray
    ) -> NDArray[np.int64]:
        first = len(self.face)
        self.face = np.concatenate([self.face, face])
        self.barycentric = np.concatenate([self.barycentric, barycentric])
        self.edge, self.edge_share = (
            np.concatenate([self.edge, edge]),
            np.concatenate([self.edge_share, share]),
        )
        return first + np.arange(len(face))

    # boundary edges

    def _split_boundary(self, side: NDArray) -> NDArray[np.int64]:
        """Cut boundary sides ij of faces (i, j, k) at v; returns the sides whose edges may need a flip."""
        state = self.state
        if len(side) == 0:
            return side
        _, jk, ki = around(side)
        share = self._shell(side)
        edge, at = self._place_on_edge(side, share)
        corner = edge % 3
        barycentric = np.zeros((len(side), 3))
        barycentric[np.arange(len(side)), corner] = 1.0 - at
        barycentric[np.arange(len(side)), (corner + 1) % 3] = at
        vertex = self._add_vertices(edge // 3, barycentric, edge, at)

        whole, lengths_jk = state.length[side].copy(), state.length[jk].copy()
        to_apex = np.abs(apex_of(state, side) - share) * whole
        old_jk, old_ki = state.direction[jk].copy(), state.direction[ki].copy()  # type: ignore[index]
        new = state.split_boundary(side, vertex)
        p = 3 * new
        state.length[side], state.length[jk] = share * whole, to_apex
        state.length[p], state.length[p + 1], state.length[p + 2] = (1 - share) * whole, lengths_jk, to_apex
        state.measure(np.concatenate([side // 3, new]))
        x, y = self.tracer.unfolding.direction[edge // 3, corner].T
        direction = self.direction
        direction[p] = np.arctan2(y, x)
        direction[p + 1] = old_jk
        direction[jk] = direction[p] + 2 * np.arctan(state.tangent[p + 1])
        direction[p + 2] = old_ki + 2 * np.arctan(state.tangent[side])
        return np.concatenate([side, jk, ki, p, p + 1, p + 2])

    def _shell(self, side: NDArray) -> NDArray[np.float64]:
        """Share at which to cut: the middle, or a power of two from a sharp corner (Ruppert's shells)."""
        state = self.state
        at_tail, at_head = self._is_sharp(state.tail[side]), self._is_sharp(state.tail[around(side)[1]])
        length = state.length[side]
        shell = np.exp2(np.rint(np.log2(0.5 * length))) / length
        share = np.where(at_tail & ~at_head, shell, 0.5)
        return np.where(at_head & ~at_tail, 1.0 - shell, share)

    def _place_on_edge(self, side: NDArray, share: NDArray) -> tuple[NDArray, NDArray]:
        """Input side, and share of it, of points at a share of intrinsic boundary sides."""
        tail, head = self.state.tail[side], self.state.tail[around(side)[1]]
        edge = np.where(self.edge[tail] >= 0, self.edge[tail], self.edge[head])
        whole = np.flatnonzero(edge < 0)  # both ends are input vertices
        edge[whole] = sides_between(self.mesh, tail[whole], head[whole])
        low = np.where(self.edge[tail] >= 0, self.edge_share[tail], 0.0)
        high = np.where(self.edge[head] >= 0, self.edge_share[head], 1.0)
        return edge, low + share * (high - low)

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
        located = self._locate(face, corners, point)
        for _ in range(3):  # towards the middle of the face where an input edge is too near
            near = np.flatnonzero(~located.clear)
            point[near] += 0.05 * (corners[near].mean(axis=1) - point[near])
            located.replace(near, self._locate(face[near], corners[near], point[near]))
        face, corners, located = face[located.sound], corners[located.sound], located[located.sound]
        if len(face) == 0:
            return face
        distance = np.abs(corners - located.point[:, None])
        from_point = located.turn + np.angle(corners[:, 0] - located.point)
        k = len(face)
        vertex = self._add_vertices(located.face, located.barycentric, np.full(k, -1), np.zeros(k))
        new = state.split_faces(face, vertex)
        a, b, c, p, q = 3 * face, 3 * face + 1, 3 * face + 2, 3 * new[0], 3 * new[1]
        length, (da, db, dc) = state.length, distance.T
        length[p], length[q] = length[b], length[c]
        length[b], length[c] = db, da
        length[p + 1], length[p + 2], length[q + 1], length[q + 2] = dc, db, da, dc
        state.measure(np.concatenate([face, new[0], new[1]]))
        angle, direction = 2 * np.arctan(state.tangent), self.direction
        at_a, at_b, at_c = direction[a], direction[b].copy(), direction[c].copy()
        direction[p], direction[q] = at_b, at_c
        direction[q + 1] = at_a + angle[b]
        direction[b] = at_b + angle[p + 1]
        direction[p + 1] = at_c + angle[q + 1]
        direction[c] = from_point
        direction[p + 2] = from_point + angle[a]
        direction[q + 2] = direction[p + 2] + angle[p]
        return np.concatenate([a, b, c, p, p + 1, p + 2, q, q + 1, q + 2])

    def _locate(self, face: NDArray, corners: NDArray, point: NDArray) -> _Located:
        """Find points of intrinsic faces, laid out with their corners, on the input."""
        k = np.arange(len(face))
        distance = np.abs(corners - point[:, None])
        near = distance.argmin(axis=1)
        start, following = corners[k, near], corners[k, (near + 1) % 3]
        side = 3 * face + near
        turn = np.angle((point - start) / (following - start))
        where, barycentric, heading = self._start(self.state.tail[side], self.direction[side] + turn)
        planar = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        ends = self.tracer.trace(where, barycentric, planar, distance[k, near] * self.scale)
        found = _Located(
            sound=(ends.status == 0) & np.isfinite(ends.barycentric).all(axis=1),
            face=ends.face,
            barycentric=np.nan_to_num(ends.barycentric, nan=1 / 3),  # in a face without area
            point=point,
            turn=np.arctan2(ends.direction[:, 1], ends.direction[:, 0]) - np.angle(point - start),
            clear=np.ones(len(face), dtype=bool),
        )
        return self._off_input_edges(found, corners, KEEP_OFF_EDGES * distance[k, near])

    def _off_input_edges(self, found: _Located, corners: NDArray, reach: NDArray) -> _Located:
        """Points moved to a distance from the input edges, where they stay inside their intrinsic faces."""
        layout = corner_position(self.tracer.unfolding, found.face) / self.scale
        places = layout[..., 0] + 1j * layout[..., 1]
        side = self.mesh.side_length[found.face] / self.scale
        height = 2 * face_area(side)[:, None] / side[:, NEXT]
        least = np.minimum(np.divide(reach[:, None], height, out=np.ones_like(height), where=height > 0), 0.2)
        barycentric = np.maximum(found.barycentric, least)
        barycentric /= barycentric.sum(axis=1, keepdims=True)
        shift = ((barycentric - found.barycentric) * places).sum(axis=1)
        point = found.point + shift * np.exp(-1j * found.turn)
        moved = triangle_share(corners, point).min(axis=1) > 0.5 * LEAST_SHARE
        return _Located(
            found.sound,
            found.face,
            np.where(moved[:, None], barycentric, found.barycentric),
            np.where(moved, point, found.point),
            found.turn,
            moved,
        )

    def _start(self, vertex: NDArray, direction: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Face, barycentric coordinates and heading in the face's frame of directions at vertices."""
        face, barycentric = self.face[vertex].copy(), self.barycentric[vertex].copy()
        heading = direction.copy()
        given = np.flatnonzero(vertex < self.mesh.n_vertices)
        fan = self.fan[vertex[given]]
        angle = np.mod(direction[given], np.where(self.fans.is_open[fan], np.inf, self.fans.total_angle[fan]))
        corner = self.fans.locate(fan, angle)
        face[given] = corner // 3
        barycentric[given] = np.eye(3)[corner % 3]
        x, y = self.tracer.unfolding.direction[corner // 3, corner % 3].T
        within = np.clip(angle - self.fans.angle_before[corner], 0.0, self.fans.corner_angle[corner])
        heading[given] = np.arctan2(y, x) + within
        return face, barycentric, heading

    @property
    def direction(self) -> NDArray[np.float64]:
        return self.state.direction  # type: ignore[return-value]
