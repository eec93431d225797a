"""Results and accuracy of a shell run."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.rounding import Rounding
from ddgcli.mechanics.system import LINEAR_SOLVER, System
from ddgcli.models.shell.groups import Order, points_at_end
from ddgcli.simulation.outcome import Outcome

log = logging.getLogger("ddgcli")
# scalars of the frames, by support and by obstacle
FORCE, MOMENT = "reaction_force_", "reaction_moment_"
CONTACT_FORCE, CONTACT_MOMENT = "contact_force_", "contact_moment_"
N_RIGID_MOTIONS = 6
VOLUME = "volume_"  # of a closed shell with pressure
# growth of the energy over the available energy above which a warning is issued, and above which the result
# is unreliable
ENERGY_GROWTH_WARNING, ENERGY_GROWTH_FAILURE = 0.1, 1.0


@dataclass(frozen=True)
class RunRounding:
    """Bounds of the rounding of a run's energy (J), momentum (kg m/s) and angular momentum (kg m^2/s)."""

    energy: float
    momentum: float
    angular_momentum: float


@np.errstate(over="ignore", invalid="ignore")
def rounding(outcome: Outcome, systems: dict[str, System], order: Order) -> RunRounding:
    """Rounding of a run, summed over all shells: the larger of the values at the start and at the end.

    Parameters
    ----------
    outcome : Outcome
    systems : dict of str to System
    order : Order

    Returns
    -------
    RunRounding
        Energy in J, momentum in kg m/s, angular momentum.
    """
    steps, end = outcome.steps, points_at_end(outcome, systems, order)
    dt = outcome.smallest_step if steps else np.inf
    energy = momentum = angular = 0.0
    for name, system in systems.items():
        at_end = system.at(outcome.end.time).potentials  # moving obstacles may have passed these places
        scales = [system.rounding, Rounding.at(at_end, system.mass, end[name])]
        momentum_rounding = max(scale.momentum(dt, steps) for scale in scales)
        energy += max(scale.energy(dt, steps) for scale in scales)
        momentum += momentum_rounding
        angular += momentum_rounding * float(np.abs(end[name]).max())
    return RunRounding(energy, momentum, angular)


MAX_ELASTIC_STRAIN = 2.0  # strain of an edge that no preset material bears
UNRESISTED_STRAIN = 0.5  # strain of an edge above which a missing effect `stretching` is likely a mistake
DRIFTS = ("energy_drift", "energy_gain", "momentum_drift", "angular_momentum_drift")


