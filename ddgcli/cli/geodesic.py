"""`ddgcli geodesic`."""

from __future__ import annotations

import click

from ddgcli.cli import options
from ddgcli.cli.geodesic_curves import (
    CurveOptions,
    check_asked,
    compute_curves,
    compute_vectors,
    curve_options,
    write_curves,
)
from ddgcli.cli.options import Common
from ddgcli.cli.run import Run

METHODS = ("exact", "heat", "fast-marching", "dijkstra")


@click.command("geodesic")
@options.mesh_arg
@click.option("--source", "source", type=int, multiple=True, metavar="ID", help="Source vertex; repeatable.")
@click.option("--method", type=click.Choice(METHODS), default="exact", show_default=True)
@curve_options
@options.common
def command(
    mesh_path: str, source: tuple[int, ...], method: str, curves: CurveOptions, common: Common
) -> None:
    """Measure distance along the surface of MESH from the sources, and draw curves on it."""
    check_asked(curves, bool(source), method)
    run = Run("geodesic", common, source=list(source), method=method, **curves.said())
    mesh_input = run.read(mesh_path)
    mesh = mesh_input.mesh
    vertex, results, accuracy, converged, exact = {}, {}, {}, True, None
    with run.timed("compute"):
        from ddgcli.algorithms.geodesic import measure_distance
        from ddgcli.algorithms.geodesic_sources import Sources
        from ddgcli.mesh.fields import AnnotatedMesh

        sources = Sources.at(source)
        if source or not curves.any:
            measured = measure_distance(mesh, sources, method)
            exact = measured.exact
            vertex, results, accuracy = measured.arrays, measured.results, measured.accuracy
    if curves.any:
        made = compute_curves(run, mesh, curves, sources, exact)
        write_curves(run, mesh, made, curves.paths_output)
        results, accuracy = results | {"paths": made.entries}, accuracy | made.accuracy
        converged = made.converged
    if curves.any_vectors:
        vectors = compute_vectors(run, mesh, curves, sources, exact)
        vertex, results, accuracy = (
            vertex | vectors.arrays,
            results | vectors.results,
            accuracy | vectors.accuracy,
        )
    run.write(AnnotatedMesh(mesh, vertex=vertex))
    run.finish(results, accuracy, converged=converged)
