"""Advection by circulation: each dual loop is carried backwards and takes the circulation at its end.

By Kelvin's theorem the circulation along a loop that moves with the flow is constant. The circulation of each
dual edge is measured once and counted with opposite signs for its two loops, so that the total vorticity is
exact; the new flow is the one whose circulations against all discrete flows agree (a projection).

Loops are carried by the flow of mid-step and meet a velocity that is linear in every face (`recovery`); what
a face's own velocity has beyond it stays with the face, so that a step of length zero is the identity. The
step is repeated backwards and half its error subtracted (Dupont and Liu, "Back and forth error compensation",
2003): of second order in space and time, stable for steps of any length. Where energy or enstrophy would
rise, just enough smoothing is mixed in that neither does.

S. Elcott et al., "Stable, circulation-preserving, simplicial fluids", ACM Transactions on Graphics, 2007.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.models.fluid.conservative import rate
from ddgcli.models.fluid.limits import (
    ENERGY_RISE_TOLERANCE,
    MAX_DEFORMATION,
    SMALL_DEFORMATION,
    Flow,
    FlowLimits,
    along_walls,
    keep_total,
)
from ddgcli.models.fluid.loss_account import LossAccount
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Step
from ddgcli.models.fluid.state import CORRECTIONS, FluidState
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.models.fluid.transport import BackwardPaths, Transport
from ddgcli.simulation.model import Observation, StepRejected


@dataclass(frozen=True, eq=False)
class LoopPaths:
    """Where a step's loops come from.

    Parameters
    ----------
    centre : BackwardPaths
        The centres of the faces.
    near, far : (e,) ndarray of complex
        Conjugate carried halves of the inner dual edges in their left and right faces.
    rim : BackwardPaths, or None without boundary
        The boundary vertices.
    """

    centre: BackwardPaths
    near: NDArray[np.complex128]
    far: NDArray[np.complex128]
    rim: BackwardPaths | None


class CirculationAdvection:
    """Dual edges of a surface, ready for steps of any length."""

    def __init__(self, space: SurfaceSpace, transport: Transport | None = None) -> None:
        self.space = space
        self.transport = transport or Transport(space)
        self.limits = FlowLimits(space)
        topology = space.mesh.topology
        twin = topology.side_twin.ravel()
        side = np.flatnonzero((twin >= 0) & (topology.side_sign.ravel() > 0))
        other = twin[side]
        self.edge = topology.side_edge.ravel()[side]
        self.left, self.right = side // 3, other // 3
        # from the frame of the right face to that of the left, unfolded about the edge
        turn = -space.side.ravel()[side] / space.side.ravel()[other]
        self.turn = turn / np.abs(turn)
        head = space.corner[self.right, (other % 3 + 1) % 3]
        hinge = space.corner.ravel()[side]
        centre = space.corner.mean(axis=1)
        far = hinge + self.turn * (centre[self.right] - head)
        middle = hinge + 0.5 * space.side.ravel()[side]
        near_part, far_part = middle - centre[self.left], far - middle
        self.near_part, self.far_part = np.conj(near_part), np.conj(far_part) * self.turn
        reach, reach_far = np.abs(near_part), np.abs(far_part)
        self.share = reach / (reach + reach_far)
        self.third = np.full((len(space.faces), 3), 1.0 / 3.0)
        self.rim = np.flatnonzero(topology.boundary_vertex)

    def step(
        self,
        vorticity: NDArray,
        coefficients: NDArray,
        dt: float,
        evolve_harmonic: bool,
        most: float = np.inf,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float, NDArray[np.float64]]:
        """Vorticity and harmonic coefficients after dt, the `deformation`, the relative rise of the energy.

        The last value holds the `CORRECTIONS`. A deformation above `most` changes no flow.
        """
        space = self.space
        start = vorticity, coefficients
        d_vorticity, d_coefficients, flux = rate(space, vorticity, coefficients, evolve_harmonic)
        change = space.side_flux(space.stream_function_change(d_vorticity), d_coefficients)
        corner = self.transport.corners(flux + 0.5 * dt * change)
        folded = self.limits.deformation(corner, dt)
        if not folded <= most:
            return vorticity, coefficients, folded, 0.0, np.zeros(len(CORRECTIONS))
        back, forth = self._loop_paths(corner, dt), self._loop_paths(corner, -dt)
        flux = flux - space.side_flux(np.zeros(space.n), coefficients)
        there = self._advected(back, start, flux, evolve_harmonic)
        again = self._advected(forth, there, self._flux(there), evolve_harmonic)
        corrected = 1.5 * start[0] - 0.5 * again[0], 1.5 * start[1] - 0.5 * again[1]
        advected = self._advected(back, corrected, self._flux(corrected), evolve_harmonic)

        def smooth() -> Flow:
            return self._advected(back, start, flux, evolve_harmonic, smooth=True)

        after, rise, acted = self.limits.limited(start, advected, smooth)
        return *after, folded, rise, acted

    def _flux(self, flow: Flow) -> NDArray[np.float64]:
        """(m, 3) flux through the sides of a flow without its harmonic part."""
        return self.space.side_flux(self.space.stream_function(flow[0]), np.zeros(0))

    def _loop_paths(self, corner: NDArray, dt: float) -> LoopPaths:
        transport = self.transport
        centre = transport.backwards(corner, np.arange(len(corner)), self.third, dt)
        stretch = np.conj(self.turn * centre.shift[self.right] - centre.shift[self.left])
        near = self.near_part + self.share * stretch
        far = self.far_part + (1.0 - self.share) * stretch * self.turn
        rim = transport.vertices_backwards(corner, self.rim, dt) if len(self.rim) else None
        return LoopPaths(centre, near, far, rim)

    def _advected(
        self, paths: LoopPaths, flow: Flow, flux: NDArray, evolve: bool, smooth: bool = False
    ) -> Flow:
        """The flow along the traced loops; `smooth`: without what a face has beyond the vertices' flow.

        `flux` is that of the flow without its harmonic part. Around loops that the flow carries a harmonic
        flow keeps its circulations: it is kept as it is, and gains what the rest has of it at the end.
        """
        space, left, right = self.space, self.left, self.right
        corner = self.transport.corners(flux)
        at_ends = self.transport.end_velocity(corner, paths.centre)
        own = space.face_velocity(flux) - corner.mean(axis=1)
        carried = (at_ends[left] * paths.near + at_ends[right] * paths.far).real
        face_own = (own[left] * self.near_part + own[right] * self.far_part).real
        circulation = np.zeros(space.mesh.topology.n_edges)
        circulation[self.edge] = carried if smooth else carried + face_own
        after = np.where(
            space.inside, space.circulation_around(circulation), along_walls(space, paths.rim, flow[0])
        )
        keep_total(space, after, flow[0])
        coefficients = flow[1]
        if evolve and len(coefficients):
            coefficients = flow[1] + space.harmonic[:, self.edge] @ (carried + face_own)
        return after, coefficients


class CirculationTransport(FlowPhase):
    """Transport by loops that are carried backwards; its losses are booked in the state."""

    step_stage = "transport"

    def __init__(self, setting: FluidSetting) -> None:
        self.evolve_harmonic = setting.evolve_harmonic
        self.advection = CirculationAdvection(setting.space, setting.tracing)
        self.account = LossAccount(setting, ("energy", "enstrophy"), corrects=True)

    def start(self) -> dict[str, NDArray]:
        return self.account.start()

    def advance(self, step: Step, state: FluidState) -> FluidState:
        before = state["vorticity"], state["coefficients"]
        vorticity, coefficients, folded, rise, acted = self.advection.step(
            *before, step.dt, self.evolve_harmonic, MAX_DEFORMATION
        )
        if not folded <= MAX_DEFORMATION:
            raise StepRejected("loops fold", value=folded)
        if folded > SMALL_DEFORMATION and not rise <= ENERGY_RISE_TOLERANCE:
            raise StepRejected("energy rises", value=rise)
        after = state.replaced(vorticity=vorticity, coefficients=coefficients)
        return self.account.booked(state, after, step.dt, acted)

    def observed(self, state: FluidState) -> Observation:
        return self.account.observed(state)


def transport(setting: FluidSetting, parameters: Any) -> CirculationTransport:
    """Transport phase of the integrator in [time]."""
    return CirculationTransport(setting)
