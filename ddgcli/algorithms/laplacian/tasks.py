"""What `ddgcli laplacian` computes: every task that was asked for, with arrays, results and accuracy."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.laplacian.choice import (
    LaplaceOperator,
    laplace_operator,
    negative_weights,
    symmetry_residual,
)
from ddgcli.errors import ParameterError
from ddgcli.linalg.residual_gate import within_residuals
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.progress import ProgressCallback

if TYPE_CHECKING:
    from ddgcli.algorithms.laplacian.smooth import Smoothed

log = logging.getLogger("ddgcli")
RESIDUALS = (
    "eigen_residuals", "poisson_residual", "harmonic_residual", "parameterize_residual", "smooth_residual",
    "row_sum_residual", "symmetry_residual",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Tasks:
    """What is asked of a Laplacian.

    Parameters
    ----------
    operator, mass : str
        See `laplace_operator`.
    eigen : int, optional
        Number of eigenpairs.
    poisson : (n,) ndarray, optional
        Source of a Poisson problem.
    harmonic : bool
        Interpolate the fixed values.
    fixed : mapping of vertex to value
    smooth : float, optional
        Time of mean curvature flow, in `smooth_steps` steps (10), by `smooth_flow` ('mean-curvature').
    parameterize : {'harmonic', 'conformal'}, optional
    hks : sequence of float
        Times of heat kernel signatures.
    seed : int
    """

    operator: str | None = None
    mass: str = "lumped"
    eigen: int | None = None
    poisson: NDArray | None = None
    harmonic: bool = False
    fixed: Mapping[int, float] = field(default_factory=dict)
    smooth: float | None = None
    smooth_steps: int | None = None
    smooth_flow: str | None = None
    parameterize: str | None = None
    hks: tuple[float, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        if self.harmonic and not self.fixed:
            raise ParameterError("--harmonic interpolates fixed values; add --fix ID=VALUE")
        if self.fixed and not self.harmonic and self.poisson is None:
            raise ParameterError("--fix belongs to --harmonic or --poisson; add one of them")
        if self.smooth_steps is not None and self.smooth is None:
            raise ParameterError("--smooth-steps belongs to --smooth TIME; add that")
        if self.smooth_flow is not None and self.smooth is None:
            raise ParameterError("--smooth-flow belongs to --smooth TIME; add that")


@dataclass(eq=False)
class Report:
    """Arrays on vertices, results, accuracy, and whether everything converged; `mesh` moves by smoothing."""

    mesh: TriangleMesh
    operator: LaplaceOperator
    vertex: dict[str, NDArray] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)
    accuracy: dict[str, Any] = field(default_factory=dict)
    converged: bool = True

    @property
    def annotated(self) -> AnnotatedMesh:
        return AnnotatedMesh(self.mesh, vertex=self.vertex)

    @property
    def shown(self) -> tuple[str, NDArray]:
        """Name and values of the array that a picture shows: the first that is more than a constant."""
        names = [name for name in self.vertex if name != "vertex_area"] + ["vertex_area"]
        name = next((n for n in names if np.ptp(self.vertex[n]) > 0), names[0])
        values = self.vertex[name]
        return name, values if values.ndim == 1 else np.linalg.norm(values, axis=1)


def laplacian_report(mesh: TriangleMesh, tasks: Tasks, progress: ProgressCallback | None = None) -> Report:
    """Assemble the operator and do every task; `progress` is called with (done, total)."""
    operator = laplace_operator(mesh, tasks.operator, tasks.mass)
    L = operator.stiffness
    area = operator.mass @ np.ones(mesh.n_vertices)
    report = Report(mesh, operator, {"vertex_area": area})
    report.results = {
        "operator": operator.name,
        "mass": operator.mass_name,
        "unknowns": L.shape[0],
        "nonzeros": int(L.nnz),
        "area": float(area.sum()),
        **operator.facts,
    }
    row_sum = np.abs(L @ np.ones(L.shape[0])).max()
    report.accuracy = {
        "negative_weights": negative_weights(L),
        "symmetry_residual": symmetry_residual(L),
        "row_sum_residual": float(row_sum / (abs(L).max() or 1.0)),
    }
    chores: list[tuple[Any, Callable[[Report, Tasks, ProgressCallback], None]]] = [
        (tasks.eigen or tasks.hks, _eigen),
        (tasks.poisson is not None, _poisson),
        (tasks.harmonic, _harmonic),
        (tasks.parameterize, _parameterize),
        (tasks.smooth, _smooth),
    ]
    asked = [chore for wanted, chore in chores if wanted]
    for before, chore in enumerate(asked, start=1):
        report_progress = _share_of(progress, before, len(asked) + 1)
        report_progress(0, 1)
        chore(report, tasks, report_progress)
    # the maximum principle holds for non-negative weights only
    principle = () if report.accuracy["negative_weights"] else ("maximum_principle_violation",)
    report.converged &= within_residuals(
        report.accuracy,
        (*RESIDUALS, *principle),
        "the triangles leave the system too ill-conditioned; repair the mesh",
    )
    return report


def _share_of(progress: ProgressCallback | None, before: int, parts: int) -> ProgressCallback:
    """Callback of one of several parts of the work, after `before` of them."""
    if progress is None:
        return lambda done, total: None
    return lambda done, total: progress(before + done / total, parts)


def _eigen(report: Report, tasks: Tasks, progress: ProgressCallback) -> None:
    from ddgcli.algorithms.laplacian.spectrum import heat_kernel_signature, signature_pairs, spectrum

    k = tasks.eigen or 0
    if tasks.hks:
        k = max(k, signature_pairs(report.operator, tasks.hks))
    pairs = spectrum(report.operator, k, seed=tasks.seed, progress=progress)
    report.converged &= pairs.complete
    if tasks.eigen is not None:
        shown = slice(tasks.eigen)
        report.vertex |= {f"eigenvector_{i:03d}": v for i, v in enumerate(pairs.vectors.T[shown])}
        report.results["eigenvalues"] = pairs.values[shown].tolist()
    report.accuracy["eigen_residuals"] = pairs.residuals.tolist()
    report.accuracy["eigen_complete"] = pairs.complete
    if tasks.hks:
        signature = heat_kernel_signature(pairs, np.array(tasks.hks))
        report.vertex |= {f"hks_{i:03d}": v for i, v in enumerate(signature.values.T)}
        report.results["hks_times"] = list(tasks.hks)
        report.results["hks_eigenpairs"] = k
        report.accuracy["hks_truncation"] = signature.truncation.tolist()


def _poisson(report: Report, tasks: Tasks, progress: ProgressCallback) -> None:
    if tasks.poisson is None:
        return
    from ddgcli.algorithms.laplacian.poisson import poisson

    solution = poisson(report.operator, tasks.poisson, tasks.fixed)
    report.vertex["poisson"] = solution.values
    report.results["poisson"] = _summary(report.operator, solution.values)
    report.accuracy["poisson_residual"] = solution.residual
    report.accuracy["poisson_imbalance"] = solution.imbalance


def _harmonic(report: Report, tasks: Tasks, progress: ProgressCallback) -> None:
    from ddgcli.algorithms.laplacian.poisson import harmonic

    solution = harmonic(report.operator, tasks.fixed)
    report.vertex["harmonic"] = solution.values
    report.results["harmonic"] = _summary(report.operator, solution.values)
    values = np.array(list(tasks.fixed.values()))
    beyond = max(solution.values.max() - values.max(), values.min() - solution.values.min(), 0.0)
    report.accuracy["harmonic_residual"] = solution.residual
    violation = float(beyond / (np.ptp(values) or np.abs(values).max() or 1.0))
    report.accuracy["maximum_principle_violation"] = violation


def _summary(operator: LaplaceOperator, u: NDArray) -> dict[str, Any]:
    energy = 0.5 * float(np.sum(u * (operator.stiffness @ u)))
    return {"min": float(u.min()), "max": float(u.max()), "dirichlet_energy": energy}


def _parameterize(report: Report, tasks: Tasks, progress: ProgressCallback) -> None:
    if tasks.parameterize is None:
        return
    from ddgcli.algorithms.laplacian.parameterize import parameterize_conformal, parameterize_harmonic

    flatten = {"harmonic": parameterize_harmonic, "conformal": parameterize_conformal}[tasks.parameterize]
    flat = flatten(report.mesh, report.operator)
    report.vertex["uv"] = flat.uv
    report.results |= {
        "parameterization": tasks.parameterize,
        "flipped_triangles": flat.flipped,
        "flipped_input_triangles": flat.flipped_input,
        "collapsed_input_triangles": flat.collapsed_input,
        "conformal_distortion": {"mean": flat.distortion_mean, "max": flat.distortion_max},
    }
    report.accuracy["parameterize_residual"] = flat.residual
    report.converged &= flat.converged


def _smooth(report: Report, tasks: Tasks, progress: ProgressCallback) -> None:
    if tasks.smooth is None:
        return
    from ddgcli.algorithms.laplacian.smooth import FLOWS, sensible_times, smooth

    before = report.mesh
    flow = tasks.smooth_flow or FLOWS[0]
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
    report.mesh = smoothed.mesh
    report.vertex["displacement"] = smoothed.mesh.points - before.points
    report.results |= {
        "smooth_flow": flow,
        "smooth_time": smoothed.time,
        "smooth_sensible_time": {"noise": edge, "shape": shape},
        "smooth_area": {"before": smoothed.area[0], "after": smoothed.area[-1]},
        "smooth_collapsed_vertices": smoothed.collapsed,
    }
    report.accuracy["smooth_residual"] = smoothed.residual
    report.accuracy["smooth_area_increases"] = int((np.diff(smoothed.area) > 0).sum())
    report.accuracy["smooth_box_growth"] = smoothed.box_growth
    report.converged &= smoothed.in_box and smoothed.time >= tasks.smooth * (1 - 1e-9)
    _warn_of_smoothing(smoothed, tasks.smooth, f"{edge:.2g} removes noise, {shape:.2g} changes the shape")


def _warn_of_smoothing(smoothed: Smoothed, time: float, advice: str) -> None:
    """Report what smoothing did to the surface beside smoothing it."""
    if smoothed.time < time * (1 - 1e-9):
        log.warning(
            "the surface vanished at time %g of %g: take a shorter time (%s)", smoothed.time, time, advice
        )
    elif smoothed.collapse_time is not None:
        log.warning(
            "thin parts with %d vertices shrank to lines or points after time %g: take a shorter time (%s), "
            "or the flow 'conformalized', which seldom pinches",
            smoothed.collapsed,
            smoothed.collapse_time,
            advice,
        )
    if not smoothed.in_box:
        log.warning(
            "the bounding box grew by %.2g of its diagonal, which mean curvature flow never does: the "
            "operator has negative weights, or the mass matrix couples vertices; take the operator "
            "'intrinsic-delaunay' or 'tufted' with mass 'lumped' or 'voronoi'",
            smoothed.box_growth,
        )
