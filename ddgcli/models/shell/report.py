"""Results and accuracy of a shell run, and what a dry run tells."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np

from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.model import make_system
from ddgcli.scenes.scene import Scene
from ddgcli.simulation.account import Account
from ddgcli.simulation.outcome import Outcome
from ddgcli.simulation.time_loop import Schedule

# of the energy at hand: more is told; more is not to be trusted, exit 1
GROWTH, BEYOND_TRUST = 0.1, 1.0


def summary(outcome: Outcome, shells: dict[str, ShellContext]) -> tuple[dict[str, Any], dict[str, Any]]:
    """(`results`, `accuracy`) of a run.

    Scales of the drifts: energy, the largest kinetic energy or change of a part of the energy; momentum, the
    mass times the largest speed; angular momentum, that times the size of the shells.
    """
    series, last = outcome.series, outcome.end
    energies = {
        name.removeprefix("energy_"): {"start": float(values[0]), "end": float(values[-1])}
        for name, values in series.items()
        if name.startswith("energy_")
    }
    energies["total"] = {"start": float(series["energy"][0]), "end": float(series["energy"][-1])}
    results = {
        "frames": outcome.frames,
        "time": last.time,
        "steps": outcome.steps,
        **({"smallest_step": outcome.smallest_step} if outcome.steps else {}),
        "rejected_steps": outcome.events,
        "newton_iterations": int(series["newton_iterations"][-1]),
        "energies": energies,
        "momentum": last.scalar["momentum"],
        "angular_momentum": last.scalar["angular_momentum"],
    }
    if outcome.failure:
        results["stopped_because"] = outcome.failure
    mass = sum(float(c.mass.sum()) for c in shells.values())
    size = max(float(np.ptp(c.mesh.points, axis=0).max()) for c in shells.values())
    swing = [np.ptp(v) for name, v in series.items() if name.startswith("energy_")]
    energy_scale = max([float(np.abs(series["energy_kinetic"]).max()), *map(float, swing)])
    momentum_scale = mass * outcome.largest.get("velocity", 0.0)
    accuracy = {
        "energy_drift": _drift(series["energy"], energy_scale),
        "momentum_drift": _drift(series["momentum"], momentum_scale),
        "angular_momentum_drift": _drift(series["angular_momentum"], momentum_scale * size),
        "max_strain": outcome.largest.get("strain", 0.0),
    }
    return results, accuracy


def doubt(series: dict[str, np.ndarray]) -> str:
    """Why the run is not to be trusted: its energy more than doubled. A smaller rise is a warning.

    No force of a shell gives energy: what rises above the start comes from the scheme.
    """
    inner = ("energy_kinetic", "energy_stretching", "energy_bending", "energy_contact")
    at_start = sum(float(series[name][0]) for name in inner if name in series)
    given = sum(float(np.ptp(v)) for n, v in series.items() if n.startswith("energy_") and n not in inner)
    growth = float(np.max(series["energy"]) - series["energy"][0])
    if not at_start + given > 0 or growth <= GROWTH * (at_start + given):
        return ""
    told = (
        f"the energy grew by {growth / (at_start + given):.3g} of what there is to move, and no force can do "
        "that: the step is too long for this scheme; shorten it, or take implicit-euler"
    )
    logging.getLogger("ddgcli").warning(told)
    return told if growth > BEYOND_TRUST * (at_start + given) else ""


def _drift(series: np.ndarray, scale: float) -> float:
    """Largest |q - q0| over the frames by the scale; 0 where nothing moved."""
    change = float(np.abs(series - series[0]).max())
    return change / scale if scale > 0 else change


def assembled(
    scene: Scene, shells: dict[str, ShellContext], schedule: Schedule, account: Account
) -> dict[str, Any]:
    """What the scene would build: sizes, terms, steps."""
    told: dict[str, Any] = {
        "integrator": scene.time.integrator,
        "order": INTEGRATORS[scene.time.integrator].order,
        "steps": schedule.steps,
        "frames": schedule.frames,
        "step": schedule.dt,
    }
    for name, context in shells.items():
        system = make_system(scene, context, account)
        acting: list[Any] = [*system.potentials, *system.dissipations]
        terms = {p.name: f"{type(p).__name__}, {len(p.stencil)} elements" for p in acting}
        told[name] = {
            "vertices": context.mesh.n_vertices,
            "faces": context.mesh.n_faces,
            "mass": float(context.mass.sum()),
            "free_coordinates": int(system.free.sum()),
            "terms": terms,
        }
    return told
