"""Options of `ddgcli geodesic` that ask for curves, and the way from them to results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import click

from ddgcli.cli.options import POSITIVE, REAL, FacePoint, Ids, Numbers, gathered
from ddgcli.errors import ParameterError

if TYPE_CHECKING:
    from ddgcli.algorithms.geodesics.exact.exact_distance import ExactDistance
    from ddgcli.algorithms.geodesics.oriented_cover import OrientedCover
    from ddgcli.algorithms.geodesics.sources import Sources
    from ddgcli.algorithms.geodesics.surface_curves import Curves
    from ddgcli.algorithms.tangent_fields.vertex_vectors import VertexVectors
    from ddgcli.cli.commands.geodesic_distance import DistanceMade
    from ddgcli.cli.run import Run
    from ddgcli.io.mesh_file import MeshInput
    from ddgcli.mesh.triangle_mesh import TriangleMesh

CURVE_FORMATS = (".vtp", ".vtu", ".ply", ".obj", ".npz", ".vtkhdf", ".vtk", ".xdmf")


@dataclass(frozen=True)
class CurveOptions:
    """Curves asked for."""

    path_to: tuple[int, ...] = ()
    trace: tuple[Any, ...] = ()
    at_boundary: str = "stop"
    straighten: tuple[Any, ...] = ()
    loop: tuple[Any, ...] = ()
    curve: tuple[Any, ...] = ()
    field: str | None = None
    field_seeds: int | None = None
    field_time: float | None = None
    field_order: str = "4"
    field_step: float | None = None
    field_tolerance: float | None = None
    transport: bool = False
    paths_output: tuple[str, ...] = ()
    log_map: bool = False
    spread_vector: tuple[Any, ...] = ()

    @property
    def any(self) -> bool:
        """Is any curve asked for?"""
        return bool(self.path_to or self.trace or self.straighten or self.loop or self.curve or self.field)

    @property
    def any_vectors(self) -> bool:
        """Is a field of vectors at the vertices asked for?"""
        return bool(self.log_map or self.spread_vector)

    def said(self) -> dict[str, Any]:
        """The options that were given, for the summary."""
        return {name: value for name, value in asdict(self).items() if value != getattr(CurveOptions, name)}


class TraceStart(click.ParamType):
    """FACE:b0,b1,b2:dx,dy,dz:LENGTH."""

    name = "trace"

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        parts = str(value).split(":")
        if len(parts) != 4:
            self.fail(
                f"{value!r} is not FACE:b0,b1,b2:dx,dy,dz:LENGTH, e.g. 0:0.3,0.3,0.4:1,0,0:2.5", param, ctx
            )
        face, barycentric = FacePoint().convert(f"{parts[0]}:{parts[1]}", param, ctx)
        direction = Numbers(3, "1,0,0.5").convert(parts[2], param, ctx)
        return face, barycentric, direction, REAL.convert(parts[3], param, ctx)


_OPTIONS = (
    click.option("--path-to", multiple=True, type=int, metavar="ID",
                 help="Shortest path from the nearest source to this vertex; repeatable."),
    click.option("--trace", multiple=True, type=TraceStart(), metavar="FACE:b0,b1,b2:dx,dy,dz:LENGTH",
                 help="Straightest geodesic from a point of a face; repeatable."),
    click.option("--at-boundary", type=click.Choice(["stop", "reflect"]), default="stop", show_default=True,
                 help="What traces do at the boundary."),
    click.option("--straighten", multiple=True, type=Ids(), metavar="ID,ID,...",
                 help="Geodesic in the isotopy class of the edge path through these vertices; repeatable."),
    click.option("--loop", multiple=True, type=Ids(), metavar="ID,ID,...",
                 help="Closed geodesic in the class of the edge loop through these vertices; repeatable."),
    click.option("--curve", multiple=True, type=Ids(), metavar="ID,ID,...",
                 help="The edge path through these vertices as it is (closed if the last is the first), and "
                      "the geodesic curvature of all curves; repeatable."),
    click.option("--field", metavar="NAME",
                 help="Integral curves of a vector array of the input (on vertices or faces), or of a file; "
                      "from the sources, or from random points."),
    click.option("--field-seeds", type=click.IntRange(min=1), metavar="N",
                 help="How many random starts without sources; default 16."),
    click.option("--field-time", type=POSITIVE, metavar="T",
                 help="Time to integrate; by default that of crossing the bounding box."),
    click.option("--field-order", type=click.Choice(["1", "2", "4"]), default="4", show_default=True,
                 help="Order of the geodesic Runge-Kutta method."),
    click.option("--field-step", type=POSITIVE, metavar="H",
                 help="Fixed time step; by default steps adapt."),
    click.option("--field-tolerance", type=POSITIVE, metavar="LENGTH",
                 help="Error allowed in an adapted step; by default a hundredth of the mean side."),
    click.option("--transport", is_flag=True,
                 help="Carry a tangent frame along the curves: transport_x, transport_y in --paths-output."),
    click.option("--paths-output", multiple=True, metavar="PATH",
                 help="Write all curves as polylines (.vtp, .vtu, .ply, .obj, .npz); repeatable."),
    click.option("--log-map", is_flag=True,
                 help="Array log_map: each vertex in the tangent plane of the one source; exact, or several "
                      "times faster with --method fast-marching."),
    click.option("--spread-vector", multiple=True, type=Numbers(3, "1,0,0.5"), metavar="dx,dy,dz",
                 help="Array transported_vector: tangent vectors at the --source vertices, one each, spread "
                      "by parallel transport (vector heat)."),
)  # fmt: skip

curve_options = gathered("curves", CurveOptions, _OPTIONS)


def compute_curves(
    run: Run,
    read: MeshInput,
    asked: CurveOptions,
    sources: Sources | None,
    exact: ExactDistance | None,
    more: Sequence[Curves] = (),
) -> Curves:
    """All curves that the options ask for on the mesh read, in the order of the options in --help."""
    with run.timed("compute"):
        from ddgcli.algorithms.geodesics import surface_curves as curves
        from ddgcli.algorithms.geodesics.oriented_cover import oriented_cover

        cover = oriented_cover(read.surface)
        mesh, parts = cover.mesh, []
        if asked.path_to and sources is not None and exact is not None:
            from ddgcli.algorithms.geodesics.shortest_paths import shortest_paths

            if len(sources.points):
                cover.require_two_sides("--path-to from points inside faces")
            run.progress("shortest paths")
            parts.append(
                shortest_paths(
                    mesh,
                    cover.lift_exact(exact),
                    cover.lift_sources(sources),
                    list(asked.path_to),
                    continued=cover.continued,
                )  # fmt: skip
            )
        if asked.trace:
            parts.append(_traced(run, cover, asked))
        if asked.straighten or asked.loop:
            from ddgcli.algorithms.geodesics.flipout import straighten_curves

            cover.require_two_sides("--straighten or --loop")
            run.progress("straightening")
            closed = [False] * len(asked.straighten) + [True] * len(asked.loop)
            parts.append(straighten_curves(mesh, [*asked.straighten, *asked.loop], closed))
        if asked.curve:
            from ddgcli.algorithms.geodesics.edge_curves import edge_curves

            cover.require_two_sides("--curve")
            parts.append(edge_curves(mesh, list(asked.curve)))
        if asked.field:
            parts.append(_field_curves(run, read, cover, asked, sources))
        lifted = [] if cover.is_one_sided else [cover.lift_curves(lines) for lines in more]
        made = curves.gathered([*parts, *lifted])
        made = curves.add_geodesic_curvature(mesh, made) if asked.curve else made
        if asked.transport:
            from ddgcli.algorithms.tangent_fields.field_curves import add_transport

            made = add_transport(mesh, made)
        made = cover.projected(made)
        return curves.gathered([made, *more]) if cover.is_one_sided else made


def _traced(run: Run, cover: OrientedCover, asked: CurveOptions) -> Curves:
    """The traces, from points of the input's faces."""
    import numpy as np

    from ddgcli.algorithms.geodesics.surface_curves import trace_curves
    from ddgcli.geometry.surface_points import SurfacePoints

    face, barycentric, direction, length = (np.array(x) for x in zip(*asked.trace, strict=True))
    start = cover.lift_points(SurfacePoints.checked(face, barycentric, cover.base.n_faces))
    return trace_curves(
        cover.mesh, start.face, start.barycentric, direction, length,
        at_boundary=asked.at_boundary, progress=run.progress("traces"),
    )  # fmt: skip


