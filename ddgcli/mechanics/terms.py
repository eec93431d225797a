"""Terms of a mechanical system, which effects return: potentials, dissipation, fixed coordinates."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

Mode = Literal["exact", "projected", "material"]
ActsAt = Literal["ends", "end", "middle"]  # of a step: where its forces are taken
TimedPositions = tuple[float, NDArray[np.float64]]  # s; (n, 3) in m
LinearOperator = Callable[[NDArray], NDArray[np.float64]]  # product of a matrix with (n, 3) vectors

NO_ELEMENTS: NDArray[np.int64] = np.zeros((0, 1), dtype=np.int64)
NO_ELEMENTS.flags.writeable = False


class Term:
    """What an effect adds to a system; a member that is None is one that the term does not have.

    Attributes
    ----------
    name : str
        Of the effect.
    obstacle : str
        Name of the obstacle that the term's force is exerted on; "" without one.
    vertices : slice or None
        Of the object, in a system of several.
    at : method (time in s) -> Potential or Dissipation
        Of a term that depends on time.
    travel_work : method (x, before, after) -> float
        Joules that a moving obstacle adds between two pairs of a time and positions, with the force at x.
    """

    name: str
    obstacle: str = ""
    vertices: slice | None = None
    at: Any = None
    travel_work: Any = None

    @property
    def own_term(self) -> Any:
        """The term of the object alone, without what places or divides it."""
        return self

    @property
    def is_zero(self) -> bool:
        """Whether the term is a load of strength zero."""
        return False


class Potential(Term, ABC):
    """An energy of the positions, as a sum over elements.

    An energy that is the least one over internal unknowns (edge rotations) lists these in `stencil` by
    numbers from n on, and `blocks` are Hessians in both; of an internal unknown only the first of its three
    rows is used.

    Attributes
    ----------
    stencil : (k, s) ndarray of int
        Vertices of each element; empty where the gradient is constant.
    exact_energy : bool
        Whether the gradient is that of the energy; else the work is that of the force along the path.
    hessian : method (x, mode) -> (3n, 3n) sparse array, or None for zero
        Of a potential whose elements change from place to place, and whose stencil is empty.
    pair_blocks : method (x, mode) -> (3, 3, p, k) ndarray
        Blocks of the p pairs of vertices of the elements, where the energy is invariant to translations.
    matrix : (n, n) sparse array
        Of an energy that is quadratic with the same matrix for each coordinate.
    low_rank : method (x) -> (n, 3) ndarray u
        The Hessian is that of the blocks plus u u^T.
    material_operator : method (x) -> LinearOperator
        Product of the material Hessian at x with vectors (n, 3), without its blocks.
    subset : method (rows, stencil) -> Potential
        Some of the elements, with these vertex indices.
    linearised : method (x, move) -> Potential
        The Hessian has the stress to which x + move leads to first order.
    scaled : method (factor) -> Potential
        A load times a factor.
    couples : method (x) -> ((c, 2) vertices, (c, 3) moments)
        Of the supports on directions of edges that they hold.
    observed : method (x) -> dict of str to float
        Scalars of a frame.
    """

    stencil: NDArray[np.int64]
    exact_energy: bool = True
    hessian: Any = None
    pair_blocks: Any = None
    matrix: Any = None
    low_rank: Any = None
    material_operator: Any = None
    subset: Any = None
    linearised: Any = None
    scaled: Any = None
    couples: Any = None
    observed: Any = None

    @abstractmethod
    def energy(self, x: NDArray) -> float: ...

    @abstractmethod
    def gradient(self, x: NDArray) -> NDArray[np.float64]: ...

    @abstractmethod
    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        """(k, 3s, 3s) Hessians of the elements, coordinates of a vertex together.

        `exact`, `projected` (positive semidefinite) or `material` (Gauss-Newton: the part that a rigid motion
        does not feel); the next call may reuse the array.
        """

    @property
    def is_dead(self) -> bool:
        """Whether the gradient is constant: no elements, and no Hessian of its own."""
        return len(self.stencil) == 0 and self.hessian is None


class BarrierPotential(Potential):
    """A potential that is infinite outside an admissible set (a barrier); 0 where nothing is in contact.

    Attributes
    ----------
    crosses : method (before, after) -> bool
        Whether surfaces meet along the straight path.
    begin_step : method () -> None
        Discards what the potential keeps from earlier steps.
    carried : method (x, since) -> (n, 3) ndarray or None
        Positions x of the time `since`, moved along with a moving obstacle; None where surfaces would meet.
    """

    crosses: Any = None
    begin_step: Any = None
    carried: Any = None

    @abstractmethod
    def longest(self, x: NDArray, move: NDArray) -> float:
        """Largest fraction in (0, 1] of `move` that stays inside."""

    @abstractmethod
    def outside(self, x: NDArray) -> tuple[int, float] | None:
        """First vertex that is outside and its gap, or None."""

    @abstractmethod
    def stiffest(self, x: NDArray) -> NDArray[np.float64]:
        """(n,) curvature in N/m that a vertex is expected to meet from `x` on: for explicit steps."""


class Dissipation(Term, ABC):
    """A Rayleigh dissipation function R of the velocities; the force is -dR/dv.

    Attributes
    ----------
    stencil : (k, s) ndarray of int
    active : bool
        It can also add energy, as wind does, whose air moves.
    smooth : bool
        It is a smooth function of the positions, of inadmissible ones too: implicit steps take it at
        predicted positions.
    lagged : method (time in s) -> Dissipation
        The one whose normal forces are those of an earlier time.
    """

    stencil: NDArray[np.int64]
    active: bool = False
    smooth: bool = False
    lagged: Any = None

    @abstractmethod
    def frozen(self, x: NDArray, dt: float) -> Potential:
        """R as a potential of the velocity, with everything that depends on positions taken at `x`."""


OPTIONAL_MEMBERS = tuple(
    name
    for kind in (Term, Potential, BarrierPotential, Dissipation)
    for name in kind.__annotations__
    if name in vars(kind)
)


class Constraint(Term, ABC):
    """Equations between the positions that hold at all times."""

    @abstractmethod
    def jacobian(self, x: NDArray) -> Any:
        """Sparse (e, 3n) derivatives of the equations in the positions."""


BLOCK_ROWS = 4096  # whose working arrays stay in the cache
Arrays = dict[str, NDArray[np.float64]]


class Memory(ABC):
    """A potential of another term that depends on the past, through arrays that change between steps.

    Attributes
    ----------
    potential : Term
        The one that it replaces.
    effect : str
        Name that its time is booked to.
    """

    potential: Any
    effect: str

    @property
    def is_zero(self) -> bool:
        """Whether the term that it replaces is a load of strength zero."""
        return self.potential.is_zero

    @abstractmethod
    def initial(self) -> Arrays:
        """The arrays at the start of a run; `work` (1,), if among them: joules dissipated so far."""

    @abstractmethod
    def at(self, memory: Arrays) -> Any:
        """The term for these arrays."""

    @abstractmethod
    def commit(self, x: NDArray, memory: Arrays) -> Arrays:
        """The arrays after a step that ends at x; the same object where they do not change."""


class PlasticMemory(Memory):
    """A memory of plastic strains: an equilibrium has to find them together with its positions."""

    @abstractmethod
    def distance(self, one: Arrays, other: Arrays) -> float:
        """Largest difference of the plastic strains of two memories, over the limit."""

    @abstractmethod
    def quasi_static(self, x: NDArray, before: Arrays, after: Arrays) -> Arrays:
        """`after` with the work of a slow path from `before` that ends at x, in balance at all times."""

    @abstractmethod
    def carried(self, before: Any, memory: Arrays, rows: NDArray) -> Arrays:
        """The arrays after a change of the mesh, from those of the memory `before` it.

        `rows` (n,) are the vertices before that the vertices were.
        """


@dataclass(frozen=True, eq=False)
class FixedCoordinates(Term):
    """Coordinates that do not move.

    Parameters
    ----------
    mask : (n, 3) ndarray of bool
    name : str
        Of the reaction force; "" where none is reported.
    supports : bool
        Whether they hold the object; those of vertices that no face uses do not.
    """

    mask: NDArray[np.bool_]
    name: str = ""
    supports: bool = True


@dataclass(frozen=True, eq=False)
class PrescribedMotion(Term):
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
class RampedLoad(Term):
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

    @property
    def is_zero(self) -> bool:
        return self.potential.is_zero

    def at(self, time: float) -> Potential:
        return self.potential.scaled(float(np.interp(time, self.times, self.factors)))


@dataclass(frozen=True, eq=False)
class ProportionalLoad(Term):
    """A potential times time over a duration, without bounds: the load of an equilibrium path."""

    potential: Any
    duration: float

    @property
    def is_zero(self) -> bool:
        return self.potential.is_zero

    def at(self, time: float) -> Potential:
        return self.potential.scaled(time / self.duration)


@dataclass(frozen=True, eq=False)
class DeadLoad(Potential):
    """A constant force: energy -f . x.

    Parameters
    ----------
    name : str
    force : (n, 3) ndarray
        Newtons on each vertex.
    """

    name: str
    force: NDArray[np.float64]
    stencil = NO_ELEMENTS

    @property
    def is_zero(self) -> bool:
        return not np.any(self.force)

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
