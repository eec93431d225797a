"""Texts beside the points of a chart that overlap neither each other nor points and lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

FONT_SIZE = 6.5
MARKER_SIZE = 7.0  # points: a square that no text may touch
LINE_BOX = 2.0  # points: squares along lines that no text may touch
GAP = 1.0  # points between two texts
DIRECTIONS = 16
DISTANCES = (7.0, 9.0, 14.0, 20.0, 28.0, 38.0, 50.0, 64.0, 80.0)  # points from the marker to the text
NEAR = 9.0  # distance up to which a text needs no line to its point
POINTS_PER_INCH = 72.0


def place_labels(
    axes: Any,
    texts: Sequence[tuple[str, float, float]],
    points: Sequence[tuple[NDArray, NDArray]],
    lines: Sequence[tuple[NDArray, NDArray]] = (),
) -> None:
    """Write each text near its point, at the nearest free place; texts without a free place are left out.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        With its limits and scales set.
    texts : sequence of (text, x, y)
        Equal texts at one place are written once.
    points : sequence of (x, y)
        All points of the chart.
    lines : sequence of (x, y)
        Vertices of the lines of the chart.
    """
    figure = axes.figure
    renderer = (
        figure.canvas.get_renderer() if hasattr(figure.canvas, "get_renderer") else figure._get_renderer()
    )
    axes.get_xlim(), axes.get_ylim()  # the limits are set here, if they have not been
    unit = figure.dpi / POINTS_PER_INCH
    occupied = np.concatenate(
        [_boxes(np.concatenate([_pixels(axes, p) for p in points] or [np.zeros((0, 2))]), MARKER_SIZE * unit)]
        + [_boxes_along(_pixels(axes, line), LINE_BOX * unit) for line in lines]
    )
    placed = np.zeros((0, 4))
    window = axes.get_window_extent(renderer)
    turn = 2 * np.pi * (np.arange(DIRECTIONS) + 2) / DIRECTIONS  # the first is up and to the right
    for text, x, y in dict.fromkeys(texts):
        label = axes.annotate(text, (x, y), (0, 0), textcoords="offset points", fontsize=FONT_SIZE)
        size = label.get_window_extent(renderer)
        extent = np.array([size.width, size.height])
        centre = axes.transData.transform((x, y))
        label.remove()
        box, distance = _free_place(centre, extent, unit, turn, occupied, placed, window)
        if box is None:
            continue
        occupied, placed = np.concatenate([occupied, box[None]]), np.concatenate([placed, box[None]])
        far = distance > unit * NEAR
        if far:  # no later text may touch the line from this one to its point
            occupied = np.concatenate([occupied, _line_to_point(box, centre, unit)])
        line: dict[str, Any] = {
            "arrowstyle": "-",
            "color": "0.4",
            "linewidth": 0.6,
            "shrinkA": 0,
            "shrinkB": 2,
        }
        # from the nearest point of the text: that line was tested, not the one from the middle
        line["relpos"] = tuple((np.clip(centre, box[:2], box[2:]) - box[:2]) / np.maximum(extent, 1.0))
        axes.annotate(
            text, (x, y), tuple((box[:2] - centre) / unit), textcoords="offset points", fontsize=FONT_SIZE,
            arrowprops=line if far else None, va="bottom", ha="left",
        )  # fmt: skip


def _pixels(axes: Any, points: tuple[NDArray, NDArray]) -> NDArray:
    return axes.transData.transform(np.column_stack(points)) if len(points[0]) else np.zeros((0, 2))


def _boxes(centres: NDArray, size: float) -> NDArray:
    """Squares as x0, y0, x1, y1."""
    return np.concatenate([centres - 0.5 * size, centres + 0.5 * size], axis=1)


def _boxes_along(vertices: NDArray, size: float) -> NDArray:
    """Squares along a polygonal line, at most their size apart."""
    if len(vertices) < 2:
        return np.zeros((0, 4))
    steps = np.diff(vertices, axis=0)
    counts = 1 + np.ceil(np.linalg.norm(steps, axis=1) / size).astype(int)
    samples = [a + np.linspace(0, 1, n)[:, None] * step for a, step, n in zip(vertices, steps, counts)]
    return _boxes(np.concatenate(samples), size)


def _line_to_point(box: NDArray, centre: NDArray, unit: float) -> NDArray:
    """Squares along the line from a text to its point."""
    nearest = np.clip(centre, box[:2], box[2:])
    return _boxes_along(np.stack([nearest, centre]), LINE_BOX * unit)


def _free(boxes: NDArray, others: NDArray) -> NDArray:
    """(n,) whether a box overlaps none of others."""
    apart = (
        (boxes[:, None, 0] >= others[None, :, 2]) | (boxes[:, None, 2] <= others[None, :, 0])
        | (boxes[:, None, 1] >= others[None, :, 3]) | (boxes[:, None, 3] <= others[None, :, 1])
    )  # fmt: skip
    return np.asarray(apart.all(axis=1))


def _free_place(
    centre: NDArray,
    extent: NDArray,
    unit: float,
    turn: NDArray,
    occupied: NDArray,
    placed: NDArray,
    window: Any,
) -> tuple[NDArray | None, float]:
    """(box, distance) of the first place round a point that touches nothing; (None, 0) if there is none.

    A place whose line to the point crosses a placed text is not free.
    """
    gap = GAP * unit
    direction = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    for distance in unit * np.array(DISTANCES):
        # the text lies on the far side of the circle of that radius
        low = centre + distance * direction - np.where(
            direction > 0.3, 0.0, np.where(direction < -0.3, 1.0, 0.5)
        ) * extent  # fmt: skip
        boxes = np.concatenate([low - gap, low + extent + gap], axis=1)
        inside = (boxes[:, 1] >= window.y0) & (boxes[:, 3] <= window.y1)
        inside &= (boxes[:, 0] >= window.x0) & (boxes[:, 2] <= window.x1)
        for k in np.flatnonzero(_free(boxes, occupied) & inside):
            box = np.concatenate([low[k], low[k] + extent])
            if distance <= unit * NEAR or _free(_line_to_point(box, centre, unit), placed).all():
                return box, float(distance)
    return None, 0.0
