"""Pictures of polylines in the plane and in space, coloured by an array, with over- and under-crossings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.vectors import vector_length
from ddgcli.plots.colour import colour_bar, colour_scale, extremes, robust_limits
from ddgcli.plots.page import draw_texts, page, picture_axes
from ddgcli.plots.raster import Camera, View, fitted_camera, unit_box, view_axes

_PAPER, _RIM = (1.0, 1.0, 1.0, 1.0), (0.25, 0.25, 0.25, 1.0)
SIGNED_ARRAYS = ("torsion", "turning_angle")
HALO_WIDTH = 6.0  # points, of the white edge of a curve before others
NEIGHBOUR_RADII = 4.0  # along a curve, within which its segments are neighbours and do not cut each other
MAX_CUT_SEGMENTS = 50_000
VECTOR_SHARE = 0.1  # length of a vector in the picture, in halves of the size of the curves


def draw_curves(
    path: str,
    curves: Sequence[NDArray],
    values: Sequence[NDArray] | None = None,
    *,
    closed: Sequence[bool] | bool = False,
    groups: Sequence[int] | None = None,
    label: str = "",
    title: str = "",
    signed: bool | None = None,
    limits: Sequence[float] | None = None,
    bar: bool = True,
    fit: NDArray | None = None,
    vectors: Sequence[tuple[NDArray, NDArray, str]] = (),
    view: View = None,
    up: str | None = None,
    width: float = 7.0,
    height: float = 5.25,
    dpi: float = 200,
) -> None:
    """Write a picture of polylines; where one passes behind another, it is cut.

    Parameters
    ----------
    path : str
        .png, .svg or .pdf.
    curves : sequence of (k, 2) or (k, 3) ndarray
    values : sequence of (k,) ndarray, optional
        One array of vertex values a curve.
    closed : bool, or one for each curve
    groups : sequence of int, optional
        Group of each curve; curves of different groups (such as times) do not hide each other.
    label, title, signed, limits, bar, fit, view, up
        As for `draw_surface`.
    vectors : sequence of (points (k, 3), vectors (k, 3), colour)
        Thin lines from points, longest 5 % of the size of the curves.
    width, height : float
        Inches.
    dpi : float
    """
    flags = [closed] * len(curves) if isinstance(closed, bool) else list(closed)
    start, stop, shade, curve = _segments(curves, values, flags)
    has_several_groups = groups is not None and len(set(groups)) > 1
    if fit is None:
        fit = np.concatenate([start, stop]) if len(start) else np.zeros((1, 3))
    placed = unit_box(fit)
    start, stop, fit = placed(start), placed(stop), placed(fit)
    axes3 = view_axes(fit, view, up or "z")
    with page(path, width, height, dpi) as figure:
        caption = "" if values is None else extremes(label, np.concatenate(values))
        axes = picture_axes(figure, bar and values is not None, caption=caption)
        box = axes.get_position()
        camera = fitted_camera(
            fit,
            axes3,
            int(box.width * width * dpi),
            int(box.height * height * dpi),
            margin=0.12 if vectors else 0.05,
        )
        a, b = camera.project(start), camera.project(stop)
        flat = bool(np.ptp(np.concatenate([a[:, 2], b[:, 2]])) < 1e-6 * camera.width)
        order = np.argsort(-(a[:, 2] + b[:, 2]), kind="stable")
        if has_several_groups and not flat:
            group = np.asarray(groups)[curve]
            order = order[~is_cut((a + b) / 2, group, curve, HALO_WIDTH / 2 * dpi / 72)[order]]
        lines = np.stack([a, b], axis=1)[order, :, :2]
        mappable = _colour_scale(shade, True if label in SIGNED_ARRAYS else signed, limits)
        plain = np.tile([0.2, 0.4, 0.7, 1.0], (len(order), 1))
        tint = plain if values is None else mappable.to_rgba(shade[order])
        axes.add_collection(_rimmed_lines(lines, tint, flat or has_several_groups))
        for points, directions, colour in vectors:
            axes.add_collection(_vector_lines(camera, placed(points), directions, colour))
        axes.set(xlim=(0, camera.width), ylim=(camera.height, 0), aspect="equal")
        axes.set_axis_off()
        if bar and values is not None:
            colour_bar(figure, mappable, label)
        draw_texts(axes, title, caption)


def _colour_scale(shade: NDArray, signed: bool | None, limits: Sequence[float] | None) -> Any:
    """Colour scale of values, diverging about zero if they are signed."""
    low, high, diverging = robust_limits(shade, signed)
    if limits is not None:
        low, high, diverging = limits[0], limits[1], bool(signed)
    return colour_scale(low, high, diverging)


def _vector_lines(camera: Camera, foot: NDArray, directions: NDArray, colour: str) -> Any:
    """Thin lines from points (k, 3) in the unit box along vectors (k, 3)."""
    from matplotlib.collections import LineCollection

    tip = foot + VECTOR_SHARE * directions / (np.abs(directions).max() or 1.0)
    ends = [camera.project(end)[:, :2] for end in (foot, tip)]
    return LineCollection(np.stack(ends, axis=1), colors=[colour], linewidths=0.8)


def is_cut(middle: NDArray, group: NDArray, curve: NDArray, radius: float) -> NDArray[np.bool_]:
    """Whether a nearer segment of the same group passes before a segment.

    Parameters
    ----------
    middle : (k, 3) ndarray
        Middles of the segments in the picture, in order along each curve, the last coordinate their depth.
    group, curve : (k,) ndarray of int
    radius : float
        Distance in the picture up to which a segment passes before another one.

    Returns
    -------
    (k,) ndarray of bool
        None is cut where there are more than `MAX_CUT_SEGMENTS`: they fill the picture.
    """
    hidden = np.zeros(len(middle), dtype=bool)
    if len(middle) > MAX_CUT_SEGMENTS:
        return hidden
    from scipy.spatial import cKDTree

    i, j = cKDTree(middle[:, :2]).query_pairs(radius, output_type="ndarray").T
    along = np.cumsum(vector_length(np.diff(middle[:, :2], axis=0, prepend=middle[:1, :2])))
    size = np.bincount(curve)
    last = np.cumsum(size) - 1
    whole = along[last] - along[last - size + 1]
    apart = np.abs(along[i] - along[j])
    apart = np.minimum(apart, whole[curve[i]] - apart)  # of a closed curve, the other way round
    crosses = (group[i] == group[j]) & ((curve[i] != curve[j]) | (apart > NEIGHBOUR_RADII * radius))
    behind = np.where(middle[i, 2] > middle[j, 2], i, j)
    hidden[behind[crosses]] = True
    return hidden


def _rimmed_lines(lines: NDArray, tint: NDArray, flat: bool) -> Any:
    """Segments (k, 2, 2), farthest first, over their own dark rims.

    Unless `flat` each rim is over a white edge too, which cuts the segments behind it.
    """
    from matplotlib.collections import LineCollection

    layers = [(3.0, _RIM), (2.2, None)] if flat else [(HALO_WIDTH, _PAPER), (3.0, _RIM), (2.2, None)]
    colour = np.stack([tint if c is None else np.broadcast_to(c, tint.shape) for _, c in layers], axis=1)
    return LineCollection(
        np.repeat(lines, len(layers), axis=0),
        colors=colour.reshape(-1, 4),
        linewidths=np.tile([w for w, _ in layers], len(lines)),
        capstyle="butt",
    )


def _segments(
    curves: Sequence[NDArray], values: Sequence[NDArray] | None, closed: list[bool]
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Starts (k, 3), ends (k, 3), values and curves (k,) of segments, fine enough for an order by depth."""
    starts, ends, shades = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros(0)]
    counts = np.zeros(len(curves), dtype=np.int64)
    for i, curve in enumerate(curves):
        points = np.zeros((len(curve), 3))
        points[:, : np.shape(curve)[1]] = curve
        value = np.asarray(values[i], dtype=np.float64) if values is not None else np.zeros(len(points))
        if closed[i]:
            points, value = np.concatenate([points, points[:1]]), np.append(value, value[0])
        if len(points) < 2:
            continue
        pieces = max(1, 600 // len(points))
        at = np.arange((len(points) - 1) * pieces + 1) / pieces
        fine = np.stack([np.interp(at, np.arange(len(points)), points[:, j]) for j in range(3)], axis=1)
        fine_value = np.interp(at, np.arange(len(points)), value)
        starts.append(fine[:-1])
        ends.append(fine[1:])
        counts[i] = len(fine) - 1
        shades.append((fine_value[:-1] + fine_value[1:]) / 2)
    curve = np.repeat(np.arange(len(curves)), counts)
    return np.concatenate(starts), np.concatenate(ends), np.concatenate(shades), curve
