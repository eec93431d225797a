"""Boundary conditions of a flow in a volume, assembled from all sections of the effect `boundary`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.tet_mesh import TET_FACES
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
    """

    flux: NDArray[np.float64]
    natural: NDArray[np.bool_]
    friction: NDArray[np.bool_]
    velocity: NDArray[np.float64]
    is_open: bool = False


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


def volume_conditions(context: Any, sections: Sequence[BoundaryPart], space: Any) -> VolumeConditions:
    """Conditions of every boundary face: the first part that holds at its centroid, or a wall at rest.

    Parameters
    ----------
    context : FluidContext
    sections : sequence of BoundaryPart
    space : VolumeSpace

    Returns
    -------
    VolumeConditions

    Raises
    ------
    ValueError
        When the flux does not balance, or an inflow has no outflow.
    """
    cell, i = space.boundary
    face, centre, area = space.cell_face[cell, i], space.face_centre[cell, i], space.area[cell, i]
    vertices = space.cells[cell[:, None], TET_FACES[i]]
    owner = np.full(len(face), len(sections))
    for number, section in reversed(list(enumerate(sections))):
        covered = np.ones(len(face), dtype=bool)
        if section.where is not None:
            covered &= evaluate(section.where, dict(zip("xyz", centre.T))) != 0
        if section.obstacle is not None:
            covered &= context.obstacles[section.obstacle][vertices].all(axis=1)
        owner[covered] = number
    rest = "no-slip" if any(section.kind != "free-slip" for section in sections) else "free-slip"
    kind = np.array([section.kind for section in sections] + [rest])[owner]
    velocity, flux, natural = np.zeros((len(face), 3)), np.zeros(len(face)), np.zeros(len(face), dtype=bool)
    for number, section in enumerate(sections):
        own = owner == number
        if section.kind in ("inflow", "outflow") and not own.any():
            raise ValueError(
                f"{section.kind}: no boundary face lies where {section.where!r} holds; check `where`"
            )
        if section.velocity is not None:
            place = dict(zip("xyz", centre[own].T))
            velocity[own] = np.stack([evaluate(text, place) for text in section.velocity], axis=1)
        if section.kind in ("inflow", "outflow"):
            size = np.linalg.norm(area[own], axis=1)
            crossing = np.einsum("ia,ia->i", velocity[own], area[own])
            flux[own] = section.flux * size / size.sum() if section.flux is not None else crossing
            if section.kind == "inflow" and not flux[own].sum() < 0:
                raise ValueError(f"inflow: velocity {section.velocity} brings no fluid in; reverse it")
            natural[own] = section.kind == "outflow" and section.velocity is None and section.flux is None
    unit = area / np.linalg.norm(area, axis=1, keepdims=True)
    along = velocity - np.einsum("ia,ia->i", velocity, unit)[:, None] * unit
    slides = np.linalg.norm(along, axis=1) > WALL_ROUNDING * np.linalg.norm(velocity, axis=1)
    warn_of_still_walls(sections, owner, slides)
    warn_of_crossed_obstacles(context, sections, owner, vertices)
    _refuse_imbalance(flux, natural, {section.kind for section in sections})
    on_faces, open_faces = np.zeros(space.n_faces), np.zeros(space.n_faces, dtype=bool)
    on_faces[face], open_faces[face] = flux, natural
    return VolumeConditions(
        on_faces, open_faces, (kind != "free-slip") & ~natural, velocity,
        bool(np.isin(kind, ("inflow", "outflow")).any()),
    )  # fmt: skip


def _refuse_imbalance(flux: NDArray, natural: NDArray, kinds: set[str]) -> None:
    if "inflow" in kinds and "outflow" not in kinds:
        raise ValueError('inflow without outflow: add [[effects.boundary]] with kind = "outflow"')
    imbalance = flux_imbalance(flux, natural)
    if imbalance:
        raise ValueError(
            f"{imbalance.format(unit='m^3/s')}; balance the fluxes, or leave "
            "velocity and flux out of an outflow"
        )
