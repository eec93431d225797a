"""`ddgcli delaunay`."""

from __future__ import annotations

import click

from ddgcli.cli import options
from ddgcli.cli.options import Common
from ddgcli.cli.run import Run


@click.command("delaunay")
@options.mesh_arg
@click.option("--condition", is_flag=True, help="Also measure the condition number of the Laplacian.")
@options.common
def command(mesh_path: str, condition: bool, common: Common) -> None:
    """The intrinsic Delaunay triangulation of MESH: same vertices, same metric, better edges."""
    run = Run("delaunay", common, condition=condition)
    source = run.read(mesh_path)
    with run.timed("compute"):
        from ddgcli.algorithms.delaunay import flip_to_delaunay
        from ddgcli.algorithms.delaunay_report import metric_residuals, triangulation_statistics
        from ddgcli.mesh.fields import AnnotatedMesh

        flipped = flip_to_delaunay(source.mesh)
        results = {
            "flips": flipped.flips,
            "steiner_points": 0,
            "before": triangulation_statistics(source.mesh, condition=condition),
            "after": triangulation_statistics(flipped.mesh, condition=condition),
        }
        accuracy = metric_residuals(source.mesh, flipped.mesh)
    run.write(AnnotatedMesh(flipped.mesh))
    run.finish(results, accuracy)
