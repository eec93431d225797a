"""Cubic shells: isometric bending about a curved rest shape, an energy cubic in the positions.

A. Garg, E. Grinspun, M. Wardetzky, D. Zorin, "Cubic shells", 2007. Under isometries the cosine of a hinge
angle is quadratic in the positions and its sine is cubic, so 4 sin^2((angle - rest) / 2) is cubic:
cos(rest) |q|^2 - 2 sin(rest) det + constant, with q the sum of the unit vectors from the edge to the two
apexes and det the volume of the hinge. Multiples of the squared lengths, which isometries do not change, are
added so that the rest shape is stationary under stretching moves, too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.hinges import hinge_frame
from ddgcli.mechanics.terms import LinearOperator, Mode, Potential
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.vectors import cross_matrix, row_cross, row_dot

SIDES = ((0, 1), (0, 2), (1, 2), (0, 3), (1, 3))  # of a hinge
ROTATIONS = ((1, 2, 3), (2, 3, 1), (3, 1, 2))  # of the vertices whose vectors span a hinge's volume


class CubicBending(Potential):
    """Energy 4 w sin^2((angle - rest) / 2) of the hinges under isometric moves.

    Parameters
    ----------
    x : (n, 3) ndarray
        The rest shape.
    stencil : (h, 4) ndarray
    weight : (h,) ndarray
        w in J.
    flat : bool
        Whether the hinges are at rest when flat, not as in the input.
    """

    name = "bending"

    def __init__(self, x: NDArray, stencil: NDArray, weight: NDArray, flat: bool = False) -> None:
        self.stencil = stencil
        f = hinge_frame(x, stencil)
        rest = np.zeros(len(stencil)) if flat else f.angle
        a = np.stack(
            [-(1 - f.s) / f.h - (1 - f.st) / f.ht, -f.s / f.h - f.st / f.ht, 1 / f.h, 1 / f.ht], axis=1
        )
        self.form = (2 * weight * np.cos(rest))[:, None, None] * a[:, :, None] * a[:, None, :]
        self.cubic = 2 * weight * np.sin(rest) / (f.length * f.h * f.ht)
        self._rest = np.zeros((len(stencil), 4, 3))
        if not flat:
            self.form -= _length_terms(x[stencil], self._local_gradient(x))
            self._rest = self._vectors(x)
        values, vectors = np.linalg.eigh(self.form)
        self._positive = np.einsum("hik,hk,hjk->hij", vectors, np.maximum(values, 0.0), vectors)

    def _vectors(self, x: NDArray) -> NDArray[np.float64]:
        """(h, 4, 3) positions relative to the first vertex of each hinge."""
        corner = x[self.stencil]
        return corner - corner[:, :1]

    def energy(self, x: NDArray) -> float:
        # as a polynomial of the displacement from the rest shape: that of the positions loses many digits
        d = self._vectors(x) - self._rest
        quadratic = 0.5 * np.einsum("hij,hia,hja->h", self.form, d, d, optimize=True)
        mean = self._rest + d / 3
        volume = sum(row_dot(mean[:, i], row_cross(d[:, j], d[:, k])) for i, j, k in ROTATIONS)
        return float(np.sum(quadratic + self.cubic * volume))

    def _local_gradient(self, x: NDArray) -> NDArray[np.float64]:
        p = self._vectors(x)
        d = p - self._rest
        gradient = np.matmul(self.form, d)
        for i, j, k in ROTATIONS:
            change = row_cross(d[:, j], p[:, k]) + row_cross(self._rest[:, j], d[:, k])
            slope = self.cubic[:, None] * change
            gradient[:, i] += slope
            gradient[:, 0] -= slope
        return gradient

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        return sum_by_index(self.stencil, self._local_gradient(x), len(x))

    def material_operator(self, x: NDArray) -> LinearOperator:
        """Product of the positive part of the quadratic form, which is constant, with velocities (n, 3)."""
        return lambda v: sum_by_index(self.stencil, np.matmul(self._positive, v[self.stencil]), len(v))

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        """Blocks of the quadratic form (its positive part, unless exact), plus those of the cubic."""
        form = self.form if mode == "exact" else self._positive
        blocks = np.einsum("hij,ab->hiajb", form, np.eye(3))
        if mode == "exact":
            p = self._vectors(x)
            for i, j, k in ROTATIONS:
                # derivative of p_j x p_k in p_j
                turn = -self.cubic[:, None, None] * cross_matrix(p[:, k])
                for row, sign in ((i, 1.0), (0, -1.0)):
                    blocks[:, row, :, j] += sign * turn
                    blocks[:, row, :, 0] -= sign * turn
                turn = self.cubic[:, None, None] * cross_matrix(p[:, j])
                for row, sign in ((i, 1.0), (0, -1.0)):
                    blocks[:, row, :, k] += sign * turn
                    blocks[:, row, :, 0] -= sign * turn
        return blocks.reshape(-1, 12, 12)


def _length_terms(corner: NDArray, gradient: NDArray) -> NDArray[np.float64]:
    """(h, 4, 4) combinations of the forms of squared side lengths with a given gradient at (h, 4, 3) corners.

    They exist because the forces on a hinge at its rest angle are in the span of its five sides.
    """
    span = np.zeros((len(corner), 4, 3, len(SIDES)))
    forms = np.zeros((len(SIDES), 4, 4))
    for k, (i, j) in enumerate(SIDES):
        vector = corner[:, i] - corner[:, j]
        span[:, i, :, k], span[:, j, :, k] = vector, -vector
        forms[k, [i, j], [i, j]], forms[k, [i, j], [j, i]] = 1.0, -1.0
    pseudo = np.linalg.pinv(span.reshape(-1, 12, len(SIDES)))
    factors = np.matmul(pseudo, gradient.reshape(-1, 12, 1))[:, :, 0]
    return np.einsum("hk,kij->hij", factors, forms)