def summary(
    outcome: Outcome, systems: dict[str, System], order: Order, *, static: bool
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Results and accuracy of a run of shells.

    Parameters
    ----------
    outcome : Outcome
    systems : dict of str to System
    order : Order
    static : bool
        Adds the stability of the equilibrium, and has no drifts: its frames are not a motion that conserves
        anything.

    Returns
    -------
    results, accuracy : dict
    """
    accuracy = _accuracy(outcome, systems, order)
    if static:
        accuracy |= dict.fromkeys(DRIFTS)
    if static and not outcome.failure:
        end = points_at_end(outcome, systems, order)
        accuracy["negative_eigenvalues"] = _instability(end, systems)
    return _results(outcome), accuracy


def _results(outcome: Outcome) -> dict[str, Any]:
    """Frames, steps, energies, momenta and the results of single effects, at the end of a run."""
    series, last = outcome.series, outcome.end
    energies = {
        name.removeprefix("energy_"): {"start": float(values[0]), "end": float(values[-1])}
        for name, values in series.items()
        if name.startswith("energy_")
    }
    energies["total"] = {"start": float(series["energy"][0]), "end": float(series["energy"][-1])}
    results = {
        "frames": outcome.n_frames,
        "time": last.time,
        **outcome.step_counts,
        "newton_iterations": int(series["newton_iterations"][-1]),
        "energies": energies,
        "momentum": last.scalar["momentum"],
        "angular_momentum": last.scalar["angular_momentum"],
    }
    if "external_work" in last.scalar:
        results["external_work"] = last.scalar["external_work"]
    for name in ("plastic_work", "fracture_energy", "rigid_force"):
        if name in last.scalar:
            results[name] = last.scalar[name]
    for name in ("cracks", "pieces"):
        if name in last.scalar:
            results[name] = int(last.scalar[name])
    for key, force, moment in (
        ("reaction_forces", FORCE, MOMENT),
        ("contact_forces", CONTACT_FORCE, CONTACT_MOMENT),
    ):
        names = [name.removeprefix(force) for name in last.scalar if name.startswith(force)]
        if names:
            results[key] = {
                name: {"force": last.scalar[force + name], "moment": last.scalar[moment + name]}
                for name in names
            }
    if outcome.failure:
        results["stopped_because"] = outcome.failure
    return results


def _accuracy(outcome: Outcome, systems: dict[str, System], order: Order) -> dict[str, Any]:
    """Drifts, gain, strain and linear solver of a run.

    The drift of the energy is relative to the largest kinetic energy or change of one of the energies; that
    of the momentum to the mass times the largest speed; that of the angular momentum to this times the size
    of the shells. A drift within rounding is 0. The gain is the largest rise of the energy above its lowest
    value so far. The linear solver is reported if it is conjugate gradients, not a factorisation.
    """
    series = outcome.series
    mass = sum(float(system.mass.sum()) for system in systems.values())
    size = max(system.size for system in systems.values())
    least = rounding(outcome, systems, order)
    swing = [np.ptp(v) for name, v in series.items() if name.startswith("energy_")]
    energy_scale = max([float(np.abs(series["energy_kinetic"]).max()), *map(float, swing)])
    momentum_scale = mass * outcome.largest.get("velocity", 0.0)
    own_energy = series["energy"] - _work(series)
    gain = float(np.max(own_energy - np.minimum.accumulate(own_energy)))
    accuracy: dict[str, Any] = {
        "energy_drift": _drift(own_energy, energy_scale, least.energy),
        "energy_gain": gain / max(energy_scale, least.energy) if gain > least.energy else 0.0,
        "momentum_drift": _drift(series["momentum"], momentum_scale, least.momentum),
        "angular_momentum_drift": _drift(
            series["angular_momentum"], momentum_scale * size, least.angular_momentum
        ),
        "max_strain": outcome.largest.get("strain", 0.0),
        **_linear_solver_accuracy(systems),
    }
    if "rigid_error" in series:
        accuracy["rigid_error"] = float(series["rigid_error"].max())
    return accuracy


def _instability(end: dict[str, NDArray], systems: dict[str, System]) -> int | None:
    """Number of negative eigenvalues of the Hessians at all equilibria; warn if there are any."""
    from ddgcli.mechanics.equilibrium import unstable_directions
    from ddgcli.mechanics.rigid_motions import unheld_motions

    total: int | None = 0
    for name, system in systems.items():
        count = unstable_directions(system.with_own_account(), end[name])
        total = None if total is None or count is None else total + count
        if count is None:
            log.warning("object %s: no factorisation shows whether the equilibrium is stable", name)
        elif count:
            # with more negative directions than rigid motions, the shell buckles whatever its supports
            unheld = unheld_motions(system) if count <= N_RIGID_MOTIONS else ""
            log.warning(
                "object %s: the equilibrium is unstable, its Hessian has %d negative eigenvalue%s; %s",
                name, count, "s" * (count > 1),
                f"{unheld}, hold it by pins" if unheld
                else "give it a small load in the direction in which it should buckle",
            )  # fmt: skip
    return total


def failure_reason(outcome: Outcome, least: RunRounding, *, static: bool) -> str:
    """Reason why the result is unreliable: the energy grew, or a closed shell turned inside out.

    It is unreliable if the energy more than doubled or overflowed; a smaller rise is a warning. Energy beyond
    the initial one and the work of handles, time-dependent loads and wind comes from the scheme. The scale is
    the available energy: the initial energy above the lowest potential energy of the run, plus the largest
    external work.

    Parameters
    ----------
    outcome : Outcome
    least : RunRounding
        Rounding; rises within it are not significant.
    static : bool
        Whether the frames are equilibria, whose energies are not checked.

    Returns
    -------
    str
        Empty if it is reliable.
    """
    total, kinetic = outcome.series["energy"], outcome.series["energy_kinetic"]
    if not np.isfinite(total).all():
        message = "the energy overflows; use smaller velocities, forces or accelerations"
        log.error(message)
        return message
    if message := _inverted(outcome.series):
        log.error(message)
        return message
    strain, names = outcome.largest.get("strain", 0.0), set(outcome.series)
    if strain > MAX_ELASTIC_STRAIN and "energy_stretching" in names and "plastic_work" not in names:
        log.warning(
            "an edge changes its length by %.3g times that at rest, where `stretching`, a law of small "
            "strains, means little: lessen the loads",
            strain,
        )
    if strain > UNRESISTED_STRAIN and not {"energy_stretching", "rigid_error"} & names:
        log.warning(
            "an edge changes its length by %.3g times that at rest, and no effect of the scene resists it; "
            "add `stretching`",
            strain,
        )
    if static:
        return ""
    work = np.zeros_like(total) + _work(outcome.series)
    energy = total - work
    growth, available = float(np.max(energy) - energy[0]), float(total[0] - np.min(total - kinetic))
    scale = max(available + float(np.max(np.abs(work))), least.energy)
    if not growth > ENERGY_GROWTH_WARNING * scale + least.energy:
        return ""
    message = (
        f"the energy grew by {growth / scale:.3g} of the available energy, which no force explains: the step "
        "is too long for this scheme; shorten it, or take implicit-euler"
    )
    fails = growth > ENERGY_GROWTH_FAILURE * scale + least.energy
    log.log(logging.ERROR if fails else logging.WARNING, message)
    return message if fails else ""


def _inverted(series: dict[str, NDArray]) -> str:
    """Error of a closed shell whose volume has changed its sign, or ""."""
    for name, volume in series.items():
        if name.startswith(VOLUME) and (volume * volume[0] < 0.0).any():
            return (
                f"{name.removeprefix(VOLUME)} passes through itself and turns inside out under its pressure: "
                "lessen the pressure, use a gas, or write contact = { self_contact = true }"
            )
    return ""


def _work(series: dict[str, NDArray]) -> Any:
    """External work, less the energy that cracks have released, in J in every frame."""
    return series.get("external_work", 0.0) - series.get("fracture_energy", 0.0)


def _drift(series: np.ndarray, scale: float, rounding: float) -> float:
    """Largest |q - q0| over the frames, divided by the scale; 0 within rounding."""
    change = float(np.abs(series - series[0]).max())
    return change / max(scale, rounding) if change > rounding else 0.0


def _linear_solver_accuracy(systems: dict[str, System]) -> dict[str, Any]:
    """Fields of `accuracy` for a run whose steps were solved by conjugate gradients; else empty."""
    solvers = [system.cache[LINEAR_SOLVER] for system in systems.values() if LINEAR_SOLVER in system.cache]
    if not solvers:
        return {}
    return {
        "step_solver": solvers[0].name,
        "step_solver_iterations": max(solver.most_iterations for solver in solvers),
        "step_solver_residual": max(solver.residual for solver in solvers),
    }
