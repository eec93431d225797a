"""The whole error of a row: the error in time on its mesh, and the distance of that mesh from finer ones."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import DdgError, SolveError
from ddgcli.tradeoff.candidates import ROUNDING, UNKNOWN, ErrorNorms, MeshLimit, Problem, Reference, Table
from ddgcli.tradeoff.certainty import AnswerDeviation
from ddgcli.tradeoff.time_budget import REFERENCE_SHARE, BudgetExceeded, TimeBudget

MIN_STEP_RATIO = 4.0  # of the steps of a method from which its time error is expected to fall
MAX_STEADY_RATIO = 0.7  # of its time errors above which it does not; 1/4 with a method of first order


@dataclass(frozen=True)
class WholeError:
    """Error that a row is compared by, its parts, and its uncertainty.

    Attributes
    ----------
    error, uncertainty : ErrorNorms
        The uncertainty is infinite where a part is not known.
    time_error, mesh_error : ErrorNorms or None
        None where the error has no parts, or the part is not known.
    worst : int or None
        Entry of the largest error; None where it is not known.
    is_reference : bool
        Whether the answer is the reference, whose uncertainty is then the error.
    deviation : AnswerDeviation or None
        Of the answer, from what the error is measured against; None where rows share more than that.
    """

    error: ErrorNorms
    uncertainty: ErrorNorms
    time_error: ErrorNorms | None
    mesh_error: ErrorNorms | None
    worst: int | None
    is_reference: bool = False
    deviation: AnswerDeviation | None = None


def whole_error(
    problem: Problem, answer: NDArray, errors: NDArray, reference: Reference, mesh_limit: MeshLimit | None
) -> WholeError:
    """Error of a row: its distance from the limit of fine meshes, or a part of it.

    The parts are its error on this mesh, and the distance of the mesh from finer ones; where they cancel, the
    distance is smaller than either. Without a limit of fine meshes the error is that on this mesh. An answer
    that equals an uncertain reference is as wrong as the reference is: its error there is not zero.

    Parameters
    ----------
    problem : Problem
    answer : ndarray
    errors : (k,) ndarray of float64
        Of the answer against the reference on the same mesh.
    reference : Reference
    mesh_limit : MeshLimit or None

    Returns
    -------
    WholeError
    """
    first = ErrorNorms.of(errors)
    worst = int(errors.argmax()) if len(errors) else 0
    is_reference = first.max == 0.0 and reference.uncertainty > ROUNDING
    if is_reference:
        first = reference.bounds
    at = None if is_reference else worst
    if problem.error_part in ("", "time"):
        time_error = first if problem.error_part else None
        deviation = AnswerDeviation(answer, reference.values, problem.error)
        return WholeError(first, reference.bounds, time_error, None, at, is_reference, deviation)
    if mesh_limit is None:
        return WholeError(first, UNKNOWN, first, None, at, is_reference)
    distance = np.asarray(problem.error(mesh_limit.values, reference.values), dtype=np.float64)
    second = ErrorNorms.of(distance)
    if problem.error_part == "mesh":
        uncertainty = reference.bounds + mesh_limit.uncertainty
        return WholeError(second, uncertainty, first, second, int(distance.argmax()))
    whole = np.asarray(problem.error(answer, mesh_limit.values), dtype=np.float64)
    return WholeError(
        ErrorNorms.of(whole), mesh_limit.uncertainty, first, second, int(whole.argmax()),
        deviation=AnswerDeviation(answer, mesh_limit.values, problem.error),
    )  # fmt: skip


def find_mesh_limit(problem: Problem, time_budget: TimeBudget, table: Table) -> None:
    """Set the table's limit of fine meshes, the most accurate within its share of the budget, or the reason.

    Parameters
    ----------
    problem : Problem
    time_budget : TimeBudget
    table : Table
        Its `mesh_limit` is set.

    Raises
    ------
    SolveError
        If rows are to be compared by the mesh error alone, and there is no limit.
    """
    if problem.error_part not in ("mesh", "both"):
        return
    for work, compute in problem.mesh_limits:
        share = REFERENCE_SHARE * time_budget.seconds_left()
        estimate = time_budget.estimate_like(problem.candidates[0], work)
        if estimate > share:
            table.mesh_failure = time_budget.beyond(estimate, share)
            continue
        try:
            with time_budget.limit_time(share):
                table.mesh_limit = compute()
                table.mesh_failure = ""
                return
        except BudgetExceeded:
            table.mesh_failure = f"stopped after {share:.3g} s"
        except DdgError as error:
            table.mesh_failure = str(error)
    if problem.error_part == "mesh":
        raise SolveError(f"the mesh error is not known: {table.mesh_failure}; use `error=time`")


def find_polyhedron_error(
    problem: Problem, reference: Reference, time_budget: TimeBudget, table: Table
) -> None:
    """Set the distance of a polyhedron's answer from that of a smooth surface, if the budget allows it.

    Parameters
    ----------
    problem : Problem
    reference : Reference
    time_budget : TimeBudget
    table : Table
        Its `polyhedron_error` is set.
    """
    if problem.smooth is None or reference.is_truth:
        return
    work, compute = problem.smooth
    left = time_budget.seconds_left()
    if problem.candidates and time_budget.estimate_like(problem.candidates[-1], work) > left:
        return
    with contextlib.suppress(BudgetExceeded, DdgError), time_budget.limit_time(left):
        distance = np.asarray(problem.error(compute(), reference.values), dtype=np.float64)
        if np.isfinite(distance).all():
            table.polyhedron_error = ErrorNorms.of(distance)


def mesh_bound_methods(table: Table, norm: str) -> list[str]:
    """Methods whose time error does not fall with the step taken: it is their own error on this mesh.

    Parameters
    ----------
    table : Table
    norm : {'max', 'mean'}

    Returns
    -------
    list of str
    """
    uncertainty = table.reference.error_bound(norm) if table.reference else 0.0
    lines: dict[str, list[tuple[float, float]]] = {}
    for row in table.rows:
        if row.time_error is not None and "dt" in row.parameters:
            step = row.step_taken or row.parameters["dt"]
            lines.setdefault(row.method, []).append((step, row.time_error.at(norm)))
    names = []
    for method, line in lines.items():
        (shortest, least), (longest, most) = min(line), max(line)
        if shortest <= longest / MIN_STEP_RATIO and least > max(MAX_STEADY_RATIO * most, uncertainty):
            names.append(method)
    return names
