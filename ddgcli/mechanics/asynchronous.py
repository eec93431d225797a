"""Asynchronous variational integrator: each element of a potential has a step of its own.

A. Lew, J. E. Marsden, M. Ortiz, M. West, "Asynchronous variational integrators", 2003: the discrete action
sums the energies of the elements, each at its own times. Its stationarity gives every vertex the impulses
-h_K dV_K/dx at the times of its elements, between which it moves uniformly. Here the steps of the elements
are dt / 2^k, so that all elements with the same k act at the same times, and each acts with half an impulse
at both ends of dt: the scheme is symmetric, of order 2, and velocity Verlet if all elements have the same k.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.mechanics.stability import stable_step
from ddgcli.mechanics.system import Motion, System
from ddgcli.mechanics.terms import Potential

SAFETY = 0.8  # factor on the stability limit of an element, because its neighbours have other steps
MAX_LEVEL = 14  # the shortest steps are dt / 2^14


@dataclass(frozen=True, eq=False)
class Batch:
    """Elements of one potential that act at the same times.

    Parameters
    ----------
    potential : Potential, or a term whose `at` returns one
        Potential of these elements, as a function of the positions of `rows`.
    rows : (k,) ndarray of int, or None for all
        Vertices of these elements.
    name : str
        Name of the effect.
    """

    potential: Any
    rows: NDArray[np.int64] | None
    name: str

    def add(self, x: NDArray, time: float, total: NDArray) -> None:
        """Add the gradient at x to `total` (n, 3)."""
        if self.rows is None:
            total += (self.potential if self.potential.at is None else self.potential.at(time)).gradient(x)
        else:
            total[self.rows] += self.potential.gradient(x[self.rows])


@dataclass(frozen=True, eq=False)
class Levels:
    """Batches by step: those of `batches[k]` act every dt / 2^k; `terms` are the terms of the system."""

    terms: tuple[Any, ...]
    batches: list[list[Batch]]


def step(system: System, motion: Motion, dt: float) -> tuple[NDArray, NDArray]:
    """Positions and velocities after a step of asynchronous velocity Verlet.

    Parameters
    ----------
    system : System
    motion : Motion
    dt : float
        In s.

    Returns
    -------
    x, v : (n, 3) ndarray of float64
        In m and m/s.

    References
    ----------
    A. Lew, J. E. Marsden, M. Ortiz, M. West, "Asynchronous variational integrators", 2003.
    """
    levels = levels_of(system, dt)
    finest = len(levels.batches) - 1
    count, small = 2**finest, dt / 2**finest
    weight = system.free / system.mass[:, None]
    x, v = motion.x, motion.v
    for k in range(count + 1):
        here = system.at(motion.time + k * small)
        impulse = np.zeros_like(v)  # of half a step of each element that acts now
        for level, batches in enumerate(levels.batches):
            every = 2 ** (finest - level)
            if k % every == 0 and batches:
                impulse += (0.5 * every * small) * weight * _gradient(here, batches, x, k, count)
        if k > 0:
            v = v - impulse
        if system.dissipations:  # between the two half impulses, so that the scheme is symmetric
            v = _dragged(here, x, v, small * (0.5 if k in (0, count) else 1.0), weight)
        if k < count:
            v = v - impulse
            x = system.at(motion.time + (k + 1) * small).prescribed_state(x + small * v, v, v)[0]
    return x, v


def _gradient(system: System, batches: list[Batch], x: NDArray, k: int, count: int) -> NDArray[np.float64]:
    """(n, 3) gradient of some elements; the one at the end of a step is cached for the start of the next.

    At the start of a run or of a resumed run it is computed but not counted, so that both report the same
    number of calls.
    """
    cached = system.cache.get("asynchronous gradients", (None, {}))
    if cached[0] is x and id(batches) in cached[1]:
        return cached[1][id(batches)]
    total = np.zeros_like(x)
    for batch in batches:
        with system.account.within(batch.name, 1 if k else 0):
            batch.add(x, system.time, total)
    if k == count:
        if cached[0] is not x:
            cached = system.cache["asynchronous gradients"] = (x, {})
        cached[1][id(batches)] = total
    return total


def _dragged(system: System, x: NDArray, v: NDArray, h: float, weight: NDArray) -> NDArray[np.float64]:
    """Velocities after drag during a time h, by Heun's method."""
    first = weight * system.drag(x, v, h)
    return v - 0.5 * h * (first + weight * system.drag(x, v - h * first, h))


