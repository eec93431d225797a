"""Phases of a step of a fluid: transport, sources (diffusion, forces) and tracers, with one signature.

A step is symmetric, hence of second order: every source for half of the step (forces and viscosity together,
see `sources`), the transport of the flow, every tracer, and the sources in reverse for the other half.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ddgcli.models.fluid.state import FluidState
from ddgcli.simulation.model import Observation

if TYPE_CHECKING:
    from ddgcli.models.fluid.boundary_motion import InTime
    from ddgcli.models.fluid.context import FluidContext
    from ddgcli.models.fluid.surface_space import SurfaceSpace
    from ddgcli.models.fluid.transport import Transport
    from ddgcli.models.fluid.volume_paths import VolumePaths
    from ddgcli.models.fluid.volume_space import VolumeSpace


FlowRate = tuple[NDArray[np.float64], NDArray[np.float64]]  # of vorticity (n,) and harmonic coefficients (b,)
# (k,) vorticity of the cells of the space's `rim` vertices by stream function, coefficients and time
BoundaryVorticity = Callable[[NDArray, NDArray, float], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class Step:
    """A span of time.

    Parameters
    ----------
    time, dt : float
        Start and length [s].
    before : FluidState
        At the start of the span; tracers read the flow there and in the state that they advance.
    balance : FlowRate, optional
        What the transport leaves out in the span, since the viscosity has it as a source.
    """

    time: float
    dt: float
    before: FluidState
    balance: FlowRate | None = None


class Phase(Protocol):
    """One part of a step.

    Attributes
    ----------
    effect : str
        Name under which its seconds are booked; "" books them to the integrator.
    step_stage : {'transport', 'source', 'tracer'}
        Its place in a step.
    order : int
        Order in time.
    """

    effect: str
    step_stage: Literal["transport", "source", "tracer"]
    order: int

    def start(self) -> dict[str, NDArray]:
        """Arrays that it adds to the state, at the start."""
        ...

    def advance(self, step: Step, state: FluidState) -> FluidState:
        """The state after the span; a pure function. Raises `StepRejected`."""
        ...

    def distance(self, a: FluidState, b: FluidState, start: FluidState, duration: float) -> float:
        """Relative distance of what it adds to states in a run of `duration`, for adaptive steps."""
        ...

    def observed(self, state: FluidState) -> Observation:
        """What it adds to a frame."""
        ...


class TransportPhase(Phase, Protocol):
    """The phase of an integrator."""

    def balance(self, state: FluidState, dt: float) -> FlowRate | None:
        """Its rate of change where the viscosity takes it as a source in a step of dt, else None."""
        ...

    def step_limit(self, state: FluidState) -> float:
        """Longest step that is stable at a state; infinity without a limit."""
        ...


class Acceleration(Phase, Protocol):
    """A force that does not depend on the flow."""

    def cell_acceleration(self, state: FluidState, time: float) -> NDArray[np.float64]:
        """(m, 3) what it adds to the velocity of the cells a second."""
        ...


class FlowPhase:
    """Base of phases that change the flow and add nothing to the state or to the frames."""

    effect = ""
    is_force = False  # an acceleration that does not depend on the flow
    step_stage: Literal["transport", "source", "tracer"] = "source"
    order = 2

    def start(self) -> dict[str, NDArray]:
        return {}

    def step_limit(self, state: FluidState) -> float:
        return math.inf

    def balance(self, state: FluidState, dt: float) -> FlowRate | None:
        return None

    def distance(self, a: FluidState, b: FluidState, start: FluidState, duration: float) -> float:
        return 0.0

    def observed(self, state: FluidState) -> Observation:
        return Observation(None)


@dataclass(eq=False)
class FluidSetting:
    """What phases are built from.

    Parameters
    ----------
    context : FluidContext
    space : SurfaceSpace
    effects : frozenset of str
        Names of the effects that act on this fluid.
    no_slip : bool
    wall_circulation : (n,) ndarray or InTime, optional
        What moving walls add to the circulation around the cells of their vertices.
    evolve_harmonic : bool
    slip : (n,) ndarray of bool, optional
        Boundary vertices of free-slip walls.
    is_open : bool
        Whether fluid crosses the boundary.
    phases : list of Phase
        Those of all effects, complete when the model is.
    coriolis : (n,) ndarray or 0
        Vorticity of a frame that turns [1/s].
    transport_takes_coriolis : bool
        Whether the integrator's rate of change holds the Coriolis force, so that its effect has no step.
    viscosity : float
        That of the effect `viscosity` [m^2/s]; 0 without it.
    boundary_vorticity : BoundaryVorticity, optional
        Vorticity that a surface with viscosity has at its boundary.
    needs_time : bool
        Whether states hold their time.
    """

    context: FluidContext
    space: SurfaceSpace
    effects: frozenset[str]
    no_slip: bool = False
    wall_circulation: NDArray[np.float64] | InTime | None = None
    evolve_harmonic: bool = False
    slip: NDArray[np.bool_] | None = None
    is_open: bool = False
    phases: list[Phase] = field(default_factory=list)
    coriolis: NDArray[np.float64] | float = 0.0
    transport_takes_coriolis: bool = False
    viscosity: float = 0.0
    boundary_vorticity: BoundaryVorticity | None = None
    needs_time: bool = False

    @property
    def wall_friction(self) -> float:
        """Viscosity of a fluid that has walls without slip [m^2/s], else 0."""
        return self.viscosity if self.no_slip else 0.0

    @property
    def volume(self) -> VolumeSpace:
        """The space of a volume."""
        return self.space  # type: ignore[return-value]

    @cached_property
    def volume_paths(self) -> VolumePaths:
        """The cells of a volume ready for tracing points, shared by all phases that do."""
        from ddgcli.models.fluid.volume_paths import VolumePaths

        return VolumePaths(self.volume)

    @cached_property
    def tracing(self) -> Transport:
        """The surface ready for tracing points, shared by all phases that do."""
        from ddgcli.models.fluid.transport import Transport

        return Transport(self.space)


@dataclass(frozen=True)
class PhaseRequest:
    """Request of an effect for a phase; `make` may return None (a check), or refuse by ValueError."""

    make: Callable[[FluidSetting], Phase | None]
