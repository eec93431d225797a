"""Triangles clipped by balls: areas and lengths of sides inside, from coordinates in their planes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.vectors import cross, dot, ratio

_MAX_PAIRS = 8192  # faces clipped at once: the working arrays stay in the cache


@dataclass(frozen=True, eq=False)
class FacePlanes:
    """Triangles in coordinates of their own planes.

    Parameters
    ----------
    table : (25, m) ndarray
        Corner 0 (3 rows), axes of the plane and its normal (9), plane coordinates of corners 1 and 2 about
        corner 0 (4), unit vectors along the three sides (6), their lengths (3). One table, so that one
        gather reads a face.
    area : (m,) ndarray
    """

    table: NDArray[np.float64]
    area: NDArray[np.float64]

    @classmethod
    def of(cls, corners: NDArray) -> FacePlanes:
        """Planes of (3, 3, m) corner positions, components second."""
        side = corners[NEXT] - corners
        longest = np.argmax([dot(s, s) for s in side], axis=0)
        along, other = (np.take_along_axis(side, k[None, None], axis=0)[0] for k in (longest, NEXT[longest]))
        along = ratio(along, np.sqrt(dot(along, along)))
        across = _orthogonal(other, along)
        # a face without area takes any plane through its longest side
        least = np.eye(3)[np.argmin(np.abs(along), axis=0)].T
        across = np.where(dot(across, across) > 0, across, _orthogonal(least, along))
        # twice: of the sides of a needle little more than rounding may remain
        across = _orthogonal(ratio(across, np.sqrt(dot(across, across))), along)
        across = ratio(across, np.sqrt(dot(across, across)))
        normal = cross(along, across)
        doubled = cross(side[0], side[1])
        plane = np.stack([[dot(s, along), dot(s, across)] for s in side])
        length = np.sqrt((plane**2).sum(axis=1))
        unit = ratio(plane, length[:, None])
        rows = [corners[0], along, across, normal, plane[0], -plane[2], *unit, length]
        return cls(np.concatenate(rows), 0.5 * np.sqrt(dot(doubled, doubled)))

    def clip(self, face: NDArray, centre: NDArray, radius: float) -> tuple[NDArray, NDArray]:
        """Areas of faces, and lengths of their sides, inside balls.

        Parameters
        ----------
        face : (k,) ndarray
        centre : (3, k) ndarray

        Returns
        -------
        area : (k,) ndarray
        chord : (3, k) ndarray
        """
        area, chord = np.empty(len(face)), np.empty((3, len(face)))
        for begin in range(0, len(face), _MAX_PAIRS):
            block = slice(begin, begin + _MAX_PAIRS)
            table = np.take(self.table, face[block], axis=1)
            area[block], chord[:, block] = _clipped(table, centre[:, block], radius)
        return np.clip(area, 0.0, self.area[face]), chord


def _orthogonal(vector: NDArray, unit: NDArray) -> NDArray[np.float64]:
    """(3, m) vectors without their components along unit vectors."""
    return vector - dot(vector, unit) * unit


def _clipped(table: NDArray, centre: NDArray, radius: float) -> tuple[NDArray, NDArray]:
    """Areas and chords; the ball cuts the plane in a disc around the projection of its centre.

    The area of the disc within the triangle is a sum over sides: the triangle from the foot to the part of
    the side inside the disc, and circular sectors to the parts outside, all signed.
    """
    offset = table[0:3] - centre
    x, y, height = dot(offset, table[3:6]), dot(offset, table[6:9]), dot(offset, table[9:12])
    disc = np.maximum(radius * radius - height * height, 0.0)
    corners = ((x, y), (x + table[12], y + table[13]), (x + table[14], y + table[15]))
    doubled, chord = np.zeros(len(x)), np.empty((3, len(x)))
    for j, (px, py) in enumerate(corners):
        ux, uy = table[16 + 2 * j], table[17 + 2 * j]
        start = px * ux + py * uy  # position of the side's start along its line
        end = start + table[22 + j]
        away = px * uy - py * ux  # signed distance of the line from the foot
        squared = away * away
        half = np.sqrt(np.maximum(disc - squared, 0.0))
        first, last = np.clip(-half, start, end), np.clip(half, start, end)
        np.subtract(last, first, out=chord[j])
        # both angles are below a right one, so their sum is that of the product of complex numbers
        distance = np.abs(away)
        c, s = squared + first * start, distance * (first - start)
        d, t = squared + last * end, distance * (end - last)
        swept = np.arctan2(c * t + s * d, c * d - s * t)
        doubled += away * chord[j] + disc * np.sign(away) * swept
    return 0.5 * doubled, chord
