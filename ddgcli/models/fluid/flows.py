"""Flows with a name, as pointwise vorticity at the vertices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.models.fluid.context import FluidContext


def _middle(context: FluidContext) -> NDArray[np.float64]:
    used = context.points[context.mesh.topology.referenced_vertex]
    return 0.5 * (used.min(axis=0) + used.max(axis=0))


def _extent(context: FluidContext) -> float:
    used = context.points[context.mesh.topology.referenced_vertex]
    return float(np.ptp(used, axis=0).max())


def _pair(context: FluidContext, parameters: Any, apart: float) -> tuple[NDArray, NDArray]:
    """(n,) distances from two centres, `apart` of the surface's extent from each other by default."""
    separation = parameters.separation or apart * _extent(context)
    centre = _middle(context) if parameters.center is None else np.array(parameters.center)
    direction = np.array(parameters.direction or (1.0, 0.0, 0.0), dtype=np.float64)
    half = 0.5 * separation * direction / np.linalg.norm(direction)
    if np.any(context.period > 0) or np.ptp(context.points[:, 2]) == 0:
        return context.distance(centre - half), context.distance(centre + half)
    first, second = (context.nearest_vertex(centre + s * half) for s in (-1, 1))
    if np.array_equal(first, second):
        raise ValueError(
            f"both vortices fall on the vertex at {first.tolist()}; move center, direction or separation"
        )
    return context.distance(first), context.distance(second)


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
    """A turn about the z axis through the middle, `strength` the speed at the widest place."""
    x = context.points - _middle(context)
    radius = float(np.linalg.norm(x, axis=1).max())
    if np.ptp(context.points[:, 2]) == 0:
        return np.full(len(x), 2.0 * parameters.strength / radius)
    return 2.0 * parameters.strength / radius * x[:, 2] / radius


def taylor_green(context: FluidContext, parameters: Any) -> NDArray[np.float64]:
    """Cells of alternating turn over one period of a rectangle: decays at its exact rate."""
    low = context.points.min(axis=0)
    size = np.where(context.period > 0, context.period, np.ptp(context.points, axis=0))
    kx, ky = 2.0 * np.pi / size[:2]
    x, y = (context.points - low)[:, :2].T
    return parameters.strength * (kx**2 + ky**2) / ky * np.sin(kx * x) * np.sin(ky * y)


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


KEYS = ("core", "separation", "center", "direction")
FLOWS = {
    "taylor-vortices": NamedFlow(taylor_vortices, KEYS),
    "vortex-pair": NamedFlow(vortex_pair, KEYS),
    "rotation": NamedFlow(rotation),
    "taylor-green": NamedFlow(taylor_green),
}
