"""Windows on the march: batched propagation of unfolded distance across a surface.

A window on side h enters the face of h. It stands for the straight lines from an unfolded source (sx, sy),
sy < 0, through the interval [b0, b1] of the side; its distance at x is origin + |(x, 0) - (sx, sy)|.

References
----------
J. Mitchell, D. Mount, C. Papadimitriou, The discrete geodesic problem, 1987 (windows);
S. Xin, G. Wang, Improving Chen and Han's algorithm, 2009 (the filter by vertex distances).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.window_tables import BOUNDARY, WindowTables
from ddgcli.errors import SolveError

EPS = 1e-12  # of the longest side (which lies in [1/2, 1) here); always on the side of keeping a window
LIFT = 1e-15  # of a side: least height of a source above it, so that one on the side itself still sees across
NEVER = np.inf


class Pool:
    """Waiting windows: rows of (b0, b1, sx, sy), of (side, origin), and a key that is inf in free slots."""

    def __init__(self, capacity: int = 1024) -> None:
        self.lines = np.empty((capacity, 4))
        self.where = np.empty((capacity, 2), dtype=np.int64)
        self.key = np.full(capacity, NEVER)
        self.top = 0
        self._free = np.zeros(0, dtype=np.int64)

    def least(self) -> float:
        return float(self.key[: self.top].min(initial=NEVER))

    def push(self, lines: NDArray, where: NDArray, key: NDArray) -> None:
        count, reused = len(key), min(len(key), len(self._free))
        fresh = count - reused
        if self.top + fresh > len(self.key):
            self._grow(self.top + fresh)
        if reused:
            slot = self._free[:reused]
            self.lines[slot], self.where[slot], self.key[slot] = lines[:reused], where[:reused], key[:reused]
            self._free = self._free[reused:]
        if fresh:
            end = self.top + fresh
            self.lines[self.top : end] = lines[reused:]
            self.where[self.top : end] = where[reused:]
            self.key[self.top : end] = key[reused:]
            self.top = end

    def pop_below(self, bound: float) -> tuple[NDArray, NDArray]:
        slot = np.flatnonzero(self.key[: self.top] < bound)
        lines, where = self.lines.take(slot, axis=0), self.where.take(slot, axis=0)
        self.key[slot] = NEVER
        if len(self._free):
            self._compact()
        else:
            self._free = slot
        return lines, where

    def _compact(self) -> None:
        live = np.flatnonzero(self.key[: self.top] < NEVER)
        k = len(live)
        self.lines[:k], self.where[:k] = self.lines.take(live, axis=0), self.where.take(live, axis=0)
        self.key[:k] = self.key[live]
        self.key[k : self.top] = NEVER
        self.top = k
        self._free = self._free[:0]

    def _grow(self, need: int) -> None:
        capacity = max(need, 2 * len(self.key))
        extra = capacity - len(self.key)
        self.lines = np.concatenate([self.lines, np.empty((extra, 4))])
        self.where = np.concatenate([self.where, np.empty((extra, 2), dtype=np.int64)])
        self.key = np.concatenate([self.key, np.full(extra, NEVER)])


class Origins:
    """Points that windows unfold from: the sources, and vertices that a shortest path bends around."""

    def __init__(self) -> None:
        self.count = 0
        self._vertex = np.empty(64, dtype=np.int64)
        self._source = np.empty(64, dtype=np.int64)
        self._distance = np.empty(64)

    def add(self, vertex: NDArray, source: NDArray, distance: NDArray) -> NDArray[np.int64]:
        first, self.count = self.count, self.count + len(vertex)
        if self.count > len(self._vertex):
            for name in ("_vertex", "_source", "_distance"):
                old = getattr(self, name)
                grown = np.empty(2 * self.count, dtype=old.dtype)
                grown[:first] = old[:first]
                setattr(self, name, grown)
        self._vertex[first : self.count] = vertex
        self._source[first : self.count] = source
        self._distance[first : self.count] = distance
        return np.arange(first, self.count)

    @property
    def vertex(self) -> NDArray[np.int64]:
        return self._vertex[: self.count]

    @property
    def source(self) -> NDArray[np.int64]:
        return self._source[: self.count]

    @property
    def distance(self) -> NDArray[np.float64]:
        return self._distance[: self.count]


class Front:
    """State of one propagation: distances so far, how each was reached, windows and vertices that wait.

    Parameters
    ----------
    tables : WindowTables
    slack : float
        0 for exact; tau > 0 drops windows that a vertex path matches within tau side lengths.
    dominance_every : int
        Rounds between two prunes of windows on the same side; 0 never prunes (the distances are the same).
    """

    def __init__(self, tables: WindowTables, *, slack: float = 0.0, dominance_every: int = 2) -> None:
        n = tables.n_vertices
        self.tables, self.slack, self.dominance_every = tables, slack, dominance_every
        self.bends = np.ones(n, dtype=bool) if slack > 0 else tables.bends
        self.distance = np.full(n, np.inf)
        self.origin = np.full(n, -1, dtype=np.int64)
        self.side = np.full(n, -1, dtype=np.int64)
        self.crossing = np.full(n, np.nan)
        self.spawned_at = np.full(n, np.inf)
        self.origins = Origins()
        self.pool = Pool()
        self.pending = np.zeros(0, dtype=np.int64)
        self.windows = 0
        self.rounds = 0
        self.bucket = 1.5 * float(tables.shape[:, 0].mean()) if len(tables.shape) else 1.0

    # -- vertices -----------------------------------------------------------------------------------

    def improve(
        self, vertex: NDArray, distance: NDArray, origin: NDArray, side: NDArray, crossing: NDArray
    ) -> None:
        """Lower distances at vertices (entries may repeat), and note the winners' way in."""
        better = np.flatnonzero(distance < self.distance.take(vertex))
        if not len(better):
            return
        vertex, distance = vertex[better], distance[better]
        np.minimum.at(self.distance, vertex, distance)
        won = distance == self.distance.take(vertex)
        vertex, better = vertex[won], better[won]
        self.origin[vertex] = origin[better]
        self.side[vertex] = side[better]
        self.crossing[vertex] = crossing[better]
        self.pending = np.concatenate([self.pending, vertex[self.bends[vertex]]])

    def start_vertex(self, vertex: NDArray, source: NDArray) -> None:
        """Sources at vertices, distance zero."""
        origin = self.origins.add(vertex, source, np.zeros(len(vertex)))
        self.distance[vertex] = 0.0
        self.origin[vertex] = origin
        self.spawned_at[vertex] = 0.0
        self._spawn(vertex, origin)

    def _spawn(self, vertex: NDArray, origin: NDArray) -> None:
        """Distances along the edges at each vertex, and windows on the sides opposite it."""
        start, end = self.tables.around_start[vertex], self.tables.around_start[vertex + 1]
        count = end - start
        row = np.repeat(np.arange(len(vertex)), count)
        offset = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
        side = self.tables.around[start[row] + offset]
        length, x, y, left, right = self.tables.shape[side].T
        v0, v1 = self.tables.ids[side, 0], self.tables.ids[side, 1]
        base = self.origins.distance[origin][row]
        none = np.full(2 * len(row), -1, dtype=np.int64)
        self.improve(
            np.concatenate([v0, v1]),
            np.concatenate([base + left, base + right]),
            np.concatenate([origin[row], origin[row]]),
            none,
            np.full(2 * len(row), np.nan),
        )
        self.launch(side, x, y, origin[row])

    def launch(self, side: NDArray, x: NDArray, y: NDArray, origin: NDArray) -> None:
        """Windows over whole sides, from points (x, y) above each side in its own frame, leaving its face."""
        length = self.tables.shape[side, 0]
        y = np.maximum(y, LIFT * length)
        lines = np.stack([np.zeros(len(side)), length, length - x, -y], axis=1)
        code = self._code(side)
        r0 = self.origins.distance[origin] + np.hypot(length - x, y)  # at the end where the new frame starts
        r1 = self.origins.distance[origin] + np.hypot(x, y)
        margin = EPS - self.slack * length
        v0, v1 = self.tables.ids[side, 0], self.tables.ids[side, 1]
        keep = (code != BOUNDARY) & (length > EPS)
        keep &= (r1 <= self.distance[v1] + length + margin) & (r0 <= self.distance[v0] + length + margin)
        key = np.where((x > 0) & (x < length), self.origins.distance[origin] + y, np.minimum(r0, r1))
        self._enter(lines[keep], code[keep], origin[keep], key[keep], side[keep])

    def _code(self, side: NDArray) -> NDArray:
        face, j = np.divmod(side, 3)
        return self.tables.ids[3 * face + (j + 1) % 3, 3]

    # -- windows ------------------------------------------------------------------------------------

    def _enter(self, lines: NDArray, code: NDArray, origin: NDArray, key: NDArray, left_by: NDArray) -> None:
        """Push windows into the faces across; `lines` are in the frame that runs against side `left_by`."""
        tables = self.tables
        if tables.edge_sides is not None and (code < BOUNDARY).any():
            many = code < BOUNDARY
            row, side, same_way = tables.across_many(left_by[many])
            one = ~many
            where_from = np.concatenate([np.flatnonzero(one), np.flatnonzero(many)[row]])
            code = np.concatenate([code[one], side])
            lines, origin, key = lines[where_from], origin[where_from], key[where_from]
            flip = np.concatenate([np.zeros(int(one.sum()), dtype=bool), same_way])
            if tables.mirrored is not None:
                flip[: int(one.sum())] = tables.mirrored[left_by[one]]
            _reflect(lines, flip, tables.shape[code, 0])
        elif tables.mirrored is not None:
            _reflect(lines, tables.mirrored[left_by], tables.shape[code, 0])
        where = np.empty((len(code), 2), dtype=np.int64)
        where[:, 0] = code
        where[:, 1] = origin
        self.pool.push(lines, where, key)

    def run(self, limit: float = np.inf, most_windows: float = np.inf) -> None:
        """Propagate until nothing waits below `limit` (distances below it are then final).

        Raises
        ------
        SolveError
            After `most_windows` windows: the surface is too degenerate for this method.
        """
        while True:
            waiting = self._waiting()
            least = min(self.pool.least(), waiting)
            if not least < limit:
                return
            bound = max(least + self.bucket, np.nextafter(least, np.inf))
            if waiting < bound:
                self._spawn_below(bound)
            lines, where = self.pool.pop_below(bound)
            self.rounds += 1
            if len(where) == 0:
                continue
            if self.dominance_every and self.rounds % self.dominance_every == 0 and len(where) > 1:
                lines, where = dominate(lines, where, self.tables.shape, self.origins.distance)
            self.windows += len(where)
            if self.windows > most_windows:
                raise SolveError(
                    f"exact distance gave up after {self.windows} windows; the triangles are too degenerate: "
                    "use --method heat, or repair the mesh"
                )
            self._propagate(lines, where)

    def _waiting(self) -> float:
        """Least distance of the vertices that wait to be origins; forgets those that need not."""
        if not len(self.pending):
            return NEVER
        distance = self.distance[self.pending]
        live = distance < self.spawned_at[self.pending]
        self.pending = self.pending[live]
        return float(distance[live].min(initial=NEVER))

    def _spawn_below(self, bound: float) -> None:
        distance = self.distance[self.pending]
        now = distance < bound
        vertex = np.unique(self.pending[now])
        self.pending = self.pending[~now]
        before = self.origin[vertex]
        self.spawned_at[vertex] = self.distance[vertex]
        origin = self.origins.add(vertex, self.origins.source[before], self.distance[vertex])
        self._spawn(vertex, origin)

    def _propagate(self, lines: NDArray, where: NDArray) -> None:
        """Carry windows across their faces: light the apex, then hand on what the filter keeps."""
        side, origin = where.T
        b0, b1, sx, sy = lines.T
        base = self.origins.distance.take(origin)
        shape = self.tables.shape.take(side, axis=0)
        ids = self.tables.ids.take(side, axis=0)
        length, ax, ay = shape[:, 0], shape[:, 1], shape[:, 2]
        dx, dy = ax - sx, ay - sy
        at = sx - dx * sy / dy  # where the line to the apex crosses the side
        to_left, to_right = at > b0, at < b1

        lit = np.flatnonzero((at >= b0 - EPS) & (at <= b1 + EPS))
        reach = base[lit] + np.sqrt(np.square(dx[lit]) + np.square(dy[lit]))
        self.improve(ids[lit, 2], reach, origin[lit], side[lit], at[lit])

        # children, in a frame that starts at the near vertex (v0, or v1 mirrored) and runs towards the apex
        left, right = np.flatnonzero(to_left), np.flatnonzero(to_right)
        k = len(left)
        parent = np.concatenate([left, right])
        a = np.empty((7, len(parent)))
        near, far, x, apex_x, far_cut, l, r = a
        l[:] = length.take(parent)
        near[:k], near[k:] = b0[left], l[k:] - b1[right]
        far[:k], far[k:] = b1[left], l[k:] - b0[right]
        far_cut[:k], far_cut[k:] = at[left], l[k:] - at[right]
        x[:k], x[k:] = sx[left], l[k:] - sx[right]
        apex_x[:k], apex_x[k:] = ax[left], l[k:] - ax[right]
        y, apex_y = sy.take(parent), ay.take(parent)
        edge = np.concatenate([shape[left, 3], shape[right, 4]])
        r[:] = base.take(parent)
        cross = apex_x * y - apex_y * x
        tiny = -1e-300
        f0 = np.minimum(near * y / np.minimum(cross + near * apex_y, tiny), 1.0)
        f1 = np.minimum(far * y / np.minimum(cross + far * apex_y, tiny), 1.0)
        f1[far_cut <= far] = 1.0

        u, v = f0 * apex_x, f0 * apex_y
        r0 = r + np.sqrt(np.square(u - x) + np.square(v - y))
        detour = np.sqrt(np.square(l - u) + np.square(v))
        r1 = r + np.sqrt(np.square(f1 * apex_x - x) + np.square(f1 * apex_y - y))
        s0, s1 = f0 * edge, f1 * edge
        margin = EPS - self.slack * edge if self.slack > 0 else EPS
        tri = ids.take(parent, axis=0)
        code = np.concatenate([tri[:k, 3], tri[k:, 4]])
        d_left, d_right = self.distance.take(tri[:, 0]), self.distance.take(tri[:, 1])
        d_near = np.concatenate([d_left[:k], d_right[k:]])
        d_other = np.concatenate([d_right[:k], d_left[k:]])
        keep = s1 - s0 > EPS
        keep &= code != BOUNDARY
        keep &= r1 <= d_near + s1 + margin
        keep &= r0 <= self.distance.take(tri[:, 2]) + (edge - s0) + margin
        keep &= r0 <= d_other + detour + margin
        kept = np.flatnonzero(keep)
        if not len(kept):
            return
        k = int(np.searchsorted(kept, k))
        edge, s0, s1, r0, r1, r, y = (c.take(kept) for c in (edge, s0, s1, r0, r1, r, y))
        x, apex_x, apex_y, cross = (c.take(kept) for c in (x, apex_x, apex_y, cross))
        new_x = (x * apex_x + y * apex_y) / edge
        new_y = cross / edge
        key = np.where((new_x > s0) & (new_x < s1), r - new_y, np.minimum(r0, r1))
        out = np.empty((len(kept), 4))
        out[:k, 0], out[k:, 0] = s0[:k], edge[k:] - s1[k:]
        out[:k, 1], out[k:, 1] = s1[:k], edge[k:] - s0[k:]
        out[:k, 2], out[k:, 2] = new_x[:k], edge[k:] - new_x[k:]
        out[:, 3] = new_y
        source = parent.take(kept)
        left_by = code[:0]  # needed only where crossings are not plain
        if self.tables.mirrored is not None or self.tables.edge_sides is not None:
            face, j = np.divmod(side[source], 3)
            j[:k] += 2
            j[k:] += 1
            left_by = 3 * face + j % 3
        self._enter(out, code.take(kept), origin.take(source), key, left_by)


