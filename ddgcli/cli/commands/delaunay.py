"""`ddgcli delaunay`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ddgcli.cli import options
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run
from ddgcli.errors import ParameterError, named_array, renamed_parameters

if TYPE_CHECKING:
    from ddgcli.algorithms.delaunay.intrinsic_delaunay import DelaunayResult
    from ddgcli.mesh.triangle_mesh import TriangleMesh

INTRINSIC_FORMATS = (".npz", ".vtkhdf")
LINE_FORMATS = (".vtp", ".vtu", ".obj", ".vtk", ".xdmf")
EDGE_ASPECT = 0.1  # width over length of drawn edges: more than half of a dense mesh remains free
OVERLAY_FORMATS = (".npz", ".vtkhdf", ".ply", ".vtu", ".vtp", ".vtk", ".xdmf", ".obj", ".off", ".stl")


@click.command(
    "delaunay",
    epilog="Choosing a method: flips alone (the default) suffice for Laplacians and distances; --refine 25 "
    "bounds the angles, at ten to a hundred times the cost. See docs/delaunay.md and "
    "docs/accuracy/delaunay.md.",
)
@options.mesh_arg
@click.option(
    "--refine",
    metavar="DEGREES",
    type=options.POSITIVE_NUMBER,
    help="Insert Steiner points until no angle is smaller (25 always succeeds; at most 33).",
)
@click.option(
    "--max-points",
    metavar="N",
    type=click.IntRange(min=0),
    help="With --refine: at most N Steiner points (exit 1 when they run out)  "
    "[default: 10 per vertex, at least 100000].",
)
@click.option(
    "--overlay",
    metavar="PATH",
    help="Write the common subdivision with the input: arrays input_face, intrinsic_face, vertex_kind "
    "(0 input vertex, 1 Steiner point, 2 crossing).",
)
@click.option(
    "--transfer",
    metavar="ARRAY",
    multiple=True,
    help="Transfer an array on the vertices of MESH to those of the triangulation: the values nearest in L2 "
    "(in -o; on --overlay its interpolant). May be repeated.",
)
@click.option(
    "--dual",
    metavar="PATH",
    help="Write the circumcentric dual: arrays circumcentre, circumradius, dual_length, dual_area (.npz, "
    ".vtkhdf), or its edges as lines on the surface (.vtp, .vtu, .vtk, .xdmf, .obj).",
)
@click.option("--condition", is_flag=True, help="Also measure the condition number of the Laplacian.")
@options.subdivide
@options.common_of_edges
def command(
    mesh_path: str,
    refine: float | None,
    max_points: int | None,
    overlay: str | None,
    transfer: tuple[str, ...],
    dual: str | None,
    condition: bool,
    subdivide: int,
    common: CommonOptions,
) -> None:
    """Compute the intrinsic Delaunay triangulation of MESH: same vertices, same metric, better edges.

    -o writes faces, face_edge_lengths, neighbors and points (.npz or .vtkhdf); with --refine also where the
    points lie on the input: input_face and input_barycentric.

    \b
    Examples:
      ddgcli delaunay scan.ply -o scan-idt.npz --overlay common.ply --plot edges.png
      ddgcli delaunay scan.ply --refine 25 --transfer temperature -o scan-idt.vtkhdf
      ddgcli delaunay part.stl --refine 25 -o part-idt.npz
      ddgcli delaunay scan.ply --dual dual.npz
    """
    run = Run(
        "delaunay",
        common,
        formats=INTRINSIC_FORMATS,
        refine=refine,
        max_points=max_points,
        overlay=overlay,
        transfer=list(transfer),
        dual=dual,
        condition=condition,
        subdivide=subdivide,
    )
    if max_points is not None and refine is None:
        raise ParameterError(
            "bounds the points of `refine`; add `refine`, or leave it out", parameter="max_points"
        )
    run.plan_output(overlay, OVERLAY_FORMATS)
    run.plan_output(dual, INTRINSIC_FORMATS + LINE_FORMATS)
    lines = dual is not None and not dual.lower().endswith(INTRINSIC_FORMATS)
    source = run.read(mesh_path, subdivide=subdivide)
    transferred = {
        name: named_array(source.vertex, name, "vertex array", parameter="transfer") for name in transfer
    }

    from ddgcli.algorithms.delaunay.intrinsic_delaunay import check_query, intrinsic_delaunay
    from ddgcli.mesh.fields import AnnotatedMesh

    with renamed_parameters(degrees="refine", transferred="transfer"):
        check_query(source.surface, refine, transferred)
    run.begin()
    result = intrinsic_delaunay(
        source.surface,
        degrees=refine,
        max_points=max_points,
        subdivide=bool(overlay or common.plot or lines),
        dual=dual is not None,
        transferred=transferred,
        condition=condition,
        seed=common.seed,
    )
    run.write(AnnotatedMesh(result.mesh, vertex=result.vertex), converged=result.converged)
    if overlay:
        run.write_file(overlay, result.overlay(), converged=result.converged)
    if dual is not None:
        write_dual(run, dual, result, lines)
    run.plot(lambda path: draw(path, source.surface, result, run.picture_options))
    run.finish(result.results, result.accuracy, converged=result.converged)


def write_dual(run: Run, path: str, result: DelaunayResult, lines: bool) -> None:
    """Write the circumcentric dual, as lines on the surface or as the arrays of its cells."""
    if result.dual is None:
        return
    if lines and result.subdivision:
        from ddgcli.algorithms.delaunay.dual import dual_lines
        from ddgcli.mesh.fields import AnnotatedMesh

        run.write_file(path, AnnotatedMesh(dual_lines(result.dual, result.subdivision)))
    else:
        run.write_file(path, result.dual_arrays, converged=result.converged)


def draw(path: str, mesh: TriangleMesh, result: DelaunayResult, look: dict[str, Any]) -> None:
    """Draw the edges of the input beside the intrinsic ones, and the dual if there is one, as thin lines."""
    from ddgcli.algorithms.delaunay.dual import dual_lines
    from ddgcli.plots.surface import draw_beside

    cut = result.subdivision
    panels: list[tuple[TriangleMesh, dict[str, Any]]]
    panels = [(mesh, {"curves": list(mesh.points[mesh.topology.edges]), "title": "input"}),
              (mesh, {"curves": cut.curves() if cut else (), "title": "intrinsic Delaunay"})]  # fmt: skip
    if result.dual is not None and cut is not None:
        lines = dual_lines(result.dual, cut)
        panels.append((mesh, {"curves": list(lines.points[lines.lines]), "title": "circumcentric dual"}))
    draw_beside(path, panels, curve_width=0.35, curve_halo=0.0, curve_aspect=EDGE_ASPECT, **look)
