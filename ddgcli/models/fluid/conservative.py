"""Conservative advection: the Galerkin form of Euler's equation in piecewise constant velocities.

    (du/dt, w) = - int omega (n x u) . w      for all discrete flows w,

omega linear in every face. Tested with the stream functions' own flows this is the Jacobian of two piecewise
linear functions. Without time error it conserves kinetic energy (w = u), enstrophy, total vorticity and the
circulation along every boundary loop, on any mesh.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.models.fluid.loss_account import LossAccount
from ddgcli.models.fluid.midpoint import PICARD_TOLERANCE, implicit_midpoint
from ddgcli.models.fluid.phases import BoundaryVorticity, FlowPhase, FlowRate, FluidSetting, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.surface_space import SurfaceFlow, SurfaceSpace
from ddgcli.simulation.model import Cause, Observation, StepRejected

RK4_LIMIT = 2.8  # on the imaginary axis
STREAM_SHARE = 1e-3  # of the fluxes of a stream, below which its circulations count as small
BALANCE_LIMIT = 2.0  # the same of a step whose rate of change at the start is a source of the viscosity


# vorticity at the `rim` vertices by stream function, coefficients and time, where the flow determines it
Rates = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def rate(
    space: SurfaceSpace,
    vorticity: NDArray,
    coefficients: NDArray,
    evolve_harmonic: bool,
    coriolis: NDArray | float = 0.0,
    time: float = 0.0,
    flow: SurfaceFlow | None = None,
) -> Rates:
    """Time derivatives of vorticity and harmonic coefficients by Euler's equation.

    Parameters
    ----------
    space : SurfaceSpace
    vorticity : (n,) ndarray of float64
        Integrated over the cells.
    coefficients : (b,) ndarray of float64
    evolve_harmonic : bool
        Whether the harmonic coefficients change.
    coriolis : (n,) ndarray of float64 or float
        Vorticity of a frame that turns, in 1/s.
    time : float
        Of what the boundary prescribes.
    flow : SurfaceFlow, optional
        Of these arrays at this time, where it is known.

    Returns
    -------
    d_vorticity : (n,) ndarray of float64
    d_coefficients : (b,) ndarray of float64
        Without what a change of the prescribed flow takes from them.
    flux : (m, 3) ndarray of float64
        Through the sides.
    """
    if flow is None:
        flow = space.flow_of(vorticity, coefficients, time)
    phi, flux = flow.phi, flow.side_flux
    d_vorticity, d_coefficients = rotational_rates(
        space, vorticity * space.inverse_mass + coriolis, flux, evolve_harmonic
    )
    if space.lift is not None and np.any(coriolis):
        closing, at_outflows = space.of_boundary_integrals(coriolis_along_boundary(space, coriolis, flux))
        d_vorticity += closing
        d_coefficients += at_outflows if evolve_harmonic else 0.0
    if space.outflow is not None:
        by_head, of_coefficients = space.outflow.head_rates(
            space.edge_flux(phi, coefficients), space.harmonic
        )
        d_vorticity += by_head
        d_coefficients += of_coefficients if evolve_harmonic else 0.0
    return d_vorticity, d_coefficients, flux


def rotational_rates(
    space: SurfaceSpace, omega: NDArray, flux: NDArray, evolve_harmonic: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rates of vorticity and harmonic coefficients by the force -omega n x u.

    Parameters
    ----------
    space : SurfaceSpace
    omega : (n,) ndarray of float64
        Vorticity at the vertices, in 1/s.
    flux : (m, 3) ndarray of float64
        Through the sides.
    evolve_harmonic : bool
        Whether the harmonic coefficients change.

    Returns
    -------
    d_vorticity : (n,) ndarray of float64
    d_coefficients : (b,) ndarray of float64
    """
    first, second, third = omega.take(space.corners)
    mean = (first + second + third) / 3.0
    carried = (-0.5 * mean) * flux.T[NEXT]  # side k+1 is opposite corner k
    d_vorticity = sum_by_index(space.corners, carried, space.n)
    d_coefficients = np.zeros(len(space.harmonic))
    if evolve_harmonic and len(d_coefficients):
        push = np.zeros_like(flux)
        push[:, 0], push[:, 2] = -0.5 * mean * flux[:, 2], 0.5 * mean * flux[:, 0]
        on_edge = sum_by_index(space.side_edge, push * space.side_sign, space.harmonic.shape[1])
        d_coefficients = space.harmonic @ on_edge
    return d_vorticity, d_coefficients


