"""Shaded pictures of surfaces, coloured by an array, with a colour bar."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.plots.colour import beyond, colour_bar, colour_scale, extremes, robust_limits
from ddgcli.plots.glyphs import ARROW_LENGTH, Arrows, Glyphs, draw_arrows, draw_glyphs
from ddgcli.plots.hiding_planes import boundary_edges, hides
from ddgcli.plots.labels import POINTS_PER_INCH
from ddgcli.plots.page import WHOLE_PAGE, Box, cells, draw_texts, page, picture_axes
from ddgcli.plots.raster import (
    MARGIN,
    Camera,
    PixelFaces,
    View,
    altitude,
    fitted_camera,
    interpolated,
    rasterise,
    unit_box,
    view_axes,
    visible_runs,
)
from ddgcli.plots.shading import SAMPLES, ShadingSpots, brightness, picture_of_spots, shading_spots
from ddgcli.plots.viewpoint import best_view, up_axis_of

_PLAIN_COLOUR = np.array([0.78, 0.81, 0.86])
_CONTEXT = np.array([0.86, 0.83, 0.76])
_UNKNOWN_COLOUR = np.array([0.42, 0.42, 0.42])  # also in the light darker than white in the shade
LIGHT_SQUARE_COLOUR, BLUE_SQUARE_COLOUR = np.array([0.93, 0.91, 0.85]), np.array([0.30, 0.48, 0.68])
N_SQUARES = 24  # along the larger side of a flat layout


def draw_surface(
    path: str,
    mesh: TriangleMesh,
    values: NDArray | None = None,
    *,
    width: float = 7.0,
    height: float = 5.25,
    dpi: float = 200,
    **options: Any,
) -> None:
    """Write a picture of a surface.

    Parameters
    ----------
    path : str
        .png, .svg or .pdf (the surface is a raster in all; text, bar and curves are vectors in the last two).
    mesh : TriangleMesh
    values : (n,) or (m,) ndarray, or (n, 2), optional
        Colours by vertex or by face; grey if not finite. Two flat coordinates by vertex: squares.
    width, height : float
        Inches.
    dpi : float
    **options
        As listed below.

    Other Parameters
    ----------------
    label, title, caption : str
        Beside the colour bar, above and below the picture; the caption ends with the extremes of the values.
    signed : bool, optional
        True: diverging colours about zero. None decides by the values.
    limits : (float, float), optional
        Ends of the colour bar; default `robust_limits`.
    bar : bool
        Draw the colour bar.
    value_size : float
        `size` of `robust_limits`.
    curves : sequence of (k, 3) ndarray
        Polylines, drawn where the surface does not hide them.
    curve_width, curve_halo : float
        Width of the polylines, and of the white rim around them, in points.
    curve_aspect : float, optional
        Largest width of a polyline over its length in the picture: edges of a dense mesh become thinner.
    level_lines : sequence of (k, 3) ndarray
        The same, thin and without a halo, under the curves.
    points : (k, 3) ndarray, optional
        Points marked with a dot, where visible.
    glyphs : Glyphs, optional
        Vectors drawn where visible.
    arrows : sequence of Arrows
        Frames along curves, drawn over them where their feet are visible.
    interest : (n,) or (m,) ndarray, optional
        Weights for the choice of a view with `view` None; default the size of the values.
    edges : bool
        Draw the triangles' sides.
    context : sequence of TriangleMesh
        Further surfaces, drawn in one colour; planes in front of the surface as their outlines.
    view : str or (elevation, azimuth), optional
        'x', 'y', 'z', 'iso', or degrees; None: along the normal of a flat surface, else the 'iso'
        view that shows most of the interest (with `fit`, always the first).
    up : {'z', 'y', 'x'}, optional
        Axis that points up on the page; None: by the shape (with `fit`: z).
    fit : (k, 3) ndarray, optional
        Points inside the picture, such as all frames of a motion; default those of the mesh.
    """
    with page(path, width, height, dpi) as figure:
        _paint(figure, WHOLE_PAGE, mesh, values, **options)


def draw_beside(
    path: str,
    pictures: Sequence[tuple[TriangleMesh, dict[str, Any]]],
    *,
    width: float = 7.0,
    height: float = 5.25,
    dpi: float = 200,
    **options: Any,
) -> None:
    """Write pictures of surfaces on one page, in as many columns as show them largest, without colour bars.

    Parameters
    ----------
    path : str
        .png, .svg or .pdf.
    pictures : sequence of (TriangleMesh, dict)
        Each mesh with its own `values` and options of `draw_surface`.
    width, height : float
        Size of the page in inches.
    dpi : float
    **options
        Options of all pictures.
    """
    looks = [{**options, **own} for _, own in pictures]
    extents = [_extent(mesh, look.get("view"), look.get("up")) for (mesh, _), look in zip(pictures, looks)]
    with page(path, width, height, dpi) as figure:
        boxes = cells(len(pictures), np.array(extents), WHOLE_PAGE, width / height)
        for (mesh, _), look, box in zip(pictures, looks, boxes):
            _paint(figure, box, mesh, **look)


def _extent(mesh: TriangleMesh, view: View, up: str | None) -> NDArray[np.float64]:
    """Width and height of a surface on the page."""
    mesh, corners, _ = _in_unit_box(mesh, None)
    return np.ptp(corners @ view_axes(corners, view, up or up_axis_of(mesh)).T, axis=0)[:2]


def _paint(
    figure: Any,
    box: Box,
    mesh: TriangleMesh,
    values: NDArray | None = None,
    *,
    label: str = "",
    title: str = "",
    caption: str = "",
    signed: bool | None = None,
    limits: Sequence[float] | None = None,
    bar: bool = True,
    value_size: float = 0.0,
    curves: Sequence[NDArray] = (),
    level_lines: Sequence[NDArray] = (),
    curve_width: float = 1.4,
    curve_halo: float = 1.2,
    curve_aspect: float | None = None,
    points: NDArray | None = None,
    glyphs: Glyphs | None = None,
    arrows: Sequence[Arrows] = (),
    interest: NDArray | None = None,
    edges: bool = False,
    context: Sequence[TriangleMesh] = (),
    view: View = None,
    up: str | None = None,
    fit: NDArray | None = None,
) -> None:
    """Paint a surface on a part of the page."""
    mesh, fit_points, placed = _in_unit_box(mesh, fit)
    squares = values is not None and values.ndim == 2
    plot_values = None if values is None or squares else _relevant(mesh, values)
    if plot_values is not None:
        caption = "; ".join(filter(None, [caption, extremes(label, plot_values)]))
    axes = picture_axes(figure, bar and plot_values is not None, box, caption)
    if plot_values is not None and limits is None:
        low, high, signed = robust_limits(plot_values, signed, value_size)
        limits = low, high
    if fit is None:
        up = up or up_axis_of(mesh)
        if view is None:
            view = best_view(mesh, _interest(interest, values, signed, limits), up)
    size = _sampled_size(figure, axes)
    margin = ARROW_LENGTH + MARGIN if arrows else MARGIN
    camera = fitted_camera(fit_points, view_axes(fit_points, view, up or "z"), size[0], size[1], margin)
    others = [other.moved_unchecked(placed(other.points)) for other in context]
    planes = [hides(other, mesh.points, camera.axes[2]) for other in others]
    outlines = [edge for other, before in zip(others, planes) if before for edge in boundary_edges(other)]
    others = [other for other, before in zip(others, planes) if not before]
    from_below = bool(camera.axes[2]["xyz".index(up or "z")] < 0)
    image, visible, mappable = _surface_image(camera, mesh, values, signed, limits, others, edges, from_below)
    axes.imshow(image, extent=(0, size[0], size[1], 0), interpolation="none")
    axes.set_axis_off()
    _overlay(axes, camera, visible, outlines, None, "0.6", 0.7, 0.0)
    dots = None if points is None or len(points) == 0 else placed(points)
    _overlay(axes, camera, visible, [placed(c) for c in level_lines], None, "0.15", 0.7, 0.0)
    black_curves = [placed(c) for c in curves]
    _overlay(axes, camera, visible, black_curves, dots, "black", curve_width, curve_halo, curve_aspect)
    if glyphs is not None:
        draw_glyphs(axes, camera, visible, replace(glyphs, places=placed(glyphs.places)))
    draw_arrows(axes, camera, visible, [replace(one, places=placed(one.places)) for one in arrows])
    axes.set(xlim=(0, size[0]), ylim=(size[1], 0))
    if plot_values is not None and limits is not None and bar:
        whole = values is not None and np.asarray(values).dtype.kind in "iub"
        colour_bar(figure, mappable, label, beyond(plot_values, *limits), whole=whole)
    draw_texts(axes, title, caption, box)


def _sampled_size(figure: Any, axes: Any) -> list[int]:
    """Width and height of axes in samples."""
    box = axes.get_position()
    return [
        int(round(share * inches * figure.dpi * SAMPLES))
        for share, inches in zip((box.width, box.height), figure.get_size_inches())
    ]


def _surface_image(
    camera: Camera,
    mesh: TriangleMesh,
    values: NDArray | None,
    signed: bool | None,
    limits: Sequence[float] | None,
    context: list[TriangleMesh],
    edges: bool,
    from_below: bool,
) -> tuple[NDArray, PixelFaces, Any]:
    """Picture of a surface among grey ones, what is visible in it, and the colour scale of its values."""
    n_faces = mesh.n_faces
    if context:
        mesh, values = _with_context(mesh, values, context)
    visible = rasterise(camera, mesh.points, mesh.faces)
    flat = values if values is not None and values.ndim == 2 else None
    heights = altitude(camera, mesh.points, mesh.faces) if edges else None
    spots = shading_spots(visible, every_sample=flat is not None, heights=heights)
    if flat is not None:
        colour, mappable = _squares(mesh, spots, flat), None
    else:
        colour, mappable = _colours(mesh, spots, values, signed, limits)
    if context:
        colour = np.where((spots.face < n_faces)[:, None], colour, _CONTEXT)
    # the backs of a coloured surface are as bright as its fronts, as the colour bar is
    light = brightness(
        camera, mesh, spots, heights=heights, from_below=from_below, shade_backs=values is None
    )
    shown = np.clip(colour * light[:, None], 0, 1)
    return picture_of_spots(visible, spots, shown), visible, mappable


def _with_context(
    mesh: TriangleMesh, values: NDArray | None, context: Sequence[TriangleMesh]
) -> tuple[TriangleMesh, NDArray | None]:
    """One mesh of a surface and further ones behind it; their values are NaN."""
    start = np.cumsum([mesh.n_vertices, *(other.n_vertices for other in context)])
    points = np.concatenate([mesh.points, *(other.points for other in context)])
    faces = np.concatenate([mesh.faces, *(other.faces + k for other, k in zip(context, start))])
    joined = TriangleMesh(points, Topology(faces, len(points)))
    if values is not None:
        on_vertices = len(values) == mesh.n_vertices
        extra = (len(points) if on_vertices else len(faces)) - len(values)
        blank = np.full((extra, *np.shape(values)[1:]), np.nan)
        values = np.concatenate([np.asarray(values, dtype=np.float64), blank])
    return joined, values


def _interest(
    interest: NDArray | None, values: NDArray | None, signed: bool | None, limits: Sequence[float] | None
) -> NDArray | None:
    """Weights for the choice of a view: the values, or the sizes of signed ones."""
    if interest is not None or values is None or limits is None:
        return interest
    low, high = limits
    size = np.abs(values) / high if signed else (values - low) / (high - low)
    return np.clip(size, 0.0, 1.0)


def _squares(mesh: TriangleMesh, spots: ShadingSpots, flat: NDArray) -> NDArray[np.float64]:
    """(s, 3) colours of a chessboard over flat coordinates; conformal maps preserve the squares."""
    corners = flat[mesh.topology.referenced_vertex]
    side = float(np.ptp(corners, axis=0).max()) / N_SQUARES or 1.0
    at = np.einsum("fki,fk->fi", flat[mesh.faces[spots.face]], spots.barycentric) / side
    odd = np.floor(at - corners.min(axis=0) / side).sum(axis=1) % 2 == 1
    return np.where(odd[:, None], BLUE_SQUARE_COLOUR, LIGHT_SQUARE_COLOUR)


def _in_unit_box(mesh: TriangleMesh, fit: NDArray | None) -> tuple[TriangleMesh, NDArray, Callable]:
    """Mesh and (k, 3) points inside the picture, both in a unit box, and the map into it."""
    corners = mesh.points[mesh.topology.referenced_vertex] if mesh.n_faces else mesh.points
    fit_points = corners if fit is None else np.asarray(fit, dtype=np.float64)
    if len(fit_points) == 0:
        fit_points = np.zeros((1, 3))
    placed = unit_box(fit_points)
    return mesh.moved_unchecked(placed(mesh.points)), placed(fit_points), placed


def _relevant(mesh: TriangleMesh, values: NDArray) -> NDArray[np.float64]:
    """The values of faces, or of the vertices that a face uses."""
    values = np.asarray(values, dtype=np.float64)
    return values[mesh.topology.referenced_vertex] if len(values) == mesh.n_vertices else values


def _colours(
    mesh: TriangleMesh,
    spots: ShadingSpots,
    values: NDArray | None,
    signed: bool | None,
    limits: Sequence[float] | None,
) -> tuple[NDArray, Any]:
    """(s, 3) colour of each spot, and the mappable of the colour bar."""
    if values is None or limits is None:
        return np.broadcast_to(_PLAIN_COLOUR, (len(spots.face), 3)), None
    values = np.asarray(values, dtype=np.float64)
    low, high = limits
    if len(values) == mesh.n_vertices:
        shown = interpolated(spots.barycentric, spots.face, values[mesh.faces])
    else:
        shown = values[spots.face]
    mappable = colour_scale(low, high, bool(signed))
    finite = np.isfinite(shown)
    table = mappable.cmap(np.linspace(0, 1, 1024))[:, :3]
    with np.errstate(over="ignore"):
        place = np.clip((np.where(finite, shown, low) - low) / (high - low), 0, 1)
    return np.where(finite[:, None], table[(place * 1023).astype(np.int64)], _UNKNOWN_COLOUR), mappable


def _page_lengths(axes: Any, runs: Sequence[NDArray]) -> NDArray[np.float64]:
    """Length of each polyline on the page, in points."""
    unit = POINTS_PER_INCH / (axes.figure.dpi * SAMPLES)
    return unit * np.array([np.linalg.norm(np.diff(run, axis=0), axis=1).sum() for run in runs])


def _overlay(
    axes: Any,
    camera: Camera,
    visible: PixelFaces,
    curves: Sequence[NDArray],
    points: NDArray | None,
    colour: str,
    width: float,
    halo: float = 1.2,
    aspect: float | None = None,
) -> None:
    from matplotlib.collections import LineCollection

    runs = visible_runs(camera, visible, [curve for curve in curves if len(curve) > 1])
    if runs:
        widths = width if aspect is None else np.minimum(width, aspect * _page_lengths(axes, runs))
        for under, tint in ((halo, "white"), (0.0, colour)):
            lines = LineCollection(runs, linewidths=widths + under, colors=tint, capstyle="round")
            axes.add_collection(lines)
    if points is not None:
        place = camera.project(points)
        column = np.clip(place[:, 0].astype(np.int64), 0, camera.width - 1)
        row = np.clip(place[:, 1].astype(np.int64), 0, camera.height - 1)
        shown = place[:, 2] <= visible.depth[row, column] + 0.01 * max(camera.width, camera.height)
        axes.plot(*place[shown, :2].T, "o", ms=4, mfc=colour, mec="white", mew=0.7, ls="none")
