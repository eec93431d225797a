"""Parallel transport along curves, and the holonomy of closed curves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.paths import SurfacePaths, joints, segment_vectors
from ddgcli.geometry.face_frames import to_space
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh


def angle_to_curve(mesh: SurfaceMesh, paths: SurfacePaths) -> NDArray[np.float64]:
    """(p,) angle from the direction of a curve to a vector transported along it, initially tangent to it.

    In faces and across edges, transport is that of the unfolded plane; at a vertex the angle to the curve
    changes by the normalised turning (2 pi / total)(total / 2 - left), so that along straightest lines the
    angle to the line stays (Polthier and Schmies). The value belongs to the segment that leaves the point; at
    an open end to the one that arrives.
    """
    turning = np.nan_to_num(joints(mesh, paths).geodesic_curvature)
    first = paths.start[:-1][np.diff(paths.start) > 0]
    turning[first] = 0.0
    return -_cumulative_sums(turning, paths)


def _cumulative_sums(value: NDArray, paths: SurfacePaths) -> NDArray[np.float64]:
    """Running sums within each path."""
    total = np.cumsum(value)
    before = np.concatenate([[0.0], total])[paths.start[:-1]]
    return total - np.repeat(before, np.diff(paths.start))


def transported_frame(mesh: TriangleMesh, paths: SurfacePaths) -> dict[str, NDArray[np.float64]]:
    """Orthonormal tangent frames in parallel transport along curves.

    Parameters
    ----------
    mesh : TriangleMesh
        Consistently oriented.
    paths : SurfacePaths

    Returns
    -------
    dict of str to (p, 3) ndarray of float64
        `transport_x`, which starts along the curve, and `transport_y`, a quarter turn to its left; in the
        plane of the face of the segment that leaves the point (at an open end, that arrives).
    """
    step = segment_vectors(mesh, paths)
    face = paths.face.copy()
    last = np.flatnonzero(np.isnan(step[:, 0]))
    last = last[last > paths.start[paths.of_point()[last]]]
    step[last], face[last] = step[last - 1], face[last - 1]
    angle = np.arctan2(step[:, 1], step[:, 0]) + angle_to_curve(mesh, paths)
    angle = np.nan_to_num(angle)
    x = to_space(mesh, face, np.stack([np.cos(angle), np.sin(angle)], axis=1))
    y = to_space(mesh, face, np.stack([-np.sin(angle), np.cos(angle)], axis=1))
    return {"transport_x": x, "transport_y": y}


def holonomy(mesh: SurfaceMesh, paths: SurfacePaths) -> NDArray[np.float64]:
    """Holonomy: angle by which transport once around a closed path turns a vector.

    For a counter-clockwise loop around a disk it is the sum of the angle defects inside, modulo 2 pi.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    paths : SurfacePaths

    Returns
    -------
    (k,) ndarray of float64
        In radians, in (-pi, pi]; nan for open paths.
    """
    turning = np.nan_to_num(joints(mesh, paths).geodesic_curvature)
    total = sum_by_index(paths.of_point(), turning, len(paths))
    turned = np.pi - (np.pi + total) % (2 * np.pi)
    return np.where(paths.closed & (np.diff(paths.start) > 0), turned, np.nan)