def _field_curves(
    run: Run, read: MeshInput, cover: OrientedCover, asked: CurveOptions, sources: Sources | None
) -> Curves:
    """Integral curves of the named field."""
    from ddgcli.algorithms.tangent_fields.field_curves import field_curves
    from ddgcli.algorithms.tangent_fields.integral_curves import random_starts, starts_at
    from ddgcli.io.arrays import given_array

    values, place = cover.lift_values(*given_array(read, asked.field or ""))
    if sources is None:
        starts = random_starts(cover.mesh, asked.field_seeds or 16, run.common.seed)
    else:
        starts = starts_at(cover.mesh, cover.lift_sources(sources))
    return field_curves(
        cover.mesh, values, starts, asked.field_time, order=int(asked.field_order),
        step=asked.field_step, tolerance=asked.field_tolerance,
        progress=run.progress("integral curves"), place=place,
    )  # fmt: skip


def compute_vectors(
    run: Run, mesh: TriangleMesh, asked: CurveOptions, sources: Sources, measured: DistanceMade
) -> VertexVectors:
    """The vectors at vertices that the options ask for."""
    with run.timed("compute"):
        from ddgcli.algorithms.geodesics.oriented_cover import oriented_cover
        from ddgcli.algorithms.tangent_fields import vertex_vectors

        cover, parts = oriented_cover(mesh), []
        cover.require_two_sides("--log-map or --spread-vector")
        sources = cover.lift_sources(sources)
        arrived = measured.marched if measured.exact is None else cover.lift_exact(measured.exact)
        if asked.log_map and arrived is not None:
            told = run.progress("log map")
            parts.append(vertex_vectors.log_map_vectors(cover.mesh, arrived, sources, told))
        if asked.spread_vector:
            parts.append(vertex_vectors.transport_vectors(cover.mesh, sources, asked.spread_vector))
        return vertex_vectors.gathered(parts)


