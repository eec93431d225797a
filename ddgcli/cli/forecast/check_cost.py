"""Cost of a run after its input is read: an error if it does not fit into memory, else a prediction."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ddgcli.choices import MAX_POINTS_PER_VERTEX, MIN_MAX_POINTS
from ddgcli.cli.forecast.delaunay_kernels import MEASURED_REFINEMENT_DEGREES, needs_overlay
from ddgcli.cli.forecast.facts import DelaunayFacts, LaplacianFacts, TradeoffFacts
from ddgcli.cli.forecast.kernels import kernels_of
from ddgcli.cli.forecast.use import InputSize
from ddgcli.errors import MeshError, ParameterError, excerpt
from ddgcli.waiting import captured_run

if TYPE_CHECKING:
    from ddgcli.cli.forecast.prediction import Prediction
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.fields import AnyMesh
    from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["check_cost", "dry_run_of", "predict_run", "refined_prediction", "refuse_run", "size_of"]

MIN_CHECKED_ELEMENTS = 100_000  # smaller inputs fit into memory, and their runs need no prediction
COMPARISON_EXPONENT = 1.1  # the seconds of a comparison grow as the number of faces to this power
DEFAULT_FRAME_COUNT = 50  # frames of flows with adaptive steps
REMEDIES = {
    "laplacian": "use fewer eigenpairs, a coarser mesh, or a machine with more memory",
    "geodesic": "use --method fast-marching or heat, or a coarser mesh",
    "delaunay": "leave --refine and --overlay out, or use a coarser mesh",
    "curvature": "use --scheme cotan, or a coarser mesh",
    "frames": "select fewer frames with --every",
    "view": "show fewer frames with --every, or a coarser mesh",
    "batch": "use fewer --jobs, or a coarser mesh",
}
DEFAULT_REMEDY = "use a coarser mesh, or a machine with more memory"


def _step_count(duration: float, each: float) -> int:
    """Number of steps; at most one more than the limit, which is an error of the run itself."""
    from ddgcli.simulation.model import MAX_STEP_COUNT

    return max(1, round(min(duration / each, MAX_STEP_COUNT + 1)))


def size_of(mesh: AnyMesh, options: Mapping[str, Any]) -> InputSize:
    """Size of a mesh and of the steps that the options name."""
    from ddgcli.cli.forecast.mesh_facts import compactness, handles, signature_pairs
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.tet_mesh import TetMesh

    steps, adaptive = _steps(mesh, options)
    if isinstance(mesh, CurveSet):
        n_curves = _n_curves(mesh) if options.get("flow") else 1
        return InputSize("curve", mesh.n_vertices, steps, adaptive, n_curves=n_curves)
    if not isinstance(mesh, TetMesh):
        return _surface_size(mesh, options, InputSize("surface", len(mesh.faces), steps, adaptive))
    spectrum = LaplacianFacts(
        signature_pairs(mesh, options["hks"]) if options.get("hks") else 0,
        compactness=compactness(mesh) if options.get("form_eigen") else 1.0,
    )
    betti_number = handles(mesh.boundary) if "basis" in options else 0
    return InputSize("tetrahedra", len(mesh.tetrahedra), steps, betti_number=betti_number, laplacian=spectrum)


def _steps(mesh: AnyMesh, options: Mapping[str, Any]) -> tuple[int | None, bool]:
    """Number of steps from the options, or None; and whether these are frames with adaptive steps."""
    from ddgcli.cli.forecast.mesh_facts import wave_steps
    from ddgcli.mesh.curve import CurveSet

    duration, steps = options.get("duration"), options.get("steps")
    if duration and options.get("tolerance"):
        every = options.get("frame_every")
        return _step_count(duration, every) if every else DEFAULT_FRAME_COUNT, True
    step = options.get("step") or options.get("time_step")
    if steps is None and duration and step:
        steps = _step_count(duration, step)
    if steps is None and options.get("wave") and duration and not isinstance(mesh, CurveSet):
        steps = wave_steps(mesh, duration)
    return steps, False


def _surface_size(
    mesh: TriangleMesh | IntrinsicMesh, options: Mapping[str, Any], size: InputSize
) -> InputSize:
    """The size of a surface, with the properties on which the cost for these options depends."""
    from ddgcli.cli.forecast.curvature_kernels import compared_work
    from ddgcli.cli.forecast.curve_facts import curve_facts, has_curves
    from ddgcli.cli.forecast.mesh_facts import harmonic_fields, hole_triangles, offset_faces, picture_share
    from ddgcli.mesh.triangle_mesh import TriangleMesh

    size = replace(
        size,
        betti_number=harmonic_fields(mesh) if options.get("basis") else 0,
        hole_triangles=hole_triangles(mesh, options["fill_holes"]) if options.get("fill_holes") else 0.0,
        delaunay=_delaunay_facts(mesh, options),
        laplacian=_spectrum_facts(mesh, options),
    )
    if options.get("radius") and len(mesh.faces):
        size = size.with_curvature(edge_length=float(mesh.side_length.mean()))
    if not isinstance(mesh, TriangleMesh):
        return size
    if options.get("offset"):
        size = size.with_curvature(offset_faces=offset_faces(mesh, options))
    if options.get("compared") == "curvature" and len(mesh.faces):
        size = replace(size, tradeoff=TradeoffFacts(compared_work(mesh)))
    if has_curves(options):
        size = replace(size, geodesic=curve_facts(mesh, options))
    return replace(size, picture_share=picture_share(mesh)) if options.get("plot") else size


def _delaunay_facts(mesh: TriangleMesh | IntrinsicMesh, options: Mapping[str, Any]) -> DelaunayFacts:
    """Properties on which the cost of refinements and overlays depends."""
    from ddgcli.cli.forecast.mesh_facts import (
        angle_contrast,
        angle_deficit,
        corridor_aspect,
        crossings_per_root_face,
        delaunay_mesh,
    )

    degrees, overlaid = options.get("refine"), needs_overlay(options)
    if options.get("compared") == "delaunay" and len(mesh.faces) < MIN_CHECKED_ELEMENTS:
        degrees = degrees or MEASURED_REFINEMENT_DEGREES
    facts = DelaunayFacts(most_points=max(MIN_MAX_POINTS, MAX_POINTS_PER_VERTEX * mesh.n_vertices))
    if not (degrees or overlaid):
        return facts
    delaunay, further_faces = delaunay_mesh(mesh)
    if overlaid:
        facts = replace(facts, further_overlay_faces=further_faces)
    if not degrees:
        return facts
    degrees = float(degrees)
    return replace(
        facts,
        angle_deficit=angle_deficit(delaunay, degrees),
        angle_contrast=angle_contrast(delaunay, degrees),
        corridor_aspect=corridor_aspect(delaunay, degrees),
        crossings_per_root_face=crossings_per_root_face(mesh) if overlaid else 0.0,
    )


def _spectrum_facts(mesh: TriangleMesh | IntrinsicMesh, options: Mapping[str, Any]) -> LaplacianFacts:
    """Properties on which the cost of eigenpairs depends."""
    from ddgcli.cli.forecast.mesh_facts import component_counts, signature_pairs

    if not (options.get("hks") or options.get("eigen")):
        return LaplacianFacts()
    pairs = signature_pairs(mesh, options["hks"]) if options.get("hks") else 0
    return LaplacianFacts(pairs, *component_counts(mesh))


def _n_curves(mesh: CurveSet) -> int:
    try:
        return max(1, len(mesh.paths))
    except MeshError:  # curves that meet are an error of the command itself
        return 1


def predict_run(
    run: Any, size: InputSize, options: Mapping[str, Any] | None = None, earlier: Prediction | None = None
) -> Prediction:
    """Cost of a run on an input of a size; `options` replace those of the summary.

    If factors do not fit into memory, conjugate gradients are assumed, as in the run. `earlier` is an earlier
    prediction for the same run.
    """
    from ddgcli.cli.forecast.prediction import fits, predict

    common = run.common
    all_options = {**run.options, **(options or {})}
    all_options["solver"] = all_options.get("solver") or os.environ.get("DDGCLI_SOLVER")

    def prediction_of(solver: str | None, size: InputSize = size) -> Prediction:
        uses = kernels_of(
            run.command, all_options | {"solver": solver}, size, common.outputs, common.plot is not None,
            common.exceeds_short_summary, common.shows_all_results,
            *([math.prod(common.size)] if common.size else []),
        )  # fmt: skip
        return predict(uses, size, calibrate=common.dry_run, earlier=earlier)

    prediction = prediction_of(all_options["solver"])
    if all_options["solver"] in (None, "auto") and not fits(prediction):
        prediction = min(prediction, prediction_of("multigrid"), key=lambda p: p.peak_mib)
    if run.command == "tradeoff":  # rows that would exceed the time budget are not run
        most = prediction.read_seconds + all_options["budget"]
        low, high = (min(most, seconds) for seconds in prediction.seconds_range)
        share = min(1.0, most / prediction.seconds) ** (1.0 / COMPARISON_EXPONENT)
        fitted = replace(size, tradeoff=replace(size.tradeoff, share=share))
        fitting = prediction_of(all_options["solver"], fitted)
        return replace(fitting, seconds=min(most, prediction.seconds), seconds_range=(low, high))
    return prediction


def refined_prediction(
    run: Any, size: InputSize, mesh: AnyMesh, prediction: Prediction
) -> tuple[Prediction, InputSize]:
    """A prediction and its size with costlier properties of the mesh, which only affect predicted seconds."""
    from ddgcli.mesh.triangle_mesh import TriangleMesh

    if not isinstance(mesh, TriangleMesh) or not mesh.n_faces:
        return prediction, size
    from ddgcli.cli.forecast.mesh_facts import ball_work, edge_paths, has_sheared_fits, noise_of_vertices

    options = run.options
    propagates = options.get("method") in ("exact", "fast-marching")
    if run.command == "geodesic" and (propagates or options.get("isolines")):
        of_all, of_one = edge_paths(mesh, options)
        size = size.with_geodesic(paths=of_all, paths_of_one=of_one)
    elif run.command == "curvature":
        scheme, radius = options["scheme"], options.get("radius")
        if stated := radius not in (None, "auto"):
            size = size.with_curvature(ball_work=ball_work(mesh, float(radius), scheme))
        if scheme == "quadric" or not stated:
            noise, pairs = noise_of_vertices(mesh, scheme)
            size = size.with_curvature(noise=noise, fitted_pairs=pairs)
        if scheme == "quadric":
            size = size.with_curvature(sheared=has_sheared_fits(mesh))
    else:
        return prediction, size
    return predict_run(run, size, earlier=prediction), size


def check_cost(run: Any, size: InputSize, options: Mapping[str, Any] | None = None) -> Prediction | None:
    """Cost of a run; None for small inputs outside dry runs.

    Raises
    ------
    ParameterError
        If the run needs more memory than is available.
    """
    if not run.common.dry_run and size.elements * size.frame_count < MIN_CHECKED_ELEMENTS:
        return None
    prediction = predict_run(run, size, options)
    refuse_run(run, size, prediction)
    return prediction


def refuse_run(run: Any, size: InputSize, prediction: Prediction) -> None:
    """Raise ParameterError for a run that needs more memory than is available."""
    from ddgcli.cli.forecast.prediction import refuse_without_memory

    path = run.input.get("path") or run.command
    what = f"{path}: {run.command} on {size.elements:,} elements"
    refuse_without_memory(prediction, what, REMEDIES.get(run.command, DEFAULT_REMEDY))


def dry_run_of(words: Sequence[str]) -> dict[str, Any]:
    """Prediction of another command, by a dry run in a process of its own.

    Raises
    ------
    ParameterError
        If the input of the command is invalid.
    """
    import json
    import sys

    from ddgcli.cli.batch.process import MESSAGE_LENGTH

    call = [sys.executable, "-m", "ddgcli", *words, "--dry-run", "--json"]
    process = captured_run(call)
    try:
        return json.loads(process.stdout)["results"]
    except (ValueError, KeyError, TypeError):
        last = (process.stderr.strip().splitlines() or ["no prediction"])[-1]
        raise ParameterError(excerpt(last.removeprefix("Error: "), MESSAGE_LENGTH)) from None
