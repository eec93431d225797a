"""The exponential map as a fan: evenly spaced straightest geodesics, geodesic circles, caustics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.paths import SurfacePaths, barycentric_in, segment_vectors
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.geodesics.surface_curves import Curves, concatenate_curves
from ddgcli.algorithms.tangent_fields.log_map import SourceFrame
from ddgcli.algorithms.tracing.lines import BOUNDARY_STATUS, FAILURE_STATUS, Traces
from ddgcli.algorithms.tracing.trace import STATUS_TEXT, Tracer, check_lengths
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.geometry.component_sides import component_mean_side
from ddgcli.geometry.extrinsic import face_normal
from ddgcli.geometry.face_frames import relative_position, surface_position
from ddgcli.mesh.require import check_size
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot, vector_length
from ddgcli.progress import ProgressCallback

MIN_LEVELS, MAX_LEVELS, LEVELS_PER_SIDE = 64, 1024, 4.0  # at which the order of neighbouring rays is compared


@dataclass(frozen=True, eq=False)
class _Rays:
    """Recorded rays, with the length at each of their points.

    Parameters
    ----------
    paths : SurfacePaths
    reach : (p,) ndarray of float64
        Length from the source at each point.
    total : (k,) ndarray of float64
        Traced length of each ray.
    shift : (k,) ndarray of float64
        Of each ray, so that `shifted_reach` increases over all rays: one search finds points of many.
    shifted_reach : (p,) ndarray of float64
    """

    mesh: TriangleMesh
    paths: SurfacePaths
    reach: NDArray[np.float64]
    total: NDArray[np.float64]
    shift: NDArray[np.float64]
    shifted_reach: NDArray[np.float64]

    @classmethod
    def of_lines(cls, mesh: TriangleMesh, lines: Traces) -> _Rays:
        paths = SurfacePaths.of_traces(lines)
        size = np.nan_to_num(np.hypot(*segment_vectors(mesh, paths).T))
        reach = np.cumsum(np.append(0.0, size[:-1]))
        reach -= np.repeat(reach[paths.start[:-1]], np.diff(paths.start))
        gap = float(lines.length.max(initial=0.0)) or 1.0  # no sum rounds lengths away
        shift = np.append(0.0, np.cumsum(lines.length[:-1] + gap))
        return cls(mesh, paths, reach, lines.length, shift, reach + shift[paths.of_point()])

    def at(self, ray: NDArray, length: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Face, barycentric coordinates and unit direction in space at lengths along rays."""
        paths = self.paths
        point = np.searchsorted(self.shifted_reach, length + self.shift[ray], side="right") - 1
        point = np.clip(point, paths.start[ray], paths.start[ray + 1] - 2)
        face = paths.face[point]
        ahead = barycentric_in(self.mesh.topology, paths.face[point + 1], paths.barycentric[point + 1], face)
        step = self.reach[point + 1] - self.reach[point]
        share = np.clip((length - self.reach[point]) / np.where(step > 0, step, 1.0), 0.0, 1.0)[:, None]
        tail = relative_position(self.mesh, face, paths.barycentric[point])
        vector = relative_position(self.mesh, face, ahead) - tail
        size = vector_length(vector)[:, None]
        weights = (1 - share) * paths.barycentric[point] + share * ahead
        return face, weights, vector / np.where(size > 0, size, 1.0)


def check_fan(
    mesh: TriangleMesh,
    source: Sources,
    rays: int,
    length: float,
    circles: int = 0,
) -> SourceFrame:
    """Tangent frame at the source of a fan; raises the errors of `geodesic_fan`.

    Parameters
    ----------
    mesh : TriangleMesh
    source : Sources
    rays : int
    length : float
    circles : int
        As in `geodesic_fan`.

    Returns
    -------
    SourceFrame

    Raises
    ------
    ParameterError
    MeshError
        All vertices are at the same place.
    """
    if rays < 3:
        raise ParameterError(f"needs 3 rays or more, not {rays}", parameter="rays")
    if not (np.isfinite(length) and length > 0):
        raise ParameterError(f"must be a positive length, not {length}", parameter="length")
    if circles < 0:
        raise ParameterError(f"must be 0 or more, not {circles}", parameter="circles")
    if len(source) != 1 or len(source.edge):
        raise ParameterError(
            f"a fan has exactly one source vertex or point, not {len(source)}", parameter="source"
        )
    check_size(float(mesh.side_length.max()), in_range=False)
    with renamed_parameters(sources="source"):
        source_frame = SourceFrame(Tracer(mesh), source)
    face = source_frame.first // 3 if source_frame.vertex >= 0 else source_frame.face
    check_lengths(mesh, np.array([face]), np.array([length]))
    return source_frame


