"""Pictures of surfaces coloured by an array: shaded, with a colour bar, good enough to print."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.extrinsic import face_area_vector, face_normal
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.plots.colour import colour_bar, colours, extremes, robust_limits
from ddgcli.plots.page import lettered, page, picture_axes
from ddgcli.plots.raster import (
    OUTLINE,
    Camera,
    Seen,
    View,
    altitude,
    fitted_camera,
    rasterise,
    unit_box,
    view_axes,
    visible_runs,
)

_PLAIN = np.array([0.78, 0.81, 0.86])
_UNKNOWN = np.array([0.62, 0.62, 0.62])
_LIGHT = np.array([-0.35, 0.45, 0.82]) / np.linalg.norm([-0.35, 0.45, 0.82])
_SAMPLES = 2  # each way within a pixel


def draw_surface(
    path: str,
    mesh: TriangleMesh,
    values: NDArray | None = None,
    *,
    label: str = "",
    title: str = "",
    caption: str = "",
    signed: bool | None = None,
    limits: Sequence[float] | None = None,
    value_size: float = 0.0,
    curves: Sequence[NDArray] = (),
    level_lines: Sequence[NDArray] = (),
    curve_width: float = 1.4,
    points: NDArray | None = None,
    edges: bool = False,
    view: View = None,
    up: str = "z",
    fit: NDArray | None = None,
    width: float = 7.0,
    height: float = 5.25,
    dpi: int = 200,
) -> None:
    """Write a picture of a surface.

    Parameters
    ----------
    path : str
        .png, .svg or .pdf (the surface is a raster in all; text, bar and curves are vectors in the last two).
    mesh : TriangleMesh
    values : (n,) or (m,) ndarray, optional
        Colours by vertex or by face; what is not finite is grey.
    label, title, caption : str
        Beside the colour bar, above and below the picture; the caption ends with the extremes of the values.
    signed : bool, optional
        True: diverging colours about zero. None decides by the values.
    limits : (float, float), optional
        Ends of the colour bar; default `robust_limits`.
    value_size : float
        What values are to be seen against: `size` of `robust_limits`.
    curves : sequence of (k, 3) ndarray
        Polylines, drawn where the surface does not hide them, `curve_width` points wide.
    level_lines : sequence of (k, 3) ndarray
        The same, thin and without a halo, under the curves.
    points : (k, 3) ndarray, optional
        Places marked with a dot, where visible.
    edges : bool
        Draw the triangles' sides.
    view : str or (elevation, azimuth), optional
        'x', 'y', 'z', 'iso', or degrees; None looks straight at a flat surface and 'iso' at others.
    up : {'z', 'y', 'x'}
        Axis that points up on the page.
    fit : (k, 3) ndarray, optional
        Points that the picture must hold (all frames of a motion, say); default the mesh's own.
    """
    mesh, frame, placed = _in_unit_box(mesh, fit)
    with page(path, width, height, dpi) as figure:
        axes = picture_axes(figure, coloured=values is not None)
        box = axes.get_position()
        size = [int(round(s * dpi * _SAMPLES)) for s in (box.width * width, box.height * height)]
        camera = fitted_camera(frame, view_axes(frame, view, up), *size)
        seen = rasterise(camera, mesh.points, mesh.faces)
        known = None if values is None else _relevant(mesh, values)
        if known is not None and limits is None:
            low, high, signed = robust_limits(known, signed, value_size)
            limits = low, high
        colour, mappable = _colours(mesh, seen, values, signed, limits)
        image = _picture(camera, mesh, seen, colour, edges)
        axes.imshow(image, extent=(0, size[0], size[1], 0), interpolation="none")
        axes.set_axis_off()
        dots = None if points is None or len(points) == 0 else placed(points)
        _overlay(axes, camera, seen, [placed(c) for c in level_lines], None, "0.15", 0.7, 0.0)
        _overlay(axes, camera, seen, [placed(c) for c in curves], dots, "black", curve_width)
        axes.set(xlim=(0, size[0]), ylim=(size[1], 0))
        if known is not None and limits is not None:
            colour_bar(figure, mappable, label, _beyond(known, *limits))
            caption = "; ".join(filter(None, [caption, extremes(label, known)]))
        lettered(figure, title, caption)


def _in_unit_box(mesh: TriangleMesh, fit: NDArray | None) -> tuple[TriangleMesh, NDArray, Callable]:
    """The mesh and the (k, 3) points that the picture must hold, both in a unit box, and the map into it."""
    used = mesh.points[mesh.topology.referenced_vertex] if mesh.n_faces else mesh.points
    frame = used if fit is None else np.asarray(fit, dtype=np.float64)
    if len(frame) == 0:
        frame = np.zeros((1, 3))
    placed = unit_box(frame)
    return mesh.moved(placed(mesh.points)), placed(frame), placed


def _relevant(mesh: TriangleMesh, values: NDArray) -> NDArray[np.float64]:
    """The values of faces, or of the vertices that a face uses."""
    values = np.asarray(values, dtype=np.float64)
    return values[mesh.topology.referenced_vertex] if len(values) == mesh.n_vertices else values


def _colours(
    mesh: TriangleMesh,
    seen: Seen,
    values: NDArray | None,
    signed: bool | None,
    limits: Sequence[float] | None,
) -> tuple[NDArray, Any]:
    """(k, 3) colour of each seen pixel, and what the colour bar is made from."""
    if values is None or limits is None:
        return np.broadcast_to(_PLAIN, (len(seen.pixel), 3)), None
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    values = np.asarray(values, dtype=np.float64)
    low, high = limits
    if len(values) == mesh.n_vertices:
        shown = np.einsum("ij,ij->i", values[mesh.faces[seen.face]], seen.barycentric)
    else:
        shown = values[seen.face]
    mappable: Any = ScalarMappable(Normalize(low, high), colours(bool(signed)))
    finite = np.isfinite(shown)
    table = mappable.cmap(np.linspace(0, 1, 1024))[:, :3]
    with np.errstate(over="ignore"):
        place = np.clip((np.where(finite, shown, low) - low) / (high - low), 0, 1)
    return np.where(finite[:, None], table[(place * 1023).astype(np.int64)], _UNKNOWN), mappable


def _beyond(known: NDArray, low: float, high: float) -> str:
    """At which ends of the colour bar values lie beyond it."""
    known = known[np.isfinite(known)]
    slack = 1e-9 * (high - low)
    beyond = 2 * bool((known < low - slack).any()) + bool((known > high + slack).any())
    return ("neither", "max", "min", "both")[beyond]


def _corner_normals(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(m, 3, 3) normals to shade with: smooth across a vertex, but sharp where faces turn by 45 degrees."""
    area_vector = face_area_vector(mesh)
    area_vector = area_vector / (np.abs(area_vector).max(initial=0.0) or 1.0)
    flat = face_normal(mesh)
    corner = mesh.faces.ravel()
    total = np.stack(
        [np.bincount(corner, np.repeat(area_vector[:, i], 3), mesh.n_vertices) for i in range(3)], axis=1
    )
    smooth = (total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300))[mesh.faces]
    near = np.einsum("fki,fi->fk", smooth, flat) > np.cos(np.pi / 4)
    return np.where(near[..., None], smooth, flat[:, None, :])


