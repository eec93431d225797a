"""`ddgcli info`."""

from __future__ import annotations

import click

from ddgcli.cli import options
from ddgcli.cli.options import Common
from ddgcli.cli.run import Run


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
    from ddgcli.algorithms.inspect.report import inspect_mesh
    from ddgcli.mesh.fields import AnnotatedMesh

    found = inspect_mesh(source.mesh)
    arrays = {"vertex": source.vertex, "face": source.face, "edge": source.edge}
    results = {**found.results, "arrays": {place: sorted(names) for place, names in arrays.items() if names}}
    run.write(AnnotatedMesh(source.mesh, vertex=found.vertex, face=found.face))
    if source.kind == "surface":
        from ddgcli.plots.surface import draw_surface

        shown = found.face["min_angle_degrees"]
        run.plot(lambda path: draw_surface(path, source.surface, shown, label="smallest angle [degrees]"))
    run.finish(results, {})
