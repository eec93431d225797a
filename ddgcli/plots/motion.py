"""Pictures of a motion: a few frames with the chart of energies, and sequences."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import frames_of_equal_change
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.plots.chart import draw_chart
from ddgcli.plots.colour import beyond, colour_bar, colour_scale, robust_limits
from ddgcli.plots.curve import draw_curves
from ddgcli.plots.glyphs import Glyphs
from ddgcli.plots.page import cells, page
from ddgcli.plots.raster import flat_view, view_axes
from ddgcli.plots.surface import draw_surface
from ddgcli.workers import results_in_order

MAX_PICTURE_FRAMES = 4
CHART_HEIGHT = 0.3  # of the page of a motion
FRAMES_WIDTH = 0.9  # beside the colour bar
BAR_PLACE = (0.91, 0.42, 0.016, 0.46)
DRAWING_MODULES = (
    "matplotlib.figure",
    "matplotlib.collections",
    "matplotlib.backends.backend_agg",
    "PIL.PngImagePlugin",
)
NEAR_SHARE = 0.15  # of the diagonal of all frames: how far beyond them obstacles are shown


@dataclass(frozen=True, eq=False)
class PlotFrame:
    """One trajectory frame to draw.

    Parameters
    ----------
    time : float
    mesh : TriangleMesh or CurveSet
        A CurveSet is drawn alone.
    values : (n,) ndarray, optional
        Colours.
    obstacles : sequence of TriangleMesh
        Bodies around it, drawn in one colour.
    arrows : Glyphs, optional
        Vectors over the colours.
    paths : sequence of (k, 3) ndarray
        Polylines that end at particles.
    """

    time: float
    mesh: TriangleMesh | CurveSet
    values: NDArray | None = None
    obstacles: Sequence[TriangleMesh] = ()
    arrows: Glyphs | None = None
    paths: Sequence[NDArray] = ()


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
    time_name, time_unit : str
        In titles and on the time axis; the unit may be empty.
    ends : {'neither', 'min', 'max', 'both'}
        Ends of the colour bar that values exceed.
    bar : bool
        Draw a colour bar beside every frame.
    """

    fit: NDArray
    label: str = ""
    limits: tuple[float, float] | None = None
    signed: bool = False
    edges: bool = False
    view: Mapping[str, Any] | None = None
    time_name: str = "t"
    time_unit: str = "s"
    ends: str = "neither"
    bar: bool = True


def sequence_style(
    plot_frames: Iterable[PlotFrame],
    label: str = "",
    view: Mapping[str, Any] | None = None,
    *,
    limits: tuple[float, float] | None = None,
    signed: bool | None = None,
    value_size: float = 0.0,
    edges: bool = False,
    time_name: str = "t",
    time_unit: str = "s",
) -> SequenceStyle:
    """Common view and colour limits of frames.

    Obstacles are inside the pictures as far as they are near the bodies.

    Parameters
    ----------
    plot_frames : iterable of PlotFrame
    label : str
        Beside the colour bar.
    view : mapping, optional
        `view` and `up` of `draw_surface`; where the former is None, bodies that stay in a plane normal to an
        axis are seen along it, whatever the obstacles.
    limits : (float, float), optional
        Ends of the colour bar, diverging about zero if zero lies between them; default `robust_limits` over
        all frames.
    signed : bool, optional
        As returned by `robust_limits`.
    value_size : float
        `size` of `robust_limits`.
    edges : bool
        Draw the edges too.
    time_name, time_unit : str

    Returns
    -------
    SequenceStyle
    """
    view = dict(view or {})
    axes = np.concatenate([np.eye(3), view_axes(np.eye(3), view.get("view") or "iso", view.get("up") or "z")])
    ends, values, obstacles = [], [], []
    for plot_frame in plot_frames:
        obstacles += [mesh.points for mesh in plot_frame.obstacles]
        ends.append(_extreme_points(plot_frame.mesh.points, axes))
        if plot_frame.values is not None:
            values.append(plot_frame.values)
    fit = np.concatenate(ends)
    low, high = fit.min(axis=0), fit.max(axis=0)
    view["view"] = view.get("view") or flat_view(high - low, view.get("up") or "z")
    if obstacles:
        reach = NEAR_SHARE * float(np.linalg.norm(high - low))
        near = np.clip(np.concatenate(obstacles), low - reach, high + reach)
        fit = np.concatenate([fit, _extreme_points(near, axes)])
    style = SequenceStyle(fit, view=view, edges=edges, time_name=time_name, time_unit=time_unit)
    if not values:
        return style
    shown = np.concatenate(values)
    if limits is None:
        bottom, top, diverging = robust_limits(shown, signed, value_size)
    else:
        (bottom, top), diverging = limits, limits[0] < 0 < limits[1]
    return replace(
        style, label=label, limits=(bottom, top), signed=diverging, ends=beyond(shown, bottom, top)
    )


def _extreme_points(points: NDArray, axes: NDArray) -> NDArray[np.float64]:
    """The points that lie farthest along axes (k, 3), both ways."""
    along = points @ axes.T
    return np.asarray(points[np.concatenate([along.argmin(axis=0), along.argmax(axis=0)])])


