"""Effects in volumes: the flow at the start, tracers and their diffusion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.tet_mesh import TET_FACES
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.crossings import FLUX_ROUNDING
from ddgcli.models.fluid.effect_parts import Initial
from ddgcli.models.fluid.flows import VOLUME_FLOWS
from ddgcli.models.fluid.lost_gradient import warn_of_lost_gradient
from ddgcli.models.fluid.phases import FluidSetting
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

    def start(space: VolumeSpace) -> dict[str, NDArray]:
        flux = space.projected(vectors, inflow=False)
        if parameters.velocity is not None and (space.conditions is None or not space.conditions.is_open):
            energies = space.kinetic_energy(vectors), space.kinetic_energy(space.velocity(flux))
            warn_of_lost_gradient(context.name, *energies)
        return {"flux": flux}

    return Initial(start)


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


class VolumeTracer:
    """Values at vertices carried backwards with error compensation, within the bounds of the cell."""

    def __init__(self, setting: FluidSetting) -> None:
        self.space, self.paths = setting.volume, setting.volume_paths
        space = self.space
        self.vertices = np.flatnonzero(space.mass > 0)
        self.is_open, self.entering = setting.is_open, np.zeros(0, dtype=np.int64)
        self.turning = self.entering
        self.turns = space.conditions is not None and space.conditions.flux_in_time is not None
        if self.is_open and space.conditions is not None:
            cell, i = space.boundary
            in_time, natural = space.conditions.flux_in_time, space.conditions.natural
            times = [0.0] if in_time is None else in_time.times
            self.natural = natural[space.cell_face[cell, i]]
            fluxes = [space.conditions.flux_at(time)[space.cell_face[cell, i]] for time in times]
            enters = [self._enters(flux) for flux in fluxes]
            leaves = [self._enters(-flux) for flux in fluxes]
            self.entering = self._vertices(np.any(enters, axis=0))
            self.turning = self._vertices(np.any(enters, axis=0) & np.any(leaves, axis=0))

    def _enters(self, flux: NDArray) -> NDArray[np.bool_]:
        """(b,) boundary faces through which prescribed outward fluxes (b,) enter."""
        return ~self.natural & (flux < -FLUX_ROUNDING * np.abs(flux).max(initial=0.0))

    def _vertices(self, marked: NDArray) -> NDArray[np.int64]:
        cell, i = self.space.boundary
        return unique_keys(self.space.cells[cell[:, None], TET_FACES[i]][marked])

    def entering_in(self, before: FluidState, after: FluidState) -> NDArray[np.int64]:
        """Vertices at which fluid enters between two states."""
        if not self.turns:
            return self.entering
        return self._vertices(self._enters(self._outward(0.5 * (before["flux"] + after["flux"]))))

    def _outward(self, flux: NDArray) -> NDArray[np.float64]:
        """(b,) fluxes out of the boundary faces."""
        cell, i = self.space.boundary
        return flux[self.space.cell_face[cell, i]] * self.space.sign[cell, i]

    def carried(
        self, before: FluidState, after: FluidState, values: NDArray, dt: float
    ) -> NDArray[np.float64]:
        """(n,) values after dt, in the mean of the velocities of two states."""
        space, paths, vertices = self.space, self.paths, self.vertices
        first, last = (space.vertex_velocity(space.cell_velocity(s), s.time) for s in (before, after))
        velocity = 0.5 * (first + last)
        back, forth = (paths.vertices_carried(velocity, vertices, span) for span in (dt, -dt))
        there, again = np.array(values), np.array(values)
        there[vertices] = paths.interpolated(values, *back)
        again[vertices] = paths.interpolated(there, *forth)
        moved = paths.interpolated(1.5 * values - 0.5 * again, *back)
        corners = values[space.cells[back[0]]]
        rest, here = ~velocity[vertices].any(axis=1), values[vertices]
        bounds = Bounds(np.where(rest, here, corners.min(axis=1)), np.where(rest, here, corners.max(axis=1)))
        result = np.array(values)
        result[vertices] = np.clip(moved, *bounds)
        leaving = None
        if self.is_open:
            flux = 0.5 * dt * (before["flux"] + after["flux"])
            leaving = self._leaving(0.5 * (values + result), flux)
        label = np.zeros(len(vertices), dtype=np.int64)
        result[vertices] = conserved(
            values[vertices], result[vertices], bounds, space.mass[vertices], label, leaving
        )
        entering = self.entering_in(before, after)
        result[entering] = values[entering]
        return result

    def _leaving(self, values: NDArray, flux: NDArray) -> NDArray[np.float64]:
        """(1,) amount that crosses the boundary with fluxes (F,)."""
        space = self.space
        cell, i = space.boundary
        rim = space.cells[cell[:, None], TET_FACES[i]]
        return np.array([self._outward(flux) @ values[rim].mean(axis=1)])