def evaluations(system: System, dt: float) -> tuple[float, int]:
    """Cost of a step: mean number of evaluations of an element, and number of shortest steps.

    Parameters
    ----------
    system : System
    dt : float
        In s.

    Returns
    -------
    mean : float
        Mean over the elements of all potentials.
    shortest : int
        2 to the power of the finest level.
    """
    batches = levels_of(system, dt).batches
    potentials = [[b.potential for b in level if isinstance(b.potential, Potential)] for level in batches]
    counts = [sum(len(p.stencil) for p in level) for level in potentials]
    shortest = 2 ** (len(batches) - 1)
    if not sum(counts):
        return float(shortest), shortest
    return sum(count * 2.0**k for k, count in enumerate(counts)) / sum(counts), shortest


def levels_of(system: System, dt: float) -> Levels:
    """Batches of a system's potentials for steps of length dt, from the stiffness at its initial positions.

    Raises
    ------
    SolveError
        If an element needs steps more than 2^14 times shorter.
    """
    stored = system.cache.setdefault("asynchronous", {})
    levels = stored.get(dt)
    if levels is None or not _same(levels.terms, system.terms):
        calls = dict(system.account.calls)
        levels = stored[dt] = _assign_levels(system, dt)
        system.account.calls = calls  # a resumed run computes the levels again, but reports the same calls
    return levels


def _same(a: tuple[Any, ...], b: tuple[Any, ...]) -> bool:
    return len(a) == len(b) and all(p is q for p, q in zip(a, b))


def _assign_levels(system: System, dt: float) -> Levels:
    """Assign each element a level from the stability limit of the system and bounds of the rates of vertices.

    The rate of a vertex is bounded by the row sums of the Hessian over its mass (Gershgorin). An element has
    the largest rate of its vertices, and the element with the largest rate of all has the system's limit.
    """

    x = np.asarray(system.start)
    limit = stable_step(system, x, 2.0)
    rate = sum((b.expected_stiffness(x) for b in system.barriers), np.zeros(len(x))) / system.mass
    for p in system.potentials:
        if p.subset is not None:
            rows = np.abs(p.blocks(x, "material")).sum(axis=2)
            rows = rows.reshape(*p.stencil.shape, 3).max(axis=2)
            rate += np.bincount(p.stencil.ravel(), rows.ravel(), len(x)) / system.mass
    rate = np.where(system.free.any(axis=1), rate, 0.0)
    largest = float(rate.max(initial=0.0))
    finest = _level(np.array([limit]), dt)[0] if np.isfinite(limit) else 0
    batches: list[list[Batch]] = [[] for _ in range(finest + 1)]
    for term in system.terms:
        potential: Any = term if term.at is None else term.at(system.time)
        if not isinstance(potential, Potential):
            continue
        if potential is not term or potential.subset is None or not largest > 0:
            # dead loads are constant, so any step will do; for other terms only the system's limit is known
            batches[0 if potential.is_dead else finest].append(Batch(term, None, potential.name))
            continue
        own = rate[potential.stencil].max(axis=1)
        steps = limit * np.sqrt(largest / np.maximum(own, 1e-300 * largest))
        level = np.minimum(_level(steps, dt), finest)
        for k in np.unique(level):
            members = np.flatnonzero(level == k)
            vertices, stencil = np.unique(potential.stencil[members], return_inverse=True)
            own_term = potential.subset(members, stencil.reshape(-1, potential.stencil.shape[1]))
            batches[k].append(Batch(own_term, vertices, potential.name))
    return Levels(system.terms, batches)


def _level(limits: NDArray, dt: float) -> NDArray[np.int64]:
    """Least k with dt / 2^k within a limit."""
    level = np.ceil(np.log2(np.maximum(dt / (SAFETY * limits), 1.0))).astype(np.int64)
    if level.max(initial=0) > MAX_LEVEL:
        raise SolveError(
            f"an element needs steps of {limits.min():.3g} s, over {2**MAX_LEVEL} times shorter than dt; "
            "shorten dt, or take an implicit scheme"
        )
    return level
