"""Boundary conditions of a surface flow, assembled from all sections of the effect `boundary`.

The flux through boundary sides fixes the stream function along every boundary loop. Along a natural outflow
it stays free: the tangential velocity vanishes there and the pressure is constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.vectors import row_cross
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
    """

    no_slip: bool
    boundary_values: NDArray[np.float64] | None
    open_vertices: NDArray[np.bool_] | None
    open_sides: NDArray[np.int64]
    wall_circulation: NDArray[np.float64]
    slip: NDArray[np.bool_]

    @property
    def is_open(self) -> bool:
        return self.boundary_values is not None


def boundary_conditions(context: FluidContext, sections: Sequence[BoundaryPart]) -> BoundaryConditions:
    """Conditions of every boundary side: the first part that holds there, or a wall at rest.

    A side that no part covers is a no-slip wall where any part is other than free-slip.

    Parameters
    ----------
    context : FluidContext
    sections : sequence of BoundaryPart

    Returns
    -------
    BoundaryConditions

    Raises
    ------
    ValueError
        When the flux through a loop does not balance, an inflow has no outflow, or natural outflows cannot
        be distinguished.
    """
    mesh = context.mesh
    n, topology = mesh.n_vertices, mesh.topology
    face, k = np.nonzero(topology.side_twin < 0)
    tail, head = mesh.faces[face, k], mesh.faces[face, NEXT[k]]
    side = context.unwrapped(context.points[head] - context.points[tail])
    owner = _owners(context, sections, tail, head, side)
    kind = np.array([section.kind for section in sections] + [_rest(sections)])[owner]
    velocity = _velocities(context, sections, owner, tail, side)
    along = 0.5 * np.einsum("ijk,ik,j->i", velocity, side, 0.5 * GAUSS_WEIGHTS)
    warn_of_still_walls(sections, owner, along)
    warn_of_crossed_obstacles(context, sections, owner, np.stack([tail, head], axis=1))
    circulation = sum_by_index(np.concatenate([tail, head]), np.tile(along, 2), n)
    solid, crossed, free = (
        _ends(n, tail, head, np.isin(kind, kinds))
        for kinds in (("no-slip", "wall"), ("inflow", "outflow"), ("free-slip",))
    )
    # beside a wall of free slip fluid that enters or leaves has the speed along the wall, which nothing sets
    friction = solid | (crossed & ~free)
    slip = topology.boundary_vertex & ~friction
    values, open_vertices, natural = None, None, np.zeros(len(tail), dtype=bool)
    if np.isin(kind, ("inflow", "outflow")).any() or any(section.kind == "inflow" for section in sections):
        _require_outflow(sections)
        flux = _outward_flux(context, sections, owner, kind, velocity, side, face)
        natural = _natural(sections, owner)
        values, open_vertices = _stream_function(n, tail, head, flux, natural)
    sides = np.stack([tail, head], axis=1)[natural]
    return BoundaryConditions(bool(friction.any()), values, open_vertices, sides, circulation, slip)


def _rest(sections: Sequence[BoundaryPart]) -> str:
    return "no-slip" if any(section.kind != "free-slip" for section in sections) else "free-slip"


def _ends(n: int, tail: NDArray, head: NDArray, selection: NDArray) -> NDArray[np.bool_]:
    """(n,) ends of the chosen sides."""
    marked = np.zeros(n, dtype=bool)
    marked[tail[selection]] = marked[head[selection]] = True
    return marked


def _owners(
    context: FluidContext, sections: Sequence[BoundaryPart], tail: NDArray, head: NDArray, side: NDArray
) -> NDArray[np.int64]:
    """(s,) number of the part of every boundary side, len(parts) for the rest."""
    place = dict(zip("xyz", (context.points[tail] + 0.5 * side).T))
    owner = np.full(len(tail), len(sections), dtype=np.int64)
    for i, section in reversed(list(enumerate(sections))):
        covered = np.ones(len(tail), dtype=bool)
        if section.where is not None:
            covered &= evaluate(section.where, place) != 0
        if section.obstacle is not None:
            marked = context.obstacles[section.obstacle]
            covered &= marked[tail] & marked[head]
        owner[covered] = i
    for i, section in enumerate(sections):
        if section.kind in ("inflow", "outflow") and not (owner == i).any():
            raise ValueError(
                f"{section.kind}: no boundary side lies where {section.where!r} holds; check `where`"
            )
    return owner


