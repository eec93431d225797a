"""Figures without a screen; equal pictures are equal files."""

from __future__ import annotations

import importlib.util
import os
import textwrap
from collections.abc import Iterator, Sequence
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
CAPTION_POINTS = 7.5
CHARACTERS_PER_INCH, LINE_HEIGHT = 17, 0.13  # of a caption, and inches
BAR_SPACE = 1.1  # inches beside a picture for a colour bar, its numbers and its label
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


PAGE_WIDTH = 7.0  # inches: the text scales with the picture,
MIN_DPI = 80.0  # but not below this resolution, at which its least letters have 8 pixels


def size_in_inches(pixels: Sequence[int], width: float = PAGE_WIDTH) -> dict[str, float]:
    """Arguments of `page` for a picture.

    Parameters
    ----------
    pixels : (int, int)
        Width and height.
    width : float
        Largest width in inches.

    Returns
    -------
    dict
        `width`, `height` and `dpi`.
    """
    width = min(width, pixels[0] / MIN_DPI)
    return {"width": width, "height": width * pixels[1] / pixels[0], "dpi": pixels[0] / width}


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
    with no_backend_variable():
        import matplotlib
        from matplotlib.figure import Figure

    # a matplotlibrc file of the user changes nothing
    defaults = {name: value for name, value in matplotlib.rcParamsDefault.items() if "backend" not in name}
    with matplotlib.rc_context({**defaults, **_STYLE}):
        # a hundredth of a pixel more, because the number of pixels is rounded down
        figure = Figure(figsize=(width + 0.01 / dpi, height + 0.01 / dpi), dpi=dpi)
        yield figure
        figure.savefig(path, dpi=dpi, metadata=_NO_DATE[Path(path).suffix.lower()])


@contextmanager
def no_backend_variable() -> Iterator[None]:
    """Hide MPLBACKEND from the import of matplotlib, which fails where that backend is not installed.

    Figures are written without a backend. Jupyter exports the variable to the programs that it starts.

    Yields
    ------
    None
    """
    backend = os.environ.pop("MPLBACKEND", None)
    try:
        yield
    finally:
        if backend is not None:
            os.environ["MPLBACKEND"] = backend


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


def picture_axes(figure: Any, coloured: bool, box: Box = WHOLE_PAGE, caption: str = "") -> Any:
    """Axes of a picture on a part of a page.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    coloured : bool
        Leave space for a colour bar.
    box : Box
        That part.
    caption : str
        Below the picture; leave space for its lines.

    Returns
    -------
    matplotlib.axes.Axes
    """
    left, bottom, width, height = box
    page_width, page_height = figure.get_size_inches()
    lines = len(_wrapped(caption, width * page_width))
    below = min(max(0.05 * height, (lines * LINE_HEIGHT + 0.05) / page_height if lines else 0), 0.5 * height)
    share = max(0.16 * width, (BAR_SPACE + 0.01) / page_width) if coloured else 0.02 * width
    inner = (left + 0.01, bottom + below, width - share, 0.92 * height - below)
    return figure.add_axes(inner)


def _wrapped(caption: str, width: float) -> list[str]:
    """Lines of a caption that fit into a width in inches."""
    return textwrap.wrap(caption, max(int(CHARACTERS_PER_INCH * width), 12))


def draw_texts(axes: Any, title: str, caption: str, box: Box = WHOLE_PAGE) -> None:
    """Draw the title above the middle of a picture and the caption below it.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        As returned by `picture_axes`.
    title, caption : str
    box : Box
        As for `picture_axes`.
    """
    inner, figure = axes.get_position(), axes.figure
    _, bottom, width, height = box
    middle = (inner.x0 + inner.x1) / 2
    figure.text(middle, bottom + 0.955 * height, title, ha="center", va="center", fontsize=10)
    lines = _wrapped(caption, width * figure.get_size_inches()[0])
    caption_style = {"ha": "left", "va": "center", "fontsize": CAPTION_POINTS, "color": "0.35"}
    middle_of_lines = max(
        0.02 * height, (0.5 * len(lines) * LINE_HEIGHT + 0.02) / figure.get_size_inches()[1]
    )
    figure.text(inner.x0 + 0.01, bottom + middle_of_lines, "\n".join(lines), **caption_style)
