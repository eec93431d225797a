"""Accuracy against seconds: the methods of one question, measured on one mesh."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Literal

from numpy.typing import NDArray

from ddgcli.choices import (
    CURVATURE_SCHEMES,
    DISTANCE_METHODS,
    ERROR_NORMS,
    ERROR_PARTS,
    HEAT_OPERATORS,
    LAPLACE_OPERATORS,
    MASSES,
    MAX_REFINEMENT_DEGREES,
    MAX_SUBDIVISIONS,
    WILLMORE_BOUNDARIES,
    WILLMORE_ENERGIES,
    WILLMORE_FLOWS,
)
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.library.arguments import checked_arguments, real_number, text, whole_number
from ddgcli.library.arguments import truth as boolean
from ddgcli.library.distances import surface_sources
from ddgcli.library.mesh_arguments import MeshLike, mesh_of_kind
from ddgcli.tradeoff.candidates import Table
from ddgcli.tradeoff.measure import run_problem
from ddgcli.tradeoff.pareto import assign_verdicts
from ddgcli.tradeoff.problems.table import mesh_problem
from ddgcli.tradeoff.truths import parse_truth

__all__ = ["tradeoff_table"]


def _one_of(*names: str) -> Callable[[Any, str], Any]:
    """Check that a value is one of the names."""

    def check(value: Any, name: str) -> str:
        if text(value, name) not in names:
            raise ParameterError(f"is one of {', '.join(names)}, not {value!r}", parameter=name)
        return str(value)

    return check


def _within(
    low: float,
    high: float = math.inf,
    convert: Callable[[Any, str], Any] = real_number,
    *,
    above: bool = False,
) -> Callable[[Any, str], Any]:
    """Check that a number is finite and between `low` (excluded if `above`) and `high`."""

    def check(value: Any, name: str) -> Any:
        number = convert(value, name)
        if not low <= number <= high or number == math.inf or (above and number == low):
            bounds = f"{'above' if above else 'at least'} {low:g}" + (
                f" and at most {high:g}" * (high < math.inf)
            )
            raise ParameterError(f"must be {bounds}, not {value}", parameter=name)
        return number

    return check


POSITIVE = _within(0.0, above=True)
# question -> option -> check; the options are those of the command of the same name
OPTIONS_OF_QUESTION: dict[str, dict[str, Callable[[Any, str], Any]]] = {
    "curvature": {"scheme": _one_of(*CURVATURE_SCHEMES), "radius": POSITIVE},
    "delaunay": {
        "refine": _within(0, MAX_REFINEMENT_DEGREES, above=True),
        "max_points": _within(0, convert=whole_number),
    },
    "laplacian": {
        "eigen": _within(1, convert=whole_number),
        "operator": _one_of(*LAPLACE_OPERATORS),
        "mass": _one_of(*MASSES),
    },
    "maps": {
        "operator": _one_of(*LAPLACE_OPERATORS),
        "subdivide": _within(0, MAX_SUBDIVISIONS, whole_number),
    },
    "geodesic": {
        "method": _one_of(*DISTANCE_METHODS),
        "tolerance": _within(0.0),
        "operator": _one_of(*HEAT_OPERATORS),
        "heat_time": POSITIVE,
        "heat_refine": _within(0, 100, whole_number),
        "subdivide": _within(0, MAX_SUBDIVISIONS, whole_number),
    },
    "willmore-flow": {
        "flow": _one_of(*WILLMORE_FLOWS),
        "energy": _one_of(*WILLMORE_ENERGIES),
        "boundary": _one_of(*WILLMORE_BOUNDARIES),
        "fix_area": boolean,
        "fix_volume": boolean,
        "duration": POSITIVE,
        "steps": _within(1, convert=whole_number),
        "step": POSITIVE,
        "integrator": text,
        "tolerance": POSITIVE,
    },
}


@checked_arguments
def tradeoff_table(
    question: Literal["curvature", "delaunay", "laplacian", "maps", "geodesic", "willmore-flow"],
    mesh: MeshLike,
    *,
    sources: int | Sequence[int] | NDArray | None = None,
    truth: str | None = None,
    within: float | None = None,
    norm: Literal["max", "mean"] = "max",
    error: Literal["both", "time", "mesh"] | None = None,
    repeat: int = 5,
    budget: float = 60.0,
    **options: Any,
) -> Table:
    """Measure what accuracy costs in time: error and seconds of every method of a problem.

    Parameters
    ----------
    question : {'curvature', 'delaunay', 'laplacian', 'maps', 'geodesic', 'willmore-flow'}
        'maps': conformal distortion of the maps to the plane.
    mesh : TriangleMesh or (points, faces) pair
    sources : int or sequence of int, optional
        'geodesic': source vertices; default vertex 0.
    truth : str, optional
        Shape that the mesh samples, such as "sphere:1" or "torus:1,0.4"; errors are then against analytic
        values, else against the most accurate method that fits into the budget.
    within : float, optional
        Relative error; the cheapest row whose error is at most this gets a verdict.
    norm : {'max', 'mean'}
        Error that `within` and the Pareto front refer to.
    error : {'both', 'time', 'mesh'}, optional
        'willmore-flow': part of the error that rows are compared by; by default the distance from
        the limit of small steps and fine meshes.
    repeat : int
        Timed queries per row.
    budget : float
        Seconds for all measurements; rows that would exceed it are left out.
    **options
        Options of the command that the question is about: `eigen=20`, `method="heat"`, `refine=25`, ...

    Returns
    -------
    Table
        `rows`: `method`, `parameters`, `setup_seconds`, `seconds`, `peak_mib`, `max_error`, `mean_error`
        (relative), `time_error`, `mesh_error`, `uncertainty`, `on_front`, `verdict`;
        `reference` with its `uncertainty`; `left_out` with reasons; `undecided`: why there is no verdict.

    Raises
    ------
    ParameterError
        On an unknown question, option or shape.
    SolveError
        When no reference fits into the budget.
    KeyboardInterrupt
        At an interrupt, without the rows so far.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> table = ddg.tradeoff_table("geodesic", ddg.icosphere(2), method="dijkstra", repeat=1)
    >>> [(row.method, row.max_error > 0) for row in table.rows]
    [('dijkstra', True)]
    """
    options = _checked_options(question, options, sources is not None)
    _check_measurement(question, norm, error, repeat, budget, within)
    surface = mesh_of_kind(mesh, ("surface",), "tradeoff_table")
    more: dict[str, Any] = {} if error is None else {"error_part": error}
    if sources is not None:
        more["sources"] = surface_sources(surface, sources)
    with renamed_parameters(text="truth"):
        if truth is not None and question == "maps":
            raise ParameterError("maps are compared with conformal ones; leave it out", parameter="truth")
        if question != "maps":
            more["truth"] = None if truth is None else parse_truth(truth, surface.points)
    problem = mesh_problem(question, surface, options=options, **more)
    if not problem.candidates and not problem.left_out:
        raise ParameterError(f"no method of {question!r} has the options {options}")
    table = run_problem(problem, repeat=repeat, budget=budget)
    if table.interrupted:
        raise KeyboardInterrupt
    assign_verdicts(table, within, norm)
    return table


def _check_measurement(
    question: str, norm: str, error: str | None, repeat: int, budget: float, within: float | None
) -> None:
    if norm not in ERROR_NORMS:
        raise ParameterError(f"must be 'max' or 'mean', not {norm!r}", parameter="norm")
    if error is not None and (question != "willmore-flow" or error not in ERROR_PARTS):
        raise ParameterError(
            f"is one of {', '.join(ERROR_PARTS)}, for 'willmore-flow' only", parameter="error"
        )
    for name, value in (("repeat", repeat), ("budget", budget)):
        if not value > 0:
            raise ParameterError(f"must be positive, not {value}", parameter=name)
    if within is not None and not 0 < within < math.inf:
        raise ParameterError(f"must be a positive number, not {within:g}", parameter="within")


def _checked_options(question: str, options: dict[str, Any], has_sources: bool) -> dict[str, Any]:
    """The options of a question, converted; raises an error for unknown ones and for wrong values."""
    if question not in OPTIONS_OF_QUESTION:
        raise ParameterError(
            f"{question!r} is not one of {', '.join(OPTIONS_OF_QUESTION)}", parameter="question"
        )
    own_options = OPTIONS_OF_QUESTION[question]
    unknown = [name for name in options if name not in own_options]
    if unknown:
        raise ParameterError(
            f"is not an option of {question!r}; its options are {', '.join(own_options)}",
            parameter=unknown[0],
        )
    if has_sources and question != "geodesic":
        raise ParameterError(f"belongs to 'geodesic', not to {question!r}", parameter="sources")
    return {name: own_options[name](value, name) for name, value in options.items()}
