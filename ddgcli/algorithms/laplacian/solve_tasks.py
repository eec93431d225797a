"""Solve tasks with the Laplacian of a mesh: spectra, Poisson problems, smoothing, parameterization."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.laplacian.check_tasks import check_tasks
from ddgcli.algorithms.laplacian.laplace_operator import (
    LaplaceOperator,
    laplace_operator,
    negative_weights,
    symmetry_residual,
)
from ddgcli.algorithms.laplacian.tasks import LaplacianResult, LaplacianTasks
from ddgcli.choices import CONFORMAL_BOUNDARIES, ITERATIVE_SOLVERS, SMOOTHING_FLOWS
from ddgcli.errors import counted, renamed_parameters
from ddgcli.geometry.extrinsic import face_area_vector
from ddgcli.geometry.remedies import remedy_for_bad_shapes
from ddgcli.linalg.residual_gate import within_residuals
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import vector_length
from ddgcli.progress import ProgressCallback

if TYPE_CHECKING:
    from ddgcli.algorithms.laplacian.smooth import SmoothingResult

log = logging.getLogger("ddgcli")
RESIDUALS = (
    "eigen_residuals", "form_eigen_residuals", "poisson_residual", "harmonic_residual",
    "parameterize_residual", "smooth_residual", "row_sum_residual", "symmetry_residual",
    "angle_sum_residual", "layout_residual",
)  # fmt: skip

MAX_COLLAPSED_SHARE = (
    0.01  # of the vertices; with more of them on lines or points the surface has degenerated
)
MAX_TIME_ERROR = 0.1  # relative to the area at the end, above which steps are too long for the flow


def solve_laplacian_tasks(
    mesh: TriangleMesh | TetMesh, tasks: LaplacianTasks, progress: ProgressCallback | None = None
) -> LaplacianResult:
    """Assemble the operator and solve every task.

    Parameters
    ----------
    mesh : TriangleMesh or TetMesh
    tasks : LaplacianTasks
        Of tetrahedra without `smooth` and `parameterize`.
    progress : callable, optional
        Called with (completed, total).

    Returns
    -------
    LaplacianResult

    Raises
    ------
    MeshError
        For a mesh that the operator or a task does not support.
    ParameterError
    """
    solid = isinstance(mesh, TetMesh)
    check_tasks(mesh, tasks)
    operator = laplace_operator(mesh, tasks.operator, tasks.mass)
    L = operator.stiffness
    vertex_size = operator.mass @ np.ones(mesh.n_vertices)
    result = LaplacianResult(mesh, operator, {"vertex_volume" if solid else "vertex_area": vertex_size})
    result.results = {
        "operator": operator.name,
        "mass": operator.mass_name,
        "unknowns": L.shape[0],
        "nonzeros": int(L.nnz),
        **_size(mesh, operator, vertex_size),
        **operator.preparation,
    }
    row_sum = np.abs(L @ np.ones(L.shape[0])).max()
    result.accuracy = {
        "negative_weights": negative_weights(L),
        "symmetry_residual": symmetry_residual(L),
        "row_sum_residual": float(row_sum / (np.abs(L.data).max(initial=0.0) or 1.0)),
    }
    solvers: list[tuple[Any, Callable[[LaplacianResult, LaplacianTasks, ProgressCallback], None]]] = [
        (tasks.eigen or tasks.hks, _eigen),
        (tasks.form_eigen, _form_eigen),
        (tasks.poisson is not None, _poisson),
        (tasks.harmonic, _harmonic),
        (tasks.parameterize, _parameterize),
        (tasks.smooth, _smooth),
    ]
    selected = [solve for requested, solve in solvers if requested]
    for n_finished, solve in enumerate(selected, start=1):
        part_progress = _progress_of_part(progress, n_finished, len(selected) + 1)
        part_progress(0, 1)
        solve(result, tasks, part_progress)
    # the maximum principle holds for non-negative weights only
    principle = () if result.accuracy["negative_weights"] else ("maximum_principle_violation",)
    result.converged &= within_residuals(
        result.accuracy,
        (*RESIDUALS, *principle),
        partial(remedy_for_bad_shapes, mesh),
    )
    return result


def _size(mesh: TriangleMesh | TetMesh, operator: LaplaceOperator, vertex_size: NDArray) -> dict[str, float]:
    if isinstance(mesh, TetMesh):
        return {"volume": float(np.abs(mesh.signed_volume).sum())}
    if operator.name != "tufted" and "mollified_faces" not in operator.preparation:
        return {"area": float(vertex_size.sum())}
    # from positions: mollified side lengths of caps without height have more
    return {"area": float(vector_length(face_area_vector(mesh)).sum())}


def _progress_of_part(progress: ProgressCallback | None, n_finished: int, n_parts: int) -> ProgressCallback:
    """Progress callback of one part of the work, after `n_finished` of `n_parts` parts."""
    if progress is None:
        return lambda completed, total: None
    return lambda completed, total: progress(n_finished + completed / total, n_parts)


def _eigen(result: LaplacianResult, tasks: LaplacianTasks, progress: ProgressCallback) -> None:
    from ddgcli.algorithms.laplacian.spectrum import heat_kernel_signature, signature_pairs, spectrum

    k = tasks.eigen or 0
    if tasks.hks:
        k = max(k, signature_pairs(result.operator, tasks.hks))
    pairs = spectrum(result.operator, k, seed=tasks.seed, progress=progress)
    result.converged &= pairs.complete
    if tasks.eigen is not None:
        requested = slice(tasks.eigen)
        result.vertex |= {f"eigenvector_{i:03d}": v for i, v in enumerate(pairs.vectors.T[requested])}
        result.results["eigenvalues"] = pairs.values[requested].tolist()
    result.accuracy["eigen_residuals"] = pairs.residuals.tolist()
    result.accuracy["eigen_complete"] = pairs.complete
    _report_iterative(result, "eigen", pairs.solver)
    if tasks.hks:
        signature = heat_kernel_signature(result.operator, pairs, np.array(tasks.hks))
        result.vertex |= {f"hks_{i:03d}": v for i, v in enumerate(signature.values.T)}
        result.results["hks_times"] = list(tasks.hks)
        result.results["hks_eigenpairs"] = k
        result.accuracy["hks_truncation"] = signature.truncation.tolist()


def _report_iterative(result: LaplacianResult, task: str, solver: str) -> None:
    """Name the solver of a task where it is not a factorisation."""
    if solver in ITERATIVE_SOLVERS:
        result.accuracy[f"{task}_solver"] = solver


def _form_eigen(result: LaplacianResult, tasks: LaplacianTasks, progress: ProgressCallback) -> None:
    from ddgcli.algorithms.laplacian.form_spectrum import form_spectrum

    k = tasks.form_eigen or 0
    forms = form_spectrum(result.mesh, k, seed=tasks.seed, progress=progress)
    result.edge |= {f"eigenform_{i:03d}": form for i, form in enumerate(forms.pairs.vectors.T)}
    result.edge["edges"] = forms.edges
    result.face |= {f"eigenform_vectors_{i:03d}": vectors for i, vectors in enumerate(forms.fields)}
    result.results["form_eigenvalues"] = forms.pairs.values.tolist()
    result.results["harmonic_forms"] = forms.kernel
    result.accuracy["form_eigen_residuals"] = forms.pairs.residuals.tolist()
    result.accuracy["form_eigen_complete"] = forms.pairs.complete
    result.converged &= forms.pairs.complete


def _poisson(result: LaplacianResult, tasks: LaplacianTasks, progress: ProgressCallback) -> None:
    if tasks.poisson is None:
        return
    from ddgcli.algorithms.laplacian.poisson import poisson

    with renamed_parameters(source="poisson"):
        solution = poisson(result.operator, tasks.poisson, tasks.fixed)
    result.vertex["poisson"] = solution.values
    result.results["poisson"] = _summary(result.operator, solution.values)
    result.accuracy["poisson_residual"] = solution.residual
    result.accuracy["poisson_imbalance"] = solution.imbalance
    _report_iterative(result, "poisson", solution.solver)


def _harmonic(result: LaplacianResult, tasks: LaplacianTasks, progress: ProgressCallback) -> None:
    from ddgcli.algorithms.laplacian.poisson import harmonic

    solution = harmonic(result.operator, tasks.fixed)
    result.vertex["harmonic"] = solution.values
    result.results["harmonic"] = _summary(result.operator, solution.values)
    summary = result.results["harmonic"]
    has_mass = set(result.operator.referenced_vertices.tolist())
    values = np.array([value for vertex, value in tasks.fixed.items() if vertex in has_mass])
    beyond = max(summary["max"] - values.max(), values.min() - summary["min"], 0.0)
    result.accuracy["harmonic_residual"] = solution.residual
    _report_iterative(result, "harmonic", solution.solver)
    violation = float(beyond / (np.ptp(values) or np.abs(values).max() or 1.0))
    result.accuracy["maximum_principle_violation"] = violation


def _summary(operator: LaplaceOperator, u: NDArray) -> dict[str, Any]:
    with np.errstate(over="ignore", invalid="ignore"):
        energy = 0.5 * float(np.sum(u * (operator.stiffness @ u)))
    values = u[operator.referenced_vertices]  # no equation holds at other vertices
    return {"min": float(values.min()), "max": float(values.max()), "dirichlet_energy": energy}


def _parameterize(result: LaplacianResult, tasks: LaplacianTasks, progress: ProgressCallback) -> None:
    if tasks.parameterize is None:
        return
    if tasks.parameterize == "discrete-conformal":
        _map_conformally(result, tasks, progress)
        return
    from ddgcli.algorithms.laplacian.parameterize import parameterize_conformal, parameterize_harmonic

    flatten = {"harmonic": parameterize_harmonic, "conformal": parameterize_conformal}[tasks.parameterize]
    flat = flatten(result.surface, result.operator)
    result.vertex["uv"] = flat.uv
    result.face |= flat.distortion
    result.results |= {
        "parameterization": tasks.parameterize,
        "flipped_triangles": flat.flipped,
        "flipped_input_triangles": flat.flipped_input,
        "collapsed_input_triangles": flat.collapsed_input,
        "conformal_distortion": {"mean": flat.distortion_mean, "max": flat.distortion_max},
    }
    result.accuracy["parameterize_residual"] = flat.residual
    result.converged &= flat.converged


def _map_conformally(result: LaplacianResult, tasks: LaplacianTasks, progress: ProgressCallback) -> None:
    from ddgcli.algorithms.conformal.conformal_map import conformal_map

    flat = conformal_map(
        result.surface,
        cones=tasks.cones,
        boundary=tasks.boundary or CONFORMAL_BOUNDARIES[0],
        boundary_values=tasks.boundary_values,
        operator=tasks.operator,
        progress=progress,
    )
    result.conformal = flat
    result.vertex |= {"log_scale_factor": flat.scale, "angle_sum": flat.metric.angle}
    uv = flat.uv
    if uv is not None:
        result.vertex["uv"] = uv
        result.face |= flat.distortion()
    result.results |= {"parameterization": tasks.parameterize, **flat.summary}
    result.accuracy |= flat.accuracy
    result.converged &= flat.converged


def _smooth(result: LaplacianResult, tasks: LaplacianTasks, progress: ProgressCallback) -> None:
    if tasks.smooth is None:
        return
    from ddgcli.algorithms.laplacian.smooth import latest_end, sensible_times, smooth

    before = result.surface
    flow = tasks.smooth_flow or SMOOTHING_FLOWS[0]
    with renamed_parameters(time="smooth", steps="smooth_steps", flow="smooth_flow"):
        smoothed = smooth(
            before,
            tasks.smooth,
            steps=tasks.smooth_steps or 10,
            flow=flow,
            operator=tasks.operator,
            mass=tasks.mass,
            progress=progress,
        )
    edge, shape = sensible_times(before)
    result.mesh = smoothed.mesh
    result.vertex["displacement"] = smoothed.mesh.points - before.points
    result.results |= {
        "smooth_flow": flow,
        "smooth_time": smoothed.time,
        "smooth_sensible_time": {"noise": edge, "shape": shape},
        "smooth_area": {"before": smoothed.area[0], "after": smoothed.area[-1]},
        "smooth_collapsed_vertices": smoothed.collapsed,
    }
    result.accuracy["smooth_residual"] = smoothed.residual
    result.accuracy["smooth_area_increases"] = int((np.diff(smoothed.area) > 0).sum())
    result.accuracy["smooth_box_growth"] = smoothed.box_growth
    result.accuracy["smooth_time_error"] = smoothed.time_error
    result.converged &= smoothed.in_box and smoothed.time >= tasks.smooth * (1 - 1e-9)
    result.converged &= smoothed.collapsed <= MAX_COLLAPSED_SHARE * before.n_vertices
    result.converged &= smoothed.time_error < 1.0
    end = np.inf if flow == "conformalized" else latest_end(before)
    sensible = {"removes noise": edge, "changes the shape": shape}
    _warn_of_smoothing(smoothed, tasks.smooth, flow, sensible, end)


def _warn_of_smoothing(
    smoothed: SmoothingResult, time: float, flow: str, sensible: dict[str, float], end: float
) -> None:
    """Warn if smoothing collapsed parts of the surface, took long steps or enlarged its bounding box.

    `end` is a time by which the flow itself has ended.
    """
    vanished = smoothed.time < time * (1 - 1e-9)
    too_long = smoothed.time if vanished or smoothed.collapse_time is None else smoothed.collapse_time
    too_long = min(too_long, end) if vanished else too_long
    shorter = ", ".join(f"{t:.2g} {effect}" for effect, t in sensible.items() if t < too_long)
    advice = f"use a shorter time{shorter and f' ({shorter})'}"
    if vanished:
        # a step without a solution has no end; long steps outlive the flow itself
        when = "before" if smoothed.has_vanished else "after"
        gone = f" (the flow itself ends by time {end:.3g})" if end < smoothed.time else ""
        log.warning("the surface vanished %s time %g of %g%s: %s", when, smoothed.time, time, gone, advice)
    elif smoothed.collapse_time is not None:
        other = "" if flow == "conformalized" else ", or `smooth_flow=conformalized`, which seldom pinches"
        log.warning(
            "thin parts with %s shrank to lines or points after time %g: %s",
            counted(smoothed.collapsed, "vertex", "vertices"),
            smoothed.collapse_time,
            advice + other,
        )
    elif smoothed.time_error >= 1:
        log.warning("the flow ends before time %g, and the steps are too long to show it: %s", time, advice)
    elif smoothed.time_error > MAX_TIME_ERROR:
        log.warning(
            "the steps are too long: about %.0f %% of the area at the end would be gone; use more than "
            "`smooth_steps=%d`, or a shorter time",
            100 * smoothed.time_error,
            len(smoothed.area) - 1,
        )
    if not smoothed.in_box:
        log.warning(
            "the bounding box grew by %.2g of its diagonal, which mean curvature flow never does: the "
            "operator has negative weights, or the mass matrix couples vertices; use "
            "`operator=intrinsic-delaunay` or `operator=tufted` with `mass=lumped` or `mass=voronoi`",
            smoothed.box_growth,
        )
