"""Figures without a screen, and pictures written whole or not at all, the same bytes every time."""

from __future__ import annotations

import importlib.util
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ddgcli.errors import MissingExtraError, OutputError

FORMATS = (".png", ".svg", ".pdf")
# what would differ between two runs of the same picture is left out of the file
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


def check_picture_path(path: str) -> None:
    """Refuse a picture that could not be written, before any work is done for it.

    Raises
    ------
    OutputError
        Unknown extension or missing folder.
    MissingExtraError
        matplotlib is not installed.
    """
    target = Path(path)
    if target.suffix.lower() not in FORMATS:
        raise OutputError(f"{path}: pictures are written as {', '.join(FORMATS)}; change the extension")
    if not target.parent.is_dir():
        raise OutputError(f"{path}: folder {target.parent} does not exist; create it")
    if importlib.util.find_spec("matplotlib") is None:
        raise MissingExtraError("pictures need matplotlib; install it with: pip install 'ddgcli[plot]'")


@contextmanager
def page(path: str, width: float = 7.0, height: float = 5.25, dpi: int = 200) -> Iterator[Any]:
    """A matplotlib Figure that is saved to `path` when the block ends without an error.

    Parameters
    ----------
    path : str
        Ends in .png, .svg or .pdf.
    width, height : float
        Inches.
    dpi : int
        Resolution of .png, and of raster parts of the others.
    """
    check_picture_path(path)
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(width, height), dpi=dpi)
        yield figure
        _save(figure, Path(path), dpi)


def _save(figure: Any, target: Path, dpi: int) -> None:
    suffix = target.suffix.lower()
    try:
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".ddgcli-") as folder:
            partial = os.path.join(folder, "picture" + suffix)
            figure.savefig(partial, dpi=dpi, metadata=_NO_DATE[suffix])
            os.replace(partial, target)
    except OSError as error:
        raise OutputError(f"{target}: cannot be written ({error.strerror}); check the folder") from error


def colours(diverging: bool) -> Any:
    """The colour map of signed values (blue, white, red) or of others (dark to light, readable in grey)."""
    from matplotlib import colormaps
    from matplotlib.colors import LinearSegmentedColormap

    # the ends of RdBu are too dark to carry shading
    ends = (0.08, 0.92) if diverging else (0.04, 1.0)
    base = colormaps["RdBu_r" if diverging else "viridis"]
    return LinearSegmentedColormap.from_list(
        base.name, base([ends[0] + (ends[1] - ends[0]) * i / 32 for i in range(33)])
    )
