"""Level sets with known curvature, and meshes of them: of segmented volumes, of grids and inscribed ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.triangle_mesh import TriangleMesh

Level = Callable[[NDArray, NDArray, NDArray], NDArray]
DIFFERENCE_STEP = 0.02  # voxels; fourth-order differences of functions that vary over ten voxels or more
PROJECTIONS = 30


@dataclass(frozen=True, eq=False)
class Body:
    """The places where a function is negative, in voxels about the origin.

    Parameters
    ----------
    level : callable
        (x, y, z) -> value; smooth with a gradient that does not vanish near the surface.
    reach : (3,) tuple of float
        Half the size of the box that holds the body, or that cuts it.
    counted : callable, optional
        (x, y, z) -> whether the truth holds there; default everywhere.
    """

    level: Level
    reach: tuple[float, float, float]
    counted: Callable[[NDArray, NDArray, NDArray], NDArray] | None = None


def within(*reach: float) -> Callable[[NDArray, NDArray, NDArray], NDArray]:
    """Whether points lie so far inside a box about the origin."""
    return lambda *p: np.all([np.abs(c) < r for c, r in zip(p, reach)], axis=0)


def _differences(level: Level, points: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Values (n,), gradients (n, 3) and Hessians (n, 3, 3) by fourth-order differences."""
    weights = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}

    def gradient(p: NDArray) -> NDArray:
        columns = []
        for axis in np.eye(3) * DIFFERENCE_STEP:
            columns.append(sum(w * level(*(p + k * axis).T) for k, w in weights.items()) / DIFFERENCE_STEP)
        return np.stack(columns, axis=1)

    hessian = np.stack(
        [
            sum(w * gradient(points + k * axis) for k, w in weights.items()) / DIFFERENCE_STEP
            for axis in np.eye(3) * DIFFERENCE_STEP
        ],
        axis=1,
    )
    return level(*points.T), gradient(points), hessian


def projected(body: Body, points: NDArray) -> NDArray[np.float64]:
    """Points of the surface near to some points: Newton steps along the gradient."""
    points = np.array(points, dtype=np.float64)
    for _ in range(PROJECTIONS):
        value, gradient, _ = _differences(body.level, points)
        step = value / (gradient**2).sum(axis=1)
        points -= np.clip(step, -1, 1)[:, None] * gradient
        if np.abs(value).max() < 1e-10:
            break
    return points


def principal_curvatures(body: Body, points: NDArray) -> NDArray[np.float64]:
    """(n, 2) lower and higher principal curvature of the surface at its points, positive where convex."""
    _, gradient, hessian = _differences(body.level, points)
    size = np.linalg.norm(gradient, axis=1)
    normal = gradient / size[:, None]
    tangent = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    form = tangent @ hessian @ tangent / size[:, None, None]
    trace = np.einsum("nii->n", form)
    # the third eigenvalue is zero: the sum of the squares has those of the two curvatures alone
    spread = np.sqrt(np.maximum(2 * np.einsum("nij,nji->n", form, form) - trace**2, 0.0))
    return 0.5 * np.stack([trace - spread, trace + spread], axis=1)


def samples(
    body: Body, spacing: tuple[float, float, float] = (1.0, 1.0, 1.0), turn: NDArray | None = None
) -> tuple[NDArray, Callable[[NDArray], NDArray]]:
    """Values on a grid about the origin, and the map from places of the grid to space.

    `turn` is a rotation of the grid. The grid is off the centre by an irrational share of a voxel.
    """
    turn = np.eye(3) if turn is None else turn
    reach = (
        np.full(3, np.linalg.norm(body.reach)) if not np.allclose(turn, np.eye(3)) else np.array(body.reach)
    )
    shape = np.ceil((2 * reach + 5) / spacing).astype(int)
    shift = (shape - 1) / 2 * spacing + np.array([0.137, 0.271, 0.414])

    def place(index: NDArray) -> NDArray:
        return (index * np.array(spacing) - shift) @ turn

    grid = place(np.indices(tuple(shape)).reshape(3, -1).T)
    values = body.level(*grid.T)
    outside = (np.abs(grid) > np.array(body.reach) + 1).any(axis=1)
    return np.where(outside, np.abs(values) + 1, values).reshape(tuple(shape)), place


def surface_nets(inside: NDArray[np.bool_]) -> TriangleMesh:
    """Dual surface: in each cell of mixed corners the mean of the midpoints of its crossed edges."""
    cells = np.stack(
        [
            inside[a : a + inside.shape[0] - 1, b : b + inside.shape[1] - 1, c : c + inside.shape[2] - 1]
            for a in (0, 1) for b in (0, 1) for c in (0, 1)
        ]
    )  # fmt: skip
    corner = np.array([(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)])
    mixed = cells.any(axis=0) & ~cells.all(axis=0)
    number = np.full(mixed.shape, -1)
    number[mixed] = np.arange(mixed.sum())
    total, count = np.zeros((mixed.sum(), 3)), np.zeros((mixed.sum(), 1))
    for i in range(8):
        for j in range(i):
            if np.abs(corner[i] - corner[j]).sum() == 1:
                crossed = (cells[i] != cells[j])[mixed][:, None]
                total += crossed * (corner[i] + corner[j]) / 2
                count += crossed
    points = np.argwhere(mixed) + total / count
    quads = []
    for axis in range(3):
        u, v = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        step = np.roll(inside, -1, axis=axis)
        for crossing, turned in ((inside & ~step, False), (~inside & step, True)):
            at = np.argwhere(crossing)
            at = at[
                (at[:, [(axis + 1) % 3, (axis + 2) % 3]] > 0).all(axis=1)
                & (at[:, axis] < inside.shape[axis] - 1)
            ]
            quad = np.stack([number[tuple(p.T)] for p in (at - u - v, at - v, at, at - u)], axis=1)
            quad = quad[(quad >= 0).all(axis=1)]
            quads.append(quad[:, ::-1] if turned else quad)
    quad = np.concatenate(quads)
    return TriangleMesh.from_arrays(points, np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]))
