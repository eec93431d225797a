"""Equilibria of what yields: positions and rest state together, by a fixed point.

The rest state follows from the positions, by one return from that of the step before; the positions are the
equilibrium of that rest state. Their iteration converges like (1 + h)^-k where the hardening is h, and D. G.
Anderson's acceleration ("Iterative procedures for nonlinear integral equations", 1965) takes its few slow
directions out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.increment import worst
from ddgcli.mechanics.system import Motion, System
from ddgcli.mechanics.terms import Arrays, PlasticMemory
from ddgcli.simulation.model import StepRejected

MAX_RETURNS, MAX_HALVINGS = 60, 2  # a load that the limits do not bear fails in nearly all halves of its step
RETURN_TOLERANCE = 1e-6  # of the limit: what a further return would add to the plastic strain
MAX_DIFFERENCES = 8  # that the acceleration combines
# what the acceleration may add, of the object's size: without hardening no end is near
MAX_EXTRAPOLATION = 0.5


def yielding_equilibrium(
    system: System, start: Motion, equilibrium: Callable[[System, Motion], Motion]
) -> tuple[Motion, tuple[Arrays, ...]]:
    """Equilibrium whose stresses are within the limits, and its rest state.

    Parameters
    ----------
    system : System
        With the terms of the scene, at no memory.
    start : Motion
    equilibrium : callable
        The equilibrium of a system that is reached from a motion.

    Returns
    -------
    Motion
        At rest.
    tuple of dict of str to ndarray
        The memory of its end.

    Raises
    ------
    StepRejected
        No convergence: loads that the limits do not bear.
    """
    memory = start.memory
    after = equilibrium(system.with_memory_at(memory), start)
    returned = system.committed(after.x, memory)
    if all(new is old for new, old in zip(returned, memory)):
        return after, returned
    x, acceleration = after.x, _Acceleration()
    for _ in range(MAX_RETURNS):
        # a path has its own start, from which the length of the step counts
        guess = replace(start, x=start.x if start.past else x, newton=after.newton)
        after = equilibrium(system.with_memory_at(_plastic(system, returned, memory)), guess)
        following = system.committed(after.x, memory)
        left = _distance(system, returned, following)
        if left <= RETURN_TOLERANCE:
            return after, _quasi_static(system, after.x, memory, returned, following)
        x = acceleration.following(x, after.x)
        if not float(np.abs(x - after.x).max()) <= MAX_EXTRAPOLATION * system.size:
            break
        returned = system.committed(x, memory)
    raise StepRejected("yields without end", worst(after.x - x), left, halvings=MAX_HALVINGS)


def _plastic(system: System, returned: tuple[Arrays, ...], memory: tuple[Arrays, ...]) -> tuple[Arrays, ...]:
    """What has yielded; any other memory changes at the end of a step only."""
    kinds = [isinstance(term, PlasticMemory) for term in system.memories]
    return tuple(new if plastic else old for plastic, new, old in zip(kinds, returned, memory))


def _distance(system: System, one: tuple[Arrays, ...], other: tuple[Arrays, ...]) -> float:
    """Largest difference of plastic strains over the limit."""
    rows = zip(system.memories, one, other)
    return max(term.distance(a, b) for term, a, b in rows if isinstance(term, PlasticMemory))


def _quasi_static(
    system: System,
    x: NDArray,
    memory: tuple[Arrays, ...],
    returned: tuple[Arrays, ...],
    following: tuple[Arrays, ...],
) -> tuple[Arrays, ...]:
    """The memory at an equilibrium: rest states `returned`, and what else a step commits."""
    rows = zip(system.memories, memory, returned, following)
    return tuple(
        term.quasi_static(x, old, new) if isinstance(term, PlasticMemory) else end
        for term, old, new, end in rows
    )


class _Acceleration:
    """Anderson's: the next argument from the last arguments and values of a fixed-point map."""

    def __init__(self) -> None:
        self.arguments: list[NDArray] = []
        self.values: list[NDArray] = []

    def following(self, x: NDArray, value: NDArray) -> NDArray[np.float64]:
        """The combination of values whose residuals cancel best."""
        arguments, values = self.arguments, self.values
        arguments.append(x.ravel())
        values.append(value.ravel())
        del arguments[: -MAX_DIFFERENCES - 1], values[: -MAX_DIFFERENCES - 1]
        if len(values) == 1:
            return value
        images = np.array(values)
        residuals = images - np.array(arguments)
        weights = np.linalg.lstsq(np.diff(residuals, axis=0).T, residuals[-1], rcond=1e-10)[0]
        return (images[-1] - weights @ np.diff(images, axis=0)).reshape(x.shape)