def _velocities(
    context: FluidContext, sections: Sequence[BoundaryPart], owner: NDArray, tail: NDArray, side: NDArray
) -> NDArray[np.float64]:
    """(s, 3, 3) prescribed velocities at the Gauss points of every boundary side, 0 where there is none."""
    velocity = np.zeros((len(tail), 3, 3))
    for i, section in enumerate(sections):
        own = np.flatnonzero(owner == i)
        if section.velocity is None or not len(own):
            continue
        for j, t in enumerate(0.5 + 0.5 * GAUSS_POINTS):
            place = dict(zip("xyz", (context.points[tail[own]] + t * side[own]).T))
            velocity[own, j] = np.stack([evaluate(text, place) for text in section.velocity], axis=1)
    return velocity


def _require_outflow(sections: Sequence[BoundaryPart]) -> None:
    kinds = {section.kind for section in sections}
    if "inflow" in kinds and "outflow" not in kinds:
        raise ValueError('inflow without outflow: add [[effects.boundary]] with kind = "outflow"')


def _natural(sections: Sequence[BoundaryPart], owner: NDArray) -> NDArray[np.bool_]:
    """(s,) sides of outflows without a prescribed flux."""
    free = [
        section.kind == "outflow" and section.velocity is None and section.flux is None
        for section in sections
    ]
    return np.array([*free, False])[owner]


def _outward_flux(
    context: FluidContext,
    sections: Sequence[BoundaryPart],
    owner: NDArray,
    kind: NDArray,
    velocity: NDArray,
    side: NDArray,
    face: NDArray,
) -> NDArray[np.float64]:
    """(s,) prescribed flux out of every boundary side; 0 on walls and natural outflows."""
    corner = context.points[context.mesh.faces[face]]
    first, second = (
        context.unwrapped(corner[:, 1] - corner[:, 0]),
        context.unwrapped(corner[:, 2] - corner[:, 0]),
    )
    normal = row_cross(first, second)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    outward = row_cross(side, normal)  # of the length of the side
    flux = np.einsum("ijk,ik,j->i", velocity, outward, 0.5 * GAUSS_WEIGHTS)
    flux[~np.isin(kind, ("inflow", "outflow"))] = 0.0
    length = np.linalg.norm(side, axis=1)
    for i, section in enumerate(sections):
        own = owner == i
        if section.flux is not None:
            flux[own] = section.flux * length[own] / length[own].sum()
        if section.kind == "inflow" and not flux[own].sum() < 0:
            raise ValueError(f"inflow: velocity {section.velocity} brings no fluid in; reverse it")
    return flux


def _stream_function(
    n: int, tail: NDArray, head: NDArray, flux: NDArray, natural: NDArray
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
        _refuse_imbalance(tail[loop], flux[loop], natural[loop])
        share = np.where(natural[loop], 0.0, np.abs(flux[loop]))
        excess = 0.0 if natural[loop].any() or not share.any() else float(flux[loop].sum() / share.sum())
        values[head[loop]] = np.cumsum(np.where(natural[loop], 0.0, flux[loop] - excess * share))
        last = int(np.flatnonzero(~natural[loop])[-1])
        values[tail[loop[0]]] = 0.0 if last < len(loop) - 1 else values[head[loop[last]]]
    return np.where(free, 0.0, values), free


def _refuse_imbalance(loop: NDArray, flux: NDArray, natural: NDArray) -> None:
    segments = int(np.sum(natural & ~np.roll(natural, 1)))
    if segments > 1:
        raise ValueError(
            f"{segments} natural outflows on one boundary loop: their shares are unknown; prescribe "
            "`flux` of all but one"
        )
    if natural.all():
        raise ValueError("the whole boundary loop is a natural outflow; prescribe its flux or velocity")
    imbalance = flux_imbalance(flux, natural)
    if imbalance:
        raise ValueError(
            f"{imbalance.format(unit='m^2/s')} through the boundary loop of "
            f"vertex {loop[0]}; balance the fluxes, or leave velocity and flux out of an outflow there"
        )