def _reflect(lines: NDArray, flip: NDArray, length: NDArray) -> None:
    """Turn windows around where `flip`: x becomes length - x."""
    i = np.flatnonzero(flip)
    b0 = lines[i, 0].copy()
    lines[i, 0] = length[i] - lines[i, 1]
    lines[i, 1] = length[i] - b0
    lines[i, 2] = length[i] - lines[i, 2]


def dominate(
    lines: NDArray, where: NDArray, shape: NDArray, origin_distance: NDArray
) -> tuple[NDArray, NDArray]:
    """Sort windows by side and trim neighbours on the same side to where each is the nearer.

    Only parts where another window of the batch is at least as near are cut, so no distance changes.

    Notes
    -----
    On a side, the difference of two windows' distances has at most one interior extremum, where the line
    through the two sources meets the side; hence at most two roots, found by bracketing (the closed
    quadratic cancels when the sources nearly coincide).
    """
    side = where[:, 0]
    order = np.argsort(side + 0.9999999 * lines[:, 0] / shape.take(side, axis=0)[:, 0])
    lines, where = lines.take(order, axis=0), where.take(order, axis=0)
    side = where[:, 0]
    i = np.flatnonzero((side[1:] == side[:-1]) & (lines[1:, 0] < lines[:-1, 1]))
    if not len(i):
        return lines, where
    p, q = lines.take(i, axis=0), lines.take(i + 1, axis=0)
    base = origin_distance.take(where[:, 1])
    base_p, base_q = base.take(i), base.take(i + 1)
    px, py, qx, qy = p[:, 2], p[:, 3], q[:, 2], q[:, 3]
    contained = q[:, 1] <= p[:, 1]
    lo, hi = q[:, 0].copy(), np.minimum(p[:, 1], q[:, 1])

    def gap(x: NDArray) -> NDArray:
        return (base_p + np.sqrt(np.square(x - px) + np.square(py))) - (
            base_q + np.sqrt(np.square(x - qx) + np.square(qy))
        )

    with np.errstate(divide="ignore", invalid="ignore"):
        middle = px + (qx - px) * py / (py - qy)
    middle = np.where(np.isfinite(middle), np.clip(middle, lo, hi), lo)
    g_lo, g_hi, g_mid = gap(lo), gap(hi), gap(middle)
    p_wins = (g_lo <= 0) & (g_hi <= 0) & (g_mid <= 0)
    q_wins = (g_lo > 0) & (g_hi > 0) & (g_mid > 0) & ~contained
    p_first = (g_lo < 0) & (g_hi > 0)
    q_first = contained & (g_lo > 0) & (g_hi < 0)
    root = np.flatnonzero(p_first | q_first)
    if len(root):
        a, b = lo[root], hi[root]
        lo_r, hi_r = _bracket(
            a,
            b,
            g_lo[root],
            g_hi[root],
            (base_p[root], px[root], py[root]),
            (base_q[root], qx[root], qy[root]),
        )
        forward = p_first[root]
        lines[i[root[forward]] + 1, 0] = lo_r[forward]
        cut_p = forward & ~contained[root]
        lines[i[root[cut_p]], 1] = hi_r[cut_p]
        lines[i[root[~forward]] + 1, 1] = hi_r[~forward]
    lines[i[p_wins] + 1, 0] = hi[p_wins]
    lines[i[q_wins], 1] = lo[q_wins]
    alive = np.flatnonzero(lines[:, 1] - lines[:, 0] > EPS)
    if len(alive) == len(lines):
        return lines, where
    return lines.take(alive, axis=0), where.take(alive, axis=0)


