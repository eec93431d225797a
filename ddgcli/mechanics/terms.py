"""Terms of a mechanical system, which effects return: potentials, dissipation, fixed coordinates."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Mode = Literal["exact", "projected", "material"]
LinearOperator = Callable[[NDArray], NDArray[np.float64]]  # product of a matrix with (n, 3) vectors


@runtime_checkable
class Potential(Protocol):
    """An energy of the positions, as a sum over elements.

    `name` is the effect's name. `stencil` (k, s) lists the vertices of each element; it is empty where the
    gradient is constant. `blocks` returns (k, 3s, 3s) Hessians of the elements, coordinates of a vertex
    together: `exact`, `projected` (positive semidefinite) or `material` (Gauss-Newton: the part that a rigid
    motion does not feel); the next call may reuse the array.

    An energy that is the least one over internal unknowns (edge rotations) lists these in `stencil` by
    numbers from n on, and `blocks` are Hessians in both; of an internal unknown only the first of its three
    rows is used. A potential whose elements change from place to place has an empty stencil and a method
    `hessian(x, mode)`: a (3n, 3n) sparse array, or None for zero.
    """

    @property
    def name(self) -> str: ...
    @property
    def stencil(self) -> NDArray[np.int64]: ...
    def energy(self, x: NDArray) -> float: ...
    def gradient(self, x: NDArray) -> NDArray[np.float64]: ...
    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]: ...


class ElasticPotential(Potential, Protocol):
    """A potential that stiffness damping follows."""

    def material_operator(self, x: NDArray) -> LinearOperator:
        """Product of the material Hessian at x with vectors (n, 3), without its blocks."""
        ...


_KINDS: dict[tuple[Any, ...], bool] = {}  # of `has_kind`, by protocol, class and attributes


def has_kind(term: Any, kind: type) -> bool:
    """Whether a term has the members of a protocol of this module.

    Parameters
    ----------
    term : object
    kind : type
        A protocol.

    Returns
    -------
    bool

    Notes
    -----
    `isinstance` looks up every member at each call: half of an explicit step of a small shell with a handle.
    """
    key = (kind, type(term), *getattr(term, "__dict__", ()))
    if key not in _KINDS:
        _KINDS[key] = isinstance(term, kind)
    return _KINDS[key]


def is_dead(potential: Any) -> bool:
    """Whether the gradient of a potential is constant: no elements, and no Hessian of its own.

    Parameters
    ----------
    potential : Potential

    Returns
    -------
    bool
    """
    return len(potential.stencil) == 0 and not hasattr(potential, "hessian")


def has_exact_energy(potential: Any) -> bool:
    """Whether the gradient of a potential is that of its energy.

    Parameters
    ----------
    potential : Potential

    Returns
    -------
    bool
        False where its attribute `exact_energy` is: its work is that of its force along the path.
    """
    return bool(getattr(potential, "exact_energy", True))


@runtime_checkable
class BarrierPotential(Protocol):
    """A potential that is infinite outside an admissible set (a barrier)."""

    @property
    def name(self) -> str: ...
    def energy(self, x: NDArray) -> float:
        """J; 0 where nothing is in contact."""
        ...

    def longest(self, x: NDArray, move: NDArray) -> float:
        """Largest fraction in (0, 1] of `move` that stays inside."""
        ...

    def outside(self, x: NDArray) -> tuple[int, float] | None:
        """First vertex that is outside and its gap, or None."""
        ...

    def stiffest(self, x: NDArray) -> NDArray[np.float64]:
        """(n,) curvature in N/m that a vertex is expected to meet from `x` on: for explicit steps."""
        ...


@runtime_checkable
class Dissipation(Protocol):
    """A Rayleigh dissipation function R of the velocities; the force is -dR/dv.

    One with the attribute `smooth` is a smooth function of the positions, of inadmissible ones too: implicit
    steps take it at predicted positions.
    """

    @property
    def name(self) -> str: ...
    @property
    def stencil(self) -> NDArray[np.int64]: ...
    def frozen(self, x: NDArray, dt: float) -> Potential:
        """R as a potential of the velocity, with everything that depends on positions taken at `x`."""
        ...


@runtime_checkable
class TimeDependent(Protocol):
    """A potential or dissipation that depends on time."""

    def at(self, time: float) -> Any:
        """The potential or dissipation at a time in s."""
        ...


BLOCK_ROWS = 4096  # whose working arrays stay in the cache
Arrays = dict[str, NDArray[np.float64]]


@runtime_checkable
class Memory(Protocol):
    """A potential of another term that depends on the past, through arrays that change between steps.

    `potential` is the term that it replaces, `effect` the name that its time is booked to.
    """

    @property
    def potential(self) -> Any: ...
    @property
    def effect(self) -> str: ...
    def initial(self) -> Arrays:
        """The arrays at the start of a run; `work` (1,), if among them: joules dissipated so far."""
        ...

    def at(self, memory: Arrays) -> Potential:
        """The potential for these arrays."""
        ...

    def commit(self, x: NDArray, memory: Arrays) -> Arrays:
        """The arrays after a step that ends at x; the same object where they do not change."""
        ...


@runtime_checkable
class PlasticMemory(Memory, Protocol):
    """A memory of plastic strains: an equilibrium has to find them together with its positions."""

    def distance(self, one: Arrays, other: Arrays) -> float:
        """Largest difference of the plastic strains of two memories, over the limit."""
        ...

    def quasi_static(self, x: NDArray, before: Arrays, after: Arrays) -> Arrays:
        """`after` with the work of a slow path from `before` that ends at x, in balance at all times."""
        ...


class SplittableMemory(Memory, Protocol):
    """A memory that continues after the mesh of its term is split."""

    def carried(self, before: Any, memory: Arrays, rows: NDArray) -> Arrays:
        """The arrays after a change of the mesh, from those of the memory `before` it.

        `rows` (n,) are the vertices before that the vertices were.
        """
        ...


@dataclass(frozen=True, eq=False)
class FixedCoordinates:
    """Coordinates that do not move.

    Parameters
    ----------
    mask : (n, 3) ndarray of bool
    name : str
        Of the reaction force; "" where none is reported.
    """

    mask: NDArray[np.bool_]
    name: str = ""


@dataclass(frozen=True, eq=False)
class PrescribedMotion:
    """Vertices that follow a given motion.

    Parameters
    ----------
    mask : (n, 3) ndarray of bool
        True in the rows of these vertices.
    motion : callable time -> (x, v, a)
        (k, 3) positions, velocities and accelerations of the vertices, in ascending order.
    name : str
        Of the reaction force.
    """

    mask: NDArray[np.bool_]
    motion: Callable[[float], tuple[NDArray, NDArray, NDArray]]
    name: str = ""


@dataclass(frozen=True, eq=False)
class RampedLoad:
    """A potential times a factor that is piecewise linear in time.

    Parameters
    ----------
    potential : potential with a method `scaled(factor)`
    times, factors : (k,) ndarray
        Seconds, ascending; before the first and after the last the factor is constant.
    """

    potential: Any
    times: NDArray[np.float64]
    factors: NDArray[np.float64]

    def at(self, time: float) -> Potential:
        return self.potential.scaled(float(np.interp(time, self.times, self.factors)))


@dataclass(frozen=True, eq=False)
class ProportionalLoad:
    """A potential times time over a duration, without bounds: the load of an equilibrium path."""

    potential: Any
    duration: float

    def at(self, time: float) -> Potential:
        return self.potential.scaled(time / self.duration)


@dataclass(frozen=True, eq=False)
class DeadLoad:
    """A constant force: energy -f . x.

    Parameters
    ----------
    name : str
    force : (n, 3) ndarray
        Newtons on each vertex.
    """

    name: str
    force: NDArray[np.float64]

    @property
    def stencil(self) -> NDArray[np.int64]:
        return np.zeros((0, 1), dtype=np.int64)

    def scaled(self, factor: float) -> DeadLoad:
        """The load times a factor."""
        return DeadLoad(self.name, factor * self.force)

    def energy(self, x: NDArray) -> float:
        return -float(np.vdot(self.force, x))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        return -self.force

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return np.zeros((0, 3, 3))


Value = TypeVar("Value")


def at_last_point(method: Callable[[Any, NDArray], Value]) -> Callable[[Any, NDArray], Value]:
    """Cache a method's value at the last array of positions (the same object, which is not written to).

    Energy, gradient and Hessian of a Newton iteration are evaluated at one point and share results.

    Parameters
    ----------
    method : callable
        Of an object and its positions.

    Returns
    -------
    callable
    """
    name = f"_last_{method.__name__}"

    @functools.wraps(method)
    def cached(self: Any, x: NDArray) -> Value:
        last = self.__dict__.get(name)
        if last is None or last[0] is not x:
            last = self.__dict__[name] = (x, method(self, x))
        return last[1]

    return cached


def row_blocks(count: int) -> Iterator[slice]:
    """Slices of at most `BLOCK_ROWS` elements.

    Parameters
    ----------
    count : int
        Number of elements.

    Yields
    ------
    slice
    """
    return (slice(start, min(start + BLOCK_ROWS, count)) for start in range(0, count, BLOCK_ROWS))
