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
    """The (n, 2) texture coordinates of vertex arrays, None without."""
    values = arrays.get(UV)
    return values if values is not None and values.ndim == 2 and values.shape[1] == 2 else None


def corner_uv(arrays: Mapping[str, NDArray]) -> NDArray | None:
    """The (m, 3, 2) texture coordinates of face arrays, None without; (m, 6) is the same array."""
    values = arrays.get(CORNER_UV)
    if values is None or values.size != 6 * len(values):
        return None
    return values.reshape(-1, 3, 2)


def color(arrays: Mapping[str, NDArray]) -> NDArray | None:
    """The (k, 3) or (k, 4) colours of vertex or face arrays, None without."""
    values = arrays.get(COLOR)
    if values is None or values.dtype != np.uint8 or values.ndim != 2 or values.shape[1] not in (3, 4):
        return None
    return values


def appearance(
    vertex: Mapping[str, NDArray], face: Mapping[str, NDArray]
) -> tuple[dict[str, NDArray], dict[str, NDArray]]:
    """The arrays among those of a mesh that are texture coordinates or colours."""
    on_vertices = {UV: vertex_uv(vertex), COLOR: color(vertex)}
    on_faces = {CORNER_UV: corner_uv(face), COLOR: color(face)}
    return (
        {name: values for name, values in on_vertices.items() if values is not None},
        {name: values for name, values in on_faces.items() if values is not None},
    )


def uv_of_corners(corners: NDArray, values: NDArray, n_points: int) -> tuple[NDArray | None, NDArray | None]:
    """(`uv`, None) if every vertex has one value, else (None, `corner_uv`).

    Parameters
    ----------
    corners : (m, 3) ndarray of int64
    values : (m, 3, 2) ndarray
        NaN at corners without texture coordinates.
    """
    flat, vertex = values.reshape(-1, 2), corners.ravel()
    uv = np.full((n_points, 2), np.nan)
    uv[vertex] = flat
    return (uv, None) if np.array_equal(uv[vertex], flat, equal_nan=True) else (None, values)


def colors_of_fractions(values: NDArray) -> NDArray[np.uint8]:
    """Colours of numbers from 0 to 1 (larger ones: from 0 to 255)."""
    largest = float(np.max(values, initial=0.0))
    scaled = values if largest > 1.0 else values * 255.0
    return np.clip(np.rint(np.nan_to_num(scaled)), 0, 255).astype(np.uint8)
