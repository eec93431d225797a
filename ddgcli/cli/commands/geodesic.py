"""`ddgcli geodesic`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import click

from ddgcli.algorithms.geodesics.query import CurveQuery, DistanceQuery, WaveQuery
from ddgcli.cli import options
from ddgcli.cli.commands.geodesic_curves import (
    CURVE_FORMATS,
    GeodesicCurveOptions,
    curve_options,
    write_curves,
)
from ddgcli.cli.commands.geodesic_distance import distance_options, draw_distance
from ddgcli.cli.commands.geodesic_waves import WaveOptions, input_edge_set, wave_options, write_matrix
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run


@click.command(
    "geodesic",
    epilog="Choosing a method: exact for one source; heat for many, with errors that the run estimates "
    "(at most 1 to 5 % of the largest distance, up to 30 % around holes of coarse meshes); fast-marching in "
    "up to half the time of exact (errors of 0.2 % on average; the largest 1 % in the median, up to 9 % on "
    "coarse parts, which the run does not estimate). ddgcli tradeoff geodesic compares them on your mesh. "
    "See docs/geodesic.md and docs/accuracy/geodesic.md.",
)
@options.mesh_arg
@distance_options
@curve_options
@wave_options
@options.solver
@options.subdivide
@options.common
def command(
    mesh_path: str,
    distance: DistanceQuery,
    curves: GeodesicCurveOptions,
    waves: WaveOptions,
    solver: str | None,
    subdivide: int,
    common: CommonOptions,
) -> None:
    """Measure distance along the surface of MESH from the sources, and draw curves on it.

    \b
    Example:
      ddgcli geodesic spot.obj --source 0 -o distance.vtu --path-to 100 --paths-output path.vtp
    """
    options.use_solver(solver)
    distance.check(needs_source=waves.signed_distance is None)
    curves.check(distance)
    waves.check(distance)
    curves.check_output(curves.has_curves or distance.isolines is not None or waves.fan is not None)
    run = Run(
        "geodesic",
        common,
        subdivide=subdivide,
        **({"solver": solver} if solver else {}),
        **_distance_options(distance),
        **_changed(curves),
        **_changed(waves),
    )
    for path in curves.paths_output:
        run.plan_output(path, CURVE_FORMATS)
    run.plan_output(waves.distance_matrix, (".npz",))
    for name in (curves.field, distance.source_edges, waves.signed_distance):
        run.add_input(name)
    read = run.read(mesh_path, subdivide=subdivide)
    mesh, field = read.surface, None
    if curves.field:
        from ddgcli.cli.forecast.curve_facts import field_facts
        from ddgcli.cli.subdivided_input import input_function

        field = input_function(read, curves.field, "field")
        facts = field_facts(mesh, field[0], run.options)
        run.predict_with(lambda size: size.with_geodesic(**facts))
    if subdivide:
        from ddgcli.cli.subdivided_input import on_subdivided_faces

        distance, curves = on_subdivided_faces(read, distance), on_subdivided_faces(read, curves)
    source_edges = input_edge_set(read, distance.source_edges, "source_edges")
    signed_curves = input_edge_set(read, waves.signed_distance, "signed_distance")
    with run.clock.timed("compute"):
        from ddgcli.algorithms.tangent_fields.geodesic_query import solve_geodesic_task
        from ddgcli.algorithms.tangent_fields.geodesic_task import GeodesicTask
        from ddgcli.mesh.fields import AnnotatedMesh

        task = GeodesicTask.of(
            mesh, distance, curves, waves,
            source_edges=source_edges, signed_curves=signed_curves, field=field, seed=common.seed,
        )  # fmt: skip
        names = (*task.vertex_arrays, *task.face_arrays)
        run.begin(names, names)
        result = solve_geodesic_task(task, run.progress)
    converged = result.converged
    run.write(AnnotatedMesh(mesh, vertex=result.vertex, face=result.face), converged=converged)
    if result.curves is not None:
        write_curves(run, mesh, result.curves, curves.paths_output, converged=converged)
    write_matrix(run, waves.distance_matrix, result.matrix)
    draw_distance(run, mesh, distance, result)
    run.finish(result.results, result.accuracy, converged=converged)


def _changed(query: DistanceQuery | CurveQuery | WaveQuery) -> dict[str, Any]:
    """Options that differ from their defaults, for the summary."""
    return {name: value for name, value in asdict(query).items() if value != getattr(type(query), name)}


def _distance_options(query: DistanceQuery) -> dict[str, Any]:
    """Source vertices, method and other changed options, for the summary."""
    changed = _changed(query)
    return {"source": query.vertices, "method": query.method} | {
        name: value for name, value in changed.items() if name not in ("source", "method")
    }
