"""Effect `damping`: Rayleigh damping, by mass and by stiffness."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.terms import Dissipation, LinearOperator, Mode, Potential
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.models.shell.context import ShellContext
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect


class Damping(Section):
    """Force -(mass M + stiffness K) v; a mode of frequency w has the ratio mass/(2 w) + stiffness w/2."""

    mass: quantity("1/s", "by mass: also slows rigid motion", ge=0) = 0.0
    stiffness: quantity("s", "by stiffness: leaves rigid motion alone", ge=0) = 0.0


class MassDamping(Dissipation):
    """R = alpha/2 v' M v."""

    name = "damping"

    def __init__(self, weight: NDArray) -> None:
        self.weight = weight
        self.stencil = np.arange(len(weight))[:, None]

    def frozen(self, x: NDArray, dt: float) -> Potential:
        return Viscous(self.name, self.stencil, self.weight[:, None, None] * np.eye(3))


@dataclass(frozen=True, eq=False)
class Viscous(Potential):
    """R = 1/2 v' C v with the element blocks of C."""

    name: str
    stencil: NDArray
    local: NDArray

    def _force(self, v: NDArray) -> NDArray:
        return np.einsum("kij,kj->ki", self.local, v[self.stencil].reshape(len(self.stencil), -1))

    def energy(self, x: NDArray) -> float:
        return 0.5 * float(np.vdot(x[self.stencil].reshape(len(self.stencil), -1), self._force(x)))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        return sum_by_index(self.stencil, self._force(x).reshape(*self.stencil.shape, 3), len(x))

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return self.local


class ElasticViscous(Potential):
    """R = beta/2 v' K v, K the material Hessian of a potential at `x`, given by its products with v.

    Explicit steps need only the force; the blocks, which take twenty times as long, are computed on demand
    for implicit steps.

    Parameters
    ----------
    x : (n, 3) ndarray
        Positions in m.
    beta : float
        In s.
    multiply : callable
        Product of K (N/m) with velocities (n, 3) in m/s.
    """

    def __init__(
        self, name: str, potential: Potential, x: NDArray, beta: float, multiply: LinearOperator
    ) -> None:
        self.name, self.stencil, self.potential = name, potential.stencil, potential
        self.x, self.beta, self.multiply = x, beta, multiply

    def energy(self, x: NDArray) -> float:
        return 0.5 * float(np.vdot(x, self.gradient(x)))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        return self.beta * self.multiply(x)

    @cached_property
    def _blocks(self) -> NDArray[np.float64]:
        return self.beta * self.potential.blocks(self.x, "material")

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return self._blocks


class StiffnessDamping(Dissipation):
    """R = beta/2 v' K v, K the material part of a potential's Hessian: rigid motion is not damped."""

    name = "damping"
    smooth = True

    def __init__(self, potential: Potential, beta: float) -> None:
        self.potential, self.beta, self.stencil = potential, beta, potential.stencil

    def frozen(self, x: NDArray, dt: float) -> Potential:
        multiply = self.potential.material_operator(x)
        return ElasticViscous(self.name, self.potential, np.array(x), self.beta, multiply)


def build(parameters: Damping, context: ShellContext) -> list[MassDamping | StiffnessDamping]:
    if parameters.mass == 0 and parameters.stiffness == 0:
        raise ValueError("give mass (1/s) or stiffness (s) greater than 0, or leave the line out")
    if parameters.stiffness and not context.scene.has_effect("stretching", "bending"):
        raise ValueError("stiffness has no effect without stretching or bending; take it out, or give mass")
    terms: list[MassDamping | StiffnessDamping] = []
    if parameters.mass:
        terms.append(MassDamping(parameters.mass * context.mass))
    if parameters.stiffness:
        terms += [StiffnessDamping(p, parameters.stiffness) for p in context.elastic]
    return terms


EFFECT = Effect("damping", Damping, build, "for stiffness: a product with the material Hessian", ("shell",))
