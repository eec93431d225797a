"""Orthographic camera and z-buffer: the visible face of each pixel, and the position on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.choices import MAX_ELEVATION
from ddgcli.errors import ParameterError
from ddgcli.mesh.ragged import ranges
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.vectors import row_cross

_MAX_FRAGMENTS = 2_000_000  # pixels of faces in memory at once
_EMPTY_PIXEL = np.iinfo(np.int64).max
_DEPTH_STEPS = 2**30
OUTLINE_DEPTH_STEP = 0.012  # relative to the size of the picture
MARGIN = 0.03  # of a picture, free at each side

View = str | tuple[float, float] | None
FLATNESS = 1e-3  # ratio of the least and the largest extent of a flat shape
TURNED_AXES = {"z": [0, 1, 2], "y": [2, 0, 1], "x": [1, 2, 0]}  # axes, with the one that points up last
# elevation and azimuth in degrees; the vertical axis of the page is z, or y for a look along z
VIEWS = {"x": (0.0, 0.0), "y": (0.0, -90.0), "z": (90.0, -90.0), "iso": (25.0, -60.0)}


@dataclass(frozen=True, eq=False)
class Camera:
    """Orthographic camera over a picture of width x height pixels.

    Parameters
    ----------
    axes : (3, 3) ndarray of float64
        Rows: to the right, up, towards the viewer.
    centre : (3,) ndarray of float64
        Point at the middle of the picture.
    scale : float
        Pixels a length unit.
    """

    axes: NDArray[np.float64]
    centre: NDArray[np.float64]
    scale: float
    width: int
    height: int

    def project(self, points: NDArray) -> NDArray[np.float64]:
        """(..., 3) pixel column, pixel row and depth in pixels (smaller is nearer) of points."""
        projected = ((points - self.centre) * self.scale) @ self.axes.T
        projected *= np.array([1.0, -1.0, -1.0])
        return projected + np.array([self.width / 2, self.height / 2, 0.0])


def view_axes(points: NDArray, view: View = None, up: str = "z") -> NDArray[np.float64]:
    """Camera axes of a view.

    Parameters
    ----------
    points : (k, 3) ndarray
        Points of the shape, which determine the default view.
    view : {'x', 'y', 'z', 'iso'} or (float, float), optional
        Name, or elevation and azimuth in degrees; None looks along the normal of a flat surface, and from
        above and the side at other surfaces.
    up : {'z', 'y', 'x'}
        Coordinate axis that points up on the page.

    Returns
    -------
    (3, 3) ndarray of float64
        Rows: to the right, up, towards the viewer.

    Raises
    ------
    ParameterError
        For an elevation beyond 90 degrees.
    """
    if view is None:
        view = flat_view(np.ptp(points, axis=0), up) or "iso"
    if not isinstance(view, str) and not abs(view[0]) <= MAX_ELEVATION:
        raise ParameterError(f"elevation {view[0]:g} is beyond {MAX_ELEVATION} degrees", parameter="view")
    elevation, azimuth = np.radians(VIEWS[view] if isinstance(view, str) else view)
    towards = np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, row_cross(towards, right), towards]) @ np.eye(3)[TURNED_AXES[up]]


def flat_view(extent: NDArray, up: str = "z") -> str | None:
    """View along the normal of a shape that is flat along a coordinate axis.

    Parameters
    ----------
    extent : (3,) ndarray
        Sides of the bounding box.
    up : {'z', 'y', 'x'}
        Coordinate axis that points up on the page.

    Returns
    -------
    str or None
        Name of the view for `view_axes`; None for other shapes.
    """
    turned = extent[TURNED_AXES[up]]
    thin = int(np.argmin(turned))
    return "xyz"[thin] if turned[thin] < FLATNESS * turned.max() else None


def fitted_camera(points: NDArray, axes: NDArray, width: int, height: int, margin: float = MARGIN) -> Camera:
    """Camera along `axes` whose picture contains all points with a margin.

    Parameters
    ----------
    points : (k, 3) ndarray
    axes : (3, 3) ndarray
        As returned by `view_axes`.
    width, height : int
        Pixels.
    margin : float
        At each side, as a share of the picture.

    Returns
    -------
    Camera
    """
    projected = points @ axes.T
    low, high = projected.min(axis=0), projected.max(axis=0)
    extent = (high - low)[:2]
    extent = np.maximum(extent, 1e-9 * (float(extent.max()) or 1.0))
    inner = (1 - 2 * margin) * np.array([width, height])
    return Camera(axes, axes.T @ ((low + high) / 2), float((inner / extent).min()), width, height)


def unit_box(points: NDArray) -> Callable[[NDArray], NDArray[np.float64]]:
    """Map of points to the cube [-1, 1]^3, so that coordinates of 1e200 do not overflow.

    Parameters
    ----------
    points : (k, 3) ndarray
        Their bounding box is centred at the origin and scaled to a longest side of two.

    Returns
    -------
    callable ((..., 3) ndarray) -> (..., 3) ndarray of float64
    """
    middle = points.min(axis=0) / 2 + points.max(axis=0) / 2
    size = float(np.abs(points - middle).max()) or 1.0
    return lambda p: (np.asarray(p, dtype=np.float64) - middle) / size


@dataclass(frozen=True, eq=False)
class PixelFaces:
    """Visible faces of a picture.

    Parameters
    ----------
    corners : (m, 3, 3) ndarray of float64
        Pixel column, pixel row and depth of the corners of all faces.
    face_image : (height, width) ndarray of int32
        Visible face of each pixel; -1 where there is none.
    depth : (height, width) ndarray of float32
        Depth in pixels; inf where no face is visible.
    """

    corners: NDArray[np.float64]
    face_image: NDArray[np.int32]
    depth: NDArray[np.float32]

    @cached_property
    def pixel(self) -> NDArray[np.int64]:
        """(k,) flat indices of the pixels that show a face."""
        return np.flatnonzero(self.face_image >= 0)

    @cached_property
    def face(self) -> NDArray[np.int32]:
        """(k,) visible face of each of these pixels."""
        return self.face_image.ravel()[self.pixel]

    @cached_property
    def barycentric(self) -> NDArray[np.float64]:
        """(k, 3) position of their centres on the faces."""
        row, column = np.divmod(self.pixel, self.face_image.shape[1])
        return barycentric_at(self.corners, self.face, column + 0.5, row + 0.5)


def rasterise(camera: Camera, points: NDArray, faces: NDArray) -> PixelFaces:
    """Nearest face at the centre of every pixel.

    Parameters
    ----------
    camera : Camera
    points : (n, 3) ndarray
    faces : (m, 3) ndarray of int64

    Returns
    -------
    PixelFaces
    """
    corners = camera.project(points)[faces]
    low, high = corners[..., 2].min(initial=0.0), corners[..., 2].max(initial=1.0)
    to_step = _DEPTH_STEPS / max(high - low, 1e-300)
    nearest = np.full(camera.width * camera.height, _EMPTY_PIXEL, dtype=np.int64)
    area = np.ptp(corners[..., 0], axis=1) * np.ptp(corners[..., 1], axis=1) + 1
    chunk = (np.cumsum(area) // _MAX_FRAGMENTS).astype(np.int64)
    last = chunk[-1:] + 1
    bounds = np.flatnonzero(np.diff(np.concatenate([[-1], chunk, last])))
    for start, stop in zip(bounds[:-1], bounds[1:]):
        pixel, face, depth = _fragments(corners[start:stop], camera.width, camera.height)
        depth -= low
        depth *= to_step
        key = depth.astype(np.int64)
        key <<= 32
        key |= face + start
        np.minimum.at(nearest, pixel, key)
    shape = camera.height, camera.width
    empty = nearest == _EMPTY_PIXEL
    face_image = nearest.astype(np.int32)  # the lower half of the key
    face_image[empty] = -1
    nearest >>= 32
    depth_image = (nearest / to_step + low).astype(np.float32)
    depth_image[empty] = np.inf
    return PixelFaces(corners, face_image.reshape(shape), depth_image.reshape(shape))


def interpolated(barycentric: NDArray, face: NDArray, corner_values: NDArray) -> NDArray[np.float64]:
    """Values at pixels, linear on each face.

    Parameters
    ----------
    barycentric : (k, 3) ndarray
    face : (k,) ndarray of int64
        As in `PixelFaces`.
    corner_values : (m, 3) ndarray
        Values at the corners of the faces.

    Returns
    -------
    (k,) ndarray of float64
    """
    first, second, third = corner_values.T
    total = barycentric[:, 0] * first[face]
    total += barycentric[:, 1] * second[face]
    total += barycentric[:, 2] * third[face]
    return total


def _expanded(first: NDArray, stop: NDArray) -> tuple[NDArray, NDArray]:
    """For ranges first..stop: number of the range, and the integers, of every member."""
    count = np.maximum(stop - first, 0)
    return np.repeat(np.arange(len(count)), count), ranges(first, count)[0]


def _fragments(corners: NDArray, width: int, height: int) -> tuple[NDArray, NDArray, NDArray]:
    """Pixel, face and depth of every pixel centre covered by faces, by scan lines."""
    by_row = np.take_along_axis(corners, np.argsort(corners[..., 1], axis=1)[..., None], axis=1)
    (x0, y0), (x1, y1), (x2, y2) = by_row[..., :2].transpose(1, 2, 0)

    def slope(dx: NDArray, dy: NDArray) -> NDArray:
        return np.divide(dx, dy, out=np.zeros_like(dx), where=dy > 0)

    long, upper, lower = slope(x2 - x0, y2 - y0), slope(x1 - x0, y1 - y0), slope(x2 - x1, y2 - y1)
    first_row = np.clip(np.ceil(y0 - 0.5), 0, height).astype(np.int64)
    last_row = np.clip(np.ceil(y2 - 0.5), 0, height).astype(np.int64)
    face, row = _expanded(first_row, last_row)
    y = row + 0.5
    on_long = x0[face] + (y - y0[face]) * long[face]
    above = y < y1[face]
    on_short = np.where(
        above, x0[face] + (y - y0[face]) * upper[face], x1[face] + (y - y1[face]) * lower[face]
    )
    left = np.clip(np.ceil(np.minimum(on_long, on_short) - 0.5), 0, width).astype(np.int64)
    right = np.clip(np.ceil(np.maximum(on_long, on_short) - 0.5), 0, width).astype(np.int64)
    count = np.maximum(right - left, 0)
    pixel, _ = ranges(row * width + left, count)
    return pixel, np.repeat(face, count), _plane_depth(corners, face, left, y, count)


def _plane_depth(
    corners: NDArray, face: NDArray, left: NDArray, y: NDArray, count: NDArray
) -> NDArray[np.float64]:
    """Depth of faces at `count` pixels from `left` on; within that of their corners, also on slivers."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    determinant = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    inverse = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=np.abs(determinant) > 1e-9)
    in_x = (a[:, 2] * b[:, 1] - a[:, 1] * b[:, 2]) * inverse
    in_y = (a[:, 0] * b[:, 2] - a[:, 2] * b[:, 0]) * inverse
    base = corners[:, 0, 2] - in_x * corners[:, 0, 0] - in_y * corners[:, 0, 1]
    first = base[face] + in_y[face] * y + in_x[face] * (left + 0.5)
    step = ranges(np.zeros_like(left), count)[0]
    depth: NDArray[np.float64] = np.repeat(in_x[face], count) * step
    depth += np.repeat(first, count)
    near, far = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    return np.clip(depth, np.repeat(near[face], count), np.repeat(far[face], count))


