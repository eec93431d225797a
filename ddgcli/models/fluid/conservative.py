"""Conservative advection: the Galerkin form of Euler's equation in piecewise constant velocities.

    (du/dt, w) = - int omega (n x u) . w      for all discrete flows w,

omega linear in every face. Tested with the stream functions' own flows this is the Jacobian of two piecewise
linear functions. Without time error it conserves kinetic energy (w = u), enstrophy, total vorticity and the
circulation along every boundary loop, on any mesh.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.models.fluid.midpoint import PICARD_TOLERANCE, implicit_midpoint
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.simulation.model import StepRejected

RK4_LIMIT = 2.8  # on the imaginary axis


def rate(
    space: SurfaceSpace, vorticity: NDArray, coefficients: NDArray, evolve_harmonic: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Time derivatives of vorticity and harmonic coefficients by Euler's equation.

    Parameters
    ----------
    space : SurfaceSpace
    vorticity : (n,) ndarray of float64
        Integrated over the cells.
    coefficients : (b,) ndarray of float64
    evolve_harmonic : bool
        Whether the harmonic coefficients change.

    Returns
    -------
    d_vorticity : (n,) ndarray of float64
    d_coefficients : (b,) ndarray of float64
    flux : (m, 3) ndarray of float64
        Through the sides.
    """
    phi = space.stream_function(vorticity)
    flux = space.side_flux(phi, coefficients)
    d_vorticity, d_coefficients = rotational_rates(
        space, vorticity * space.inverse_mass, flux, evolve_harmonic
    )
    outflow = space.outflow_head(phi, coefficients)
    if outflow is not None:
        d_vorticity += outflow[0]
        d_coefficients += outflow[1] if evolve_harmonic else 0.0
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


def advection_rate(space: SurfaceSpace, flux: NDArray) -> float:
    """Bound on the spectral radius of the transport: the largest absolute row sum."""
    row = 0.5 * sum_by_index(space.faces, np.abs(flux[:, NEXT]), space.n)
    return float((row * space.inverse_mass).max(initial=0.0))


def runge_kutta(
    space: SurfaceSpace, vorticity: NDArray, coefficients: NDArray, dt: float, evolve_harmonic: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """One classical fourth-order step; the third value is dt times `advection_rate` at its start."""
    k1, c1, flux = rate(space, vorticity, coefficients, evolve_harmonic)
    courant = dt * advection_rate(space, flux)
    if courant > RK4_LIMIT:
        return vorticity, coefficients, courant
    half = 0.5 * dt
    k2, c2, _ = rate(space, vorticity + half * k1, coefficients + half * c1, evolve_harmonic)
    k3, c3, _ = rate(space, vorticity + half * k2, coefficients + half * c2, evolve_harmonic)
    k4, c4, _ = rate(space, vorticity + dt * k3, coefficients + dt * c3, evolve_harmonic)
    sixth = dt / 6.0
    return (
        vorticity + sixth * (k1 + 2.0 * (k2 + k3) + k4),
        coefficients + sixth * (c1 + 2.0 * (c2 + c3) + c4),
        courant,
    )


def midpoint(
    space: SurfaceSpace, vorticity: NDArray, coefficients: NDArray, dt: float, evolve_harmonic: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """One step of the implicit midpoint rule, which keeps energy and enstrophy to the solver's tolerance.

    The third value is the last relative change: the step is to be shortened where that is not small.
    """
    n = len(vorticity)
    start = np.concatenate([vorticity, coefficients])

    def slope(middle: NDArray) -> NDArray[np.float64]:
        return np.concatenate(rate(space, middle[:n], middle[n:], evolve_harmonic)[:2])

    after, change = implicit_midpoint(slope, start, dt)
    return after[:n], after[n:], change


class ConservativeTransport(FlowPhase):
    """Transport by an explicit Runge-Kutta step of order 4, or by the implicit midpoint rule."""

    step_stage = "transport"

    def __init__(self, setting: FluidSetting, scheme: str) -> None:
        self.space, self.evolve_harmonic = setting.space, setting.evolve_harmonic
        self.implicit = scheme == "midpoint"
        self.order = 2 if self.implicit else 4

    def step_limit(self, state: FluidState) -> float:
        """Longest stable step of a state, up to which steps are halved; infinite with the midpoint rule."""
        if self.implicit:
            return math.inf
        phi = self.space.stream_function(state["vorticity"])
        courant = advection_rate(self.space, self.space.side_flux(phi, state["coefficients"]))
        return RK4_LIMIT / courant if courant > 0 else math.inf

    def advance(self, step: Step, state: FluidState) -> FluidState:
        scheme = midpoint if self.implicit else runge_kutta
        vorticity, coefficients, measure = scheme(
            self.space, state["vorticity"], state["coefficients"], step.dt, self.evolve_harmonic
        )
        if not measure <= (PICARD_TOLERANCE if self.implicit else RK4_LIMIT):
            raise StepRejected("midpoint iteration" if self.implicit else "stability", value=measure)
        return state.replaced(vorticity=vorticity, coefficients=coefficients)


def transport(setting: FluidSetting, parameters: Any) -> ConservativeTransport:
    """Transport phase of the integrator in [time]."""
    return ConservativeTransport(setting, parameters.scheme)
