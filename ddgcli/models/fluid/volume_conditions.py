"""Boundary conditions of a flow in a volume, assembled from all sections of the effect `boundary`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.tet_mesh import TET_FACES
from ddgcli.mesh.vectors import row_dot, tangential
from ddgcli.models.fluid.boundary_motion import (
    InTime,
    crosses_in_time,
    flux_at,
    natural_sides,
    refuse_empty_wall,
    refuse_outward_inflow,
    require_outflow,
    rest_kind,
    sample_times,
    values_at,
    velocity_at,
)
from ddgcli.models.fluid.boundary_velocity import BoundaryVelocity
from ddgcli.models.fluid.boundary_warnings import warn_of_crossed_obstacles, warn_of_still_walls
from ddgcli.models.fluid.effect_parts import BoundaryPart
from ddgcli.models.fluid.flux_balance import flux_imbalance
from ddgcli.scenes.expressions import evaluate

WALL_ROUNDING = 1e-12  # of its velocity, up to which a wall has none along itself


@dataclass(frozen=True, eq=False)
class VolumeConditions:
    """What the discrete flow meets at the boundary.

    Parameters
    ----------
    flux : (F,) ndarray
        Prescribed flux out of every boundary face; 0 elsewhere.
    natural : (F,) ndarray of bool
        Faces of natural outflows, at constant pressure.
    friction : (b,) ndarray of bool
        Boundary faces (in the order of `VolumeSpace.boundary`) with a prescribed velocity along them.
    velocity : (b, 3) ndarray
        That velocity.
    is_open : bool
    crosses : (F,) ndarray of bool, optional
        Faces with a flux other than 0 at some time; by default those of `flux`.
    flux_in_time, velocity_in_time : InTime, optional
        Both at any time, where they depend on it; else they are those of the start.
    at_vertices : BoundaryVelocity, optional
        Prescribed velocities at vertices.
    """

    flux: NDArray[np.float64]
    natural: NDArray[np.bool_]
    friction: NDArray[np.bool_]
    velocity: NDArray[np.float64]
    is_open: bool = False
    crosses: NDArray[np.bool_] | None = None
    flux_in_time: InTime | None = None
    velocity_in_time: InTime | None = None
    at_vertices: BoundaryVelocity | None = None

    def flux_at(self, time: float) -> NDArray[np.float64]:
        """(F,) prescribed fluxes at a time."""
        return self.flux if self.flux_in_time is None else self.flux_in_time.at(time)

    def velocity_at(self, time: float) -> NDArray[np.float64]:
        """(b, 3) prescribed velocities at a time."""
        return self.velocity if self.velocity_in_time is None else self.velocity_in_time.at(time)

    @property
    def crossed(self) -> NDArray[np.bool_]:
        """(F,) faces that fluid crosses at some time."""
        return self.natural | (self.flux != 0 if self.crosses is None else self.crosses)


def walls(space: Any) -> VolumeConditions:
    """Boundary conditions of walls without friction everywhere.

    Parameters
    ----------
    space : VolumeSpace

    Returns
    -------
    VolumeConditions
    """
    count = len(space.boundary[0])
    none = np.zeros(space.n_faces, dtype=bool)
    return VolumeConditions(np.zeros(space.n_faces), none, np.zeros(count, dtype=bool), np.zeros((count, 3)))


def volume_conditions(
    context: Any, sections: Sequence[BoundaryPart], space: Any, duration: float = 0.0
) -> VolumeConditions:
    """Conditions of every boundary face: the first part that holds at its centroid, or a wall at rest.

    Parameters
    ----------
    context : FluidContext
    sections : sequence of BoundaryPart
    space : VolumeSpace
    duration : float
        Of the run; conditions in time are checked at some times of it.

    Returns
    -------
    VolumeConditions
        At the start.

    Raises
    ------
    ValueError
        When the flux does not balance, or an inflow has no outflow.
    """
    rim = _Rim(context, sections, space)
    times = sample_times(sections, duration)
    velocities = values_at(rim.velocity, times)
    unit = rim.area / np.linalg.norm(rim.area, axis=1, keepdims=True)
    slides = np.zeros(len(unit), dtype=bool)
    for velocity in velocities:
        along = tangential(velocity, unit)
        slides |= np.linalg.norm(along, axis=1) > WALL_ROUNDING * np.linalg.norm(velocity, axis=1)
    prescribed = np.array(values_at(rim.flux, times))
    refuse_outward_inflow(sections, rim.owner, prescribed)
    if len(times) > 1:
        rim.largest_flux = float(np.abs(prescribed).sum(axis=1).max())
    warn_of_still_walls(sections, rim.owner, slides)
    warn_of_crossed_obstacles(context, sections, rim.owner, rim.vertices)
    require_outflow(sections)
    fluxes = values_at(rim.balanced_flux, times)
    natural = np.zeros(space.n_faces, dtype=bool)
    natural[rim.face] = rim.natural
    in_time = len(times) > 1
    return VolumeConditions(
        fluxes[0], natural, (rim.kind != "free-slip") & ~rim.natural, velocities[0],
        bool(np.isin(rim.kind, ("inflow", "outflow")).any()),
        np.any(fluxes, axis=0) if in_time else None,
        InTime(rim.balanced_flux, times) if crosses_in_time(sections) else None,
        InTime(rim.velocity, times) if in_time else None,
        BoundaryVelocity(sections, context.points, rim.vertices, rim.area, rim.owner),
    )  # fmt: skip


class _Rim:
    """The boundary faces of a volume, and what the sections prescribe there at any time."""

    def __init__(self, context: Any, sections: Sequence[BoundaryPart], space: Any) -> None:
        self.sections, self.n_faces, self.division = sections, space.n_faces, context.division
        cell, i = space.boundary
        self.face, self.centre, self.area = (
            space.cell_face[cell, i],
            space.face_centre[cell, i],
            space.area[cell, i],
        )
        self.vertices = space.cells[cell[:, None], TET_FACES[i]]
        self.component = space.face_component[self.face]
        self.owner = self._owners(context)
        self.kind = np.array([section.kind for section in sections] + [rest_kind(sections)])[self.owner]
        self.natural = natural_sides(sections, self.owner)
        self.largest_flux = 0.0  # through the whole boundary in the run

    def _owners(self, context: Any) -> NDArray[np.int64]:
        """(b,) index of the section of every boundary face, len(sections) for the rest."""
        owner = np.full(len(self.face), len(self.sections))
        for number, section in reversed(list(enumerate(self.sections))):
            covered = np.ones(len(self.face), dtype=bool)
            if section.where is not None:
                covered &= evaluate(section.where, dict(zip("xyz", self.centre.T))) != 0
            if section.obstacle is not None:
                covered &= context.obstacles[section.obstacle][self.vertices].all(axis=1)
            refuse_empty_wall(section, covered, "face")
            owner[covered] = number
        for number, section in enumerate(self.sections):
            if section.kind in ("inflow", "outflow") and not (owner == number).any():
                raise ValueError(
                    f"{section.kind}: no boundary face lies where {section.where!r} holds and no section "
                    "before it does; check `where` and the order"
                )
        return owner

    def velocity(self, time: float) -> NDArray[np.float64]:
        """(b, 3) prescribed velocities, 0 where there is none."""
        velocity = np.zeros((len(self.face), 3))
        for number, section in enumerate(self.sections):
            own = self.owner == number
            if section.velocity is not None:
                velocity[own] = velocity_at(section, self.centre[own], time)
        return velocity

    def flux(self, time: float) -> NDArray[np.float64]:
        """(b,) prescribed fluxes out of the boundary faces; 0 on walls and natural outflows."""
        flux, velocity = np.zeros(len(self.face)), self.velocity(time)
        for number, section in enumerate(self.sections):
            own = self.owner == number
            if section.kind not in ("inflow", "outflow"):
                continue
            size = np.linalg.norm(self.area[own], axis=1)
            crossing = row_dot(velocity[own], self.area[own])
            flux[own] = crossing if section.flux is None else flux_at(section, time) * size / size.sum()
        return flux

    def balanced_flux(self, time: float) -> NDArray[np.float64]:
        """(F,) these fluxes, 0 inside; ValueError where they do not balance."""
        flux = self.flux(time)
        for number in np.unique(self.component):
            own = self.component == number
            imbalance = flux_imbalance(flux[own], self.natural[own], self.largest_flux)
            if imbalance:
                place = "({:.4g}, {:.4g}, {:.4g})".format(*self.centre[own][0])
                where = "" if own.all() else f" through the component at {place}"
                remedy = "balance the fluxes, or leave velocity and flux out of an outflow there"
                raise ValueError(f"{imbalance.format(unit='m^3/s')}{where}; {self.division or remedy}")
        on_faces = np.zeros(self.n_faces)
        on_faces[self.face] = flux
        return on_faces
