"""Repairs of tetrahedral meshes, by the steps of `SOLID_STEPS` in their order."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.repair.pipeline import RepairSteps, requirement_of
from ddgcli.algorithms.repair.steps import near_vertices
from ddgcli.errors import MeshError, ParameterError, counted
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.flat_cells import without_flat_cells
from ddgcli.mesh.require_solid import refuse_flat_cells
from ddgcli.mesh.tet_mesh import TET_FACES, TetMesh

log = logging.getLogger("ddgcli")
SOLID_STEPS = ("weld", "drop_duplicates", "drop_degenerate", "split_fans", "orient", "drop_unused")


@dataclass(frozen=True, eq=False)
class RepairedSolid:
    """A tetrahedral mesh and where its vertices and cells come from.

    Parameters
    ----------
    mesh : TetMesh
    input_vertex : (n,) ndarray of int64
    input_cell : (k,) ndarray of int64
        Input cell of each; for a cell that replaces others, the nearest of those.
    changes : dict of str to int
        Cells or vertices that each step changed.
    """

    mesh: TetMesh
    input_vertex: NDArray[np.int64]
    input_cell: NDArray[np.int64]
    changes: dict[str, int]


def solid_steps_for(command: str) -> RepairSteps:
    """Steps that make tetrahedra acceptable to a command.

    Parameters
    ----------
    command : str

    Returns
    -------
    RepairSteps

    Raises
    ------
    ParameterError
        For a command that takes no tetrahedra.
    """
    need = requirement_of(command, "tetrahedra")
    return RepairSteps(
        weld=0.0,
        drop_degenerate=True,
        drop_duplicates=need.manifold_cells,
        orient=True,
        split_fans=need.boundary.get("manifold", False),
    )


def check_solid_steps(mesh: TetMesh, chosen_steps: RepairSteps) -> list[str]:
    """Names of the chosen steps, if tetrahedra have them and they leave some.

    Parameters
    ----------
    mesh : TetMesh
    chosen_steps : RepairSteps

    Returns
    -------
    list of str

    Raises
    ------
    ParameterError
        For no step, or for one that tetrahedra do not have.
    MeshError
        Where no cell would be left.
    """
    values = asdict(chosen_steps).items()
    steps = [name for name, value in values if value is not None and value is not False]
    if not steps:
        raise ParameterError("no repair is chosen; name one, such as `drop_degenerate`")
    others = [name for name in steps if name not in SOLID_STEPS]
    if others:
        names = ", ".join(f"`{step}`" for step in SOLID_STEPS)
        remedy = (
            f"leave {', '.join(f'`{step}`' for step in others)} out"
            if len(others) < len(steps)
            else ("name one of them")
        )
        raise ParameterError(f"is a step of surfaces, tetrahedra have {names}; {remedy}", parameter=others[0])
    flat = mesh.flat_tetrahedra if "drop_degenerate" in steps else ()
    if len(flat) == len(mesh.tetrahedra):
        refuse_flat_cells(mesh.flat_tetrahedra, len(flat))
    return steps


def repair_solid(mesh: TetMesh, chosen_steps: RepairSteps) -> RepairedSolid:
    """Join vertices, remove cells, part bodies that touch, orient cells, drop unused vertices, as chosen.

    Where a flat cell disappears inside a body, other cells around it take its place (`without_flat_cells`).

    Parameters
    ----------
    mesh : TetMesh
    chosen_steps : RepairSteps

    Returns
    -------
    RepairedSolid

    Raises
    ------
    ParameterError
        No step, or one of surfaces.
    MeshError
        Where no cell is left.
    """
    steps, changes = check_solid_steps(mesh, chosen_steps), {}
    cell, vertex = np.arange(len(mesh.tetrahedra)), np.arange(mesh.n_vertices)
    corners, points = mesh.tetrahedra, mesh.points
    if chosen_steps.weld is not None:
        vertex, group = near_vertices(points, chosen_steps.weld)
        points, corners = points[vertex], group[corners]
        changes["weld"] = mesh.n_vertices - len(vertex)
        _check_weld(mesh, TetMesh(points, corners))
    if "drop_duplicates" in steps:
        first = np.setdiff1d(cell, TetMesh(points, corners).duplicate_tetrahedra)
        changes["drop_duplicates"] = len(cell) - len(first)
        cell, corners = first, corners[first]
    if "drop_degenerate" in steps:
        before = TetMesh(points, corners)
        slim = without_flat_cells(before)
        changes["drop_degenerate"] = len(before.flat_tetrahedra) - len(slim.flat) + slim.gaps
        corners, cell = slim.tetrahedra, cell[slim.origin]
        is_left = ~np.isin(np.arange(len(points)), list(slim.merged))
        points, vertex, corners = points[is_left], vertex[is_left], (np.cumsum(is_left) - 1)[corners]
        _warn_of_flat_cells(slim.flat)
    if "split_fans" in steps:
        corners, source = _split_fans(TetMesh.from_arrays(points, corners))
        changes["split_fans"] = len(source) - len(points)
        points, vertex = points[source], vertex[source]
    if "orient" in steps:
        inverted = TetMesh(points, corners).signed_volume < 0  # positions after the weld
        corners = np.where(inverted[:, None], corners[:, [1, 0, 2, 3]], corners)
        changes["orient"] = int(inverted.sum())
    if "drop_unused" in steps:
        referenced, index = np.unique(corners, return_inverse=True)
        corners = index.reshape(-1, 4)
        changes["drop_unused"] = len(points) - len(referenced)
        points, vertex = points[referenced], vertex[referenced]
    return RepairedSolid(TetMesh.from_arrays(points, corners), vertex, cell, changes)


def _warn_of_flat_cells(flat: NDArray) -> None:
    """Warn of flat cells that are left."""
    if len(flat):
        log.warning(
            "%s (first: tetrahedron %d), which no change of the cells around removes: move vertices, or "
            "mesh the body again", counted(len(flat), "flat cell is left", "flat cells are left"), flat[0],
        )  # fmt: skip


def _check_weld(before: TetMesh, after: TetMesh) -> None:
    """Warn of cells that a weld collapsed; raise MeshError where it collapsed all of them."""
    n_collapsed = len(np.setdiff1d(after.flat_tetrahedra, before.flat_tetrahedra))
    if n_collapsed and len(after.flat_tetrahedra) == len(after.tetrahedra):
        raise MeshError("the weld leaves no cell with volume; weld by a smaller distance, or not at all")
    if n_collapsed:
        log.warning(
            "the weld leaves %s without volume: remove such cells with `drop_degenerate`, or weld by a "
            "smaller distance", counted(n_collapsed, "cell", "cells"),
        )  # fmt: skip


def _split_fans(mesh: TetMesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cells with a vertex for each fan of cells that share faces around it, and the input vertex of each.

    Where one fan touches itself (an edge whose cells also meet around both of its ends, a vertex between two
    sheets of the boundary) each cell gets its own copy of the vertex, as in `steps.split_fans`.
    """
    source = np.arange(mesh.n_vertices)
    uncut = np.zeros(0, dtype=np.int64)
    while True:
        split, copied = _separated(mesh, uncut)
        source = source[copied]
        topology = split.boundary.topology
        uncut = topology.edges[topology.nonmanifold_edges, 0]
        if len(uncut) == 0:
            uncut = topology.nonmanifold_vertices
        if len(uncut) == 0:
            return split.tetrahedra, source
        mesh = split


