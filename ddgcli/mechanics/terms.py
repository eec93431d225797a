"""Terms of a mechanical system: potentials, dissipation, constraints, supports, memories.

Effects of scenes return terms; `system` collects them.
"""

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
    """Contribution of an effect to a system. Optional members are None if a term does not have them.

    Attributes
    ----------
    name : str
        Name of the effect.
    obstacle : str
        Name of the obstacle with which the term exchanges forces; "" without one.
    vertices : slice or None
        Vertices of the object of the term, in a system of several objects.
    at : method (time in s) -> Potential or Dissipation
        The term at a time, if it depends on time.
    travel_work : method (x, before, after) -> float
        Energy in J that a moving obstacle adds between two times, each with positions, with the force at x.
    """

    name: str
    obstacle: str = ""
    vertices: slice | None = None
    at: Any = None
    travel_work: Any = None

    @property
    def own_term(self) -> Any:
        """The term of a single object, without embedding in a system and division into pieces."""
        return self

    @property
    def is_zero(self) -> bool:
        """Whether the term is a load of strength zero."""
        return False


class Potential(Term, ABC):
    """A potential energy of the positions, as a sum over elements.

    An energy may be the minimum over internal unknowns, such as edge rotations. These have indices from n on
    in `stencil`, and `blocks` are the Hessians by positions and internal unknowns; only the first of the
    three rows of an internal unknown is used.

    Attributes
    ----------
    stencil : (k, s) ndarray of int
        Vertices of each element; empty where the gradient is constant.
    exact_energy : bool
        Whether `gradient` is the gradient of `energy`; otherwise work is integrated along the path.
    hessian : method (x, mode) -> (3n, 3n) sparse array, or None for zero
        Hessian of a potential whose elements change with the positions, and whose stencil is empty.
    pair_blocks : method (x, mode) -> (3, 3, p, k) ndarray
        Blocks of the p vertex pairs of the elements, if the energy is translation invariant.
    matrix : (n, n) sparse array
        Matrix of a quadratic energy, the same for each coordinate.
    low_rank : method (x) -> (n, 3) ndarray u
        The Hessian is that of the blocks plus u u^T.
    material_operator : method (x) -> LinearOperator
        Product of the material Hessian at x with vectors (n, 3), without its blocks.
    subset : method (rows, stencil) -> Potential
        Potential of some elements, which get the vertex indices `stencil`.
    linearised : method (x, move) -> Potential
        Potential whose Hessian uses the stress at x + move, linearised in the move.
    scaled : method (factor) -> Potential
        Load times a factor; only loads have this method.
    couples : method (x) -> ((c, 2) vertices, (c, 3) moments)
        Edges whose direction supports hold, and moments of the supports on them.
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

        `exact`; `projected` to positive semidefinite; or `material` (Gauss-Newton), in which rigid motions
        have no energy. The next call may reuse the array.
        """

    @property
    def is_dead(self) -> bool:
        """Whether the gradient is constant: no elements, and no Hessian of its own."""
        return len(self.stencil) == 0 and self.hessian is None


class BarrierPotential(Potential):
    """A barrier: a potential that is infinite outside an admissible set, and 0 without contact.

    Attributes
    ----------
    crosses : method (before, after) -> bool
        Whether surfaces collide along the straight path.
    begin_step : method () -> None
        Discards what the potential has cached in earlier steps.
    carried : method (x, since) -> (n, 3) ndarray or None
        Positions x of the time `since`, moved along with a moving obstacle; None if surfaces would collide.
    """

    crosses: Any = None
    begin_step: Any = None
    carried: Any = None

    @abstractmethod
    def collision_free_fraction(self, x: NDArray, move: NDArray) -> float:
        """Largest fraction in (0, 1] of `move` that stays in the admissible set."""

    @abstractmethod
    def outside(self, x: NDArray) -> tuple[int, float] | None:
        """A vertex outside the admissible set and its gap, or None."""

    @abstractmethod
    def expected_stiffness(self, x: NDArray) -> NDArray[np.float64]:
        """(n,) largest stiffness in N/m that each vertex is expected to meet, at `x` or later.

        Explicit schemes derive their step from it.
        """


