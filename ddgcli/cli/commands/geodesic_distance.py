"""Distance options of `ddgcli geodesic`, and its picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ddgcli.algorithms.geodesics.query import DistanceQuery
from ddgcli.choices import DEFAULT_HEAT_TIME, DISTANCE_METHODS, HEAT_OPERATORS
from ddgcli.cli.options import NONNEGATIVE_NUMBER, POSITIVE_NUMBER, FacePoint, Ids, Numbers, grouped_options

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.algorithms.geodesics.paths import SurfacePaths
    from ddgcli.algorithms.geodesics.surface_curves import Curves
    from ddgcli.algorithms.tangent_fields.geodesic_query import GeodesicResult
    from ddgcli.cli.run import Run
    from ddgcli.mesh.triangle_mesh import TriangleMesh


THIN_CURVES = ("isoline", "fan ray", "geodesic circle")  # kinds that a picture draws as thin lines
DARBOUX_COLOURS = {"darboux_tangent": "red", "darboux_conormal": "green", "darboux_normal": "blue"}
PICTURE_ARRAYS = ("geodesic_distance", "signed_distance", "vertex_type")  # the first one is drawn

_OPTIONS = (
    click.option("--source", multiple=True, type=Ids(), metavar="ID...",
                 help="Source vertices: 0 5 9, or 0,5,9, or repeat the option."),
    click.option("--source-point", multiple=True, type=Numbers(3, "0.5,1,0"), metavar="X,Y,Z...",
                 help="Source at the point of the surface nearest to this one."),
    click.option("--source-face", multiple=True, type=FacePoint(), metavar="F:b0,b1,b2...",
                 help="Source inside a face, by barycentric coordinates."),
    click.option("--source-edges", metavar="FILE_OR_ARRAY",
                 help="exact: sources are all points of these edges: an array of the input, or a file "
                      "of vertex "
                      "pairs, of marks, or of polylines along edges."),
    click.option("--source-boundary", is_flag=True, help="Sources are all points of the boundary."),
    click.option("--target-point", multiple=True, type=Numbers(3, "0.5,1,0"), metavar="X,Y,Z...",
                 help="exact: also the distance at the point of the surface nearest to this one."),
    click.option("--target-face", multiple=True, type=FacePoint(), metavar="F:b0,b1,b2...",
                 help="exact: also the distance at a point inside a face, in results.targets."),
    click.option("--method", type=click.Choice(DISTANCE_METHODS), default="exact", show_default=True,
                 help="exact: the polyhedral distance. heat: two linear solves, factored once; faster for "
                      "many sources. fast-marching: first order. dijkstra: along edges."),
    click.option("--tolerance", type=NONNEGATIVE_NUMBER, metavar="TAU",
                 help="exact: let a path be longer by TAU edge lengths at each bend, where that saves time; "
                      "accuracy.tolerance_error_estimate is of the whole error. Distances are never too "
                      "short."),
    click.option("--operator", type=click.Choice(HEAT_OPERATORS),
                 help="heat: the Laplacian. [default: intrinsic-delaunay, tufted where non-manifold]"),
    click.option("--heat-time", type=POSITIVE_NUMBER, metavar="M",
                 help="heat: time step in squares of the mean edge length of each component. "
                 f"[default: {DEFAULT_HEAT_TIME:g}]"),
    click.option("--heat-refine", type=click.IntRange(0, 100), metavar="K",
                 help="heat: normalise and integrate the gradient K more times. [default: 0]"),
    click.option("--each-source", is_flag=True,
                 help="Also one array per source: geodesic_distance_000, ..."),
    click.option("--gradient", is_flag=True, help="Also the face array distance_gradient."),
    click.option("--isolines", type=click.IntRange(1, 10_000), metavar="N",
                 help="Level lines of the distance at N evenly spaced levels, in --paths-output; of the "
                      "--signed-distance if there is no source."),
    click.option("--compare", multiple=True, type=click.Choice(DISTANCE_METHODS), metavar="METHOD...",
                 help="Error against other methods, and their seconds."),
    click.option("--certify", is_flag=True,
                 help="Also check symmetry and the triangle inequality on sampled pairs (4 more runs)."),
)  # fmt: skip

distance_options = grouped_options("distance", DistanceQuery, _OPTIONS)


def draw_distance(
    run: Run,
    mesh: TriangleMesh,
    query: DistanceQuery,
    result: GeodesicResult,
) -> None:
    """Draw distance bands and curves on the shaded surface, if the run has a picture to draw.

    The thin level lines are those of the query; twelve by default.
    """
    if run.common.plot is None:
        return
    import numpy as np

    from ddgcli.algorithms.geodesics.isolines import even_levels, isolines
    from ddgcli.plots.array import draw_array
    from ddgcli.plots.viewpoint import curve_interest

    vertex, sources = result.vertex, result.sources
    curves = [] if result.curves is None else _polylines(mesh, result.curves.paths)
    kinds = [] if result.curves is None else [entry["kind"] for entry in result.curves.entries]
    heavy = [curve for curve, kind in zip(curves, kinds, strict=True) if kind not in THIN_CURVES]
    thin = [curve for curve, kind in zip(curves, kinds, strict=True) if kind in THIN_CURVES]
    distance = vertex.get("geodesic_distance")
    points = None if distance is None or sources is None else sources.positions(mesh)
    largest = 0.0 if distance is None else float(distance[np.isfinite(distance)].max(initial=0.0))
    if distance is not None and not thin:
        thin = _polylines(mesh, isolines(mesh, distance, even_levels(distance, 12))[0])
    arrays = {**vertex, **result.face}
    default = next((name for name in PICTURE_ARRAYS if name in arrays), PICTURE_ARRAYS[0])
    if "region" in result.face:  # of --voronoi; the level lines show the distance
        default = "region"
    name, values = run.picture_array(arrays, default)
    picture: dict[str, Any] = {"points": points, "curves": heavy, "level_lines": thin, **run.picture_options}
    if result.curves is not None and "darboux_normal" in result.curves.arrays:
        picture |= darboux_arrows(mesh, result.curves)
    if heavy:
        picture["interest"] = curve_interest(mesh, heavy)
    elif distance is not None:
        picture["interest"] = np.where(np.isfinite(distance), (1 - distance / (largest or 1.0)) ** 2, 0.0)
    if run.common.show is None and distance is not None and default != "region":
        picture |= {"label": "geodesic distance", "limits": (0.0, largest or 1.0)}
    run.plot(lambda path: draw_array(path, mesh, name, values, **picture))


def darboux_arrows(mesh: TriangleMesh, curves: Curves) -> dict[str, Any]:
    """Options of a picture with the Darboux frames of curves."""
    import numpy as np

    from ddgcli.geometry.face_frames import surface_position
    from ddgcli.plots.glyphs import frame_arrows

    points = surface_position(mesh, curves.paths.face, curves.paths.barycentric)
    vectors = {colour: curves.arrays[name] for name, colour in DARBOUX_COLOURS.items()}
    extent = float(np.ptp(mesh.points[mesh.topology.referenced_vertex], axis=0).max())
    words = ", ".join(f"{name.removeprefix('darboux_')} {colour}" for name, colour in DARBOUX_COLOURS.items())
    return {
        "arrows": frame_arrows(points, curves.paths.start, extent, vectors),
        "caption": f"frames: {words}",
    }


def _polylines(mesh: TriangleMesh, paths: SurfacePaths) -> list[NDArray]:
    """(p, 3) points of each path."""
    import numpy as np

    from ddgcli.algorithms.geodesics.path_results import curve_set

    if not len(paths):
        return []
    polylines = curve_set(mesh, paths)
    path_id = polylines.point_arrays["path_id"]
    return np.split(polylines.points, np.searchsorted(path_id, np.arange(1, len(paths))))
