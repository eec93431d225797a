"""`ddgcli geodesic`."""

from __future__ import annotations

import click

from ddgcli.cli import options
from ddgcli.cli.commands.geodesic_curves import (
    CURVE_FORMATS,
    CurveOptions,
    check_asked,
    compute_curves,
    compute_vectors,
    curve_options,
    write_curves,
)
from ddgcli.cli.commands.geodesic_distance import (
    DistanceChoice,
    check_distance,
    compute_distance,
    distance_options,
    draw_distance,
    read_sources,
)
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run


@click.command(
    "geodesic",
    epilog="Which: exact for one source; heat for many, two per cent off or less; fast-marching for a tenth "
    "of a per cent on average, in up to half the time. ddgcli tradeoff geodesic shows it on your mesh. See "
    "docs/geodesic.md and docs/accuracy/geodesic.md.",
)
@options.mesh_arg
@distance_options
@curve_options
@options.subdivide
@options.common
def command(
    mesh_path: str, distance: DistanceChoice, curves: CurveOptions, subdivide: int, common: CommonOptions
) -> None:
    """Measure distance along the surface of MESH from the sources, and draw curves on it.

    \b
    Example:
      ddgcli geodesic spot.obj --source 0 -o distance.vtu --path-to 100 --paths-output path.vtp
    """
    check_distance(distance)
    check_asked(curves, distance.any, distance.method, extra=distance.isolines is not None)
    run = Run("geodesic", common, subdivide=subdivide, **distance.said(), **curves.said())
    for path in curves.paths_output:
        run.will_write(path, CURVE_FORMATS)
    run.also_reads(curves.field)
    read = run.read(mesh_path, subdivide=subdivide)
    mesh = read.surface
    vertex, face, results, accuracy, converged, measured, made = {}, {}, {}, {}, True, None, None
    lines: list = []
    with run.timed("compute"):
        from ddgcli.mesh.fields import AnnotatedMesh

        sources = read_sources(mesh, distance) if distance.any or not curves.any else None
        if sources is not None:
            measured = compute_distance(run, mesh, distance, sources, directions=curves.log_map)
            vertex, face, lines = measured.vertex, measured.face, measured.curves
            results, accuracy, converged = measured.results, measured.accuracy, measured.converged
    if curves.any or lines:
        exact = None if measured is None else measured.exact
        made = compute_curves(run, read, curves, sources, exact, more=lines)
        results, accuracy = results | {"paths": made.entries}, accuracy | made.accuracy
        converged &= made.converged
    if curves.any_vectors and sources is not None and measured is not None:
        vectors = compute_vectors(run, mesh, curves, sources, measured)
        vertex, results, accuracy = (
            vertex | vectors.arrays,
            results | vectors.results,
            accuracy | vectors.accuracy,
        )
    run.shown({**vertex, **face}, "geodesic_distance")
    run.write(AnnotatedMesh(mesh, vertex=vertex, face=face), converged=converged)
    if made is not None:
        write_curves(run, mesh, made, curves.paths_output, converged=converged)
    draw_distance(run, mesh, distance, vertex, face, sources, made)
    run.finish(results, accuracy, converged=converged)
