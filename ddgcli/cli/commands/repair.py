"""`ddgcli repair`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import click

from ddgcli.cli import options
from ddgcli.cli.input_facts import input_facts
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.parameters import with_repair_command
from ddgcli.cli.run import Run
from ddgcli.errors import ParameterError, renamed_parameters

if TYPE_CHECKING:
    from ddgcli.io.mesh_file import MeshInput


@click.command("repair", short_help="Repair a surface: weld, split, orient, fill, cut.")
@options.mesh_arg
@click.option(
    "--weld",
    is_flag=False,
    flag_value="0",
    type=options.NONNEGATIVE_NUMBER,
    metavar="[DISTANCE]",
    help="Merge vertices at equal positions, or up to DISTANCE apart.",
)
@click.option(
    "--split-edges",
    is_flag=False,
    flag_value="0",
    type=options.NONNEGATIVE_NUMBER,
    metavar="[DISTANCE]",
    help="Divide boundary edges at boundary vertices on them, or up to DISTANCE away (T-junctions).",
)
@click.option("--orient", is_flag=True, help="Reverse faces so that neighbours have the same orientation.")
@click.option(
    "--split-fans",
    is_flag=True,
    help="Duplicate vertices: one for each fan of faces; splits edges of three or more faces.",
)
@click.option("--split-folds", is_flag=True, help="Separate the faces at edges folded by 180 degrees.")
@click.option("--drop-degenerate", is_flag=True, help="Remove faces without area.")
@click.option("--drop-duplicates", is_flag=True, help="Remove faces that occur twice.")
@click.option("--drop-unused", is_flag=True, help="Remove vertices that belong to no face.")
@click.option(
    "--fill-holes",
    type=click.IntRange(min=3),
    metavar="EDGES",
    help="Fill boundary loops of at most EDGES edges.",
)
@click.option("--largest", is_flag=True, help="Keep the component with the largest area.")
@click.option("--cut-to-disk", is_flag=True, help="Cut every component open to a disk.")
@click.option(
    "--for", "for_command", multiple=True, metavar="COMMAND", help="Run the steps that COMMAND needs."
)
@options.common
def command(mesh_path: str, common: CommonOptions, for_command: tuple[str, ...], **steps: Any) -> None:
    """Repair the surface MESH, or tetrahedra, and write it with maps to the input.

    Every step has a flag, and only these steps change the mesh. They run in this order: --weld,
    --drop-degenerate, --drop-duplicates, --split-edges, --largest, --split-fans, --orient, --split-folds,
    --fill-holes, --cut-to-disk, --drop-unused.

    Tetrahedra have --weld, --drop-degenerate, --drop-duplicates, --split-fans (bodies that touch), --orient
    (inverted cells) and --drop-unused.

    The output holds `input_vertex` and `input_face` (-1 for faces that fill a hole). `results.changes` counts
    what each step changed; `results.refused_by` names the commands that still refuse the surface, and why.

    \b
    Examples:
      ddgcli repair scan.obj --for willmore-flow -o clean.ply
      ddgcli repair part.stl --split-fans --orient --fill-holes 40 -o closed.ply
      ddgcli repair part.stl --weld --split-edges -o joined.ply
      ddgcli repair torus.ply --cut-to-disk -o disk.obj
    """
    run = Run("repair", common, for_command=list(for_command), **steps)
    if for_command and any(value is not None and value is not False for value in steps.values()):
        raise ParameterError("--for selects the steps; leave the other flags out")
    source = run.read(mesh_path, ("surface", "tetrahedra"))
    if source.kind == "tetrahedra":
        _repair_cells(run, source, for_command, steps)
        return
    from ddgcli.algorithms.repair.pipeline import (
        RepairSteps,
        all_steps,
        check_steps,
        refusals,
        repair_mesh,
        repaired_array,
        steps_for,
    )
    from ddgcli.mesh.fields import AnnotatedMesh

    mesh = source.surface
    with renamed_parameters(command="for_command"):
        selected = all_steps(map(steps_for, for_command)) if for_command else RepairSteps(**steps)
    check_steps(mesh, selected)
    marks = ("input_vertex", "input_face")
    run.begin((*source.vertex, *source.face, *marks), (*source.vertex, *source.face, *marks))
    repaired, changes = repair_mesh(mesh, selected)
    vertex = {name: repaired_array(values, repaired.input_vertex) for name, values in source.vertex.items()}
    face = {name: repaired_array(values, repaired.input_face) for name, values in source.face.items()}
    vertex |= {"input_vertex": repaired.input_vertex}
    face |= {"input_face": repaired.input_face}
    annotated = AnnotatedMesh(
        repaired.mesh,
        vertex={name: values for name, values in vertex.items() if values is not None},
        face={name: values for name, values in face.items() if values is not None},
    )
    reasons = refusals(repaired.mesh)
    written = run.common.outputs[:1]
    refused_by = {name: with_repair_command(reason, written) for name, reason in reasons.items()}
    accepted = reasons.keys().isdisjoint(for_command)
    run.write(annotated, converged=accepted)
    name, values = run.picture_array({**annotated.vertex, **annotated.face}, "input_face")
    from ddgcli.plots.array import draw_array

    run.plot(lambda path: draw_array(path, repaired.mesh, name, values, **run.picture_options))
    results = {"changes": changes, "repaired": input_facts(repaired.mesh), "refused_by": refused_by}
    run.finish(results, {}, converged=accepted)


def _repair_cells(run: Run, source: MeshInput, for_command: tuple[str, ...], flags: dict[str, Any]) -> None:
    """Repair tetrahedra, and write them with maps to the input."""
    from ddgcli.algorithms.repair.pipeline import RepairSteps, all_steps, refusals
    from ddgcli.algorithms.repair.solid import check_solid_steps, repair_solid, solid_steps_for
    from ddgcli.mesh.fields import AnnotatedMesh, surface_arrays
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.plots.array import draw_array

    with renamed_parameters(command="for_command"):
        steps = all_steps(map(solid_steps_for, for_command)) if for_command else RepairSteps(**flags)
    mesh = cast(TetMesh, source.mesh)
    check_solid_steps(mesh, steps)
    arrays = (*source.vertex, *source.face, "input_vertex", "input_cell")
    run.begin(arrays, arrays)
    repaired = repair_solid(mesh, steps)
    vertex = {name: values[repaired.input_vertex] for name, values in source.vertex.items()}
    cell = {name: values[repaired.input_cell] for name, values in source.face.items()}
    annotated = AnnotatedMesh(
        repaired.mesh,
        vertex=vertex | {"input_vertex": repaired.input_vertex},
        face=cell | {"input_cell": repaired.input_cell},
    )
    reasons = refusals(repaired.mesh)
    written = run.common.outputs[:1]
    refused_by = {
        name: with_repair_command(reason, written, tetrahedra=True) for name, reason in reasons.items()
    }
    accepted = reasons.keys().isdisjoint(for_command)
    run.write(annotated, converged=accepted)
    shown = annotated.vertex | surface_arrays(repaired.mesh, annotated.face)
    name, values = run.picture_array(shown, "input_vertex")
    run.plot(lambda path: draw_array(path, repaired.mesh.boundary, name, values, **run.picture_options))
    facts = {"repaired": input_facts(repaired.mesh), "refused_by": refused_by}
    run.finish({"changes": repaired.changes, **facts}, {}, converged=accepted)
