"""Inspection and repair of meshes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from numpy.typing import NDArray

from ddgcli.algorithms.inspection import inspect_mesh as inspection
from ddgcli.algorithms.repair import pipeline, solid
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.library.arguments import with_repair_call
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.library.result import Measurement
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["inspect_mesh", "repair_mesh"]


@accepts_arrays("surface", "tetrahedra", "curve")
def inspect_mesh(mesh: TriangleMesh | TetMesh | CurveSet, *, self_intersections: bool = False) -> Measurement:
    """Contents and quality of a mesh, and which commands accept it.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh, CurveSet or (points, cells) pair
    self_intersections : bool
        Count the pairs of faces of a surface that cross, and mark the faces (`self_intersecting`).

    Returns
    -------
    Measurement
        `results` as those of `ddgcli info`: defects with the indices of the first few, `quality`, `size`,
        `accepts` (by command: yes, or the reason and a repair). `vertex` (`component`, `boundary`,
        `non_manifold`) and `face` (`min_angle_degrees`) locate the defects.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.inspect_mesh(ddg.grid(2, 2))
    >>> square.results["orientation"], square.results["accepts"]["curvature"]
    ('consistent', 'yes')
    """
    inspected = inspection.inspect_mesh(mesh, self_intersections=self_intersections)
    accepts = {name: with_repair_call(text) for name, text in inspected.results["accepts"].items()}
    return Measurement(
        mesh, inspected.vertex, inspected.face, results={**inspected.results, "accepts": accepts}
    )


@accepts_arrays("surface", "tetrahedra")
def repair_mesh(
    mesh: TriangleMesh | TetMesh,
    *,
    weld: float | None = None,
    drop_degenerate: bool = False,
    drop_duplicates: bool = False,
    split_edges: float | None = None,
    largest: bool = False,
    split_fans: bool = False,
    orient: bool = False,
    split_folds: bool = False,
    fill_holes: int | None = None,
    cut_to_disk: bool = False,
    drop_unused: bool = False,
    for_command: str | Sequence[str] | None = None,
) -> Measurement:
    """Repair a mesh by steps that run in the order of the parameters; nothing else is changed.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
    weld : float, optional
        Merge vertices whose distance is at most this (length units; 0: equal positions).
    drop_degenerate, drop_duplicates : bool
        Remove faces (cells) without area (volume); faces that occur twice.
    split_edges : float, optional
        Divide boundary edges, and their faces, at boundary vertices within this distance of them
        (T-junctions; length units; 0: as far as rounding of coordinates explains).
    largest : bool
        Keep the component with the largest area.
    split_fans : bool
        Give each fan of faces its own vertex; splits edges of three or more faces.
    orient : bool
        Reverse faces so that neighbours have the same orientation; exchange corners of inverted cells.
    split_folds : bool
        Separate the faces at edges folded by 180 degrees.
    fill_holes : int, optional
        Fill boundary loops of at most this many edges.
    cut_to_disk : bool
        Cut every component open to a disk.
    drop_unused : bool
        Remove vertices that belong to no cell.
    for_command : str or sequence of str, optional
        In place of steps: those that commands of the command line need, such as "willmore-flow".

    Returns
    -------
    Measurement
        The repaired `mesh`; `vertex["input_vertex"]` and `face["input_face"]` (tetrahedra: `input_cell`) name
        where its elements come from, -1 for new ones; `results` has `changes` (by step) and `refused_by` (by
        command: why it still refuses the mesh). `converged` is False if one of `for_command` still does.

    Raises
    ------
    ParameterError
        No step, or one that the mesh does not have.
    MeshError
        A step needs what the mesh does not have.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ball = ddg.icosphere(1)
    >>> F = ball.faces.copy()
    >>> F[3] = F[3][::-1]
    >>> repaired = ddg.repair_mesh((ball.points, F), orient=True)
    >>> repaired.results["changes"], bool((repaired.mesh.faces == ball.faces).all())
    ({'orient': 1}, True)
    """
    steps = pipeline.RepairSteps(
        weld, drop_degenerate, drop_duplicates, split_edges, largest, split_fans, orient, split_folds,
        fill_holes, cut_to_disk, drop_unused,
    )  # fmt: skip
    for name, distance in (("weld", weld), ("split_edges", split_edges)):
        if distance is not None and not 0 <= distance < math.inf:
            raise ParameterError(f"must be 0 or a positive number, not {distance:g}", parameter=name)
    if fill_holes is not None and fill_holes < 3:
        raise ParameterError(f"must be 3 or more, not {fill_holes}", parameter="fill_holes")
    commands = [for_command] if isinstance(for_command, str) else list(for_command or [])
    if commands and steps != pipeline.RepairSteps():
        raise ParameterError("selects the steps itself; leave the other steps out", parameter="for_command")
    if isinstance(mesh, TetMesh):
        steps = _steps_for(solid.solid_steps_for, commands) if commands else steps
        cells = solid.repair_solid(mesh, steps)
        origin = {"input_cell": cells.input_cell}
        return _judged(cells.mesh, cells.changes, commands, cells.input_vertex, origin)
    steps = _steps_for(pipeline.steps_for, commands) if commands else steps
    faces, changes = pipeline.repair_mesh(mesh, steps)
    return _judged(faces.mesh, changes, commands, faces.input_vertex, {"input_face": faces.input_face})


def _steps_for(steps_of: Callable[[str], pipeline.RepairSteps], commands: list[str]) -> pipeline.RepairSteps:
    with renamed_parameters(command="for_command"):
        return pipeline.all_steps(map(steps_of, commands))


def _judged(
    mesh: TriangleMesh | TetMesh,
    changes: dict[str, int],
    commands: list[str],
    input_vertex: NDArray,
    origin: dict[str, NDArray],
) -> Measurement:
    """A repaired mesh with its maps, and which commands still refuse it."""
    refused_by = {name: with_repair_call(text) for name, text in pipeline.refusals(mesh).items()}
    accepted = refused_by.keys().isdisjoint(commands)
    return Measurement(
        mesh, {"input_vertex": input_vertex}, origin,
        results={"changes": changes, "refused_by": refused_by}, converged=accepted,
    )  # fmt: skip
