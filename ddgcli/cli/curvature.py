"""`ddgcli curvature`."""

from __future__ import annotations

import click

from ddgcli.cli import options
from ddgcli.cli.options import Common
from ddgcli.cli.run import Run


@click.command("curvature")
@options.mesh_arg
@options.common
def command(mesh_path: str, common: Common) -> None:
    """Measure the curvature of MESH at every vertex."""
    run = Run("curvature", common)
    source = run.read(mesh_path)
    with run.timed("compute"):
        from ddgcli.algorithms.curvature import angle_defect
        from ddgcli.mesh.fields import AnnotatedMesh

        defect = angle_defect(source.mesh)
    run.write(AnnotatedMesh(source.mesh, vertex={"angle_defect": defect}))
    run.finish({"total_gaussian_curvature": float(defect.sum())}, {})
