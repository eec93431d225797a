"""Equilibria of plastic shells: fixed-point iteration for positions and rest state.

The rest state follows from the positions by one return mapping from that of the last step, and the positions
are the equilibrium of this rest state. The iteration converges like (1 + h)^-k with hardening h; D. G.
Anderson's acceleration ("Iterative procedures for nonlinear integral equations", 1965) removes the few slow
directions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.increment import worst_vertex
from ddgcli.mechanics.system import Motion, System
from ddgcli.mechanics.terms import Arrays, PlasticMemory
from ddgcli.simulation.model import StepRejected

MAX_RETURNS = 60  # return mappings in a step
MAX_HALVINGS = 2  # of a load step that does not converge: a load above the limits fails in all shorter steps
RETURN_TOLERANCE = 1e-6  # change of the plastic strain by a further return mapping, over the yield limit
MAX_DIFFERENCES = 8  # differences that the acceleration combines
MAX_EXTRAPOLATION = 0.5  # move by the acceleration over the object's size, above which nothing converges


def yielding_equilibrium(
    system: System, start: Motion, equilibrium: Callable[[System, Motion], Motion]
) -> tuple[Motion, tuple[Arrays, ...]]:
    """Equilibrium with stresses within the yield limits, and its rest state.

    Parameters
    ----------
    system : System
        The system with the terms of the scene, before a memory is applied.
    start : Motion
    equilibrium : callable
        Computes the equilibrium of a system from a motion.

    Returns
    -------
    Motion
        At rest.
    tuple of dict of str to ndarray
        The memory after the step.

    Raises
    ------
    StepRejected
        If it does not converge: the loads exceed the yield limits.
    """
    memory = start.memory
    after = equilibrium(system.with_memory_at(memory), start)
    returned = system.committed(after.x, memory)
    if all(new is old for new, old in zip(returned, memory)):
        return after, returned
    x, acceleration = after.x, _Acceleration()
    for _ in range(MAX_RETURNS):
        # the arc length of a step on a path is measured from its start
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
    raise StepRejected("yields without end", worst_vertex(after.x - x), left, halvings=MAX_HALVINGS)


def _plastic(system: System, returned: tuple[Arrays, ...], memory: tuple[Arrays, ...]) -> tuple[Arrays, ...]:
    """The new plastic memories; other memories do not change before the end of a step."""
    kinds = [isinstance(term, PlasticMemory) for term in system.memories]
    return tuple(new if plastic else old for plastic, new, old in zip(kinds, returned, memory))


def _distance(system: System, one: tuple[Arrays, ...], other: tuple[Arrays, ...]) -> float:
    """Largest difference of plastic strains, over the yield limit."""
    rows = zip(system.memories, one, other)
    return max(term.distance(a, b) for term, a, b in rows if isinstance(term, PlasticMemory))


def _quasi_static(
    system: System,
    x: NDArray,
    memory: tuple[Arrays, ...],
    returned: tuple[Arrays, ...],
    following: tuple[Arrays, ...],
) -> tuple[Arrays, ...]:
    """The memory at an equilibrium: rest states `returned`, and the other memories after the step."""
    rows = zip(system.memories, memory, returned, following)
    return tuple(
        term.quasi_static(x, old, new) if isinstance(term, PlasticMemory) else end
        for term, old, new, end in rows
    )


class _Acceleration:
    """Anderson acceleration of a fixed-point map."""

    def __init__(self) -> None:
        self.arguments: list[NDArray] = []
        self.values: list[NDArray] = []

    def following(self, x: NDArray, value: NDArray) -> NDArray[np.float64]:
        """Next argument: the combination of the last values with the least residual."""
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
