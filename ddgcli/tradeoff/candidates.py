"""What is compared: candidates with dials, references with their uncertainty, and the rows that come out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

# options of the command compared, by the names of its parameters, as far as they were given
Asked = Mapping[str, Any]
NOTHING: Asked = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Candidate:
    """One configuration of one method.

    Attributes
    ----------
    method : str
        Line in the picture.
    parameters : dict
        Values of its dials.
    setup : callable
        What is paid once; its result is handed to `solve`.
    solve : callable
        One query: the answer, in the form that the problem's reference has.
    options : str
        Options of the command that run this configuration, as a shell takes them.
    work : float
        Guess of the seconds of set-up and one query; only ratios matter once one candidate has run.
    program : str, optional
        The command that runs it, where that is another than the one compared.
    """

    method: str
    parameters: dict[str, Any]
    setup: Callable[[], Any]
    solve: Callable[[Any], NDArray]
    options: str
    work: float = 0.0
    program: str = ""


@dataclass(frozen=True, eq=False)
class Reference:
    """The answer that errors are measured against.

    Attributes
    ----------
    name : str
        What it is: "known truth: ...", "exact polyhedral distance", "Richardson limit of ...".
    values : ndarray
    uncertainty : float
        Bound or estimate of its own largest relative error, on the scale of the rows.
    known : bool
        True for an analytic truth.
    mean_uncertainty : float, optional
        The same for the mean error; by default that of the largest.
    """

    name: str
    values: NDArray
    uncertainty: float
    known: bool = False
    mean_uncertainty: float | None = None

    @classmethod
    def of_truth(cls, name: str, values: NDArray) -> Reference:
        """An analytic answer, uncertain by rounding alone."""
        return cls(f"known truth: {name}", values, 1e-15, known=True)

    @classmethod
    def as_far_as(cls, name: str, values: NDArray, gap: NDArray) -> Reference:
        """An answer that is trusted as far as another agrees: (k,) relative differences of the two.

        Where they agree altogether rounding is left.
        """
        mean = float(gap.mean()) if len(gap) else 0.0
        return cls(name, values, max(float(gap.max(initial=0.0)), 1e-14), mean_uncertainty=max(mean, 1e-14))

    def within(self, norm: str = "max") -> float:
        """Its own error, in a norm of the rows."""
        if norm == "mean" and self.mean_uncertainty is not None:
            return self.mean_uncertainty
        return self.uncertainty


@dataclass(frozen=True, eq=False)
class Problem:
    """One question, several ways to answer it.

    Attributes
    ----------
    candidates : sequence of Candidate
        Cheap ones first.
    references : sequence of (work, callable)
        From the most accurate to the cheapest; the first that the budget can pay is taken.
    error : callable
        (answer, reference values) -> (k,) relative errors, one a vertex, eigenvalue, ...
    error_scale : str
        What errors are relative to.
    place : str
        What the index of the largest error counts ("vertex", "eigenvalue").
    query : str
        What one `seconds` pays for ("source", "run", "step").
    left_out : tuple of (str, str)
        Configurations that cannot run on this input, and why.
    """

    candidates: Sequence[Candidate]
    references: Sequence[tuple[float, Callable[[], Reference]]]
    error: Callable[[NDArray, NDArray], NDArray]
    error_scale: str
    place: str = "vertex"
    query: str = "run"
    left_out: tuple[tuple[str, str], ...] = ()


def label_of(one: Candidate | Row) -> str:
    """Method and dials in a few words."""
    dials = " ".join(f"{k}={v:g}" if isinstance(v, float) else f"{k}={v}" for k, v in one.parameters.items())
    return f"{one.method} {dials}".strip()


@dataclass
class Row:
    """Cost and error of one candidate, as measured."""

    method: str
    parameters: dict[str, Any]
    setup_seconds: float
    seconds: float
    seconds_spread: tuple[float, float]
    repeats: int
    peak_mib: float
    max_error: float
    max_error_at: int
    mean_error: float
    options: str
    program: str = ""
    on_front: bool = False
    verdict: str = ""

    @property
    def total_seconds(self) -> float:
        """Set-up and one query."""
        return self.setup_seconds + self.seconds

    def error(self, norm: str = "max") -> float:
        """The error that `--within` speaks of."""
        return self.max_error if norm == "max" else self.mean_error

    @property
    def label(self) -> str:
        """Method and dials in a few words."""
        return label_of(self)


@dataclass
class Table:
    """All rows of a problem and what is to be said of them."""

    rows: list[Row] = field(default_factory=list)
    reference: Reference | None = None
    left_out: list[tuple[str, str]] = field(default_factory=list)
    interrupted: bool = False


def relative_to_largest(answer: NDArray, truth: NDArray) -> NDArray[np.float64]:
    """|answer - truth| over the largest |truth|, where that is finite; an answer that is not counts inf."""
    return _relative(answer, truth, np.abs(truth[np.isfinite(truth)]).max(initial=0.0))


def relative_to_rms(answer: NDArray, truth: NDArray) -> NDArray[np.float64]:
    """|answer - truth| over the root mean square of the truth, leaving out entries without a truth."""
    return _relative(answer, truth, float(np.sqrt(np.mean(truth[np.isfinite(truth)] ** 2))))


def _relative(answer: NDArray, truth: NDArray, scale: float) -> NDArray[np.float64]:
    finite = np.isfinite(truth)
    error = np.zeros(len(truth))
    with np.errstate(invalid="ignore"):
        difference = np.abs(answer[finite] - truth[finite]) / (scale or 1.0)
    error[finite] = np.nan_to_num(difference, nan=np.inf)
    return error


def relative_to_each(answer: NDArray, truth: NDArray) -> NDArray[np.float64]:
    """|answer - truth| over |truth|, entry by entry; entries whose truth is zero count absolutely."""
    scale = np.where(truth == 0, 1.0, np.abs(truth))
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(np.abs(answer - truth) / scale, nan=np.inf)
