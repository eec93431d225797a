"""Lines under way on an unfolded surface, advanced all together, one face at a time."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.unfolding import (
    APEX_X,
    APEX_Y,
    NEXT_COS,
    NEXT_LENGTH,
    NEXT_SIN,
    PREV_COS,
    PREV_LENGTH,
    PREV_SIN,
    Fans,
    Unfolding,
    corner_position,
)
from ddgcli.mesh.topology import NEXT, PREVIOUS

REACHED, AT_BOUNDARY, GAVE_UP = 0, 1, 2
SNAP = 1e-12  # a line this close to a vertex, relative to the side it crosses, goes through the vertex

_log = logging.getLogger("ddgcli")
_NEXT_SIDE = np.array([1, 1, -2])  # 3f+j -> 3f+(j+1)%3 by adding
_PREVIOUS_SIDE = np.array([2, -1, -1])


@dataclass(frozen=True, eq=False)
class Start:
    """Checked start points, unit directions in the planar frames of their faces, and lengths."""

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    direction: NDArray[np.float64]
    length: NDArray[np.float64]


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


class Walk:
    """Lines under way: each stands on `side` at `x` from its tail, heading (dx, dy) into the face above."""

    def __init__(
        self, unfolding: Unfolding, make_fans: Callable[[], Fans], start: Start, reflect: bool, record: bool
    ) -> None:
        self.unfolding, self.make_fans, self.start = unfolding, make_fans, start
        self.reflect, self.record = reflect, record
        self.table, self.exit_twin = unfolding.side, unfolding.exit_twin
        self.length = unfolding.length
        k = len(start.face)
        self.end_face = start.face.copy()
        self.end_barycentric = start.barycentric.copy()
        self.end_direction = start.direction.copy()
        self.left_over = start.length / unfolding.scale
        self.status = np.zeros(k, dtype=np.int8)
        self.crossings = np.zeros(k, dtype=np.int64)
        self.steps = 0
        self.records: list[tuple[NDArray, NDArray, NDArray]] = []
        self.no_start = np.zeros(
            k, dtype=bool
        )  # lines that start on a side or at a vertex, and so with a crossing
        none = np.zeros(0, dtype=np.int64)
        self._hold(none, none, *(np.zeros(0) for _ in range(5)))

    def _hold(
        self,
        line: NDArray,
        side: NDArray,
        x: NDArray,
        dx: NDArray,
        dy: NDArray,
        rest: NDArray,
        width: NDArray,
    ) -> None:
        self.line, self.side, self.x, self.dx, self.dy, self.rest, self.width = (
            line,
            side,
            x,
            dx,
            dy,
            rest,
            width,
        )

    # -- the first face ------------------------------------------------------------------------------------

    def begin(self) -> None:
        """From the start point to the first side or vertex."""
        start = self.start
        line = np.flatnonzero(self.left_over > 0)
        b, d, face = start.barycentric[line], start.direction[line], start.face[line]
        side_length = self.length.reshape(-1, 3)[face]
        corner = corner_position(self.unfolding, face) / self.unfolding.scale
        position = np.einsum("ij,ijk->ik", b, corner)
        e = self.unfolding.direction[face]
        outward = d[:, None, 0] * e[:, :, 1] - d[:, None, 1] * e[:, :, 0]
        height = b[:, PREVIOUS] * self.table[:, APEX_Y].reshape(-1, 3)[face]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(outward > 1e-15, height / outward, np.inf)
        j = np.argmin(reach, axis=1)
        pick = np.arange(len(line)), j
        distance = np.where(np.isfinite(reach[pick]), reach[pick], 0.0)
        at = position + distance[:, None] * d - corner[pick]
        length = side_length[pick]
        u = np.clip(np.einsum("ij,ij->i", at, e[pick]), 0.0, length)
        along = np.einsum("ij,ij->i", d, e[pick])
        side = 3 * face + j
        at_vertex = (b > SNAP).sum(axis=1) == 1
        self._finish_in_first_face(line, b, pick, u, length, distance, at_vertex)
        rest = self.left_over[line] - distance
        on = np.flatnonzero((rest > 0) & ~at_vertex)
        self.no_start[line[on]] = distance[on] <= 0
        self._leave(line[on], side[on], u[on], along[on], outward[pick][on], rest[on], length[on])
        self.no_start[line[at_vertex]] = True
        self._leave_vertices(line[at_vertex], face[at_vertex], np.argmax(b[at_vertex], axis=1), d[at_vertex])
        went_on = np.zeros(len(self.no_start), dtype=bool)
        went_on[self.line] = True
        self.no_start &= went_on

    def _finish_in_first_face(
        self,
        line: NDArray,
        b: NDArray,
        pick: tuple,
        u: NDArray,
        length: NDArray,
        distance: NDArray,
        skip: NDArray,
    ) -> None:
        rest = self.left_over[line]
        done = np.flatnonzero((rest <= distance) & ~skip)
        rows, j = np.arange(len(done)), pick[1][done]
        share = (u[done] / length[done]) if len(done) else u[done]
        exit_b = np.zeros((len(done), 3))
        exit_b[rows, j], exit_b[rows, NEXT[j]] = 1.0 - share, share
        s = (rest[done] / distance[done])[:, None]
        self.end_barycentric[line[done]] = (1 - s) * b[done] + s * exit_b
        self.left_over[line[done]] = 0.0

    def _leave_vertices(self, line: NDArray, face: NDArray, corner: NDArray, d: NDArray) -> None:
        """Start at a vertex: the direction, read in the plane of `face`, is looked up in the unfolded fan."""
        if not len(line):
            return
        fans = self.make_fans()
        side = 3 * face + corner
        e = self.unfolding.direction[face, corner]
        angle = np.arctan2(e[:, 0] * d[:, 1] - e[:, 1] * d[:, 0], np.einsum("ij,ij->i", d, e))
        middle = 0.5 * fans.corner_angle[side]
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
            self._end_at_corner(
                line[stuck], corner[stuck], rest[stuck], np.where(lost, GAVE_UP, AT_BOUNDARY)[stuck]
            )
            keep = ~stuck
            line, corner, fan, total, turned, rest, is_open = (
                a[keep] for a in (line, corner, fan, total, turned, rest, is_open)
            )
        turned = np.where(is_open, np.clip(turned, 0.0, total), turned % total)
        corner = fans.locate(fan, turned)
        local = np.clip(turned - fans.angle_before[corner], 0.0, fans.corner_angle[corner])
        self._append(line, corner, np.zeros(len(line)), np.cos(local), np.sin(local), rest)
        self._note(line, corner, np.zeros(len(line)))

    # -- one crossing --------------------------------------------------------------------------------------

    def cross(self) -> None:
        """Advance every line through one face."""
        self.steps += 1
        side, x, dx, dy, rest = self.side, self.x, self.dx, self.dy, self.rest
        row = self.table.take(side, axis=0)
        apex_x, apex_y = row[:, APEX_X], row[:, APEX_Y]
        to_apex = apex_x - x
        right = (dx * apex_y > dy * to_apex) | (x == 0.0)
        c = np.where(right, row[:, NEXT_COS], row[:, PREV_COS])
        s = np.where(right, row[:, NEXT_SIN], row[:, PREV_SIN])
        outward = dx * s - dy * c
        along = dx * c + dy * s
        base = np.where(right, self.width - x, x)  # from the line to the corner shared by entry and exit side
        with np.errstate(divide="ignore", invalid="ignore"):
            k = base / outward
            u = k * dy
            distance = k * np.abs(s)
        exit_length = np.where(right, row[:, NEXT_LENGTH], row[:, PREV_LENGTH])
        beyond = ~((u <= exit_length) & (outward > 0))
        if beyond.any():  # rounding, beside the apex or along the exit side: through the apex
            distance[beyond] = np.hypot(to_apex[beyond], apex_y[beyond])
            u[beyond] = exit_length[beyond]
            outward = np.maximum(outward, 0.0)
        done = rest <= distance
        which = right.astype(np.int64)
        if done.any():
            self._finish(np.flatnonzero(done), right, u, exit_length, distance)
            on = np.flatnonzero(~done)
            side, which, u, along, outward, exit_length = (
                a.take(on) for a in (side, which, u, along, outward, exit_length)
            )
            line, rest = self.line.take(on), rest.take(on) - distance.take(on)
        else:
            line, rest = self.line, rest - distance
        self._pass(line, side, which, u, along, outward, rest, exit_length)

    def _pass(
        self, line: NDArray, side: NDArray, which: NDArray, u: NDArray, along: NDArray, outward: NDArray,
        rest: NDArray, exit_length: NDArray,
    ) -> None:  # fmt: skip
        """Through the exit side (`u` counts from the corner shared with the entry side) or a vertex."""
        twin = self.exit_twin.take(2 * side + which)
        snap = SNAP * exit_length
        special = (twin < 0) | (u <= snap) | (u >= exit_length - snap)
        x = np.where(which == 1, exit_length - u, u)  # on the twin, which runs the other way
        if special.any():
            odd, plain = np.flatnonzero(special), np.flatnonzero(~special)
            is_right = which[odd] == 1
            exit_side = side[odd] + np.where(
                is_right, _NEXT_SIDE[side[odd] % 3], _PREVIOUS_SIDE[side[odd] % 3]
            )
            from_tail = np.where(is_right, u[odd], exit_length[odd] - u[odd])
            self._hold(
                line[plain],
                twin[plain],
                x[plain],
                -along[plain],
                outward[plain],
                rest[plain],
                exit_length[plain],
            )
            self._note(line[plain], twin[plain], x[plain])
            self._leave_odd(
                line[odd], exit_side, from_tail, along[odd], outward[odd], rest[odd], exit_length[odd]
            )
            return
        self._hold(line, twin, x, -along, outward, rest, exit_length)
        self._note(line, twin, x)

    def _leave(
        self, line: NDArray, side: NDArray, u: NDArray, along: NDArray, outward: NDArray, rest: NDArray,
        length: NDArray,
    ) -> None:  # fmt: skip
        """Leave faces through `side` at `u` from its tail, heading (along, -outward) in its frame."""
        twin = self.exit_twin[side + np.where(side % 3 == 2, -2, 1), 0]
        snap = SNAP * length
        special = (twin < 0) | (u <= snap) | (u >= length - snap)
        on = ~special
        self._append(line[on], twin[on], (length - u)[on], -along[on], outward[on], rest[on])
        self._note(line[on], twin[on], (length - u)[on])
        odd = special
        self._leave_odd(line[odd], side[odd], u[odd], along[odd], outward[odd], rest[odd], length[odd])

    def _leave_odd(
        self, line: NDArray, side: NDArray, u: NDArray, along: NDArray, outward: NDArray, rest: NDArray,
        length: NDArray,
    ) -> None:  # fmt: skip
        """Through a vertex at an end of `side`, or at the boundary."""
        if not len(line):
            return
        snap = SNAP * length
        vertex = (u <= snap) | (u >= length - snap)
        self._through_vertices(*(a[vertex] for a in (line, side, u, along, outward, rest, length)))
        edge = ~vertex
        line, side, u, along, outward, rest, length = (
            a[edge] for a in (line, side, u, along, outward, rest, length)
        )
        if self.reflect:  # turned back into the same face; a side with three faces reflects too
            self._append(line, side, u, along, outward, rest)
            self._note(line, side, u)
        elif len(line):
            barycentric = _on_side(side, u / length)
            self._end(line, side, along, -outward, barycentric, rest, np.int8(AT_BOUNDARY))

    def _through_vertices(
        self, line: NDArray, side: NDArray, u: NDArray, along: NDArray, outward: NDArray, rest: NDArray,
        length: NDArray,
    ) -> None:  # fmt: skip
        """The equal-angle rule: leave at half the total angle from where the line came in."""
        if not len(line):
            return
        fans = self.make_fans()
        head = u > 0.5 * length
        corner = side + np.where(head, _NEXT_SIDE[side % 3], 0)
        width = fans.corner_angle[corner]
        local = np.where(head, width - np.arctan2(outward, along), np.arctan2(outward, -along))
        local = np.clip(local, 0.0, width)
        fan = fans.fan[corner]
        total = fans.total_angle[fan]
        here = fans.angle_before[corner] + local
        at_end = fans.is_open[fan]
        there = np.where(at_end, total - here, (here + 0.5 * total) % np.where(total > 0, total, 1.0))
        if not self.reflect and at_end.any():
            stop = np.flatnonzero(at_end)
            self._end_at_corner(line[stop], corner[stop], rest[stop], np.int8(AT_BOUNDARY))
            self.end_direction[line[stop]] = self._in_face(side[stop], along[stop], -outward[stop])
            on = ~at_end
            line, corner, there, rest = line[on], corner[on], there[on], rest[on]
        self._start_from_corner(line, corner, there - fans.angle_before[corner], rest)

    # -- ends and notes ------------------------------------------------------------------------------------

    def _append(
        self, line: NDArray, side: NDArray, x: NDArray, dx: NDArray, dy: NDArray, rest: NDArray
    ) -> None:
        new = (line, side, x, dx, dy, rest, self.length[side])
        old = (self.line, self.side, self.x, self.dx, self.dy, self.rest, self.width)
        self._hold(*(np.concatenate(pair) for pair in zip(old, new, strict=True)))

    def _note(self, line: NDArray, side: NDArray, x: NDArray) -> None:
        if self.record and len(line):
            self.records.append((line, side, x))

    def _finish(
        self, done: NDArray, right: NDArray, u: NDArray, exit_length: NDArray, distance: NDArray
    ) -> None:
        """Lines that end inside the face: between the entry and the exit point."""
        side, line = self.side[done], self.line[done]
        entry = _on_side(side, self.x[done] / self.width[done])
        is_right, share = right[done], u[done] / exit_length[done]
        exit_side = side + np.where(is_right, _NEXT_SIDE[side % 3], _PREVIOUS_SIDE[side % 3])
        leaving = _on_side(exit_side, np.where(is_right, share, 1.0 - share))
        s = np.divide(self.rest[done], distance[done], out=np.zeros(len(done)), where=distance[done] > 0)[
            :, None
        ]
        self._end(
            line, side, self.dx[done], self.dy[done], (1 - s) * entry + s * leaving, 0.0, np.int8(REACHED)
        )

    def _end(
        self,
        line: NDArray,
        side: NDArray,
        dx: NDArray,
        dy: NDArray,
        barycentric: NDArray,
        rest: Any,
        status: Any,
    ) -> None:
        self.end_face[line] = side // 3
        self.end_barycentric[line] = barycentric
        self.end_direction[line] = self._in_face(side, dx, dy)
        self.left_over[line] = rest
        self.status[line] = status
        self.crossings[line] = self.steps

    def _end_at_corner(self, line: NDArray, corner: NDArray, rest: NDArray, status: Any) -> None:
        self.end_face[line] = corner // 3
        self.end_barycentric[line] = _on_side(corner, np.zeros(len(corner)))
        self.left_over[line] = rest
        self.status[line] = status
        self.crossings[line] = self.steps

    def _in_face(self, side: NDArray, dx: NDArray, dy: NDArray) -> NDArray[np.float64]:
        e = self.unfolding.direction.reshape(-1, 2)[side]
        turned = np.stack([dx * e[:, 0] - dy * e[:, 1], dx * e[:, 1] + dy * e[:, 0]], axis=1)
        return turned / np.hypot(turned[:, 0], turned[:, 1])[:, None]

    def abandon(self, max_crossings: int) -> None:
        """End what is still under way, and say so."""
        if len(self.line):
            with np.errstate(divide="ignore", invalid="ignore"):
                share = np.nan_to_num(self.x / self.width)
            self._end(
                self.line,
                self.side,
                self.dx,
                self.dy,
                _on_side(self.side, share),
                self.rest,
                np.int8(GAVE_UP),
            )
        stuck = np.flatnonzero(self.status == GAVE_UP)
        if len(stuck):
            _log.warning(
                f"{len(stuck)} lines were given up (first: line {stuck[0]}) after {max_crossings} crossings "
                "or at a vertex without angles; they end short of their length"
            )

    def result(self) -> Traces:
        scale = self.unfolding.scale
        walked = self.start.length - self.left_over * scale
        ends = (self.end_face, self.end_barycentric, self.end_direction, walked, self.status, self.crossings)
        return Traces(*ends, *(self._paths() if self.record else ()))

    def _paths(self) -> tuple[NDArray, NDArray, NDArray]:
        """Start, crossings in order, end: one line after the other."""
        k = len(self.status)
        first = np.flatnonzero(~self.no_start)
        batches = [first, *(record[0] for record in self.records), np.arange(k)]
        start = np.concatenate([[0], np.cumsum(np.bincount(np.concatenate(batches), minlength=k))])
        cursor, places = start[:-1].copy(), []
        for line in batches:  # a line stands at most once in a batch
            place = cursor[line]
            cursor[line] = place + 1
            places.append(place)
        none = np.zeros(0, dtype=np.int64)
        side = np.concatenate([none, *(record[1] for record in self.records)])
        x = np.concatenate([np.zeros(0), *(record[2] for record in self.records)])
        share = np.divide(x, self.length[side], out=np.zeros(len(x)), where=self.length[side] > 0)
        face, barycentric = np.empty(start[-1], dtype=np.int64), np.zeros((start[-1], 3))
        face[places[0]], barycentric[places[0]] = self.start.face[first], self.start.barycentric[first]
        face[places[-1]], barycentric[places[-1]] = self.end_face, self.end_barycentric
        middle = np.concatenate([none, *places[1:-1]])
        quotient, j = np.divmod(side, 3)
        face[middle] = quotient
        barycentric[middle, j] = 1.0 - share
        barycentric[middle, NEXT[j]] = share
        return start, face, barycentric


def _on_side(side: NDArray, share: NDArray) -> NDArray[np.float64]:
    """(k, 3) barycentric coordinates at `share` of the way along sides, in the face of the side."""
    barycentric = np.zeros((len(side), 3))
    rows, j = np.arange(len(side)), side % 3
    barycentric[rows, j] = 1.0 - share
    barycentric[rows, NEXT[j]] = share
    return barycentric
