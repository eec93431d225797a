"""Colours and texture coordinates of written meshes."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_matrix

if TYPE_CHECKING:
    from ddgcli.io.mesh_file import MeshInput
    from ddgcli.mesh.fields import AnnotatedMesh

log = logging.getLogger("ddgcli")


def with_input_appearance(annotated: AnnotatedMesh, source: MeshInput) -> AnnotatedMesh:
    """The mesh with texture coordinates and colours of the input, where it has the input's faces.

    Arrays of the result take precedence.
    """
    mesh = annotated.mesh
    if not isinstance(mesh, TriangleMesh) or not isinstance(source.mesh, TriangleMesh):
        return annotated
    if mesh.n_vertices != source.mesh.n_vertices or not np.array_equal(mesh.faces, source.mesh.faces):
        return annotated
    from ddgcli.io.appearance import COLOR, CORNER_UV, UV, appearance

    vertex, face = appearance(source.vertex, source.face)
    if {UV, CORNER_UV} & (set(annotated.vertex) | set(annotated.face)):
        vertex.pop(UV, None), face.pop(CORNER_UV, None)
    if COLOR in annotated.vertex or COLOR in annotated.face:
        vertex.pop(COLOR, None), face.pop(COLOR, None)
    return replace(annotated, vertex={**annotated.vertex, **vertex}, face={**annotated.face, **face})


def with_baked_colours(
    annotated: AnnotatedMesh, name: str, colour_range: tuple[float, float, bool] | None = None
) -> AnnotatedMesh:
    """The mesh with the array `color` drawn from an array, and the range in its metadata.

    A mesh without the array stays as it is, with a warning.
    """
    from ddgcli.io.appearance import COLOR
    from ddgcli.plots.colour import baked_colours, is_signed, robust_limits, value_scale

    values = {**annotated.face, **annotated.vertex}.get(name)
    if values is None:
        log.warning(f"these results have no array {name!r}: the output has no colours")
        return annotated
    size = values if values.ndim == 1 else np.linalg.norm(row_matrix(values), axis=1)
    low, high, signed = colour_range or robust_limits(size, is_signed(name, values.ndim), value_scale(name))
    colours, colour_map = baked_colours(size, low, high, signed)
    place = "vertex" if name in annotated.vertex else "face"
    metadata = {"colors": {"array": name, "on": place, "low": low, "high": high, "map": colour_map}}
    annotated = replace(annotated, metadata={**annotated.metadata, **metadata})
    if place == "vertex":
        return replace(annotated, vertex={**annotated.vertex, COLOR: colours})
    return replace(annotated, face={**annotated.face, COLOR: colours})
