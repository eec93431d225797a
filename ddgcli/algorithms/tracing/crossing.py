"""Arithmetic of one crossing, for arrays and for scalars, and points on sides."""

from __future__ import annotations

from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import NEXT

VERTEX_TOLERANCE = (
    1e-12  # a line this close to a vertex, relative to the side it crosses, goes through the vertex
)
MIN_SINE = 1e-150  # below it the exit length cannot be computed from the angle
ROW = Struct("6d2q")  # a row of Unfolding.side


def leaves_right(apex: Any, x: Any, heading: Any) -> Any:
    """True where the line leaves by the next side. From a vertex it always does (the opposite side)."""
    return (heading.real * apex.imag > heading.imag * (apex.real - x)) | (x == 0.0)


def to_exit(
    x: Any, width: Any, heading: Any, turned: Any, sine: Any, exit_length: Any, share: Any
) -> tuple[Any, Any, Any]:
    """Position of the exit from the corner shared by entry and exit side, from the apex, and its distance.

    `turned` is the heading in the frame of the exit's twin, `sine` the sine of the angle between the two
    sides. `share` is 1 where the line leaves by the next side, 0 where it leaves by the previous.
    """
    k = (x + share * (width - 2.0 * x)) / turned.imag
    u = k * heading.imag
    return u, exit_length - u, k * sine


def scalar_crossings(rows: memoryview, state: tuple, max_steps: int) -> list[tuple]:
    """States (side, x, heading, rest, width) of one line after each of the next faces.

    Ends before a crossing that needs special treatment. `rows` are the bytes of Unfolding.side.
    """
    states = []
    unpack, size = ROW.unpack_from, ROW.size
    side, x, heading, rest, width = state
    for _ in range(max_steps):
        apex_x, apex_y, back_x, back_y, on_x, on_y, back, on = unpack(rows, size * side)
        right = leaves_right(complex(apex_x, apex_y), x, heading)
        side, turn = (on, complex(on_x, on_y)) if right else (back, complex(back_x, back_y))
        before, sine = heading, abs(turn.imag)
        heading = before * turn
        if side < 0 or heading.imag == 0.0 or sine < MIN_SINE:
            break
        exit_length = apex_y / sine
        u, beyond_u, distance = to_exit(x, width, before, heading, sine, exit_length, right)
        least_u = u if u < beyond_u else beyond_u
        if not (least_u > VERTEX_TOLERANCE * exit_length and distance < rest):
            break
        x, rest, width = beyond_u if right else u, rest - distance, exit_length
        states.append((side, x, heading, rest, width))
    return states


def next_side(side: NDArray) -> NDArray[np.int64]:
    """Next side of the same face."""
    return side + np.where(side % 3 == 2, -2, 1)


def previous_side(side: NDArray) -> NDArray[np.int64]:
    """Previous side of the same face."""
    return side + np.where(side % 3 == 0, 2, -1)


def least(x: NDArray, y: NDArray, z: NDArray) -> NDArray[np.int64]:
    """Index of the least of three numbers, row by row (numpy reductions over short axes are slow)."""
    return np.where(x <= y, np.where(x <= z, 0, 2), np.where(y <= z, 1, 2))


def on_side(side: NDArray, share: NDArray) -> NDArray[np.float64]:
    """(k, 3) barycentric coordinates of the points at the fraction `share` along sides, in the face of the
    side."""
    barycentric = np.zeros((len(side), 3))
    rows, j = np.arange(len(side)), side % 3
    barycentric[rows, j] = 1.0 - share
    barycentric[rows, NEXT[j]] = share
    return barycentric