def write_curves(
    run: Run, mesh: TriangleMesh, made: Curves, paths_output: tuple[str, ...], *, converged: bool
) -> None:
    """Write the polylines of all curves to every --paths-output."""
    if not paths_output:
        return
    from ddgcli.algorithms.geodesics.paths import curve_set
    from ddgcli.mesh.fields import AnnotatedMesh

    with run.timed("write"):
        annotated = AnnotatedMesh(curve_set(mesh, made.paths, **made.arrays))
    for path in paths_output:
        run.write_file(path, annotated, converged=converged)


def check_asked(asked: CurveOptions, has_source: bool, method: str, *, extra: bool = False) -> None:
    """Refuse options that cannot be served together."""
    for name, given, methods in (
        ("--path-to follows the exact distance", bool(asked.path_to), ("exact",)),
        ("--log-map follows the exact distance or fast marching", asked.log_map, ("exact", "fast-marching")),
    ):
        if given and not has_source:
            raise ParameterError(f"{name.split()[0]} needs a source, e.g. --source 0")
        if given and method not in methods:
            raise ParameterError(f"{name}, not --method {method}; give --method {' or '.join(methods)}")
    for name in ("field_seeds", "field_time", "field_step", "field_tolerance"):
        if getattr(asked, name) is not None and not asked.field:
            raise ParameterError(f"--{name.replace('_', '-')} belongs to --field NAME; give that too")
    if asked.field_order != CurveOptions.field_order and not asked.field:
        raise ParameterError("--field-order belongs to --field NAME; give that too")
    if asked.at_boundary != CurveOptions.at_boundary and not asked.trace:
        raise ParameterError("--at-boundary says what --trace does; give that too")
    if asked.field_step is not None and asked.field_tolerance is not None:
        raise ParameterError("--field-step fixes the step and --field-tolerance adapts it; give one of them")
    if asked.field_seeds is not None and has_source:
        raise ParameterError("--field-seeds are random starts, but sources are given; drop one of them")
    if asked.spread_vector and not has_source:
        raise ParameterError("--spread-vector needs source vertices, e.g. --source 0")
    for name, wanted in (("--paths-output", bool(asked.paths_output)), ("--transport", asked.transport)):
        if wanted and not (asked.any or extra):
            raise ParameterError(f"{name} has no curves; ask for some, e.g. with --path-to or --trace")
