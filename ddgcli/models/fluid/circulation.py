"""Advection by circulation: each dual loop is carried backwards and takes the circulation at its end.

By Kelvin's theorem the circulation along a loop that moves with the flow stays. The circulation of each dual
edge is measured once and counted with opposite signs for its two loops, so that the total vorticity is
exact; the new flow is the one whose circulations against all discrete flows agree (a projection).

Loops are carried by the flow of mid-step and meet a velocity that is linear in every face (`recovery`); what
a face's own velocity has beyond it stays with the face, so that a step of length zero is the identity. The
step is made forth and back and its error taken off (Dupont and Liu, "Back and forth error compensation",
2003): of second order in space and time, stable for steps of any length. Where energy or enstrophy would
rise, just enough smoothing is mixed in that neither does.

S. Elcott et al., "Stable, circulation-preserving, simplicial fluids", ACM Transactions on Graphics, 2007.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.models.fluid.conservative import rate
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Step
from ddgcli.models.fluid.smoothing import Smoothing, first_root, share_at_constant_energy
from ddgcli.models.fluid.state import CORRECTIONS, FluidState
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.models.fluid.transport import BackwardPaths, Transport, corner_of
from ddgcli.simulation.model import Observation, StepRejected

MAX_DEFORMATION = 1.0  # change of the velocity along a side times dt over its length, beyond which loops fold
ENERGY_RISE_TOLERANCE = 1e-6  # relative rise of the kinetic energy at which a step is shortened
ENERGY_ROUNDING = 1e-12  # relative rise of the energy that counts as none
SMALL_DEFORMATION = 0.02  # deformation below which a step is taken as it is: a shorter one would be no better
Flow = tuple[NDArray[np.float64], NDArray[np.float64]]  # vorticity (n,), harmonic coefficients (b,)


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
        self.smoothing = Smoothing(space)
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
        self.rim_face, self.rim_corner = corner_of(space, self.rim)
        length = space.mesh.side_length
        self.size = np.maximum(length, 0.5 * np.median(length))

    def deformation(self, corner: NDArray, dt: float) -> float:
        """Largest change of the velocity along a side, times dt over its length: from about 1 on loops fold.

        Sides far shorter than most count as longer: what folds among them is lost in their neighbours.
        """
        change = np.abs(corner[:, NEXT] - corner)
        return dt * float((change / self.size).max(initial=0.0))

    def step(
        self,
        vorticity: NDArray,
        coefficients: NDArray,
        dt: float,
        evolve_harmonic: bool,
        most: float = np.inf,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float, NDArray[np.bool_]]:
        """Vorticity and harmonic coefficients after dt, the `deformation`, the relative rise of the energy.

        The last value says which of `CORRECTIONS` acted. A deformation above `most` leaves the flow as it is.
        """
        space = self.space
        start = vorticity, coefficients
        d_vorticity, d_coefficients, flux = rate(space, vorticity, coefficients, evolve_harmonic)
        change = space.side_flux(space.stream_function_change(d_vorticity), d_coefficients)
        corner = self.transport.corners(flux + 0.5 * dt * change)
        folded = self.deformation(corner, dt)
        if not folded <= most:
            return vorticity, coefficients, folded, 0.0, np.zeros(len(CORRECTIONS), dtype=bool)
        back, forth = self._loop_paths(corner, dt), self._loop_paths(corner, -dt)
        there = self._advected(back, start, flux, evolve_harmonic)
        again = self._advected(forth, there, self._flux(there), evolve_harmonic)
        mended = 1.5 * start[0] - 0.5 * again[0], 1.5 * start[1] - 0.5 * again[1]
        advected = self._advected(back, mended, self._flux(mended), evolve_harmonic)
        energy, enstrophy = self._energy(start), space.enstrophy(vorticity)
        after, reached = self._without_rise(back, start, flux, advected, energy, evolve_harmonic)
        rise = reached / energy - 1.0 if energy > 0 else 0.0
        mixed = after is not advected
        filtered = space.enstrophy(after[0]) > (1.0 + ENERGY_ROUNDING) * enstrophy
        after = self._without_enstrophy_rise(after, enstrophy)
        reached, scaled = self._energy(after), False
        if reached > energy and (folded <= SMALL_DEFORMATION or rise <= ENERGY_ROUNDING):
            scaled = reached > (1.0 + ENERGY_ROUNDING) * energy
            after = self._at_energy(after, reached, energy)
        return *after, folded, rise, np.array([mixed, filtered, scaled])

    def _energy(self, flow: Flow) -> float:
        return self.space.kinetic_energy(self.space.stream_function(flow[0]), *flow)

    def _flux(self, flow: Flow) -> NDArray[np.float64]:
        return self.space.side_flux(self.space.stream_function(flow[0]), flow[1])

    def _loop_paths(self, corner: NDArray, dt: float) -> LoopPaths:
        transport = self.transport
        centre = transport.backwards(corner, np.arange(len(corner)), self.third, dt)
        stretch = np.conj(self.turn * centre.shift[self.right] - centre.shift[self.left])
        near = self.near_part + self.share * stretch
        far = self.far_part + (1.0 - self.share) * stretch * self.turn
        rim = None
        if len(self.rim):
            rim = transport.backwards(corner, self.rim_face, np.eye(3)[self.rim_corner], dt)
        return LoopPaths(centre, near, far, rim)

    def _advected(
        self, paths: LoopPaths, flow: Flow, flux: NDArray, evolve: bool, smooth: bool = False
    ) -> Flow:
        """The flow along the traced loops; `smooth`: without what a face has beyond the vertices' flow."""
        space, left, right = self.space, self.left, self.right
        corner = self.transport.corners(flux)
        at_ends = self.transport.end_velocity(corner, paths.centre)
        along = at_ends[left] * paths.near + at_ends[right] * paths.far
        if not smooth:
            own = space.face_velocity(flux) - corner.mean(axis=1)
            along += own[left] * self.near_part + own[right] * self.far_part
        circulation = np.zeros(space.mesh.topology.n_edges)
        circulation[self.edge] = along.real
        after = np.where(
            space.inside, space.circulation_around(circulation), self._along_walls(paths, flow[0])
        )
        self._keep_total(after, flow[0])
        coefficients = flow[1]
        if evolve and len(coefficients):
            coefficients = space.harmonic @ circulation
        return after, coefficients

    def _without_rise(
        self, paths: LoopPaths, start: Flow, flux: NDArray, after: Flow, energy: float, evolve: bool
    ) -> tuple[Flow, float]:
        """Mixed with just as much of the smooth step as keeps the energy from rising; the energy reached."""
        space = self.space
        phi = space.stream_function(after[0])
        reached = space.kinetic_energy(phi, *after)
        if reached <= energy:
            return after, reached
        smooth = self._advected(paths, start, flux, evolve, smooth=True)
        change, turn = smooth[0] - after[0], smooth[1] - after[1]
        phi_change = space.stream_function_change(change)
        slope = float(phi @ (space.stiffness @ phi_change) + after[1] @ turn)
        curvature = space.kinetic_energy(phi_change, change, turn)
        share = first_root(reached - energy, slope, curvature)
        mixed = after[0] + share * change, after[1] + share * turn
        return mixed, reached + share * (slope + share * curvature)

    def _without_enstrophy_rise(self, flow: Flow, most: float) -> Flow:
        """Filtered until the enstrophy is at most `most`; the energy that the filter takes is put back.

        What a filter takes of the energy is taken at every step, however short. Scaling the filtered flow
        back to the energy before raises the enstrophy less than the filter lowered it, so a share of the
        filter exists that does both, as in the anticipated potential vorticity method (R. Sadourny and
        C. Basdevant, Journal of the Atmospheric Sciences, 1985).
        """
        space, vorticity = self.space, flow[0]
        if not space.enstrophy(vorticity) > most:
            return flow
        phi = space.stream_function_change(vorticity)
        change = self.smoothing.change(vorticity)
        phi_change = space.stream_function_change(change)
        enstrophy = (
            space.enstrophy(vorticity),
            float(vorticity @ (space.inverse_mass * change)),
            space.enstrophy(change),
        )
        none = np.zeros(0)
        energy = (
            space.kinetic_energy(phi, vorticity, none),
            float(phi @ (space.stiffness @ phi_change)),
            space.kinetic_energy(phi_change, change, none),
        )
        if not energy[0] > ENERGY_ROUNDING * 0.5 * float(flow[1] @ flow[1]):  # vorticity that is rounding
            return self.smoothing.without_rise(vorticity, most), flow[1]
        share, gain = share_at_constant_energy(enstrophy, energy, most)
        filtered = vorticity + share * change
        scaled = np.where(space.inside, gain * filtered, filtered)
        self._keep_total(scaled, filtered)
        if space.enstrophy(scaled) > space.enstrophy(vorticity):
            scaled = filtered
        return self.smoothing.without_rise(scaled, most), flow[1]

    def _at_energy(self, flow: Flow, reached: float, energy: float) -> Flow:
        """The vorticity scaled to `energy`, a last resort on bad meshes."""
        fixed = 0.5 * float(flow[1] @ flow[1])
        if not reached > fixed:
            return flow
        share = (max(energy - fixed, 0.0) / (reached - fixed)) ** 0.5
        scaled = np.where(self.space.inside, share * flow[0], flow[0])
        self._keep_total(scaled, flow[0])
        return scaled, flow[1]

    def _along_walls(self, paths: LoopPaths, vorticity: NDArray) -> NDArray[np.float64]:
        """Vorticity of the cells at the boundary: carried along it, point by point."""
        if paths.rim is None:
            return vorticity
        space = self.space
        omega = (vorticity * space.inverse_mass)[space.faces[paths.rim.face]]
        after = np.array(vorticity)
        after[self.rim] = space.mass[self.rim] * np.einsum("ij,ij->i", omega, paths.rim.barycentric)
        return after

    def _keep_total(self, after: NDArray, before: NDArray) -> None:
        """What the inner loops of a component gained comes from its boundary cells."""
        space = self.space
        rim = space.mesh.topology.boundary_vertex
        if not rim.any():
            return
        label = space.mesh.topology.vertex_component
        missing = space.component_vorticity(before) - space.component_vorticity(after)
        area = sum_by_index(label[rim], space.mass[rim], len(missing))
        share = np.divide(missing, area, out=np.zeros_like(missing), where=area > 0)
        after[rim] += space.mass[rim] * share[label[rim]]


