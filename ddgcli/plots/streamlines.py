"""Streamlines of a vector field on the visible surface, at even distances in the picture.

Lines start in the middle of squares of the picture and follow the field's projection both ways; the longest
are drawn first, and later ones end where they come near one of these (after Jobard and Lefer, "Creating
evenly-spaced streamlines of arbitrary density", 1997).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ddgcli.plots.raster import Camera, PixelFaces

SPACING = 1 / 32  # of the picture's larger side: distance of two lines, and size of a square
STEP = 0.2  # of SPACING: length of a step along a line
MAX_STEPS = 150  # each way
MIN_LENGTH = 1.5  # of SPACING: shorter lines are not drawn
LEAST_SPEED = 1e-3  # of the largest: lines end where the field is slower
DEPTH_JUMP = 0.03  # of the picture's larger side: a line does not pass over an outline
LOOP_LENGTH = 2.0  # of SPACING: a line of this length that comes back to its start ends there

Field = Callable[[NDArray], NDArray[np.float64]]


def streamlines(
    camera: Camera, visible: PixelFaces, faces: NDArray, vectors: NDArray
) -> list[NDArray[np.float64]]:
    """Streamlines of a vector field on the visible surface.

    Parameters
    ----------
    camera : Camera
    visible : PixelFaces
    faces : (m, 3) ndarray of int64
        The first m of the visible faces; the field is none on others.
    vectors : (n, 3) ndarray of float64
        At the vertices.

    Returns
    -------
    list of (k, 2) ndarray of float64
        Columns and rows along the field; the longest line first.
    """
    size = max(camera.width, camera.height)
    spacing = SPACING * size
    flow = _picture_field(camera, visible, faces, vectors)
    columns, rows = (np.arange(0.5, limit / spacing) * spacing for limit in (camera.width, camera.height))
    seeds = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    seeds = seeds[np.isfinite(flow(seeds)[:, 0])]
    if not len(seeds):
        return []
    ahead, back = (_followed(flow, visible.depth, seeds, sign * STEP * spacing) for sign in (1, -1))
    return _spaced(ahead, back, spacing)


def picture_vectors(
    camera: Camera, visible: PixelFaces, faces: NDArray, vectors: NDArray
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Vectors in the picture, linear between the vertices, at the pixels that show the surface.

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
    pixel : (k,) ndarray of int64
        Flat indices.
    vectors : (k, 2) ndarray of float64
        Along columns and rows, foreshortened.
    """
    own = visible.face < len(faces)
    corner = faces[visible.face[own]]
    flat = (np.asarray(vectors, dtype=np.float64) @ camera.axes.T)[:, :2] * [1.0, -1.0]
    return visible.pixel[own], np.einsum("kij,ki->kj", flat[corner], visible.barycentric[own])


def _picture_field(camera: Camera, visible: PixelFaces, faces: NDArray, vectors: NDArray) -> Field:
    """Unit direction in the picture at (k, 2) columns and rows; NaN where there is none."""
    pixel, at = picture_vectors(camera, visible, faces, vectors)
    speed = np.hypot(at[:, 0], at[:, 1])
    moves = speed > LEAST_SPEED * speed.max(initial=0.0)
    direction = np.full((camera.height * camera.width, 2), np.nan, dtype=np.float32)
    direction[pixel[moves]] = at[moves] / speed[moves, None]

    def field(places: NDArray) -> NDArray[np.float64]:
        column, row = np.floor(np.nan_to_num(places, nan=-1.0)).astype(np.int64).T
        inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
        values = direction[np.where(inside, row * camera.width + column, 0)].astype(np.float64)
        return np.where(inside[:, None], values, np.nan)

    return field


def _followed(flow: Field, depth: NDArray, seeds: NDArray, step: float) -> NDArray[np.float64]:
    """(k, MAX_STEPS + 1, 2) places along the lines from their seeds on, NaN behind their ends."""
    height, width = depth.shape
    jump = DEPTH_JUMP * max(width, height)
    track = np.full((len(seeds), MAX_STEPS + 1, 2), np.nan)
    track[:, 0] = seeds
    active = np.arange(len(seeds))
    for number in range(1, MAX_STEPS + 1):
        here = track[active, number - 1]
        there = here + step * flow(here + 0.5 * step * flow(here))
        goes_on = np.isfinite(flow(there)[:, 0])
        active, here, there = active[goes_on], here[goes_on], there[goes_on]
        before, after = (depth[p[:, 1].astype(np.int64), p[:, 0].astype(np.int64)] for p in (here, there))
        smooth = np.abs(after - before) < jump
        if number * STEP > LOOP_LENGTH:
            smooth &= np.hypot(*(there - seeds[active]).T) > abs(step)
        active = active[smooth]
        track[active, number] = there[smooth]
        if not len(active):
            break
    return track


def _spaced(ahead: NDArray, back: NDArray, spacing: float) -> list[NDArray[np.float64]]:
    """The lines, the longest first, each as far as it keeps its distance from those before."""
    length = np.isfinite(ahead[..., 0]).sum(axis=1) + np.isfinite(back[..., 0]).sum(axis=1)
    occupied: set[tuple[int, int]] = set()
    lines = []
    for k in np.argsort(-length, kind="stable"):
        halves = []
        for track in (back[k], ahead[k]):
            places = track[np.isfinite(track[:, 0])]
            cells = np.floor(places / (0.5 * spacing)).astype(np.int64).tolist()
            halves.append(places[: _free_length(cells, occupied)])
        if not len(halves[0]) or not len(halves[1]):
            continue
        line = np.concatenate([halves[0][:0:-1], halves[1]])
        if (len(line) - 1) * STEP < MIN_LENGTH:
            continue
        lines.append(line)
        for c, r in set(map(tuple, np.floor(line / (0.5 * spacing)).astype(np.int64).tolist())):
            occupied |= {(c + i, r + j) for i in (-1, 0, 1) for j in (-1, 0, 1)}
    return lines


def _free_length(cells: list[list[int]], occupied: set[tuple[int, int]]) -> int:
    """Points before the line meets another one, or itself after `LOOP_LENGTH`."""
    visited: dict[tuple[int, int], int] = {}
    for i, (c, r) in enumerate(cells):
        if (c, r) in occupied or i - visited.setdefault((c, r), i) > LOOP_LENGTH / STEP:
            return i
    return len(cells)
