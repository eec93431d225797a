"""Curve options of `ddgcli geodesic`, and the output of curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from ddgcli.algorithms.geodesics.query import CurveQuery
from ddgcli.choices import TRACE_BOUNDARIES
from ddgcli.cli.options import (
    POSITIVE_NUMBER,
    REAL_NUMBER,
    FacePoint,
    Ids,
    Numbers,
    grouped_options,
    joined_ids,
)
from ddgcli.errors import ParameterError

if TYPE_CHECKING:
    from ddgcli.algorithms.geodesics.surface_curves import Curves
    from ddgcli.cli.run import Run
    from ddgcli.mesh.triangle_mesh import TriangleMesh

CURVE_FORMATS = (".vtp", ".vtu", ".ply", ".obj", ".npz", ".vtkhdf", ".vtk", ".xdmf")


@dataclass(frozen=True)
class GeodesicCurveOptions(CurveQuery):
    """Curve query, and the files to write its curves to."""

    paths_output: tuple[str, ...] = ()

    def check_output(self, has_curves: bool) -> None:
        """Raise ParameterError for an output of curves without curves."""
        if self.paths_output and not has_curves:
            raise ParameterError(
                "has no curves; add some, such as `path_to` or `trace`", parameter="paths_output"
            )


class TraceStart(click.ParamType):
    """FACE:b0,b1,b2:dx,dy,dz:LENGTH."""

    name = "trace"

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        words = str(value).split(":")
        if len(words) != 4:
            self.fail(
                f"{value!r} is not FACE:b0,b1,b2:dx,dy,dz:LENGTH, e.g. 0:0.3,0.3,0.4:1,0,0:2.5", param, ctx
            )
        face, barycentric = FacePoint().convert(f"{words[0]}:{words[1]}", param, ctx)
        direction = Numbers(3, "1,0,0.5").convert(words[2], param, ctx)
        return face, barycentric, direction, REAL_NUMBER.convert(words[3], param, ctx)


_OPTIONS = (
    click.option("--path-to", multiple=True, type=Ids(), callback=joined_ids, metavar="ID...",
                 help="Shortest path from the nearest source to each of these vertices."),
    click.option("--trace", multiple=True, type=TraceStart(), metavar="FACE:b0,b1,b2:dx,dy,dz:LENGTH",
                 help="Straightest geodesic from a point of a face; repeatable."),
    click.option("--at-boundary", type=click.Choice(TRACE_BOUNDARIES), default="stop", show_default=True,
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
    click.option("--field-time", type=POSITIVE_NUMBER, metavar="T",
                 help="Time to integrate; by default that of crossing the bounding box."),
    click.option("--field-order", type=click.Choice(["1", "2", "4"]), default="4", show_default=True,
                 help="Order of the geodesic Runge-Kutta method."),
    click.option("--field-step", type=POSITIVE_NUMBER, metavar="H",
                 help="Fixed time step; by default steps adapt."),
    click.option("--field-tolerance", type=POSITIVE_NUMBER, metavar="LENGTH",
                 help="Error allowed in an adapted step; by default a hundredth of the mean side of its "
                      "component."),
    click.option("--transport", is_flag=True,
                 help="Carry a tangent frame along the curves: transport_x, transport_y in --paths-output."),
    click.option("--darboux", is_flag=True,
                 help="Darboux frames, normal curvature and geodesic torsion of the curves, in "
                      "--paths-output."),
    click.option("--paths-output", multiple=True, metavar="PATH",
                 help="Write all curves as polylines (.vtp, .vtu, .ply, .obj, .npz); repeatable."),
    click.option("--log-map", is_flag=True,
                 help="Array log_map: each vertex in the tangent plane of the one source; exact, or several "
                      "times faster with --method fast-marching, or coarsely with --method heat."),
    click.option("--spread-vector", multiple=True, type=Numbers(3, "1,0,0.5"), metavar="dx,dy,dz",
                 help="Array transported_vector: tangent vectors at the --source vertices, one each, spread "
                      "by parallel transport (vector heat)."),
)  # fmt: skip

curve_options = grouped_options("curves", GeodesicCurveOptions, _OPTIONS)


def write_curves(
    run: Run, mesh: TriangleMesh, curves: Curves, paths_output: tuple[str, ...], *, converged: bool
) -> None:
    """Write the polylines of all curves to every output path."""
    if not paths_output:
        return
    from ddgcli.algorithms.geodesics.path_results import curve_set
    from ddgcli.mesh.fields import AnnotatedMesh

    with run.clock.timed("write"):
        annotated = AnnotatedMesh(curve_set(mesh, curves.paths, **curves.arrays))
    for path in paths_output:
        run.write_file(path, annotated, converged=converged)
