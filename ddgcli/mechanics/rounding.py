"""Rounding of energies and momenta due to rounded positions: smaller differences are not significant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.pieces import pieces_of
from ddgcli.mechanics.terms import Potential

# relative rounding of a sum of n terms, each of about fifty operations, divided by the square root of n
SUM_ROUNDING = 1e-14
# rounding of step doubling in spacings of floats: a step and its two halves round positions three times
STEP_DOUBLING_SPACINGS = 2.0


@dataclass(frozen=True)
class Rounding:
    """Effect of rounded positions on the energy and the momentum of a system.

    Positions are rounded by at most `length` = eps max |x|. A change d with |d| <= `length` in every
    coordinate changes an elastic energy by f . d + d' K d / 2: the first-order term is at most `force` times
    `length`, and the second-order term `length`^2 tr(K) / 2 on average over the signs of d. In a step of
    length dt, it changes velocities by `length` / dt, and adds the impulse dt K d. While dt^2 K < 4 M, as
    explicit steps require and as the fastest waves of implicit steps fulfil, its energy is below 2 d' K d.

    Parameters
    ----------
    length : float
        In m.
    mass, stiffness : float
        Traces of the mass matrix (three coordinates per vertex) in kg, and of the elastic Hessian in N/m.
    force : float
        Sum of the absolute forces of all potentials over all coordinates, in N.
    """

    length: float
    mass: float
    stiffness: float
    force: float

    @classmethod
    def at(cls, potentials: Sequence[Potential], mass: NDArray, x: NDArray) -> Rounding:
        """Rounding for potentials and masses (n,) at the positions x (n, 3)."""
        force = stiffness = 0.0
        for potential in potentials:
            force += float(np.abs(potential.gradient(x)).sum())
            if len(potential.stencil):
                stiffness += sum(_trace(piece, own_x) for piece, own_x in pieces_of(potential, x))
        return cls(float(np.finfo(float).eps * np.abs(x).max()), 3 * float(mass.sum()), stiffness, force)

    def energy(self, dt: float = np.inf, steps: int = 0) -> float:
        """Bound in J of the energy due to rounding in a run of steps of length dt; by default in one state.

        Rounding errors may be the same in every step: then momenta add up, and energies grow with the square.
        """
        # a product of floats becomes infinite where a power raises OverflowError
        second = 2 * self.length * self.length * (self.stiffness + self.mass / dt / dt)
        return (1 + steps) * self.force * self.length + (1 + steps) ** 2 * second

    def momentum(self, dt: float = np.inf, steps: int = 0) -> float:
        """Bound in kg m/s of the momentum due to rounding in a run of steps of length dt."""
        return (1 + steps) * self.length * (self.mass / dt + 2 * np.sqrt(self.mass * self.stiffness))


def _trace(potential: Potential, x: NDArray) -> float:
    """Sum of the traces of the blocks of a potential's elements."""
    if potential.pair_blocks is not None:  # the block of a vertex is minus the sum of those with the others
        return -2.0 * float(np.einsum("iipk->", potential.pair_blocks(x, "material")))
    return float(np.einsum("kii->", potential.blocks(x, "material")))


def sum_rounding(scale: float, count: int) -> float:
    """Rounding error of a sum over elements.

    Parameters
    ----------
    scale : float
        Sum of the absolute terms.
    count : int
        Number of terms.

    Returns
    -------
    float
        In the unit of `scale`.
    """
    return SUM_ROUNDING * scale * float(np.sqrt(count))


def least_tolerance(x: NDArray, size: float) -> float:
    """Smallest tolerance that adaptive steps can meet, whatever their length.

    Parameters
    ----------
    x : (n, 3) ndarray of float64
        Positions in m.
    size : float
        Size of the object, in m.

    Returns
    -------
    float
        Rounding of the difference between a step and its two halves, over the size.
    """
    return STEP_DOUBLING_SPACINGS * float(np.finfo(float).eps * np.abs(x).max()) / size
