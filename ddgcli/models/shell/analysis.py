"""Modes and buckling loads of the shells of a scene, as results and arrays."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.mechanics.modes import ZERO_FREQUENCY, Modes, buckling_modes, natural_modes
from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import RampedLoad
from ddgcli.models.shell.equilibrium_advice import rest_advice
from ddgcli.models.shell.groups import Order
from ddgcli.scenes.scene import Scene

log = logging.getLogger("ddgcli")

# relative change of a frequency between the start and the equilibrium above which a warning is issued
MAX_FREQUENCY_CHANGE = 0.1
# displacement to the equilibrium by linear theory, over the shell's size, above which a warning is issued
MAX_DISPLACEMENT = 0.1


def vibrations(
    systems: dict[str, System], points: dict[str, NDArray], order: Order, k: int, scene: Scene
) -> tuple[dict[str, Any], dict[str, NDArray]]:
    """Natural frequencies and modes of shells about given positions.

    Parameters
    ----------
    systems : dict of str to System
    points : dict of str to (n, 3) ndarray
        Positions of each group in m.
    order : Order
        Order of the shells in the arrays.
    k : int
        Number of modes over all shells.
    scene : Scene
        If its integrator is `static`, the positions are equilibria; otherwise a warning states how far the
        frequencies are from those at the equilibrium.

    Returns
    -------
    results : dict
        `frequencies` in Hz, ascending; negative ones are unstable, with a warning.
    arrays : dict of str to ndarray
        `mode_000`, ...
    """
    balanced, at_rest = True, scene.time.integrator == "static"

    def modes_of(name: str, system: System) -> Modes:
        nonlocal balanced
        modes = natural_modes(system, points[name], k, equilibrium=not at_rest)
        balanced &= not _differs_at_equilibrium(name, modes, rest_advice(scene, system, modes.accelerates))
        return modes

    modes, shapes = _lowest(systems, modes_of, order, k)
    if modes and modes[0] < 0 and balanced:
        log.warning(
            "%d frequencies are negative: the state is unstable, with growth rates of 2 pi times them",
            sum(f < 0 for f in modes),
        )
    return {"frequencies": modes}, {f"mode_{i:03d}": shape for i, shape in enumerate(shapes)}


def _differs_at_equilibrium(name: str, modes: Modes, remedy: str) -> bool:
    """Warn if the frequencies at the nearby equilibrium differ from those at the start; return whether."""
    if modes.at_equilibrium is None:
        return False
    largest = np.maximum(np.abs(modes.values), np.abs(modes.at_equilibrium))
    change = np.abs(modes.at_equilibrium - modes.values)
    changed = change > MAX_FREQUENCY_CHANGE * np.maximum(largest, ZERO_FREQUENCY * largest.max())
    if modes.rotates:
        difference = "its loads move it in ways that nothing resists at first"
    elif modes.displacement > MAX_DISPLACEMENT:
        difference = f"by linear theory it moves by {modes.displacement:.2g} of its size"
    elif changed.any():
        k = int(np.argmax(changed))
        at_rest = modes.at_equilibrium[k]
        rest = f"is about {at_rest:.3g} Hz" if at_rest >= 0 else "is unstable"
        difference = f"one of {modes.values[k]:.3g} Hz {rest} at rest, by a second-order estimate"
    else:
        return False
    log.warning(
        "%s is not in equilibrium at the start (%s), so its frequencies there are not those of the shell at "
        "rest under its loads: %s", name, difference, remedy,
    )  # fmt: skip
    return True


def buckling(systems: dict[str, System], order: Order, k: int) -> tuple[dict[str, Any], dict[str, NDArray]]:
    """Load factors and modes of linear buckling of shells at rest.

    Parameters
    ----------
    systems : dict of str to System
    order : Order
        Order of the shells in the arrays.
    k : int
        Number of modes over all shells.

    Returns
    -------
    results : dict
        `load_factors`, ascending.
    arrays : dict of str to ndarray
        `buckling_000`, ...
    """
    factors, shapes = _lowest(systems, lambda name, s: buckling_modes(s, s.start, k), order, k)
    return {"load_factors": factors}, {f"buckling_{i:03d}": shape for i, shape in enumerate(shapes)}


def warn_of_ramps(systems: dict[str, System]) -> None:
    """Warn about loads whose ramp factor at the time of the systems is not 1.

    Parameters
    ----------
    systems : dict of str to System
    """
    for name, system in systems.items():
        ramps = [term.own_term for term in system.terms if isinstance(term.own_term, RampedLoad)]
        factors = [float(np.interp(system.time, ramp.times, ramp.factors)) for ramp in ramps]
        if any(factor != 1.0 for factor in factors):
            log.warning(
                "%s: ramped loads count with their factors at %g s (%s); leave times and factors out",
                name,
                system.time,
                ", ".join(f"{factor:.3g}" for factor in factors),
            )


def _lowest(
    systems: dict[str, System], modes_of: Callable[[str, System], Modes], order: Order, k: int
) -> tuple[list[float], list[NDArray]]:
    """The k lowest values over all systems, and their shapes on the vertices of all shells.

    Raises
    ------
    SolveError
        If no system has a mode: the error of the first one. Errors of single systems become warnings.
    """
    values: list[float] = []
    shapes: list[NDArray] = []
    failures: dict[str, SolveError] = {}
    owners = np.concatenate([np.full(count, owner, dtype=object) for owner, count in order])
    for name, system in systems.items():
        try:
            modes = modes_of(name, system)
        except SolveError as error:
            failures[name] = error
            continue
        for value, shape in zip(modes.values, modes.shapes):
            whole = np.zeros((len(owners), 3))
            whole[owners == name] = shape
            values.append(float(value))
            shapes.append(whole)
    if not values and failures:
        raise next(iter(failures.values()))
    for name, failure in failures.items():
        log.warning("%s: %s", name, failure)
    if len(values) < k:
        log.warning("%d modes in place of %d: the shells have no more", len(values), k)
    ascending = np.argsort(values, kind="stable")[:k]
    return [values[i] for i in ascending], [shapes[i] for i in ascending]
