"""A mechanical system (masses and terms), and its state of motion."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.pieces import in_pieces
from ddgcli.mechanics.rounding import Rounding
from ddgcli.mechanics.terms import (
    Arrays,
    BarrierPotential,
    Constraint,
    Dissipation,
    FixedCoordinates,
    Memory,
    Potential,
    PrescribedMotion,
    Term,
)
from ddgcli.simulation.account import Account

NO_MULTIPLIERS = np.zeros(0)
LINEAR_SOLVER = "linear solver"  # key in `System.cache` of the conjugate gradients for implicit steps


@dataclass(frozen=True, eq=False)
class Motion:
    """State of a mechanical system.

    Parameters
    ----------
    x, v, a : (n, 3) ndarray
        Positions, velocities, accelerations (of schemes that keep them).
    newton : int
        Number of Newton iterations since the start.
    balance_excess : float
        Energy balance above its minimum, in J, if the scheme checks it.
    time : float
        In s.
    work : float
        Work of handles, time-dependent loads and wind since the start, in J.
    memory : tuple of dict of str to ndarray
        Arrays of each term with a memory.
    past : tuple of ndarray
        For multistep schemes: positions and velocities a step before, and the length of that step (0: none).
    multipliers : (e,) ndarray
        Lagrange multipliers of constraints: tensions of rigid edges in N.
    """

    x: NDArray[np.float64]
    v: NDArray[np.float64]
    a: NDArray[np.float64]
    newton: int = 0
    balance_excess: float = 0.0
    time: float = 0.0
    work: float = 0.0
    memory: tuple[Arrays, ...] = ()
    past: tuple[NDArray[np.float64], ...] = ()
    multipliers: NDArray[np.float64] = field(default_factory=lambda: NO_MULTIPLIERS)


class System:
    """Masses and terms of a mechanical system.

    Parameters
    ----------
    mass : (n,) ndarray
    terms : sequence of Term and Memory
    account : Account
    start : (n, 3) ndarray
        Positions at the start of the run, even if it was resumed: the scale of tolerances and of rounding.
    size : float, optional
        Size of the object in m; by default the longest side of its bounding box.

    Attributes
    ----------
    size : float
        Size of the object in m.
    linear : bool
        Whether every potential is quadratic, with one constant matrix for each coordinate.
    cache : dict
        Data that solvers reuse between steps, by name.
    constraints : list of RigidEdges
        At most one.
    free, support_mask : (n, 3) ndarray of bool
        Coordinates that are not fixed; those fixed by supports.
    pushed : bool
        Whether obstacles move, so that the stored energy depends on time.
    """

    def __init__(
        self,
        mass: NDArray,
        terms: Sequence[Term | Memory],
        account: Account,
        start: NDArray,
        size: float | None = None,
    ) -> None:
        self.mass, self.account, self.time = mass, account, 0.0
        self.memories = [p for p in terms if isinstance(p, Memory)]
        self.terms: tuple[Term, ...] = tuple(p for p in terms if not isinstance(p, Memory))
        for term in self.terms:
            _require_kind(term)
        self._sort_terms(self.terms)
        self.prescribed = [p for p in terms if isinstance(p, PrescribedMotion)]
        self.supports = [p for p in terms if isinstance(p, FixedCoordinates | PrescribedMotion) and p.name]
        self.constraints: list[Any] = [p for p in self.terms if isinstance(p, Constraint)]
        fixed, support_mask = np.zeros((len(mass), 3), dtype=bool), np.zeros((len(mass), 3), dtype=bool)
        for p in self.terms:
            if isinstance(p, FixedCoordinates | PrescribedMotion):
                fixed |= p.mask
                if isinstance(p, PrescribedMotion) or p.supports:
                    support_mask |= p.mask
        self.free, self.support_mask = ~fixed, support_mask
        self.all_free = not fixed.any()
        self._fixed = np.flatnonzero(fixed)
        self.start, self.size = start, size or float(np.ptp(start, axis=0).max())
        by_vertex = bool((fixed.all(axis=1) == fixed.any(axis=1)).all())
        self.linear = by_vertex and all(p.is_dead or p.matrix is not None for p in self.potentials)
        self.cache: dict[str, Any] = {}
        timed = any(term.at is not None for term in self.terms)
        self.driven = timed or bool(self.prescribed) or any(d.active for d in self.dissipations)
        self.varies = timed or bool(self.prescribed)
        self.pushed = any(term.travel_work is not None for term in self.terms)

    def _sort_terms(self, terms: Sequence[Term], obstacle_time: float | None = None) -> None:
        """Sort the terms by kind: terms at `self.time`, obstacles at `obstacle_time` if it is given."""
        of_obstacles = self.time if obstacle_time is None else obstacle_time
        now = [
            p if p.at is None else p.at(self.time if p.travel_work is None else of_obstacles) for p in terms
        ]
        self.potentials: list[Potential] = [in_pieces(p) for p in now if isinstance(p, Potential)]
        self.dissipations: list[Dissipation] = [p for p in now if isinstance(p, Dissipation)]
        self.barriers: list[BarrierPotential] = [p for p in now if isinstance(p, BarrierPotential)]

    def at(self, time: float) -> System:
        """The system at a time in s; itself if nothing depends on time.

        The systems at all times share one cache.
        """
        if not self.varies or time == self.time:
            return self
        system = copy.copy(self)
        system.time = time
        system._sort_terms(self.terms)
        return system

    def with_obstacles_at(self, time: float) -> System:
        """The system with its moving obstacles at their positions at a time in s, otherwise unchanged."""
        system = copy.copy(self)
        system._sort_terms(self.terms, time)
        return system

    def with_own_account(self) -> System:
        """The system with an account of its own, for computations that do not belong to the run."""
        system = copy.copy(self)
        system.account = Account()
        return system

    def begin_step(self) -> None:
        """Discard what terms have cached in earlier steps, so that a step depends only on its arguments."""
        for barrier in self.barriers:
            if barrier.begin_step is not None:
                barrier.begin_step()

    def with_memory_at(self, memory: tuple[Arrays, ...]) -> System:
        """The system whose terms with a memory have these arrays; itself without such terms.

        The last such system is cached, and returned again for the same array objects.
        """
        if not self.memories:
            return self
        last = self.cache.get("memory")
        if last is None or len(last[0]) != len(memory) or any(a is not b for a, b in zip(last[0], memory)):
            system = copy.copy(self)
            new = {id(m.potential): m.at(arrays) for m, arrays in zip(self.memories, memory)}
            system.terms = tuple(new.get(id(term), term) for term in self.terms)
            system._sort_terms(system.terms)
            last = self.cache["memory"] = (memory, system)
        return last[1]

    def committed(self, x: NDArray, memory: tuple[Arrays, ...]) -> tuple[Arrays, ...]:
        """The memory after a step that ends at x."""
        after = []
        for term, arrays in zip(self.memories, memory):
            with self.account.within(term.effect):
                after.append(term.commit(x, arrays))
        return tuple(after)

    def prescribed_state(self, x: NDArray, v: NDArray, a: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """(x, v, a) with the state of prescribed vertices at `time`; the same arrays without any."""
        if not self.prescribed:
            return x, v, a
        x, v, a = x.copy(), v.copy(), a.copy()
        for term in self.prescribed:
            rows = term.mask[:, 0]
            x[rows], v[rows], a[rows] = term.motion(self.time)
        return x, v, a

    def only_free(self, vectors: NDArray) -> NDArray[np.float64]:
        """(n, 3) vectors with zeros at fixed coordinates."""
        if self.all_free:
            return vectors
        vectors = np.array(vectors, dtype=np.float64, order="C")
        vectors.ravel()[self._fixed] = 0.0  # by index: a mask would read all coordinates for a few fixed ones
        return vectors

    def fixed_as(self, x: NDArray, y: NDArray) -> NDArray[np.float64]:
        """(n, 3) positions y with the fixed coordinates of x."""
        if self.all_free:
            return y
        y = np.array(y, dtype=np.float64, order="C")
        y.ravel()[self._fixed] = x.ravel()[self._fixed]
        return y

    @cached_property
    def rounding(self) -> Rounding:
        """Rounding of energies and momenta due to that of the positions at the start, without barriers.

        The barriers of moving obstacles are not finite at positions that the obstacles have passed.
        """
        regular = [p for p in self.potentials if not isinstance(p, BarrierPotential)]
        return Rounding.at(regular, self.mass, self.start)

    def energies(self, x: NDArray) -> dict[str, float]:
        """Energy of each potential by its effect's name."""
        by_effect: dict[str, float] = {}
        for potential in self.potentials:
            with self.account.within(potential.name):
                by_effect[potential.name] = by_effect.get(potential.name, 0.0) + potential.energy(x)
        return by_effect

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        """(n, 3) gradient of the potential energy, zero at fixed coordinates."""
        return self.only_free(self.full_gradient(x))

    def low_rank(self, x: NDArray) -> NDArray[np.float64] | None:
        """(n, 3, k) columns U of the low-rank term U U^T of the Hessian; None without one."""
        dense = [p for p in self.potentials if p.low_rank is not None]
        return np.stack([p.low_rank(x) for p in dense], axis=-1) if dense else None

    def full_gradient(self, x: NDArray) -> NDArray[np.float64]:
        """(n, 3) gradient of the potential energy; at fixed coordinates, the reaction force."""
        total = np.zeros_like(x)
        for potential in self.potentials:
            with self.account.within(potential.name):
                total += potential.gradient(x)
        return total

    def drag(self, x: NDArray, v: NDArray, dt: float) -> NDArray[np.float64]:
        """(n, 3) gradient of the dissipation in the velocities at (x, v), zero at fixed coordinates."""
        return self.only_free(self.full_drag(x, v, dt))

    def full_drag(self, x: NDArray, v: NDArray, dt: float) -> NDArray[np.float64]:
        """(n, 3) gradient of the dissipation in the velocities at (x, v), also at fixed coordinates."""
        return self.drag_of(self.frozen(x, dt), v)

    def drag_of(self, frozen: Iterable[Potential], v: NDArray) -> NDArray[np.float64]:
        """(n, 3) gradient of frozen dissipation at velocities v (n, 3), also at fixed coordinates."""
        total = np.zeros_like(v)
        for term in frozen:
            with self.account.within(term.name):
                total += term.gradient(v)
        return total

    def later_work(self, since: float, before: NDArray, after: NDArray) -> float:
        """Work of time-dependent potentials as at the end of the step, less that by the trapezoidal rule.

        The step begins at `since` and ends at `time`. Obstacles do not count.
        """
        work = 0.0
        for p in self.terms:
            if p.at is None or p.travel_work is not None:
                continue
            now, then = p.at(self.time), p.at(since)
            if isinstance(now, Potential) and not now.is_dead and now.exact_energy:
                work += 0.5 * (now.energy(after) - now.energy(before))
                work -= 0.5 * (then.energy(after) - then.energy(before))
        return work

    def external_work(
        self,
        path: Sequence[NDArray],
        dt: float,
        acting: Sequence[Sequence[tuple[tuple[Potential, ...], NDArray]]],
    ) -> float:
        """Joules that dead loads, moments and handles add, less those that dissipation takes.

        `path` holds positions that are dt apart; loads and wind have the forces of `time`. Of each part of it
        `acting` holds the dissipation that acted, with its velocities (n, 3) in m/s, or that of both ends,
        whose mean counts: at the mean velocity of a step, a body that sticks to an accelerated obstacle would
        slide. What is smooth is taken at the middle instead. The kinetic energy of prescribed vertices does
        not count.
        """
        work = 0.0
        for potential in self.potentials:
            if potential.is_dead:
                with self.account.within(potential.name):
                    work += potential.energy(path[0]) - potential.energy(path[-1])
            elif not potential.exact_energy:
                with self.account.within(potential.name):
                    for before, after in pairwise(path):
                        force = potential.gradient(before) + potential.gradient(after)
                        work -= 0.5 * float(np.vdot(force, after - before))
        for k, dissipation in enumerate(self.dissipations):
            with self.account.within(dissipation.name):
                for (before, after), in_part in zip(pairwise(path), acting, strict=True):
                    move = self.only_free(after - before)
                    terms = [(frozen[k], velocity) for frozen, velocity in in_part]
                    if dissipation.smooth:
                        terms = [(dissipation.frozen(0.5 * (before + after), dt), (after - before) / dt)]
                    for term, velocity in terms:
                        work -= float(np.vdot(term.gradient(velocity), move)) / len(terms)
        if self.prescribed:
            for before, after in pairwise(path):
                force = 0.5 * (self.full_gradient(before) + self.full_gradient(after))
                work += float(np.vdot(force, np.where(self.free, 0.0, after - before)))
        return work

    def frozen(
        self, x: NDArray, dt: float, since: float | None = None, ahead: NDArray | None = None
    ) -> tuple[Potential, ...]:
        """Dissipation as potentials of the velocity, taken at `x`, the positions of the time `since`.

        What is smooth in the positions is taken at `ahead`, where the step is expected at the time of its
        velocity: a damper at the start would take the turning of a body since then for a stretch.
        """
        potentials = []
        for dissipation in self.dissipations:
            if since is not None and dissipation.lagged is not None:
                dissipation = dissipation.lagged(since)
            with self.account.within(dissipation.name):
                at = ahead if ahead is not None and dissipation.smooth else x
                potentials.append(dissipation.frozen(at, dt))
        return tuple(potentials)

    def acceleration(self, x: NDArray, v: NDArray, dt: float) -> NDArray[np.float64]:
        """(n, 3) acceleration, zero at fixed coordinates."""
        force = -self.gradient(x)
        if self.has_drag(v):
            force -= self.drag(x, v, dt)
        return force / self.mass[:, None]

    def has_drag(self, v: NDArray) -> bool:
        """Whether dissipation acts at velocities v (n, 3); on a system at rest only wind does."""
        return bool(self.dissipations) and (bool(v.any()) or any(d.active for d in self.dissipations))


def _require_kind(term: Any) -> None:
    """TypeError for a term that the system would ignore."""
    kinds = Potential | Dissipation
    if isinstance(term, kinds | FixedCoordinates | PrescribedMotion | Constraint):
        return
    if not isinstance(term, Term) or term.at is None or not isinstance(term.at(0.0), kinds):
        raise TypeError(f"{type(term).__name__} is neither a potential nor a dissipation of a system")
