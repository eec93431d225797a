"""The input of a run with every face split in four, for --subdivide."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.query import CurveQuery, DistanceQuery
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.io.appearance import NAMES as APPEARANCE
from ddgcli.io.arrays import input_array
from ddgcli.io.mesh_file import MeshInput
from ddgcli.mesh.midpoint_subdivision import MidpointSubdivision

Query = TypeVar("Query", bound=DistanceQuery | CurveQuery)

log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SubdividedInput(MeshInput):
    """The subdivided mesh with the arrays that follow it, and the input as it was read.

    Names, numbers and files of a call refer to `base`; only vertices keep their numbers.

    Parameters
    ----------
    base : MeshInput
    subdivision : MidpointSubdivision
    """

    base: MeshInput
    subdivision: MidpointSubdivision


def subdivided_input(source: MeshInput, times: int) -> SubdividedInput:
    """The input with every face split in four `times` times.

    Numbers on vertices are interpolated linearly, as functions; faces have the values of those that they are
    pieces of. Textures, colours and arrays on edges are those of the `base` alone, as are marks and labels:
    what they choose is found on the base, and then followed.
    """
    if source.kind == "tetrahedra":
        raise ParameterError("splits the faces of a surface, and MESH holds tetrahedra; leave it out",
                             parameter="subdivide")  # fmt: skip
    with renamed_parameters(times="subdivide"):
        subdivision = MidpointSubdivision.of(source.surface, times)
    textures = sorted({*APPEARANCE} & {*source.vertex, *source.face})
    if textures:
        log.warning("`subdivide` drops the arrays %s", ", ".join(textures))
    of_input = {field.name: getattr(source, field.name) for field in fields(MeshInput)}
    changed = {
        "mesh": subdivision.mesh,
        "vertex": {
            name: subdivision.vertex_values(array)
            for name, array in source.vertex.items()
            if array.dtype.kind in "fiub" and name not in APPEARANCE
        },
        "face": {
            name: subdivision.face_values(array)
            for name, array in source.face.items()
            if name not in APPEARANCE
        },
        "edge": {},
        "input_face": None,
    }
    return SubdividedInput(**(of_input | changed), base=source, subdivision=subdivision)


def input_function(
    source: MeshInput, name: str, parameter: str, *, at_midpoints: float | None = None
) -> tuple[NDArray, str]:
    """`input_array` as a function on the mesh of the run: linear from vertices, constant on faces.

    Arrays of the input, and of files with one value (or row) for each of its vertices or faces, follow the
    subdivision; other files belong to the subdivided mesh. `at_midpoints` replaces the means at new vertices.
    """
    if not isinstance(source, SubdividedInput):
        return input_array(source, name, parameter=parameter)
    array, place = input_array(source.base, name, parameter=parameter)
    base, subdivision = source.base.surface, source.subdivision
    if place in ("vertex", "") and len(array) == base.n_vertices:
        values = subdivision.vertex_values(array)
        if at_midpoints is not None:
            values[base.n_vertices :] = at_midpoints
        return values, "vertex"
    if place in ("face", "") and len(array) == base.n_faces:
        return subdivision.face_values(array), "face"
    return array, place


def on_subdivided_faces(source: MeshInput, query: Query) -> Query:
    """A query with the points on faces of the input as points on faces of the mesh of the run."""
    names = [name for name in ("source_face", "target_face", "trace") if getattr(query, name, ())]
    if not names or not isinstance(source, SubdividedInput):
        return query
    points: dict[str, Any] = {name: _subdivided_points(source, getattr(query, name)) for name in names}
    return replace(query, **points)


def _subdivided_points(source: SubdividedInput, starts: Sequence[Any]) -> tuple[Any, ...]:
    """Tuples that begin with a face and barycentric coordinates, with those of the subdivided mesh."""
    face, weights = (np.array(values) for values in list(zip(*starts, strict=True))[:2])
    points = SurfacePoints.checked(face, weights, source.base.surface.n_faces)
    face, weights = source.subdivision.points(points.face, points.barycentric)
    rows = zip(face.tolist(), weights.tolist(), starts, strict=True)
    return tuple((f, w, *start[2:]) for f, w, start in rows)
