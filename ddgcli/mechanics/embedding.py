"""Terms of one object as terms of a system of several objects, whose vertices are concatenated."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.terms import (
    Arrays,
    FixedCoordinates,
    Memory,
    Mode,
    PlasticMemory,
    PrescribedMotion,
    SplittableMemory,
)


class Rows:
    """Vertices start ... start + count of a system of n vertices."""

    def __init__(self, start: int, count: int, n: int) -> None:
        self.rows, self.start, self.count, self.n = slice(start, start + count), start, count, n
        self._last: tuple[NDArray, NDArray] | None = None

    def of(self, x: NDArray) -> NDArray[np.float64]:
        """The object's part of (n, ...) values: one array for one array, for terms with a memory."""
        if self._last is None or self._last[0] is not x:
            self._last = x, x[self.rows]
        return self._last[1]

    def padded(self, values: NDArray) -> NDArray:
        """(n, ...) values with zeros outside the object."""
        total = np.zeros((self.n, *values.shape[1:]), dtype=values.dtype)
        total[self.rows] = values
        return total


class _Term:
    """A term of one object, `own_term`, in a system."""

    def __init__(self, own_term: Any, rows: Rows) -> None:
        self.own_term, self.rows = own_term, rows

    @property
    def name(self) -> str:
        return self.own_term.name

    @property
    def stencil(self) -> NDArray[np.int64]:
        stencil, rows = self.own_term.stencil, self.rows
        # behind the vertices come internal unknowns of the term
        return np.where(stencil < rows.count, stencil + rows.start, stencil - rows.count + rows.n)

    @property
    def obstacle(self) -> str:
        return getattr(self.own_term, "obstacle", "")

    @property
    def exact_energy(self) -> bool:
        return bool(getattr(self.own_term, "exact_energy", True))

    @property
    def active(self) -> bool:
        return bool(getattr(self.own_term, "active", False))

    @property
    def smooth(self) -> bool:
        return bool(getattr(self.own_term, "smooth", False))


class _Energy:
    own_term: Any
    rows: Rows

    def energy(self, x: NDArray) -> float:
        return self.own_term.energy(self.rows.of(x))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        return self.rows.padded(self.own_term.gradient(self.rows.of(x)))

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return self.own_term.blocks(self.rows.of(x), mode)


class _Pairs:
    own_term: Any
    rows: Rows

    def pair_blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        # its vertices keep their order in the system
        return self.own_term.pair_blocks(self.rows.of(x), mode)


class _Changing:
    own_term: Any
    rows: Rows

    def hessian(self, x: NDArray, mode: Mode) -> Any:
        local = self.own_term.hessian(self.rows.of(x), mode)
        if local is None:
            return None
        entries = local.tocoo()
        first, size = 3 * self.rows.start, 3 * self.rows.n
        place = (entries.row + first, entries.col + first)
        return type(entries)((entries.data, place), shape=(size, size)).tocsc()


class _Barrier:
    own_term: Any
    rows: Rows

    def longest(self, x: NDArray, move: NDArray) -> float:
        return self.own_term.longest(self.rows.of(x), move[self.rows.rows])

    def outside(self, x: NDArray) -> tuple[int, float] | None:
        crossed = self.own_term.outside(self.rows.of(x))
        return None if crossed is None else (crossed[0] + self.rows.start, crossed[1])

    def stiffest(self, x: NDArray) -> NDArray[np.float64]:
        own = self.own_term.stiffest(self.rows.of(x))
        return self.rows.padded(np.broadcast_to(own, (self.rows.count,)))


class _Crossing:
    own_term: Any
    rows: Rows

    def crosses(self, before: NDArray, after: NDArray) -> bool:
        return self.own_term.crosses(before[self.rows.rows], after[self.rows.rows])


class _Beginning:
    own_term: Any

    def begin_step(self) -> None:
        self.own_term.begin_step()


class _Pushing:
    own_term: Any
    rows: Rows

    def power(self, x: NDArray) -> float:
        return self.own_term.power(self.rows.of(x))

    def carried(self, x: NDArray, since: float) -> NDArray[np.float64] | None:
        local = self.own_term.carried(self.rows.of(x), since)
        if local is None:
            return None
        moved = x.copy()
        moved[self.rows.rows] = local
        return moved


