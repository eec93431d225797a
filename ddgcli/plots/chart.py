"""Line charts whose series differ in colour, marker and dash, to be read without colours too."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.plots.labels import place_labels
from ddgcli.plots.page import page

# Okabe and Ito's palette, dark ones first
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#E69F00", "#56B4E9", "#8B6B00")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", "h", ">")
# as many as colours less one: a ninth line has the first colour, but another marker and dash
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)), (0, (8, 2)))

MIN_AXIS_RANGE = 1e-5  # of the largest value
LABELS_HEIGHT = 0.48  # inches, of the numbers and the label below the horizontal axis
CHARACTERS_PER_INCH = 13  # of the label beside the vertical axis

Series = tuple[ArrayLike, ArrayLike]


def draw_chart(
    path: str,
    series: Mapping[str, Series],
    *,
    xlabel: str = "",
    ylabel: str = "",
    log: str = "",
    title: str = "",
    caption: str = "",
    labels: Mapping[str, Sequence[str]] | None = None,
    ringed: Mapping[str, Sequence[int]] | None = None,
    bars: Mapping[str, Sequence[float]] | None = None,
    pareto_front: Series | None = None,
    threshold: tuple[str, float] | None = None,
    styles: Mapping[str, int] | None = None,
    width: float = 7.0,
    height: float = 4.6,
    dpi: float = 200,
) -> None:
    """Write a chart of several series.

    Parameters
    ----------
    path : str
        .png, .svg or .pdf.
    series : mapping of name to (x, y)
        Points that are not finite (or not positive on a logarithmic axis) are omitted; the line is
        interrupted where both are NaN.
    xlabel, ylabel : str
        Beside the axes.
    log : str
        'x', 'y' or 'xy': which axes are logarithmic.
    title, caption : str
        Above and below the chart.
    labels : mapping of name to texts, optional
        A text beside each point of a series, where no other text or point is; elsewhere with a thin line.
    ringed : mapping of name to indices, optional
        Points to mark with a ring, such as those of the Pareto front.
    bars : mapping of name to lengths, optional
        Uncertainty of each value, drawn as a vertical bar up and down; none where it is infinite. On a
        logarithmic axis a bar of more than a decade below its point ends with the axis.
    pareto_front : (x, y), optional
        Pareto front, drawn as a broad grey line behind the series.
    threshold : (name, y), optional
        Horizontal line across the chart.
    styles : mapping of name to int, optional
        Number of the colour, marker and dash of each series, so that several charts draw a series alike.
        By default the series are numbered in order.
    width, height : float
        Inches.
    dpi : float
    """
    with page(path, width, height, dpi) as figure:
        below = [row for line in caption.splitlines() for row in textwrap.wrap(line, int(16 * width))]
        bottom = max(0.18 + 0.03 * max(0, len(below) - 2), LABELS_HEIGHT / height)
        has_legend = len(series) + (threshold is not None) > 1
        axes = figure.add_axes((0.125, bottom, _width(series, has_legend), 0.91 - bottom))
        drawable = {name: _drawable(x, y, log) for name, (x, y) in series.items()}
        _scale(axes, log)
        if pareto_front is not None:
            _draw_pareto_front(axes, *_drawable(*pareto_front, log))
        texts: list[tuple[str, float, float]] = []
        for k, (name, (x, y, shown)) in enumerate(drawable.items()):
            with_gaps = shown | np.isnan(x) & np.isnan(y)
            _draw_series(axes, k if styles is None else styles[name], name, x[with_gaps], y[with_gaps])
            if labels and name in labels:
                texts += [(labels[name][int(i)], float(x[i]), float(y[i])) for i in np.flatnonzero(shown)]
            _draw_rings(axes, x, y, [i for i in (ringed or {}).get(name, ()) if shown[i]])
        if threshold is not None:
            axes.axhline(threshold[1], label=threshold[0], color="0.3", linewidth=1.0, linestyle=(0, (1, 2)))
        _widen(axes, drawable, log)
        lines = []
        x, y, length = _bars(drawable, bars or {})
        if len(length):
            lines += _draw_bars(axes, x, y, length)
        wrapped_ylabel = textwrap.fill(ylabel, int(CHARACTERS_PER_INCH * height))
        axes.set(xlabel=xlabel, ylabel=wrapped_ylabel, title=title)
        _draw_grid_and_legend(axes, log, has_legend)
        if texts:
            shown_points = [(x[shown], y[shown]) for x, y, shown in drawable.values()]
            if threshold is not None:
                lines.append((np.array(axes.get_xlim()), np.full(2, threshold[1])))
            place_labels(axes, texts, shown_points, shown_points + lines)
        figure.text(0.02, 0.01, "\n".join(below), ha="left", va="bottom", fontsize=7.5, color="0.35")


def _width(series: Mapping[str, Series], has_legend: bool) -> float:
    """Share of the page that the axes take, beside a legend as wide as its longest name."""
    longest = max(map(len, series), default=0)
    return max(0.64 - 0.009 * max(0, longest - 16), 0.4) - 0.015 if has_legend else 0.835


def _draw_pareto_front(axes: Any, x: NDArray, y: NDArray, shown: NDArray) -> None:
    axes.plot(x[shown], y[shown], color="0.85", linewidth=6, solid_capstyle="round", zorder=0.5,
              drawstyle="steps-post", label="Pareto front")  # fmt: skip


def _draw_rings(axes: Any, x: NDArray, y: NDArray, points: Sequence[int]) -> None:
    for i in points:
        axes.plot(x[i], y[i], "o", ms=12, mfc="none", mec="0.3", mew=0.9)


def _draw_bars(axes: Any, x: NDArray, y: NDArray, length: NDArray) -> list[tuple[NDArray, NDArray]]:
    """Draw vertical bars, and widen the axis for them; the ends (x, y) of each.

    On a logarithmic axis those of more than a decade below their point, such as to 0, end with the axis.
    """
    is_log = axes.get_yscale() == "log"
    margin = 1.1 if is_log else 1.0
    low, high = axes.get_ylim()
    below, above = y - length, y + length
    whole = below[below >= 0.1 * y] if is_log else below
    low = min(low, whole.min(initial=np.inf) / margin)
    high = max(high, above.max(initial=-np.inf) * margin)
    ends = np.stack([np.maximum(below, low), above], axis=1)
    axes.vlines(x, *ends.T, color="0.55", linewidth=0.9, zorder=1)
    axes.set_ylim(low, high)
    return list(zip(np.stack([x, x], axis=1), ends))


def _bars(drawable: Mapping[str, Any], bars: Mapping[str, Sequence[float]]) -> tuple[NDArray, ...]:
    """(k,) places, values and lengths of the bars of all series, without infinite ones."""
    rows = []
    for name, lengths in bars.items():
        (x, y, shown), length = drawable[name], np.asarray(lengths, dtype=np.float64)
        shown = shown & (length > 0) & np.isfinite(length)
        rows.append(np.stack([x, y, length])[:, shown])
    return tuple(np.concatenate(rows, axis=1)) if rows else (np.zeros(0),) * 3


def _scale(axes: Any, log: str) -> None:
    axes.set_xscale("log" if "x" in log else "linear")
    axes.set_yscale("log" if "y" in log else "linear")


def _draw_grid_and_legend(axes: Any, log: str, has_legend: bool) -> None:
    """Draw the grid and the legend, and label the axes."""
    axes.grid(True, which="major", color="0.85", linewidth=0.5)
    axes.set_axisbelow(True)
    for name, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        if name in log:
            _label_few_decades(axis)
    axes.spines[["top", "right"]].set_visible(False)
    if has_legend:
        place = {"loc": "center left", "bbox_to_anchor": (1.02, 0.5)}
        axes.legend(**place, frameon=False, handlelength=3.2, fontsize=8)


def _widen(axes: Any, drawable: Mapping[str, Any], log: str) -> None:
    """Widen the axis of series that are constant up to rounding, so that the chart does not magnify noise."""
    values = [y[shown] for _, y, shown in drawable.values() if shown.any()]
    if "y" in log or not values:
        return
    low, high = min(v.min() for v in values), max(v.max() for v in values)
    largest = max(abs(low), abs(high))
    if high - low < MIN_AXIS_RANGE * largest:
        axes.set_ylim(low - 0.05 * largest, high + 0.05 * largest)


def _label_few_decades(axis: Any) -> None:
    """Label 1, 2 and 5 on a logarithmic axis of less than two decades, where decades alone are too few.

    Equal steps where even these are too few.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    from ddgcli.plots.ticks import decade_formatter

    low, high = axis.get_view_interval()
    axis.set_minor_formatter(NullFormatter())
    if high < 100 * low:
        axis.set_major_locator(LogLocator(10, subs=(1, 2, 5)) if high > 5 * low else MaxNLocator(5))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    else:
        axis.set_major_formatter(decade_formatter())


def _drawable(x: ArrayLike, y: ArrayLike, log: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    shown = np.isfinite(x) & np.isfinite(y)
    shown &= (x > 0) | ("x" not in log)
    shown &= (y > 0) | ("y" not in log)
    return x, y, shown


def _draw_series(axes: Any, k: int, name: str, x: np.ndarray, y: np.ndarray) -> None:
    axes.plot(
        x,
        y,
        label=name,
        color=COLOURS[k % len(COLOURS)],
        marker=MARKERS[k % len(MARKERS)],
        linestyle=DASHES[k % len(DASHES)],
        markevery=max(1, len(x) // 12),
        markersize=5,
        linewidth=1.4,
        markeredgecolor="white",
        markeredgewidth=0.5,
    )
