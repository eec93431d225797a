"""Figures without a screen; equal pictures are equal files."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MissingExtraError

Box = tuple[float, float, float, float]  # left, bottom, width and height, as shares of the page
WHOLE_PAGE: Box = (0.0, 0.0, 1.0, 1.0)
FORMATS = (".png", ".svg", ".pdf")
RAW = ".rgba"  # bytes of the pixels alone, for pictures that are read again at once
# dates and versions are omitted, because they differ between equal pictures
_NO_DATE = {".png": {"Software": None}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}, RAW: None}
_STYLE = {
    "svg.hashsalt": "ddgcli",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.linewidth": 0.6,
    "figure.facecolor": "white",
    "text.parse_math": False,  # dollars in the names of files and arrays are dollars
}


def require_matplotlib() -> None:
    """Raise MissingExtraError if matplotlib is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise MissingExtraError("pictures need matplotlib; pip install 'ddgcli[plot]'")


@contextmanager
def page(path: str, width: float = 7.0, height: float = 5.25, dpi: float = 200) -> Iterator[Any]:
    """Matplotlib figure that is saved to `path` if the block raises nothing.

    Parameters
    ----------
    path : str
        Ends in .png, .svg, .pdf or `RAW`.
    width, height : float
        Inches.
    dpi : float
        Resolution of .png, and of raster parts of the others.

    Yields
    ------
    matplotlib.figure.Figure

    Raises
    ------
    MissingExtraError
        matplotlib is not installed.
    """
    require_matplotlib()
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        # a hundredth of a pixel more, because the number of pixels is rounded down
        figure = Figure(figsize=(width + 0.01 / dpi, height + 0.01 / dpi), dpi=dpi)
        yield figure
        figure.savefig(path, dpi=dpi, metadata=_NO_DATE[Path(path).suffix.lower()])


def cells(count: int, extents: NDArray, area: Box, page_ratio: float) -> list[Box]:
    """Places of several pictures: of the numbers of columns the one that shows the shapes largest.

    Parameters
    ----------
    count : int
        Pictures.
    extents : (2,) or (count, 2) ndarray
        Width and height of the shapes.
    area : Box
        Part of the page for all pictures.
    page_ratio : float
        Width over height of the page.

    Returns
    -------
    list of Box
        Row by row from the top left.
    """
    left, bottom, width, height = area
    largest = extents.max(axis=-1, keepdims=True)
    shapes = np.maximum(extents, 1e-9 * np.where(largest > 0, largest, 1.0))

    def size(columns: int) -> float:
        cell = np.array([page_ratio * width / columns, height / -(-count // columns)])
        return float(np.log((cell / shapes).min(axis=-1)).mean())

    columns = max(range(1, count + 1), key=size)
    across, down = width / columns, height / -(-count // columns)
    return [
        (left + (k % columns) * across, bottom + height - (k // columns + 1) * down, across, down)
        for k in range(count)
    ]


def picture_axes(figure: Any, coloured: bool, box: Box = WHOLE_PAGE) -> Any:
    """Axes of a picture on a part of a page.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    coloured : bool
        Leave space for a colour bar.
    box : Box
        That part.

    Returns
    -------
    matplotlib.axes.Axes
    """
    left, bottom, width, height = box
    inner = (left + 0.01, bottom + 0.05 * height, width * (0.84 if coloured else 0.98), 0.87 * height)
    return figure.add_axes(inner)


def draw_texts(axes: Any, title: str, caption: str, box: Box = WHOLE_PAGE) -> None:
    """Draw the title above the middle of a picture and the caption below it.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Of `picture_axes`.
    title, caption : str
    box : Box
        As for `picture_axes`.
    """
    inner, figure = axes.get_position(), axes.figure
    _, bottom, _, height = box
    middle = (inner.x0 + inner.x1) / 2
    figure.text(middle, bottom + 0.955 * height, title, ha="center", va="center", fontsize=10)
    caption_style = {"ha": "left", "va": "center", "fontsize": 7.5, "color": "0.35"}
    figure.text(inner.x0 + 0.01, bottom + 0.02 * height, caption, **caption_style)
