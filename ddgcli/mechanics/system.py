"""A mechanical system: masses and the terms that the scene asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.rounding import Rounding
from ddgcli.mechanics.terms import Bounded, Dissipation, Held, Potential
from ddgcli.simulation.account import Account

if TYPE_CHECKING:
    from ddgcli.mechanics.newton import Newton


@dataclass(frozen=True, eq=False)
class Motion:
    """State of a mechanical system.

    Parameters
    ----------
    x, v, a : (n, 3) ndarray
        Positions, velocities, accelerations (of schemes that keep them).
    newton : int
        Newton iterations since the start.
    lifted : float
        Joules by which the balance of energy stands above its lowest, where the scheme watches it.
    """

    x: NDArray[np.float64]
    v: NDArray[np.float64]
    a: NDArray[np.float64]
    newton: int = 0
    lifted: float = 0.0


class System:
    """Masses and terms; what the scene did not name is not here.

    Parameters
    ----------
    mass : (n,) ndarray
    parts : sequence of Potential, Dissipation and Held
    account : Account
    start : (n, 3) ndarray
        Positions at the start of the run, also of a resumed one: the scale of tolerances and of rounding.

    Attributes
    ----------
    size : float
        Of the object, in metres.
    linear : bool
        Every potential is quadratic with a constant matrix, coordinate by coordinate.
    """

    def __init__(self, mass: NDArray, parts: Sequence[Any], account: Account, start: NDArray) -> None:
        self.mass, self.account = mass, account
        self.potentials: list[Potential] = [p for p in parts if isinstance(p, Potential)]
        self.dissipations: list[Dissipation] = [p for p in parts if isinstance(p, Dissipation)]
        self.bounded: list[Bounded] = [p for p in parts if isinstance(p, Bounded)]
        held = np.zeros((len(mass), 3), dtype=bool)
        for part in parts:
            if isinstance(part, Held):
                held |= part.mask
        self.free = ~held
        self.all_free = not held.any()
        self.start, self.size = start, float(np.ptp(start, axis=0).max())
        by_vertex = bool((held.all(axis=1) == held.any(axis=1)).all())
        self.linear = by_vertex and all(len(p.stencil) == 0 or hasattr(p, "matrix") for p in self.potentials)
        self._newton: Newton | None = None

    def only_free(self, vectors: NDArray) -> NDArray[np.float64]:
        """(n, 3) vectors with zeros where held."""
        return vectors if self.all_free else np.where(self.free, vectors, 0.0)

    @property
    def newton(self) -> Newton:
        """The Newton iteration of implicit steps; explicit runs never import it."""
        if self._newton is None:
            from ddgcli.mechanics.newton import Newton

            self._newton = Newton(self)
        return self._newton

    @cached_property
    def rounding(self) -> Rounding:
        """What rounding of the positions at the start does to energies and momenta."""
        return Rounding.at(self, self.start)

    def energies(self, x: NDArray) -> dict[str, float]:
        """Energy of each potential by its effect's name."""
        found: dict[str, float] = {}
        for potential in self.potentials:
            with self.account.within(potential.name):
                found[potential.name] = found.get(potential.name, 0.0) + potential.energy(x)
        return found

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        """(n, 3) gradient of the potential energy, zero where held."""
        total = np.zeros_like(x)
        for potential in self.potentials:
            with self.account.within(potential.name):
                total += potential.gradient(x)
        return self.only_free(total)

    def drag(self, x: NDArray, v: NDArray, dt: float) -> NDArray[np.float64]:
        """(n, 3) gradient of the dissipation in the velocities at (x, v)."""
        total = np.zeros_like(x)
        for dissipation in self.dissipations:
            with self.account.within(dissipation.name):
                total += dissipation.frozen(x, dt).gradient(v)
        return self.only_free(total)

    def external_work(self, path: Sequence[NDArray], dt: float) -> float:
        """Joules that dead loads give less what dissipation takes along positions that are dt apart."""
        work = 0.0
        for potential in self.potentials:
            if not len(potential.stencil):
                with self.account.within(potential.name):
                    work += potential.energy(path[0]) - potential.energy(path[-1])
        if self.dissipations:
            for before, after in pairwise(path):
                move = after - before
                work -= float(np.vdot(self.drag(before, move / dt, dt), move))
        return work

    def frozen(self, x: NDArray, dt: float) -> tuple[Potential, ...]:
        """Dissipation as potentials of the velocity, taken at `x`."""
        found = []
        for dissipation in self.dissipations:
            with self.account.within(dissipation.name):
                found.append(dissipation.frozen(x, dt))
        return tuple(found)

    def acceleration(self, x: NDArray, v: NDArray, dt: float) -> NDArray[np.float64]:
        """(n, 3) acceleration, zero where held."""
        force = -self.gradient(x)
        if self.dissipations:
            force -= self.drag(x, v, dt)
        return force / self.mass[:, None]
