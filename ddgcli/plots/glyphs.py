"""Vector fields in pictures: arrows, stripes where a direction has no sign, or streamlines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.plots.raster import Camera, PixelFaces
from ddgcli.plots.streamlines import streamlines

SPACING = 1 / 42  # of the picture's larger side: at most one glyph in a square of this size
HEAD = 0.34  # of an arrow's length


@dataclass(frozen=True, eq=False)
class Glyphs:
    """Vectors to draw at points.

    Parameters
    ----------
    places, vectors : (k, 3) ndarray of float64
    stripes : bool
        Lines without heads, through their places: v and -v are the same direction.
    faces : (m, 3) ndarray of int64, optional
        Of the surface in the picture, the places its vertices: streamlines are drawn instead.
    """

    places: NDArray[np.float64]
    vectors: NDArray[np.float64]
    stripes: bool = False
    faces: NDArray[np.int64] | None = None


def thin_glyphs(camera: Camera, visible: PixelFaces, glyphs: Glyphs) -> NDArray[np.int64]:
    """Numbers of the glyphs to draw: finite, not zero, visible, one in each square of the picture."""
    size = max(camera.width, camera.height)
    place = camera.project(glyphs.places)
    column, row = (np.clip(place[:, i], 0, limit - 1).astype(np.int64) for i, limit in (
        (0, camera.width), (1, camera.height)))  # fmt: skip
    length = np.linalg.norm(glyphs.vectors, axis=1)
    drawable = np.isfinite(length) & (length > 1e-9 * np.nanmax(length, initial=0.0))
    drawable &= place[:, 2] <= visible.depth[row, column] + 0.01 * size
    number = np.flatnonzero(drawable)
    cell = np.floor(place[number, :2] / (SPACING * size)).astype(np.int64)
    off_centre = np.abs(place[number, :2] / (SPACING * size) - cell - 0.5).max(axis=1)
    order = np.lexsort((number, np.round(off_centre, 6), cell[:, 1], cell[:, 0]))
    cell, number = cell[order], number[order]
    first = np.ones(len(number), dtype=bool)
    first[1:] = (cell[1:] != cell[:-1]).any(axis=1)
    return np.sort(number[first])


def draw_glyphs(axes: Any, camera: Camera, visible: PixelFaces, glyphs: Glyphs) -> None:
    """Draw streamlines, or the thinned vectors: all but the longest two per cent fit into a square."""
    if glyphs.faces is not None:
        _draw_streamlines(axes, camera, streamlines(camera, visible, glyphs.faces, glyphs.vectors))
        return
    chosen = thin_glyphs(camera, visible, glyphs)
    if len(chosen) == 0:
        return
    vectors = glyphs.vectors[chosen]
    length = np.linalg.norm(vectors, axis=1)
    scale = 1.05 * SPACING * max(camera.width, camera.height) / float(np.quantile(length, 0.98))
    vectors = vectors * (scale * np.minimum(1.0, np.quantile(length, 0.98) / length))[:, None]
    flat = (vectors @ camera.axes.T)[:, :2] * [1.0, -1.0]
    middle = camera.project(glyphs.places[chosen])[:, :2]
    tail, tip = middle - flat / 2, middle + flat / 2
    lines = [np.stack([tail, tip], axis=1)]
    if not glyphs.stripes:
        side = np.stack([-flat[:, 1], flat[:, 0]], axis=1)
        for sign in (1, -1):
            lines.append(np.stack([tip - HEAD * flat + sign * 0.5 * HEAD * side, tip], axis=1))
    _draw_lines(axes, list(np.concatenate(lines)))


def _draw_streamlines(axes: Any, camera: Camera, lines: list[NDArray]) -> None:
    """Each with one head in its middle."""
    head = HEAD * SPACING * max(camera.width, camera.height)
    heads = []
    for line in lines:
        middle = len(line) // 2
        along = line[middle] - line[middle - 1]
        along *= head / np.hypot(*along)
        side = np.array([-along[1], along[0]])
        heads += [np.stack([line[middle] - along + sign * 0.5 * side, line[middle]]) for sign in (1, -1)]
    _draw_lines(axes, lines + heads)


def _draw_lines(axes: Any, segments: list[NDArray]) -> None:
    from matplotlib.collections import LineCollection

    for width, colour in ((1.6, "white"), (0.8, "black")):
        axes.add_collection(LineCollection(segments, linewidths=width, colors=colour, capstyle="round"))
