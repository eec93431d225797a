"""Effect `stretching`: edge springs."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ddgcli.evolve.effects import Effect
from ddgcli.evolve.terms import Mode, Potential, scattered
from ddgcli.models.scene import Section
from ddgcli.models.scene_units import quantity
from ddgcli.models.shell.context import ShellContext


class Stretching(Section):
    """Resistance to stretch."""

    model: Literal["edges"] = "edges"
    stiffness: quantity("N/m", "membrane stiffness; default: young * thickness", gt=0) | None = None


class EdgeSprings:
    """Energy k a (l/l0 - 1)^2 / 2 of every edge, a the area of the edge's tile, k in N/m."""

    name = "stretching"

    def __init__(self, edges: NDArray, rest: NDArray, stiffness: NDArray) -> None:
        self.stencil = edges
        self.rest, self.stiffness = rest, stiffness

    def _edge(self, x: NDArray) -> tuple[NDArray, NDArray]:
        vector = x[self.stencil[:, 1]] - x[self.stencil[:, 0]]
        return vector, np.sqrt(np.einsum("ei,ei->e", vector, vector))

    def energy(self, x: NDArray) -> float:
        return 0.5 * float(np.sum(self.stiffness * (self._edge(x)[1] / self.rest - 1) ** 2))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        vector, length = self._edge(x)
        force = (self.stiffness / self.rest * (length / self.rest - 1) / length)[:, None] * vector
        return scattered(self.stencil, np.stack([-force, force], axis=1), len(x))

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        vector, length = self._edge(x)
        unit = vector / length[:, None]
        k = self.stiffness / self.rest**2
        across = 1 - self.rest / length
        if mode != "exact":
            across = np.maximum(across, 0) if mode == "projected" else np.zeros_like(across)
        outer = unit[:, :, None] * unit[:, None, :]
        block = k[:, None, None] * (outer + across[:, None, None] * (np.eye(3) - outer))
        return np.block([[block, -block], [-block, block]])


def build(parameters: Stretching, context: ShellContext) -> list[Potential]:
    stiffness = float(parameters.stiffness or context.shell.young * context.shell.thickness)  # type: ignore[operator]
    topology = context.mesh.topology
    rest = np.zeros(topology.n_edges)
    rest[topology.side_edge.ravel()] = context.mesh.side_length.ravel()
    tile = np.bincount(
        topology.side_edge.ravel(), weights=np.repeat(context.face_area / 3, 3), minlength=topology.n_edges
    )
    return [EdgeSprings(topology.edges, rest, stiffness * tile)]


EFFECT = Effect("stretching", Stretching, build, "one pass over the edges", ("shell",))