def geodesic_fan(
    mesh: TriangleMesh,
    source: Sources,
    rays: int,
    length: float,
    circles: int = 8,
    *,
    progress: ProgressCallback | None = None,
) -> Curves:
    """Straightest geodesics from one source in evenly spaced directions, with circles and caustics.

    Parameters
    ----------
    mesh : TriangleMesh
        Consistently oriented.
    source : Sources
        One vertex or one point. At a vertex directions are spaced evenly in its total angle; at a boundary
        vertex the first and the last have half that space to the boundary.
    rays : int
        Number of rays; at least 3.
    length : float
        Of each ray; rays end at the boundary.
    circles : int
        Number of geodesic circles, at even lengths.
    progress : callable, optional
        Called with the work done and the whole work.

    Returns
    -------
    Curves
        First the rays ("fan ray"), counter-clockwise; then the circles ("geodesic circle"): polygons
        through the points of equal length on neighbouring rays, one path for each arc between rays that
        have ended; then the caustics ("caustic"): polylines through the first points at which
        neighbouring rays cross. The array `caustic` is 1 on points of rays and circles beyond the caustic,
        where the wavefront runs backwards, and on caustics; 0 elsewhere; the array `level` is the length
        from the source.

    Raises
    ------
    ParameterError
        On fewer than 3 rays, a length that is not positive, less than 0 circles, or several sources.
    """
    source_frame = check_fan(mesh, source, rays, length, circles)
    total, is_open = 2 * np.pi, False
    if source_frame.vertex >= 0:
        fans = source_frame.tracer.fans
        total, is_open = float(fans.total_angle[source_frame.fan]), bool(fans.is_open[source_frame.fan])
    angle = total * ((np.arange(rays) + (0.5 if is_open else 0.0)) / rays)  # none along the boundary
    lines = source_frame.lines(angle, np.full(rays, float(length)))
    swept = _Rays.of_lines(mesh, lines)
    caustic = _caustic_lengths(swept, length, is_open)
    if progress is not None:
        progress(1.0, 1.0)
    curve_sets = [
        _ray_curves(swept, lines, angle, caustic),
        *(_circle(swept, length * (k + 1) / circles, caustic, is_open) for k in range(circles)),
        _caustics(swept, caustic, is_open),
    ]
    return concatenate_curves(curve_sets)


def _ray_curves(swept: _Rays, lines: Traces, angle: NDArray, caustic: NDArray) -> Curves:
    """The rays with their entries of the summary and the arrays of their points."""
    entries: list[dict[str, Any]] = [
        {"kind": "fan ray", "angle": float(a), "length": float(traced), "status": STATUS_TEXT[status],
         "caustic_length": float(c) if np.isfinite(c) else None}
        for a, traced, status, c in zip(angle, lines.length, lines.status, caustic, strict=True)
    ]  # fmt: skip
    behind = (swept.reach >= caustic[swept.paths.of_point()]).astype(np.float64)
    complete = bool((lines.status != FAILURE_STATUS).all())
    return Curves(swept.paths, entries, {}, complete, {"level": swept.reach, "caustic": behind})


