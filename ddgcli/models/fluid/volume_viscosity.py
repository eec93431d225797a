"""Viscosity in volumes: implicit steps of the vorticity, with one value per edge.

The vorticity w of a flow u is the Whitney form with

    (w, t) = (u, curl t) + int n x u_wall . t      for all Whitney forms t of the edges,

and the flow changes by - nu curl w, which is a discrete flow again. An implicit step of both is one symmetric
positive definite system, (M + dt nu curl' curl) w = curl' u, and lowers the energy of any flow between walls
at rest. Two of them make a step of second order. Between walls of free slip the edges have no vorticity.
Elsewhere the velocity along the boundary is prescribed by the integral, and curl w also crosses the wall: a
pressure holds that back, so that P curl takes the place of curl, with the projection P on flows between the
walls, and conjugate gradients solve the system with the factors of the one without pressure.

J. C. Nedelec, "A new family of mixed finite elements in R^3", Numerische Mathematik, 1986.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, cg

from ddgcli.errors import SolveError
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
from ddgcli.simulation.model import StepRejected

MAX_FACTORS = 4  # of step lengths, kept at a time
MAX_DECAY = 1e10  # in a step, of the fastest vorticity: its pressure cancels all but six digits of it
TOLERANCE, MAX_ROUNDS = 1e-9, 1000  # of conjugate gradients beside walls without slip


class VolumeDiffusion(FlowPhase):
    """Viscosity: steps of Alexander's two-stage method (`diffusion.Decay`), together with forces."""

    effect = "viscosity"

    def __init__(self, setting: FluidSetting, nu: float) -> None:
        self.space, self.nu = setting.volume, nu
        cells = self.space.complex
        self.curl = cells.derivatives[1].astype(np.float64)
        self.mass = hodge_star(cells, 1)
        self.to_circulation = self.curl.T @ hodge_star(cells, 2)  # of fluxes without divergence
        self.stiffness = self.to_circulation @ self.curl
        self.in_time = None if self.space.conditions is None else self.space.conditions.velocity_in_time
        self.has_friction, self.slip_edges, self.wall = self._boundary()
        if self.in_time is not None:
            self.wall_in_time = InTime(lambda time: self._boundary(time)[2], self.in_time.times)
        self.rate = float((self.stiffness.diagonal() / self.mass.diagonal()).max(initial=0.0))  # in 1/m^2
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
        space, circulation = self.space, self._circulation(state, time)
        if not self.has_friction:
            vorticity = self._factor(dt).solve_held_at_zero(circulation, refine=False)
            return state.replaced(flux=state["flux"] - dt * self.nu * (self.curl @ vorticity))
        change = -dt * self.nu * (self.curl @ self._vorticity_with_pressure(circulation, dt))
        # most of it crosses the walls where nu dt is large: the second projection takes off its rounding
        within = space.projected(space.velocity(change), inflow=False)
        return space.accelerated(state, space.velocity(within))

    def _factor(self, dt: float) -> Dirichlet:
        if dt not in self._factors:
            if len(self._factors) >= MAX_FACTORS:
                self._factors.clear()
            if self.has_friction and dt * self.nu * self.rate > MAX_DECAY:
                raise SolveError(
                    f"viscosity of nu = {self.nu:g} in steps of {dt:.3g} s leaves no digit of the flow along "
                    "walls without slip; lessen nu or shorten the step"
                )
            self._factors[dt] = Dirichlet(self.mass + dt * self.nu * self.stiffness, self.slip_edges)
        return self._factors[dt]

    def _circulation(self, state: FluidState, time: float) -> NDArray[np.float64]:
        """(e,) circulations around the edges in m^2/s, with the velocities of the walls at a time."""
        space, velocity = self.space, self.space.cell_velocity(state)
        wall, stream = self.wall if self.in_time is None else self.wall_in_time.at(time), space.stream_in_time
        if stream is not None:  # walls without slip would stop the difference of two times at once
            velocity = velocity + space.velocity(stream.at(time) - stream.at(state.time))
        return space.edge_circulation(velocity) + wall

    def _vorticity_with_pressure(self, circulation: NDArray, dt: float) -> NDArray[np.float64]:
        """(e,) solution of (M + dt nu curl' P curl) w = circulation.

        Raises
        ------
        StepRejected
            Conjugate gradients do not end in MAX_ROUNDS rounds.
        """
        space, shape = self.space, self.mass.shape
        factor, load = self._factor(dt), circulation.copy()
        load[self.slip_edges] = 0.0

        def product(w: NDArray) -> NDArray:
            flux = space.projected(space.velocity(self.curl @ w), inflow=False)
            result = self.mass @ w + dt * self.nu * (self.to_circulation @ flux)
            result[self.slip_edges] = 0.0
            return result

        def without_pressure(load: NDArray) -> NDArray:
            return factor.solve_held_at_zero(load, refine=False)

        start = self._mass_factor.solve_held_at_zero(load, refine=False)  # right where the flow is steady
        matrix = LinearOperator(shape, product, dtype=np.float64)
        inverse = LinearOperator(shape, without_pressure, dtype=np.float64)
        w, status = cg(matrix, load, x0=start, rtol=TOLERANCE, maxiter=MAX_ROUNDS, M=inverse)
        if status:
            raise StepRejected(f"viscosity at walls was not solved in {MAX_ROUNDS} rounds")
        return w

    @cached_property
    def _mass_factor(self) -> Dirichlet:
        return Dirichlet(self.mass, self.slip_edges)

    def cell_acceleration(self, state: FluidState, time: float) -> NDArray[np.float64]:
        """(k, 3) what it adds to the velocity of the cells a second."""
        vorticity = self._mass_factor.solve_held_at_zero(self._circulation(state, time), refine=False)
        return self.space.velocity(-self.nu * (self.curl @ vorticity))