def barycentric_at(corners: NDArray, face: NDArray, x: NDArray, y: NDArray) -> NDArray[np.float64]:
    """Positions on faces of points of the picture.

    Parameters
    ----------
    corners : (m, 3, 3) ndarray
        As in `PixelFaces`.
    face : (k,) ndarray of int
    x, y : (k,) ndarray
        In pixels from the left and from above.

    Returns
    -------
    (k, 3) ndarray of float64
        Weights of the corners, in [0, 1]; the columns are contiguous.
    """
    (x0, y0), (x1, y1), (x2, y2) = corners[..., :2].transpose(1, 2, 0)
    ax, ay, bx, by = x1 - x0, y1 - y0, x2 - x0, y2 - y0
    determinant = ax * by - ay * bx
    inverse = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=np.abs(determinant) > 1e-9)
    x, y = x - x0[face], y - y0[face]
    second = x * (by * inverse)[face] - y * (bx * inverse)[face]
    third = y * (ax * inverse)[face] - x * (ay * inverse)[face]
    weights = np.clip(np.stack([1 - second - third, second, third]), 0.0, 1.0)
    return (weights / np.maximum(weights[0] + weights[1] + weights[2], 1e-300)).T


def altitude(camera: Camera, points: NDArray, faces: NDArray) -> NDArray[np.float64]:
    """Height of each corner over its opposite side in the picture.

    Parameters
    ----------
    camera : Camera
    points : (n, 3) ndarray
    faces : (m, 3) ndarray of int64

    Returns
    -------
    (m, 3) ndarray of float64
        In pixels; 0 where the opposite side is a point.
    """
    flat = camera.project(points)[faces][..., :2]
    side = flat[:, NEXT] - flat
    doubled = np.abs(side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0])
    length = np.hypot(side[..., 0], side[..., 1])[:, NEXT]
    return np.divide(doubled[:, None], length, out=np.zeros_like(length), where=length > 0)


