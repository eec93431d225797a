"""Lines under way on an unfolded surface, advanced all together, one face at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.tracing.crossing import (
    SNAP,
    crossed,
    least,
    leaves_right,
    next_side,
    on_side,
    previous_side,
    to_exit,
)
from ddgcli.algorithms.tracing.trace_points import Record
from ddgcli.geometry.unfolding import APEX, TURN, TWIN, Fans, Unfolding
from ddgcli.mesh.topology import NEXT, PREVIOUS

REACHED, AT_BOUNDARY, GAVE_UP = 0, 1, 2
IDLE_SHARE = 1 / 8  # of the lines on the list may have ended
FEW = 8  # lines: fewer cost less one by one than as arrays


@dataclass(frozen=True, eq=False)
class Start:
    """Checked start points, unit directions in the planar frames of their faces, and lengths."""

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    direction: NDArray[np.float64]
    length: NDArray[np.float64]

    def part(self, first: int, last: int) -> Start:
        """Lines first..last-1."""
        some = slice(first, last)
        return Start(self.face[some], self.barycentric[some], self.direction[some], self.length[some])


@dataclass(frozen=True, eq=False)
class Traces:
    """Where k lines ended, and on request every point at which they crossed a side.

    Parameters
    ----------
    face : (k,) ndarray of int64
    barycentric : (k, 3) ndarray of float64
        End points.
    direction : (k, 2) ndarray of float64
        Unit direction at the end, in the planar frame of `face` (corner 0 at the origin, corner 1 on +x).
    length : (k,) ndarray of float64
        Length walked; less than asked where `status` is not 0.
    status : (k,) ndarray of int8
        0 reached the length asked; 1 stopped at the boundary; 2 gave up (`max_crossings`, or no way on).
    crossings : (k,) ndarray of int64
        Sides and vertices passed.
    path_start : (k+1,) ndarray of int64
        Points of line i are path_start[i]:path_start[i+1]; empty unless recorded.
    path_face, path_barycentric : (p,), (p, 3) ndarray
        Points in the face that the line enters there (the last: the face in which it ends).
    """

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    direction: NDArray[np.float64]
    length: NDArray[np.float64]
    status: NDArray[np.int8]
    crossings: NDArray[np.int64]
    path_start: NDArray[np.int64] = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    path_face: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    path_barycentric: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))

    def path(self, i: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """(face, barycentric) of the points of line i, start and end included."""
        part = slice(self.path_start[i], self.path_start[i + 1])
        return self.path_face[part], self.path_barycentric[part]

    @classmethod
    def joined(cls, parts: list[Traces]) -> Traces:
        """The lines of several sets, in order."""
        if len(parts) == 1:
            return parts[0]
        shift = np.cumsum([0, *(len(part.path_face) for part in parts)])
        start = [part.path_start[1:] + before for part, before in zip(parts, shift, strict=False)]
        return cls(
            np.concatenate([part.face for part in parts]),
            np.concatenate([part.barycentric for part in parts]),
            np.concatenate([part.direction for part in parts]),
            np.concatenate([part.length for part in parts]),
            np.concatenate([part.status for part in parts]),
            np.concatenate([part.crossings for part in parts]),
            np.concatenate([np.zeros(1, dtype=np.int64), *start]),
            np.concatenate([part.path_face for part in parts]),
            np.concatenate([part.path_barycentric for part in parts]),
        )


class Walk:
    """Lines under way: each stands on `side` at `x` from its tail, with a unit `heading` into the face above.

    Headings are complex numbers in the frame of the side; `rest` is the length left to walk, `width` that of
    the side. Lengths are in units of the longest side. Lines that have ended stay on the list for some steps,
    with infinite `rest`.
    """

    def __init__(
        self, unfolding: Unfolding, make_fans: Callable[[], Fans], start: Start, reflect: bool, record: bool
    ) -> None:
        self.unfolding, self.make_fans, self.start = unfolding, make_fans, start
        self.reflect = reflect
        self.table, self.length = unfolding.side, unfolding.length
        self.along = unfolding.direction.reshape(-1, 2).view(np.complex128)[:, 0]
        k = len(start.face)
        self.end_face = start.face.copy()
        self.end_barycentric = start.barycentric.copy()
        self.end_direction = start.direction.copy()
        with np.errstate(over="ignore"):  # infinite is what marks lines that have ended
            self.left_over = np.minimum(start.length / unfolding.scale, 1e300)
        self.status = np.zeros(k, dtype=np.int8)
        self.crossings = np.zeros(k, dtype=np.int64)
        self.steps, self.idle = 0, 0
        self.record = Record() if record else None
        self.ended: list[tuple[NDArray, ...]] = []
        self.no_start = np.zeros(k, dtype=bool)  # started on a side or at a vertex, and so with a crossing
        self.turn_at, self.twin_at = 4 * np.arange(k) + TURN, 8 * np.arange(k) + 2 * TWIN
        none = np.zeros(0, dtype=np.int64)
        empty = np.zeros(0)
        self._hold(none, none, empty, empty.astype(np.complex128), empty, empty)

    def _hold(
        self, line: NDArray, side: NDArray, x: NDArray, heading: NDArray, rest: NDArray, width: NDArray
    ) -> None:
        self.line, self.side, self.x, self.heading = line, side, x, heading
        self.rest, self.width = rest, width

    def _state(self) -> tuple[NDArray, ...]:
        return self.line, self.side, self.x, self.heading, self.rest, self.width

    # -- the first face ------------------------------------------------------------------------------------

    def begin(self) -> None:
        """From the start point to the first side or vertex."""
        start = self.start
        line = np.flatnonzero(self.left_over > 0)
        b, face = start.barycentric[line], start.face[line]
        d = start.direction[line].view(np.complex128)[:, 0]
        e = self.along.reshape(-1, 3)[face]
        turned = -d[:, None] * e.conj()  # in the frame of each side's twin
        apex = self.table[:, APEX].reshape(-1, 3)[face]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(turned.imag > 1e-15, b[:, PREVIOUS] * apex.imag / turned.imag, np.inf)
        j = least(*reach.T)
        pick = 3 * np.arange(len(line)) + j
        distance, turned = reach.ravel()[pick], turned.ravel()[pick]
        distance = np.where(np.isfinite(distance), distance, 0.0)
        side = 3 * face + j
        length = self.length[side]
        by_head, by_apex = b.ravel()[pick - j + NEXT[j]], b.ravel()[pick - j + PREVIOUS[j]]
        u = by_head * length + by_apex * apex.real.ravel()[pick] - distance * turned.real
        u = np.clip(u, 0.0, length)
        inside = b > SNAP
        at_vertex = inside[:, 0].astype(np.int8) + inside[:, 1] + inside[:, 2] == 1
        rest = self.left_over[line] - distance
        done = np.flatnonzero((rest <= 0) & ~at_vertex)
        self._finish_in_first_face(line[done], b[done], side[done], u[done], distance[done])
        on = np.flatnonzero((rest > 0) & ~at_vertex)
        self.no_start[line[on]] = distance[on] <= 0
        self._leave(line[on], side[on], u[on], turned[on], rest[on])
        self.no_start[line[at_vertex]] = True
        self._leave_vertices(line[at_vertex], face[at_vertex], np.argmax(b[at_vertex], axis=1), d[at_vertex])
        went_on = np.zeros(len(self.no_start), dtype=bool)
        went_on[self.line] = True
        self.no_start &= went_on
        self._note()

    def _finish_in_first_face(
        self, line: NDArray, b: NDArray, side: NDArray, u: NDArray, distance: NDArray
    ) -> None:
        """Lines that end before they leave their first face."""
        s = (self.left_over[line] / distance)[:, None]
        self.end_barycentric[line] = (1 - s) * b + s * on_side(side, u / self.length[side])
        self.left_over[line] = 0.0

    def _leave_vertices(self, line: NDArray, face: NDArray, corner: NDArray, d: NDArray) -> None:
        """Start at a vertex: the direction, read in the plane of `face`, is looked up in the unfolded fan."""
        if not len(line):
            return
        side = 3 * face + corner
        angle = np.angle(d * self.along[side].conj())
        middle = 0.5 * self.make_fans().corner_angle[side]
        angle = middle + (angle - middle + np.pi) % (2 * np.pi) - np.pi
        self._start_from_corner(line, side, angle, self.left_over[line])

    def _start_from_corner(self, line: NDArray, corner: NDArray, angle: NDArray, rest: NDArray) -> None:
        """Leave the vertex of `corner` at `angle` from its side, which may lie beyond the corner's face."""
        fans = self.make_fans()
        fan = fans.fan[corner]
        total = fans.total_angle[fan]
        turned = fans.angle_before[corner] + angle
        slack = 1e-14
        is_open = fans.is_open[fan]
        outside = is_open & ((turned < -slack) | (turned > total + slack))
        lost = ~(total > 0)
        stuck = outside | lost
        if stuck.any():
            why = np.where(lost, GAVE_UP, AT_BOUNDARY)[stuck]
            self._end_at_corner(line[stuck], corner[stuck], rest[stuck], why)
            keep = ~stuck
            line, corner, fan, total, turned, rest, is_open = (
                a[keep] for a in (line, corner, fan, total, turned, rest, is_open)
            )
        turned = np.where(is_open, np.clip(turned, 0.0, total), turned % total)
        corner = fans.locate(fan, turned)
        local = np.clip(turned - fans.angle_before[corner], 0.0, fans.corner_angle[corner])
        self._append(line, corner, np.zeros(len(line)), np.exp(1j * local), rest)

    # -- one crossing --------------------------------------------------------------------------------------

    def advance(self, most: int) -> None:
        """Advance every line through `most` faces, or until all have ended."""
        stop = self.steps + most
        while len(self.line) and self.steps < stop:
            if len(self.line) <= FEW and not self.idle:
                self._cross_in_numbers(stop - self.steps)
            if self.steps < stop:
                self.cross()

    def _cross_in_numbers(self, most: int) -> None:
        """Up to `most` steps of few lines as plain numbers, until one is not plain for some line."""
        rows = self.table.view(np.uint8).data
        state: list[Any] = list(zip(*(part.tolist() for part in self._state()[1:]), strict=True))
        marks: list[complex] = []
        for _ in range(most):
            after: list[Any] = [crossed(rows, *line) for line in state]
            if None in after:
                break
            self.steps += 1
            state = after
            marks += [complex(x / width, side) for side, x, _, _, width in state]
        if self.record is not None and marks:
            self.record.note_steps(self.line, marks)
        self._hold(self.line, *(np.array(part) for part in zip(*state, strict=True)))

    def _exits(self, side: NDArray, x: NDArray, heading: NDArray, width: NDArray) -> tuple[NDArray, ...]:
        """How lines leave their faces: (right, twin, turned, exit_length, u, beyond_u, distance).

        A line leaves by the next or the previous side of the one it stands on; `right` says which (1 or 0),
        and picks what belongs to it from the gathered rows (cheaper than a selection by mask, which
        mispredicts). The exit is `u` from the corner that both sides share and `beyond_u` from the apex.
        """
        rows = self.table.take(side, axis=0)
        apex = rows[:, APEX]
        right = leaves_right(apex, x, heading)
        one = right.astype(np.int64)
        turn = rows.ravel().take(self.turn_at[: len(x)] + one)
        twin = rows.view(np.int64).ravel().take(self.twin_at[: len(x)] + one)
        turned = heading * turn
        sine = np.abs(turn.imag)
        exit_length = self._exit_length(side, right) if self.unfolding.has_flat else apex.imag / sine
        share = one.astype(np.float64)
        u, beyond_u, distance = to_exit(x, width, heading, turned, sine, exit_length, share)
        if not (np.minimum(u, beyond_u) > 0).all():
            beyond = ~((u <= exit_length) & (turned.imag > 0))  # rounding beside the apex: through the apex
            distance[beyond] = np.abs(apex[beyond] - x[beyond])
            u[beyond] = exit_length[beyond]
            beyond_u[beyond] = 0.0
        return share, twin, turned, exit_length, u, beyond_u, distance

    def cross(self) -> None:
        """Advance every line through one face."""
        self.steps += 1
        right, twin, turned, exit_length, u, beyond_u, distance = self._exits(
            self.side, self.x, self.heading, self.width
        )
        left = self.rest - distance
        done = left <= 0
        plain = (np.minimum(u, beyond_u) > SNAP * exit_length) & (twin >= 0)
        state = (self.line, twin, u + right * (beyond_u - u), turned, left, exit_length)
        all_plain = bool(plain.all())
        if all_plain and not done.any():
            self._hold(*state)
            self._note()
            return
        ended = np.flatnonzero(done)
        self.ended.append((*(part.take(ended) for part in self._state()), np.full(len(ended), self.steps)))
        left[ended] = np.inf
        self.idle += len(ended)
        if all_plain and self.idle < IDLE_SHARE * len(left):  # let them run on: cheaper than to take them out
            self._hold(*state)
            self._note()
            return
        self.idle = 0
        under_way = left < np.inf
        odd, on = np.flatnonzero(under_way & ~plain), np.flatnonzero(under_way & plain)
        line, side, is_right = self.line[odd], self.side[odd], right[odd] > 0
        exit_side = np.where(is_right, next_side(side), previous_side(side))
        from_tail = np.where(is_right, u[odd], beyond_u[odd])
        self._hold(*(part.take(on) for part in state))
        if len(odd):
            self._leave_odd(line, exit_side, from_tail, turned[odd], left[odd])
        self._note()

    def _exit_length(self, side: NDArray, right: NDArray) -> NDArray[np.float64]:
        """Lengths of the sides by which lines leave."""
        return self.length.take(np.where(right, next_side(side), previous_side(side)))

    def _leave(self, line: NDArray, side: NDArray, u: NDArray, turned: NDArray, rest: NDArray) -> None:
        """Leave faces through `side` at `u` from its tail; `turned` is the heading in its twin's frame."""
        length = self.length[side]
        twin = self.table.view(np.int64)[next_side(side), 2 * TWIN]
        odd = (twin < 0) | (u <= SNAP * length) | (u >= length - SNAP * length)
        on = ~odd
        self._append(line[on], twin[on], (length - u)[on], turned[on], rest[on])
        self._leave_odd(line[odd], side[odd], u[odd], turned[odd], rest[odd])

    def _leave_odd(self, line: NDArray, side: NDArray, u: NDArray, turned: NDArray, rest: NDArray) -> None:
        """Through a vertex at an end of `side`, or at the boundary."""
        length = self.length[side]
        vertex = (u <= SNAP * length) | (u >= length - SNAP * length)
        self._through_vertices(*(a[vertex] for a in (line, side, u, turned, rest)))
        line, side, u, turned, rest = (a[~vertex] for a in (line, side, u, turned, rest))
        if not len(line):
            return
        if self.reflect:  # turned back into the same face; a side with three faces reflects too
            self._append(line, side, u, -turned.conj(), rest)
        else:
            self._end(line, side, -turned, on_side(side, u / self.length[side]), rest, np.int8(AT_BOUNDARY))

    def _through_vertices(
        self, line: NDArray, side: NDArray, u: NDArray, turned: NDArray, rest: NDArray
    ) -> None:
        """The equal-angle rule: leave at half the total angle from where the line came in."""
        if not len(line):
            return
        fans = self.make_fans()
        head = u > 0.5 * self.length[side]
        corner = np.where(head, next_side(side), side)
        width = fans.corner_angle[corner]
        inward = np.maximum(turned.imag, 0.0)
        came = np.where(head, width - np.arctan2(inward, -turned.real), np.arctan2(inward, turned.real))
        fan = fans.fan[corner]
        total = fans.total_angle[fan]
        here = fans.angle_before[corner] + np.clip(came, 0.0, width)
        at_end = fans.is_open[fan]
        there = np.where(at_end, total - here, (here + 0.5 * total) % np.where(total > 0, total, 1.0))
        if not self.reflect and at_end.any():
            stop, on = np.flatnonzero(at_end), ~at_end
            self._end_at_corner(line[stop], corner[stop], rest[stop], np.int8(AT_BOUNDARY))
            self.end_direction[line[stop]] = self._in_face(side[stop], -turned[stop])
            line, corner, there, rest = line[on], corner[on], there[on], rest[on]
        self._start_from_corner(line, corner, there - fans.angle_before[corner], rest)

    # -- ends and notes ------------------------------------------------------------------------------------

    def _append(self, line: NDArray, side: NDArray, x: NDArray, heading: NDArray, rest: NDArray) -> None:
        if not len(line):
            return
        new = (line, side, x, heading, rest, self.length[side])
        parts = [np.concatenate(pair) for pair in zip(self._state(), new, strict=True)]
        order = np.argsort(parts[0], kind="stable")  # the notes are read by line
        self._hold(*(part.take(order) for part in parts))

    def _note(self) -> None:
        if self.record is not None and len(self.line):
            self.record.note(self.line, self.side, self.x, self.width)

    def finish(self) -> None:
        """Place the lines that ended inside faces, between entry and exit; kept until all have ended."""
        if not self.ended:
            return
        line, side, x, heading, rest, width, steps = (
            np.concatenate(parts) for parts in zip(*self.ended, strict=True)
        )
        right, _, _, exit_length, u, _, distance = self._exits(side, x, heading, width)
        exit_side = np.where(right, next_side(side), previous_side(side))
        share = u / exit_length
        leaving = on_side(exit_side, np.where(right, share, 1.0 - share))
        s = np.divide(rest, distance, out=np.zeros(len(line)), where=distance > 0)[:, None]
        end = (1 - s) * on_side(side, x / width) + s * leaving
        self._end(line, side, heading, end, 0.0, np.int8(REACHED))
        self.crossings[line] = steps

    def _end(
        self, line: NDArray, side: NDArray, heading: NDArray, barycentric: NDArray, rest: Any, status: Any
    ) -> None:
        self.end_face[line] = side // 3
        self.end_barycentric[line] = barycentric
        self.end_direction[line] = self._in_face(side, heading)
        self.left_over[line] = rest
        self.status[line] = status
        self.crossings[line] = self.steps

    def _end_at_corner(self, line: NDArray, corner: NDArray, rest: NDArray, status: Any) -> None:
        self.end_face[line] = corner // 3
        self.end_barycentric[line] = on_side(corner, np.zeros(len(corner)))
        self.left_over[line] = rest
        self.status[line] = status
        self.crossings[line] = self.steps

    def _in_face(self, side: NDArray, heading: NDArray) -> NDArray[np.float64]:
        turned = heading * self.along[side]
        return (turned / np.abs(turned))[:, None].view(np.float64)

    def abandon(self) -> None:
        """End what is still under way."""
        on = np.flatnonzero(self.rest < np.inf)
        if len(on):
            self.steps += 1
            self._hold(*(part.take(on) for part in self._state()))
            share = np.nan_to_num(self.x / self.width)
            self._end(
                self.line, self.side, self.heading, on_side(self.side, share), self.rest, np.int8(GAVE_UP)
            )

    def walked(self) -> float:
        """Length walked by all lines so far, in the mesh's length unit."""
        return float(self.start.length.sum() - self.unfolding.scale * self.rest[self.rest < np.inf].sum())

    def result(self) -> Traces:
        scale = self.unfolding.scale
        walked = np.maximum(self.start.length - self.left_over * scale, 0.0)
        ends = (self.end_face, self.end_barycentric, self.end_direction, walked, self.status, self.crossings)
        return Traces(*ends, *(self._paths(self.record) if self.record is not None else ()))

    def _paths(self, record: Record) -> tuple[NDArray, NDArray, NDArray]:
        """Start, crossings in order, end: one line after the other."""
        start, face, barycentric = record.in_order(self.crossings, ~self.no_start)
        first = np.flatnonzero(~self.no_start)
        face[start[first]], barycentric[start[first]] = self.start.face[first], self.start.barycentric[first]
        face[start[1:] - 1], barycentric[start[1:] - 1] = self.end_face, self.end_barycentric
        return start, face, barycentric
