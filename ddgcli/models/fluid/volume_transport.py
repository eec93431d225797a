"""Transport of a flow in a volume: by circulation, and by the implicit midpoint rule that keeps the energy.

`circulation` (chapter 9): the centroids of cells and faces are carried backwards; the circulation along every
piece of a dual edge, from the centroid of a cell to those of its faces, is measured where it came from, once
for all loops that it belongs to. Four numbers per cell make a velocity whose circulations around all edges
are these sums; one solve finds the discrete flow that has them. What a cell's own velocity has beyond the
vertices' stays with the cell. The step is repeated backwards and half of the error subtracted.

`energy`: (du/dt, w) = - (omega x u, w) for all discrete flows w, omega the mean of the vertices' weak curl.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.vectors import row_cross, row_dot
from ddgcli.models.fluid.loss_account import LossAccount
from ddgcli.models.fluid.midpoint import PICARD_TOLERANCE, implicit_midpoint
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Step
from ddgcli.models.fluid.smoothing import first_root
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.volume_space import VolumeSpace
from ddgcli.simulation.model import Cause, Observation, StepRejected


def rate(space: VolumeSpace, flux: NDArray, time: float = 0.0) -> NDArray[np.float64]:
    """Rate of change of the fluxes by Euler's equation.

    Parameters
    ----------
    space : VolumeSpace
    flux : (F,) ndarray of float64
        Through the faces.
    time : float
        Of what the boundary prescribes.

    Returns
    -------
    (F,) ndarray of float64
        Without what a change of the prescribed fluxes adds.
    """
    push, head = rotational_acceleration(space, flux, time)
    return space.projected(push, inflow=False, head=head)


def rotational_acceleration(
    space: VolumeSpace, flux: NDArray, time: float = 0.0
) -> tuple[NDArray, NDArray | None]:
    """Acceleration -omega x u of the cells, and the head at natural outflows.

    Parameters
    ----------
    space : VolumeSpace
    flux : (F,) ndarray of float64
        Through the faces.
    time : float
        Of what the boundary prescribes.

    Returns
    -------
    acceleration : (k, 3) ndarray of float64
    head : (F,) ndarray of float64 or None
        Half the square of the outward velocity; None without natural outflows.
    """
    velocity = space.velocity(flux)
    omega = space.vorticity(velocity, time)[space.cells].mean(axis=1)
    head = None
    if space.conditions is not None and space.conditions.natural.any():
        cell, i = space.boundary
        face, size = space.cell_face[cell, i], np.linalg.norm(space.area[cell, i], axis=1)
        head = np.zeros(space.n_faces)
        head[face] = 0.5 * (np.maximum(flux[face] * space.sign[cell, i], 0.0) / size) ** 2
        head[~space.conditions.natural] = 0.0
    return -row_cross(omega, velocity), head


class EnergyTransport(FlowPhase):
    """Implicit midpoint rule."""

    step_stage = "transport"

    def __init__(self, setting: FluidSetting) -> None:
        self.space = setting.volume

    def advance(self, step: Step, state: FluidState) -> FluidState:
        space, half = self.space, step.time + 0.5 * step.dt
        in_middle, in_step = (self._added(step.time, time) for time in (half, step.time + step.dt))

        def slope(middle: NDArray) -> NDArray[np.float64]:
            return rate(space, middle if in_middle is None else middle + in_middle, half)

        flux, change = implicit_midpoint(slope, state["flux"], step.dt, self._scale)
        if not change <= PICARD_TOLERANCE:
            raise StepRejected("midpoint iteration", value=change)
        return state.replaced(flux=flux if in_step is None else flux + in_step)

    def _added(self, start: float, time: float) -> NDArray[np.float64] | None:
        """(F,) what the flow that the boundary prescribes gains; None where it is constant."""
        stream = self.space.stream_in_time
        return None if stream is None else stream.at(time) - stream.at(start)

    @cached_property
    def _scale(self) -> float:
        """Largest flux that the boundary prescribes in the run, where it depends on time [m^3/s]."""
        stream = self.space.stream_in_time
        return 0.0 if stream is None else max(float(np.abs(stream.at(time)).max()) for time in stream.times)


def without_rise(space: VolumeSpace, flux: NDArray, smooth: NDArray, energy: float) -> NDArray[np.float64]:
    """Mix a flow with just as much of a smooth one as keeps the energy from rising; else scale it.

    Parameters
    ----------
    space : VolumeSpace
    flux, smooth : (F,) ndarray of float64
        Fluxes through the faces.
    energy : float
        Not to be exceeded.

    Returns
    -------
    (F,) ndarray of float64
    """
    velocity, change = space.velocity(flux), space.velocity(smooth - flux)
    slope = float(np.sum(space.volume[:, None] * velocity * change))
    excess = space.kinetic_energy(velocity) - energy
    mixed = flux + first_root(excess, slope, space.kinetic_energy(change)) * (smooth - flux)
    energy_after = space.kinetic_energy(space.velocity(mixed))
    return mixed * min(1.0, (energy / energy_after) ** 0.5) if energy_after > 0 else mixed


class VolumeCirculationTransport(FlowPhase):
    """Dual edges carried backwards; what it loses is booked in the state."""

    step_stage = "transport"

    def __init__(self, setting: FluidSetting) -> None:
        self.space, self.paths = setting.volume, setting.volume_paths
        self.account = LossAccount(setting, ("energy",))
        space = self.space
        self.cell_of_face = np.zeros(space.n_faces, dtype=np.int64)
        self.cell_of_face[space.cell_face.ravel()] = np.repeat(np.arange(len(space.cells)), 4)
        self.face_centre = np.zeros((space.n_faces, 3))
        self.face_centre[space.cell_face.ravel()] = space.face_centre.reshape(-1, 3)

    def start(self) -> dict[str, NDArray]:
        return self.account.start()

    def _circulations(self, vertex_velocity: NDArray, ends: tuple) -> NDArray[np.float64]:
        """(k, 4) circulation along the carried pieces from cells to their faces."""
        (cell, centre), (face_cell, face) = ends
        at_centre = self.paths.interpolated(vertex_velocity, cell, centre)
        at_face = self.paths.interpolated(vertex_velocity, face_cell, face)[self.space.cell_face]
        piece = face[self.space.cell_face] - centre[:, None]
        return 0.5 * row_dot(at_centre[:, None] + at_face, piece)

    def _ends(self, vertex_velocity: NDArray, dt: float) -> tuple:
        space, paths = self.space, self.paths
        cells = np.arange(len(space.cells))
        if dt == 0:
            return (cells, space.centre), (self.cell_of_face, self.face_centre)
        return (
            paths.carried(vertex_velocity, cells, space.centre, dt),
            paths.carried(vertex_velocity, self.cell_of_face, self.face_centre, dt),
        )

    def _carried(self, velocity: NDArray, ends: tuple, here: tuple, smooth: bool = False) -> NDArray:
        """(F,) fluxes of the flow with the circulations of the carried loops."""
        space = self.space
        at_vertices = space.vertex_means(velocity)
        change = self._circulations(at_vertices, ends)
        if smooth:
            return space.projected(space.broken_gradient(change))
        change -= self._circulations(at_vertices, here)
        return space.projected(velocity + space.broken_gradient(change))

    def advance(self, step: Step, state: FluidState) -> FluidState:
        space, dt = self.space, step.dt
        velocity = space.cell_velocity(state)
        middle = space.velocity(state["flux"] + 0.5 * dt * rate(space, state["flux"], step.time))
        carrier = space.vertex_means(middle)
        here, back, forth = (self._ends(carrier, t) for t in (0.0, dt, -dt))
        there = space.velocity(self._carried(velocity, back, here))
        again = space.velocity(self._carried(there, forth, here))
        flux = self._carried(1.5 * velocity - 0.5 * again, back, here)
        energy, energy_after = space.kinetic_energy(velocity), space.kinetic_energy(space.velocity(flux))
        if not np.isfinite(energy_after):
            raise StepRejected(Cause.NOT_FINITE)
        if energy_after > energy:
            flux = without_rise(space, flux, self._carried(velocity, back, here, smooth=True), energy)
        return self.account.booked(state, state.replaced(flux=flux), dt)

    def observed(self, state: FluidState) -> Observation:
        return self.account.observed(state)


def transport(setting: FluidSetting, parameters: Any) -> VolumeCirculationTransport | EnergyTransport:
    """Transport phase of the integrator in [time]."""
    return (
        EnergyTransport(setting) if parameters.integrator == "energy" else VolumeCirculationTransport(setting)
    )