def draw_frame(
    path: str,
    plot_frame: PlotFrame,
    style: SequenceStyle,
    width: float = 7.0,
    height: float = 5.25,
    dpi: float = 200,
) -> None:
    """Draw one frame; the label of its colour bar is in the title."""
    mesh, values = plot_frame.mesh, plot_frame.values
    title = f"{style.time_name} = {plot_frame.time:.4g} {style.time_unit}".rstrip() + (
        f", {style.label}" if style.bar and values is not None else ""
    )
    look = {
        "title": title, "bar": style.bar, "fit": style.fit, "limits": style.limits,
        "signed": style.signed if values is not None else None,
        "width": width, "height": height, "dpi": dpi, **dict(style.view or {}),
    }  # fmt: skip
    if isinstance(mesh, CurveSet):
        paths = mesh.paths
        colours = None if values is None else [values[vertices] for vertices, _ in paths]
        closed = [is_closed for _, is_closed in paths]
        draw_curves(path, [mesh.points[vertices] for vertices, _ in paths], colours, closed=closed, **look)
        return
    draw_surface(
        path, mesh, values, edges=style.edges, context=plot_frame.obstacles, glyphs=plot_frame.arrows,
        curves=plot_frame.paths, curve_width=0.8,
        points=np.array([path[-1] for path in plot_frame.paths]) if len(plot_frame.paths) else None, **look,
    )  # fmt: skip


def draw_frames(
    plot_frames: Iterable[PlotFrame],
    style: SequenceStyle,
    folder: str,
    suffix: str,
    page_size: Mapping[str, float],
    jobs: int = 1,
    finish: Callable[[str], None] | None = None,
) -> Iterator[str]:
    """Draw frames to numbered files in a folder.

    Parameters
    ----------
    plot_frames : iterable of PlotFrame
    style : SequenceStyle
    folder : str
    suffix : str
        As for `page`.
    page_size : mapping
        `width`, `height` and `dpi` of `draw_frame`.
    jobs : int
        Processes; the files have the same bytes for any number.
    finish : callable (path) -> None, optional
        Changes each file in the process that has drawn it.

    Yields
    ------
    str
        Path of each file, in order, as soon as it is written.
    """
    tasks = (
        (f"{folder}/{k}{suffix}", plot_frame, style, page_size, finish)
        for k, plot_frame in enumerate(plot_frames)
    )
    yield from results_in_order(_draw_file, tasks, jobs, modules=(__name__, *DRAWING_MODULES))


def _draw_file(
    path: str,
    plot_frame: PlotFrame,
    style: SequenceStyle,
    page_size: Mapping[str, float],
    finish: Callable[[str], None] | None,
) -> str:
    """Path of one file of `draw_frames`, written here."""
    draw_frame(path, plot_frame, style, **page_size)
    if finish is not None:
        finish(path)
    return path


def draw_motion(
    path: str,
    plot_frames: Sequence[PlotFrame],
    series: Mapping[str, tuple[NDArray, NDArray]],
    style: SequenceStyle,
    ylabel: str,
    width: float = 9.0,
    height: float = 10.8,
    dpi: float = 200,
) -> None:
    """Draw a few frames above the chart of the series, on one page.

    Parameters
    ----------
    path : str
        .png, .svg or .pdf.
    plot_frames : sequence of PlotFrame
        At most `MAX_PICTURE_FRAMES` are drawn, with about equal changes between them.
    series : mapping of name to (x, y)
        As for `draw_chart`, over the time.
    style : SequenceStyle
    ylabel : str
        Label of the vertical axis.
    width, height : float
        Inches.
    dpi : float
    """
    from matplotlib.image import imread

    numbers = frames_of_equal_change(
        [plot_frame.mesh.points for plot_frame in plot_frames],
        [plot_frame.values for plot_frame in plot_frames],
        MAX_PICTURE_FRAMES,
    )
    view = style.view or {}
    extent = np.ptp(style.fit @ view_axes(style.fit, view.get("view"), view.get("up") or "z").T, axis=0)[:2]
    area = (0.0, CHART_HEIGHT, 1.0 if style.limits is None else FRAMES_WIDTH, 1.0 - CHART_HEIGHT)
    boxes = cells(len(numbers), extent, area, width / height)
    look = replace(style, bar=False)
    with tempfile.TemporaryDirectory() as folder:
        pictures = []
        for k, (_, _, across, down) in zip(numbers, boxes):
            name = f"{folder}/{k}.png"
            draw_frame(name, plot_frames[k], look, across * width, down * height, dpi)
            pictures.append(imread(name))
        name = "time" if style.time_name == "t" else style.time_name
        xlabel = f"{name} [{style.time_unit}]" if style.time_unit else name
        draw_chart(
            f"{folder}/chart.png", series, xlabel=xlabel, ylabel=ylabel,
            width=width, height=CHART_HEIGHT * height, dpi=dpi,
        )  # fmt: skip
        pictures.append(imread(f"{folder}/chart.png"))
    with page(path, width, height, dpi) as figure:
        for picture, box in zip(pictures, [*boxes, (0.0, 0.0, 1.0, CHART_HEIGHT)]):
            axes = figure.add_axes(box)
            axes.imshow(picture, interpolation="lanczos")
            axes.set_axis_off()
        if style.limits is not None:
            colour_bar(figure, colour_scale(*style.limits, style.signed), style.label, style.ends, BAR_PLACE)
