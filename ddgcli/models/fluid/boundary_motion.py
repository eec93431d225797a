"""Velocities and fluxes of the boundary that depend on time."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.models.fluid.effect_parts import BoundaryPart
from ddgcli.scenes.expressions import evaluate

N_SAMPLES = 8  # times within a run, besides its ends, at which its boundary is checked before it starts
SAMPLE_SHARE = 0.5 * (
    5.0**0.5 - 1.0
)  # golden ratio: its multiples modulo 1 never stay near one phase of a wave
DERIVATIVE_SHARE = 1e-4  # of the run, over which a rate of change is a difference
CACHE_SIZE = 8  # times: a step needs seven


def depends_on_time(text: str) -> bool:
    """Whether an expression holds the time t.

    Parameters
    ----------
    text : str

    Returns
    -------
    bool
    """
    return re.search(r"\bt\b", text) is not None


def holds_time(section: BoundaryPart) -> bool:
    """Whether a section prescribes what depends on t.

    Parameters
    ----------
    section : BoundaryPart

    Returns
    -------
    bool
    """
    texts = [*(section.velocity or []), str(section.flux)]
    return any(depends_on_time(text) for text in texts)


def rest_kind(sections: Sequence[BoundaryPart]) -> str:
    """Kind of the boundary that no section covers.

    Parameters
    ----------
    sections : sequence of BoundaryPart

    Returns
    -------
    str
        A wall without slip where any section is other than free-slip.
    """
    return "no-slip" if any(section.kind != "free-slip" for section in sections) else "free-slip"


def crosses_in_time(sections: Sequence[BoundaryPart]) -> bool:
    """Whether a flux through the boundary depends on t.

    Parameters
    ----------
    sections : sequence of BoundaryPart

    Returns
    -------
    bool
    """
    return any(holds_time(section) for section in sections if section.kind in ("inflow", "outflow"))


def natural_sides(sections: Sequence[BoundaryPart], owner: NDArray) -> NDArray[np.bool_]:
    """Sides of outflows without a prescribed flux.

    Parameters
    ----------
    sections : sequence of BoundaryPart
    owner : (s,) ndarray of int64
        Index of the section of every boundary side, len(sections) for the rest.

    Returns
    -------
    (s,) ndarray of bool
    """
    free = [
        section.kind == "outflow" and section.velocity is None and section.flux is None
        for section in sections
    ]
    return np.array([*free, False])[owner]


def require_outflow(sections: Sequence[BoundaryPart]) -> None:
    """Refuse an inflow where there is no outflow.

    Parameters
    ----------
    sections : sequence of BoundaryPart

    Raises
    ------
    ValueError
    """
    kinds = {section.kind for section in sections}
    if "inflow" in kinds and "outflow" not in kinds:
        raise ValueError('inflow without outflow: add [[effects.boundary]] with kind = "outflow"')


def refuse_empty_wall(section: BoundaryPart, covered: NDArray, what: str) -> None:
    """Refuse a wall that lies nowhere: it would still decide how the rest of the boundary is.

    Parameters
    ----------
    section : BoundaryPart
    covered : (s,) ndarray of bool
        Boundary sides that it selects.
    what : {'side', 'face'}
        Of the boundary, for the message.

    Raises
    ------
    ValueError
    """
    if section.kind not in ("inflow", "outflow") and section.where is not None and not covered.any():
        place = f" of obstacle {section.obstacle!r}" if section.obstacle is not None else ""
        raise ValueError(
            f"{section.kind}: no boundary {what}{place} lies where {section.where!r} holds; check `where`"
        )


def refuse_outward_inflow(sections: Sequence[BoundaryPart], owner: NDArray, flux: NDArray) -> None:
    """Refuse inflows through which no fluid enters at any time.

    Parameters
    ----------
    sections : sequence of BoundaryPart
    owner : (s,) ndarray of int64
    flux : (times, s) ndarray of float64
        Outwards, at some times, in m^2/s (surfaces) or m^3/s (volumes).

    Raises
    ------
    ValueError
    """
    for i, section in enumerate(sections):
        own = flux[:, owner == i]
        if section.kind == "inflow" and not (own.sum(axis=1) < 0).any():
            remedy = "reverse it" if own.any() else "give it a speed towards the fluid"
            raise ValueError(f"inflow: velocity {section.velocity} brings no fluid in; {remedy}")


def velocity_at(section: BoundaryPart, points: NDArray, time: float) -> NDArray[np.float64]:
    """Velocity that a section prescribes.

    Parameters
    ----------
    section : BoundaryPart
    points : (k, 3) ndarray of float64
        In m.
    time : float
        In s.

    Returns
    -------
    (k, 3) ndarray of float64
        In m/s.
    """
    place = dict(zip("xyz", points.T))
    if holds_time(section):
        place["t"] = np.full(len(points), time)
    return np.stack([evaluate(text, place) for text in section.velocity or []], axis=1)


def flux_at(section: BoundaryPart, time: float) -> float:
    """Flux that a section prescribes.

    Parameters
    ----------
    section : BoundaryPart
        With a flux.
    time : float
        In s.

    Returns
    -------
    float
        Outwards, in m^2/s.
    """
    if isinstance(section.flux, str):
        return float(evaluate(section.flux, {"t": np.array([time])})[0])
    return float(section.flux or 0.0)


def sample_times(sections: Sequence[BoundaryPart], duration: float) -> list[float]:
    """Times at which the conditions of a run are checked before it starts: 0 alone where none depends on t.

    Parameters
    ----------
    sections : sequence of BoundaryPart
    duration : float
        Of the run.

    Returns
    -------
    list of float
        The first is 0, the last the end of the run.
    """
    if not any(holds_time(section) for section in sections):
        return [0.0]
    shares = [SAMPLE_SHARE * k % 1.0 for k in range(1, N_SAMPLES + 1)]
    return [0.0, *(share * duration for share in sorted(shares)), duration]


class InTime:
    """A function of time with a cache of its last values.

    Parameters
    ----------
    function : callable float -> ndarray
    times : list of float
        Of the run, from 0 to its end; a bound on the function is estimated from its values there.
    """

    def __init__(self, function: Callable[[float], Any], times: list[float]) -> None:
        self.times, self._value = times, lru_cache(CACHE_SIZE)(function)

    def at(self, time: float) -> Any:
        """Its value.

        Raises
        ------
        SolveError
            Where it has none, with the time.
        """
        try:
            return self._value(time)
        except ValueError as error:
            raise SolveError(f"t = {time:.6g} s, effect boundary: {error}") from error

    def rate(self, time: float) -> Any:
        """Its derivative, by a difference over a small share of the run and within it."""
        end = self.times[-1]
        first, last = max(time - DERIVATIVE_SHARE * end, 0.0), min(time + DERIVATIVE_SHARE * end, end)
        return (self.at(last) - self.at(first)) / (last - first)


def values_at(function: Callable[[float], Any], times: Sequence[float]) -> list[Any]:
    """Values of a function at some times; what it refuses is refused with the time.

    Parameters
    ----------
    function : callable float -> object
        Raises ValueError.
    times : sequence of float

    Returns
    -------
    list

    Raises
    ------
    ValueError
    """
    values = []
    for time in times:
        try:
            values.append(function(time))
        except ValueError as error:
            if len(times) == 1:
                raise
            raise ValueError(f"t = {time:.6g} s: {error}") from error
    return values
