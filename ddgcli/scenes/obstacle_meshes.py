"""Meshes of the obstacles of a scene, for trajectories and pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.shapes import box, grid, icosphere
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import tangents
from ddgcli.scenes.shapes import rotation_matrix

BALL_SUBDIVISIONS = 4
PLANE_CELLS = 8
CYLINDER_SIDES = 48
PLANE_SHARE = 0.75  # half the side of the square drawn for a plane, over the diagonal of the bodies


def obstacle_meshes(
    sections: Sequence[Any], bodies: Sequence[Any], read: Callable[[str], Any]
) -> dict[str, TriangleMesh]:
    """Mesh of every object of role `obstacle`, by name, where it is at the start.

    Parameters
    ----------
    sections : sequence of ObjectSection
        All objects of the scene.
    bodies : sequence of meshes
        The moving objects; a plane is drawn as a square below them that is larger than they are.
    read : callable
        Opens a mesh file relative to the scene.

    Returns
    -------
    dict of str to TriangleMesh
    """
    obstacles = [section for section in sections if section.role == "obstacle"]
    points = np.concatenate([np.asarray(body.points) for body in bodies]) if bodies else np.zeros((1, 3))
    return {section.name: _placed(section, _shape(section, points, read)) for section in obstacles}


def _shape(section: Any, bodies: NDArray, read: Callable[[str], Any]) -> TriangleMesh:
    """The obstacle's surface in its own coordinates, before scaling, rotation and translation."""
    if getattr(section, "plane", None) is not None:
        return _square(np.array(section.plane.point), np.array(section.plane.normal), bodies)
    if getattr(section, "sphere", None) is not None:
        ball = icosphere(BALL_SUBDIVISIONS, section.sphere.radius)
        return ball.moved_unchecked(ball.points + np.array(section.sphere.center))
    if getattr(section, "box", None) is not None:
        solid = box(1, 1, 1, section.box.size)
        return solid.moved_unchecked(solid.points + np.array(section.box.corner))
    if getattr(section, "cylinder", None) is not None:
        shape = section.cylinder
        return _cylinder(np.array(shape.start), np.array(shape.end), shape.radius)
    mesh = read(section.mesh).mesh
    return mesh.boundary if isinstance(mesh, TetMesh) else mesh


def _placed(section: Any, mesh: TriangleMesh) -> TriangleMesh:
    """The mesh scaled, rotated and translated by the keys of its object."""
    points = np.asarray(mesh.points) * (getattr(section, "scale", None) or 1.0)
    rotation = getattr(section, "rotation", None)
    if rotation is not None:
        points = points @ rotation_matrix(rotation.axis, np.radians(rotation.degrees)).T
    return mesh.moved_unchecked(points + np.array(getattr(section, "position", (0.0, 0.0, 0.0))))


def _square(point: NDArray, normal: NDArray, bodies: NDArray) -> TriangleMesh:
    """Square in a plane around the projection of the bodies."""
    normal = normal / np.linalg.norm(normal)
    low, high = bodies.min(axis=0), bodies.max(axis=0)
    middle = 0.5 * (low + high)
    middle = middle - ((middle - point) @ normal) * normal
    reach = PLANE_SHARE * (float(np.linalg.norm(high - low)) or 1.0)
    across, along = tangents(normal)
    flat = grid(PLANE_CELLS, PLANE_CELLS)
    share = flat.points[:, :2] / flat.points[:, :2].max() * 2.0 - 1.0
    return flat.moved_unchecked(middle + reach * (share[:, :1] * across + share[:, 1:] * along))


def _cylinder(start: NDArray, end: NDArray, radius: float) -> TriangleMesh:
    """Closed cylinder with flat ends."""
    axis = (end - start) / np.linalg.norm(end - start)
    across, along = tangents(axis)
    angle = 2 * np.pi * np.arange(CYLINDER_SIDES) / CYLINDER_SIDES
    ring = radius * (np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * along)
    points = np.concatenate([start + ring, end + ring, [start, end]])
    k, n = np.arange(CYLINDER_SIDES), CYLINDER_SIDES
    after = (k + 1) % n
    faces = [
        np.stack([k, after, after + n], axis=1),
        np.stack([k, after + n, k + n], axis=1),
        np.stack([np.full(n, 2 * n), after, k], axis=1),
        np.stack([np.full(n, 2 * n + 1), k + n, after + n], axis=1),
    ]
    return TriangleMesh.from_arrays(points, np.concatenate(faces))
