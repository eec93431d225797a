"""Repairs in their fixed order, and those that a command needs."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ddgcli.algorithms.repair import steps
from ddgcli.algorithms.repair.fans import split_fans
from ddgcli.algorithms.repair.holes import fill_holes
from ddgcli.algorithms.repair.steps import RepairedMesh
from ddgcli.algorithms.repair.t_junctions import split_edges
from ddgcli.errors import MeshError, ParameterError, counted
from ddgcli.mesh.require import require
from ddgcli.mesh.requirements import REQUIREMENTS, Requirement, kind_of, unmet_need
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

log = logging.getLogger("ddgcli")
MANIFOLD_STEPS = ("fill_holes", "cut_to_disk")
EARLY_STEPS = {"drop_degenerate", "drop_duplicates", "split_fans", "orient"}  # which run before those


@dataclass(frozen=True)
class RepairSteps:
    """Which repairs to make; they run in the order of the fields.

    Parameters
    ----------
    weld : float, optional
        Merge vertices whose distance is at most this (length units; 0: equal positions).
    drop_degenerate, drop_duplicates : bool
    split_edges : float, optional
        Divide boundary edges at boundary vertices at most so far from them (length units; 0: what rounding
        of coordinates explains).
    largest, split_fans, orient, split_folds : bool
    fill_holes : int, optional
        Fill boundary loops of at most this many edges.
    cut_to_disk : bool
    drop_unused : bool
    """

    weld: float | None = None
    drop_degenerate: bool = False
    drop_duplicates: bool = False
    split_edges: float | None = None
    largest: bool = False
    split_fans: bool = False
    orient: bool = False
    split_folds: bool = False
    fill_holes: int | None = None
    cut_to_disk: bool = False
    drop_unused: bool = False


def all_steps(steps: Iterable[RepairSteps]) -> RepairSteps:
    """The steps that any of some choices has.

    Parameters
    ----------
    steps : iterable of RepairSteps
        Distances are 0 where they are chosen, as `steps_for` does.

    Returns
    -------
    RepairSteps
    """
    values: dict[str, Any] = {}
    for one in steps:
        values |= {
            name: value for name, value in vars(one).items() if value is not None and value is not False
        }
    return RepairSteps(**values)


def requirement_of(command: str, kind: str) -> Requirement:
    """What a command requires of a mesh of this kind.

    Parameters
    ----------
    command : str
    kind : {'surface', 'tetrahedra'}

    Returns
    -------
    Requirement

    Raises
    ------
    ParameterError
        For a command that takes no such mesh.
    """
    if command not in REQUIREMENTS or kind not in REQUIREMENTS[command].kinds:
        commands = ", ".join(name for name, need in REQUIREMENTS.items() if kind in need.kinds)
        raise ParameterError(
            f"{command!r} takes no {kind}; commands that do: {commands}", parameter="command"
        )
    return REQUIREMENTS[command]


def steps_for(command: str) -> RepairSteps:
    """Steps that make a surface acceptable to a command, as far as repairs can.

    Parameters
    ----------
    command : str

    Returns
    -------
    RepairSteps

    Raises
    ------
    ParameterError
        For a command that takes no surface.
    """
    need = requirement_of(command, "surface")
    manifold = need.surface.get("manifold", False) or need.surface.get("manifold_edges", False)
    return RepairSteps(
        weld=0.0,
        drop_degenerate=need.every_area,
        split_edges=0.0 if need.every_area else None,
        drop_duplicates=manifold,
        split_fans=manifold,
        orient=need.surface.get("oriented", False),
    )


def repair_mesh(mesh: TriangleMesh, chosen_steps: RepairSteps) -> tuple[RepairedMesh, dict[str, int]]:
    """Repair a surface by the chosen steps, in their fixed order.

    `input_vertex` of a vertex that was made by splitting names the vertex that it was split from.

    Parameters
    ----------
    mesh : TriangleMesh
    chosen_steps : RepairSteps

    Returns
    -------
    repaired : RepairedMesh
    changes : dict of str to int
        Number of changes of each step.

    Raises
    ------
    ParameterError
        No step is chosen.
    MeshError
        A step needs what the mesh does not have: filling and cutting take oriented manifold surfaces, cutting
        one-sided ones too. Or no face is left with three different vertices.
    """
    plan: list[tuple[str, Any, Callable[[RepairedMesh], RepairedMesh]]] = [
        ("weld", chosen_steps.weld is not None, lambda r: steps.weld(r, chosen_steps.weld or 0.0)),
        ("drop_degenerate", chosen_steps.drop_degenerate, steps.drop_degenerate),
        ("drop_duplicates", chosen_steps.drop_duplicates, steps.drop_duplicates),
        (
            "split_edges",
            chosen_steps.split_edges is not None,
            lambda r: split_edges(r, chosen_steps.split_edges or 0.0),
        ),
        ("largest", chosen_steps.largest, steps.keep_largest),
        ("split_fans", chosen_steps.split_fans, split_fans),
        ("orient", chosen_steps.orient, steps.orient),
        ("split_folds", chosen_steps.split_folds, steps.split_folds),
        (
            "fill_holes",
            chosen_steps.fill_holes is not None,
            lambda r: fill_holes(r, chosen_steps.fill_holes or 0),
        ),
        ("cut_to_disk", chosen_steps.cut_to_disk, steps.cut_to_disk),
        ("drop_unused", chosen_steps.drop_unused, steps.drop_unused),
    ]
    check_steps(mesh, chosen_steps)
    repaired = RepairedMesh.unchanged(mesh)
    changes: dict[str, int] = {}
    for name, is_requested, step in plan:
        if is_requested:
            if name in MANIFOLD_STEPS:
                _require_manifold(repaired.mesh, name, before=_words(chosen_steps, changes))
            repaired = step(repaired)
            changes[name] = repaired.changes
    if repaired.mesh.n_faces == 0 and mesh.n_faces:
        raise MeshError("the repair leaves no face; choose fewer steps")
    if changes.get("weld"):
        _check_weld(mesh, repaired)
    return repaired, changes


def _check_weld(mesh: TriangleMesh, repaired: RepairedMesh) -> None:
    """Warn of faces that a weld collapsed; raise MeshError where it collapsed all of them."""
    after, before = repaired.mesh.topology.repeated_vertex_faces, mesh.topology.repeated_vertex_faces
    n_collapsed = int((~np.isin(repaired.input_face[after], before)).sum())
    if n_collapsed and len(after) == repaired.mesh.n_faces:
        raise MeshError(
            "the weld leaves no face with three different vertices; weld by a smaller distance, or not at all"
        )
    if n_collapsed:
        log.warning(
            "the weld makes %s a vertex twice: remove such faces with `drop_degenerate`, or weld by a "
            "smaller distance", counted(n_collapsed, "face name", "faces name"),
        )  # fmt: skip


def check_steps(mesh: TriangleMesh, chosen_steps: RepairSteps) -> None:
    """Raise an error for steps that the mesh cannot take, whatever the steps before them do.

    Parameters
    ----------
    mesh : TriangleMesh
    chosen_steps : RepairSteps

    Raises
    ------
    ParameterError
        No step is chosen.
    MeshError
        A step needs what the mesh does not have, and no step before it makes.
    """
    requested = [
        name for name, value in asdict(chosen_steps).items() if value is not None and value is not False
    ]
    if not requested:
        raise ParameterError("no repair is chosen; name one, such as `orient`, or a command by `for_command`")
    first = next((k for k, name in enumerate(requested) if name in MANIFOLD_STEPS), len(requested))
    if first < len(requested) and {*requested[:first]} <= {"orient"}:
        _require_manifold(mesh, requested[first], oriented=first == 0)


def _words(chosen_steps: RepairSteps, names: Iterable[str]) -> dict[str, str]:
    """Steps by name as a call states them."""
    values = asdict(chosen_steps)
    return {name: name if values[name] is True else f"{name}={values[name]:g}" for name in names}


def _require_manifold(
    mesh: TriangleMesh, parameter: str, *, oriented: bool = True, before: Mapping[str, str] | None = None
) -> None:
    """Raise an error for what the step does not take.

    Its remedy adds steps that run before this one, or is a repair of its own that repeats the steps before.
    """
    one_sided = parameter == "cut_to_disk"
    try:
        require(mesh, "this step", manifold=True, oriented=oriented, one_sided=one_sided)
    except MeshError as error:
        earlier_steps, advice = dict(before or {}), ""
        if "`repair=cut_to_disk" in str(error) and earlier_steps.pop("weld", None) is not None:
            advice = ", and drop `weld` then, which closes the cut"

        def remedy(match: re.Match[str]) -> str:
            steps = match[1].split()
            names = {word.partition("=")[0] for word in steps}
            if names <= EARLY_STEPS:
                return f": add {' and '.join(f'`{name}`' for name in steps)}"
            earlier = [word for name, word in earlier_steps.items() if name not in names]
            return f" with `repair={' '.join([*earlier, *steps])}`"

        raise MeshError(
            f"`{parameter}`: {re.sub(' with `repair=([^`]*)`', remedy, str(error))}{advice}"
        ) from None


def refusals(mesh: TriangleMesh | TetMesh) -> dict[str, str]:
    """Why commands that take such meshes refuse this one.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh

    Returns
    -------
    dict of str to str
        By command; empty where none does.
    """
    kind = kind_of(mesh)
    reasons = {name: unmet_need(mesh, name) for name, need in REQUIREMENTS.items() if kind in need.kinds}
    return {name: reason for name, reason in reasons.items() if reason is not None}


def repaired_array(values: np.ndarray, source: np.ndarray) -> np.ndarray | None:
    """Array of the input at the vertices or faces of the repaired mesh.

    Parameters
    ----------
    values : (k, ...) ndarray
    source : (k',) ndarray of int64
        Input element of each, -1 for new ones.

    Returns
    -------
    (k', ...) ndarray or None
        None where the repair added elements.
    """
    return None if (source < 0).any() else values[source]
