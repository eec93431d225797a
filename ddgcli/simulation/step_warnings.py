"""Warnings of failed steps: each is logged once in a run, which may be resumed in between."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from ddgcli.simulation.model import NO_REJECTIONS, Model

BY_COMPOSITE_SCHEME = "; taken by the composite scheme"  # end of the detail of such a step's event


def halved(time: float, unit: str, detail: str) -> str:
    """Warning of a failed step that is halved.

    Parameters
    ----------
    time : float
    unit : str
    detail : str
        Text of its event.

    Returns
    -------
    str
    """
    return f"t = {time:.6g} {unit}, {detail}; it is halved, and so are those after it where they must"


def rescued(time: float, unit: str, detail: str) -> str:
    """Warning of a failed step that another scheme takes.

    Parameters
    ----------
    time : float
    unit : str
    detail : str
        Text of its event.

    Returns
    -------
    str
    """
    return f"t = {time:.6g} {unit}, {detail}, and so are those after it that must"


def earlier_warnings(
    models: Mapping[str, Model], events: Iterable[tuple[float, str, str]], *, adaptive: bool
) -> list[str]:
    """Warnings that the earlier part of a resumed run has logged, by its events.

    Parameters
    ----------
    models : mapping of str to Model
    events : iterable of (float, str, str)
        Time, kind and detail.
    adaptive : bool
        Whether a tolerance chooses the steps: those that fail are no warnings then.

    Returns
    -------
    list of str
    """
    first: dict[tuple[str, bool], str] = {}
    for time, kind, detail in events:
        name = next((name for name in models if detail.startswith(f"{name}: ")), None)
        if name is None:
            continue
        unit, by_other = models[name].time_unit, detail.endswith(BY_COMPOSITE_SCHEME)
        if kind == "stability":
            first.setdefault((name, by_other), detail)
        elif by_other:
            first.setdefault((name, by_other), rescued(time, unit, detail))
        elif kind not in NO_REJECTIONS and not adaptive:
            first.setdefault((name, by_other), halved(time, unit, detail))
    return list(first.values())
