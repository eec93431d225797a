"""Inspect a mesh: defects, quality, size, the commands that accept it, and arrays that locate defects."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.inspection import quality
from ddgcli.errors import ParameterError
from ddgcli.geometry.unfolding import face_corner_angle
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.requirements import REQUIREMENTS, unmet_need
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import vector_length


@dataclass(frozen=True, eq=False)
class Inspection:
    """Results of the summary, and arrays of the annotated mesh."""

    results: dict[str, Any]
    vertex: dict[str, NDArray]
    face: dict[str, NDArray] = field(default_factory=dict)


def array_names(
    mesh: TriangleMesh | TetMesh | CurveSet, *, self_intersections: bool = False
) -> tuple[str, ...]:
    """Names of the arrays of `inspect_mesh`.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or CurveSet
    self_intersections : bool

    Returns
    -------
    tuple of str

    Raises
    ------
    ParameterError
        Self-intersections of tetrahedra or curves.
    """
    if self_intersections:
        _require_surface(mesh)
    if isinstance(mesh, CurveSet):
        return ("component", "boundary")
    crossings = ("self_intersecting",) if self_intersections else ()
    return ("component", "boundary", "non_manifold", "min_angle_degrees", *crossings)


def inspect_mesh(mesh: TriangleMesh | TetMesh | CurveSet, *, self_intersections: bool = False) -> Inspection:
    """Inspect a mesh: defects, quality, size, and the commands that accept it.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or CurveSet
    self_intersections : bool
        Count the pairs of faces of a surface that cross, and mark the faces.

    Returns
    -------
    Inspection

    Raises
    ------
    ParameterError
        Self-intersections of tetrahedra or curves.
    """
    if self_intersections:
        _require_surface(mesh)
    if isinstance(mesh, TetMesh):
        results = {**quality.tetrahedra_quality(mesh), "size": _tetrahedra_size(mesh)}
        vertex, face = quality.tetrahedra_marks(mesh)
    elif isinstance(mesh, CurveSet):
        segment = mesh.points[mesh.lines]
        length = vector_length(segment[:, 1] - segment[:, 0])
        results = {**quality.curve_quality(mesh), "size": quality.size(mesh.points, length)}
        vertex, face = quality.curve_marks(mesh), {}
    else:
        angle = np.degrees(face_corner_angle(mesh))
        results = {**quality.surface_defects(mesh), "quality": quality.triangle_quality(mesh, angle)}
        results["size"] = quality.surface_size(mesh)
        vertex = quality.surface_marks(mesh)
        face = {"min_angle_degrees": quality.face_min_angle(mesh, angle)}
        if self_intersections:
            crossings, face["self_intersecting"] = quality.self_intersections(mesh)
            results = crossings | results
    accepts = {command: unmet_need(mesh, command) for command in REQUIREMENTS}
    results["accepts"] = {command: f"no: {why}" if why else "yes" for command, why in accepts.items()}
    return Inspection(results, vertex, face)


def _require_surface(mesh: TriangleMesh | TetMesh | CurveSet) -> None:
    if not isinstance(mesh, TriangleMesh):
        content = "tetrahedra" if isinstance(mesh, TetMesh) else "a curve"
        raise ParameterError(
            f"needs a surface, and the input holds {content}", parameter="self_intersections"
        )


def _tetrahedra_size(mesh: TetMesh) -> dict[str, Any]:
    p = mesh.points[mesh.tetrahedra]
    edges = p[:, [0, 0, 0, 1, 1, 2]] - p[:, [1, 2, 3, 2, 3, 3]]
    return quality.size(mesh.points, vector_length(edges))
