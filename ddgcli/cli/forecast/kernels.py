"""Kernels that a command runs for its options, and how often."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ddgcli.cli.forecast.curvature_kernels import curvature_kernels
from ddgcli.cli.forecast.delaunay_kernels import (
    DEFICIT_OF_MEASURED_FACE,
    MEASURED_REFINEMENT_DEGREES,
    delaunay_kernels,
)
from ddgcli.cli.forecast.geodesic_kernels import geodesic_kernels
from ddgcli.cli.forecast.simulator_kernels import (
    curve_flow_kernels,
    fluid_kernels,
    shell_kernels,
    willmore_kernels,
)
from ddgcli.cli.forecast.use import KNOWN, InputSize, Range, Use, iterative_suffix

__all__ = ["kernels_of"]

MEASURED_EIGENFORMS = 4
PAIRS_PER_FACTOR = 80  # eigenforms whose solves take as long as the first four
# eigenforms whose orthogonalisation takes as long; it grows as their square
PAIRS_PER_ORTHOGONAL_BASIS = 155.0
PAIRS_PER_SOLUTIONS = 17.0  # PAIRS_PER_FACTOR, where each solution is iterative
MEASURED_EIGENPAIRS = 8  # of the kernel `laplacian eigen`
# between the powers of the factors' memory (0.45: a mat of one layer has 0.54 of a cube's) and seconds (0.15)
COMPACTNESS_POWER = 0.3
# components that are copies of one another have multiple eigenvalues, which Lanczos finds in several passes
MAX_FAST_COPIES, COPIES_FACTOR = 4, 4.0
COPIES: dict[str, Any] = {"range": (0.4, 1.6), "assumes": "multiple eigenvalues of equal components"}
HARMONIC_FIELD_MEMORY = 4.0  # edge values and vectors on faces, over the memory of an eigenpair
MEASURED_SMOOTHING_STEPS = 10
MEASURED_WAVE_STEPS = 100
SMOOTH_START_RANGE: Range = (0.4, 1.0)
MEASURED_HEAT_FRAMES, DEFAULT_EVOLUTION_FRAMES = 2, 50
PAGE_PIXELS = 1400 * 1050  # of a picture without --size
# frames on the page of a run, which shows the first one too; those of the measured page, and the part of each
MAX_PICTURE_FRAMES, MEASURED_PICTURE_FRAMES, PAGE_SHARE_OF_FRAME = 4, 2, 1 / 6
PAGE_PIXELS_OF_RUN = 1800 * 2160
FURTHER_PICTURE = 0.05  # seconds beside the pixels, over those of the first, which loads the library
PICTURES = (".png", ".svg", ".pdf", ".gif", ".mp4")
BALL_SHARE = 0.65  # of the seconds of a comparison of curvature on a sphere: rows that clip faces
MAX_COMPARED_FACES, TRADEOFF_RANGE = 14_000, (0.1, 5.0)  # on larger meshes the budget bounds the rows
REFINED_SHARE = 0.75  # of the rows of triangulations on the measured mesh, that of their refinements
CONFORMAL_MAP_RANGE: Range = (0.7, 4.0)  # by the distance of the second eigenvalue


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
        Number of pixels of a picture.
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
    solver = iterative_suffix(options)
    if options.get("poisson") or options.get("harmonic"):
        yield Use(f"laplacian poisson{solver}")
    yield from _eigenpairs(options, size, solver)
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
        yield _eigenforms(options["form_eigen"], size, solver)
    yield from _evolution(options, size, solver)


def _eigenpairs(options: Mapping[str, Any], size: InputSize, solver: str) -> Iterator[Use]:
    """Kernels of eigenpairs, and of those of heat kernel signatures."""
    pairs = max(options.get("eigen") or 0, size.laplacian.signature_pairs)
    if pairs:
        computed = pairs - size.laplacian.n_components + 1  # the constants of the components are known
        yield Use(f"laplacian eigen{solver}", elements=None if computed > 0 else 0)
        if (further := computed - MEASURED_EIGENPAIRS) > 0:
            use = Use(f"laplacian eigenpair{solver}", further, added=pairs - MEASURED_EIGENPAIRS)
            copies = size.laplacian.equal_components > MAX_FAST_COPIES
            yield replace(use, times=COPIES_FACTOR * further, **COPIES) if copies else use


def _eigenforms(count: int, size: InputSize, solver: str) -> Use:
    """Kernel of eigenforms."""
    # the factor and the count of what is missing are most of the cost
    further = count - MEASURED_EIGENFORMS
    compactness = size.laplacian.compactness
    elements = None if compactness == 1.0 else size.elements * compactness**COMPACTNESS_POWER
    per_pair = PAIRS_PER_SOLUTIONS if solver else PAIRS_PER_FACTOR
    times = 1.0 + further / per_pair
    if not solver:  # each vector is made orthogonal to all before it
        times += (further / PAIRS_PER_ORTHOGONAL_BASIS) ** 2
    return Use(f"laplacian form-eigen{solver}", times, elements=elements)


def _evolution(options: Mapping[str, Any], size: InputSize, solver: str) -> Iterator[Use]:
    """Kernels of heat and waves."""
    if options.get("heat"):
        # steps cost nothing, frames do; a smooth start takes a third of the solves of a vertex
        known = str(options["heat"]).isdigit()
        yield Use(
            f"laplacian heat{solver}",
            range=KNOWN if known else SMOOTH_START_RANGE,
            assumes="" if known else "as many solves as for a rough start",
        )
        n_frames = min(options.get("n_frames") or DEFAULT_EVOLUTION_FRAMES, size.steps or MEASURED_WAVE_STEPS)
        if (further := n_frames - MEASURED_HEAT_FRAMES) > 0:
            yield Use("laplacian heat frame", further, added=further)
    if options.get("wave"):
        steps = (size.steps or MEASURED_WAVE_STEPS) / MEASURED_WAVE_STEPS
        known = options.get("time_step") or str(options["wave"]).isdigit() or steps <= 1
        spread = 1.0 if known else math.sqrt(steps)
        yield Use(
            f"laplacian wave{solver}",
            steps / spread,
            once=True,
            range=(1.0 / spread, spread),
            assumes=""
            if known
            else f"{100 * spread:.0f} steps: fewer for a smooth start, more for a rough one",
        )


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
    elements = size.tradeoff.share * min(size.elements, MAX_COMPARED_FACES)
    times, assumes = 1.0, "rows as of a sphere"
    deficit = size.delaunay.angle_deficit
    if compared == "delaunay" and deficit is not None:
        refined = deficit / max(DEFICIT_OF_MEASURED_FACE * size.elements, 1.0)
        of_measured = 1.0 - REFINED_SHARE + REFINED_SHARE * refined
        times = of_measured * size.elements / max(elements, 1.0)
        assumes = "rows with Steiner points by angles"
    if compared == "curvature":
        times, assumes = 1.0 - BALL_SHARE + BALL_SHARE * size.tradeoff.ball_work, "no noise to search"
    yield Use(f"tradeoff {compared}", times, elements=elements, range=TRADEOFF_RANGE, assumes=assumes)


_KERNELS: dict[str, Callable[[Mapping[str, Any], InputSize], Iterator[Use]]] = {
    "info": _info,
    "repair": _repair,
    "examples": _nothing,
    "check": _nothing,
    "curvature": curvature_kernels,
    "delaunay": delaunay_kernels,
    "laplacian": _laplacian,
    "hodge": _hodge,
    "dec": _dec,
    "geodesic": geodesic_kernels,
    "willmore-flow": willmore_kernels,
    "curve-flow": curve_flow_kernels,
    "shell-sim": shell_kernels,
    "fluid-sim": fluid_kernels,
    "view": _view,
    "tradeoff": _tradeoff,
}
