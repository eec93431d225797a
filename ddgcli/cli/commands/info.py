"""`ddgcli info`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ddgcli.cli import options
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.io.mesh_file import MeshInput


@click.command("info", short_help="Report the contents and quality of a file, and which commands accept it.")
@options.mesh_arg
@click.option(
    "--self-intersections",
    is_flag=True,
    help="Count the pairs of faces that cross; -o marks the faces as self_intersecting.",
)
@options.common
def command(mesh_path: str, self_intersections: bool, common: CommonOptions) -> None:
    """Report the contents and the quality of MESH, and which commands accept it.

    Counts, components, boundary loops, genus, orientation; angles and aspect of the cells; defects with
    the indices of the first few; size in the file's own unit; `accepts` for every command: yes, or the
    reason and a repair. Surfaces, tetrahedra and curves. Nothing is repaired.

    -o writes the mesh with arrays that locate the defects: component, boundary, non_manifold (vertices) and
    min_angle_degrees (faces; for tetrahedra the smallest dihedral angle).

    \b
    Examples:
      ddgcli info part.stl
      ddgcli info part.stl -o part.vtu
      ddgcli info part.stl --self-intersections --plot part.png --show self_intersecting
      ddgcli info ball.msh -o surface.ply      the boundary of tetrahedra
    """
    run = Run("info", common, self_intersections=self_intersections)
    source = run.read(mesh_path, accept=("surface", "tetrahedra", "curve"))
    from ddgcli.algorithms.inspection.inspect_mesh import array_names, inspect_mesh
    from ddgcli.mesh.fields import AnnotatedMesh, surface_arrays

    marks = array_names(source.mesh, self_intersections=self_intersections)
    run.begin((*source.vertex, *source.face, *marks) if source.kind != "curve" else (), marks)
    inspection = inspect_mesh(source.mesh, self_intersections=self_intersections)
    arrays = {"vertex": source.vertex, "face": source.face, "edge": source.edge}
    names = {place: sorted(names) for place, names in arrays.items() if names}
    accepts = run.with_commands(inspection.results["accepts"])
    results = {**inspection.results, "accepts": accepts, "arrays": names}
    of_faces = surface_arrays(source.mesh, {**source.face, **inspection.face})
    candidates = {**source.vertex, **inspection.vertex, **of_faces} if source.kind != "curve" else {}
    name, values = run.picture_array(candidates, "min_angle_degrees")
    run.write(AnnotatedMesh(source.mesh, vertex=inspection.vertex, face=inspection.face))
    run.plot(lambda path: draw(path, source, name, values, run.picture_options))
    run.finish(results, {})


def draw(path: str, source: MeshInput, name: str, values: NDArray | None, look: dict[str, Any]) -> None:
    """Draw the surface, or the boundary of tetrahedra, by the smallest angles; or the curves."""
    from ddgcli.mesh.curve import CurveSet

    if isinstance(source.mesh, CurveSet):
        from ddgcli.plots.curve import draw_curves

        paths, points = source.mesh.paths, source.mesh.points
        draw_curves(path, [points[p] for p, _ in paths], closed=[closed for _, closed in paths], **look)
        return
    from ddgcli.plots.array import draw_array

    label = {"label": "smallest angle [degrees]"} if name == "min_angle_degrees" else {}
    draw_array(path, source.surface, name, values, **label, **look)
