"""Paths as results: polylines in space, and entries of a summary."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.paths import SIDE_TOLERANCE, Joints, SurfacePaths, joints, sums_by_path
from ddgcli.geometry.face_frames import surface_position
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh


def curve_set(mesh: TriangleMesh, paths: SurfacePaths, **arrays: NDArray) -> CurveSet:
    """Polylines in space of surface paths; closed ones end at their first point.

    Parameters
    ----------
    mesh : TriangleMesh
    paths : SurfacePaths
    **arrays : (p, ...) ndarray
        Further arrays on the points.

    Returns
    -------
    CurveSet
        With the arrays `path_id`, `face`, `barycentric` and the further ones.
    """
    index = [
        np.append(np.arange(a, b), [a] if closed and b > a else []).astype(np.int64)
        for a, b, closed in zip(paths.start[:-1], paths.start[1:], paths.closed, strict=True)
    ]
    position = surface_position(mesh, paths.face, paths.barycentric)
    arrays = {"face": paths.face, "barycentric": paths.barycentric, **arrays}
    return CurveSet.from_paths(
        [position[i] for i in index], **{name: [value[i] for i in index] for name, value in arrays.items()}
    )


def describe_paths(
    mesh: SurfaceMesh, paths: SurfacePaths, kinds: list[dict[str, Any]], joint: Joints | None = None
) -> list[dict[str, Any]]:
    """Summary entries of paths: kind, length, both ends, angles at the vertices on the path.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    paths : SurfacePaths
    kinds : list of dict
        First fields of each entry: kind, source, target, ...
    joint : Joints, optional
        Of the paths, where they are known.

    Returns
    -------
    list of dict
    """
    if not len(paths):
        return []
    joint = joint or joints(mesh, paths)
    length = sums_by_path(paths, joint.length)
    passes = (joint.vertex >= 0) & ~np.isnan(joint.total)
    entries = []
    for i, kind in enumerate(kinds):
        a, b = int(paths.start[i]), int(paths.start[i + 1])
        passed = a + np.flatnonzero(passes[a:b])
        entries.append(
            {
                **kind,
                "length": float(length[i]),
                "closed": bool(paths.closed[i]),
                "points": b - a,
                "start": _point(mesh, paths, a) if b > a else None,
                "end": _point(mesh, paths, a if paths.closed[i] else b - 1) if b > a else None,
                "vertices": [
                    {
                        "vertex": int(joint.vertex[p]),
                        "left": _finite_or_none(joint.left[p]),
                        "right": _finite_or_none(joint.right[p]),
                    }
                    for p in passed
                ],
            }
        )
    return entries


def _finite_or_none(angle: float) -> float | None:
    """Angle for the summary; None where it does not exist."""
    return None if np.isnan(angle) else float(angle)


def _point(mesh: SurfaceMesh, paths: SurfacePaths, i: int) -> dict[str, Any]:
    face, b = paths.face[i : i + 1], paths.barycentric[i : i + 1]
    point: dict[str, Any] = {"face": int(face[0]), "barycentric": b[0].tolist()}
    if b.max() >= 1 - SIDE_TOLERANCE:
        point["vertex"] = int(mesh.faces[face[0], np.argmax(b[0])])
    if mesh.points is not None:
        point["point"] = surface_position(mesh, face, b)[0].tolist()
    return point
