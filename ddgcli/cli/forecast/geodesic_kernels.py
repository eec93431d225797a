"""Kernels of `geodesic`: distances, and curves by their number and the edges that they cross."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from ddgcli.choices import MAX_CROSSINGS, SYMMETRIC_METHODS
from ddgcli.cli.forecast.facts import EdgePaths, GeodesicFacts
from ddgcli.cli.forecast.mesh_facts import CURVE_SOURCES
from ddgcli.cli.forecast.use import KNOWN, InputSize, Range, Use, iterative_suffix

__all__ = ["geodesic_kernels"]

# levels at which neighbouring rays of a fan are compared: four for each mean side, 0.45 of which is from one
# crossing to the next
LEVELS_PER_CROSSING, LEAST_LEVELS, MOST_LEVELS = 1.8, 64, 1024
BOUNDARY_FAN_RANGE: Range = (0.3, 2.0)  # on rough surfaces most rays from the boundary return to it soon
MEASURED_ISOLINES = 20
CERTIFICATE_RUNS = 4
EDGE_PATH_DETOUR = 1.1  # length of edge paths over that of shortest paths
# Integral curves: steps that adapt to a smooth field, and those of a rough field for each edge that a curve
# crosses
FIELD_SEEDS, SMOOTH_STEPS, ROUGH_STEPS_PER_CROSSING = 16, 12.0, 6.0
MAX_FIELD_STEPS = 10_000  # that of `ddgcli.algorithms.tangent_fields.integral_curves`
TRIED_HALVES, COARSE_STEPS = 3.0, 1.5  # of an adaptive step; with one of twice a fixed step, which checks it
# flips of a straightened path for each edge that it crosses: 1 on irregular triangles; on regular ones a path
# of k crossings takes up to k^2 / 6
FLIP_RANGE_PER_CROSSING = 1 / 6
# memory of points of curves while they are written, over that of level lines; that of most others ends when
# they are described. Vectors of frames on the points add to it
OTHER_CURVES_WRITTEN, FRAMES_WRITTEN = 0.3, {"transport": 1.0, "darboux": 1.8}
# Windows of exact distances: a face has 0.2 (flat strips) to 0.7 (smooth surfaces) times the edges between it
# and the source; a round of the wavefront costs as much as 1,800 of them, and an edge takes 2 to 5 rounds
# of a face, of an edge of each path, and of one of the longest: windows; vertices that fast marching updates,
# whose rounds (1.0 to 2.7 of an edge of the longest path) cost as much as those of a hundred faces
ROUND_COST, ROUNDS_PER_PATH_EDGE = 1800.0, 2.5
PROPAGATION_WORK = {"exact": (0.0, 0.9, 3 * ROUND_COST), "fast-marching": (1.0, 0.0, 130.0)}
WINDOW_RANGE: Range = (0.35, 2.0)
# windows of the measured kernel, as predicted from the vertices near its source, and their growth
WINDOWS_OF_1E5_FACES, WINDOW_EXPONENT = 3.65e6, 1.12
COUNTED_WINDOW_RANGE: Range = (0.6, 1.6)
SPHERE_MEAN_PATH, SPHERE_LONGEST_PATH = 0.237, 0.456  # edges over the root of the faces: the measured kernel
SOURCE_OPTIONS = ("source", "source_point", "source_face", *CURVE_SOURCES)
MAX_BRUTE_FORCE_STARTS = 16  # that of `ddgcli.algorithms.geodesics.certificate`, which would load its imports


def geodesic_kernels(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    method = options.get("method", "exact")
    solver = iterative_suffix(options) if method == "heat" else ""
    sources = max(1, len(options.get("source") or ()))
    exact, facts = method == "exact", size.geodesic
    windows, assumes = (WINDOW_RANGE, "windows as on scans") if exact else (KNOWN, "")
    if exact and facts.paths is not None and facts.paths.windows is not None:
        windows, assumes = COUNTED_WINDOW_RANGE, "windows as near the sources"
    further = 0.0
    if any(options.get(name) for name in SOURCE_OPTIONS):
        share = _wavefront_share(method, facts.paths, size.elements)
        times, further = (share, 0.0) if exact else (1.0, max(0.0, share - 1.0))
        yield Use(f"geodesic {method}{solver}", times, range=windows, assumes=assumes, once=exact)
        reach_all = facts.paths is None or facts.paths.reach_all
        if exact and (not reach_all or any(options.get(name) for name in SOURCE_OPTIONS[1:])):
            yield Use("geodesic dijkstra", added=1.0)  # the certificate compares with distances along edges
    runs = sources if options.get("each_source") else 0
    if targets := _count(options.get("target")):  # symmetric distances start from the smaller set
        runs += min(sources, targets) if method in SYMMETRIC_METHODS else sources
    if (jobs := min(options.get("jobs", 1), runs)) > 1:
        yield Use("geodesic job", jobs)
        # each process factorises, or makes the stencils, where it is no copy of the first
        if method in ("heat", "fast-marching") and sys.platform != "linux":
            yield Use(f"geodesic {method}{solver}", jobs)
    if options.get("certify"):
        runs += CERTIFICATE_RUNS
    starts = sum(len(options.get(name) or ()) for name in ("source", "source_point", "source_face"))
    if starts > MAX_BRUTE_FORCE_STARTS or any(options.get(name) for name in CURVE_SOURCES):
        yield Use("geodesic many sources")  # the certificate searches the nearest one in a tree
    if further := further + runs * _wavefront_share(method, facts.paths_of_one, size.elements):
        yield Use(f"geodesic {method} solve{solver}", further, range=windows, assumes=assumes)
    for other in options.get("compare") or ():
        yield Use(f"geodesic {other}")
    if options.get("source_point") or options.get("target_point"):
        yield Use("geodesic point")
    if options.get("log_map"):
        of_heat = f"vector-heat{solver}" if solver else "heat log-map"
        log_maps = {"heat": of_heat, "fast-marching": "marching log-map"}
        yield Use(f"geodesic {log_maps.get(method, 'log-map')}")
    if options.get("signed_distance") or options.get("spread_vector"):
        yield Use(f"geodesic vector-heat{iterative_suffix(options)}")
    if options.get("voronoi"):
        yield Use("geodesic voronoi")
    yield from _curve_kernels(options, facts)


def _curve_kernels(options: Mapping[str, Any], facts: GeodesicFacts) -> Iterator[Use]:
    """Kernels of curves; `lines` are points of level lines and rays, `others` those of other curves."""
    lines = others = 0.0
    if targets := len(options.get("path_to") or ()):
        crossings = _path_length(facts) * facts.crossings_per_length
        others += targets * crossings
        yield Use("geodesic path", targets, added=targets, elements=crossings)
    if options.get("trace"):
        yield Use("geodesic trace")
        reflects = options.get("at_boundary") == "reflect"
        crossings = sum(_crossings(length, facts, stops=not reflects) for *_, length in options["trace"])
        others += crossings
        yield Use("geodesic crossings", added=1.0, elements=crossings)
    if facts.n_legs:
        crossings = facts.leg_length * facts.crossings_per_length
        others += facts.n_legs * crossings
        yield from _straightened_paths(options, crossings, facts)
    if options.get("field"):
        points, uses = _integral_curves(options, facts)
        others += points
        yield from uses
    if rays := options.get("fan"):
        yield Use("geodesic fan")
        crossings = rays * _fan_crossings(options["fan_length"], facts)
        lines += crossings
        at_boundary = facts.starts_at_boundary
        spread, assumes = (BOUNDARY_FAN_RANGE, "a smooth surface") if at_boundary else (KNOWN, "")
        yield Use("geodesic fan crossings", added=1.0, elements=crossings, range=spread, assumes=assumes)
        levels = LEVELS_PER_CROSSING * options["fan_length"] * facts.crossings_per_length
        yield Use("geodesic fan levels", elements=rays * min(max(levels, LEAST_LEVELS), MOST_LEVELS))
    if levels := options.get("isolines"):
        yield Use("geodesic isolines", levels / MEASURED_ISOLINES, once=True)
        points = _points_of_level(facts)
        lines += levels * points
        yield Use("geodesic level", levels, added=levels, elements=points)
    frame_options = [name for name in FRAMES_WRITTEN if options.get(name)]
    if "transport" in frame_options:
        yield Use("geodesic transport")
    if frame_options:
        yield Use("geodesic frames", len(frame_options), elements=lines + others)
    if files := len(options.get("paths_output") or ()):
        share = (lines + OTHER_CURVES_WRITTEN * others) / max(lines + others, 1.0)
        added = share + sum(FRAMES_WRITTEN[name] for name in frame_options)
        yield Use("write curves", files, added=added, elements=lines + others)


def _path_length(facts: GeodesicFacts) -> float:
    """Mean length of shortest paths."""
    if facts.paths is None or facts.paths.target_length is None:
        return facts.extent
    return facts.paths.target_length / EDGE_PATH_DETOUR


def _points_of_level(facts: GeodesicFacts) -> float:
    """Edges that a level line of the distance crosses, by the formula of Cauchy and Crofton.

    The gradient of the distance is 1, so that an edge meets on average 2 / pi of its length over the space
    between two levels.
    """
    longest = None if facts.paths is None else facts.paths.longest_length
    reach = facts.extent if longest is None else longest / EDGE_PATH_DETOUR
    return 2.0 / math.pi * facts.total_edge_length / reach if reach else 0.0


def _straightened_paths(options: Mapping[str, Any], crossings: float, facts: GeodesicFacts) -> Iterator[Use]:
    """Edge paths between way-points, and their straightening."""
    yield Use("geodesic edge path")
    yield Use("geodesic leg", facts.n_legs)
    if not (options.get("straighten") or options.get("loop")):
        yield Use("geodesic crossings", added=1.0, elements=facts.n_legs * crossings)
        return
    yield Use(
        "geodesic straighten",
        added=1.0,
        elements=facts.n_legs * crossings,
        range=(0.5, max(2.0, FLIP_RANGE_PER_CROSSING * crossings)),
        assumes="as few flips as on irregular triangles",
    )


def _integral_curves(options: Mapping[str, Any], facts: GeodesicFacts) -> tuple[float, list[Use]]:
    """Points of integral curves, and the kernels that integrate them."""
    seeds = options.get("field_seeds") or FIELD_SEEDS
    if any(options.get(name) for name in SOURCE_OPTIONS):
        seeds = sum(len(options.get(name) or ()) for name in SOURCE_OPTIONS[:3])
    length = 2.0 * facts.extent if facts.field_length is None else facts.field_length
    crossings = _crossings(length, facts, stops=True)
    spread, assumes = KNOWN, ""
    if facts.field_steps is not None:
        n_lines, n_rounds = float(facts.field_steps), COARSE_STEPS * facts.field_steps
    else:
        most = min(max(SMOOTH_STEPS, ROUGH_STEPS_PER_CROSSING * crossings), MAX_FIELD_STEPS)
        steps = math.sqrt(SMOOTH_STEPS * most)
        spread = (SMOOTH_STEPS / steps, 1.5 * most / steps)
        assumes = f"{steps:.0f} steps of a curve: fewer in smooth fields, more in rough ones"
        n_lines, n_rounds = 2.0 * steps, TRIED_HALVES * steps
    points = seeds * (n_lines + crossings)
    order = float(options.get("field_order") or 4) / 4.0
    return points, [
        Use("geodesic field"),
        Use(
            "geodesic field round",
            order * n_rounds,
            added=n_rounds,
            elements=0,
            range=spread,
            assumes=assumes,
        ),
        Use("geodesic field step", order, added=1.0, elements=seeds * n_rounds, range=spread),
        Use("geodesic crossings", added=1.0, elements=seeds * crossings),
    ]


def _fan_crossings(length: float, facts: GeodesicFacts) -> float:
    """Edges that a ray of a fan crosses.

    From the boundary many rays leave the surface soon: their lengths vary as those of random lines.
    """
    if facts.starts_at_boundary and math.isfinite(facts.mean_chord):
        length = facts.mean_chord * -math.expm1(-length / facts.mean_chord)
    return _crossings(length, facts, stops=True)


def _crossings(length: float, facts: GeodesicFacts, *, stops: bool) -> float:
    """Edges that a straight line of a length crosses; one that stops at the boundary ends there."""
    reached = min(length, facts.mean_chord) if stops else length
    return min(reached * facts.crossings_per_length, MAX_CROSSINGS)


def _count(vertices: Any) -> int:
    """Number of vertices in groups of them, or without groups."""
    return sum(len(group) if isinstance(group, (list, tuple)) else 1 for group in vertices or ())


def _wavefront_share(method: str, paths: EdgePaths | None, n_faces: int) -> float:
    """Work of a propagation, over that on a sphere with as many faces, where kernels were measured."""
    if paths is None or method not in PROPAGATION_WORK:
        return 1.0
    root = math.sqrt(n_faces)
    if paths.windows is not None:
        of_sphere = WINDOWS_OF_1E5_FACES * (n_faces / 1e5) ** WINDOW_EXPONENT
        rounds = [ROUNDS_PER_PATH_EDGE * longest for longest in (paths.longest, SPHERE_LONGEST_PATH * root)]
        return (paths.windows + ROUND_COST * rounds[0]) / (of_sphere + ROUND_COST * rounds[1])
    of_face, of_total, of_longest = PROPAGATION_WORK[method]
    sphere = EdgePaths(0.5 * n_faces * SPHERE_MEAN_PATH * root, SPHERE_LONGEST_PATH * root)
    own, measured = (
        of_face * n_faces + of_total * run.total + of_longest * run.longest for run in (paths, sphere)
    )
    return own / measured