def _separated(mesh: TetMesh, ends: NDArray[np.int64]) -> tuple[TetMesh, NDArray[np.int64]]:
    """The mesh with a vertex for each set of corners that meet across faces, and the vertex of each copy.

    Cells do not meet at the vertices `ends`, nor across faces of more than two cells. The first set of a
    vertex keeps its index.
    """
    corners = mesh.tetrahedra
    triangle = mesh.cell_triangle.ravel()
    order = np.argsort(triangle, kind="stable")
    first = order[np.flatnonzero(np.bincount(triangle)[triangle[order]] == 2)][::2]
    second = order[np.flatnonzero(np.bincount(triangle)[triangle[order]] == 2)][1::2]
    slot = [_face_corners(corners, side) for side in (first, second)]
    is_end = np.isin(corners.ravel()[slot[0]], ends).any(axis=1)
    rows, cols = (nodes[~is_end].ravel() for nodes in slot)
    fan = connected_labels(rows, cols, corners.size)[1]
    start = np.unique(fan, return_index=True)[1]
    vertex = corners.ravel()[start]
    by_vertex = np.lexsort((start, vertex))
    further = by_vertex[1:][vertex[by_vertex[1:]] == vertex[by_vertex[:-1]]]
    index = vertex.copy()
    index[further] = mesh.n_vertices + np.arange(len(further))
    source = np.concatenate([np.arange(mesh.n_vertices), vertex[further]])
    return TetMesh.from_arrays(mesh.points[source], index[fan].reshape(-1, 4)), source


def _face_corners(corners: NDArray, side: NDArray) -> NDArray[np.int64]:
    """(s, 3) flat indices of the corners of sides of cells, by ascending vertices."""
    local = 4 * (side // 4)[:, None] + TET_FACES[side % 4]
    return np.take_along_axis(local, np.argsort(corners.ravel()[local], axis=1), axis=1)
