"""Darboux frames of curves on a surface: normal curvature, geodesic torsion, and the frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.paths import SurfacePaths
from ddgcli.algorithms.geodesics.surface_curves import Curves
from ddgcli.geometry.face_frames import relative_position
from ddgcli.geometry.normals import sphere_normals
from ddgcli.geometry.surface_points import interpolated
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import ratio, row_cross, row_dot, tangential, unit_vectors, vector_length


def add_darboux_frames(mesh: TriangleMesh, curves: Curves) -> Curves:
    """Add the Darboux frame, the normal curvature and the geodesic torsion to curves.

    Parameters
    ----------
    mesh : TriangleMesh
        Consistently oriented, faces outward.
    curves : Curves

    Returns
    -------
    Curves
        With arrays on points: `darboux_tangent` (p, 3), bisector of both segments; `darboux_normal`, the
        surface normal made orthogonal to it; `darboux_conormal`, their cross product normal x tangent, which
        points to the left; `normal_curvature` (p,), positive where the surface curves away from its normal
        along the curve (1 / R on a sphere); `geodesic_torsion` (p,), both in 1/length and means over the
        two segments.

    Notes
    -----
    The normal is the linear interpolant of `sphere_normals`. Along a segment of unit direction T and length s
    it changes by dN: the normal curvature is dN . T / s, the geodesic torsion -dN . C / s with C the conormal
    (the derivatives of the Darboux frame).
    """
    paths = curves.paths
    at_vertex = sphere_normals(mesh)
    normal = unit_vectors(interpolated(at_vertex, mesh.faces[paths.face], paths.barycentric))
    before, after, segment, length = _segments(mesh, paths)
    direction = unit_vectors(segment)
    middle = np.concatenate([direction, np.zeros((1, 3))])  # row -1: no segment
    tangent = unit_vectors(middle[before] + middle[after])
    own = unit_vectors(tangential(normal, tangent))
    change = _along_segments(paths, normal)
    conormal = unit_vectors(row_cross(_along_segments(paths, normal, mean=True), direction))
    rates = {"normal_curvature": row_dot(change, direction), "geodesic_torsion": -row_dot(change, conormal)}
    weight = np.append(length, 0.0)
    arrays: dict[str, NDArray] = {
        "darboux_tangent": tangent, "darboux_normal": own, "darboux_conormal": row_cross(own, tangent),
    }  # fmt: skip
    for name, total in rates.items():
        value = np.append(total, 0.0)  # integrals over segments
        arrays[name] = ratio(value[before] + value[after], weight[before] + weight[after])
    return replace(curves, arrays=curves.arrays | arrays)


def _segments(mesh: TriangleMesh, paths: SurfacePaths) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Segments before and after each point (-1 where there is none), their vectors and lengths.

    Segment i leaves point i; points without a next one have a segment of length 0.
    """
    following = paths.following()
    here = np.flatnonzero(following >= 0)
    position = relative_position(mesh, paths.face, paths.barycentric)
    segment = np.zeros_like(position)
    segment[here] = position[following[here]] - position[here]
    after = np.full(len(following), -1)
    after[here] = here
    before = np.full(len(following), -1)
    before[following[here]] = here
    return before, after, segment, vector_length(segment)


def _along_segments(paths: SurfacePaths, values: NDArray, *, mean: bool = False) -> NDArray[np.float64]:
    """(p, 3) differences, or sums, of point values over the segment that leaves each point."""
    following = paths.following()
    here = np.flatnonzero(following >= 0)
    result = np.zeros_like(values)
    result[here] = values[following[here]] + (values[here] if mean else -values[here])
    return result
