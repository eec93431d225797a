"""Embedding of the terms of one object in a system of several objects, whose vertices are concatenated."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.terms import (
    OPTIONAL_MEMBERS,
    Arrays,
    BarrierPotential,
    Dissipation,
    FixedCoordinates,
    LinearOperator,
    Memory,
    Mode,
    PlasticMemory,
    Potential,
    PrescribedMotion,
    Term,
    TimedPositions,
)


class Rows:
    """Vertices start ... start + count of a system of n vertices."""

    def __init__(self, start: int, count: int, n: int) -> None:
        self.rows, self.start, self.count, self.n = slice(start, start + count), start, count, n
        self._last: tuple[NDArray, NDArray] | None = None

    def of(self, x: NDArray) -> NDArray[np.float64]:
        """The rows of the object in (n, ...) values; the same input gives the same array, for caches."""
        if self._last is None or self._last[0] is not x:
            self._last = x, x[self.rows]
        return self._last[1]

    def padded(self, values: NDArray) -> NDArray:
        """(n, ...) values with zeros outside the object."""
        total = np.zeros((self.n, *values.shape[1:]), dtype=values.dtype)
        total[self.rows] = values
        return total

    def padded_matrix(self, matrix: Any, size: int = 1) -> Any:
        """(size n, size n) sparse array with zeros outside the object; `size` rows per vertex."""
        entries, first, whole = matrix.tocoo(), size * self.start, size * self.n
        place = (entries.row + first, entries.col + first)
        return type(entries)((entries.data, place), shape=(whole, whole)).tocsc()

    def indices(self, stencil: NDArray) -> NDArray[np.int64]:
        """A stencil of the object with the indices of the system."""
        # the indices after those of the vertices are internal unknowns of the term
        return np.where(stencil < self.count, stencil + self.start, stencil - self.count + self.n)


class EmbeddedTerm(Term):
    """A term of one object in a system; optional members that the term lacks are None here, too."""

    def __init__(self, own_term: Any, rows: Rows) -> None:
        self._own_term, self.rows = own_term, rows
        for name in OPTIONAL_MEMBERS:
            value = getattr(own_term, name, None)
            if not callable(value):
                setattr(self, name, value)
        self.vertices = rows.rows
        if isinstance(own_term, Potential | Dissipation):
            self.name, self.stencil = own_term.name, rows.indices(own_term.stencil)
        if isinstance(own_term, Potential) and own_term.matrix is not None:
            self.matrix = rows.padded_matrix(own_term.matrix)

    @property
    def own_term(self) -> Any:
        return self._own_term

    def at(self, time: float) -> Any:
        return embedded(self.own_term.at(time), self.rows)


class EmbeddedPotential(EmbeddedTerm, Potential):
    """A potential of one object in a system."""

    def energy(self, x: NDArray) -> float:
        return self.own_term.energy(self.rows.of(x))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        return self.rows.padded(self.own_term.gradient(self.rows.of(x)))

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return self.own_term.blocks(self.rows.of(x), mode)

    def pair_blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        # valid because the vertices of an object keep their order in the system
        return self.own_term.pair_blocks(self.rows.of(x), mode)

    def hessian(self, x: NDArray, mode: Mode) -> Any:
        local = self.own_term.hessian(self.rows.of(x), mode)
        return None if local is None else self.rows.padded_matrix(local, 3)

    def low_rank(self, x: NDArray) -> NDArray[np.float64]:
        return self.rows.padded(self.own_term.low_rank(self.rows.of(x)))

    def material_operator(self, x: NDArray) -> LinearOperator:
        multiply = self.own_term.material_operator(self.rows.of(x))
        return lambda v: self.rows.padded(multiply(v[self.rows.rows]))

    def subset(self, rows: NDArray, stencil: NDArray) -> Potential:
        # `stencil` has indices of its own, without the offset of the object
        return self.own_term.subset(rows, stencil)

    def linearised(self, x: NDArray, move: NDArray) -> Any:
        return embedded(self.own_term.linearised(self.rows.of(x), move[self.rows.rows]), self.rows)

    def scaled(self, factor: float) -> Any:
        return embedded(self.own_term.scaled(factor), self.rows)

    def couples(self, x: NDArray) -> tuple[NDArray, NDArray]:
        ends, moments = self.own_term.couples(self.rows.of(x))
        return ends + self.rows.start, moments

    def observed(self, x: NDArray) -> dict[str, Any]:
        return self.own_term.observed(self.rows.of(x))


class EmbeddedBarrier(EmbeddedPotential, BarrierPotential):
    """A barrier of one object in a system."""

    def collision_free_fraction(self, x: NDArray, move: NDArray) -> float:
        return self.own_term.collision_free_fraction(self.rows.of(x), move[self.rows.rows])

    def outside(self, x: NDArray) -> tuple[int, float] | None:
        crossed = self.own_term.outside(self.rows.of(x))
        return None if crossed is None else (crossed[0] + self.rows.start, crossed[1])

    def expected_stiffness(self, x: NDArray) -> NDArray[np.float64]:
        own = self.own_term.expected_stiffness(self.rows.of(x))
        return self.rows.padded(np.broadcast_to(own, (self.rows.count,)))

    def crosses(self, before: NDArray, after: NDArray) -> bool:
        return self.own_term.crosses(before[self.rows.rows], after[self.rows.rows])

    def begin_step(self) -> None:
        self.own_term.begin_step()

    def travel_work(self, x: NDArray, before: TimedPositions, after: TimedPositions) -> float:
        own_before, own_after = ((time, self.rows.of(y)) for time, y in (before, after))
        return self.own_term.travel_work(self.rows.of(x), own_before, own_after)

    def carried(self, x: NDArray, since: float) -> NDArray[np.float64] | None:
        local = self.own_term.carried(self.rows.of(x), since)
        if local is None:
            return None
        moved = x.copy()
        moved[self.rows.rows] = local
        return moved


class EmbeddedDissipation(EmbeddedTerm, Dissipation):
    """A dissipation of one object in a system."""

    def frozen(self, x: NDArray, dt: float) -> Any:
        return embedded(self.own_term.frozen(self.rows.of(x), dt), self.rows)

    def lagged(self, time: float) -> Any:
        return embedded(self.own_term.lagged(time), self.rows)


class EmbeddedMemory(Memory):
    """A memory of one object's term; `potential` is the embedded term that it replaces."""

    def __init__(self, memory: Memory, potential: Any, rows: Rows) -> None:
        self.memory, self.potential, self.rows = memory, potential, rows
        self.effect = memory.effect

    def initial(self) -> Arrays:
        return self.memory.initial()

    def at(self, memory: Arrays) -> Any:
        return embedded(self.memory.at(memory), self.rows)

    def commit(self, x: NDArray, memory: Arrays) -> Arrays:
        return self.memory.commit(self.rows.of(x), memory)


