"""Repairs of tetrahedral meshes: flat cells, inverted cells, vertices of no cell."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.repair.pipeline import RepairSteps
from ddgcli.errors import ParameterError
from ddgcli.mesh.require import refuse_flat_cells
from ddgcli.mesh.tet_mesh import TetMesh

SOLID_STEPS = ("drop_degenerate", "orient", "drop_unused")


@dataclass(frozen=True, eq=False)
class RepairedSolid:
    """A tetrahedral mesh and where its vertices and cells come from.

    Parameters
    ----------
    mesh : TetMesh
    input_vertex : (n,) ndarray of int64
    input_cell : (k,) ndarray of int64
    changes : dict of str to int
        Cells or vertices that each step changed.
    """

    mesh: TetMesh
    input_vertex: NDArray[np.int64]
    input_cell: NDArray[np.int64]
    changes: dict[str, int]


def check_solid_steps(chosen_steps: RepairSteps) -> list[str]:
    """The chosen steps; ParameterError for none, or for one that tetrahedra do not have."""
    values = asdict(chosen_steps).items()
    steps = [name for name, value in values if value is not None and value is not False]
    if not steps:
        raise ParameterError("no repair is chosen; name one, such as `drop_degenerate`")
    for name in steps:
        if name not in SOLID_STEPS:
            names = ", ".join(f"`{step}`" for step in SOLID_STEPS)
            raise ParameterError(f"is a step of surfaces; tetrahedra have {names}", parameter=name)
    return steps


def repair_solid(mesh: TetMesh, chosen_steps: RepairSteps) -> RepairedSolid:
    """Remove cells without volume, exchange two corners of inverted ones, drop unused vertices, as chosen.

    A flat cell inside a body leaves faces of its neighbours that lie on each other; vertices stay joined.

    Raises
    ------
    ParameterError
        No step, or one of surfaces.
    MeshError
        Where no cell is left.
    """
    steps, changes = check_solid_steps(chosen_steps), {}
    cell, vertex = np.arange(len(mesh.tetrahedra)), np.arange(mesh.n_vertices)
    corners = mesh.tetrahedra
    if "drop_degenerate" in steps:
        flat = mesh.flat_tetrahedra
        if len(flat) == len(corners):
            refuse_flat_cells(flat, len(corners))
        cell = np.setdiff1d(cell, flat)
        changes["drop_degenerate"] = len(corners) - len(cell)
        corners = corners[cell]
    if "orient" in steps:
        inverted = mesh.signed_volume[cell] < 0
        corners = np.where(inverted[:, None], corners[:, [1, 0, 2, 3]], corners)
        changes["orient"] = int(inverted.sum())
    if "drop_unused" in steps:
        vertex, number = np.unique(corners, return_inverse=True)
        corners = number.reshape(-1, 4)
        changes["drop_unused"] = mesh.n_vertices - len(vertex)
    return RepairedSolid(TetMesh.from_arrays(mesh.points[vertex], corners), vertex, cell, changes)
