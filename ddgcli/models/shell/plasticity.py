"""Effect `plasticity`: rest lengths and rest angles yield, with linear hardening."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ddgcli.mechanics.terms import Arrays, PlasticMemory, Potential
from ddgcli.models.shell.context import ShellContext
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect

PATH_FRACTION = 1e-3  # difference step for the stress, over a plastic increment


class Plasticity(Section):
    """Permanent deformation beyond a yield strain or a yield angle."""

    object: str | None = Field(None, description="shell; by default all")
    yield_strain: quantity("", "elastic strain at which stretching yields", gt=0) | None = None
    yield_angle: quantity("rad", "elastic change of a hinge's angle at which bending yields", gt=0) | None = (
        None
    )
    hardening: quantity("", "growth of the yield limit per plastic strain or angle", ge=0) = 0.0

    @model_validator(mode="after")
    def _one(self) -> Plasticity:
        if self.yield_strain is None and self.yield_angle is None:
            raise ValueError("give yield_strain, yield_angle or both")
        return self


class PlasticFlow(PlasticMemory):
    """Plastic flow of one elastic potential: radial return mapping with linear hardening.

    The memory has the rest state and the accumulated plastic strain of each element. An elastic strain e
    above the limit L = yield + hardening * accumulated gives the plastic increment (e - L) / (1 + hardening).
    """

    effect = "plasticity"

    def __init__(self, potential: Any, limit: float, hardening: float) -> None:
        self.potential, self.limit, self.hardening = potential, limit, hardening

    def initial(self) -> Arrays:
        """Memory of a shell that has not yielded."""
        rest = self.rest()
        return {"rest": rest, "accumulated": np.zeros(len(rest)), "work": np.zeros(1)}

    def commit(self, x: NDArray, memory: Arrays) -> Arrays:
        """The memory after a step that ends at x; the same object if nothing yields."""
        strain = self.strain(x, memory["rest"])
        increment = (strain - self.limit - self.hardening * memory["accumulated"]) / (1 + self.hardening)
        if not (increment > 0).any():
            return memory
        increment = np.maximum(increment, 0.0)
        rest = self.yielded(x, memory["rest"], strain, increment)
        after = {"rest": rest, "accumulated": memory["accumulated"] + increment, "work": memory["work"]}
        work = self.at(memory).energy(x) - self.at(after).energy(x)
        return {**after, "work": memory["work"] + work}

    def distance(self, one: Arrays, other: Arrays) -> float:
        """Largest difference of the plastic strains of two memories, over the limit."""
        return float(np.abs(one["accumulated"] - other["accumulated"]).max(initial=0.0)) / self.limit

    def quasi_static(self, x: NDArray, before: Arrays, after: Arrays) -> Arrays:
        """`after` with the work of a slow path from `before` to x: mean stress times plastic strain."""
        limits = [self.limit + self.hardening * memory["accumulated"] for memory in (before, after)]
        mean = 0.5 * (limits[0] + limits[1]) / limits[1]  # mean stress over the stress at the end
        back = (before["rest"] - after["rest"]) * mean.reshape(-1, *[1] * (after["rest"].ndim - 1))

        def energy(fraction: float) -> float:
            return self.at({**after, "rest": after["rest"] + fraction * back}).energy(x)

        work = 0.5 / PATH_FRACTION * (energy(PATH_FRACTION) - energy(-PATH_FRACTION))
        return {**after, "work": before["work"] + work}

    def carried(self, before: PlasticFlow, memory: Arrays, rows: NDArray) -> Arrays:
        """Memory after a crack, from that of the flow before it.

        Parameters
        ----------
        rows : (n,) ndarray of int
            Index before the crack of each vertex.
        """
        own = self._elements(before, rows)
        return {
            "rest": memory["rest"][own],
            "accumulated": memory["accumulated"][own],
            "work": memory["work"],
        }

    def _elements(self, before: PlasticFlow, rows: NDArray) -> NDArray[np.int64]:
        """Index before a crack of each element: that of the element with the same edge."""

        def keys(edges: NDArray) -> NDArray[np.int64]:
            low, high = np.sort(edges[:, :2], axis=1).T
            return low * (int(rows.max()) + 1) + high

        earlier = keys(before.potential.stencil)
        order = np.argsort(earlier)
        return order[np.searchsorted(earlier[order], keys(rows[self.potential.stencil]))]

    def rest(self) -> NDArray[np.float64]:
        """Rest state of the elements before they yield."""
        return np.asarray(self.potential.rest)

    @abstractmethod
    def strain(self, x: NDArray, rest: NDArray) -> NDArray[np.float64]:
        """Size of the elastic strain of each element."""

    @abstractmethod
    def yielded(self, x: NDArray, rest: NDArray, strain: NDArray, increment: NDArray) -> NDArray[np.float64]:
        """Rest state after a plastic increment."""


class HingeFlow(PlasticFlow):
    """Plastic flow of the rest angles of hinges."""

    def _change(self, x: NDArray, rest: NDArray) -> NDArray[np.float64]:
        from ddgcli.geometry.hinges import hinge_frame
        from ddgcli.models.shell.hinge import wrapped

        return wrapped(hinge_frame(x, self.potential.stencil).angle - rest)

    def at(self, memory: Arrays) -> Potential:
        return type(self.potential)(self.potential.stencil, self.potential.weight, memory["rest"])

    def strain(self, x: NDArray, rest: NDArray) -> NDArray[np.float64]:
        return np.abs(self._change(x, rest))

    def yielded(self, x: NDArray, rest: NDArray, strain: NDArray, increment: NDArray) -> NDArray[np.float64]:
        return rest + np.sign(self._change(x, rest)) * increment


class EdgeFlow(PlasticFlow):
    """Plastic flow of the rest lengths of edges."""

    def _strain(self, x: NDArray, rest: NDArray) -> tuple[NDArray, NDArray]:
        length = self.potential.lengths(x)
        return length, length / rest - 1

    def at(self, memory: Arrays) -> Potential:
        return type(self.potential)(self.potential.stencil, memory["rest"], self.potential.stiffness)

    def strain(self, x: NDArray, rest: NDArray) -> NDArray[np.float64]:
        return np.abs(self._strain(x, rest)[1])

    def yielded(self, x: NDArray, rest: NDArray, strain: NDArray, increment: NDArray) -> NDArray[np.float64]:
        length, signed = self._strain(x, rest)
        return np.where(increment > 0, length / (1 + signed - np.sign(signed) * increment), rest)


class MembraneFlow(PlasticFlow):
    """Plastic flow of the rest metrics of faces, along the straight line to the current metric.

    The metrics are (m, 2, 2), in the orthonormal frame of the face in the input. Along that line every
    principal strain shrinks, so the energy decreases. Elastic energies are still integrated over the area of
    the face in the input, because plastic flow preserves the volume of the material.
    """

    def rest(self) -> NDArray[np.float64]:
        return np.tile(np.eye(2), (len(self.potential.area), 1, 1))

    def _elements(self, before: PlasticFlow, rows: NDArray) -> NDArray[np.int64]:
        return np.arange(len(self.potential.area))  # faces keep their order

    def _metric(self, x: NDArray) -> NDArray[np.float64]:
        return self.potential.metric(x)

    def at(self, memory: Arrays) -> Potential:
        p, root = self.potential, _inverse_root(memory["rest"])
        eye = np.eye(2)  # equal to the rest metric up to rounding
        rest = eye + np.matmul(np.matmul(root.transpose(0, 2, 1), p.rest_metric - eye), root)
        return type(p)(p.stencil, np.matmul(p.basis, root), p.area, p.lam, p.mu, rest)

    def _principal(self, x: NDArray, rest: NDArray) -> NDArray[np.float64]:
        """(m, 2) principal Green strains relative to the rest metric."""
        root, change = _inverse_root(rest), self._metric(x) - rest
        p, q, r = root[:, 0, 0], root[:, 0, 1], root[:, 1, 1]
        c11, c12, c22 = change[:, 0, 0], change[:, 0, 1], change[:, 1, 1]
        # components of root' change root, whose eigenvalues are twice the strains
        e11, e12 = p * p * c11, p * (q * c11 + r * c12)
        e22 = q * q * c11 + 2 * q * r * c12 + r * r * c22
        mean, radius = 0.5 * (e11 + e22), np.hypot(0.5 * (e11 - e22), e12)
        return 0.5 * np.stack([mean - radius, mean + radius], axis=1)

    def strain(self, x: NDArray, rest: NDArray) -> NDArray[np.float64]:
        return np.abs(self._principal(x, rest)).max(axis=1)

    def yielded(self, x: NDArray, rest: NDArray, strain: NDArray, increment: NDArray) -> NDArray[np.float64]:
        # with the fraction s of the old rest metric, a principal strain e becomes s e / (1 + 2 e (1 - s))
        principal = self._principal(x, rest)
        bound = np.sign(principal) * (strain - increment)[:, None]
        beyond = np.abs(principal) > np.abs(bound)
        safe = np.where(beyond, principal, 1.0)
        fraction = np.where(beyond, bound * (1 + 2 * safe) / (safe * (1 + 2 * bound)), 1.0).min(axis=1)
        fraction = fraction[:, None, None]
        return (1 - fraction) * self._metric(x) + fraction * rest


def _inverse_root(metric: NDArray) -> NDArray[np.float64]:
    """(m, 2, 2) upper triangular P with P^T M P = I: the transposed inverse of the Cholesky factor."""
    a = np.sqrt(metric[:, 0, 0])
    b = metric[:, 0, 1] / a
    c = np.sqrt(metric[:, 1, 1] - b * b)
    root = np.zeros_like(metric)
    root[:, 0, 0], root[:, 0, 1], root[:, 1, 1] = 1 / a, -b / (a * c), 1 / c
    return root


def build(parameters: Plasticity, context: ShellContext) -> list[PlasticFlow]:
    # by class name, so that the modules of effects that the scene does not use are not imported
    kinds: dict[str, tuple[type[PlasticFlow], float | None]] = {
        "HingeBending": (HingeFlow, parameters.yield_angle),
        "EdgeSprings": (EdgeFlow, parameters.yield_strain),
        "StVK": (MembraneFlow, parameters.yield_strain),
    }
    flows: list[PlasticFlow] = []
    for potential in context.elastic:
        flow, limit = kinds.get(type(potential).__name__, (None, None))
        if potential.name == "stretching" and flow is None and parameters.yield_strain is not None:
            raise ValueError('yield_strain needs stretching with model = "stvk" or "edges"')
        if potential.name == "bending" and flow is None and parameters.yield_angle is not None:
            raise ValueError('yield_angle needs rest angles: write bending = { model = "hinge" }')
        if flow is not None and limit is not None:
            flows.append(flow(potential, limit, parameters.hardening))
    for name, effect in (("yield_strain", "stretching"), ("yield_angle", "bending")):
        if getattr(parameters, name) is not None and effect not in context.terms:
            raise ValueError(f"{name} needs the effect {effect}")
    return flows


EFFECT = Effect(
    "plasticity",
    Plasticity,
    build,
    "one pass over the faces and hinges per step",
    ("shell",),
    acts_on_all=True,
)