class EmbeddedPlasticMemory(EmbeddedMemory, PlasticMemory):
    """A memory of the plastic strains of one object."""

    memory: PlasticMemory

    def distance(self, one: Arrays, other: Arrays) -> float:
        return self.memory.distance(one, other)

    def quasi_static(self, x: NDArray, before: Arrays, after: Arrays) -> Arrays:
        return self.memory.quasi_static(self.rows.of(x), before, after)

    def carried(self, before: EmbeddedPlasticMemory, memory: Arrays, rows: NDArray) -> Arrays:
        """Memory after a change of the object's mesh; `rows` are indices of its vertices before."""
        return self.memory.carried(before.memory, memory, rows[self.rows.rows] - before.rows.start)


KINDS: dict[type, type[EmbeddedTerm]] = {
    BarrierPotential: EmbeddedBarrier,
    Potential: EmbeddedPotential,
    Dissipation: EmbeddedDissipation,
    Term: EmbeddedTerm,
}  # the first type of a term in this order counts


def embedded(own_term: Any, rows: Rows) -> Any:
    """A term of one object as a term of a system of several.

    Parameters
    ----------
    own_term : object
    rows : Rows
        The vertices of the object.

    Returns
    -------
    object
    """
    if isinstance(own_term, FixedCoordinates | PrescribedMotion):
        return replace(own_term, mask=rows.padded(own_term.mask))
    kind = next(embedding for kind, embedding in KINDS.items() if isinstance(own_term, kind))
    return kind(own_term, rows)


def terms_of_rows(terms: list[Any], rows: slice) -> list[Any]:
    """Terms of one object in a system, without their embedding.

    Parameters
    ----------
    terms : list
        Terms of the system.
    rows : slice
        Vertices of the object.

    Returns
    -------
    list
    """
    return [term.own_term for term in terms if term.vertices is None or term.vertices == rows]


def embedded_terms(own_terms: list[Any], rows: Rows) -> list[Any]:
    """All terms of one object as terms of a system of several; memories refer to the embedded terms.

    Parameters
    ----------
    own_terms : list
        Terms of the object.
    rows : Rows
        Vertices of the object.

    Returns
    -------
    list
    """
    new = {
        id(own_term): embedded(own_term, rows) for own_term in own_terms if not isinstance(own_term, Memory)
    }
    return [
        (EmbeddedPlasticMemory if isinstance(own_term, PlasticMemory) else EmbeddedMemory)(
            own_term, new[id(own_term.potential)], rows
        )
        if isinstance(own_term, Memory)
        else new[id(own_term)]
        for own_term in own_terms
    ]
