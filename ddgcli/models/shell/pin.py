"""Effect `pin`: vertices that are held still."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from ddgcli.geometry.extrinsic import face_normal
from ddgcli.mechanics.terms import FixedCoordinates
from ddgcli.mesh.ragged import unique_keys
from ddgcli.models.shell.context import ShellContext
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import vector
from ddgcli.simulation.effects import Effect

# mean square of the normal components along held axes, below which a clamp leaves the normals free
MIN_FIXED_NORMAL = 0.5


class Pin(Section):
    """Hold vertices where they start."""

    object: str | None = Field(None, description="shell; needed where the scene has several")
    name: str | None = Field(None, description="key in results.reaction_forces; default pin")
    vertices: list[int] | None = Field(None, description="vertex indices")
    box: list[vector("m")] | None = Field(
        None, min_length=2, max_length=2, description="two opposite corners, [[x, y, z], [x, y, z]]"
    )
    axes: str = Field("xyz", description="directions held; xz for a diaphragm across y")
    clamp: bool = Field(
        False,
        description="also hold the surface's direction: of edges between the vertices with midedge bending, "
        "else all faces at the vertices stay",
    )

    @field_validator("axes")
    @classmethod
    def _letters(cls, value: str) -> str:
        if not value or set(value) - set("xyz"):
            raise ValueError(f"axes must be letters of xyz, not {value!r}")
        return value


def build(parameters: Pin, context: ShellContext) -> list[FixedCoordinates]:
    vertices = context.selection(parameters.vertices, parameters.box, ("effects", "pin"))
    # mid-edge bending itself clamps the directors of the edges between the vertices
    clamps_directors = any(term.couples is not None for term in context.terms.get("bending", []))
    if parameters.clamp and not clamps_directors:
        incident = np.flatnonzero(np.isin(context.mesh.faces, vertices).any(axis=1))
        vertices = unique_keys(np.concatenate([vertices, context.mesh.faces[incident].ravel()]))
        _warn_of_free_direction(parameters, context, incident)
    mask = np.zeros((context.mesh.n_vertices, 3), dtype=bool)
    for axis in parameters.axes:
        mask[vertices, "xyz".index(axis)] = True
    return [FixedCoordinates(mask)]


def _warn_of_free_direction(parameters: Pin, context: ShellContext, incident: NDArray) -> None:
    """Warn if vertices can move along the normals, as on a symmetry plane: faces then rotate freely."""
    normal = face_normal(context.mesh)[incident][:, ["xyz".index(axis) for axis in parameters.axes]]
    if context.terms.get("bending") and np.sum(normal**2) < MIN_FIXED_NORMAL * len(incident):
        logging.getLogger("ddgcli").warning(
            "%s: clamp with axes = %r leaves the direction of hinges free where the surface moves along its "
            'normal; write bending = { model = "midedge" }, which holds it',
            parameters.name or "pin",
            parameters.axes,
        )


EFFECT = Effect("pin", Pin, build, "none: held coordinates leave the system", ("shell",), repeatable=True)
