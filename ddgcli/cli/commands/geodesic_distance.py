"""Options of `ddgcli geodesic` that say from where and how distance is measured, and the way to results."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import click

from ddgcli.cli.options import NONNEGATIVE, POSITIVE, FacePoint, Ids, Numbers, gathered
from ddgcli.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ddgcli.algorithms.geodesics.exact.exact_distance import ExactDistance
    from ddgcli.algorithms.geodesics.fast_marching import FastMarchingDistance
    from ddgcli.algorithms.geodesics.paths import SurfacePaths
    from ddgcli.algorithms.geodesics.sources import Sources
    from ddgcli.algorithms.geodesics.surface_curves import Curves
    from ddgcli.cli.run import Run
    from ddgcli.geometry.surface_points import SurfacePoints
    from ddgcli.mesh.triangle_mesh import TriangleMesh

METHODS = ("exact", "heat", "fast-marching", "dijkstra")


@dataclass(frozen=True)
class DistanceChoice:
    """Sources, method and what is to be told beyond the distance."""

    source: tuple[Any, ...] = ()
    source_point: tuple[Any, ...] = ()
    source_face: tuple[Any, ...] = ()
    target_point: tuple[Any, ...] = ()
    target_face: tuple[Any, ...] = ()
    method: str = "exact"
    tolerance: float | None = None
    operator: str | None = None
    heat_time: float | None = None
    heat_refine: int | None = None
    each_source: bool = False
    gradient: bool = False
    isolines: int | None = None
    compare: tuple[str, ...] = ()
    certify: bool = False

    @property
    def any(self) -> bool:
        """Is any source given?"""
        return bool(self.source or self.source_point or self.source_face)

    def said(self) -> dict[str, Any]:
        """The options that were given, and the method, for the summary."""
        given = {k: v for k, v in asdict(self).items() if v != getattr(DistanceChoice, k)}
        return {"source": self.vertices, "method": self.method} | {
            k: v for k, v in given.items() if k not in ("source", "method")
        }

    @property
    def vertices(self) -> list[int]:
        """Source vertices in the order given."""
        return [vertex for group in self.source for vertex in group]


_OPTIONS = (
    click.option("--source", multiple=True, type=Ids(), metavar="ID...",
                 help="Source vertex; several after one another, with commas, or by repeating the option."),
    click.option("--source-point", multiple=True, type=Numbers(3, "0.5,1,0"), metavar="X,Y,Z...",
                 help="Source at the point of the surface nearest to this one."),
    click.option("--source-face", multiple=True, type=FacePoint(), metavar="F:b0,b1,b2...",
                 help="Source inside a face, by barycentric coordinates."),
    click.option("--target-point", multiple=True, type=Numbers(3, "0.5,1,0"), metavar="X,Y,Z...",
                 help="exact: also the distance at the point of the surface nearest to this one."),
    click.option("--target-face", multiple=True, type=FacePoint(), metavar="F:b0,b1,b2...",
                 help="exact: also the distance at a point inside a face, into results.targets."),
    click.option("--method", type=click.Choice(METHODS), default="exact", show_default=True,
                 help="exact: the polyhedral distance. heat: two linear solves, factored once; pays off for "
                      "many sources. fast-marching: first order. dijkstra: along edges."),
    click.option("--tolerance", type=NONNEGATIVE, metavar="TAU",
                 help="exact: slack in edge lengths, used where it saves time; errs upwards only."),
    click.option("--operator", type=click.Choice(("intrinsic-delaunay", "plain", "tufted")),
                 help="heat: the Laplacian. [default: intrinsic-delaunay, tufted where non-manifold]"),
    click.option("--heat-time", type=POSITIVE, metavar="M",
                 help="heat: time step in squares of the mean edge length. [default: 1]"),
    click.option("--heat-refine", type=click.IntRange(0, 100), metavar="K",
                 help="heat: normalise and integrate the gradient K more times. [default: 0]"),
    click.option("--each-source", is_flag=True,
                 help="Also one array a source: geodesic_distance_000, ..."),
    click.option("--gradient", is_flag=True, help="Also the face array distance_gradient."),
    click.option("--isolines", type=click.IntRange(1, 10_000), metavar="N",
                 help="Level lines of the distance at N even levels, into --paths-output."),
    click.option("--compare", multiple=True, type=click.Choice(METHODS), metavar="METHOD...",
                 help="Error against other methods, and their seconds."),
    click.option("--certify", is_flag=True,
                 help="Also check symmetry and the triangle inequality on sampled pairs (4 more runs)."),
)  # fmt: skip

distance_options = gathered("distance", DistanceChoice, _OPTIONS)


def check_distance(asked: DistanceChoice) -> None:
    """Refuse options that the chosen method does not have, or that have nothing to work on."""
    if asked.tolerance is not None and asked.method != "exact":
        raise ParameterError(
            f"--tolerance belongs to --method exact, not to {asked.method}; drop one of them"
        )
    for name in ("target_point", "target_face"):
        if getattr(asked, name) and asked.method != "exact":
            option = "--" + name.replace("_", "-")
            raise ParameterError(
                f"{option} belongs to --method exact, not to {asked.method}; drop one of them"
            )
    for name in ("operator", "heat_time", "heat_refine"):
        if getattr(asked, name) is not None and asked.method != "heat" and "heat" not in asked.compare:
            option = "--" + name.replace("_", "-")
            raise ParameterError(
                f"{option} belongs to --method heat, not to {asked.method}; drop one of them"
            )
    needing = ("target_point", "target_face", "each_source", "gradient", "isolines", "compare", "certify")
    given = {name: bool(getattr(asked, name)) for name in needing}
    given |= {"tolerance": asked.tolerance is not None, "method": asked.method != DistanceChoice.method}
    for name, wanted in given.items():
        if wanted and not asked.any:
            raise ParameterError(f"--{name.replace('_', '-')} needs a source, e.g. --source 0")


@dataclass(frozen=True)
class DistanceMade:
    """What the distance options made."""

    vertex: dict[str, NDArray]
    face: dict[str, NDArray]
    results: dict[str, Any]
    accuracy: dict[str, Any]
    exact: ExactDistance | None
    marched: FastMarchingDistance | None
    curves: list[Curves]
    converged: bool


def read_sources(mesh: TriangleMesh, asked: DistanceChoice) -> Sources:
    """The sources in the order vertices, points in space, points of faces; checked."""
    from ddgcli.algorithms.geodesics.sources import Sources, check_sources

    points = read_points(mesh, asked.source_point, asked.source_face)
    return check_sources(mesh, Sources.at(asked.vertices, points))


def read_points(
    mesh: TriangleMesh, in_space: Sequence[list[float]], on_faces: Sequence[tuple[int, list[float]]]
) -> SurfacePoints:
    """Points of the surface: first those nearest to points in space, then those given on faces; checked."""
    import numpy as np

    from ddgcli.geometry.surface_points import SurfacePoints, nearest_points

    near, _ = nearest_points(mesh, np.array(in_space, dtype=float).reshape(-1, 3))
    face = np.array([f for f, _ in on_faces], dtype=np.int64)
    weights = np.array([w for _, w in on_faces], dtype=float).reshape(-1, 3)
    given = SurfacePoints.checked(face, weights, mesh.n_faces)
    return SurfacePoints(
        np.concatenate([near.face, given.face]), np.concatenate([near.barycentric, given.barycentric])
    )


def compute_distance(
    run: Run, mesh: TriangleMesh, asked: DistanceChoice, sources: Sources, *, directions: bool = False
) -> DistanceMade:
    """Distance arrays, results and accuracy that the options ask for; `directions` are for a log map."""
    from ddgcli.algorithms.geodesics import distance as geodesic

    chosen = geodesic.DistanceOptions(
        tolerance=asked.tolerance or 0.0,
        operator=asked.operator,
        heat_time=asked.heat_time or 1.0,
        heat_refine=asked.heat_refine or 0,
        directions=directions and mesh.topology.is_oriented,
    )
    solver = geodesic.prepare_solver(
        mesh,
        asked.method,
        chosen,
        targets=read_points(mesh, asked.target_point, asked.target_face),
        progress=run.progress("exact distance") if asked.method == "exact" else None,
    )
    measured = geodesic.measure_distance(mesh, sources, asked.method, solver=solver)
    run.progress("geodesic")
    vertex, face, curves = dict(measured.arrays), {}, []
    accuracy = dict(measured.accuracy)
    if asked.each_source:
        vertex |= geodesic.each_source(sources, solver, run.progress("each source"))
    if asked.gradient:
        face["distance_gradient"] = geodesic.distance_gradient(mesh, measured.distance)
    if asked.isolines:
        from ddgcli.algorithms.geodesics.isolines import isoline_curves
        from ddgcli.algorithms.geodesics.oriented_cover import oriented_cover

        cover = oriented_cover(mesh)
        on = mesh if cover.is_one_sided else cover.mesh
        lines = isoline_curves(on, measured.distance, asked.isolines)
        curves.append(lines if cover.is_one_sided else cover.projected(lines))
    if asked.compare:
        run.progress("comparison")
        accuracy["compare"] = geodesic.compare(mesh, sources, measured.distance, list(asked.compare), chosen)
    if asked.certify:
        from ddgcli.algorithms.geodesics.certificate import symmetry

        run.progress("symmetry")
        accuracy |= symmetry(mesh, lambda s: solver(s).distance, seed=run.common.seed)
    return DistanceMade(
        vertex, face, measured.results, accuracy, measured.exact, measured.marched, curves, measured.converged
    )


def draw_distance(
    run: Run,
    mesh: TriangleMesh,
    asked: DistanceChoice,
    vertex: dict[str, NDArray],
    face: dict[str, NDArray],
    sources: Sources | None,
    made: Curves | None,
) -> None:
    """Distance bands with the curves on the shaded surface, where --plot asks for a picture.

    The thin level lines are those of --isolines, twelve where none are asked for.
    """
    if run.common.plot is None:
        return
    import numpy as np

    from ddgcli.algorithms.geodesics.isolines import even_levels, isolines
    from ddgcli.plots.array import draw_array

    curves = [] if made is None else _polylines(mesh, made.paths)
    kinds = [] if made is None else [entry["kind"] for entry in made.entries]
    heavy = [curve for curve, kind in zip(curves, kinds, strict=True) if kind != "isoline"]
    thin = [curve for curve, kind in zip(curves, kinds, strict=True) if kind == "isoline"]
    distance = vertex.get("geodesic_distance")
    points = None if distance is None or sources is None else sources.positions(mesh)
    far = 0.0 if distance is None else float(distance[np.isfinite(distance)].max(initial=0.0))
    if distance is not None and asked.isolines is None:
        thin = _polylines(mesh, isolines(mesh, distance, even_levels(distance, 12))[0])
    name, values = run.shown({**vertex, **face}, "geodesic_distance")
    given: dict[str, Any] = {"points": points, "curves": heavy, "level_lines": thin, **run.look}
    if distance is not None:
        given["interest"] = np.where(np.isfinite(distance), (1 - distance / (far or 1.0)) ** 2, 0.0)
    if run.common.show is None:
        given |= {"label": "geodesic distance", "limits": (0.0, far or 1.0)}
    run.plot(lambda path: draw_array(path, mesh, name, values, **given))


def _polylines(mesh: TriangleMesh, paths: SurfacePaths) -> list[NDArray]:
    """Points of each path; none of a path without points."""
    import numpy as np

    from ddgcli.algorithms.geodesics.paths import curve_set

    if not len(paths):
        return []
    drawn = curve_set(mesh, paths)
    path_id = drawn.point_arrays["path_id"]
    return np.split(drawn.points, np.searchsorted(path_id, np.arange(1, len(paths))))
