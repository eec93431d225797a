"""Cost of a run after its input is read: refuse what cannot fit, predict the rest for --dry-run."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ddgcli.cli.forecast.kernels import kernels_of
from ddgcli.cli.forecast.use import InputSize
from ddgcli.errors import ParameterError, excerpt

if TYPE_CHECKING:
    from ddgcli.cli.forecast.prediction import Prediction
    from ddgcli.mesh.fields import AnyMesh
    from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["check_cost", "dry_run_of", "predict_run", "refuse_run", "size_of"]

MIN_CHECKED_ELEMENTS = 100_000  # smaller inputs fit, and their runs need no prediction
SAMPLED_SIDES = 4_000  # of a mesh, for its roughness
MIN_ROUGH_TURN, MAX_ONE_SIGN = 0.09, 0.5  # radians; share of turns that have one sign only
DEFAULT_FRAME_COUNT = 50  # of flows with adaptive steps
CURES = {
    "laplacian": "use fewer eigenpairs, a coarser mesh, or a machine with more memory",
    "geodesic": "use --method fast-marching or heat, or a coarser mesh",
    "delaunay": "leave --refine and --overlay out, or use a coarser mesh",
    "curvature": "use --scheme cotan, or a coarser mesh",
    "frames": "select fewer frames with --every",
    "view": "show fewer frames with --every, or a coarser mesh",
    "batch": "use fewer --jobs, or a coarser mesh",
}
DEFAULT_CURE = "use a coarser mesh, or a machine with more memory"


def size_of(mesh: AnyMesh, options: Mapping[str, Any]) -> InputSize:
    """Size of a mesh and of the steps that the options name."""
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.tet_mesh import TetMesh

    steps = options.get("steps")
    step = options.get("step") or options.get("time_step")
    if steps is None and options.get("duration") and step:
        steps = max(1, round(options["duration"] / step))
    adaptive = bool(options.get("tolerance") and options.get("duration"))
    if adaptive:
        every = options.get("frame_every")
        steps = max(1, round(options["duration"] / every)) if every else DEFAULT_FRAME_COUNT
    if isinstance(mesh, CurveSet):
        return InputSize("curve", mesh.n_vertices, steps=steps, adaptive=adaptive)
    if isinstance(mesh, TetMesh):
        return InputSize("tetrahedra", len(mesh.tetrahedra), steps=steps)
    edge_length = float(mesh.side_length.mean()) if options.get("radius") and len(mesh.faces) else None
    refine = options.get("refine")
    deficit = _angle_deficit(mesh, float(refine)) if refine else None
    rough = "scheme" in options and options.get("radius") in (None, "auto") and _is_rough(mesh)
    return InputSize(
        "surface", len(mesh.faces), edge_length, steps, angle_deficit=deficit, rough=rough, adaptive=adaptive
    )


def _is_rough(mesh: TriangleMesh | IntrinsicMesh) -> bool:
    """Whether faces turn against their neighbours by large angles of both signs, in a sample of sides.

    Mean turns are 0.1 to 0.25 on noise and on scans, of both signs; on smooth surfaces of more than a
    thousand faces they are smaller, or of one sign.
    """
    import numpy as np

    from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
    from ddgcli.mesh.vectors import unit_vectors

    if isinstance(mesh, IntrinsicMesh):
        return False
    faces, twin = mesh.faces, mesh.topology.side_twin[:, 0]
    face = np.flatnonzero(twin >= 0)
    face = face[:: max(1, len(face) // SAMPLED_SIDES)]
    side = twin[face]
    a, b = mesh.points[faces[face]], mesh.points[faces[side // 3]]
    first, second = (unit_vectors(np.stack([x[:, k] - x[:, 0] for x in (a, b)])) for k in (1, 2))
    n, m = unit_vectors(np.cross(first, second))
    turn = np.arccos(np.clip((n * m).sum(axis=1), -1.0, 1.0))
    away = mesh.points[faces[side // 3, (side + 2) % 3]] - a[:, 0]
    sign = -np.sign((n * unit_vectors(away)).sum(axis=1))
    if not len(turn) or not np.isfinite(turn).all():
        return False
    return bool(turn.mean() > MIN_ROUGH_TURN and abs((sign * turn).mean()) < MAX_ONE_SIGN * turn.mean())


def _angle_deficit(mesh: TriangleMesh | IntrinsicMesh, degrees: float) -> float:
    """Sum over the faces of 1 - (smallest angle / degrees), where that is positive."""
    import numpy as np

    from ddgcli.geometry.intrinsic import corner_angle

    smallest = np.degrees(corner_angle(mesh.side_length)).min(axis=1, initial=180.0)
    return float(np.maximum(1.0 - smallest / degrees, 0.0).sum())


def predict_run(
    run: Any, size: InputSize, options: Mapping[str, Any] | None = None, earlier: Prediction | None = None
) -> Prediction:
    """Cost of a run on an input of a size; `options` replace those of the summary.

    Where factors do not fit into memory, conjugate gradients take their place, as they do in the run.
    `earlier` is a prediction of the same run, before which nothing was computed.
    """
    from ddgcli.cli.forecast.prediction import fits, predict

    common = run.common
    all_options = {**run.options, **(options or {})}
    all_options["solver"] = all_options.get("solver") or os.environ.get("DDGCLI_SOLVER")

    def prediction_of(solver: str | None) -> Prediction:
        uses = kernels_of(
            run.command, all_options | {"solver": solver}, size, common.outputs, common.plot is not None,
            common.exceeds_short_summary,
        )  # fmt: skip
        return predict(uses, size, calibrate=common.dry_run, earlier=earlier)

    prediction = prediction_of(all_options["solver"])
    if all_options["solver"] in (None, "auto") and not fits(prediction):
        prediction = min(prediction, prediction_of("multigrid"), key=lambda p: p.peak_mib)
    if run.command == "tradeoff":  # rows that the budget does not suffice for are left out
        most = prediction.read_seconds + all_options["budget"]
        low, high = (min(most, seconds) for seconds in prediction.seconds_range)
        return replace(prediction, seconds=min(most, prediction.seconds), seconds_range=(low, high))
    return prediction


def check_cost(run: Any, size: InputSize, options: Mapping[str, Any] | None = None) -> Prediction | None:
    """Cost of a run that fits into memory; None for small inputs, but in a dry run.

    Raises
    ------
    ParameterError
        The run needs more memory than is available.
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
    refuse_without_memory(prediction, what, CURES.get(run.command, DEFAULT_CURE))


def dry_run_of(words: Sequence[str]) -> dict[str, Any]:
    """Prediction of another command, made by a process of its own.

    Raises
    ------
    ParameterError
        The command refuses its input.
    """
    import json
    import subprocess
    import sys

    call = [sys.executable, "-m", "ddgcli", *words, "--dry-run", "--json"]
    process = subprocess.run(call, capture_output=True, encoding="utf-8", errors="replace")
    try:
        answer = json.loads(process.stdout)
        return answer.get("prediction") or answer["results"]
    except (ValueError, KeyError, AttributeError):
        last = (process.stderr.strip().splitlines() or ["no prediction"])[-1]
        raise ParameterError(excerpt(last.removeprefix("Error: "), 300)) from None
