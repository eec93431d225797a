"""Pictures of a motion: chosen frames beside the chart of energies, sequences, animations."""

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

FRAMES_SHOWN = 4


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame to draw.

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
class Stage:
    """What all pictures of a motion share, so that they can be compared.

    Parameters
    ----------
    fit : (k, 3) ndarray
        Points that every picture holds.
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


def stage(
    shots: Iterable[Shot],
    label: str = "",
    view: Mapping[str, Any] | None = None,
    *,
    limits: tuple[float, float] | None = None,
    edges: bool = False,
    time_unit: str = "s",
) -> Stage:
    """The frame and the colour limits that hold all the shots (robust limits where none are given)."""
    corners, values = [], []
    for shot in shots:
        corners.append(np.stack([shot.mesh.points.min(axis=0), shot.mesh.points.max(axis=0)]))
        if shot.values is not None:
            values.append(shot.values)
    low, high = np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))
    fit = np.stack(np.meshgrid(*zip(low, high)), axis=-1).reshape(-1, 3)
    if not values:
        return Stage(fit, view=view, edges=edges, time_unit=time_unit)
    if limits is not None:
        return Stage(fit, label, limits, limits[0] < 0 < limits[1], edges, view, time_unit)
    bottom, top, signed = robust_limits(np.concatenate(values))
    return Stage(fit, label, (bottom, top), signed, edges, view, time_unit)


def draw_shot(
    path: str, shot: Shot, on: Stage, width: float = 7.0, height: float = 5.25, dpi: float = 200
) -> None:
    """One frame as a picture."""
    title = f"t = {shot.time:.4g} {on.time_unit}" + (f", {on.label}" if shot.values is not None else "")
    draw_surface(
        path, shot.mesh, shot.values, title=title, fit=on.fit,
        signed=on.signed if shot.values is not None else None, limits=on.limits,
        edges=on.edges, width=width, height=height, dpi=dpi, **dict(on.view or {}),
    )  # fmt: skip


def draw_motion(
    path: str,
    shots: Sequence[Shot],
    series: Mapping[str, tuple[NDArray, NDArray]],
    on: Stage,
    ylabel: str,
    width: float = 9.0,
    height: float = 10.8,
    dpi: float = 200,
) -> None:
    """Chosen frames above, the chart of the series below, on one page."""
    from matplotlib.image import imread

    chosen = shots if len(shots) <= FRAMES_SHOWN else [
        shots[k] for k in np.linspace(0, len(shots) - 1, FRAMES_SHOWN).round().astype(int)
    ]  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        pictures = []
        for k, shot in enumerate(chosen):
            draw_shot(f"{folder}/{k}.png", shot, on, 4.5, 3.6)
            pictures.append(imread(f"{folder}/{k}.png"))
        xlabel = f"time [{on.time_unit}]"
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
    path: str, shots: Iterable[Shot], on: Stage, frames_per_second: float, size: tuple[int, int] | None = None
) -> None:
    """An animated GIF, endless, of 1280 x 960 pixels where no size is given."""
    across, down = size or (1280, 960)
    try:
        from PIL import Image
    except ImportError as error:
        raise OutputError(f"{path}: animations need pillow; pip install 'ddgcli[plot]'") from error
    with tempfile.TemporaryDirectory() as folder:
        images = []
        for k, shot in enumerate(shots):
            draw_shot(f"{folder}/{k}.png", shot, on, 7.0, 7.0 * down / across, across / 7.0)
            with Image.open(f"{folder}/{k}.png") as picture:
                images.append(picture.convert("RGB").convert("P", palette=Image.Palette.ADAPTIVE))
        images[0].save(
            path, format="GIF", save_all=True, append_images=images[1:], loop=0,
            duration=max(20, round(1000 / frames_per_second)), optimize=False,
        )  # fmt: skip
