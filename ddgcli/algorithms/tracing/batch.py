"""Advance many straightest geodesics together, one face at a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.tracing.crossing import (
    VERTEX_TOLERANCE,
    least,
    leaves_right,
    on_side,
    scalar_crossings,
    to_exit,
)
from ddgcli.algorithms.tracing.lines import BOUNDARY_STATUS, END_STATUS, FAILURE_STATUS, LineStart, Traces
from ddgcli.algorithms.tracing.trace_points import PointRecorder
from ddgcli.geometry.unfolding import ANGLE_TOLERANCE, APEX, TURN, TWIN, Fans, Unfolding
from ddgcli.mesh.sides import next_side, previous_side
from ddgcli.mesh.topology import NEXT, PREVIOUS

MAX_ENDED_FRACTION = 1 / 8  # of the lines in the arrays; above it, ended lines are removed
MAX_SCALAR_LINES = 8  # up to this many lines, scalar arithmetic is faster than arrays


class TraceBatch:
    """State of lines that are being traced.

    Each line enters a face through `side`, at distance `x` from its tail, with a unit `heading` (a complex
    number in the frame of the side). `rest` is its remaining length, `width` the length of the side. Lengths
    are in units of the longest side. Lines that have ended stay in the arrays for some steps, with infinite
    `rest`.
    """

    def __init__(
        self,
        unfolding: Unfolding,
        make_fans: Callable[[], Fans],
        start: LineStart,
        reflect: bool,
        record: bool,
    ) -> None:
        self.unfolding, self.make_fans, self.start = unfolding, make_fans, start
        self.reflect = reflect
        self.table, self.length = unfolding.side, unfolding.length
        self.along = unfolding.direction.reshape(-1, 2).view(np.complex128)[:, 0]
        k = len(start.face)
        self.end_face = start.face.copy()
        self.end_barycentric = start.barycentric.copy()
        self.end_direction = start.direction.copy()
        with np.errstate(over="ignore"):  # an infinite rest marks ended lines
            self.left_over = np.minimum(start.length / unfolding.scale, 1e300)
        self.status = np.zeros(k, dtype=np.int8)
        self.crossings = np.zeros(k, dtype=np.int64)
        self.steps, self.n_ended = 0, 0
        self.recorder = PointRecorder() if record else None
        self.ended: list[tuple[NDArray, ...]] = []
        self.starts_on_side = np.zeros(
            k, dtype=bool
        )  # or at a vertex: the first recorded crossing is the start
        self.turn_at, self.twin_at = 4 * np.arange(k) + TURN, 8 * np.arange(k) + 2 * TWIN
        none = np.zeros(0, dtype=np.int64)
        empty = np.zeros(0)
        self._set_state(none, none, empty, empty.astype(np.complex128), empty, empty)

    def _set_state(
        self, line: NDArray, side: NDArray, x: NDArray, heading: NDArray, rest: NDArray, width: NDArray
    ) -> None:
        self.line, self.side, self.x, self.heading = line, side, x, heading
        self.rest, self.width = rest, width

    def _state(self) -> tuple[NDArray, ...]:
        return self.line, self.side, self.x, self.heading, self.rest, self.width

    # -- first face ------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Advance from the start points to the first side or vertex."""
        start = self.start
        line = np.flatnonzero(self.left_over > 0)
        b, face = start.barycentric[line], start.face[line]
        d = start.direction[line].view(np.complex128)[:, 0]
        inside = b > VERTEX_TOLERANCE
        at_vertex = inside[:, 0].astype(np.int8) + inside[:, 1] + inside[:, 2] == 1
        if not at_vertex.all():
            self._leave_faces(*(column[~at_vertex] for column in (line, face, b, d)))
        self.starts_on_side[line[at_vertex]] = True
        self._leave_vertices(line[at_vertex], face[at_vertex], np.argmax(b[at_vertex], axis=1), d[at_vertex])
        active = np.zeros(len(self.starts_on_side), dtype=bool)
        active[self.line] = True
        self.starts_on_side &= active
        self._record()

    def _leave_faces(self, line: NDArray, face: NDArray, b: NDArray, d: NDArray) -> None:
        """Start lines inside faces and on sides: advance them to the first side, or end them."""
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
        rest = self.left_over[line] - distance
        ends_here, on = np.flatnonzero(rest <= 0), np.flatnonzero(rest > 0)
        self._finish_in_first_face(
            line[ends_here], b[ends_here], side[ends_here], u[ends_here], distance[ends_here]
        )
        self.starts_on_side[line[on]] = distance[on] <= 0
        self._leave(line[on], side[on], u[on], turned[on], rest[on])

    def _finish_in_first_face(
        self, line: NDArray, b: NDArray, side: NDArray, u: NDArray, distance: NDArray
    ) -> None:
        """End lines inside their first face."""
        s = (self.left_over[line] / distance)[:, None]
        self.end_barycentric[line] = (1 - s) * b + s * on_side(side, u / self.length[side])
        self.left_over[line] = 0.0

    def _leave_vertices(self, line: NDArray, face: NDArray, corner: NDArray, d: NDArray) -> None:
        """Start lines at vertices: turn directions in the plane of `face` into angles in the unfolded fan."""
        if not len(line):
            return
        side = 3 * face + corner
        fans = self.make_fans()
        angle = fans.angle_of(side, np.angle(d * self.along[side].conj())) - fans.angle_before[side]
        self._start_from_corner(line, side, angle, self.left_over[line])

    def _start_from_corner(self, line: NDArray, corner: NDArray, angle: NDArray, rest: NDArray) -> None:
        """Leave the vertex of `corner` at `angle` from its side; the angle may lie beyond the corner's
        face."""
        fans = self.make_fans()
        fan = fans.fan[corner]
        total = fans.total_angle[fan]
        turned = fans.angle_before[corner] + angle
        is_open = fans.is_open[fan]
        outside = is_open & ((turned < -ANGLE_TOLERANCE) | (turned > total + ANGLE_TOLERANCE))
        no_angle = ~(total > 0)
        blocked = outside | no_angle
        if blocked.any():
            status = np.where(no_angle, FAILURE_STATUS, BOUNDARY_STATUS)[blocked]
            self._end_at_corner(line[blocked], corner[blocked], rest[blocked], status)
            keep = ~blocked
            line, corner, fan, total, turned, rest, is_open = (
                a[keep] for a in (line, corner, fan, total, turned, rest, is_open)
            )
        turned = np.where(is_open, np.clip(turned, 0.0, total), turned % total)
        corner = fans.locate(fan, turned)
        local = np.clip(turned - fans.angle_before[corner], 0.0, fans.corner_angle[corner])
        self._append(line, corner, np.zeros(len(line)), np.exp(1j * local), rest)

    # -- crossings --------------------------------------------------------------------------------------

    def advance(self, max_steps: int) -> None:
        """Advance every line through `max_steps` faces, or until all lines have ended."""
        stop = self.steps + max_steps
        while len(self.line) and self.steps < stop:
            if len(self.line) <= MAX_SCALAR_LINES and not self.n_ended:
                self._cross_scalar(stop - self.steps)
            if self.steps < stop:
                self.cross()

    def _cross_scalar(self, max_steps: int) -> None:
        """Advance a few lines with scalar arithmetic, until a crossing needs special treatment."""
        rows = self.table.view(np.uint8).data
        starts = zip(*(column.tolist() for column in self._state()[1:]), strict=True)
        states_of_lines: list[list[tuple]] = []
        for start in starts:  # all lines make as many steps as the first that needs special treatment
            states_of_lines.append(scalar_crossings(rows, start, max_steps))
            max_steps = len(states_of_lines[-1])
        if not max_steps:
            return
        self.steps += max_steps
        if self.recorder is not None:
            steps = zip(*states_of_lines, strict=False)
            marks = [complex(x / width, side) for states in steps for side, x, _, _, width in states]
            self.recorder.record_steps(self.line, marks)
        last = [states[max_steps - 1] for states in states_of_lines]
        self._set_state(self.line, *(np.array(column) for column in zip(*last, strict=True)))

    def _exits(self, side: NDArray, x: NDArray, heading: NDArray, width: NDArray) -> tuple[NDArray, ...]:
        """Exits of lines from their faces: (right, twin, turned, exit_length, u, beyond_u, distance).

        A line leaves by the next (`right` = 1) or the previous side (0). Indexing with `right` is cheaper
        than masks, which mispredict. The exit is `u` from the corner that both sides share and `beyond_u`
        from the apex.
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
            beyond = ~(
                (u <= exit_length) & (turned.imag > 0)
            )  # rounding next to the apex: go through the apex
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
        remaining_length = self.rest - distance
        ends_here = remaining_length <= 0
        plain = (np.minimum(u, beyond_u) > VERTEX_TOLERANCE * exit_length) & (twin >= 0)
        state = (self.line, twin, u + right * (beyond_u - u), turned, remaining_length, exit_length)
        all_plain = bool(plain.all())
        if all_plain and not ends_here.any():
            self._set_state(*state)
            self._record()
            return
        ended = np.flatnonzero(ends_here)
        self.ended.append(
            (*(column.take(ended) for column in self._state()), np.full(len(ended), self.steps))
        )
        remaining_length[ended] = np.inf
        self.n_ended += len(ended)
        if all_plain and self.n_ended < MAX_ENDED_FRACTION * len(
            remaining_length
        ):  # cheaper than removing them
            self._set_state(*state)
            self._record()
            return
        self.n_ended = 0
        active = remaining_length < np.inf
        special, on = np.flatnonzero(active & ~plain), np.flatnonzero(active & plain)
        line, side, is_right = self.line[special], self.side[special], right[special] > 0
        exit_side = np.where(is_right, next_side(side), previous_side(side))
        from_tail = np.where(is_right, u[special], beyond_u[special])
        self._set_state(*(column.take(on) for column in state))
        if len(special):
            self._leave_at_end(line, exit_side, from_tail, turned[special], remaining_length[special])
        self._record()

    def _exit_length(self, side: NDArray, right: NDArray) -> NDArray[np.float64]:
        """Lengths of the sides by which lines leave."""
        return self.length.take(np.where(right, next_side(side), previous_side(side)))

    def _leave(self, line: NDArray, side: NDArray, u: NDArray, turned: NDArray, rest: NDArray) -> None:
        """Leave faces through `side` at `u` from its tail; `turned` is the heading in its twin's frame."""
        length = self.length[side]
        twin = self.table.view(np.int64)[next_side(side), 2 * TWIN]
        special = (twin < 0) | (u <= VERTEX_TOLERANCE * length) | (u >= length - VERTEX_TOLERANCE * length)
        on = ~special
        self._append(line[on], twin[on], (length - u)[on], turned[on], rest[on])
        self._leave_at_end(line[special], side[special], u[special], turned[special], rest[special])

    def _leave_at_end(self, line: NDArray, side: NDArray, u: NDArray, turned: NDArray, rest: NDArray) -> None:
        """Leave faces through a vertex at an end of `side`, or stop or reflect at the boundary."""
        length = self.length[side]
        vertex = (u <= VERTEX_TOLERANCE * length) | (u >= length - VERTEX_TOLERANCE * length)
        self._through_vertices(*(a[vertex] for a in (line, side, u, turned, rest)))
        line, side, u, turned, rest = (a[~vertex] for a in (line, side, u, turned, rest))
        if not len(line):
            return
        if self.reflect:  # back into the same face; a side with three faces reflects too
            self._append(line, side, u, -turned.conj(), rest)
        else:
            self._end(
                line, side, -turned, on_side(side, u / self.length[side]), rest, np.int8(BOUNDARY_STATUS)
            )

    def _through_vertices(
        self, line: NDArray, side: NDArray, u: NDArray, turned: NDArray, rest: NDArray
    ) -> None:
        """Leave vertices at half the total angle from the incoming direction (equal-angle rule)."""
        if not len(line):
            return
        fans = self.make_fans()
        head = u > 0.5 * self.length[side]
        corner = np.where(head, next_side(side), side)
        width = fans.corner_angle[corner]
        inward = np.maximum(turned.imag, 0.0)
        incoming = np.where(head, width - np.arctan2(inward, -turned.real), np.arctan2(inward, turned.real))
        fan = fans.fan[corner]
        total = fans.total_angle[fan]
        here = fans.angle_before[corner] + np.clip(incoming, 0.0, width)
        at_end = fans.is_open[fan]
        there = np.where(at_end, total - here, (here + 0.5 * total) % np.where(total > 0, total, 1.0))
        if not self.reflect and at_end.any():
            stop, on = np.flatnonzero(at_end), ~at_end
            self._end_at_corner(line[stop], corner[stop], rest[stop], np.int8(BOUNDARY_STATUS))
            self.end_direction[line[stop]] = self._in_face(side[stop], -turned[stop])
            line, corner, there, rest = line[on], corner[on], there[on], rest[on]
        self._start_from_corner(line, corner, there - fans.angle_before[corner], rest)

    # -- ends and recorded points
    # ------------------------------------------------------------------------------------

    def _append(self, line: NDArray, side: NDArray, x: NDArray, heading: NDArray, rest: NDArray) -> None:
        if not len(line):
            return
        new = (line, side, x, heading, rest, self.length[side])
        columns = [np.concatenate(pair) for pair in zip(self._state(), new, strict=True)]
        order = np.argsort(columns[0], kind="stable")  # recorded points are read by line
        self._set_state(*(column.take(order) for column in columns))

    def _record(self) -> None:
        if self.recorder is not None and len(self.line):
            self.recorder.record(self.line, self.side, self.x, self.width)

    def finish(self) -> None:
        """Compute the end points of lines that ended inside faces."""
        if not self.ended:
            return
        line, side, x, heading, rest, width, steps = (
            np.concatenate(columns) for columns in zip(*self.ended, strict=True)
        )
        right, _, _, exit_length, u, _, distance = self._exits(side, x, heading, width)
        exit_side = np.where(right, next_side(side), previous_side(side))
        share = u / exit_length
        leaving = on_side(exit_side, np.where(right, share, 1.0 - share))
        s = np.divide(rest, distance, out=np.zeros(len(line)), where=distance > 0)[:, None]
        end = (1 - s) * on_side(side, x / width) + s * leaving
        self._end(line, side, heading, end, 0.0, np.int8(END_STATUS))
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
        """End all active lines short of their length."""
        on = np.flatnonzero(self.rest < np.inf)
        if len(on):
            self.steps += 1
            self._set_state(*(column.take(on) for column in self._state()))
            share = np.nan_to_num(self.x / self.width)
            self._end(
                self.line,
                self.side,
                self.heading,
                on_side(self.side, share),
                self.rest,
                np.int8(FAILURE_STATUS),
            )

    def traced_length(self) -> float:
        """Total length traced so far, in the mesh's length unit."""
        return float(self.start.length.sum() - self.unfolding.scale * self.rest[self.rest < np.inf].sum())

    def result(self) -> Traces:
        """Ends and recorded points of all lines."""
        scale = self.unfolding.scale
        traced = np.maximum(self.start.length - self.left_over * scale, 0.0)
        ends = (self.end_face, self.end_barycentric, self.end_direction, traced, self.status, self.crossings)
        return Traces(*ends, *(self._paths(self.recorder) if self.recorder is not None else ()))

    def _paths(self, recorder: PointRecorder) -> tuple[NDArray, NDArray, NDArray]:
        """LinePoints of all lines, line by line: start, crossings in order, end."""
        start, face, barycentric = recorder.in_order(self.crossings, ~self.starts_on_side)
        first = np.flatnonzero(~self.starts_on_side)
        face[start[first]], barycentric[start[first]] = self.start.face[first], self.start.barycentric[first]
        face[start[1:] - 1], barycentric[start[1:] - 1] = self.end_face, self.end_barycentric
        return start, face, barycentric
