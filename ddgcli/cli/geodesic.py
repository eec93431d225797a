"""`ddgcli geodesic`."""

from __future__ import annotations

import click

from ddgcli.cli import options
from ddgcli.cli.options import Common
from ddgcli.cli.run import Run

METHODS = ("exact", "heat", "fast-marching", "dijkstra")


@click.command("geodesic")
@options.mesh_arg
@click.option("--source", "source", type=int, multiple=True, metavar="ID", help="Source vertex; repeatable.")
@click.option("--method", type=click.Choice(METHODS), default="exact", show_default=True)
@options.common
def command(mesh_path: str, source: tuple[int, ...], method: str, common: Common) -> None:
    """Measure distance along the surface of MESH from the sources."""
    run = Run("geodesic", common, source=list(source), method=method)
    mesh_input = run.read(mesh_path)
    mesh = mesh_input.mesh
    with run.timed("compute"):
        from ddgcli.algorithms.geodesic import measure_distance
        from ddgcli.algorithms.geodesic_sources import Sources
        from ddgcli.mesh.fields import AnnotatedMesh

        measured = measure_distance(mesh, Sources.at(source), method)
    run.write(AnnotatedMesh(mesh, vertex=measured.arrays))
    run.finish(measured.results, measured.accuracy)
