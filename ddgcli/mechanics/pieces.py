"""Evaluation of potentials with many elements in pieces, which limits the memory for intermediate arrays."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.terms import OPTIONAL_MEMBERS, LinearOperator, Mode, Potential

MIN_PIECE = 1 << 19  # elements per piece; smaller potentials are not divided
MAX_PIECES = 16


class PotentialPieces(Potential):
    """A potential whose energy and gradient are summed over pieces of its elements.

    Unlike the potential itself, it caches nothing between evaluations.

    Parameters
    ----------
    whole : potential with the methods `subset` and `pair_blocks`
    """

    def __init__(self, whole: Potential) -> None:
        self._whole, self.name, self.stencil = whole, whole.name, whole.stencil
        for name in OPTIONAL_MEMBERS:
            value = getattr(whole, name, None)
            if value is None or name not in vars(PotentialPieces):
                setattr(self, name, value)

    @property
    def own_term(self) -> Any:
        return self._whole.own_term

    def rows(self) -> Iterator[slice]:
        """Elements of each piece."""
        size = max(MIN_PIECE, -(-len(self.stencil) // MAX_PIECES))
        return (slice(begin, begin + size) for begin in range(0, len(self.stencil), size))

    def pieces(self) -> Iterator[tuple[slice, Any]]:
        """Range of vertices of each piece, and the potential of the piece as a function of these."""
        for rows in self.rows():
            stencil = self.stencil[rows]
            vertices = slice(int(stencil.min()), int(stencil.max()) + 1)
            yield vertices, self._whole.subset(rows, stencil - vertices.start)

    def energy(self, x: NDArray) -> float:
        return float(sum(piece.energy(x[vertices]) for vertices, piece in self.pieces()))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        total = np.zeros_like(x)
        for vertices, piece in self.pieces():
            total[vertices] += piece.gradient(x[vertices])
        return total

    def material_operator(self, x: NDArray) -> LinearOperator:
        """Product of the material Hessian at x with velocities (n, 3)."""

        def multiply(v: NDArray) -> NDArray[np.float64]:
            total = np.zeros_like(v)
            for vertices, piece in self.pieces():
                total[vertices] += piece.material_operator(x[vertices])(v[vertices])
            return total

        return multiply

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return self._whole.blocks(x, mode)

    def linearised(self, x: NDArray, move: NDArray) -> Potential:
        return PotentialPieces(self._whole.linearised(x, move))


def in_pieces(potential: Potential) -> Potential:
    """Divide a potential into pieces where it has many elements.

    Parameters
    ----------
    potential : Potential

    Returns
    -------
    Potential
        The input itself if it is small, or cannot be divided.
    """
    many = len(potential.stencil) > MIN_PIECE
    divisible = potential.subset is not None and potential.pair_blocks is not None
    return PotentialPieces(potential) if many and divisible else potential


def pieces_of(potential: Any, x: NDArray) -> Iterator[tuple[Any, NDArray]]:
    """Potential of each piece, and the positions of its vertices.

    Parameters
    ----------
    potential : Potential or PotentialPieces
    x : (n, 3) ndarray of float64

    Yields
    ------
    piece : Potential
        The input itself if it is not divided.
    x : (n', 3) ndarray of float64
    """
    if not isinstance(potential, PotentialPieces):
        yield potential, x
        return
    for vertices, piece in potential.pieces():
        yield piece, x[vertices]


def stencils_of(potential: Any) -> list[NDArray[np.int64]]:
    """Stencils of the pieces of a potential, with the vertex indices of the whole system.

    Parameters
    ----------
    potential : Potential or PotentialPieces

    Returns
    -------
    list of (k, s) ndarray of int64
    """
    if not isinstance(potential, PotentialPieces):
        return [potential.stencil]
    return [potential.stencil[rows] for rows in potential.rows()]