def coriolis_along_boundary(
    space: SurfaceSpace, coriolis: NDArray | float, flux: NDArray
) -> NDArray[np.float64]:
    """Integrals of the Coriolis force along boundary sides, which fluid crosses.

    With them its gradient is balanced by pressure at outflows, too, as that of every force is.

    Parameters
    ----------
    space : SurfaceSpace
    coriolis : (n,) ndarray of float64 or float
        Vorticity of a frame that turns, in 1/s.
    flux : (m, 3) ndarray of float64
        Through the sides, outwards.

    Returns
    -------
    (s, 2) ndarray of float64
        Weighted by the hat functions of tail and head of `boundary_sides`.
    """
    face, k, ends = space.boundary_sides
    at_ends = np.broadcast_to(coriolis, (space.n,))[ends]
    return -flux[face, k][:, None] * (at_ends + at_ends.sum(axis=1, keepdims=True)) / 6.0


def advection_rate(space: SurfaceSpace, flux: NDArray) -> float:
    """Bound on the spectral radius of the transport: the largest absolute row sum."""
    row = 0.5 * sum_by_index(space.faces, np.abs(flux[:, NEXT]), space.n)
    return float((row * space.inverse_mass).max(initial=0.0))


def fourth_order_step(
    slope: Callable[[NDArray, NDArray, float], Rates],
    vorticity: NDArray,
    coefficients: NDArray,
    dt: float,
    first: Rates,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Flow after one classical Runge-Kutta step.

    Parameters
    ----------
    slope : callable (n,), (b,), float -> rates
        Time derivatives of a flow, as for `rate`, at a time after the start of the step.
    vorticity : (n,) ndarray of float64
        Integrated over the cells.
    coefficients : (b,) ndarray of float64
    dt : float
        In seconds.
    first : rates
        At the start of the step.

    Returns
    -------
    vorticity : (n,) ndarray of float64
    coefficients : (b,) ndarray of float64
    """
    half = 0.5 * dt
    k1, c1, _ = first
    k2, c2, _ = slope(vorticity + half * k1, coefficients + half * c1, half)
    k3, c3, _ = slope(vorticity + half * k2, coefficients + half * c2, half)
    k4, c4, _ = slope(vorticity + dt * k3, coefficients + dt * c3, dt)
    sixth = dt / 6.0
    return (
        vorticity + sixth * (k1 + 2.0 * (k2 + k3) + k4),
        coefficients + sixth * (c1 + 2.0 * (c2 + c3) + c4),
    )


def largest_rate(space: SurfaceSpace, flux: NDArray, coriolis: NDArray | float) -> float:
    """Bound on the spectral radius of transport and Coriolis force together [1/s]."""
    return advection_rate(space, flux) + float(np.abs(coriolis).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class StageRates:
    """Rates of change at the stages of a step.

    Parameters
    ----------
    space : SurfaceSpace
    evolve_harmonic : bool
        Whether the harmonic coefficients change.
    coriolis : (n,) ndarray of float64 or float
        Vorticity of a frame that turns, in 1/s.
    balance : FlowRate, optional
        What is left out of the rates.
    time : float
        Start of the step.
    at_walls : BoundaryVorticity, optional
        Vorticity that walls have by friction.
    """

    space: SurfaceSpace
    evolve_harmonic: bool
    coriolis: NDArray | float = 0.0
    balance: FlowRate | None = None
    time: float = 0.0
    at_walls: BoundaryVorticity | None = None

    def at(
        self, vorticity: NDArray, coefficients: NDArray, after: float, flow: SurfaceFlow | None = None
    ) -> tuple[Rates, NDArray[np.float64]]:
        """Rates at a time `after` the start of the step, and the vorticity with that of walls.

        The coefficients are those of the prescribed flow of the start; `flow` is as in `rate`.
        """
        space, then = self.space, self.time + after
        now = self.shifted(coefficients, after)
        flow = space.flow_of(vorticity, now, then) if flow is None else flow
        vorticity = self._with_boundary(vorticity, flow, now, then)
        rates = rate(space, vorticity, now, self.evolve_harmonic, self.coriolis, then, flow)
        if self.balance is not None:
            rates = rates[0] - self.balance[0], rates[1] - self.balance[1], rates[2]
        return rates, vorticity

    def shifted(self, coefficients: NDArray, after: float) -> NDArray[np.float64]:
        """(b,) harmonic coefficients without what the flow that the boundary prescribes gains of them.

        Pressure changes no inner product of the whole flow with a harmonic one, be it frozen or not.
        """
        space = self.space
        if space.lift_in_time is None:
            return coefficients
        gain = space.lifted_part_at(self.time) - space.lifted_part_at(self.time + after)
        return coefficients + gain

    def _with_boundary(
        self, vorticity: NDArray, flow: SurfaceFlow, coefficients: NDArray, time: float
    ) -> NDArray[np.float64]:
        """The vorticity with that of walls with friction, which is theirs at every stage of a step.

        Carried along from the start of a step instead, it would lack what the flow gains along the wall in
        the step, and the flow would be of first order in time.
        """
        if self.at_walls is None:
            return vorticity
        after = vorticity.copy()
        after[self.space.rim] = self.at_walls(flow.phi, coefficients, time)
        return after


def runge_kutta(
    stage_rates: StageRates,
    vorticity: NDArray,
    coefficients: NDArray,
    dt: float,
    flow: SurfaceFlow | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float]:
    """One classical fourth-order step; `flow` is that of the start, where it is known.

    The third value is dt times `largest_rate` at its start, the fourth the enstrophy that vorticity at walls
    adds in the step.
    """
    b, space = len(coefficients), stage_rates.space

    def slope(vorticity: NDArray, packed: NDArray, after: float, flow: SurfaceFlow | None = None) -> Rates:
        rates, with_walls = stage_rates.at(vorticity, packed[:b], after, flow)
        beyond = vorticity - with_walls
        added = float(beyond @ (space.inverse_mass * rates[0])) if stage_rates.at_walls is not None else 0.0
        return rates[0], np.append(rates[1], added), rates[2]

    packed = np.append(coefficients, 0.0)
    first = slope(vorticity, packed, 0.0, flow)
    courant = dt * largest_rate(space, first[2], stage_rates.coriolis)
    if courant > RK4_LIMIT:
        return vorticity, coefficients, courant, 0.0
    vorticity, packed = fourth_order_step(slope, vorticity, packed, dt, first)
    return vorticity, stage_rates.shifted(packed[:b], dt), courant, float(packed[b])


def midpoint(
    stage_rates: StageRates, vorticity: NDArray, coefficients: NDArray, dt: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """One step of the implicit midpoint rule, which keeps energy and enstrophy to the solver's tolerance.

    With vorticity at walls it keeps the energy alone. The third value is the last relative change: the step
    is to be shortened where that is not small.
    """
    n = len(vorticity)
    start = np.concatenate([vorticity, coefficients])

    def slope(middle: NDArray) -> NDArray[np.float64]:
        return np.concatenate(stage_rates.at(middle[:n], middle[n:], 0.5 * dt)[0][:2])

    after, change = implicit_midpoint(slope, start, dt, STREAM_SHARE * stage_rates.space.largest_stream_flux)
    return after[:n], stage_rates.shifted(after[n:], dt), change


class ConservativeTransport(FlowPhase):
    """Transport by an explicit Runge-Kutta step of order 4, or by the implicit midpoint rule.

    The Coriolis force is part of the rate of change, so that it does no work. The enstrophy that explicit
    steps lose is booked in the state, where no fluid crosses the boundary.

    Where fluid does, the vorticity that it carries in and what friction makes of it cancel there.
    In steps that take them in turn a steady flow errs by the step, so that the rate of the transport at the
    start is a source of the viscosity and the transport has what is beyond it (balanced splitting).

    R. L. Speth, W. H. Green, S. MacNamara, G. Strang, "Balanced splitting and rebalanced splitting", SIAM
    Journal on Numerical Analysis, 2013.
    """

    step_stage = "transport"

    def __init__(self, setting: FluidSetting, scheme: str) -> None:
        self.setting, self.space = setting, setting.space
        self.implicit = scheme == "midpoint"
        self.order = 2 if self.implicit else 4
        books_loss = not (self.implicit or setting.is_open)
        self.account = LossAccount(setting, ("enstrophy",), enstrophy=self._enstrophy) if books_loss else None
        setting.transport_takes_coriolis = True

    @property
    def at_walls(self) -> BoundaryVorticity | None:
        """Vorticity that walls have by friction; None without viscosity or walls."""
        return self.setting.boundary_vorticity if len(self.space.rim) else None

    def start(self) -> dict[str, NDArray]:
        return {} if self.account is None else self.account.start()

    def step_limit(self, state: FluidState) -> float:
        """Longest stable step of a state, up to which steps are halved; infinite with the midpoint rule."""
        if self.implicit:
            return math.inf
        space, courant = self.space, 0.0
        for time in [state.time] if space.lift_in_time is None else space.lift_in_time.times:
            phi = space.stream_function(state["vorticity"], time)
            flux = space.side_flux(phi, state["coefficients"])
            courant = max(courant, largest_rate(space, flux, self.setting.coriolis))
        return RK4_LIMIT / courant if courant > 0 else math.inf

    def balance(self, state: FluidState, dt: float) -> FlowRate | None:
        """The rate of change at a state with an open boundary, where a step of dt is stable with it."""
        setting = self.setting
        if not setting.is_open:
            return None
        vorticity, coefficients, flux = rate(
            self.space, state["vorticity"], state["coefficients"], setting.evolve_harmonic, setting.coriolis,
            state.time,
        )  # fmt: skip
        if not dt * largest_rate(self.space, flux, setting.coriolis) <= BALANCE_LIMIT:
            return None
        return vorticity, coefficients

    def advance(self, step: Step, state: FluidState) -> FluidState:
        space, setting = self.space, self.setting
        stage_rates = StageRates(
            space, setting.evolve_harmonic, setting.coriolis, step.balance, step.time, self.at_walls
        )
        start = (state["vorticity"], state["coefficients"], step.dt)
        added = 0.0
        if self.implicit:
            vorticity, coefficients, measure = midpoint(stage_rates, *start)
        else:
            vorticity, coefficients, measure, added = runge_kutta(stage_rates, *start, space.flow(state))
        if not measure <= (PICARD_TOLERANCE if self.implicit else RK4_LIMIT):
            raise StepRejected(
                "midpoint iteration" if self.implicit else Cause.STABILITY_LIMIT, value=measure
            )
        after = state.replaced(vorticity=vorticity, coefficients=coefficients)
        return after if self.account is None else self.account.booked(state, after, step.dt, added=added)

    def _enstrophy(self, state: FluidState) -> float:
        """Half the integral of the squared vorticity, with that of the frame, up to a constant [m^2/s^2]."""
        vorticity, added = state["vorticity"], 2.0 * np.asarray(self.setting.coriolis)
        return 0.5 * float(np.sum(vorticity * (vorticity * self.space.inverse_mass + added)))

    def observed(self, state: FluidState) -> Observation:
        return Observation(None) if self.account is None else self.account.observed(state)


def transport(setting: FluidSetting, parameters: Any) -> ConservativeTransport:
    """Transport phase of the integrator in [time]."""
    return ConservativeTransport(setting, parameters.scheme)
