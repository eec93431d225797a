"""Pictures of a motion: a few frames with the chart of energies, sequences, animations."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import OutputError
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.plots.chart import draw_chart
from ddgcli.plots.colour import robust_limits
from ddgcli.plots.page import page
from ddgcli.plots.surface import draw_surface

MAX_PICTURE_FRAMES = 4


@dataclass(frozen=True, eq=False)
class PlotFrame:
    """One trajectory frame to draw.

    Parameters
    ----------
    time : float
    mesh : TriangleMesh
    values : (n,) ndarray, optional
        Colours.
    """

    time: float
    mesh: TriangleMesh
    values: NDArray | None = None


@dataclass(frozen=True, eq=False)
class SequenceStyle:
    """View, colours and labels that all pictures of a motion share.

    Parameters
    ----------
    fit : (k, 3) ndarray
        Points inside every picture.
    label : str
        Beside the colour bar.
    limits : (float, float), optional
    signed : bool
    edges : bool
        Draw the edges too.
    view : dict
        `view` and `up` of `draw_surface`.
    time_unit : str
    """

    fit: NDArray
    label: str = ""
    limits: tuple[float, float] | None = None
    signed: bool = False
    edges: bool = False
    view: Mapping[str, Any] | None = None
    time_unit: str = "s"


def sequence_style(
    frames: Iterable[PlotFrame],
    label: str = "",
    view: Mapping[str, Any] | None = None,
    *,
    limits: tuple[float, float] | None = None,
    edges: bool = False,
    time_unit: str = "s",
) -> SequenceStyle:
    """Common view and colour limits of frames; robust limits over all frames by default."""
    corners, values = [], []
    for frame in frames:
        corners.append(np.stack([frame.mesh.points.min(axis=0), frame.mesh.points.max(axis=0)]))
        if frame.values is not None:
            values.append(frame.values)
    low, high = np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))
    fit = np.stack(np.meshgrid(*zip(low, high)), axis=-1).reshape(-1, 3)
    if not values:
        return SequenceStyle(fit, view=view, edges=edges, time_unit=time_unit)
    if limits is not None:
        return SequenceStyle(fit, label, limits, limits[0] < 0 < limits[1], edges, view, time_unit)
    bottom, top, signed = robust_limits(np.concatenate(values))
    return SequenceStyle(fit, label, (bottom, top), signed, edges, view, time_unit)


def draw_frame(
    path: str,
    frame: PlotFrame,
    style: SequenceStyle,
    width: float = 7.0,
    height: float = 5.25,
    dpi: float = 200,
) -> None:
    """Draw one frame."""
    title = f"t = {frame.time:.4g} {style.time_unit}" + (
        f", {style.label}" if frame.values is not None else ""
    )
    draw_surface(
        path, frame.mesh, frame.values, title=title, fit=style.fit,
        signed=style.signed if frame.values is not None else None, limits=style.limits,
        edges=style.edges, width=width, height=height, dpi=dpi, **dict(style.view or {}),
    )  # fmt: skip


def draw_motion(
    path: str,
    frames: Sequence[PlotFrame],
    series: Mapping[str, tuple[NDArray, NDArray]],
    style: SequenceStyle,
    ylabel: str,
    width: float = 9.0,
    height: float = 10.8,
    dpi: float = 200,
) -> None:
    """Draw a few frames above the chart of the series, on one page."""
    from matplotlib.image import imread

    chosen = frames if len(frames) <= MAX_PICTURE_FRAMES else [
        frames[k] for k in np.linspace(0, len(frames) - 1, MAX_PICTURE_FRAMES).round().astype(int)
    ]  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        pictures = []
        for k, frame in enumerate(chosen):
            draw_frame(f"{folder}/{k}.png", frame, style, 4.5, 3.6)
            pictures.append(imread(f"{folder}/{k}.png"))
        xlabel = f"time [{style.time_unit}]"
        draw_chart(f"{folder}/chart.png", series, xlabel=xlabel, ylabel=ylabel, width=9.0, height=3.6)
        pictures.append(imread(f"{folder}/chart.png"))
    with page(path, width, height, dpi) as figure:
        places = [(0.0, 0.667), (0.5, 0.667), (0.0, 0.333), (0.5, 0.333)][: len(chosen)]
        boxes = [(x, y, 0.5, 0.333) for x, y in places] + [(0.0, 0.0, 1.0, 0.333)]
        for picture, box in zip(pictures, boxes):
            axes = figure.add_axes(box)
            axes.imshow(picture, interpolation="lanczos")
            axes.set_axis_off()


def draw_animation(
    path: str,
    frames: Iterable[PlotFrame],
    style: SequenceStyle,
    frames_per_second: float,
    size: tuple[int, int] | None = None,
) -> None:
    """Write a looping animated GIF, by default of 1280 x 960 pixels."""
    across, down = size or (1280, 960)
    try:
        from PIL import Image
    except ImportError as error:
        raise OutputError(f"{path}: animations need pillow; pip install 'ddgcli[plot]'") from error
    with tempfile.TemporaryDirectory() as folder:
        images = []
        for k, frame in enumerate(frames):
            draw_frame(f"{folder}/{k}.png", frame, style, 7.0, 7.0 * down / across, across / 7.0)
            with Image.open(f"{folder}/{k}.png") as picture:
                images.append(picture.convert("RGB").convert("P", palette=Image.Palette.ADAPTIVE))
        images[0].save(
            path, format="GIF", save_all=True, append_images=images[1:], loop=0,
            duration=max(20, round(1000 / frames_per_second)), optimize=False,
        )  # fmt: skip
