"""Propagate windows of unfolded distance across a surface, in batches.

A window on side h enters the face of h. It represents the straight lines from an unfolded source (sx, sy),
sy < 0, through the interval [b0, b1] of the side; its distance at x is origin + |(x, 0) - (sx, sy)|.

With directions, a window also stores its rotation against the source: a line at phi leaves at turn + phi
(turn - phi if mirrored).

References
----------
J. Mitchell, D. Mount, C. Papadimitriou, The discrete geodesic problem, 1987 (windows);
S. Xin, G. Wang, Improving Chen and Han's algorithm, 2009 (the filter by vertex distances).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.bundles import Bundles
from ddgcli.algorithms.geodesics.exact.children import children, norm, reflect, side_turns
from ddgcli.algorithms.geodesics.exact.dominance import (
    DOMINANCE_TOLERANCE,
    TIE_TOLERANCE,
    dominate,
    reaching,
)
from ddgcli.algorithms.geodesics.exact.pool import POPPED_KEY, WindowOrigins, WindowPool
from ddgcli.algorithms.geodesics.exact.shadow import MARGIN, shadow_of
from ddgcli.algorithms.geodesics.exact.tables import BOUNDARY, WindowTables, incoming_directions
from ddgcli.algorithms.geodesics.exact.targets import WindowTargets
from ddgcli.errors import SolveError
from ddgcli.mesh.ragged import ranges
from ddgcli.mesh.remedies import remedy

MIN_SOURCE_HEIGHT = 1e-15  # relative to the side, so that a source on the side still has lines across it
PROGRESS_INTERVAL = 4  # rounds between two calls of the progress callback
FAN_FACTOR = 2.0  # times sqrt(slack): half-angle in radians that a vertex covers, around straight ahead
SPAWN_INTERVAL = 3  # rounds between two launches from vertices, for fewer and fuller batches


class Wavefront:
    """State of one propagation: distances, last segments of paths, and queues of windows and vertices.

    Parameters
    ----------
    tables : WindowTables
    slack : float
        0 for exact; tau > 0 drops windows if a path by a vertex is at most tau side lengths longer.
    dominance_every : int
        Rounds between two prunings of windows on the same side; 0 disables it (the distances are the same).
    targets : WindowTargets, optional
        Points in faces whose distances are also computed.
    directions : bool
        Compute the angle at which lines to vertices leave their sources (`departure`; nan beyond bends).
    max_crossings : int
        Drop windows that have crossed more faces since their origin; 0: no bound, and bundles are used.
    max_rounds : float
        Rounds after which `run` raises SolveError.
    """

    def __init__(
        self,
        tables: WindowTables,
        *,
        slack: float = 0.0,
        dominance_every: int = 10,
        targets: WindowTargets | None = None,
        directions: bool = False,
        max_crossings: int = 0,
        max_rounds: float = np.inf,
    ) -> None:
        n = tables.n_vertices
        self.max_crossings, self.max_rounds = max_crossings, max_rounds
        self.targets = targets
        self.tables, self.slack, self.dominance_every = tables, slack, dominance_every
        # with slack, paths may bend a little at any vertex; the windows there are narrow
        self.margin = MARGIN + FAN_FACTOR * float(np.sqrt(slack))
        self.bends = tables.bends if slack == 0 else tables.total_angle > 2 * (np.pi - self.margin)
        self.distance = np.full(n, np.inf)
        self.origin = np.full(n, -1, dtype=np.int64)
        self.side = np.full(n, -1, dtype=np.int64)
        self.crossing = np.full(n, np.nan)
        self.spawned_at = np.full(n, np.inf)
        self._place = np.zeros(n, dtype=np.int64)
        self.origins = WindowOrigins()
        self.columns = 4 + int(directions) * (1 if tables.plain else 2)  # b0, b1, sx, sy, turn, sign
        self.side_turn = side_turns(tables) if directions else None
        self.departure = np.full(n if directions else 0, np.nan)
        self.pool = WindowPool(self.columns, ints=3 if max_crossings else 2)
        self.bundles: Bundles | None = None
        if tables.plain and slack == 0 and dominance_every and not max_crossings:
            self.bundles = Bundles(
                tables,
                self.origins,
                self.distance,
                self.side_turn,
                None if targets is None else targets.faces,
            )
        self.pending = np.zeros(0, dtype=np.int64)
        self.windows = self.rounds = self.final = 0
        self.bucket = 3.0 * float(tables.shape[:, 0].mean()) if len(tables.shape) else 1.0

    # -- vertices -----------------------------------------------------------------------------------

    def improve(
        self,
        vertex: NDArray,
        distance: NDArray,
        origin: NDArray,
        side: NDArray | None = None,
        crossing: NDArray | None = None,
        departure: NDArray | None = None,
    ) -> None:
        """Lower distances at vertices (entries may repeat), and store the last segments of the paths.

        `side` is the opposite side that the path crosses at `crossing`; -2 - side if the path runs along an
        edge, through an end of that side; None if it comes from a point in the face.
        """
        better = (distance < self.distance.take(vertex)).nonzero()[0]
        if not len(better):
            return
        vertex, distance = vertex.take(better), distance.take(better)
        np.minimum.at(self.distance, vertex, distance)
        won = distance == self.distance.take(vertex)
        vertex, better = vertex[won], better[won]
        self.origin[vertex] = origin.take(better)
        self.side[vertex] = -1 if side is None else side.take(better)
        self.crossing[vertex] = np.nan if crossing is None else crossing.take(better)
        if self.side_turn is not None:
            self.departure[vertex] = np.nan if departure is None else departure.take(better)
        self.pending = np.concatenate([self.pending, vertex[self.bends[vertex]]])

    def start_vertex(self, vertex: NDArray, source: NDArray, first: NDArray | None = None) -> None:
        """Start from sources at vertices; `first` is as in `_spawn`."""
        origin = self.origins.add(vertex, source, np.zeros(len(vertex)))
        self.distance[vertex] = 0.0
        self.origin[vertex] = origin
        self.spawned_at[vertex] = 0.0
        self._spawn(vertex, origin, np.full(len(vertex), np.nan), first)

    def _spawn(
        self, vertex: NDArray, origin: NDArray, incoming: NDArray, first: NDArray | None = None
    ) -> None:
        """Update distances along the edges of vertices, and launch windows on the opposite sides.

        `incoming` is the direction back along the path at each vertex: only its shadow gets windows (nan: all
        directions do). `first` (3m,) is the direction of the edge from the apex of each side to its first
        corner, at sources, if directions are computed.
        """
        tables = self.tables
        start = tables.around_start.take(vertex)
        count = tables.around_start.take(vertex + 1) - start
        row = np.arange(len(vertex)).repeat(count)
        side = tables.around.take(ranges(start, count)[0])
        shape, ids, row_origin = (
            tables.shape.take(side, axis=0),
            tables.ids.take(side, axis=0),
            origin.take(row),
        )
        reach = shape[:, 3:] + self.origins.distance.take(row_origin)[:, None]
        face = side // 3 * 3
        way = np.stack([face + (side - face + 1) % 3, face + (side - face + 2) % 3], axis=1)
        end = np.stack([shape[:, 4], np.zeros(len(side))], axis=1)
        along = None if first is None else first.take(side)
        edges = None if along is None else np.stack([along, along + tables.angle.take(side)], axis=1).ravel()
        self.improve(
            ids[:, :2].ravel(), reach.ravel(), np.repeat(row_origin, 2), -2 - way.ravel(), end.ravel(), edges
        )
        begin, stop = shadow_of(
            tables.turn.take(side), tables.angle.take(side), tables.total_angle.take(vertex.take(row)),
            incoming.take(row), self.margin,
        )  # fmt: skip
        nonempty = (begin < stop).nonzero()[0]
        if len(nonempty):
            turn = None if along is None else (along - np.arctan2(shape[:, 2], shape[:, 1])).take(nonempty)
            self._fan(
                side.take(nonempty), shape.take(nonempty, axis=0), row_origin.take(nonempty),
                begin.take(nonempty), stop.take(nonempty), turn,
            )  # fmt: skip

    def _fan(
        self, side: NDArray, shape: NDArray, origin: NDArray, begin: NDArray, end: NDArray,
        turn: NDArray | None,
    ) -> None:  # fmt: skip
        """Launch windows from the apex of each side, over the part of the side between two angles at the
        apex."""
        length, x, y, left, right = shape.T
        angle = self.tables.angle.take(side)
        ends = np.empty((2, len(side)))
        for at, phi in zip(ends, (begin, end)):
            from0, from1 = left * np.sin(phi), right * np.sin(angle - phi)
            np.divide(from0, from0 + from1, out=at)
            at *= length
        self.launch(side, x, y, origin, ends, turn)

    def launch(
        self, side: NDArray, x: NDArray, y: NDArray, origin: NDArray, ends: NDArray | None = None,
        turn: NDArray | None = None,
    ) -> None:  # fmt: skip
        """Launch windows from points (x, y) above each side in its own frame, out of its face.

        They cover the part of the side between `ends` (2, k), or the whole side; `turn` is that of the frame
        across.
        """
        length, (d0, d1) = self.tables.shape[side, 0], self.distance.take(self.tables.ids[side, :2].T)
        b0, b1 = (np.zeros(len(side)), length) if ends is None else ends
        base, code = self.origins.distance.take(origin), self.tables.code(side)
        y = np.maximum(y, MIN_SOURCE_HEIGHT * length)
        r0, r1 = base + norm(x - b0, y.copy()), base + norm(b1 - x, y.copy())
        margin = DOMINANCE_TOLERANCE - self.slack * length
        keep = (code != BOUNDARY) & (b1 - b0 > DOMINANCE_TOLERANCE)
        keep &= (r0 <= d1 + (length - b0) + margin) & (r1 <= d0 + b1 + margin)
        rows = keep.nonzero()[0]
        key = np.where((x > b0) & (x < b1), base + y, np.minimum(r0, r1))
        lines = np.ones((self.columns, len(side)))  # in the frame across, from v1 to v0
        lines[0], lines[1], lines[2], lines[3] = length - b1, length - b0, length - x, -y
        lines[4:5] = np.nan if turn is None else turn
        self._enter(
            lines.take(rows, axis=1), code.take(rows), origin.take(rows), key.take(rows), side.take(rows)
        )

    # -- windows ------------------------------------------------------------------------------------

    def _enter(
        self, lines: NDArray, code: NDArray, origin: NDArray, key: NDArray, left_by: NDArray,
        crossings: NDArray | None = None,
    ) -> None:  # fmt: skip
        """Push windows into the neighbouring faces; `lines` are in the frame that runs against side
        `left_by`.

        `crossings` is the number of faces that each has crossed since its origin (None: 0).
        """
        tables = self.tables
        crossings = np.zeros(len(code), dtype=np.int64) if crossings is None else crossings
        if tables.edge_sides is not None and (code < BOUNDARY).any():
            many = code < BOUNDARY
            row, side, same_way = tables.across_many(left_by[many])
            one = ~many
            where_from = np.concatenate([np.flatnonzero(one), np.flatnonzero(many)[row]])
            code = np.concatenate([code[one], side])
            lines, origin, key = lines[:, where_from], origin[where_from], key[where_from]
            crossings = crossings[where_from]
            flip = np.concatenate([np.zeros(int(one.sum()), dtype=bool), same_way])
            if tables.mirrored is not None:
                flip[: int(one.sum())] = tables.mirrored[left_by[one]]
            reflect(lines, flip, tables.shape[code, 0])
        elif tables.mirrored is not None:
            reflect(lines, tables.mirrored[left_by], tables.shape[code, 0])
        where = np.empty((len(self.pool.where), len(code)), dtype=np.int64)
        where[0], where[1], where[2:] = code, origin, crossings
        self.pool.push(lines, where, key)

    def run(
        self,
        limit: float = np.inf,
        most_windows: float = np.inf,
        progress: Callable[[float, float], None] | None = None,
        enough: float = np.inf,
    ) -> None:
        """Propagate until all distances below `limit` are final.

        `progress` is called with the numbers of final and of all vertices. The run stops when `enough`
        vertices are final; another call continues it.

        Raises
        ------
        SolveError
            After `most_windows` windows or `max_rounds` rounds: the surface is too degenerate.
        """
        bundles = self.bundles if limit == enough == np.inf else None
        while True:
            waiting = self._waiting()
            least = min(self.pool.least(), waiting)
            if bundles is not None:
                least = min(least, bundles.pool.least())
            if not least < limit:
                return
            if self.rounds % PROGRESS_INTERVAL == 0 and (progress is not None or enough < np.inf):
                self.final = max(self.final, int(np.count_nonzero(self.distance < least)))
                if progress is not None:
                    progress(float(self.final), float(len(self.distance)))
                if self.final >= enough:
                    return
            bound = max(least + self.bucket, np.nextafter(least, np.inf))
            if waiting < bound and (self.rounds % SPAWN_INTERVAL == 0 or waiting <= least):
                self._spawn_below(bound)
            self.rounds += 1
            lines, where = self._popped(bound, bundles)
            self.windows += where.shape[1]
            if self.windows > most_windows or self.rounds > self.max_rounds:
                raise SolveError(
                    f"exact distance stopped after {self.windows} windows in {self.rounds} rounds on "
                    f"degenerate triangles: use `method=fast-marching`, or {remedy('no area')}"
                )
            if where.shape[1] == 0:
                continue
            if self.targets is not None:
                self.targets.update(lines, where, self.origins)
            self._propagate(lines, where)

    def _popped(self, bound: float, bundles: Bundles | None) -> tuple[NDArray, NDArray]:
        """Pop the next windows; in some rounds all windows are pruned, and bundled where that saves time."""
        has_bundles = bundles is not None and len(bundles) > 0
        interval = self.dominance_every * (2 if has_bundles else 1)
        prune = bool(interval) and self.rounds % interval == 0
        lines, where = self.pool.pop_below(np.inf if prune and has_bundles else bound)
        if bundles is not None and has_bundles:
            before = bundles.moves
            unbound = bundles.dissolve() if prune else bundles.advance(bound)
            self.windows += bundles.moves - before
            lines, where = (np.concatenate(pair, axis=1) for pair in zip((lines, where), unbound))
        if prune and where.shape[1]:
            lines, where = dominate(lines, where, self.tables.shape, self.origins.distance)
            if bundles is not None:
                lines, where = bundles.bind(lines, where)
        return lines, where

    def _waiting(self) -> float:
        """Least distance of the pending vertices; drops those that need no launch."""
        if not len(self.pending):
            return POPPED_KEY
        distance = self.distance[self.pending]
        queued = distance < self.spawned_at[self.pending] - TIE_TOLERANCE * (1 + distance)
        self.pending = self.pending[queued]
        return float(distance[queued].min(initial=POPPED_KEY))

    def _spawn_below(self, bound: float) -> None:
        distance = self.distance[self.pending]
        now = distance < bound
        vertex = self._once(self.pending[now])
        self.pending = self.pending[~now]
        before = self.origin[vertex]
        self.spawned_at[vertex] = self.distance[vertex]
        origin = self.origins.add(vertex, self.origins.source[before], self.distance[vertex])
        self._spawn(
            vertex,
            origin,
            incoming_directions(self.tables, self.side.take(vertex), self.crossing.take(vertex)),
        )

    def _once(self, vertex: NDArray) -> NDArray[np.int64]:
        """Unique vertices."""
        place = np.arange(len(vertex))
        self._place[vertex] = place
        return vertex[self._place[vertex] == place]

    def _propagate(self, lines: NDArray, where: NDArray) -> None:
        """Propagate windows across their faces: update the apex, then push the children that the filter
        keeps."""
        side, origin = where[:2]
        base = self.origins.distance.take(origin)
        shape = np.ascontiguousarray(self.tables.shape.take(side, axis=0).T)
        ids = np.ascontiguousarray(self.tables.ids.take(side, axis=0).T)
        b0, b1, sx, sy = lines[:4]
        dx, dy = shape[1] - sx, shape[2] - sy
        at = sx - dx * sy / dy  # where the line to the apex crosses the side

        reached = reaching(at, lines, dx, dy).nonzero()[0]
        if len(reached):
            reach = base.take(reached) + norm(dx.take(reached), dy.take(reached))
            crossing = np.clip(at.take(reached), 0.0, shape[0].take(reached))
            update = ids[2].take(reached), reach, origin.take(reached), side.take(reached), crossing
            self.improve(*update, self._departures(lines, dx, dy, reached))

        left, right = (at > b0).nonzero()[0], (at < b1).nonzero()[0]
        parent, n_left = np.concatenate([left, right]), len(left)
        rows, out, key = children(
            n_left,
            lines.take(parent, axis=1),
            at.take(parent),
            shape.take(parent, axis=1),
            self.distance.take(ids[:3].take(parent, axis=1)),
            base.take(parent),
            self.slack,
        )
        k = int(np.searchsorted(rows, n_left))
        source = parent.take(rows)
        if self.side_turn is not None:
            to = 2 * side.take(source)
            to[k:] += 1
            out[4] += self.side_turn.take(to) if len(out) == 5 else self.side_turn.take(to) * out[5]
        code = np.concatenate([ids[3].take(source[:k]), ids[4].take(source[k:])])
        inner = code != BOUNDARY
        crossings = None
        if self.max_crossings:
            crossings = where[2].take(source) + 1
            inner &= crossings < self.max_crossings
            crossings = crossings[inner]
        inner = inner.nonzero()[0]
        if len(inner) < len(rows):
            rows, out, key = rows.take(inner), out.take(inner, axis=1), key.take(inner)
            code, source = code.take(inner), source.take(inner)
        left_by = code[:0]  # needed only where crossings are not plain
        if self.tables.mirrored is not None or self.tables.edge_sides is not None:
            face, j = np.divmod(side.take(source), 3)
            left_by = 3 * face + (j + np.where(rows < n_left, 2, 1)) % 3
        self._enter(out, code, origin.take(source), key, left_by, crossings)

    def _departures(self, lines: NDArray, dx: NDArray, dy: NDArray, reached: NDArray) -> NDArray | None:
        """Angles at which lines with direction (dx, dy) through some windows leave the source."""
        if self.side_turn is None:
            return None
        angle = np.arctan2(dy.take(reached), dx.take(reached))
        return lines[4].take(reached) + (angle if len(lines) == 5 else angle * lines[5].take(reached))
