"""Arrays and results of the last frame of shells: modes, strains, stresses, moments."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError
from ddgcli.mechanics.system import System
from ddgcli.models.shell import plate_check
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.groups import Order, points_at_end
from ddgcli.simulation.outcome import Outcome


def check_analysis(systems: dict[str, System], buckling_time: float | None = None) -> None:
    """Raise an error for shells whose vibration or buckling modes cannot be computed.

    Parameters
    ----------
    systems : dict of str to System
    buckling_time : float, optional
        Time in s of the loads whose buckling factors are computed; None without buckling.

    Raises
    ------
    ParameterError
        For rigid edges, for plasticity, if no vertex is free, and if none of the shells can buckle.
    """
    if any(system.constraints for system in systems.values()):
        raise ParameterError("modes of shells with rigid edges are not computed; leave rigid out")
    if _yields(systems):
        raise ParameterError("modes of shells with plasticity are not computed; leave plasticity out")
    if not any(system.free.any() for system in systems.values()):
        raise ParameterError("every vertex is held, so nothing vibrates or buckles; pin fewer vertices")
    if buckling_time is not None:
        from ddgcli.mechanics.modes import no_buckling

        at_time = {name: system.at(buckling_time).with_own_account() for name, system in systems.items()}
        reasons = [f"{name}: {no_buckling(system, system.start)}" for name, system in at_time.items()]
        if not any(reason.endswith(": ") for reason in reasons):
            raise ParameterError(reasons[0])


def final(
    outcome: Outcome,
    contexts: dict[str, ShellContext],
    systems: dict[str, System],
    order: Order,
    n_modes: int | None = None,
    n_buckling: int | None = None,
) -> tuple[dict[str, NDArray], dict[str, NDArray], dict[str, Any]]:
    """Arrays and results of the last frame: modes, strains, stresses, moments.

    Parameters
    ----------
    outcome : Outcome
    contexts : dict of str to ShellContext
    systems : dict of str to System
    order : Order
    n_modes, n_buckling : int, optional
        Number of vibration modes and of buckling modes.

    Returns
    -------
    vertex, face : dict of str to ndarray
    results : dict
    """
    if outcome.last is None or outcome.failure:
        return {}, {}, {}
    end, time = points_at_end(outcome, systems, order), outcome.end.time
    systems = {name: system.at(time).with_own_account() for name, system in systems.items()}
    yields = _yields(systems)
    scene = next(iter(contexts.values())).scene
    static = scene.time.integrator == "static"
    twins = _plate_twins(contexts, systems, order) if not yields and (static or n_modes or n_buckling) else {}
    if static:
        factors = [plate_check.deflection_factor(twin, end[name]) for name, twin in twins.items()]
        plate_check.warn_of_hinges(plate_check.farthest_from_one(factors), "deflections", "small", "large")
        factors = [plate_check.force_factor(twin, end[name]) for name, twin in twins.items()]
        plate_check.warn_of_hinges(plate_check.farthest_from_one(factors), "forces", "large", "small")
    vertex: dict[str, NDArray] = {}
    results: dict[str, Any] = {}
    if n_modes or n_buckling:
        from ddgcli.models.shell import analysis

        if n_modes:
            values, shapes = analysis.vibrations(systems, end, order, n_modes, scene)
            results, vertex = {**results, **values}, {**vertex, **shapes}
            frequencies = np.array(values["frequencies"])
            factors = [
                plate_check.frequency_factor(twin, end[name], *_own(name, order, shapes, frequencies))
                for name, twin in twins.items()
            ]
            plate_check.warn_of_hinges(plate_check.farthest_from_one(factors), "some frequencies")
        if n_buckling:
            analysis.warn_of_ramps(systems)
            values, shapes = analysis.buckling(systems, order, n_buckling)
            results, vertex = {**results, **values}, {**vertex, **shapes}
            load_factors = np.array(values["load_factors"])
            factors = [
                plate_check.load_factor(twin, _own(name, order, shapes, load_factors)[0])
                for name, twin in twins.items()
            ]
            plate_check.warn_of_hinges(plate_check.farthest_from_one(factors), "some load factors")
    # without the plastic memory of the run, stresses after yielding cannot be computed here
    face = {} if yields else _faces(contexts, systems, end, order)
    return vertex, face, results


def _plate_twins(
    contexts: dict[str, ShellContext], systems: dict[str, System], order: Order
) -> dict[str, plate_check.PlateTwin]:
    """Plate twins of the systems that have hinges."""
    owners = [owner for owner, _ in order]
    shells = {
        name: {c: context for (c, context), owner in zip(contexts.items(), owners) if owner == name}
        for name in systems
    }
    twins = {name: plate_check.plate_twin(system, shells[name]) for name, system in systems.items()}
    return {name: twin for name, twin in twins.items() if twin is not None}


def _own(
    name: str, order: Order, shapes: dict[str, NDArray], values: NDArray
) -> tuple[list[NDArray], NDArray[np.float64]]:
    """Mode shapes of one system on its own vertices, and their values."""
    owners = np.concatenate([np.full(count, owner == name) for owner, count in order])
    is_own = np.array([bool(shape[owners].any()) for shape in shapes.values()], dtype=bool)
    return [shape[owners] for shape, own in zip(shapes.values(), is_own) if own], values[is_own]


def _yields(systems: dict[str, System]) -> bool:
    """Whether a shell has plasticity."""
    return any("work" in memory.initial() for system in systems.values() for memory in system.memories)


def _faces(
    contexts: dict[str, ShellContext], systems: dict[str, System], end: dict[str, NDArray], order: Order
) -> dict[str, NDArray]:
    """Face arrays over all shells, for the names that every shell has."""
    from ddgcli.mechanics.embedding import terms_of_rows
    from ddgcli.models.shell.face_arrays import face_arrays

    starts = dict.fromkeys(systems, 0)
    scalars = []
    for (owner, count), context in zip(order, contexts.values()):
        rows = slice(starts[owner], starts[owner] + count)
        starts[owner] += count
        scalars.append(face_arrays(context, terms_of_rows(systems[owner].potentials, rows), end[owner][rows]))
    shared = set.intersection(*(set(scalar) for scalar in scalars))
    return {
        name: np.concatenate([scalar[name] for scalar in scalars]) for name in scalars[0] if name in shared
    }