class CirculationTransport(FlowPhase):
    """Transport by loops that are carried backwards; its losses are booked in the state."""

    step_stage = "transport"

    def __init__(self, setting: FluidSetting) -> None:
        self.evolve_harmonic = setting.evolve_harmonic
        self.advection = CirculationAdvection(setting.space, setting.tracing)

    def start(self) -> dict[str, NDArray]:
        return {"loss": np.zeros(2), "corrections": np.zeros(1 + len(CORRECTIONS))}

    def advance(self, step: Step, state: FluidState) -> FluidState:
        space, before = self.advection.space, (state["vorticity"], state["coefficients"])
        vorticity, coefficients, folded, rise, acted = self.advection.step(
            *before, step.dt, self.evolve_harmonic, MAX_DEFORMATION
        )
        if not folded <= MAX_DEFORMATION:
            raise StepRejected("loops fold", value=folded)
        if folded > SMALL_DEFORMATION and not rise <= ENERGY_RISE_TOLERANCE:
            raise StepRejected("energy rises", value=rise)
        after = state.replaced(vorticity=vorticity, coefficients=coefficients)
        lost = space.energy(state) - space.energy(after)
        smoothed = space.enstrophy(before[0]) - space.enstrophy(vorticity)
        return after.with_passive(
            loss=state["loss"] + np.array([lost, smoothed]),
            corrections=state["corrections"] + np.array([1, *acted]),
        )

    def observed(self, state: FluidState) -> Observation:
        energy, enstrophy = state["loss"]
        return Observation(
            None,
            {},
            {
                "lost_energy": float(energy),
                "lost_enstrophy": float(enstrophy),
                "corrections": state["corrections"],
            },
        )


def transport(setting: FluidSetting, parameters: Any) -> CirculationTransport:
    """The phase that [time] asks for."""
    return CirculationTransport(setting)
