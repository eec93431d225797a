"""Scenes on finer meshes: every face of an object split in four, the vertices of the input kept.

New vertices lie on the shape that the mesh samples: on the sphere of a scene's `sphere` and the side of its
`cylinder`, in the flat faces of grids and boxes, and on a smooth surface through the vertices of a mesh file,
except at its creases.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.mesh.shapes import box_tetrahedra, mesh_on_sphere, midpoint_subdivided
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.scenes.scene import SceneKind, resolve
from ddgcli.scenes.sections import Document
from ddgcli.scenes.shapes import on_cylinder, periodic_grid, shape_mesh
from ddgcli.tradeoff.smooth_surface import smooth_midpoint_values, smoothly_subdivided

PREFIX = "refined:"  # of the names of refined meshes
SAME_POINT = 1e-6  # distance over the size of the mesh


@dataclasses.dataclass(frozen=True)
class RefinedScene:
    """A scene on finer meshes.

    Attributes
    ----------
    document : Document
    read, array : callable
        Readers of its meshes and arrays.
    input_vertices : dict of str to ndarray
        Vertices of each object that are those of the input, in its order.
    """

    document: Document
    read: Callable[[str], Any]
    array: Callable[[str], NDArray]
    input_vertices: dict[str, NDArray[np.int64]]


def refined_scene(
    document: Document,
    kind: SceneKind,
    read: Callable[[str], Any],
    array: Callable[[str], NDArray] | None,
    times: int,
) -> RefinedScene:
    """The scene with every face of its objects (not of its obstacles) split `times` times.

    Lists of vertices gain the new vertices between two of their own. Arrays of the input are interpolated.

    Parameters
    ----------
    document : Document
    kind : SceneKind
    read : callable
        Reads a mesh file.
    array : callable or None
        Reads an array file.
    times : int

    Returns
    -------
    RefinedScene

    Raises
    ------
    SolveError
        For meshes that have no such refinement: tetrahedra of files, fluids from which obstacles are cut.
    """
    objects = resolve(document, kind).objects
    role = next(iter(kind.roles))
    if role == "fluid" and any(o.role == "obstacle" for o in objects):
        raise SolveError("obstacles are cut out of the mesh, so a finer mesh has other vertices")
    data = copy.deepcopy(dict(document.data))
    finer: dict[str, Any] = {}
    input_vertices: dict[str, NDArray[np.int64]] = {}
    splits: dict[str, list[Any]] = {}
    for number, section in enumerate(objects):
        if section.role != role:
            continue
        table = data["object"][number]
        table["name"] = section.name
        periodic = section.grid is not None and section.grid.periodic
        if periodic or (section.box is not None and role == "fluid"):
            input_vertices[section.name] = _double_cells(table, section, times)
            continue
        source, name = _source(section, read), PREFIX + section.name
        meshes = [source.mesh]
        for _ in range(times):
            meshes.append(_split(meshes[-1], section))
        finer[name] = _interpolated(source, meshes)
        for shape in ("mesh", "grid", "sphere", "box", "cylinder"):
            table.pop(shape, None)
        table["mesh"] = name
        input_vertices[section.name] = np.arange(source.mesh.n_vertices)
        splits[section.name] = meshes
    _extend_vertex_lists(data.get("effects", {}), splits)
    changed = dataclasses.replace(document, data=data)  # type: ignore[type-var]

    def load(name: str) -> NDArray:
        values = array(name) if array is not None else np.zeros(0)
        meshes = next((m for m in splits.values() if len(values) == m[0].n_vertices), None)
        return values if meshes is None else prolonged(values, meshes)

    return RefinedScene(
        changed, lambda name: finer[name] if name in finer else read(name), load, input_vertices
    )


def _source(section: Any, read: Callable[[str], Any]) -> Any:
    if section.mesh is None:
        return SimpleNamespace(mesh=shape_mesh(section), vertex={}, face={})
    source = read(section.mesh)
    if not isinstance(source.mesh, TriangleMesh):
        raise SolveError(f"{section.mesh} holds no triangles; tetrahedra of files are not refined")
    return source


def _interpolated(source: Any, meshes: list[TriangleMesh]) -> Any:
    """The last of the meshes, each split from the one before, with the arrays of the source of the first."""
    pieces = 4 ** (len(meshes) - 1)  # of a face
    return SimpleNamespace(
        mesh=meshes[-1], notes=(), sha256="",
        vertex={k: prolonged(v, meshes) for k, v in source.vertex.items()},
        face={k: np.concatenate([v] * pieces) for k, v in source.face.items()},
    )  # fmt: skip


def _split(mesh: TriangleMesh, section: Any) -> TriangleMesh:
    if section.sphere is not None:
        centre, radius = np.array(section.sphere.center), section.sphere.radius
        unit = mesh_on_sphere(midpoint_subdivided(mesh.moved_unchecked((mesh.points - centre) / radius)))
        return unit.moved_unchecked(centre + radius * unit.points)
    if section.cylinder is not None:
        finer = midpoint_subdivided(mesh)
        return finer.moved_unchecked(on_cylinder(section.cylinder, np.asarray(finer.points)))
    return smoothly_subdivided(mesh) if section.mesh is not None else midpoint_subdivided(mesh)


def prolonged(values: NDArray, meshes: list[TriangleMesh]) -> NDArray:
    """Values on the vertices of the first mesh as those of the last: of a smooth function through them.

    Whole numbers are interpolated linearly.
    """
    for mesh in meshes[:-1]:
        is_smooth = np.issubdtype(values.dtype, np.floating) and np.isfinite(values).all()
        middle = (
            smooth_midpoint_values(mesh, values) if is_smooth else values[mesh.topology.edges].mean(axis=1)
        )
        values = np.concatenate([values, middle])
    return values


def _double_cells(table: dict[str, Any], section: Any, times: int) -> NDArray[np.int64]:
    """Double the cells of a periodic grid or a box of tetrahedra; return the indices of the old vertices."""
    from scipy.spatial import cKDTree

    def points(shape: Any) -> NDArray:
        if section.grid is not None:
            return np.asarray(periodic_grid(shape).points)
        nx, ny, nz = shape.cells
        return np.asarray(box_tetrahedra(nx, ny, nz, shape.size).points)

    key = "grid" if section.grid is not None else "box"
    shape = getattr(section, key)
    cells = [count * 2**times for count in shape.cells]
    table[key] = {**table[key], "cells": cells}
    coarse = points(shape)
    distance, nearest = cKDTree(points(shape.model_copy(update={"cells": cells}))).query(coarse)
    if distance.max(initial=0.0) > SAME_POINT * float(np.ptp(coarse, axis=0).max()):
        raise SolveError(f"object {section.name!r}: a grid of twice the cells has other vertices")
    return np.asarray(nearest, dtype=np.int64)


def _extend_vertex_lists(effects: Mapping[str, Any], splits: dict[str, list[TriangleMesh]]) -> None:
    """Add the midpoints of edges to lists of vertices that hold both ends."""
    for value in effects.values():
        for table in value if isinstance(value, list) else [value]:
            vertices = table.get("vertices") if isinstance(table, dict) else None
            name = table.get("object", next(iter(splits), None)) if isinstance(table, dict) else None
            if not vertices or name not in splits or "to_vertices" in table:
                continue
            for mesh in splits[name][:-1]:
                ends = np.isin(mesh.topology.edges, vertices).all(axis=1)
                vertices = [*vertices, *(mesh.n_vertices + np.flatnonzero(ends)).tolist()]
            table["vertices"] = vertices