class _Dissipation:
    own_term: Any
    rows: Rows

    def frozen(self, x: NDArray, dt: float) -> Any:
        return embedded(self.own_term.frozen(self.rows.of(x), dt), self.rows)


class _Lagged:
    own_term: Any
    rows: Rows

    def lagged(self, time: float) -> Any:
        return embedded(self.own_term.lagged(time), self.rows)


class _TimeDependent:
    own_term: Any
    rows: Rows

    def at(self, time: float) -> Any:
        return embedded(self.own_term.at(time), self.rows)


class _LowRank:
    own_term: Any
    rows: Rows

    def low_rank(self, x: NDArray) -> NDArray[np.float64]:
        return self.rows.padded(self.own_term.low_rank(self.rows.of(x)))


class _Observed:
    own_term: Any
    rows: Rows

    def observed(self, x: NDArray) -> dict[str, Any]:
        return self.own_term.observed(self.rows.of(x))


class _Couples:
    own_term: Any
    rows: Rows

    def couples(self, x: NDArray) -> tuple[NDArray, NDArray]:
        ends, moments = self.own_term.couples(self.rows.of(x))
        return ends + self.rows.start, moments


class _Scaled:
    own_term: Any
    rows: Rows

    def scaled(self, factor: float) -> Any:
        return embedded(self.own_term.scaled(factor), self.rows)


CAPABILITIES: dict[str, type] = {
    "energy": _Energy,
    "pair_blocks": _Pairs,
    "hessian": _Changing,
    "longest": _Barrier,
    "crosses": _Crossing,
    "begin_step": _Beginning,
    "power": _Pushing,
    "frozen": _Dissipation,
    "lagged": _Lagged,
    "at": _TimeDependent,
    "low_rank": _LowRank,
    "observed": _Observed,
    "couples": _Couples,
    "scaled": _Scaled,
}


@cache
def _kind(names: tuple[str, ...]) -> type:
    """The class with these methods; protocols are checked by the methods that a class has."""
    return type("EmbeddedTerm", (_Term, *(CAPABILITIES[name] for name in names)), {})


class EmbeddedMemory:
    """A memory of one object's term; `potential` is the embedded term that it replaces."""

    def __init__(self, memory: Memory, potential: Any, rows: Rows) -> None:
        self.memory, self.potential, self.rows = memory, potential, rows

    @property
    def effect(self) -> str:
        return self.memory.effect

    def initial(self) -> Arrays:
        return self.memory.initial()

    def at(self, memory: Arrays) -> Any:
        return embedded(self.memory.at(memory), self.rows)

    def commit(self, x: NDArray, memory: Arrays) -> Arrays:
        return self.memory.commit(self.rows.of(x), memory)

    def carried(self, before: EmbeddedMemory, memory: Arrays, rows: NDArray) -> Arrays:
        """Memory of another mesh of the object, whose vertices in the earlier system are `rows`."""
        own = cast(SplittableMemory, self.memory)
        return own.carried(before.memory, memory, rows[self.rows.rows] - before.rows.start)


class EmbeddedPlasticMemory(EmbeddedMemory):
    """A memory of the plastic strains of one object."""

    def distance(self, one: Arrays, other: Arrays) -> float:
        return cast(PlasticMemory, self.memory).distance(one, other)

    def quasi_static(self, x: NDArray, before: Arrays, after: Arrays) -> Arrays:
        return cast(PlasticMemory, self.memory).quasi_static(self.rows.of(x), before, after)


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
    return _kind(tuple(name for name in CAPABILITIES if hasattr(own_term, name)))(own_term, rows)


def terms_of_rows(terms: list[Any], rows: slice) -> list[Any]:
    """Terms of one object among those of a system, without their embedding.

    Parameters
    ----------
    terms : list
        Of the system.
    rows : slice
        Vertices of the object.

    Returns
    -------
    list
    """
    own_terms = [term.own_term for term in terms if isinstance(term, _Term) and term.rows.rows == rows]
    return own_terms if any(isinstance(term, _Term) for term in terms) else list(terms)


def embedded_terms(own_terms: list[Any], rows: Rows) -> list[Any]:
    """All terms of one object as terms of a system of several; memories with the terms that they replace.

    Parameters
    ----------
    own_terms : list
        Of the object.
    rows : Rows
        Its vertices.

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
