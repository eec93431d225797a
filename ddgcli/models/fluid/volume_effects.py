"""Effects in volumes: the flow at the start, viscosity, and tracers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from ddgcli.linalg.constrain import Dirichlet
from ddgcli.mesh.tet_mesh import TET_FACES
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.effect_parts import Initial
from ddgcli.models.fluid.flows import VOLUME_FLOWS
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.tracer import Bounds, conserved
from ddgcli.models.fluid.volume_space import VolumeSpace
from ddgcli.operators.stars import hodge_star


def initial(parameters: Any, context: FluidContext) -> Initial:
    """The discrete flow nearest to a velocity or to a flow by name.

    Parameters
    ----------
    parameters : object
        Of the effect.
    context : FluidContext

    Returns
    -------
    Initial

    Raises
    ------
    ValueError
        For a vorticity, and for flows of surfaces.
    """
    if parameters.vorticity is not None:
        raise ValueError("vorticity is that of surfaces; in a volume give velocity or flow")
    if parameters.velocity is not None:
        vectors = context.face_vectors(parameters.velocity)
    elif parameters.flow in VOLUME_FLOWS:
        vectors = VOLUME_FLOWS[parameters.flow].velocity(context, parameters)
    else:
        names = ", ".join(VOLUME_FLOWS)
        raise ValueError(f"flow {parameters.flow!r} is one of surfaces; volumes have {names}")
    return Initial(lambda space: {"flux": space.projected(vectors, inflow=False)})


class ImplicitDiffusion:
    """Implicit steps of M + dt L on values some of which are held.

    Parameters
    ----------
    mass : (k,) ndarray
    stiffness : (k, k) sparse array
        Times the coefficient of diffusion.
    fixed : (f,) ndarray of int64, sorted
    """

    def __init__(self, mass: NDArray, stiffness: csr_array, fixed: NDArray) -> None:
        self.mass, self.stiffness, self.fixed = mass, stiffness, fixed
        self._solvers: dict[float, Dirichlet] = {}

    def step(self, values: NDArray, wall_values: NDArray, dt: float) -> NDArray[np.float64]:
        """(k, c) values after dt, `held` (f, c) at the fixed ones; one factorisation per step length."""
        if dt not in self._solvers:
            if len(self._solvers) > 3:
                self._solvers.clear()
            self._solvers[dt] = Dirichlet(diags_array(self.mass) + dt * self.stiffness, self.fixed)
        return self._solvers[dt].solve(wall_values, self.mass[:, None] * values, refine=False)


def vertex_stiffness(space: VolumeSpace) -> csr_array:
    """Stiffness matrix of functions that are linear in every cell.

    Parameters
    ----------
    space : VolumeSpace

    Returns
    -------
    (n, n) csr_array of float64
        Positive semidefinite, a length.
    """
    derivative = space.complex.derivatives[0].astype(np.float64)
    return (derivative.T @ hodge_star(space.complex, 1) @ derivative).tocsr()


class VolumeDiffusion(FlowPhase):
    """Viscosity: the vertices' velocities diffuse, cells take the change, the flow is projected.

    What cells have beyond their vertices would stay: it changes over a cell, and decays by 1 / (1 + a^2),
    a = nu dt / V^(2/3), which vanishes with the second power of the step.
    """

    effect = "viscosity"
    order = 1

    def __init__(self, setting: FluidSetting, nu: float) -> None:
        self.space = space = setting.volume
        wall_vertices, self.wall = _wall_vertices(space)
        unused = np.flatnonzero(space.mass == 0)
        self.wall = np.concatenate([self.wall, np.zeros((len(unused), 3))])
        order = np.argsort(np.concatenate([wall_vertices, unused]))
        fixed = np.concatenate([wall_vertices, unused])[order]
        self.wall = self.wall[order]
        self.diffusion = ImplicitDiffusion(space.mass, nu * vertex_stiffness(space), fixed)
        self.cell_rate = nu / np.cbrt(space.volume) ** 2

    def advance_forced(self, step: Step, state: FluidState, forced: FluidState) -> FluidState:
        """The step of a state in which forces have acted: their balance with an implicit Euler step."""
        return self.advance(step, forced)

    def advance(self, step: Step, state: FluidState) -> FluidState:
        at_vertices, cells = self._vertex_velocity(state), self.space.cells
        change = self.diffusion.step(at_vertices, self.wall, step.dt) - at_vertices
        share = (step.dt * self.cell_rate) ** 2
        beyond = self.space.cell_velocity(state) - at_vertices[cells].mean(axis=1)
        decay = (share / (1.0 + share))[:, None] * beyond
        return self.space.accelerated(state, change[cells].mean(axis=1) - decay)

    def _vertex_velocity(self, state: FluidState) -> NDArray[np.float64]:
        """(n, 3) means at the vertices, with what the means over cells and vertices take from the flow added.

        The decay of a wave then errs by half as much.
        """
        space, velocity = self.space, self.space.cell_velocity(state)
        back = space.vertex_means(velocity)[space.cells].mean(axis=1)
        return space.vertex_means(2.0 * velocity - back)

    def cell_acceleration(self, state: FluidState, time: float) -> NDArray[np.float64]:
        """(k, 3) what it adds to the velocity of the cells a second."""
        space, diffusion = self.space, self.diffusion
        change = diffusion.stiffness @ self._vertex_velocity(state)
        change *= -space.inverse_mass[:, None]
        change[diffusion.fixed] = 0.0
        return change[space.cells].mean(axis=1)


def _wall_vertices(space: VolumeSpace) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Vertices with a prescribed velocity, and that velocity: means over the faces by area."""
    cell, i = space.boundary
    if space.conditions is None:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    rough = space.conditions.friction
    vertex = space.cells[cell[:, None], TET_FACES[i]][rough].ravel()
    weight = np.repeat(np.linalg.norm(space.area[cell, i][rough], axis=1), 3)
    wall = np.repeat(space.conditions.velocity[rough], 3, axis=0) * weight[:, None]
    total = np.bincount(vertex, weight, space.n)
    mean = np.stack([np.bincount(vertex, w, space.n) for w in wall.T], axis=1)
    vertices = np.flatnonzero(total > 0)
    return vertices, mean[vertices] / total[vertices, None]


