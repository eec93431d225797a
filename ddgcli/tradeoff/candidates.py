"""Candidates, references with their uncertainty, problems, and the rows of a comparison."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.representation import short_repr
from ddgcli.tradeoff.certainty import AnswerDeviation, is_surely_nearer

# options of the compared command that its caller set, by parameter name
CommandOptions = Mapping[str, Any]
NO_OPTIONS: CommandOptions = MappingProxyType({})


@dataclass(frozen=True)
class ErrorNorms:
    """Largest and mean of the entries of an error."""

    max: float
    mean: float

    @classmethod
    def of(cls, errors: NDArray) -> ErrorNorms:
        """Norms of (k,) relative errors; zero where there are none."""
        return cls(float(errors.max(initial=0.0)), float(errors.mean()) if len(errors) else 0.0)

    def at(self, norm: str) -> float:
        """Of the norm `max` or `mean`."""
        return self.max if norm == "max" else self.mean

    def __add__(self, other: ErrorNorms) -> ErrorNorms:
        return ErrorNorms(self.max + other.max, self.mean + other.mean)


ROUNDING = 1e-9  # an uncertainty of a reference below this does not matter to any comparison
ROUNDING_ERROR = 1e-11  # of answers that differ by rounding alone
UNKNOWN = ErrorNorms(float("inf"), float("inf"))


@dataclass(frozen=True, eq=False)
class Candidate:
    """One configuration of one method.

    Attributes
    ----------
    method : str
        Line in the picture.
    parameters : dict
        Its parameters and their values.
    setup : callable
        The set-up, which runs once; `solve` gets its result.
    solve : callable
        One query: the answer, in the form that the problem's reference has.
    arguments : dict
        Parameters of the command that runs this configuration, and their values as text.
    work : float
        Estimated seconds of set-up and one query; only ratios matter once one candidate has run.
    program : str, optional
        The command that runs it, if it is not the compared one.
    model : str, optional
        Models that differ from the problem's own; "" where none does.
    model_reference : callable, optional
        Answer of these models with small steps, the reference of the time error.
    is_other_law : bool
        The models include another law of physics than the scene's: its row is shown, and not ranked.
    step_taken : callable, optional
        Of the result of the set-up, the step of its runs, in seconds.
    """

    method: str
    parameters: dict[str, Any]
    setup: Callable[[], Any]
    solve: Callable[[Any], NDArray]
    arguments: Mapping[str, str]
    work: float = 0.0
    program: str = ""
    model: str = ""
    model_reference: Callable[[], Reference] | None = None
    is_other_law: bool = False
    step_taken: Callable[[Any], float] | None = None


@dataclass(frozen=True, eq=False)
class Reference:
    """The answer from which errors are measured.

    Attributes
    ----------
    name : str
        Its origin: "known truth: ...", "exact polyhedral distance", "Richardson limit of ...".
    values : ndarray
    uncertainty : float
        Bound or estimate of its own largest relative error, in the scale of the rows' errors.
    is_truth : bool
        True for an analytic truth.
    mean_uncertainty : float, optional
        The same for the mean error; by default that of the largest.
    """

    name: str
    values: NDArray
    uncertainty: float
    is_truth: bool = False
    mean_uncertainty: float | None = None

    __repr__ = short_repr

    @classmethod
    def from_truth(cls, name: str, values: NDArray) -> Reference:
        """Analytic answer; its uncertainty is rounding."""
        return cls(f"known truth: {name}", values, 1e-15, is_truth=True)

    @classmethod
    def from_agreement(cls, name: str, values: NDArray, gap: NDArray) -> Reference:
        """Answer whose uncertainty is its difference from a second answer.

        Parameters
        ----------
        gap : (k,) ndarray
            Relative differences of the two answers; rounding is the least uncertainty.
        """
        mean = float(gap.mean()) if len(gap) else 0.0
        return cls(name, values, max(float(gap.max(initial=0.0)), 1e-14), mean_uncertainty=max(mean, 1e-14))

    def error_bound(self, norm: str = "max") -> float:
        """Uncertainty in a norm (`max` or `mean`) of the errors."""
        if norm == "mean" and self.mean_uncertainty is not None:
            return self.mean_uncertainty
        return self.uncertainty

    @property
    def bounds(self) -> ErrorNorms:
        """Uncertainty in both norms."""
        return ErrorNorms(self.error_bound("max"), self.error_bound("mean"))


@dataclass(frozen=True, eq=False)
class MeshLimit:
    """Answer in the limit of fine meshes, at the vertices of the input.

    Attributes
    ----------
    name : str
    values : ndarray
    uncertainty : ErrorNorms
        In the scale of the rows' errors.
    """

    name: str
    values: NDArray
    uncertainty: ErrorNorms

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class Problem:
    """One computation and the configurations that can do it.

    Attributes
    ----------
    candidates : sequence of Candidate
        Cheap ones first.
    references : sequence of (work, callable)
        From the most accurate to the cheapest; the first within the time budget is used.
    error : callable
        (answer, reference values) -> (k,) relative errors, one a vertex, eigenvalue, ...
    error_scale : str
        The quantity that errors are divided by.
    place : str
        Kind of entry that the index of the largest error refers to ("vertex", "eigenvalue").
    query : str
        Unit of work of one `seconds` ("source", "run", "step").
    left_out : tuple of (str, str)
        Configurations that cannot run on this input, and the reasons.
    error_part : {'', 'time', 'mesh', 'both'}
        Part of the error that rows are compared by; "" where the error has no parts.
    mesh_limits : sequence of (work, callable)
        As `references`: limits of fine meshes.
    remark : str
        What the errors do not contain.
    smooth : (work, callable), optional
        Estimate of the answer on a smooth surface through the vertices, where the rows' errors are those on
        the polyhedron.
    """

    candidates: Sequence[Candidate]
    references: Sequence[tuple[float, Callable[[], Reference]]]
    error: Callable[[NDArray, NDArray], NDArray]
    error_scale: str
    place: str = "vertex"
    query: str = "run"
    left_out: tuple[tuple[str, str], ...] = ()
    error_part: str = ""
    mesh_limits: Sequence[tuple[float, Callable[[], MeshLimit]]] = ()
    remark: str = ""
    smooth: tuple[float, Callable[[], NDArray]] | None = None


def label_of(one: Candidate | Row) -> str:
    """Short label of a row: method and parameters.

    Parameters
    ----------
    one : Candidate or Row

    Returns
    -------
    str
    """
    values = " ".join(
        f"{k}={v:.3g}" if isinstance(v, float) else f"{k}={v}" for k, v in one.parameters.items()
    )
    return f"{one.method} {values}".strip()


@dataclass
class Row:
    """Cost and error of one candidate, as measured.

    The errors of a row whose answer is the reference (`is_reference`) are the reference's uncertainty.
    `step_taken` is the step of its runs, which a scheme of limited stability shortens.
    """

    method: str
    parameters: dict[str, Any]
    setup_seconds: float
    seconds: float
    seconds_spread: tuple[float, float]
    repeats: int
    peak_mib: float
    max_error: float
    max_error_at: int | None
    mean_error: float
    arguments: Mapping[str, str]
    program: str = ""
    on_front: bool = False
    verdict: str = ""
    time_error: ErrorNorms | None = None
    mesh_error: ErrorNorms | None = None
    uncertainty: ErrorNorms = ErrorNorms(0.0, 0.0)
    is_reference: bool = False
    is_other_law: bool = False
    setup_spread: tuple[float, float] | None = None
    step_taken: float | None = None
    deviation: AnswerDeviation | None = field(default=None, repr=False, compare=False)

    @property
    def total_seconds(self) -> float:
        """Set-up and one query."""
        return self.setup_seconds + self.seconds

    def error(self, norm: str = "max") -> float:
        """Largest or mean error."""
        return self.max_error if norm == "max" else self.mean_error

    def significant_uncertainty(self, norm: str = "max") -> float:
        """Uncertainty of the largest or mean error, unless it is rounding."""
        uncertainty = self.uncertainty.at(norm)
        return uncertainty if uncertainty > ROUNDING else 0.0

    def is_surely_better(self, other: Row, norm: str = "max") -> bool:
        """Whether its error is below that of another row, whatever the uncertainty hides.

        Errors from different references, or without the answers, may both be off by their uncertainty.
        """
        uncertainty = self.significant_uncertainty(norm) + other.significant_uncertainty(norm)
        if uncertainty and (pair := self._deviations(other)):
            return is_surely_nearer(*pair, 0.5 * uncertainty, norm)
        own = 0.0 if uncertainty and self.is_reference else self.error(norm)
        return own + uncertainty < other.error(norm) > ROUNDING_ERROR

    def has_same_error(self, other: Row, norm: str = "max") -> bool:
        """Whether its error is that of another row, whatever the uncertainty hides."""
        if self.significant_uncertainty(norm) and (pair := self._deviations(other)):
            return not pair[0].lengths_between(pair[1]).any()
        own, others = self.error(norm), other.error(norm)
        return own == others or max(own, others) <= ROUNDING_ERROR

    def _deviations(self, other: Row) -> tuple[AnswerDeviation, AnswerDeviation] | None:
        """Those of both rows, where they are from the same reference."""
        own, others = self.deviation, other.deviation
        return (own, others) if own and others and own.is_comparable(others) else None

    @property
    def label(self) -> str:
        """Short label: method and parameters."""
        return label_of(self)


@dataclass
class Table:
    """Rows of a problem, its references, and the configurations left out.

    `mesh_failure` is the reason why there is no limit of fine meshes, `undecided` why there is no verdict.
    `polyhedron_error` is the distance of the reference from the answer on a smooth surface; None where it is
    not known or part of the errors.
    """

    rows: list[Row] = field(default_factory=list)
    reference: Reference | None = None
    left_out: list[tuple[str, str]] = field(default_factory=list)
    interrupted: bool = False
    mesh_limit: MeshLimit | None = None
    mesh_failure: str = ""
    polyhedron_error: ErrorNorms | None = None
    undecided: str = ""

    def __repr__(self) -> str:
        """A line for each row, cheapest first, and the reference."""
        rows = sorted(self.rows, key=lambda row: row.total_seconds)
        width = max((len(row.label) for row in rows), default=0)
        lines = [
            f"    {row.label:{width}}  {row.total_seconds:.3g} s  max error {row.max_error:.2e}  "
            f"mean error {row.mean_error:.2e}  {row.verdict}".rstrip()
            for row in rows
        ]
        name = self.reference.name if self.reference else None
        return "\n".join([f"Table(reference={name!r}, {len(rows)} rows", *lines, ")"])

    def uncertainty(self, norm: str = "max") -> float:
        """Uncertainty of what the errors are measured against: the largest of the rows."""
        own = self.reference.error_bound(norm) if self.reference and self.mesh_limit is None else 0.0
        return max([own, *(row.uncertainty.at(norm) for row in self.rows)])


def relative_to_largest(answer: NDArray, truth: NDArray) -> NDArray[np.float64]:
    """Errors relative to the largest finite size of the truth.

    Parameters
    ----------
    answer, truth : (k,) ndarray of float64

    Returns
    -------
    (k,) ndarray of float64
        Infinite where an answer is not finite.
    """
    return _relative(answer, truth, np.abs(truth[np.isfinite(truth)]).max(initial=0.0))


def relative_to_rms(answer: NDArray, truth: NDArray) -> NDArray[np.float64]:
    """Errors relative to the root mean square of the truth.

    Parameters
    ----------
    answer, truth : (k,) ndarray of float64

    Returns
    -------
    (k,) ndarray of float64
        Zero where there is no truth.
    """
    return _relative(answer, truth, float(np.sqrt(np.mean(truth[np.isfinite(truth)] ** 2))))


def _relative(answer: NDArray, truth: NDArray, scale: float) -> NDArray[np.float64]:
    finite = np.isfinite(truth)
    error = np.zeros(len(truth))
    with np.errstate(invalid="ignore"):
        difference = np.abs(answer[finite] - truth[finite]) / (scale or 1.0)
    error[finite] = np.nan_to_num(difference, nan=np.inf)
    return error


def relative_to_each(answer: NDArray, truth: NDArray, *, least: float = 0.0) -> NDArray[np.float64]:
    """Errors relative to the truth, entry by entry.

    Parameters
    ----------
    answer, truth : (k,) ndarray of float64
    least : float
        Scale of the errors of smaller truths, which are rounding.

    Returns
    -------
    (k,) ndarray of float64
        Absolute where the scale is zero.
    """
    scale = np.maximum(np.abs(truth), least)
    scale = np.where(scale == 0, 1.0, scale)
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(np.abs(answer - truth) / scale, nan=np.inf, posinf=np.inf)