def _bracket(lo: NDArray, hi: NDArray, g_lo: NDArray, g_hi: NDArray, p: tuple, q: tuple) -> tuple:
    """Shrink [lo, hi] around the sign change of p - q: two steps of regula falsi, the second overshooting."""

    def gap(x: NDArray) -> NDArray:
        return (p[0] + np.sqrt(np.square(x - p[1]) + np.square(p[2]))) - (
            q[0] + np.sqrt(np.square(x - q[1]) + np.square(q[2]))
        )

    rising = g_lo < 0
    for step in (1.0, 2.0):
        slope = (g_hi - g_lo) / (hi - lo)
        if step == 1.0:
            x = lo - g_lo / slope
        else:
            nearest = np.where(np.abs(g_lo) < np.abs(g_hi), lo, hi)
            g_near = np.where(np.abs(g_lo) < np.abs(g_hi), g_lo, g_hi)
            x = nearest - 2 * g_near / slope
        x = np.where((x > lo) & (x < hi), x, 0.5 * (lo + hi))
        g = gap(x)
        low = np.where(rising, g <= 0, g > 0)
        lo, hi = np.where(low, x, lo), np.where(low, hi, x)
        g_lo, g_hi = np.where(low, g, g_lo), np.where(low, g_hi, g)
    return lo, hi
