"""Protocol of spaces of discrete flows, on surfaces and in volumes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from numpy.typing import NDArray

from ddgcli.linalg.factor import Factor
from ddgcli.models.fluid.state import FluidState
from ddgcli.simulation.model import Observation


class FlowSpace(Protocol):
    """Divergence-free velocities on one mesh.

    The arrays of a state that describe the flow are the space's own (`rest` names them); those of tracers and
    of the accounts of a scheme belong to the phases that add them.
    """

    @property
    def dimension(self) -> int: ...

    @property
    def mesh(self) -> Any: ...

    @property
    def factor(self) -> Factor:
        """Solver of the potential or the stream function of a flow."""
        ...

    def rest(self) -> dict[str, NDArray]:
        """Named arrays of a fluid at rest."""
        ...

    def restated(self, state: FluidState, time: float) -> FluidState:
        """The state with what the boundary prescribes at another time, its circulations as they were."""
        ...

    def energy(self, state: FluidState) -> float:
        """Kinetic energy of unit density."""
        ...

    def total_enstrophy(self, state: FluidState) -> float:
        """Half the integral of the squared vorticity."""
        ...

    @property
    def measure(self) -> float:
        """Area or volume."""
        ...

    @property
    def size(self) -> float:
        """Length of the side of a square, or of a cube, of the same area or volume."""
        ...

    def distance(self, a: FluidState, b: FluidState, start: FluidState, least_energy: float) -> float:
        """Size of the difference of two flows, relative to the largest of `start`, `b` and an energy."""
        ...

    def observed(self, state: FluidState) -> Observation:
        """Vertex arrays and scalars of a flow."""
        ...

    def circulation_terms(self) -> tuple[float, float]:
        """Bounds on the sums of circulations and on the enstrophy of a flow of kinetic energy 1/2."""
        ...

    def assembled(self) -> Mapping[str, Any]:
        """Counts for a dry run."""
        ...