def visible_runs(camera: Camera, visible: PixelFaces, curves: Sequence[NDArray]) -> list[NDArray]:
    """Pieces of polylines on or before the surface, of two points at least.

    Parameters
    ----------
    camera : Camera
    visible : PixelFaces
    curves : sequence of (k, 3) ndarray

    Returns
    -------
    list of (k, 2) ndarray of float64
        Columns and rows, about a pixel apart.
    """
    if not len(curves):
        return []
    track = camera.project(np.concatenate(curves))
    count = np.array([len(curve) for curve in curves])
    name = np.repeat(np.arange(len(curves)), count)
    ahead = np.diff(track, axis=0, append=track[-1:])
    ahead[np.cumsum(count) - 1] = 0.0  # the last point of a curve has no successor
    steps = np.maximum(1, np.ceil(np.hypot(*ahead[:, :2].T)).astype(np.int64))
    point, k = _expanded(np.zeros_like(steps), steps)
    samples = track[point] + (k / steps[point])[:, None] * ahead[point]
    column = np.clip(samples[:, 0].astype(np.int64), 1, camera.width - 2)
    row = np.clip(samples[:, 1].astype(np.int64), 1, camera.height - 2)
    # largest depth of 3 x 3 pixels, so that the slope of its own face does not hide a line in the surface;
    # but not across an outline, which would show lines of the far side
    size = max(camera.width, camera.height)
    block = np.stack([visible.depth[row + i, column + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    finite = np.isfinite(block)
    own = np.where(finite[4], block[4], np.where(finite, block, -np.inf).max(axis=0))
    around = np.where(finite & (block <= own + OUTLINE_DEPTH_STEP * size), block, own).max(axis=0)
    shown = samples[:, 2] <= around + 0.002 * size
    owner = name[point]
    cuts = np.flatnonzero((shown[1:] != shown[:-1]) | (owner[1:] != owner[:-1])) + 1
    first, last = np.append(0, cuts), np.append(cuts, len(shown))
    visible_run = np.flatnonzero(shown[first] & (last - first > 1))
    flat = samples[:, :2]
    return [flat[i:j] for i, j in zip(first[visible_run].tolist(), last[visible_run].tolist())]
