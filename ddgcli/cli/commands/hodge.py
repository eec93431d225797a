"""`ddgcli hodge`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ddgcli.cli import options
from ddgcli.cli.options import Common
from ddgcli.cli.run import Run

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.algorithms.hodge.homology import Boundary
    from ddgcli.algorithms.hodge.report import HodgeReport
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh


@click.command("hodge")
@options.mesh_arg
@click.option(
    "--field", metavar="NAME", help="Array of the input: vectors on vertices or faces, or edge values."
)
@click.option("--field-file", metavar="PATH", help="The same from a .npy, .npz, .csv or .txt file.")
@click.option(
    "--boundary",
    type=click.Choice(["tangential", "normal"]),
    default="tangential",
    show_default=True,
    help="Harmonic fields run along the boundary, or stand on it.",
)
@click.option("--basis", is_flag=True, help="Write an orthonormal harmonic basis: harmonic_000, ...")
@options.common
def command(
    mesh_path: str, field: str | None, field_file: str | None, boundary: Boundary, basis: bool, common: Common
) -> None:
    """Split a field on MESH into exact, coexact and harmonic parts.

    MESH is a surface or a mesh of tetrahedra. Without a field the Betti numbers, the generators of the
    homology and, with --basis, the harmonic fields are computed.

    \b
    Example:
      ddgcli hodge torus.vtu --field wind -o parts.vtu

    Which discretisation: vectors on faces split exactly and cheapest; vectors on vertices pay two averages
    (accuracy.reconstruction_residual tells how much). See docs/hodge.md.
    """
    run = Run("hodge", common, field=field or field_file, boundary=boundary, basis=basis)
    run.also_reads(field_file)
    source = run.read(mesh_path, accept=("surface", "tetrahedra"))

    from ddgcli.algorithms.hodge.report import hodge_report
    from ddgcli.io.arrays import given_field
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh

    given = given_field(source, field, field_file)
    mesh = source.mesh if isinstance(source.mesh, TetMesh) else source.surface
    report = hodge_report(mesh, given, boundary, basis, run.progress("hodge"))
    arrays = {**report.annotated.vertex, **report.annotated.face}
    name, values = run.shown(
        arrays if isinstance(mesh, TriangleMesh) else report.annotated.vertex, "potential"
    )
    run.write(report.annotated, converged=report.converged)
    run.plot(lambda path: draw(path, source.surface, name, values, report, mesh, run.look))
    run.finish(report.results, report.accuracy, converged=report.converged)


def draw(
    path: str,
    surface: TriangleMesh,
    name: str,
    values: NDArray | None,
    report: HodgeReport,
    mesh: TriangleMesh | TetMesh,
    look: dict[str, Any],
) -> None:
    """The surface by the potential, with the generators as curves and the vectors of the field as arrows."""
    import numpy as np

    from ddgcli.plots.array import draw_array, glyphs_of

    loops = [mesh.points[[*loop, loop[0]]] for loop in report.results["generators"]]
    given: dict[str, Any] = {"curves": loops, **look}
    field = report.vectors
    if name == "potential" and field is not None and len(field) in (surface.n_vertices, surface.n_faces):
        given["glyphs"] = glyphs_of(surface, "field", np.asarray(field))
    draw_array(path, surface, name, values, **given)