class Dissipation(Term, ABC):
    """A Rayleigh dissipation function R of the velocities; the force is -dR/dv.

    Attributes
    ----------
    stencil : (k, s) ndarray of int
    active : bool
        Whether it can also add energy, as wind does.
    smooth : bool
        Whether it is a smooth function of the positions, including inadmissible ones: implicit steps then
        evaluate it at predicted positions.
    lagged : method (time in s) -> Dissipation
        The dissipation with the normal forces of an earlier time.
    """

    stencil: NDArray[np.int64]
    active: bool = False
    smooth: bool = False
    lagged: Any = None

    @abstractmethod
    def frozen(self, x: NDArray, dt: float) -> Potential:
        """R as a potential of the velocity, with positions fixed at `x`."""


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
        """Sparse (e, 3n) derivatives of the equations by the positions."""


BLOCK_ROWS = 4096  # elements whose working arrays fit into the processor's cache
Arrays = dict[str, NDArray[np.float64]]


class Memory(ABC):
    """Dependence of a term on the past, through arrays that change between steps.

    Attributes
    ----------
    potential : Term
        The term that depends on the arrays; `at` returns its replacement.
    effect : str
        Name of the effect in the accounting of time.
    """

    potential: Any
    effect: str

    @property
    def is_zero(self) -> bool:
        """Whether the term is a load of strength zero."""
        return self.potential.is_zero

    @abstractmethod
    def initial(self) -> Arrays:
        """The arrays at the start of a run. `work` (1,), if present, is the energy dissipated so far in J."""

    @abstractmethod
    def at(self, memory: Arrays) -> Any:
        """The term for these arrays."""

    @abstractmethod
    def commit(self, x: NDArray, memory: Arrays) -> Arrays:
        """The arrays after a step that ends at x; the same object if they do not change."""


class PlasticMemory(Memory):
    """A memory of plastic strains, which an equilibrium determines together with the positions."""

    @abstractmethod
    def distance(self, one: Arrays, other: Arrays) -> float:
        """Largest difference of the plastic strains of two memories, over the yield limit."""

    @abstractmethod
    def quasi_static(self, x: NDArray, before: Arrays, after: Arrays) -> Arrays:
        """`after` with the work of a quasi-static path from `before` to the positions x."""

    @abstractmethod
    def carried(self, before: Any, memory: Arrays, rows: NDArray) -> Arrays:
        """The arrays after a change of the mesh, from those of the memory `before` it.

        `rows` (n,) are the indices of the vertices before the change.
        """


@dataclass(frozen=True, eq=False)
class FixedCoordinates(Term):
    """Coordinates that do not move.

    Parameters
    ----------
    mask : (n, 3) ndarray of bool
    name : str
        Name of the reaction force; "" if none is reported.
    supports : bool
        Whether they hold the object; those of vertices that no face uses do not.
    """

    mask: NDArray[np.bool_]
    name: str = ""
    supports: bool = True


@dataclass(frozen=True, eq=False)
class PrescribedMotion(Term):
    """Vertices with a prescribed motion.

    Parameters
    ----------
    mask : (n, 3) ndarray of bool
        True in the rows of the vertices.
    motion : callable time -> (x, v, a)
        (k, 3) positions, velocities and accelerations of the vertices, in ascending order.
    name : str
        Name of the reaction force.
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
        Times in s, ascending, and factors; before the first and after the last time the factor is constant.
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
    """A potential times time / duration, for any time: the load of an equilibrium path."""

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
        Force on each vertex, in N.
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
    """Cache a method's value for the last array of positions, which is recognised by its identity.

    Energy, gradient and Hessian of a Newton iteration are evaluated at one point and share results. Arrays of
    positions are never modified in place.

    Parameters
    ----------
    method : callable
        Method whose only argument is an array of positions.

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