class VolumeTracer:
    """Values at vertices carried backwards with error compensation, within the bounds of the cell."""

    def __init__(self, setting: FluidSetting) -> None:
        self.space, self.paths = setting.volume, setting.volume_paths
        space = self.space
        self.vertices = np.flatnonzero(space.mass > 0)
        self.cell = np.zeros(space.n, dtype=np.int64)
        self.cell[space.cells.ravel()] = np.repeat(np.arange(len(space.cells)), 4)

    def carried(
        self, before: FluidState, after: FluidState, values: NDArray, dt: float
    ) -> NDArray[np.float64]:
        """(n,) values after dt, in the mean of the velocities of two states."""
        space, paths, vertices = self.space, self.paths, self.vertices
        velocity = space.vertex_means(0.5 * (space.cell_velocity(before) + space.cell_velocity(after)))
        points, cell = np.asarray(space.mesh.points)[vertices], self.cell[vertices]
        back, forth = paths.carried(velocity, cell, points, dt), paths.carried(velocity, cell, points, -dt)
        there, again = np.array(values), np.array(values)
        there[vertices] = paths.interpolated(values, *back)
        again[vertices] = paths.interpolated(there, *forth)
        moved = paths.interpolated(1.5 * values - 0.5 * again, *back)
        corners = values[space.cells[back[0]]]
        bounds = Bounds(corners.min(axis=1), corners.max(axis=1))
        result = np.array(values)
        label = np.zeros(len(vertices), dtype=np.int64)
        result[vertices] = conserved(
            values[vertices], np.clip(moved, *bounds), bounds, space.mass[vertices], label
        )
        return result
