"""Known truths: analytic answers on the shapes that a mesh samples (`truth="sphere:1"`).

The shape is centred at the origin in its usual position: z is the axis of a torus and of a cylinder.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError


@dataclass(frozen=True)
class Truth:
    """A shape and its analytic quantities.

    Attributes
    ----------
    name : str
    residual : callable
        (n, 3) points -> (n,) distance from the shape, relative to its size: detects a wrong truth.
    mean_curvature : callable, optional
        (n, 3) points -> (n,), outward normals.
    distance : callable, optional
        ((n, 3) points, source point) -> (n,) geodesic distance.
    eigenvalues : callable, optional
        k -> (k,) smallest eigenvalues of the Laplacian.
    linear_eigenvalue : float, optional
        Eigenvalue of which the linear functions of the position are eigenfunctions.
    """

    name: str
    residual: Callable[[NDArray], NDArray]
    mean_curvature: Callable[[NDArray], NDArray] | None = None
    distance: Callable[[NDArray, NDArray], NDArray] | None = None
    eigenvalues: Callable[[int], NDArray] | None = None
    linear_eigenvalue: float | None = None


def sphere(radius: float) -> Truth:
    """Sphere about the origin."""

    def distance(points: NDArray, source: NDArray) -> NDArray:
        unit = points / np.linalg.norm(points, axis=1, keepdims=True)
        start = source / np.linalg.norm(source)
        chord, sum_ = np.linalg.norm(unit - start, axis=1), np.linalg.norm(unit + start, axis=1)
        return 2 * radius * np.arctan2(chord, sum_)

    def eigenvalues(k: int) -> NDArray:
        degree = np.floor(np.sqrt(np.arange(k)))
        return degree * (degree + 1) / radius**2

    return Truth(
        f"sphere of radius {radius:g}",
        lambda p: np.abs(np.linalg.norm(p, axis=1) - radius) / radius,
        lambda p: np.full(len(p), 1 / radius),
        distance,
        eigenvalues,
        2 / radius**2,
    )


def torus(major: float, minor: float) -> Truth:
    """Torus of revolution about z."""

    def cosine(points: NDArray) -> tuple[NDArray, NDArray]:
        ring = np.hypot(points[:, 0], points[:, 1])
        tube = np.hypot(ring - major, points[:, 2])
        return (ring - major) / np.where(tube > 0, tube, 1.0), tube

    def mean_curvature(points: NDArray) -> NDArray:
        c, _ = cosine(points)
        return (major + 2 * minor * c) / (2 * minor * (major + minor * c))

    return Truth(
        f"torus of radii {major:g}, {minor:g}",
        lambda p: np.abs(cosine(p)[1] - minor) / minor,
        mean_curvature,
    )


def ellipsoid(a: float, b: float, c: float) -> Truth:
    """Ellipsoid with semi-axes a, b, c along x, y, z."""
    axes = np.array([a, b, c])

    def mean_curvature(points: NDArray) -> NDArray:
        # H = (|p|^2 - a^2 - b^2 - c^2) / (2 a^2 b^2 c^2 h^3) up to sign, h^2 = sum p_i^2 / axes_i^4
        h = np.sqrt((points**2 / axes**4).sum(axis=1))
        return ((axes**2).sum() - (points**2).sum(axis=1)) / (2 * np.prod(axes) ** 2 * h**3)

    return Truth(
        f"ellipsoid of semi-axes {a:g}, {b:g}, {c:g}",
        lambda p: np.abs(np.sqrt((p**2 / axes**2).sum(axis=1)) - 1),
        mean_curvature,
    )


def cylinder(radius: float) -> Truth:
    """Cylinder about z."""
    return Truth(
        f"cylinder of radius {radius:g}",
        lambda p: np.abs(np.hypot(p[:, 0], p[:, 1]) - radius) / radius,
        lambda p: np.full(len(p), 0.5 / radius),
    )


def plane() -> Truth:
    """Convex piece of a plane: distances are Euclidean."""

    def residual(points: NDArray) -> NDArray:
        centred = points - points.mean(axis=0)
        _, size, directions = np.linalg.svd(centred, full_matrices=False)
        return np.abs(centred @ directions[-1]) / (np.abs(centred).max() or 1.0)

    return Truth(
        "plane",
        residual,
        lambda p: np.zeros(len(p)),
        lambda p, s: np.linalg.norm(p - s, axis=1),
    )


RADIUS_RANGE = (1e-50, 1e50)  # products of six do not overflow
SHAPES: dict[str, tuple[Callable[..., Truth], str]] = {  # and the names of their radii
    "sphere": (sphere, "R"),
    "torus": (torus, "R,r"),
    "ellipsoid": (ellipsoid, "a,b,c"),
    "cylinder": (cylinder, "R"),
    "plane": (plane, ""),
}


def parse_truth(text: str, points: NDArray) -> Truth:
    """Parse a truth `NAME:R,r,...` and check that the vertices lie on its shape.

    Parameters
    ----------
    text : str
    points : (n, 3) ndarray of float64
        Vertices of the mesh.

    Returns
    -------
    Truth

    Raises
    ------
    ParameterError
        On an unknown shape, a wrong number of radii, or vertices that do not lie on it.
    """
    name, _, numbers = text.partition(":")
    if name not in SHAPES:
        raise ParameterError(f"{text!r}: unknown shape; known: {', '.join(_forms())}", parameter="text")
    shape, names = SHAPES[name]
    count = len(names.split(",")) if names else 0
    try:
        radii = [float(x) for x in numbers.split(",")] if numbers else []
    except ValueError:
        radii = []
    low, high = RADIUS_RANGE
    if len(radii) != count or not all(low <= r <= high for r in radii):
        raise ParameterError(
            f"{text!r}: {name} takes {count} numbers from {low:g} to {high:g}; known: {', '.join(_forms())}",
            parameter="text",
        )
    truth = shape(*radii)
    off = truth.residual(points)
    worst = int(off.argmax())
    if not off[worst] <= 0.05:
        raise ParameterError(
            f"{text!r}: vertex {worst} lies {off[worst]:.2g} of its size off the {truth.name}; "
            "use the right shape, or none",
            parameter="text",
        )
    return truth


def _forms() -> list[str]:
    return [f"{name}:{radii}" if radii else name for name, (_, radii) in SHAPES.items()]