def _caustic_lengths(swept: _Rays, length: float, is_open: bool) -> NDArray[np.float64]:
    """(k,) length at which each ray and its neighbours first cross; inf where they do not."""
    k = len(swept.paths)
    component = swept.mesh.topology.face_component[swept.paths.face[0]]
    mean_side = float(component_mean_side(swept.mesh)[component])
    count = int(np.clip(LEVELS_PER_SIDE * length / mean_side, MIN_LEVELS, MAX_LEVELS))
    levels = length * np.arange(1, count + 1) / count
    before, order = np.zeros(k), np.full(k, np.inf)
    normal = face_normal(swept.mesh)
    ray = np.arange(k)
    left, right = (ray + 1) % k, (ray - 1) % k
    if is_open:
        left[-1], right[0] = k - 1, 0
    for level, previous in zip(levels, np.append(0.0, levels[:-1])):
        face, weights, direction = swept.at(ray, np.minimum(level, swept.total))
        position = surface_position(swept.mesh, face, weights)
        width = row_dot(row_cross(normal[face], direction), position[left] - position[right])
        present = swept.total >= level
        valid = present & present[left] & present[right] & np.isinf(order)
        crossed = valid & (width <= 0) & (before > 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            zero = previous + (level - previous) * before / (before - width)
        order[crossed] = zero[crossed]
        before = np.where(valid, width, before)
    return order


def _runs(present: NDArray, is_open: bool) -> tuple[NDArray[np.int64], NDArray[np.int64], bool]:
    """Split the present rays into runs of neighbours.

    Returns the rays run by run, the place in them where each run starts, and whether the only run is closed.
    """
    k = len(present)
    closed = bool(present.all()) and not is_open
    first = 0 if closed or is_open else int(np.argmin(present))  # no run is cut at ray 0
    order = (np.arange(k) + first) % k
    place = np.flatnonzero(present[order])
    return order[place], np.flatnonzero(np.diff(place, prepend=-2) > 1), closed


def _polylines(
    swept: _Rays, ray: NDArray, starts: NDArray, closed: bool, level: NDArray
) -> tuple[SurfacePaths, NDArray[np.float64]]:
    """Paths through the points at lengths along rays, one for each run, and the sums of their chords."""
    face, weights, _ = swept.at(ray, level)
    position = surface_position(swept.mesh, face, weights)
    ends = np.append(starts, len(ray))
    step = vector_length(np.roll(position, -1, axis=0) - position)
    if not closed:
        step[ends[1:] - 1] = 0.0
    paths = SurfacePaths(face, weights, ends, np.full(len(starts), closed))
    return paths, np.add.reduceat(step, starts)


def _circle(swept: _Rays, level: float, caustic: NDArray, is_open: bool) -> Curves:
    """Polygons through the points of neighbouring rays at one length: the arcs of a circle."""
    ray, starts, closed = _runs(swept.total >= level * (1 - 1e-12), is_open)
    levels = np.full(len(ray), level)
    paths, length = _polylines(swept, ray, starts, closed, levels)
    behind = (caustic[ray] <= level).astype(np.float64)
    sizes, n_behind = np.diff(paths.start), np.add.reduceat(behind, starts)
    entries: list[dict[str, Any]] = [
        {"kind": "geodesic circle", "level": float(level), "closed": closed, "points": int(size),
         "length": float(arc), "behind_caustic": int(number)}
        for size, arc, number in zip(sizes, length, n_behind, strict=True)
    ]  # fmt: skip
    return Curves(paths, entries, arrays={"level": levels, "caustic": behind})


def _caustics(swept: _Rays, caustic: NDArray, is_open: bool) -> Curves:
    """Polylines through the caustic points of successive rays."""
    ray, starts, closed = _runs(np.isfinite(caustic), is_open)
    level = caustic[ray]
    paths, length = _polylines(swept, ray, starts, closed, level)
    least, largest = np.minimum.reduceat(level, starts), np.maximum.reduceat(level, starts)
    entries: list[dict[str, Any]] = [
        {"kind": "caustic", "closed": closed, "points": int(size), "length": float(arc),
         "least_level": float(low), "largest_level": float(high)}
        for size, arc, low, high in zip(np.diff(paths.start), length, least, largest, strict=True)
    ]  # fmt: skip
    return Curves(paths, entries, arrays={"level": level, "caustic": np.ones(len(ray))})


def describe_fan(fan: Curves) -> dict[str, Any]:
    """Summary of a fan: its rays by how they end, its circles and caustics.

    Parameters
    ----------
    fan : Curves
        As returned by `geodesic_fan`.

    Returns
    -------
    dict
    """
    rays = [entry for entry in fan.entries if entry["kind"] == "fan ray"]
    lengths = [entry["caustic_length"] for entry in rays if entry["caustic_length"] is not None]
    return {
        "rays": len(rays),
        "stopped_at_boundary": sum(entry["status"] == STATUS_TEXT[BOUNDARY_STATUS] for entry in rays),
        "rays_with_caustic": len(lengths),
        "least_caustic_length": min(lengths, default=None),
        "circles": _circle_totals([entry for entry in fan.entries if entry["kind"] == "geodesic circle"]),
        "caustics": [entry for entry in fan.entries if entry["kind"] == "caustic"],
    }


def _circle_totals(arcs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Entries of the circles, with the sums over the arcs of each."""
    totals: dict[float, dict[str, Any]] = {}
    for arc in arcs:
        circle = totals.setdefault(
            arc["level"],
            {"level": arc["level"], "length": 0.0, "closed": arc["closed"], "arcs": 0, "behind_caustic": 0},
        )
        circle["length"] += arc["length"]
        circle["arcs"] += 1
        circle["behind_caustic"] += arc["behind_caustic"]
    return list(totals.values())
