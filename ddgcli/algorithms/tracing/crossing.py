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
    """Whether a line leaves a face by the next side; from a vertex it always does (the opposite side).

    Parameters
    ----------
    apex, heading : complex or (k,) ndarray of complex128
        In the frame of the entry side.
    x : float or (k,) ndarray of float64
        Position on the entry side, from its tail.

    Returns
    -------
    bool or (k,) ndarray of bool
    """
    return (heading.real * apex.imag > heading.imag * (apex.real - x)) | (x == 0.0)


def to_exit(
    x: Any, width: Any, heading: Any, turned: Any, sine: Any, exit_length: Any, share: Any
) -> tuple[Any, Any, Any]:
    """Where a line leaves a face, and how far it runs inside.

    Parameters
    ----------
    x, width : float or (k,) ndarray of float64
        Position on the entry side from its tail, and length of that side.
    heading, turned : complex or (k,) ndarray of complex128
        Unit heading in the frame of the entry side, and of the twin of the exit side.
    sine : float or (k,) ndarray of float64
        Sine of the angle between both sides.
    exit_length : float or (k,) ndarray of float64
        Length of the exit side.
    share : float or (k,) ndarray of float64
        1 where the line leaves by the next side, 0 where by the previous.

    Returns
    -------
    u : float or (k,) ndarray of float64
        Distance of the exit from the corner that both sides share.
    beyond_u : float or (k,) ndarray of float64
        Distance of the exit from the apex.
    distance : float or (k,) ndarray of float64
        Length of the line inside the face.
    """
    k = (x + share * (width - 2.0 * x)) / turned.imag
    u = k * heading.imag
    return u, exit_length - u, k * sine


def scalar_crossings(rows: memoryview, state: tuple, max_steps: int) -> list[tuple]:
    """Follow one line through the next faces, until a crossing that needs special treatment.

    Parameters
    ----------
    rows : memoryview
        Bytes of `Unfolding.side`.
    state : tuple
        Side, position, heading, rest of the length, width of the side.
    max_steps : int

    Returns
    -------
    list of tuple
        The state after each face.
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


def least(x: NDArray, y: NDArray, z: NDArray) -> NDArray[np.int64]:
    """Index of the least of three numbers, row by row (numpy reductions over short axes are slow).

    Parameters
    ----------
    x, y, z : (k,) ndarray of float64

    Returns
    -------
    (k,) ndarray of int64
    """
    return np.where(x <= y, np.where(x <= z, 0, 2), np.where(y <= z, 1, 2))


def on_side(side: NDArray, share: NDArray) -> NDArray[np.float64]:
    """Barycentric coordinates of points on sides, in the face of the side.

    Parameters
    ----------
    side : (k,) ndarray of int64
        Flat side indices 3*face + j.
    share : (k,) ndarray of float64
        Position of the point as a fraction of the side, from its tail.

    Returns
    -------
    (k, 3) ndarray of float64
    """
    barycentric = np.zeros((len(side), 3))
    rows, j = np.arange(len(side)), side % 3
    barycentric[rows, j] = 1.0 - share
    barycentric[rows, NEXT[j]] = share
    return barycentric
