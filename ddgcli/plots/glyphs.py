"""Vectors in pictures: fields as arrows, stripes or streamlines, and frames along curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.plots.raster import Camera, PixelFaces
from ddgcli.plots.streamlines import picture_vectors, streamlines

SPACING = 1 / 42  # of the picture's larger side: at most one glyph in a square of this size
LEAST_LENGTH = 1e-9  # of the longest vector, up to which one is zero
HEAD = 0.34  # of an arrow's length
ARROW_LENGTH = 0.075  # of a unit vector of a frame, in sizes of the picture
FRAME_SPACING = 0.12  # of frames along a curve, in sizes of the surface


@dataclass(frozen=True, eq=False)
class Glyphs:
    """Vectors to draw at points.

    Parameters
    ----------
    places, vectors : (k, 3) ndarray of float64
    stripes : bool
        Lines without heads, through their places: v and -v are the same direction.
    faces : (m, 3) ndarray of int64, optional
        Faces of the surface, if the positions are its vertices: arrows are drawn at equal distances.
    lines : bool
        Whether to draw streamlines, which need the faces.
    """

    places: NDArray[np.float64]
    vectors: NDArray[np.float64]
    stripes: bool = False
    faces: NDArray[np.int64] | None = None
    lines: bool = False


@dataclass(frozen=True, eq=False)
class Arrows:
    """Unit vectors of one colour, drawn from their places (k, 3) on; foreshortened."""

    places: NDArray[np.float64]
    vectors: NDArray[np.float64]
    colour: str


def frame_arrows(
    points: NDArray, start: NDArray, extent: float, vectors: Mapping[str, NDArray]
) -> list[Arrows]:
    """Frames along curves, at about equal distances.

    Parameters
    ----------
    points : (p, 3) ndarray
    start : (k + 1,) ndarray of int
        First point of each curve.
    extent : float
        Size of the surface.
    vectors : mapping of str to (p, 3) ndarray
        Unit vectors by colour.

    Returns
    -------
    list of Arrows
        One for each colour, all at the same points.
    """
    numbers = [np.zeros(0, dtype=np.int64)]
    for first, last in zip(start[:-1], start[1:]):
        steps = np.linalg.norm(np.diff(points[first:last], axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        count = max(2, int(along[-1] / (FRAME_SPACING * (extent or 1.0))) + 1)
        at = np.searchsorted(along, np.linspace(0.0, along[-1], count)).clip(max=len(along) - 1)
        numbers.append(first + np.unique(at))
    places = np.concatenate(numbers)
    return [Arrows(points[places], values[places], colour) for colour, values in vectors.items()]


def draw_arrows(axes: Any, camera: Camera, visible: PixelFaces, arrows: Sequence[Arrows]) -> None:
    """Draw the arrows whose feet are visible.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        In pixels of the camera.
    camera : Camera
    visible : PixelFaces
    arrows : sequence of Arrows
    """
    size = max(camera.width, camera.height)
    for one in arrows:
        foot = camera.project(one.places)
        column, row = (np.clip(foot[:, i], 0, limit - 1).astype(np.int64) for i, limit in (
            (0, camera.width), (1, camera.height)))  # fmt: skip
        shown = np.flatnonzero(foot[:, 2] <= visible.depth[row, column] + 0.01 * size)
        flat = ARROW_LENGTH * size * (one.vectors[shown] @ camera.axes.T)[:, :2] * [1.0, -1.0]
        tail, tip = foot[shown, :2], foot[shown, :2] + flat
        _draw_lines(axes, _with_heads(tail, tip), one.colour)


def thin_glyphs(camera: Camera, visible: PixelFaces, glyphs: Glyphs) -> NDArray[np.int64]:
    """Indices of the glyphs to draw: finite, not zero, visible, one in each square of the picture."""
    size = max(camera.width, camera.height)
    place = camera.project(glyphs.places)
    column, row = (np.clip(place[:, i], 0, limit - 1).astype(np.int64) for i, limit in (
        (0, camera.width), (1, camera.height)))  # fmt: skip
    length = np.linalg.norm(glyphs.vectors, axis=1)
    drawable = np.isfinite(length) & (length > LEAST_LENGTH * np.nanmax(length, initial=0.0))
    drawable &= place[:, 2] <= visible.depth[row, column] + 0.01 * size
    number = np.flatnonzero(drawable)
    cell = np.floor(place[number, :2] / (SPACING * size)).astype(np.int64)
    off_centre = np.abs(place[number, :2] / (SPACING * size) - cell - 0.5).max(axis=1)
    order = np.lexsort((number, np.round(off_centre, 6), cell[:, 1], cell[:, 0]))
    cell, number = cell[order], number[order]
    first = np.ones(len(number), dtype=bool)
    first[1:] = (cell[1:] != cell[:-1]).any(axis=1)
    return np.sort(number[first])


def even_arrows(
    camera: Camera, visible: PixelFaces, faces: NDArray, vectors: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Arrows at the centres of equal squares over the visible surface.

    Parameters
    ----------
    camera : Camera
    visible : PixelFaces
    faces : (m, 3) ndarray of int64
        The first m of the visible faces.
    vectors : (n, 3) ndarray of float64
        At the vertices.

    Returns
    -------
    middle, vectors : (k, 2) ndarray of float64
        Columns and rows; finite and not zero.
    """
    pixel, at = picture_vectors(camera, visible, faces, vectors)
    place = np.stack([pixel % camera.width, pixel // camera.width], axis=1)
    spacing = SPACING * max(camera.width, camera.height)
    number = np.full(camera.width * camera.height, -1, dtype=np.int64)
    number[pixel] = np.arange(len(pixel))
    centres = [_centres(place[:, axis], spacing) for axis in (0, 1)]
    middle = np.stack(np.meshgrid(*centres), axis=-1).reshape(-1, 2)
    column, row = np.floor(middle).astype(np.int64).T
    there = number[row * camera.width + column]
    middle, flat = middle[there >= 0], at[there[there >= 0]]
    length = np.hypot(flat[:, 0], flat[:, 1])
    drawable = length > LEAST_LENGTH * np.nanmax(length, initial=0.0)
    return middle[drawable], flat[drawable]


def _centres(place: NDArray, spacing: float) -> NDArray[np.float64]:
    """Centres of as many intervals as fit between the least and the largest place, or one."""
    if not len(place):
        return np.zeros(0)
    low, high = int(place.min()), int(place.max()) + 1
    count = max(1, int((high - low) / spacing))
    steps = np.arange(count, dtype=np.float64) - 0.5 * (count - 1)
    return np.asarray(0.5 * (low + high) + spacing * steps, dtype=np.float64)


def draw_glyphs(axes: Any, camera: Camera, visible: PixelFaces, glyphs: Glyphs) -> None:
    """Draw streamlines, or the thinned vectors: all but the longest two per cent fit into a square.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        In pixels of the camera.
    camera : Camera
    visible : PixelFaces
    glyphs : Glyphs
    """
    if glyphs.faces is not None and glyphs.lines:
        _draw_streamlines(axes, camera, streamlines(camera, visible, glyphs.faces, glyphs.vectors))
        return
    if glyphs.faces is not None:
        middle, flat = even_arrows(camera, visible, glyphs.faces, glyphs.vectors)
        length = np.hypot(flat[:, 0], flat[:, 1])
    else:
        numbers = thin_glyphs(camera, visible, glyphs)
        length = np.linalg.norm(glyphs.vectors[numbers], axis=1)
        flat = (glyphs.vectors[numbers] @ camera.axes.T)[:, :2] * [1.0, -1.0]
        middle = camera.project(glyphs.places[numbers])[:, :2]
    if len(middle) == 0:
        return
    longest = float(np.quantile(length, 0.98))
    scale = 1.05 * SPACING * max(camera.width, camera.height) / longest
    flat = flat * (scale * np.minimum(1.0, longest / length))[:, None]
    tail, tip = middle - flat / 2, middle + flat / 2
    _draw_lines(axes, np.stack([tail, tip], axis=1) if glyphs.stripes else _with_heads(tail, tip))


def _with_heads(tail: NDArray, tip: NDArray) -> NDArray[np.float64]:
    """(3k, 2, 2) segments of arrows: their shafts, and both sides of their heads."""
    flat = tip - tail
    side = np.stack([-flat[:, 1], flat[:, 0]], axis=1)
    heads = [np.stack([tip - HEAD * flat + sign * 0.5 * HEAD * side, tip], axis=1) for sign in (1, -1)]
    return np.concatenate([np.stack([tail, tip], axis=1), *heads])


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


def _draw_lines(axes: Any, segments: Sequence[NDArray] | NDArray, colour: str = "black") -> None:
    from matplotlib.collections import LineCollection

    for width, tint in ((1.6, "white"), (0.8, colour)):
        lines = LineCollection(list(segments), linewidths=width, colors=tint, capstyle="round")
        axes.add_collection(lines)
        lines.set_clip_on(colour == "black")  # arrows of frames may reach beyond the surface's box
