"""`ddgcli info`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ddgcli.cli import options
from ddgcli.cli.options import Common
from ddgcli.cli.run import Run

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.io.mesh_file import MeshInput


@click.command("info", short_help="What a file holds, how good it is, and which commands take it.")
@options.mesh_arg
@options.common
def command(mesh_path: str, common: Common) -> None:
    """Say what MESH holds, how good it is, and which commands take it.

    Counts, components, boundary loops, genus, orientation; angles and aspect of the cells; defects with
    the numbers of the first few; size in the file's own unit; for every command `accepts`: yes, or why
    not and the mend. Surfaces, tetrahedra and curves. Nothing is repaired.

    -o writes the mesh with the arrays that show where: component, boundary, non_manifold (vertices) and
    min_angle_degrees (faces; of tetrahedra the smallest dihedral angle).

    \b
    Examples:
      ddgcli info part.stl
      ddgcli info part.stl -o part.vtu
      ddgcli info ball.msh -o surface.ply      the boundary of tetrahedra
    """
    run = Run("info", common)
    source = run.read(mesh_path, accept=("surface", "tetrahedra", "curve"))
    from ddgcli.algorithms.inspection.report import inspect_mesh
    from ddgcli.mesh.fields import AnnotatedMesh

    found = inspect_mesh(source.mesh)
    arrays = {"vertex": source.vertex, "face": source.face, "edge": source.edge}
    results = {**found.results, "arrays": {place: sorted(names) for place, names in arrays.items() if names}}
    on_surface = source.kind == "surface"
    shown = {**source.vertex, **source.face, **found.vertex, **found.face} if on_surface else {}
    name, values = run.shown(shown, "min_angle_degrees")
    run.write(AnnotatedMesh(source.mesh, vertex=found.vertex, face=found.face))
    run.plot(lambda path: draw(path, source, name, values, run.look))
    run.finish(results, {})


def draw(path: str, source: MeshInput, name: str, values: NDArray | None, look: dict[str, Any]) -> None:
    """The surface (of tetrahedra the boundary, uncoloured) by its smallest angles, or the curves."""
    from ddgcli.mesh.curve import CurveSet

    if isinstance(source.mesh, CurveSet):
        from ddgcli.plots.curve import draw_curves

        paths, points = source.mesh.paths(), source.mesh.points
        draw_curves(path, [points[p] for p, _ in paths], closed=[closed for _, closed in paths], **look)
        return
    from ddgcli.plots.array import draw_array

    label = {"label": "smallest angle [degrees]"} if name == "min_angle_degrees" else {}
    draw_array(path, source.surface, name, values, **label, **look)
