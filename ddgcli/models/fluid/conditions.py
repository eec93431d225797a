"""Boundary conditions of a surface flow, assembled from all sections of the effect `boundary`.

The flux through boundary sides fixes the stream function along every boundary loop. Along a natural outflow
it stays free: the tangential velocity vanishes there and the pressure is constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.vectors import row_cross
from ddgcli.models.fluid.boundary_motion import (
    InTime,
    crosses_in_time,
    flux_at,
    holds_time,
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
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.effect_parts import BoundaryPart
from ddgcli.models.fluid.flux_balance import flux_imbalance
from ddgcli.scenes.expressions import evaluate

GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, eq=False)
class BoundaryConditions:
    """What the discrete flow meets at the boundary.

    Parameters
    ----------
    no_slip : bool
        Whether any vertex has a prescribed tangential velocity.
    boundary_values : (n,) ndarray, or None
        Stream function on the boundary vertices; None where nothing crosses the boundary.
    open_vertices : (n,) ndarray of bool, or None
        Vertices inside a natural outflow.
    open_sides : (s, 2) ndarray of int64
        Tail and head of the sides of natural outflows, the surface on the left.
    wall_circulation : (n,) ndarray
        What boundary sides with a prescribed velocity add to the circulation around their vertices' cells.
    slip : (n,) ndarray of bool
        Vertices of free-slip walls, but for those of a wall with friction: the vorticity vanishes there.
    velocity : BoundaryVelocity
        Prescribed velocities at vertices.
    in_time : BoundaryInTime, or None
        None where no section depends on time.
    """

    no_slip: bool
    boundary_values: NDArray[np.float64] | None
    open_vertices: NDArray[np.bool_] | None
    open_sides: NDArray[np.int64]
    wall_circulation: NDArray[np.float64]
    slip: NDArray[np.bool_]
    velocity: BoundaryVelocity
    in_time: BoundaryInTime | None = None

    @property
    def is_open(self) -> bool:
        return self.boundary_values is not None


@dataclass(frozen=True, eq=False)
class BoundaryInTime:
    """Boundary conditions that depend on time.

    Parameters
    ----------
    wall_circulation : InTime
        As for `BoundaryConditions`, at a time.
    boundary_values : InTime, or None
        As for `BoundaryConditions`; None where the stream function on the boundary does not depend on time.
    """

    wall_circulation: InTime
    boundary_values: InTime | None


def boundary_conditions(
    context: FluidContext, sections: Sequence[BoundaryPart], duration: float = 0.0
) -> BoundaryConditions:
    """Conditions of every boundary side: the first part that holds there, or a wall at rest.

    A side that no part covers is a no-slip wall where any part is other than free-slip.

    Parameters
    ----------
    context : FluidContext
    sections : sequence of BoundaryPart
    duration : float
        Of the run; conditions in time are checked at some times of it.

    Returns
    -------
    BoundaryConditions
        At the start.

    Raises
    ------
    ValueError
        When the flux through a loop does not balance, an inflow has no outflow, or natural outflows cannot
        be distinguished.
    """
    sides = _Sides(context, sections)
    n, tail, head, kind = context.mesh.n_vertices, sides.tail, sides.head, sides.kind
    times = sample_times(sections, duration)
    along = values_at(sides.along, times)
    warn_of_still_walls(sections, sides.owner, np.any(along, axis=0))
    warn_of_crossed_obstacles(context, sections, sides.owner, sides.ends)
    solid, crossed, free = (
        _ends(n, tail, head, np.isin(kind, kinds))
        for kinds in (("no-slip", "wall"), ("inflow", "outflow"), ("free-slip",))
    )
    # beside a wall of free slip fluid that enters or leaves has the speed along the wall, which nothing sets
    friction = solid | (crossed & ~free)
    slip = context.mesh.topology.boundary_vertex & ~friction
    values, open_vertices, in_time, natural = None, None, None, np.zeros(len(tail), dtype=bool)
    if np.isin(kind, ("inflow", "outflow")).any() or any(section.kind == "inflow" for section in sections):
        require_outflow(sections)
        fluxes = np.array(values_at(sides.flux, times))
        refuse_outward_inflow(sections, sides.owner, fluxes)
        if len(times) > 1:
            sides.largest_flux = float(np.abs(fluxes).sum(axis=1).max())
        natural = sides.natural
        values, open_vertices = values_at(sides.stream_function, times)[0]
    if len(times) > 1:
        in_time = BoundaryInTime(
            InTime(sides.wall_circulation, times),
            InTime(lambda t: sides.stream_function(t)[0], times) if crosses_in_time(sections) else None,
        )
    return BoundaryConditions(
        bool(friction.any()),
        values,
        open_vertices,
        sides.ends[natural],
        sides.wall_circulation(0.0),
        slip,
        BoundaryVelocity(sections, context.points, sides.ends, sides.outward, sides.owner, sides.side),
        in_time,
    )


class _Sides:
    """The boundary sides of a surface, and what the sections prescribe there at any time."""

    def __init__(self, context: FluidContext, sections: Sequence[BoundaryPart]) -> None:
        self.context, self.sections = context, sections
        mesh = context.mesh
        self.face, k = np.nonzero(mesh.topology.side_twin < 0)
        self.tail, self.head = mesh.faces[self.face, k], mesh.faces[self.face, NEXT[k]]
        self.ends = np.stack([self.tail, self.head], axis=1)
        self.side = context.unwrapped(context.points[self.head] - context.points[self.tail])
        self.owner = _owners(context, sections, self.tail, self.head, self.side)
        self.kind = np.array([section.kind for section in sections] + [rest_kind(sections)])[self.owner]
        self.natural = natural_sides(sections, self.owner)
        self.largest_flux = 0.0  # through the whole boundary in the run
        self._constant: NDArray[np.float64] | None = None

    def velocity(self, time: float) -> NDArray[np.float64]:
        """(s, 3, 3) prescribed velocities at the Gauss points of every side, 0 where there is none."""
        if self._constant is None:
            self._constant = np.zeros((len(self.tail), 3, 3))
            self._prescribe(self._constant, 0.0, in_time=False)
        velocity = np.array(self._constant)
        self._prescribe(velocity, time, in_time=True)
        return velocity

    def _prescribe(self, velocity: NDArray, time: float, in_time: bool) -> None:
        for i, section in enumerate(self.sections):
            own = np.flatnonzero(self.owner == i)
            if section.velocity is None or not len(own) or holds_time(section) != in_time:
                continue
            start = self.context.points[self.tail[own]]
            for j, share in enumerate(0.5 + 0.5 * GAUSS_POINTS):
                velocity[own, j] = velocity_at(section, start + share * self.side[own], time)

    def along(self, time: float) -> NDArray[np.float64]:
        """(s,) half the integral of the velocity along every side."""
        return 0.5 * np.einsum("ijk,ik,j->i", self.velocity(time), self.side, 0.5 * GAUSS_WEIGHTS)

    def wall_circulation(self, time: float) -> NDArray[np.float64]:
        """(n,) what the sides add to the circulation around their vertices' cells."""
        ends = np.concatenate([self.tail, self.head])
        return sum_by_index(ends, np.tile(self.along(time), 2), self.context.mesh.n_vertices)

    def flux(self, time: float) -> NDArray[np.float64]:
        """(s,) prescribed flux out of every side; 0 on walls and natural outflows."""
        flux = np.einsum("ijk,ik,j->i", self.velocity(time), self.outward, 0.5 * GAUSS_WEIGHTS)
        flux[~np.isin(self.kind, ("inflow", "outflow"))] = 0.0
        length = np.linalg.norm(self.side, axis=1)
        for i, section in enumerate(self.sections):
            own = self.owner == i
            if section.flux is not None:
                flux[own] = flux_at(section, time) * length[own] / length[own].sum()
        return flux

    @cached_property
    def outward(self) -> NDArray[np.float64]:
        """(s, 3) outward vectors of the length of the sides."""
        context = self.context
        corner = context.points[context.mesh.faces[self.face]]
        first, second = (
            context.unwrapped(corner[:, 1] - corner[:, 0]),
            context.unwrapped(corner[:, 2] - corner[:, 0]),
        )
        normal = row_cross(first, second)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return row_cross(self.side, normal)

    def stream_function(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Stream function (n,) on the boundary vertices, and the vertices (n,) inside natural outflows."""
        n = self.context.mesh.n_vertices
        return _stream_function(
            n, self.tail, self.head, self.flux(time), self.natural, self.largest_flux, self.context.division
        )


def _ends(n: int, tail: NDArray, head: NDArray, selection: NDArray) -> NDArray[np.bool_]:
    """(n,) ends of the chosen sides."""
    marked = np.zeros(n, dtype=bool)
    marked[tail[selection]] = marked[head[selection]] = True
    return marked


def _owners(
    context: FluidContext, sections: Sequence[BoundaryPart], tail: NDArray, head: NDArray, side: NDArray
) -> NDArray[np.int64]:
    """(s,) index of the part of every boundary side, len(parts) for the rest."""
    place = dict(zip("xyz", (context.points[tail] + 0.5 * side).T))
    owner = np.full(len(tail), len(sections), dtype=np.int64)
    for i, section in reversed(list(enumerate(sections))):
        covered = np.ones(len(tail), dtype=bool)
        if section.where is not None:
            covered &= evaluate(section.where, place) != 0
        if section.obstacle is not None:
            marked = context.obstacles[section.obstacle]
            covered &= marked[tail] & marked[head]
        refuse_empty_wall(section, covered, "side")
        owner[covered] = i
    for i, section in enumerate(sections):
        if section.kind in ("inflow", "outflow") and not (owner == i).any():
            raise ValueError(
                f"{section.kind}: no boundary side lies where {section.where!r} holds and no section before "
                "it does; check `where` and the order"
            )
    return owner


def _stream_function(
    n: int, tail: NDArray, head: NDArray, flux: NDArray, natural: NDArray, largest: float, division: str
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Stream function (n,) on the boundary vertices, and the vertices (n,) inside natural outflows."""
    values, free = np.zeros(n), np.zeros(n, dtype=bool)
    leaving = np.full(n, -1, dtype=np.int64)  # the boundary side that leaves a vertex
    leaving[tail] = np.arange(len(tail))
    visited = np.zeros(len(tail), dtype=bool)
    free[head[natural & natural[leaving[head]]]] = True
    ends = np.flatnonzero(natural & ~natural[leaving[head]])  # last sides of natural outflows
    for start in [*leaving[head[ends]].tolist(), *range(len(tail))]:
        if visited[start]:
            continue
        loop = [start]
        while (following := int(leaving[head[loop[-1]]])) != start:
            loop.append(following)
        visited[loop] = True
        _refuse_imbalance(tail[loop], flux[loop], natural[loop], largest, division)
        share = np.where(natural[loop], 0.0, np.abs(flux[loop]))
        excess = 0.0 if natural[loop].any() or not share.any() else float(flux[loop].sum() / share.sum())
        values[head[loop]] = np.cumsum(np.where(natural[loop], 0.0, flux[loop] - excess * share))
        last = int(np.flatnonzero(~natural[loop])[-1])
        values[tail[loop[0]]] = 0.0 if last < len(loop) - 1 else values[head[loop[last]]]
    return np.where(free, 0.0, values), free


def _refuse_imbalance(loop: NDArray, flux: NDArray, natural: NDArray, largest: float, division: str) -> None:
    segments = int(np.sum(natural & ~np.roll(natural, 1)))
    if segments > 1:
        raise ValueError(
            f"{segments} natural outflows on one boundary loop: their shares are unknown; prescribe "
            "`flux` of all but one"
        )
    if natural.all():
        raise ValueError("the whole boundary loop is a natural outflow; prescribe its flux or velocity")
    imbalance = flux_imbalance(flux, natural, largest)
    if imbalance:
        remedy = "balance the fluxes, or leave velocity and flux out of an outflow there"
        raise ValueError(
            f"{imbalance.format(unit='m^2/s')} through the boundary loop of vertex {loop[0]}; "
            f"{division or remedy}"
        )
