"""`ddgcli hodge`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from ddgcli.cli import options
from ddgcli.cli.options import Common
from ddgcli.cli.run import Run

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.algorithms.hodge.homology import Boundary
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

    given = given_field(source, field, field_file)
    mesh = source.mesh if isinstance(source.mesh, TetMesh) else source.surface
    report = hodge_report(mesh, given, boundary, basis, run.progress("hodge"))
    run.write(report.annotated, converged=report.converged)
    run.plot(lambda path: draw(path, source.surface, report.shown))
    run.finish(report.results, report.accuracy, converged=report.converged)


def draw(path: str, mesh: TriangleMesh, potential: NDArray | None) -> None:
    """The surface, coloured by the potential of the exact part."""
    from ddgcli.plots.surface import draw_surface

    draw_surface(path, mesh, potential, label="potential")
