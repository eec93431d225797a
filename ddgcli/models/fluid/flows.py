"""Flows with a name, as pointwise vorticity at the vertices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.plane import PLANARITY_TOLERANCE
from ddgcli.mesh.vectors import row_cross, row_dot, tangential, tangents, vector_length
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.extent import bounding_box, middle, plane_axes


def _pair(context: FluidContext, parameters: Any, apart: float) -> tuple[NDArray, NDArray]:
    """(n,) distances from two centres, `apart` of the surface's extent from each other by default.

    On a plane the centres and their direction are projected to it.
    """
    axes, centre = plane_axes(context), middle(context)
    separation = parameters.separation or apart * _extent(context)
    direction = np.array(parameters.direction or np.eye(3)[0], dtype=np.float64)
    shift = np.zeros(3) if parameters.center is None else np.array(parameters.center) - centre
    if axes is not None:
        if parameters.direction is None:
            direction = axes[0]
        along = tangential(direction, axes[2])
        if vector_length(along) <= PLANARITY_TOLERANCE * vector_length(direction):
            raise ValueError("the direction is across the plane of the surface; give one along it")
        direction, shift = along, tangential(shift, axes[2])
    centre = centre + shift
    half = 0.5 * separation * direction / np.linalg.norm(direction)
    if axes is not None:
        return context.distance(centre - half), context.distance(centre + half)
    first, second = (context.nearest_vertex(centre + s * half) for s in (-1, 1))
    if np.array_equal(first, second):
        raise ValueError(
            f"both vortices fall on the vertex at {first.tolist()}; move center, direction or separation"
        )
    return context.distance(first), context.distance(second)


def _extent(context: FluidContext) -> float:
    return float(bounding_box(context)[1].max())


def taylor_vortices(context: FluidContext, parameters: Any) -> NDArray[np.float64]:
    """Two like Taylor vortices, (U/a) (2 - r^2/a^2) exp((1 - r^2/a^2)/2): they separate or merge."""
    a = parameters.core or 0.3 / (2.0 * np.pi) * _extent(context)
    total = np.zeros(context.mesh.n_vertices)
    for r in _pair(context, parameters, 0.8 / (2.0 * np.pi)):
        q = (r / a) ** 2
        total += parameters.strength / a * (2.0 - q) * np.exp(0.5 * (1.0 - q))
    return total


def vortex_pair(context: FluidContext, parameters: Any) -> NDArray[np.float64]:
    """Two Gaussian vortices of opposite sign: they travel side by side."""
    a = parameters.core or 0.06 * _extent(context)
    first, second = _pair(context, parameters, 0.25)
    peak = 2.0 * parameters.strength / a
    return peak * (np.exp(-((first / a) ** 2)) - np.exp(-((second / a) ** 2)))


def rotation(context: FluidContext, parameters: Any) -> NDArray[np.float64]:
    """A turn about the z axis through the middle, in a plane about its normal.

    `strength` is the speed at the distance of the vertex that is the farthest from the middle.
    """
    x = context.points - middle(context)
    radius = float(np.linalg.norm(x, axis=1).max())
    if plane_axes(context) is not None:
        return np.full(len(x), 2.0 * parameters.strength / radius)
    return 2.0 * parameters.strength / radius * x[:, 2] / radius


def taylor_green(context: FluidContext, parameters: Any) -> NDArray[np.float64]:
    """Cells of alternating turn over one period of a rectangle: decays at its exact rate."""
    place, size = bounding_box(context)
    kx, ky = 2.0 * np.pi / size[:2]
    x, y = place[:, :2].T
    return parameters.strength * (kx**2 + ky**2) / ky * np.sin(kx * x) * np.sin(ky * y)


def jet(context: FluidContext, parameters: Any) -> NDArray[np.float64]:
    """A zonal jet along the latitude of `center` round the z axis, with a ripple that makes it unstable.

    The speed is strength * exp(-(s/core)^2), s the arc from the jet on the unit sphere. None on planes.
    """
    if plane_axes(context) is not None:
        return np.zeros(context.mesh.n_vertices)
    x = context.points - middle(context)
    radius = np.linalg.norm(x, axis=1)
    size = float(radius.max())
    latitude = np.arcsin(np.clip(x[:, 2] / np.where(radius > 0, radius, 1.0), -1.0, 1.0))
    centre = np.pi / 4 if parameters.center is None else _latitude(parameters.center)
    width = parameters.core / size if parameters.core else 0.15
    ripple = 0.02 * np.cos(5.0 * np.arctan2(x[:, 1], x[:, 0]))
    s = latitude - centre - ripple
    speed = np.exp(-((s / width) ** 2))
    # vorticity = -d(u cos(latitude)) / (R cos(latitude) d latitude)
    return parameters.strength / size * speed * (2.0 * s / width**2 + np.tan(np.clip(latitude, -1.5, 1.5)))


def _latitude(centre: Any) -> float:
    return float(np.arctan2(centre[2], np.hypot(centre[0], centre[1])))


def rossby_haurwitz(context: FluidContext, parameters: Any) -> NDArray[np.float64]:
    """The spherical harmonic of degree 4 with three waves round the z axis; `strength` its largest speed.

    None on planes.
    """
    if plane_axes(context) is not None:
        return np.zeros(context.mesh.n_vertices)
    x = context.points - middle(context)
    size = float(np.linalg.norm(x, axis=1).max())
    a, b, c = (x / size).T
    return 20.0 / HAURWITZ_SPEED * parameters.strength / size * (a**3 - 3.0 * a * b**2) * c


def shear_layer(context: FluidContext, parameters: Any) -> NDArray[np.float64]:
    """Two opposite shear layers in a rectangle with a ripple: they roll up (Bell, Colella and Glaz 1989)."""
    place, size = bounding_box(context)
    x, y = (place / np.where(size > 0, size, 1.0))[:, :2].T
    width = parameters.core / size[1] if parameters.core else 1.0 / 30.0
    lower, upper = (y - 0.25) / width, (0.75 - y) / width
    layers = (1.0 / np.cosh(upper) ** 2 - 1.0 / np.cosh(lower) ** 2) / (width * size[1])
    return parameters.strength * (layers + 0.05 * 2.0 * np.pi / size[0] * np.cos(2.0 * np.pi * x))


@dataclass(frozen=True)
class NamedFlow:
    """A flow with a name.

    Parameters
    ----------
    vorticity : callable (context, options) -> (n,) ndarray
    keys : tuple of str
        Options that it reads beside `strength`.
    """

    vorticity: Callable[[FluidContext, Any], NDArray[np.float64]]
    keys: tuple[str, ...] = ()


def vortex_ring(context: FluidContext, parameters: Any) -> NDArray[np.float64]:
    """(m, 3) velocity of a ring of circulation `strength` times its radius, by the law of Biot and Savart."""
    centre = middle(context) if parameters.center is None else np.array(parameters.center)
    axis = np.array(parameters.direction or (0.0, 0.0, 1.0))
    axis = axis / np.linalg.norm(axis)
    separation = parameters.separation or 0.4 * float(bounding_box(context)[1].min())
    radius = 0.5 * separation
    core = parameters.core or 0.3 * radius
    first, second = tangents(axis)
    angle = 2.0 * np.pi * (np.arange(RING_SEGMENTS) + 0.5) / RING_SEGMENTS
    out = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    piece = 2.0 * np.pi * radius / RING_SEGMENTS * row_cross(axis, out)
    x, velocity = context.face_points(), np.zeros((len(context.cells), 3))
    for place, along in zip(centre + radius * out, piece):
        apart = x - place
        square = row_dot(apart, apart) + core**2
        velocity += row_cross(along, apart) / square[:, None] ** 1.5
    return parameters.strength * radius / (4.0 * np.pi) * velocity


KEYS = ("core", "separation", "center", "direction")
RING_SEGMENTS = 64
HAURWITZ_SPEED = 1.154701  # largest slope of (x^3 - 3 x y^2) z on the unit sphere


@dataclass(frozen=True)
class VolumeFlow:
    """A flow of volumes with a name: cell velocities (m, 3), and the options that it reads."""

    velocity: Callable[[FluidContext, Any], NDArray[np.float64]]
    keys: tuple[str, ...] = ()


VOLUME_FLOWS = {"vortex-ring": VolumeFlow(vortex_ring, KEYS)}
FLOWS = {
    "taylor-vortices": NamedFlow(taylor_vortices, KEYS),
    "vortex-pair": NamedFlow(vortex_pair, KEYS),
    "rotation": NamedFlow(rotation),
    "taylor-green": NamedFlow(taylor_green),
    "jet": NamedFlow(jet, ("core", "center")),
    "rossby-haurwitz": NamedFlow(rossby_haurwitz),
    "shear-layer": NamedFlow(shear_layer, ("core",)),
}
