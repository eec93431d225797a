"""`ddgcli curvature`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ddgcli.choices import CURVATURE_SCHEMES
from ddgcli.cli import options
from ddgcli.cli.commands.curvature_measures import (
    MEASURE_NAMES,
    OFFSET_FORMATS,
    MeasureOptions,
    draw_offset,
    measure_options,
    surface_arguments,
    write_offset,
)
from ddgcli.cli.options import CommonOptions
from ddgcli.cli.run import Run
from ddgcli.errors import ParameterError, named_array, renamed_parameters

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from ddgcli.io.mesh_file import MeshInput
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.triangle_mesh import TriangleMesh


class Radius(click.ParamType):
    """A length or `auto`."""

    name = "radius"

    def convert(self, value: Any, param: Any, ctx: Any) -> float | str:
        return "auto" if value == "auto" else options.POSITIVE_NUMBER.convert(value, param, ctx)


DRAWN_FRAMES = 120  # at most twice so many tangent frames in a picture of curves
FRAME_COLOURS = {"frenet_normal": "#c03030", "frenet_binormal": "#3060c0"}


@click.command(
    "curvature",
    epilog="Choosing a scheme: quadric (noisy data: with --radius of three to five edges); corrected where "
    "speed matters; cotan for integrals and for comparison with other programs. See docs/curvature.md and "
    "docs/accuracy/curvature.md.",
)
@options.mesh_arg
@click.option(
    "--scheme",
    type=click.Choice(CURVATURE_SCHEMES),
    default="quadric",
    show_default=True,
    help="Scheme for mean and principal curvatures.",
)
@click.option(
    "--radius",
    type=Radius(),
    metavar="R|auto",
    help="Measure in balls of this radius, in length units (default: the vertex star; quadric: two rings). "
    "auto: a radius chosen from the estimated noise of the vertices.",
)
@click.option(
    "--map",
    "map_name",
    metavar="ARRAY",
    help="Vertex array (n, 2) or (n, 3) of MESH, taken as a map: report its Dirichlet energy minus its area.",
)
@click.option(
    "--frames",
    "with_frames",
    is_flag=True,
    help="Curves: also Frenet and Bishop frames, osculating circles and arc length.",
)
@click.option(
    "--resample",
    type=click.IntRange(min=3),
    metavar="N",
    help="Curves: first resample each curve at N points, evenly spaced by arc length; -o writes these.",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="quadric, and balls of --radius: processes that handle blocks of vertices; the result is the same.  "
    "[default: 1]",
)
@measure_options
@options.common
def command(
    mesh_path: str,
    scheme: str,
    radius: Any,
    map_name: str | None,
    with_frames: bool,
    resample: int | None,
    jobs: int | None,
    measures: MeasureOptions,
    common: CommonOptions,
) -> None:
    """Measure the curvature of MESH: a triangle surface, the boundary of tetrahedra, or polylines.

    Curvature is positive where the surface is convex with its faces outward; mean curvature is half the sum
    of the principal ones. angle_defect is integrated, every other curvature pointwise, in 1/length (Gaussian:
    1/length^2).

    \b
    Examples:
      ddgcli curvature torus.ply -o torus.vtu --plot torus.png
      ddgcli curvature scan.stl --radius 0.5 --json
    """
    measures.check()
    extra: dict[str, Any] = {"frames": with_frames, "resample": resample} if with_frames or resample else {}
    extra |= measures.changed()
    if jobs is not None and scheme != "quadric" and (radius is None or scheme == "cotan"):
        raise ParameterError(
            "is for `scheme=quadric` and for balls of a `radius`; leave it out", parameter="jobs"
        )
    run = Run("curvature", common, scheme=scheme, radius=radius, map=map_name, **extra)
    run.plan_output(measures.offset_output, OFFSET_FORMATS)
    for name in measures.region:
        run.add_input(name if isinstance(name, str) else None)
    source = run.read(mesh_path, accept=("surface", "tetrahedra", "curve"))
    from ddgcli.mesh.curve import CurveSet

    if isinstance(source.mesh, CurveSet):
        options.refuse_options(
            "for surfaces, and this is a curve",
            *("scheme", "radius", "map_name", "jobs", *MEASURE_NAMES),
        )
        _curves(run, source.mesh, with_frames, resample)
    else:
        options.refuse_options("for curves, and this is a surface", "with_frames", "resample")
        _surface(run, source, scheme, radius, map_name, jobs or 1, measures)


def _surface(
    run: Run,
    source: MeshInput,
    scheme: str,
    radius: Any,
    map_name: str | None,
    jobs: int,
    measures: MeasureOptions,
) -> None:
    from ddgcli.algorithms.curvature.surface_query import array_names, check_query, measure_surface
    from ddgcli.mesh.fields import AnnotatedMesh

    mesh = source.surface
    image = (
        None
        if map_name is None
        else named_array(source.vertex, map_name, "vertex array", parameter="map_name")
    )
    arguments = surface_arguments(source, measures)
    full = run.common.exceeds_short_summary
    with renamed_parameters(image="map_name", regions="region"):
        check_query(mesh, scheme, radius, image=image, **arguments)
    names = array_names(full=full or measures.offset is not None, vertex_vectors=measures.vertex_vectors)
    run.begin(names, names)
    energies = run.common.shows_all_results
    measured = measure_surface(
        mesh, scheme, radius, image=image, vertex_vectors=measures.vertex_vectors, jobs=jobs, full=full,
        energies=energies, **arguments,
    )  # fmt: skip
    name, values = run.picture_array(measured.vertex, "mean_curvature")
    annotated = AnnotatedMesh(mesh, vertex=measured.vertex, edge=measured.edge)
    run.write(annotated, converged=measured.converged)
    write_offset(run, measures.offset_output, measured.offset)
    view = run.picture_options
    body = measured.offset if run.common.show is None else None
    run.plot(
        lambda path: (
            draw_offset(path, body, view)
            if body is not None
            else _draw_surface(path, mesh, name, values, measured.vertex, scheme, view)
        )
    )
    run.finish(measured.results, measured.accuracy, converged=measured.converged)


def _size_of(name: str, vertex: Mapping[str, NDArray]) -> float:
    """Reference size for the colours of a curvature, so that a minimal surface is paler than a wave."""
    import numpy as np

    order = {"mean_curvature": 1, "principal_curvature_min": 1, "principal_curvature_max": 1}
    order["gaussian_curvature"] = 2
    ends = [np.abs(vertex[f"principal_curvature_{end}"]) for end in ("min", "max")]
    return float(np.median(np.maximum(*ends))) ** order[name] if name in order else 0.0


def _draw_surface(
    path: str,
    mesh: TriangleMesh,
    name: str,
    values: NDArray,
    vertex: Mapping[str, NDArray],
    scheme: str,
    look: dict[str, Any],
) -> None:
    """Draw an array in colours; principal directions as stripes over their curvature."""
    from ddgcli.plots.array import draw_array, glyphs_of
    from ddgcli.plots.surface import draw_surface

    picture: dict[str, Any] = {"caption": f"scheme {scheme}", **look}
    if name.startswith("principal_direction"):
        glyphs, name = glyphs_of(mesh, name, values), name.replace("direction", "curvature")
        size = _size_of(name, vertex)
        draw_surface(
            path, mesh, vertex[name], label=name, signed=True, glyphs=glyphs, value_size=size, **picture
        )
        return
    draw_array(path, mesh, name, values, value_size=_size_of(name, vertex), **picture)


def _curves(run: Run, curves: CurveSet, with_frames: bool, resample: int | None) -> None:
    from ddgcli.algorithms.curvature.polyline import array_names, check_query, measure_curves
    from ddgcli.mesh.fields import AnnotatedMesh

    check_query(curves, with_frames=with_frames, resample=resample)
    scalar_names, vector_names = array_names(curves, with_frames=with_frames, resample=resample)
    run.begin(scalar_names, (*scalar_names, *vector_names))
    measured = measure_curves(curves, with_frames=with_frames, resample=resample)
    curves = measured.curves
    scalars = {name: values for name, values in measured.vertex.items() if values.ndim == 1}
    name, values = run.picture_array(scalars, "curvature")
    run.write(AnnotatedMesh(curves, vertex=measured.vertex))
    axes = {key: measured.vertex[key] for key in FRAME_COLOURS} if with_frames else {}
    run.plot(lambda path: _draw_curves(path, curves, name, values, axes, run.picture_options))
    run.finish(measured.results, measured.accuracy)


def _draw_curves(
    path: str,
    curves: CurveSet,
    name: str,
    values: NDArray,
    axes: dict[str, NDArray],
    look: dict[str, Any],
) -> None:
    """Draw curves coloured by an array, with the vectors of their frames at some points."""
    from ddgcli.plots.curve import draw_curves

    paths = curves.paths
    some = slice(None, None, max(1, curves.n_vertices // DRAWN_FRAMES))
    draw_curves(
        path,
        [curves.points[points] for points, _ in paths],
        [values[points] for points, _ in paths],
        closed=[closed for _, closed in paths],
        label=name,
        vectors=[(curves.points[some], vectors[some], FRAME_COLOURS[key]) for key, vectors in axes.items()],
        **look,
    )
