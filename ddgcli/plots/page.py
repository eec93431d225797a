"""Figures without a screen; equal pictures are equal files."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ddgcli.errors import MissingExtraError

FORMATS = (".png", ".svg", ".pdf")
# dates and versions are omitted, because they differ between equal pictures
_NO_DATE = {".png": {"Software": None}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
_STYLE = {
    "svg.hashsalt": "ddgcli",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.linewidth": 0.6,
    "figure.facecolor": "white",
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
        Ends in .png, .svg or .pdf.
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


def picture_axes(figure: Any, coloured: bool, x_range: tuple[float, float] = (0.0, 1.0)) -> Any:
    """Axes of a picture on a part of a page.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    coloured : bool
        Leave space for a colour bar.
    x_range : (float, float)
        Left end and width of that part of the page, as shares of the page.

    Returns
    -------
    matplotlib.axes.Axes
    """
    left, width = x_range
    return figure.add_axes((left + 0.01, 0.05, width * (0.84 if coloured else 0.98), 0.87))


def draw_texts(axes: Any, title: str, caption: str) -> None:
    """Draw the title above the middle of a picture and the caption below it.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Of `picture_axes`.
    title, caption : str
    """
    box, figure = axes.get_position(), axes.figure
    figure.text((box.x0 + box.x1) / 2, 0.955, title, ha="center", va="center", fontsize=10)
    figure.text(box.x0 + 0.01, 0.02, caption, ha="left", va="center", fontsize=7.5, color="0.35")
