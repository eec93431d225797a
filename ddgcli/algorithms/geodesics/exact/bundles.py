"""Bundles: neighbouring windows of one side that propagate together.

Only the windows that contain the apex ahead change in a face; the others pass on its left or on its right. A
bundle stores its windows in the frame of the side where it was created, and one rigid motion from there to
its current side. If the apex ahead lies outside the hull of its rays, the whole bundle moves left or right
by one composition of motions. Otherwise it splits: the windows on the left of the apex stay a bundle, so do
those on the right, and those between are released, to update the apex, be cut and be filtered like any
other window.

On smooth surfaces the number of windows on a side grows with the square root of the number of faces; the
number of bundles hardly grows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.dominance import DOMINANCE_TOLERANCE
from ddgcli.algorithms.geodesics.exact.pool import WindowOrigins, WindowPool
from ddgcli.algorithms.geodesics.exact.tables import BOUNDARY, WindowTables
from ddgcli.mesh.ragged import ranges

MIN_BUNDLE_SIZE, MIN_PART_SIZE = 8, 3  # windows of a new bundle, and of a part of a split bundle
MAX_SLOPE, MAX_SLOPE_STEP = (
    8.0,
    0.5,
)  # of rays against the normal of the side: absolute, and between neighbours
# costs in units of one propagated window: of moving a bundle, of testing a window of a bundle that splits, of
# binding and releasing a window, and of a round with bundles
BUNDLE_COST, TEST_COST, BINDING_COST, ROUND_COST = 4.0, 0.33, 1.0, 4000.0
MIN_BOUND_WINDOWS = 10_000.0  # fewer are not worth bundling
RETRY_FACTOR = 1.3  # increase of the number of windows after which bundling is tried again

# rows of a bundle: its motion (x, y) -> (COS x - SIN y + SHIFT_X, SIN x + COS y + SHIFT_Y); its rays lie
# between x = LEFT_START + LEFT_SLOPE y and x = RIGHT_START + RIGHT_SLOPE y; the least distance where it was
# bound; a window's source and the distance of its origin; the rotation of frames (if directions are computed)
COS, SIN, SHIFT_X, SHIFT_Y, LEFT_START, LEFT_SLOPE, RIGHT_START, RIGHT_SLOPE, LEAST_DISTANCE = range(9)
ORIGIN_X, ORIGIN_Y, ORIGIN_DISTANCE, ROTATION = range(9, 13)


class Bundles:
    """Queue of bundles, on surfaces where every side has at most one side across, of opposite direction.

    Parameters
    ----------
    tables : WindowTables
    origins : WindowOrigins
    distance : (n,) ndarray of float64
        Upper bounds of the distances of vertices, which the wavefront lowers.
    side_turn : ndarray, optional
        Rotations of frames, if directions are computed.
    halt : (m,) ndarray of bool, optional
        Faces in which all windows are released.

    Attributes
    ----------
    moves : int
        Number of bundles moved across a face.
    """

    def __init__(
        self,
        tables: WindowTables,
        origins: WindowOrigins,
        distance: NDArray,
        side_turn: NDArray | None = None,
        halt: NDArray | None = None,
    ) -> None:
        self.tables, self.origins, self.distance, self.side_turn, self.halt = (
            tables, origins, distance, side_turn, halt
        )  # fmt: skip
        self.columns = 4 + int(side_turn is not None)
        self.windows = WindowPool(self.columns + 1)  # lines, distance of the origin; where they were bound
        self.pool = WindowPool(
            ROTATION + self.columns - 4, 1024, ints=3
        )  # bundles; side, first and number of windows
        self.moves = 0
        self._min_windows, self._saved = MIN_BOUND_WINDOWS, 0.0

    def __len__(self) -> int:
        return len(self.pool)

    # -- binding and releasing -------------------------------------------------------------------

    def bind(self, lines: NDArray, where: NDArray) -> tuple[NDArray, NDArray]:
        """Bundle runs of sorted windows if that saves time; return the other windows."""
        start, count = _runs(lines, where[0])
        rows, local = ranges(start, count)
        if self._saved < 0:
            self._min_windows = max(self._min_windows, RETRY_FACTOR * len(rows))
        self._saved = 0.0
        if len(rows) < self._min_windows:
            return lines, where
        self._saved -= BINDING_COST * len(rows)
        base = self.origins.distance.take(where[1].take(rows))
        bound = np.concatenate([lines.take(rows, axis=1), base[None]])
        b0, b1, sx, sy = bound[:4]
        reach = base + np.hypot(bound[:2] - sx, sy)
        bundle = np.zeros((len(self.pool.lines), len(start)))
        bundle[COS] = 1.0
        bundle[LEFT_START : RIGHT_SLOPE + 1] = _hull(bound, local)
        bundle[LEAST_DISTANCE] = np.minimum.reduceat(0.5 * (reach[0] + reach[1] - (b1 - b0)), local)
        middle = local + count // 2
        bundle[ORIGIN_X : ORIGIN_DISTANCE + 1] = sx.take(middle), sy.take(middle), base.take(middle)
        self._reserve(len(rows))
        place = np.stack([where[0].take(start), self.windows.top + local, count])
        self.windows.push(bound, where.take(rows, axis=1), base)
        self.pool.push(bundle, place, bundle[LEAST_DISTANCE])
        unbound = np.ones(where.shape[1], dtype=bool)
        unbound[rows] = False
        rest = unbound.nonzero()[0]
        return lines.take(rest, axis=1), where.take(rest, axis=1)

    def _reserve(self, more: int) -> None:
        """Reserve memory for more windows; drop those without a bundle."""
        if self.windows.top + more <= len(self.windows.key):
            return
        queued = (self.pool.key[: self.pool.top] < np.inf).nonzero()[0]
        rows, self.pool.where[1, queued] = ranges(*self.pool.where[1:].take(queued, axis=1))
        previous = self.windows
        self.windows = WindowPool(len(previous.lines), 2 * (len(rows) + more))
        self.windows.push(
            previous.lines.take(rows, axis=1), previous.where.take(rows, axis=1), previous.key.take(rows)
        )

    def dissolve(self) -> tuple[NDArray, NDArray]:
        """Release all windows of all bundles."""
        return self._free(*self.pool.pop_below(np.inf))

    def _free(self, bundle: NDArray, place: NDArray) -> tuple[NDArray, NDArray]:
        """Windows of bundles in the frames of their current sides."""
        side, first, count = place
        rows, _ = ranges(first, count)
        of = np.arange(len(first)).repeat(count)
        window, side = self.windows.lines.take(rows, axis=1), side.take(of)
        motion = bundle[:4].take(of, axis=1)
        x, y = _moved(motion, window[2], window[3])
        end_x, end_y = _moved(motion, window[:2], 0.0)
        lines = np.empty((self.columns, len(rows)))
        end_x -= x  # where the rays cross the side
        end_x *= y / (y - end_y)
        np.clip(x + end_x, 0.0, self.tables.shape[side, 0], out=lines[:2])
        lines[2], lines[3] = x, y
        if self.side_turn is not None:
            lines[4] = window[4] + bundle[ROTATION].take(of)
        nonempty = (lines[1] - lines[0] > DOMINANCE_TOLERANCE).nonzero()[0]
        where = np.stack([side, self.windows.where[1].take(rows)])
        return lines.take(nonempty, axis=1), where.take(nonempty, axis=1)

    # -- propagation -----------------------------------------------------------------------------------

    def advance(self, bound: float) -> tuple[NDArray, NDArray]:
        """Move the bundles below the bound across their faces; return the released windows."""
        bundle, place = self.pool.pop_below(bound)
        self.moves += len(place[0])
        self._saved -= ROUND_COST + BUNDLE_COST * len(place[0])
        face_apex = self.tables.shape[place[0], 1:3].T - bundle[SHIFT_X : SHIFT_Y + 1]
        x = (
            bundle[COS] * face_apex[0] + bundle[SIN] * face_apex[1]
        )  # the apex ahead, where the bundle was bound
        y = bundle[COS] * face_apex[1] - bundle[SIN] * face_apex[0]
        before, margin = y > 0, _margin(bundle, y)
        left = (
            x > bundle[RIGHT_START] + np.where(before, bundle[RIGHT_SLOPE], bundle[LEFT_SLOPE]) * y + margin
        )
        right = (
            x < bundle[LEFT_START] + np.where(before, bundle[LEFT_SLOPE], bundle[RIGHT_SLOPE]) * y - margin
        )
        halted = ~(left | right | before)
        if self.halt is not None:
            halted |= self.halt.take(place[0] // 3)
            left &= ~halted
            right &= ~halted
        rows = [which.nonzero()[0] for which in (left, ~(left | right | halted), right, halted)]
        (left, split, right, halted) = ((bundle.take(i, axis=1), place.take(i, axis=1)) for i in rows)
        n_left = len(left[1][0])
        if len(rows[1]):
            split, between, n_split_left = self._parted(*split, x.take(rows[1]), y.take(rows[1]))
            left, n_left, halted = _joined(left, split), n_left + n_split_left, _joined(between, halted)
        self._hand_on(*_joined(left, right), n_left)
        return self._free(*halted)

    def _parted(
        self, bundle: NDArray, place: NDArray, x: NDArray, y: NDArray
    ) -> tuple[tuple[NDArray, NDArray], tuple[NDArray, NDArray], int]:
        """Parts of bundles left of points (x, y), in the frames of the bundles, then those right of them;
        those between; and the number of parts on the left."""
        side, first, count = place
        rows, local = ranges(first, count)
        end = local + count
        self._saved -= TEST_COST * len(rows)
        b0, b1, sx, sy = self.windows.lines[:4].take(rows, axis=1)
        at = sx - (x.repeat(count) - sx) * sy / (y.repeat(count) - sy)  # as in Wavefront._propagate
        number, margin = np.arange(len(rows)), _margin(bundle, y).repeat(count)
        stop = np.minimum.reduceat(np.where(at > b1 + margin, len(rows), number), local)
        stop = np.minimum(stop, end)  # all before pass on the left
        begin = np.maximum.reduceat(np.where(at < b0 - margin, -1, number), local) + 1
        begin = np.maximum(np.maximum(begin, local), stop)  # all from here pass on the right
        stop = np.where(stop - local >= MIN_PART_SIZE, stop, local)
        begin = np.where(end - begin >= MIN_PART_SIZE, begin, end)
        left = _bundle_part(bundle, place, 0, stop - local)
        bundles, places = _joined(left, _bundle_part(bundle, place, begin - local, end - begin))
        if len(places[0]):
            rows, start = ranges(places[1], places[2])
            bundles[LEFT_START : RIGHT_SLOPE + 1] = _hull(self.windows.lines[:4].take(rows, axis=1), start)
        return (bundles, places), _bundle_part(bundle, place, stop - local, begin - stop), len(left[1][0])

    def _hand_on(self, bundle: NDArray, place: NDArray, n_left: int) -> None:
        """Move bundles to the sides across: the first `n_left` by (v0, apex), the others by (apex, v1)."""
        side = place[0]
        self._saved += float(place[2].sum())
        shape = np.ascontiguousarray(self.tables.shape.take(side, axis=0).T)
        ids = np.ascontiguousarray(self.tables.ids.take(side, axis=0).T)
        length, x, y, edge, other_edge = shape
        back = slice(n_left, None)
        code = ids[3]
        code[back], edge[back] = ids[4, back], other_edge[back]
        cos, sin, away, up = bundle[:4]
        away[back] -= x[back]
        up[back] -= y[back]
        x[back] -= length[back]
        np.negative(x[back], out=x[back])
        np.negative(y[back], out=y[back])
        x /= edge
        y /= edge
        bundle[:4] = x * cos + y * sin, x * sin - y * cos, x * away + y * up, x * up - y * away
        if self.side_turn is not None:
            to = 2 * side
            to[back] += 1
            bundle[ROTATION] += self.side_turn.take(to)
        span = _crossings(bundle, edge)
        from_x, from_y = _moved(bundle[:4], bundle[ORIGIN_X], bundle[ORIGIN_Y])
        from_x -= np.minimum(np.maximum(from_x, span[0]), span[1])
        key = bundle[ORIGIN_DISTANCE] + np.sqrt(from_x * from_x + from_y * from_y)

        d_near, d_far, d_apex = self.distance.take(ids[:3])
        d_near[back], d_far[:n_left] = d_apex[back], d_apex[:n_left]
        least = _least(bundle, edge)
        keep = (code != BOUNDARY) & (least <= d_near + span[1] + DOMINANCE_TOLERANCE)
        keep &= least <= d_far + (edge - span[0]) + DOMINANCE_TOLERANCE
        rows = keep.nonzero()[0]
        place[0] = code
        self.pool.push(bundle.take(rows, axis=1), place.take(rows, axis=1), key.take(rows))


def _runs(lines: NDArray, side: NDArray) -> tuple[NDArray, NDArray]:
    """First row and length of each long run of windows on one side with rays of much the same direction."""
    slope = (lines[:2] - lines[2]) / -lines[3]
    steep = ~(np.abs(slope) < MAX_SLOPE).all(axis=0)
    first = np.ones(len(side), dtype=bool)
    first[1:] = (
        (side[1:] != side[:-1]) | (np.abs(np.diff(slope[0])) > MAX_SLOPE_STEP) | steep[1:] | steep[:-1]
    )
    start = first.nonzero()[0]
    count = np.diff(start, append=len(side))
    long = (count >= MIN_BUNDLE_SIZE).nonzero()[0]
    return start.take(long), count.take(long)


def _margin(bundle: NDArray, y: NDArray) -> NDArray[np.float64]:
    """(k,) distance from the rays of each bundle at which a point at height y still counts as between them.

    A window reaches vertices so far beside it (`reaching`): the tolerance times one plus the length of the
    line, across the line, whose slope is at most `MAX_SLOPE` here. Farther points pass on one side.
    """
    length = (1.0 + MAX_SLOPE) * (np.abs(y) + np.abs(bundle[ORIGIN_Y]))
    return (1.0 + MAX_SLOPE) * DOMINANCE_TOLERANCE * (1.0 + length)


def _moved(motion: NDArray, x: NDArray, y: NDArray | float) -> tuple[NDArray, NDArray]:
    cos, sin, away, up = motion
    return cos * x - sin * y + away, sin * x + cos * y + up


def _joined(a: tuple[NDArray, NDArray], b: tuple[NDArray, NDArray]) -> tuple[NDArray, NDArray]:
    return np.concatenate([a[0], b[0]], axis=1), np.concatenate([a[1], b[1]], axis=1)


def _bundle_part(
    bundle: NDArray, place: NDArray, skip: NDArray | int, count: NDArray
) -> tuple[NDArray, NDArray]:
    """Bundles of `count` windows after the first `skip` of others, where there are any."""
    some = (count > 0).nonzero()[0]
    place = np.stack([place[0], place[1] + skip, count])
    return bundle.take(some, axis=1), place.take(some, axis=1)


def _hull(lines: NDArray, start: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """LEFT, LEFT_SLOPE, RIGHT, RIGHT_SLOPE of runs of windows, which begin at `start`."""
    b0, b1, sx, sy = lines[:4]
    return (
        np.minimum.reduceat(b0, start),
        np.minimum.reduceat((b0 - sx) / -sy, start),
        np.maximum.reduceat(b1, start),
        np.maximum.reduceat((b1 - sx) / -sy, start),
    )


def _crossings(bundle: NDArray, edge: NDArray) -> NDArray[np.float64]:
    """(2, k) first and last point of its side that each bundle reaches, at most."""
    cos, sin = bundle[COS], bundle[SIN]
    span = np.empty((2, len(edge)))
    for out, row, whole in zip(span, (LEFT_START, RIGHT_START), (np.zeros(len(edge)), edge)):
        at, slope = bundle[row : row + 2]
        x, y = _moved(bundle[:4], at, 0.0)
        rise = sin * slope + cos
        np.clip(x - y * (cos * slope - sin) / rise, 0.0, edge, out=out)
        np.copyto(out, whole, where=rise < 1e-3)
    return span


def _least(bundle: NDArray, edge: NDArray) -> NDArray[np.float64]:
    """Lower bounds of the distances that bundles bring: the least where they were bound, and the way."""
    cos, sin, away, up = bundle[:4]
    height = sin * away - cos * up  # of the first end of the side over that where it was bound
    height = np.maximum(np.minimum(height, height - sin * edge), 0.0)
    slope = np.maximum(np.maximum(bundle[LEFT_SLOPE], -bundle[RIGHT_SLOPE]), 0.0)
    return bundle[LEAST_DISTANCE] + height * np.sqrt(1.0 + slope * slope)
