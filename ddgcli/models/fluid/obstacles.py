"""Obstacles cut out of a fluid's surface: faces inside are removed, and flat meshes fit the outline.

Before the cut, the nearer end of every edge that crosses the outline moves onto it, so that the boundary is a
polygon on the outline instead of stairs; its neighbours are smoothed as long as the worst angle improves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError, counted
from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.geometry.solids import BoxGap, CylinderGap, SphereGap, Surface, winding_number
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.topology import NEXT, Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_dot
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.extent import is_horizontal

SMOOTHING_PASSES = 12
PROJECTION_STEPS = 4
MIN_SEPARATION = 0.3  # of two vertices on the outline, over the edge between them before
DIFFERENCE_STEP = 1e-6  # of the fluid's size, for the slope of a signed distance
OBSTACLE_REMEDY = "change the size or the place of an obstacle"
SignedDistance = Callable[[NDArray], NDArray[np.float64]]


def signed_distance(section: Any, read: Callable[[str], Any]) -> tuple[SignedDistance, bool]:
    """Distance function of an obstacle, negative inside.

    Parameters
    ----------
    section : object
        Of the scene, with a sphere, box, cylinder or other shape.
    read : callable
        Reads a mesh file.

    Returns
    -------
    distance : callable
        Function of positions (k, 3).
    is_length : bool
        Whether its size is a length.
    """
    shift = np.array(section.position)
    if (solid := _solid(section, shift)) is not None:
        gap = solid.gap
        return lambda x: gap(x)[0], True
    mesh = read(section.mesh).mesh
    if not isinstance(mesh, TriangleMesh) or not mesh.topology.is_closed:
        raise MeshError(f"{section.mesh}: an obstacle must be a closed surface; fill its holes")
    triangles = mesh.points[mesh.faces] + shift
    return lambda x: np.where(np.abs(winding_number(triangles, x)) > 0.5, -1.0, 1.0), False


def _solid(section: Any, shift: NDArray) -> Surface | None:
    """Sphere, box or cylinder of a section of the scene; None for another shape."""
    if section.sphere is not None:
        return SphereGap(np.array(section.sphere.center) + shift, section.sphere.radius)
    if section.box is not None:
        return BoxGap(np.array(section.box.corner) + shift, section.box.size)
    if section.cylinder is not None:
        start, end = np.array(section.cylinder.start) + shift, np.array(section.cylinder.end) + shift
        return CylinderGap(start, end, section.cylinder.radius)
    return None


def without_obstacles(
    context: FluidContext, obstacles: Sequence[tuple[str, SignedDistance, bool]]
) -> FluidContext:
    """The fluid's context with every obstacle cut out of its surface.

    Parameters
    ----------
    context : FluidContext
    obstacles : sequence of (name, signed distance, whether it is a length)

    Returns
    -------
    FluidContext

    Raises
    ------
    ValueError
        When an obstacle cuts no face, or nothing is left.
    """
    points, faces = np.array(context.points), context.cells
    sides = np.zeros((len(obstacles), len(points)))
    for k, (name, distance, smooth) in enumerate(obstacles):
        at = distance(points)
        if smooth and is_horizontal(context):
            points, at = _fitted(context, points, at, distance)
        sides[k] = at
        if not _inside(context, points, faces, at, distance).any():
            raise ValueError(
                f"obstacle {name!r} cuts no cell of {context.name!r}; move it, or refine the mesh"
            )
    inside = np.stack([_inside(context, points, faces, at, d) for at, (_, d, _) in zip(sides, obstacles)])
    outside = ~inside.any(axis=0)
    if not outside.any():
        raise ValueError(f"the obstacles leave nothing of {context.name!r}; make them smaller, or move them")
    referenced = np.zeros(len(points), dtype=bool)
    referenced[faces[outside]] = True
    marks = {}
    for (name, _, _), cut in zip(obstacles, inside):
        on_obstacle = np.zeros(len(points), dtype=bool)
        on_obstacle[faces[cut]] = True
        marks[name] = on_obstacle[referenced]
    number = np.cumsum(referenced) - 1
    return FluidContext(
        context.name, _mesh(context, points[referenced], number[faces[outside]]),
        {name: values[referenced] for name, values in context.vertex.items()},
        {name: values[outside] for name, values in context.face.items()},
        context.period, context.load, marks, _division(context, faces[outside]),
    )  # fmt: skip


def require_apart(context: FluidContext) -> None:
    """Raise MeshError where obstacles touch each other, or the boundary, in vertices of a surface.

    Parameters
    ----------
    context : FluidContext
        Without its obstacles.
    """
    bad = [] if context.is_volume else context.mesh.topology.nonmanifold_vertices
    if len(bad):
        place = ", ".join(f"{value:.4g}" for value in context.points[bad[0]])
        raise MeshError(
            f"at {counted(len(bad), 'vertex', 'vertices')} (first: ({place})) an obstacle touches the "
            "boundary, another obstacle or itself, which leaves no room: "
            f"{OBSTACLE_REMEDY}, or refine the mesh"
        )


def _division(context: FluidContext, cells: NDArray) -> str:
    """Into how many components the cells that are left divide the fluid, in words; "" if none is added."""
    n = len(context.points)
    before, after = (
        len(unique_keys(connected_labels(c, np.roll(c, 1, axis=1), n)[1][c])) for c in (context.cells, cells)
    )
    if after <= before:
        return ""
    whole = "" if before == 1 else f" instead of {before}"
    return (
        f"the obstacles divide {context.name!r} into {after} components{whole}, between which nothing flows; "
        f"{OBSTACLE_REMEDY} to connect them"
    )


def _mesh(context: FluidContext, points: NDArray, faces: NDArray) -> Any:
    if context.is_volume:
        return TetMesh(points, faces)
    if isinstance(context.mesh, TriangleMesh):
        return TriangleMesh.from_arrays(points, faces)
    return IntrinsicMesh(Topology(faces, len(points)), _side_length(context, points, faces), points)


def _side_length(context: FluidContext, points: NDArray, faces: NDArray) -> NDArray[np.float64]:
    side = context.unwrapped(points[faces[:, NEXT]] - points[faces])
    return np.linalg.norm(side, axis=2)


def _inside(
    context: FluidContext, points: NDArray, faces: NDArray, at: NDArray, distance: SignedDistance
) -> NDArray[np.bool_]:
    """(m,) faces inside: by their corners, or by their centre where these disagree."""
    corner = at[faces]
    low, high = corner.min(axis=1) < 0, corner.max(axis=1) > 0
    first = points[faces[:, 0]]
    apart = context.unwrapped(points[faces] - first[:, None])
    centre = distance(first + apart.mean(axis=1)) < 0
    return np.where(low != high, low, centre)


def _fitted(
    context: FluidContext, points: NDArray, at: NDArray, distance: SignedDistance
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points with the outline's nearest vertices on it, and their signed distances, 0 there."""
    topology = context.mesh.topology
    edges = topology.edges[at[topology.edges].prod(axis=1) < 0]
    candidates = unique_keys(edges)
    candidates = candidates[~topology.boundary_vertex[candidates]]
    on_outline = np.zeros(len(points), dtype=bool)
    moved = np.array(points)
    moved[candidates] = _projected(points, candidates, distance)
    for v in candidates[np.argsort(np.abs(at[candidates]), kind="stable")]:
        across = edges[(edges == v).any(axis=1)].sum(axis=1) - v  # ends of the crossing edges of v
        done = across[on_outline[across]]
        reach = np.linalg.norm(points[done] - points[v], axis=1)
        apart = np.linalg.norm(moved[done] - moved[v], axis=1)
        on_outline[v] = len(done) < len(across) and bool((apart > MIN_SEPARATION * reach).all())
    moved[~on_outline] = points[~on_outline]
    at = np.where(on_outline, 0.0, at)
    return _smoothed(context, moved, on_outline | topology.boundary_vertex, at), at


