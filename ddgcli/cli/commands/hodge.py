"""`ddgcli hodge`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ddgcli.choices import FIELD_BOUNDARIES
from ddgcli.cli import options
from ddgcli.cli.commands.geodesic_curves import CURVE_FORMATS
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run
from ddgcli.errors import renamed_parameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.algorithms.hodge.hodge_analysis import HodgeAnalysis
    from ddgcli.algorithms.hodge.homology import Boundary
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh


@click.command("hodge")
@options.mesh_arg
@click.option(
    "--field", metavar="NAME", help="Array of the input: vectors on vertices or faces, or edge values."
)
@click.option("--field-file", metavar="FILE", help="The same from a .npy, .npz, .csv or .txt file.")
@click.option(
    "--boundary",
    type=click.Choice(FIELD_BOUNDARIES),
    default="tangential",
    show_default=True,
    help="Harmonic fields are tangential or normal to the boundary.",
)
@click.option("--basis", is_flag=True, help="Write an orthonormal harmonic basis: harmonic_000, ...")
@click.option(
    "--generators",
    metavar="PATH",
    help="Write the generators of the homology as closed polylines (.vtp, ...).",
)
@options.common
def command(
    mesh_path: str,
    field: str | None,
    field_file: str | None,
    boundary: Boundary,
    basis: bool,
    generators: str | None,
    common: CommonOptions,
) -> None:
    """Split a field on MESH into exact, coexact and harmonic parts.

    MESH is a surface or a mesh of tetrahedra. Without a field the Betti numbers, the generators of the
    homology and, with --basis, the harmonic fields are computed.

    \b
    Examples:
      ddgcli hodge torus.vtu --field wind -o parts.vtu
      ddgcli hodge torus.vtu --generators loops.vtp

    Choosing a discretisation: vectors on faces split exactly at the least cost; vectors on vertices are
    averaged twice (accuracy.reconstruction_residual measures the loss). See docs/hodge.md.
    """
    run = Run(
        "hodge", common, field=field or field_file, boundary=boundary, basis=basis, generators=generators
    )
    run.plan_output(generators, CURVE_FORMATS)
    run.add_input(field_file)
    source = run.read(mesh_path, accept=("surface", "tetrahedra"))

    from ddgcli.algorithms.hodge.hodge_analysis import array_names, check_query, hodge_analysis
    from ddgcli.algorithms.hodge.homology import betti_numbers
    from ddgcli.io.arrays import input_field
    from ddgcli.mesh.fields import AnnotatedMesh, surface_arrays
    from ddgcli.mesh.tet_mesh import TetMesh

    mesh = source.mesh if isinstance(source.mesh, TetMesh) else source.surface
    with renamed_parameters(name="field"):
        array = input_field(source, field, field_file)
    place = check_query(mesh, array, basis)
    n_basis_fields = betti_numbers(mesh).of_boundary(boundary)[1] if basis else 0
    names = array_names(mesh, place, n_basis_fields, has_field=array is not None)
    drawn = (*names["vertex"], *names["face"])
    run.begin(drawn, drawn)
    analysis = hodge_analysis(mesh, array, boundary, basis, run.progress("hodge"))
    annotated = analysis.annotated
    arrays = {**annotated.vertex, **surface_arrays(mesh, annotated.face)}
    name, values = run.picture_array(arrays, "potential")
    run.write(annotated, converged=analysis.converged)
    if generators is not None:
        run.write_file(generators, AnnotatedMesh(generator_curves(mesh, analysis.results["generators"])))
    run.plot(lambda path: draw(path, source.surface, name, values, analysis, mesh, run.picture_options))
    run.finish(analysis.results, analysis.accuracy, converged=analysis.converged)


def generator_curves(mesh: TriangleMesh | TetMesh, loops: list[list[int]]) -> CurveSet:
    """Closed polylines of edge loops, with the array `vertex` of the mesh's vertices."""
    import numpy as np

    from ddgcli.mesh.curve import CurveSet

    closed = [np.array([*loop, loop[0]], dtype=np.int64) for loop in loops]
    return CurveSet.from_paths([mesh.points[loop] for loop in closed], vertex=closed)


def draw(
    path: str,
    surface: TriangleMesh,
    name: str,
    values: NDArray | None,
    analysis: HodgeAnalysis,
    mesh: TriangleMesh | TetMesh,
    look: dict[str, Any],
) -> None:
    """Draw the potential on the surface, the generators as curves and the vectors of the field as arrows."""
    import numpy as np

    from ddgcli.plots.array import draw_array, glyphs_of

    loops = [mesh.points[[*loop, loop[0]]] for loop in analysis.results["generators"]]
    picture: dict[str, Any] = {"curves": loops, **look}
    field = analysis.vectors
    if name == "potential" and field is not None and len(field) in (surface.n_vertices, surface.n_faces):
        picture["glyphs"] = glyphs_of(surface, "field", np.asarray(field))
    draw_array(path, surface, name, values, **picture)
