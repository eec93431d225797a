"""Distortion of maps to the plane, linear on triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import face_area
from ddgcli.geometry.unfolding import corner_position, unfold
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh

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

    Of a linear map f(z) = a z + b conj(z) they are |a| + |b| and the size of |a| - |b|.

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
    before, after = (c[:, 1:] - c[:, :1] for c in (corner_position(unfold(mesh)), corners))
    z, f = before[..., 0] + 1j * before[..., 1], after[..., 0] + 1j * after[..., 1]
    # both parts, times twice the area of the face before the map
    direct = np.abs(f[:, 0] * z[:, 1].conj() - f[:, 1] * z[:, 0].conj())
    mirrored = np.abs(f[:, 0] * z[:, 1] - f[:, 1] * z[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        return (direct + mirrored) / np.abs(direct - mirrored)


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