def _projected(points: NDArray, selection: NDArray, distance: SignedDistance) -> NDArray[np.float64]:
    """Points of the outline nearest to the chosen vertices, in the plane of the mesh."""
    step = DIFFERENCE_STEP * float(np.ptp(points, axis=0).max())
    x = points[selection]
    for _ in range(PROJECTION_STEPS):
        slope = np.stack([distance(x + step * e) - distance(x - step * e) for e in np.eye(3)[:2]], axis=1)
        slope /= 2.0 * step
        size = np.maximum(row_dot(slope, slope), 1e-12)
        x = x - np.pad((distance(x) / size)[:, None] * slope, ((0, 0), (0, 1)))
    return x


def _smoothed(context: FluidContext, points: NDArray, fixed: NDArray, at: NDArray) -> NDArray[np.float64]:
    """Free vertices near the outline moved towards the mean of their neighbours."""
    topology, faces = context.mesh.topology, context.mesh.faces
    a, b = topology.edges.T
    near = at == 0
    for _ in range(3):
        near = near.copy()
        crossing = near[a] | near[b]
        near[a[crossing]] = near[b[crossing]] = True
    free = near & ~fixed
    count = np.bincount(topology.edges.ravel(), minlength=len(points))
    outside = (at[faces] >= 0).all(axis=1) & near[faces].any(axis=1)

    def worst(x: NDArray) -> float:
        angle = corner_angle(_side_length(context, x, faces[outside]))
        return float(angle.min(initial=np.pi)) if np.isfinite(angle).all() else 0.0

    best = worst(points)
    for _ in range(SMOOTHING_PASSES):
        apart = context.unwrapped(points[b] - points[a])
        mean = np.stack([np.bincount(a, w, len(points)) - np.bincount(b, w, len(points)) for w in apart.T], 1)
        smoothed = np.where(free[:, None], points + 0.5 * mean / np.maximum(count, 1)[:, None], points)
        if not worst(smoothed) > best:
            break
        points, best = smoothed, worst(smoothed)
    return points
