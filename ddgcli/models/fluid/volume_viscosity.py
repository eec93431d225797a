"""Viscosity in volumes: implicit steps of the vorticity, with one value per edge.

The vorticity w of a flow u is the Whitney form with

    (w, t) = (u, curl t) + int n x u_wall . t      for all Whitney forms t of the edges,

and the flow changes by - nu curl w, which is a discrete flow again. An implicit step of both is one symmetric
positive definite system, (M + dt nu curl' curl) w = curl' u, and lowers the energy of any flow between walls
at rest. Two of them make a step of second order between walls of free slip, where the edges have no
vorticity. Elsewhere the velocity along the boundary is prescribed by the integral, and the projection takes
off what would cross a wall: of first order in time.

J. C. Nedelec, "A new family of mixed finite elements in R^3", Numerische Mathematik, 1986.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.cells import TET_EDGES
from ddgcli.linalg.constrain import Dirichlet
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.vectors import row_cross
from ddgcli.models.fluid.boundary_motion import InTime
from ddgcli.models.fluid.diffusion import GAMMA
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.operators.stars import hodge_star

MAX_FACTORS = 4  # of step lengths, kept at a time


class VolumeDiffusion(FlowPhase):
    """Viscosity: steps of Alexander's two-stage method (`diffusion.Decay`), together with forces."""

    effect = "viscosity"

    def __init__(self, setting: FluidSetting, nu: float) -> None:
        self.space, self.nu = setting.volume, nu
        cells = self.space.complex
        self.curl = cells.derivatives[1].astype(np.float64)
        self.mass = hodge_star(cells, 1)
        self.stiffness = self.curl.T @ hodge_star(cells, 2) @ self.curl
        self.in_time = None if self.space.conditions is None else self.space.conditions.velocity_in_time
        self.has_friction, self.slip_edges, self.wall = self._boundary()
        if self.in_time is not None:
            self.wall_in_time = InTime(lambda time: self._boundary(time)[2], self.in_time.times)
        self.order = 1 if self.has_friction else 2  # what crosses a wall is projected off after each stage
        self._factors: dict[float, Dirichlet] = {}

    def _boundary(self, time: float = 0.0) -> tuple[bool, NDArray[np.int64], NDArray[np.float64]]:
        """Whether a velocity along the boundary is prescribed, edges without vorticity, (e,) the integral."""
        space, cells = self.space, self.space.complex
        cell, i = space.boundary
        conditions = space.conditions
        if conditions is None:
            return False, unique_keys(cells.face_edge[space.cell_face[cell, i]]), np.zeros(cells.counts[1])
        friction = conditions.friction | conditions.natural[space.cell_face[cell, i]]
        slip_edges = unique_keys(cells.face_edge[space.cell_face[cell, i][~friction]])
        cell, i = cell[friction], i[friction]
        turned = row_cross(space.area[cell, i], conditions.velocity_at(time)[friction])
        tail, head = np.array(TET_EDGES).T
        mean = (space.slope[cell][:, head] - space.slope[cell][:, tail]) / 3.0  # of the form of an edge
        value = np.einsum("sja,sa->sj", mean, turned) * cells.cell_edge_sign[cell]
        value[(tail == i[:, None]) | (head == i[:, None])] = 0.0  # no component along the face
        return bool(friction.any()), slip_edges, sum_by_index(cells.cell_edge[cell], value, cells.counts[1])

    def advance(self, step: Step, state: FluidState) -> FluidState:
        return self.advance_forced(step, state, state)

    def advance_forced(self, step: Step, state: FluidState, forced: FluidState) -> FluidState:
        """The step of a state; `forced` is the state with what forces add in it.

        Both stages of the method are implicit Euler steps of GAMMA dt, the second from a flow on the line
        through the start and the end of the first.
        """
        span, start = GAMMA * step.dt, state["flux"]
        times = step.time + span, step.time + step.dt
        push = GAMMA * (forced["flux"] - start)
        first = self._implicit_euler(forced.replaced(flux=start + push), span, times[0])
        between = start + (1.0 - GAMMA) / GAMMA * (first["flux"] - start)
        return self._implicit_euler(first.replaced(flux=between + push), span, times[1])

    def _implicit_euler(self, state: FluidState, dt: float, time: float) -> FluidState:
        """The state after dt, with the walls of a `time`."""
        space = self.space
        change = -dt * self.nu * (self.curl @ self._vorticity(state, self._factor(dt), time))
        if self.has_friction:
            return space.accelerated(state, space.velocity(change))
        return state.replaced(flux=state["flux"] + change)

    def _factor(self, dt: float) -> Dirichlet:
        if dt not in self._factors:
            if len(self._factors) >= MAX_FACTORS:
                self._factors.clear()
            self._factors[dt] = Dirichlet(self.mass + dt * self.nu * self.stiffness, self.slip_edges)
        return self._factors[dt]

    def _vorticity(self, state: FluidState, solver: Dirichlet, time: float) -> NDArray[np.float64]:
        """(e,) vorticity along the edges, by a factorisation of their mass or of a step."""
        space, velocity = self.space, self.space.cell_velocity(state)
        wall, stream = self.wall if self.in_time is None else self.wall_in_time.at(time), space.stream_in_time
        if stream is not None:  # walls without slip would stop the difference of two times at once
            velocity = velocity + space.velocity(stream.at(time) - stream.at(state.time))
        circulation = space.edge_circulation(velocity) + wall
        return solver.solve_held_at_zero(circulation, refine=False)

    @cached_property
    def _mass_factor(self) -> Dirichlet:
        return Dirichlet(self.mass, self.slip_edges)

    def cell_acceleration(self, state: FluidState, time: float) -> NDArray[np.float64]:
        """(k, 3) what it adds to the velocity of the cells a second."""
        vorticity = self._vorticity(state, self._mass_factor, time)
        return self.space.velocity(-self.nu * (self.curl @ vorticity))
