"""Effect `wind`: the force of moving or still air on the faces, with drag and lift."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import ast
import logging

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from ddgcli.mechanics.terms import Dissipation, Mode, Potential
from ddgcli.mesh.scatter import columns_at, sum_columns_by_index
from ddgcli.mesh.vectors import cross, dot
from ddgcli.models.shell.context import ShellContext
from ddgcli.scenes.expressions import evaluate, parse
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect

log = logging.getLogger("ddgcli")
VARIABLES = ("x", "y", "z", "t")


class Wind(Section):
    """Air that moves past the faces."""

    object: str | None = Field(None, description="shell; by default all")
    velocity: list[str | float] = Field(
        ["0", "0", "0"], description="of the air [m/s]: three numbers or expressions in x, y, z, t"
    )
    density: quantity("kg/m^3", "of the air", ge=0) = 1.2
    normal: quantity("", "coefficient of the pressure from the normal velocity", ge=0) = 1.3
    tangential: quantity("", "coefficient of the friction from the tangential velocity", ge=0) = 0.02

    @field_validator("velocity")
    @classmethod
    def _expressions(cls, velocity: list[str | float]) -> list[str | float]:
        if len(velocity) != 3:
            raise ValueError(f"takes three numbers or expressions, not {len(velocity)}")
        for component in velocity:
            parse(str(component), VARIABLES)
        return velocity


class FaceDrag(Dissipation):
    """Rayleigh function of the velocity w of the faces relative to the air.

    R = rho / 2 sum A (c_n |w_n|^3 + c_t |w_t|^3) / 3, w_n and w_t the normal and tangential parts of w: the
    normal part of the force gives drag and lift (Newton's sine-square law), the tangential part friction.
    R is convex, so implicit steps are stable; air at rest takes energy from the shell.
    """

    name = "wind"
    active = True
    smooth = True

    def __init__(
        self, faces: NDArray, velocity: list[str], half_density: float, normal: float, tangential: float
    ) -> None:
        self.stencil, self.velocity, self.half_density = faces, velocity, half_density
        self.normal, self.tangential, self.time = normal, tangential, 0.0

    def frozen(self, x: NDArray, dt: float) -> Potential:
        x0, x1, x2 = columns_at(x, self.stencil)
        area = 0.5 * cross(x1 - x0, x2 - x0)
        size = np.sqrt(dot(area, area))
        normal = area / np.where(size > 0, size, 1.0)
        air = air_velocity(self.velocity, (x0 + x1 + x2) / 3, self.time)
        weight = self.half_density * size
        return FrozenFaceDrag(self.stencil, air, normal, self.normal * weight, self.tangential * weight)


class GustyFaceDrag(FaceDrag):
    """Face drag in air whose velocity depends on time."""

    def at(self, time: float) -> FaceDrag:
        drag = FaceDrag(self.stencil, self.velocity, self.half_density, self.normal, self.tangential)
        drag.time = time
        return drag


class FrozenFaceDrag(Potential):
    """The Rayleigh function at fixed positions, as a potential of the velocities of the vertices.

    Parameters
    ----------
    stencil : (m, 3) ndarray
    air, normal : (3, m) ndarray
        Velocity of the air at the faces in m/s, and unit normals.
    across, along : (m,) ndarray
        rho A c_n / 2 and rho A c_t / 2 in kg/m.
    """

    name = "wind"

    def __init__(
        self, stencil: NDArray, air: NDArray, normal: NDArray, across: NDArray, along: NDArray
    ) -> None:
        self.stencil, self.air, self.normal, self.across, self.along = stencil, air, normal, across, along

    def _relative(self, v: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Normal velocity (m,), tangential velocity (3, m) and its size (m,), relative to the air."""
        v0, v1, v2 = columns_at(v, self.stencil)
        w = (v0 + v1 + v2) / 3 - self.air
        speed = dot(w, self.normal)
        tangential = w - speed * self.normal
        return speed, tangential, np.sqrt(dot(tangential, tangential))

    def energy(self, x: NDArray) -> float:
        speed, _, slip = self._relative(x)
        return float(np.sum(self.across * np.abs(speed) ** 3 + self.along * slip**3)) / 3

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        speed, tangential, slip = self._relative(x)
        force = self.across * np.abs(speed) * speed / 3 * self.normal
        force += self.along * slip / 3 * tangential
        return sum_columns_by_index(self.stencil, [force] * 3, len(x))

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        speed, tangential, slip = self._relative(x)
        normal, unit = self.normal.T, (tangential / np.where(slip > 0, slip, 1.0)).T
        outer = normal[:, :, None] * normal[:, None, :]
        block = (2 * self.across * np.abs(speed))[:, None, None] * outer
        block += (self.along * slip)[:, None, None] * (
            np.eye(3) - outer + unit[:, :, None] * unit[:, None, :]
        )
        return np.tile(block / 9, (1, 3, 3))


def air_velocity(velocity: list[str], points: NDArray, time: float) -> NDArray[np.float64]:
    """(3, k) velocity of the air at points (3, k)."""
    variables = {**dict(zip("xyz", points)), "t": np.full(points.shape[1], time)}
    return np.stack([evaluate(text, variables) for text in velocity])


def _depends_on_time(text: str) -> bool:
    names = (node.id for node in ast.walk(parse(text, VARIABLES)) if isinstance(node, ast.Name))
    return "t" in names


def build(parameters: Wind, context: ShellContext) -> list[FaceDrag]:
    if context.scene.time.integrator == "static":
        raise ValueError(
            'the force of the wind has no energy, of which "static" finds the least; write '
            'load = { traction = [...] }, or integrator = "implicit-euler" with damping = { mass = ... }'
        )
    if parameters.density == 0 or parameters.normal == parameters.tangential == 0:
        log.warning("effect wind on %s has no strength: it changes nothing", context.shell.name)
        return []
    velocity = [str(component) for component in parameters.velocity]
    air_velocity(velocity, context.mesh.points.T, 0.0)  # raises an error if it cannot be evaluated
    kind = GustyFaceDrag if any(_depends_on_time(text) for text in velocity) else FaceDrag
    half = 0.5 * parameters.density
    return [kind(np.asarray(context.mesh.faces), velocity, half, parameters.normal, parameters.tangential)]


EFFECT = Effect("wind", Wind, build, "one pass over the faces per step", ("shell",), acts_on_all=True)
