"""Texture coordinates and colours of a surface: the arrays `uv`, `corner_uv` and `color`.

Readers map what a format has to these names, and writers map them back:

- `uv` (n, 2) on vertices, or `corner_uv` (m, 3, 2) on faces where a seam gives a vertex several values
  (NaN at corners without any); the origin is the lower left corner of the picture;
- `color` (n, 3) or (n, 4) of uint8 on vertices, red, green, blue and alpha; or on faces.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

UV, CORNER_UV, COLOR = "uv", "corner_uv", "color"
NAMES = (UV, CORNER_UV, COLOR)


def vertex_uv(arrays: Mapping[str, NDArray]) -> NDArray | None:
    """Texture coordinates of vertices.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        Arrays on vertices.

    Returns
    -------
    (n, 2) ndarray, or None
        None without an array `uv` of this shape.
    """
    values = arrays.get(UV)
    return values if values is not None and values.ndim == 2 and values.shape[1] == 2 else None


def corner_uv(arrays: Mapping[str, NDArray]) -> NDArray | None:
    """Texture coordinates of the corners of faces.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        Arrays on faces.

    Returns
    -------
    (m, 3, 2) ndarray, or None
        The array `corner_uv`, also where it is stored as (m, 6); None without one.
    """
    values = arrays.get(CORNER_UV)
    if values is None or values.size != 6 * len(values):
        return None
    return values.reshape(-1, 3, 2)


def color(arrays: Mapping[str, NDArray]) -> NDArray | None:
    """Colours of vertices or faces.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        Arrays on vertices or on faces.

    Returns
    -------
    (k, 3) or (k, 4) ndarray of uint8, or None
        None without an array `color` of this shape and type.
    """
    values = arrays.get(COLOR)
    if values is None or values.dtype != np.uint8 or values.ndim != 2 or values.shape[1] not in (3, 4):
        return None
    return values


def appearance(
    vertex: Mapping[str, NDArray], face: Mapping[str, NDArray]
) -> tuple[dict[str, NDArray], dict[str, NDArray]]:
    """The arrays among those of a mesh that are texture coordinates or colours.

    Parameters
    ----------
    vertex, face : mapping of str to ndarray
        Arrays on vertices and on faces.

    Returns
    -------
    on_vertices : dict of str to ndarray
        At most `uv` and `color`.
    on_faces : dict of str to ndarray
        At most `corner_uv` and `color`.
    """
    on_vertices = {UV: vertex_uv(vertex), COLOR: color(vertex)}
    on_faces = {CORNER_UV: corner_uv(face), COLOR: color(face)}
    return (
        {name: values for name, values in on_vertices.items() if values is not None},
        {name: values for name, values in on_faces.items() if values is not None},
    )


def uv_of_corners(corners: NDArray, values: NDArray, n_points: int) -> tuple[NDArray | None, NDArray | None]:
    """Texture coordinates by vertex if every vertex has one value, else by corner.

    Parameters
    ----------
    corners : (m, 3) ndarray of int64
        Vertices of the faces.
    values : (m, 3, 2) ndarray
        NaN at corners without texture coordinates.
    n_points : int
        Number of vertices.

    Returns
    -------
    uv : (n_points, 2) ndarray of float64, or None
        NaN at vertices without a corner; None if a vertex has several values.
    corner_uv : (m, 3, 2) ndarray, or None
        `values` if a vertex has several values, else None.
    """
    flat, vertex = values.reshape(-1, 2), corners.ravel()
    uv = np.full((n_points, 2), np.nan)
    uv[vertex] = flat
    return (uv, None) if np.array_equal(uv[vertex], flat, equal_nan=True) else (None, values)


def colors_of_fractions(values: NDArray) -> NDArray[np.uint8]:
    """Colours as bytes.

    Parameters
    ----------
    values : ndarray of float
        From 0 to 1; if the largest exceeds 1, from 0 to 255.

    Returns
    -------
    ndarray of uint8
        Of the same shape; 0 for NaN.
    """
    largest = float(np.max(values, initial=0.0))
    scaled = values if largest > 1.0 else values * 255.0
    return np.clip(np.rint(np.nan_to_num(scaled)), 0, 255).astype(np.uint8)
