"""Pictures of an array: colours for numbers, arrows or stripes for vectors, squares for maps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.plots.colour import is_signed, value_scale
from ddgcli.plots.glyphs import Glyphs
from ddgcli.plots.surface import draw_surface

CONSTANT_LENGTH_TOLERANCE = 1e-3  # relative spread of vector lengths


def glyphs_of(mesh: TriangleMesh, name: str, vectors: NDArray) -> Glyphs:
    """Arrows on vertices or faces; stripes of principal directions, which have no sign.

    Parameters
    ----------
    mesh : TriangleMesh
    name : str
        Name of the array: names of principal directions begin with `principal_direction`.
    vectors : (n, 3) or (m, 3) ndarray

    Returns
    -------
    Glyphs
        At the vertices, or at the barycentres of the faces.
    """
    on_vertices = len(vectors) == mesh.n_vertices
    places = mesh.points if on_vertices else mesh.points[mesh.faces].mean(axis=1)
    return Glyphs(places, np.asarray(vectors, dtype=np.float64), name.startswith("principal_direction"))


def draw_array(path: str, mesh: TriangleMesh, name: str, values: NDArray | None, **options: Any) -> None:
    """Write a picture of an array on the vertices or faces of a surface.

    Parameters
    ----------
    path : str
        .png, .svg or .pdf.
    mesh : TriangleMesh
    name : str
        Name of the array: label of the colour bar; signed quantities and directions are known by name.
    values : (k,), (k, 2) or (k, 3) ndarray, optional
        Numbers are colours, flat coordinates a pattern of squares, vectors arrows over the colours of their
        lengths.
    **options
        Passed on to `draw_surface`.

    Raises
    ------
    ParameterError
        An array of another shape.
    """
    scale = {"value_size": value_scale(name)}
    if values is None or values.ndim == 1:
        draw_surface(path, mesh, values, **{**scale, "label": name, "signed": is_signed(name), **options})
        return
    if values.ndim != 2 or values.shape[1] not in (2, 3):
        raise ParameterError(f"{name!r} has shape {values.shape}; a picture shows numbers or vectors")
    if values.shape[1] == 2:
        draw_surface(path, mesh, values, **options)
        return
    length = np.linalg.norm(values, axis=1)
    finite = length[np.isfinite(length)]
    constant = np.ptp(finite) <= CONSTANT_LENGTH_TOLERANCE * finite.max(initial=0.0) if len(finite) else True
    label = "" if constant else f"|{name}|"
    plain = {"title": name} if constant else {}
    glyphs = glyphs_of(mesh, name, values)
    draw_surface(
        path,
        mesh,
        None if constant else length,
        **{**scale, "label": label, "glyphs": glyphs, **plain, **options},
    )
