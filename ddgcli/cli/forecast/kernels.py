"""Kernels that a command runs for its options, and how often."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ddgcli.choices import ITERATIVE_SOLVERS, MAX_CROSSINGS, MAX_REFINEMENT_DEGREES, SYMMETRIC_METHODS
from ddgcli.cli.forecast.curvature_kernels import curvature_kernels
from ddgcli.cli.forecast.mesh_facts import CURVE_SOURCES
from ddgcli.cli.forecast.simulator_kernels import (
    curve_flow_kernels,
    fluid_kernels,
    shell_kernels,
    willmore_kernels,
)
from ddgcli.cli.forecast.use import KNOWN, EdgePaths, InputSize, Range, Use

__all__ = ["MEASURED_REFINEMENT_DEGREES", "kernels_of"]

MEASURED_EIGENFORMS = 4
PAIRS_PER_FACTOR = 40  # eigenforms that take as long as the first four
PAIRS_PER_SOLUTIONS = 17.0  # the same, where each solution is iterative
MEASURED_EIGENPAIRS = 8  # of the kernel `laplacian eigen`
# between the powers of the factors' memory (0.45: a mat of one layer has 0.54 of a cube's) and seconds (0.15)
COMPACTNESS_POWER = 0.3
# components that are copies of one another have multiple eigenvalues, which Lanczos finds in several passes
MAX_FAST_COPIES, COPIES_FACTOR = 4, 4.0
COPIES: dict[str, Any] = {"range": (0.4, 1.6), "assumes": "multiple eigenvalues of equal components"}
HARMONIC_FIELD_MEMORY = 4.0  # edge values and vectors on faces, over the memory of an eigenpair
MEASURED_SMOOTHING_STEPS = 10
MEASURED_REFINEMENT_DEGREES = 25.0
MEASURED_EVOLUTION_STEPS = 100
MEASURED_ISOLINES = 20
# levels at which neighbouring rays of a fan are compared: four for each mean side, 0.45 of which is from one
# crossing to the next
LEVELS_PER_CROSSING, LEAST_LEVELS, MOST_LEVELS = 1.8, 64, 1024
CERTIFICATE_RUNS = 4
PAGE_PIXELS = 1400 * 1050  # of a picture without --size
# frames on the page of a run, which shows the first one too; those of the measured page, and the part of each
MAX_PICTURE_FRAMES, MEASURED_PICTURE_FRAMES, PAGE_SHARE_OF_FRAME = 4, 2, 1 / 6
PAGE_PIXELS_OF_RUN = 1800 * 2160
FURTHER_PICTURE = 0.05  # seconds beside the pixels, over those of the first, which loads the library
PICTURES = (".png", ".svg", ".pdf", ".gif", ".mp4")
BALL_SHARE = 0.65  # of the seconds of a comparison of curvature on a sphere: rows that clip faces
MAX_COMPARED_FACES, TRADEOFF_RANGE = 14_000, (0.1, 5.0)  # on larger meshes the budget bounds the rows
REFINED_SHARE = 0.75  # of the rows of triangulations on the measured mesh, that of their refinements
FIELD_SEEDS, FIELD_RANGE = 16, (0.3, 30.0)  # the default; steps adapt to the field
FIXED_STEP_RANGE = (0.3, 60.0)  # up to 10,000 steps, whatever the mesh
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
CONFORMAL_MAP_RANGE: Range = (0.7, 4.0)  # by the distance of the second eigenvalue
SPHERE_MEAN_PATH, SPHERE_LONGEST_PATH = 0.237, 0.456  # edges over the root of the faces: the measured kernel
SOURCE_OPTIONS = ("source", "source_point", "source_face", *CURVE_SOURCES)
MAX_BRUTE_FORCE_STARTS = 16  # that of `ddgcli.algorithms.geodesics.certificate`, which would load its imports
# Steiner points over the angle deficit of `InputSize`, at 25 degrees: 1.4 to 2.5 on needles and slivers of
# mechanical parts, whose faces share what they lack, 4 to 6 on scans and random points, on which the kernel
# is measured; they grow as exp(degrees / 12). A point takes three flips, and the input four for its deficit
STEINER_POINTS_PER_DEFICIT, STEINER_SATURATION = 4.8, 2.0
STEINER_RANGE, STEINER_DEGREES = (0.4, 2.5), 12.0
NEEDLE_SHARE, NEEDLE_RANGE = 0.9, (0.4, 12.0)  # nearly all faces are needles, whose rows flip one by one
STEINER_POINTS_OF_MEASURED_FACE, DEFICIT_OF_MEASURED_FACE = 0.78, 0.12
FLIPS_PER_POINT, FLIPS_PER_DEFICIT = 3.0, 4.0


def kernels_of(
    command: str,
    options: Mapping[str, Any],
    size: InputSize,
    outputs: tuple[str, ...] = (),
    plot: bool = False,
    full: bool = True,
    energies: bool = True,
    pixels: int = PAGE_PIXELS,
) -> list[Use]:
    """Kernels of a command.

    Parameters
    ----------
    command : str
    options : mapping
        As in the summary: names of parameters with their values.
    size : InputSize
    outputs : tuple of str
        Paths of the result; their extensions choose the cost of writing.
    plot : bool
        Whether a picture is drawn.
    full, energies : bool
        Whether a run of `curvature` computes more arrays than its short summary shows, and all integrals.
    pixels : int
        Of a picture.
    """
    if command == "frames":
        uses = _picture(size, pixels, size.frame_count) if options.get("pictures") else []
    else:
        uses = list(_KERNELS[command](options, size))
    if command == "curvature" and size.kind != "curve":
        offset = options.get("offset") is not None  # its volume is that of Steiner's polynomial
        uses += [Use("curvature further arrays")] * (full or offset)
        uses += [Use("curvature energies")] * (energies or offset)
    if command not in ("view", "dec", "tradeoff"):
        meshes = [path for path in outputs if Path(path).suffix.lower() not in PICTURES]
        uses += [Use(f"write {_written_as(path)}", size.frame_count) for path in meshes]
    if plot:
        uses += _plot(command, size, pixels)
    return uses


def _plot(command: str, size: InputSize, pixels: int) -> list[Use]:
    """The picture of --plot: of a surface, or a page of small ones and charts."""
    if command == "delaunay":
        return [Use("delaunay overlay"), Use("picture of triangulations")]
    if command == "tradeoff":
        return [Use("picture curve")]
    if command in ("frames", "shell-sim", "fluid-sim", "willmore-flow", "curve-flow"):
        further = min(size.frame_count + 1, MAX_PICTURE_FRAMES) - MEASURED_PICTURE_FRAMES
        small = Use("picture pixels", further, elements=PAGE_SHARE_OF_FRAME * PAGE_PIXELS_OF_RUN)
        return [Use("picture of a run"), *([small] if further > 0 else [])]
    return _picture(size, pixels, 1)


def _picture(size: InputSize, pixels: int, count: int) -> list[Use]:
    """Pictures: what their faces take, and their pixels, most on those that show a surface."""
    drawing = Use("picture", 1.0 + FURTHER_PICTURE * (count - 1.0))
    if size.kind == "curve":  # lines, not pixels
        return [drawing]
    covered = Use("picture covered pixels", count, added=1.0, elements=size.picture_share * pixels)
    return [drawing, Use("picture pixels", count, elements=pixels), covered]


def _written_as(path: str) -> str:
    """Extension with a measured cost that stands for the extension of a path."""
    suffix = Path(path).suffix.lower()
    if suffix in (".npz", ".vtkhdf", ".h5"):
        return "npz"
    return (
        "ply"
        if suffix in (".ply", ".stl", ".glb", ".vtp")
        else "text"
        if suffix in (".obj", ".off")
        else "vtu"
    )


def _info(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("info")
    if options.get("self_intersections"):
        yield Use("info self-intersections")


def _nothing(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    return iter(())


def _repair(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("repair")
    if size.hole_triangles:
        yield Use("repair holes", elements=size.hole_triangles)


def _delaunay(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("delaunay")
    if options.get("refine"):
        yield Use("delaunay", added=1.0)  # the input, in which the points are inserted too
        yield _refinement(float(options["refine"]), options.get("max_points"), size)
    if needs_overlay(options):
        yield Use("delaunay overlay")
        if size.further_overlay_faces:
            yield Use("delaunay further faces", elements=size.further_overlay_faces)
    for name in ("dual", "condition"):
        if options.get(name):
            yield Use(f"delaunay {name}")
    if options.get("transfer"):
        yield Use("delaunay transfer")


def needs_overlay(options: Mapping[str, Any]) -> bool:
    """Whether `delaunay` computes the overlay of both triangulations."""
    return bool(options.get("overlay") or options.get("transfer"))


def _refinement(degrees: float, most: int | None, size: InputSize) -> Use:
    """The insertion of Steiner points, whose number grows with that of the faces with small angles."""
    deficit = size.angle_deficit
    if deficit is None:
        deficit = DEFICIT_OF_MEASURED_FACE * size.elements
    growth = math.exp((min(degrees, MAX_REFINEMENT_DEGREES) - MEASURED_REFINEMENT_DEGREES) / STEINER_DEGREES)
    shared = 1.0 + STEINER_SATURATION * deficit / max(size.elements, 1)
    points = min(STEINER_POINTS_PER_DEFICIT * growth * deficit / shared, math.inf if most is None else most)
    measured_flips = (
        FLIPS_PER_POINT + FLIPS_PER_DEFICIT * DEFICIT_OF_MEASURED_FACE / STEINER_POINTS_OF_MEASURED_FACE
    )
    flips = FLIPS_PER_POINT * points + FLIPS_PER_DEFICIT * deficit
    return Use(
        "delaunay refine",
        flips / (measured_flips * max(points, 1.0)),
        elements=points / STEINER_POINTS_OF_MEASURED_FACE,
        range=NEEDLE_RANGE if deficit > NEEDLE_SHARE * size.elements else STEINER_RANGE,
        assumes=f"{points:.2g} Steiner points",
        once=True,
    )


def _laplacian(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("laplacian")
    if options.get("operator") == "intrinsic-delaunay":
        yield Use("delaunay")
    if options.get("operator") == "tufted":
        yield Use("laplacian tufted")
    if options.get("matrix"):
        yield Use("laplacian matrix")
    if options.get("mass_matrix"):
        yield Use("laplacian matrix", 0.2)
    solver = _iterative_suffix(options)
    if options.get("poisson") or options.get("harmonic"):
        yield Use(f"laplacian poisson{solver}")
    pairs = max(options.get("eigen") or 0, size.signature_pairs)
    if pairs:
        computed = pairs - size.n_components + 1  # the constants of the components are known
        yield Use(f"laplacian eigen{solver}", elements=None if computed > 0 else 0)
        if (further := computed - MEASURED_EIGENPAIRS) > 0:
            use = Use(f"laplacian eigenpair{solver}", further, added=pairs - MEASURED_EIGENPAIRS)
            copies = size.equal_components > MAX_FAST_COPIES
            yield replace(use, times=COPIES_FACTOR * further, **COPIES) if copies else use
    if options.get("smooth"):
        steps = (options.get("smooth_steps") or MEASURED_SMOOTHING_STEPS) / MEASURED_SMOOTHING_STEPS
        yield Use(f"laplacian smooth{solver}", steps, once=True)
    if options.get("parameterize"):
        iterates = options["parameterize"] == "conformal"
        yield Use(
            f"laplacian {options['parameterize']}",
            range=CONFORMAL_MAP_RANGE if iterates else KNOWN,
            assumes="as few iterations as on a disk" if iterates else "",
        )
    if options.get("form_eigen"):
        # the factor and the count of what is missing are most of the cost
        further = options["form_eigen"] - MEASURED_EIGENFORMS
        elements = None if size.compactness == 1.0 else size.elements * size.compactness**COMPACTNESS_POWER
        per_pair = PAIRS_PER_SOLUTIONS if solver else PAIRS_PER_FACTOR
        yield Use(f"laplacian form-eigen{solver}", 1.0 + further / per_pair, elements=elements)
    if options.get("heat") or options.get("wave"):
        steps = (size.steps or MEASURED_EVOLUTION_STEPS) / MEASURED_EVOLUTION_STEPS
        yield Use(f"laplacian evolution{solver}", steps, once=True)


def _iterative_suffix(options: Mapping[str, Any]) -> str:
    """End of the names of kernels that solve linear systems, by the solver: nothing for factorisations."""
    return f" {options['solver']}" if options.get("solver") in ITERATIVE_SOLVERS else ""


def _hodge(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("hodge field" if options.get("field") else "hodge")
    if size.kind == "tetrahedra":
        if size.betti_number:  # conjugate gradients for a cochain of each class of loops
            yield Use("hodge cochains", size.betti_number)
        return
    if options.get("basis") and size.betti_number:  # a solve for each field, which stays
        yield Use("laplacian poisson", added=1.0)
        fields = size.betti_number
        yield Use("laplacian eigenpair", fields, added=HARMONIC_FIELD_MEMORY * fields)


def _dec(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("dec")


def _geodesic(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    method = options.get("method", "exact")
    solver = _iterative_suffix(options) if method == "heat" else ""
    sources = max(1, len(options.get("source") or ()))
    exact = method == "exact"
    windows, assumes = (WINDOW_RANGE, "windows as on scans") if exact else (KNOWN, "")
    if exact and size.paths is not None and size.paths.windows is not None:
        windows, assumes = COUNTED_WINDOW_RANGE, "windows as near the sources"
    further = 0.0
    if any(options.get(name) for name in SOURCE_OPTIONS):
        share = _wavefront_share(method, size.paths, size.elements)
        times, further = (share, 0.0) if exact else (1.0, max(0.0, share - 1.0))
        yield Use(f"geodesic {method}{solver}", times, range=windows, assumes=assumes, once=exact)
        reach_all = size.paths is None or size.paths.reach_all
        if exact and (not reach_all or any(options.get(name) for name in SOURCE_OPTIONS[1:])):
            yield Use("geodesic dijkstra", added=1.0)  # the certificate compares with distances along edges
    runs = sources if options.get("each_source") else 0
    if targets := _count(options.get("target")):  # symmetric distances start from the smaller set
        runs += min(sources, targets) if method in SYMMETRIC_METHODS else sources
    if (jobs := min(options.get("jobs", 1), runs)) > 1:
        yield Use("geodesic job", jobs)
        if method in ("heat", "fast-marching"):  # each process factorises, or makes the stencils
            yield Use(f"geodesic {method}{solver}", jobs)
    if options.get("certify"):
        runs += CERTIFICATE_RUNS
    starts = sum(len(options.get(name) or ()) for name in ("source", "source_point", "source_face"))
    if starts > MAX_BRUTE_FORCE_STARTS or any(options.get(name) for name in CURVE_SOURCES):
        yield Use("geodesic many sources")  # the certificate searches the nearest one in a tree
    if further := further + runs * _wavefront_share(method, size.paths_of_one, size.elements):
        yield Use(f"geodesic {method} solve{solver}", further, range=windows, assumes=assumes)
    for other in options.get("compare") or ():
        yield Use(f"geodesic {other}")
    if options.get("source_point") or options.get("target_point"):
        yield Use("geodesic point")
    if options.get("field"):
        seeds = (options.get("field_seeds") or FIELD_SEEDS) / FIELD_SEEDS
        seconds_range, assumes = (FIELD_RANGE, "a smooth field")
        if options.get("field_step") is not None:
            seconds_range, assumes = (FIXED_STEP_RANGE, "about a step for each face that a curve crosses")
        yield Use("geodesic field", seeds, range=seconds_range, assumes=assumes)
    if options.get("log_map"):
        of_heat = f"vector-heat{solver}" if solver else "heat log-map"
        log_maps = {"heat": of_heat, "fast-marching": "marching log-map"}
        yield Use(f"geodesic {log_maps.get(method, 'log-map')}")
    if options.get("transport"):
        yield Use("geodesic transport")
    if options.get("signed_distance") or options.get("spread_vector"):
        yield Use(f"geodesic vector-heat{_iterative_suffix(options)}")
    if options.get("trace"):
        yield Use("geodesic trace")
        reflects = options.get("at_boundary") == "reflect"
        crossings = sum(_crossings(length, size, stops=not reflects) for *_, length in options["trace"])
        yield Use("geodesic crossings", added=1.0, elements=crossings)
    if rays := options.get("fan"):
        yield Use("geodesic fan")
        crossings = rays * _crossings(options["fan_length"], size, stops=True)
        yield Use("geodesic fan crossings", added=1.0, elements=crossings)
        levels = LEVELS_PER_CROSSING * options["fan_length"] * size.crossings_per_length
        yield Use("geodesic fan levels", elements=rays * min(max(levels, LEAST_LEVELS), MOST_LEVELS))
    if levels := options.get("isolines"):
        yield Use("geodesic isolines", levels / MEASURED_ISOLINES, once=True)
    if options.get("voronoi"):
        yield Use("geodesic voronoi")


def _crossings(length: float, size: InputSize, *, stops: bool) -> float:
    """Edges that a straight line of a length crosses; one that stops at the boundary ends there."""
    reached = min(length, size.mean_chord) if stops else length
    return min(reached * size.crossings_per_length, MAX_CROSSINGS)


def _count(vertices: Any) -> int:
    """Number of vertices in groups of them, or without groups."""
    return sum(len(group) if isinstance(group, (list, tuple)) else 1 for group in vertices or ())


def _wavefront_share(method: str, paths: EdgePaths | None, n_faces: int) -> float:
    """Work of a propagation over that on a sphere of as many faces, where the kernels are measured."""
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


def _view(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    yield Use("view")
    if (further := size.frame_count - 1) > 0:
        yield Use("view frame", further, added=further)


def _tradeoff(options: Mapping[str, Any], size: InputSize) -> Iterator[Use]:
    """The heaviest method of the compared command, and all rows on a mesh that the budget suffices for."""
    heaviest: dict[str, dict[str, Any]] = {
        "curvature": {"scheme": "quadric"},
        "delaunay": {"refine": MEASURED_REFINEMENT_DEGREES},
        "laplacian": {"eigen": options.get("eigen") or MEASURED_EIGENPAIRS},
        "geodesic": {"method": "exact", "source": [0]},
        "willmore-flow": {"duration": 1.0, "flow": options.get("flow")},
    }
    compared = options["compared"]
    if compared not in heaviest:  # mechanical examples, which fill no memory
        return
    yield from _KERNELS[compared](heaviest[compared], replace(size, steps=1))
    elements = size.compared_share * min(size.elements, MAX_COMPARED_FACES)
    times, assumes = 1.0, "rows as of a sphere"
    if compared == "delaunay" and size.angle_deficit is not None:
        refined = size.angle_deficit / max(DEFICIT_OF_MEASURED_FACE * size.elements, 1.0)
        of_measured = 1.0 - REFINED_SHARE + REFINED_SHARE * refined
        times = of_measured * size.elements / max(elements, 1.0)
        assumes = "rows with Steiner points by angles"
    if compared == "curvature":
        times, assumes = 1.0 - BALL_SHARE + BALL_SHARE * size.compared_work, "no noise to search"
    yield Use(f"tradeoff {compared}", times, elements=elements, range=TRADEOFF_RANGE, assumes=assumes)


_KERNELS: dict[str, Callable[[Mapping[str, Any], InputSize], Iterator[Use]]] = {
    "info": _info,
    "repair": _repair,
    "examples": _nothing,
    "check": _nothing,
    "curvature": curvature_kernels,
    "delaunay": _delaunay,
    "laplacian": _laplacian,
    "hodge": _hodge,
    "dec": _dec,
    "geodesic": _geodesic,
    "willmore-flow": willmore_kernels,
    "curve-flow": curve_flow_kernels,
    "shell-sim": shell_kernels,
    "fluid-sim": fluid_kernels,
    "view": _view,
    "tradeoff": _tradeoff,
}
