"""Distortion of maps to the plane, linear on triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import corner_cotan, face_area
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.topology import NEXT, PREVIOUS

DISTORTION_ARRAYS = ("conformal_distortion", "area_distortion")
MAX_DISTORTION = 1e16  # reported where a triangle collapses


def planar_area(corners: NDArray) -> NDArray[np.float64]:
    """Twice the signed area of triangles in the plane.

    Parameters
    ----------
    corners : (m, 3, 2) ndarray of float64

    Returns
    -------
    (m,) ndarray of float64
        Positive where counter-clockwise.
    """
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def angle_distortion(mesh: SurfaceMesh, corners: NDArray) -> NDArray[np.float64]:
    """Ratio of the singular values of a map of faces to the plane, 1 where conformal.

    From K + 1/K = 2 (Dirichlet energy) / area.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    corners : (m, 3, 2) ndarray of float64
        Images of the corners of each face.

    Returns
    -------
    (m,) ndarray of float64
        Infinite or undefined where a triangle collapses.
    """
    squared = ((corners[:, NEXT] - corners) ** 2).sum(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        energy = 0.25 * (corner_cotan(mesh.side_length)[:, PREVIOUS] * squared).sum(axis=1)
        half = np.maximum(energy / (0.5 * np.abs(planar_area(corners))), 1.0)
        return half + np.sqrt(half * half - 1.0)


def distortion_arrays(mesh: SurfaceMesh, corners: NDArray) -> dict[str, NDArray[np.float64]]:
    """Face arrays of the distortion of a map to the plane.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    corners : (m, 3, 2) ndarray of float64
        Images of the corners of each face.

    Returns
    -------
    dict
        `conformal_distortion`: ratio of the singular values, 1 where conformal; `area_distortion`: logarithm
        of the area in the plane over that on the surface. Both are cut off where a triangle collapses.
    """
    ratio = np.nan_to_num(angle_distortion(mesh, corners), nan=MAX_DISTORTION, posinf=MAX_DISTORTION)
    limit = np.log(MAX_DISTORTION)
    with np.errstate(divide="ignore", invalid="ignore"):
        area = np.log(0.5 * np.abs(planar_area(corners))) - np.log(face_area(mesh.side_length))
    area = np.clip(np.nan_to_num(area, nan=0.0, posinf=limit, neginf=-limit), -limit, limit)
    return dict(zip(DISTORTION_ARRAYS, (np.minimum(ratio, MAX_DISTORTION), area), strict=True))


def mean_and_largest(mesh: SurfaceMesh, ratio: NDArray) -> dict[str, float]:
    """Area mean and maximum of `conformal_distortion` over the triangles that do not collapse.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    ratio : (m,) ndarray of float64

    Returns
    -------
    dict of str to float
        `mean`, `max`.
    """
    area, good = face_area(mesh.side_length), ratio < MAX_DISTORTION
    if not area[good].sum() > 0:
        return {"mean": MAX_DISTORTION, "max": MAX_DISTORTION}
    return {"mean": float((area * ratio)[good].sum() / area[good].sum()), "max": float(ratio[good].max())}