def _picture(camera: Camera, mesh: TriangleMesh, seen: Seen, colour: NDArray, edges: bool) -> NDArray:
    """(h, w, 3) shaded picture, averaged over the samples of each pixel, as bytes."""
    normal = np.einsum("ij,ijk->ik", seen.barycentric, _corner_normals(mesh)[seen.face]) @ camera.axes.T
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    behind = normal[:, 2] < 0
    normal[behind] *= -1
    shade = 0.60 + 0.45 * np.maximum(normal @ _LIGHT, 0.0)
    if not mesh.topology.is_closed:
        shade[behind] *= 0.8
    if edges:
        reach = (seen.barycentric * altitude(camera, mesh.points, mesh.faces)[seen.face]).min(axis=1)
        shade *= 0.45 + 0.55 * np.clip(reach / (0.6 * _SAMPLES), 0, 1)
    flat_image = np.ones((camera.height * camera.width, 3))
    flat_image[seen.pixel] = np.clip(colour * shade[:, None], 0, 1)
    image = flat_image.reshape(camera.height, camera.width, 3)
    image[_outline(seen.depth)] *= 0.35
    h, w = camera.height // _SAMPLES, camera.width // _SAMPLES
    blocks = image[: h * _SAMPLES, : w * _SAMPLES].reshape(h, _SAMPLES, w, _SAMPLES, 3)
    return np.rint(255 * blocks.mean(axis=(1, 3))).astype(np.uint8)


def _outline(depth: NDArray) -> NDArray[np.bool_]:
    """Where something nearer ends: silhouettes, which print in grey as well as in colour."""
    step = OUTLINE * max(depth.shape)
    edge = np.zeros(depth.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            jump = np.diff(depth, axis=axis)
            ahead, back = [slice(None)] * 2, [slice(None)] * 2
            ahead[axis], back[axis] = slice(1, None), slice(None, -1)
            edge[tuple(back)] |= jump > step
            edge[tuple(ahead)] |= jump < -step
    return edge


def _overlay(
    axes: Any,
    camera: Camera,
    seen: Seen,
    curves: Sequence[NDArray],
    points: NDArray | None,
    colour: str,
    width: float,
    halo: float = 1.2,
) -> None:
    from matplotlib.collections import LineCollection

    runs = visible_runs(camera, seen, [curve for curve in curves if len(curve) > 1])
    if runs:
        for under, tint in ((halo, "white"), (0.0, colour)):
            lines = LineCollection(runs, linewidths=width + under, colors=tint, capstyle="round")
            axes.add_collection(lines)
    if points is not None:
        place = camera.project(points)
        column = np.clip(place[:, 0].astype(np.int64), 0, camera.width - 1)
        row = np.clip(place[:, 1].astype(np.int64), 0, camera.height - 1)
        shown = place[:, 2] <= seen.depth[row, column] + 0.01 * max(camera.width, camera.height)
        axes.plot(*place[shown, :2].T, "o", ms=4, mfc=colour, mec="white", mew=0.7, ls="none")
