"""Effect `pressure`: a constant pressure, or an isothermal gas, inside a closed shell."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ddgcli.geometry.extrinsic import component_volumes
from ddgcli.mechanics.terms import Mode, Potential, at_last_point
from ddgcli.mesh.require import require
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.vectors import cross_matrix, row_cross, row_dot
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.ramp import RampSection
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect

log = logging.getLogger("ddgcli")

AMBIENT_PRESSURE = 101325.0  # Pa, the standard atmosphere


class Pressure(RampSection):
    """Excess pressure inside a closed shell."""

    object: str | None = Field(None, description="shell; needed where the scene has several")
    value: quantity("Pa", "excess pressure, positive outward; of a gas: at the start") = 0.0
    gas: bool = Field(False, description="isothermal gas: pressure times volume is constant")
    ambient: quantity("Pa", "absolute pressure outside, for a gas", gt=0) = AMBIENT_PRESSURE

    @model_validator(mode="after")
    def _checked(self) -> Pressure:
        if not self.gas and self.ambient != AMBIENT_PRESSURE:
            raise ValueError("ambient has no effect without gas = true; take it out")
        least = self.value * min([1.0, *(self.factors or [])])
        if self.gas and not self.ambient + least > 0:
            raise ValueError(
                f"the absolute pressure of a gas must be positive, not {self.ambient + least:g} Pa"
            )
        return self


class ConstantPressure(Potential):
    """Energy -p (V - V0), V the enclosed volume.

    Parameters
    ----------
    faces : (m, 3) ndarray
    center : (3,) ndarray
        Origin for the coordinates of the corners: it affects only the rounding of the volume.
    rest : float
        V0 in m^3, negative where the faces look inward.
    pressure : float
        p in Pa, positive outward.
    label : str
        Name of the shell in the scalars of the frames.
    """

    name = "pressure"

    def __init__(self, faces: NDArray, center: NDArray, rest: float, pressure: float, label: str) -> None:
        self.stencil, self.center, self.rest = faces, center, rest
        self.pressure, self.label, self.sign = pressure, label, float(np.sign(rest))

    def scaled(self, factor: float) -> Potential:
        """The same potential with `factor` times the pressure."""
        return ConstantPressure(self.stencil, self.center, self.rest, factor * self.pressure, self.label)

    @at_last_point
    def _corners(self, x: NDArray) -> NDArray:
        return x[self.stencil] - self.center

    def volume(self, x: NDArray) -> float:
        """Enclosed volume in m^3."""
        a, b, c = np.moveaxis(self._corners(x), 1, 0)
        return self.sign * float(row_dot(row_cross(a, b), c).sum()) / 6

    def volume_gradient(self, x: NDArray) -> NDArray[np.float64]:
        """(n, 3) gradient of the volume."""
        a, b, c = np.moveaxis(self._corners(x), 1, 0)
        area = np.stack([row_cross(b, c), row_cross(c, a), row_cross(a, b)], axis=1)
        return sum_by_index(self.stencil, self.sign / 6 * area, len(x))

    def excess(self, x: NDArray) -> float:
        """Excess pressure in Pa."""
        return self.pressure

    def energy(self, x: NDArray) -> float:
        return -self.pressure * (self.volume(x) - abs(self.rest))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        return -self.excess(x) * self.volume_gradient(x)

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        block = np.zeros((len(self.stencil), 3, 3, 3, 3))
        if mode == "exact":
            corners = -self.sign * self.excess(x) / 6 * self._corners(x)
            for i, j, k, sign in ((0, 1, 2, -1), (0, 2, 1, 1), (1, 2, 0, -1)):
                cross = sign * cross_matrix(corners[:, k])
                block[:, i, :, j] = cross
                block[:, j, :, i] = cross.transpose(0, 2, 1)
        return block.reshape(-1, 9, 9)

    def observed(self, x: NDArray) -> dict[str, float]:
        """Scalars of a frame."""
        return {f"volume_{self.label}": self.volume(x), f"pressure_{self.label}": self.excess(x)}


class Gas(ConstantPressure):
    """Energy -C ln(V / V0) + p_ambient (V - V0), C = (p_ambient + p) V0: pressure times volume stays C."""

    def __init__(
        self, faces: NDArray, center: NDArray, rest: float, pressure: float, label: str, ambient: float
    ) -> None:
        super().__init__(faces, center, rest, pressure, label)
        self.ambient = ambient

    def scaled(self, factor: float) -> Potential:
        return Gas(self.stencil, self.center, self.rest, factor * self.pressure, self.label, self.ambient)

    def _expansion(self, x: NDArray) -> float:
        """(V - V0) / V0."""
        return (self.volume(x) - abs(self.rest)) / abs(self.rest)

    def excess(self, x: NDArray) -> float:
        expansion = self._expansion(x)
        return (self.pressure - self.ambient * expansion) / (1 + expansion)

    def energy(self, x: NDArray) -> float:
        expansion = self._expansion(x)
        if expansion <= -1:
            return np.inf
        absolute = self.ambient + self.pressure
        return abs(self.rest) * (self.ambient * expansion - absolute * float(np.log1p(expansion)))

    def low_rank(self, x: NDArray) -> NDArray[np.float64]:
        """(n, 3) vector u; the stiffness of the gas adds u u^T to the Hessian of the blocks."""
        constant = (self.ambient + self.pressure) * abs(self.rest)
        return np.sqrt(constant) / self.volume(x) * self.volume_gradient(x)


class EscapedGas(Potential):
    """Zero energy, for a shell that a crack has opened; its frames report volume and pressure 0."""

    name = "pressure"

    def __init__(self, label: str) -> None:
        self.stencil, self.label = np.zeros((0, 3), dtype=np.int64), label

    def scaled(self, factor: float) -> EscapedGas:
        """Itself."""
        return self

    def energy(self, x: NDArray) -> float:
        return 0.0

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        return np.zeros_like(x)

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return np.zeros((0, 9, 9))

    def observed(self, x: NDArray) -> dict[str, float]:
        """Scalars of a frame."""
        return {f"volume_{self.label}": 0.0, f"pressure_{self.label}": 0.0}


def build(parameters: Pressure, context: ShellContext) -> list[Any]:
    mesh, name = context.mesh, context.shell.name
    topology = mesh.topology
    broken = context.input_vertex is not None
    if broken and len(topology.boundary_edges) and (parameters.gas or parameters.value):
        return [parameters.ramped(EscapedGas(name))]
    if len(topology.boundary_edges):
        raise ValueError(
            f"{name!r} is open, with {len(topology.boundary_edges)} boundary edges: pressure needs a closed "
            "shell; use a load with a traction"
        )
    if topology.one_sided_face.any():
        raise ValueError(
            f"{name!r} is one-sided: it has no inside and encloses no volume; leave pressure out, or use a "
            "load with a traction"
        )
    if topology.n_components > 1 and parameters.gas:
        raise ValueError(f"{name!r} has {topology.n_components} components; make each of them an object")
    if not parameters.gas and parameters.value == 0:
        log.warning("effect pressure on %s has no strength: it changes nothing", name)
        return []
    require(mesh, "pressure", faces=False, sized=False, oriented=True)
    if np.ptp(np.sign(component_volumes(mesh))) > 1:
        raise ValueError(
            f"components of {name!r} face opposite ways, outward and inward: the pressure would expand some "
            "and compress others; make each of them an object"
        )
    points = np.asarray(mesh.points)
    arguments = (np.asarray(mesh.faces), points.mean(axis=0))
    rest = ConstantPressure(*arguments, 1.0, 0.0, name).volume(points)
    if rest == 0:
        raise ValueError(f"{name!r} encloses no volume")
    potential: ConstantPressure = ConstantPressure(*arguments, rest, parameters.value, name)
    if parameters.gas:
        potential = Gas(*arguments, rest, parameters.value, name, parameters.ambient)
    return [parameters.ramped(potential)]


EFFECT = Effect(
    "pressure", Pressure, build, "one pass over the faces; a gas: one more solve per factorisation",
    ("shell",),    repeatable=True,
)  # fmt: skip
