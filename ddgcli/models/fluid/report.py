"""Results and accuracy of a fluid run, from the scalars of its frames."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.edge_lookup import edge_indices
from ddgcli.mesh.fields import TrajectoryFrame
from ddgcli.mesh.periodic import crosses_side
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.flow_mesh import harmonic_count
from ddgcli.models.fluid.lost_forces import warn_of_lost_transport
from ddgcli.models.fluid.model import FluidModel
from ddgcli.models.fluid.state import CORRECTIONS
from ddgcli.models.fluid.vorticity_resolution import warn_of_unresolved_vorticity
from ddgcli.scenes.scene import Scene
from ddgcli.simulation.account import Account
from ddgcli.simulation.model import Schedule
from ddgcli.simulation.outcome import Outcome

log = logging.getLogger("ddgcli")
MAX_LOSS_SHARE = 0.05  # share of energy or enstrophy lost by the scheme, above which a run warns
LOSS_ORDER = 5  # of what Runge-Kutta steps lose over a time, in the step
# effects that do no work where no fluid crosses the boundary and nothing is viscous
IDLE_EFFECTS = {"initial", "boundary", "harmonic", "rotation", "pressure", "dye", "particles"}
TOTALS = ("kinetic_energy", "enstrophy", "absolute_vorticity")  # of frames, as the `SIZES` of losses
CARRYING_INTEGRATORS = ("circulation", "covector")  # which share circulation among boundary loops by the mesh
VORTICITY_ROUNDING = 1e-12  # vorticity over the circulations that cancel in it, below which it counts as none
# of the energy: vorticity with less is what a mesh adds to a flow without, and its losses do not matter
MESH_VORTICITY_SHARE = 1e-4


def summary(outcome: Outcome, models: Mapping[str, FluidModel]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Results and accuracy of a run of fluids: values at the end, and the largest departures from the start.

    Drifts are relative: energy and enstrophy to their sizes at the start (or, from a start at rest, to their
    largest), total vorticity and circulations to the total absolute vorticity at the start. Vorticity and
    enstrophy that are the rounding of a flow without vorticity count as zero.

    Parameters
    ----------
    outcome : Outcome
    models : mapping of str to FluidModel

    Returns
    -------
    results, accuracy : dict
    """
    least_energy = sum(model.rounding_energy for model in models.values())
    totals = np.stack([outcome.series[name] for name in TOTALS], axis=1)
    circulation, enstrophy = _scales(totals[0], totals.max(axis=0), models, least_energy)
    losses, largest_energy = _scheme_losses(outcome.series, totals, models, least_energy)
    results = _results(outcome, models)
    accuracy = _drifts(outcome.series, least_energy, circulation, enstrophy) | losses
    integrator, remedy = results["integrator"], _remedy_for_losses(models)
    if "corrections" in outcome.series:
        counts = outcome.series["corrections"][-1]
        results["corrections"] = _corrections(counts, largest_energy, integrator, remedy)
    if integrator == "conservative":
        if _keeps_energy(models):
            losses = {"energy_lost_by_scheme": accuracy["energy_drift"], **losses}
        remedy = _remedy_by_steps(losses, outcome.smallest_step) or remedy
    _warn_of_losses(losses, integrator, remedy)
    if integrator in CARRYING_INTEGRATORS and _keeps_energy(models):
        _warn_of_circulation(accuracy["circulation_drift"], integrator, remedy)
    _warn_of_unresolved_vorticity(models)
    _warn_of_lost_transport(outcome.last, models)
    return results, accuracy | _linear_solver_accuracy(models)


def _results(outcome: Outcome, models: Mapping[str, FluidModel]) -> dict[str, Any]:
    """Values at the end, and steps."""
    names, series = list(models), outcome.series
    results: dict[str, Any] = {
        "integrator": next(iter(models.values())).scene.time.integrator,
        "frames": outcome.n_frames,
        **outcome.step_counts,
    }
    for name in ("kinetic_energy", "enstrophy", "total_vorticity"):
        results[name] = float(series[name][-1])
    results["kinetic_energy_start"] = float(series["kinetic_energy"][0])
    results["enstrophy_start"] = float(series["enstrophy"][0])
    results["circulation"] = {
        "boundary": _at_end(series, "boundary_circulation", names),
        "generators": generator_circulations(outcome.last, models),
    }
    results["harmonic_coefficients"] = _at_end(series, "harmonic_coefficients", names)
    triangulations = {n: m.context.triangulation for n, m in models.items() if m.context.triangulation}
    if triangulations:
        results["triangulation"] = triangulations
    forces = {k.removeprefix("force_"): series[k][-1].tolist() for k in series if k.startswith("force_")}
    if forces:
        results["forces"] = forces
    for name in ("total_dye", "total_temperature"):
        if name in series:
            results[name] = float(series[name][-1])
    return results


def _drifts(
    series: Mapping[str, NDArray], least_energy: float, circulation: float, enstrophy: float
) -> dict[str, float]:
    """Largest departures from the start, over the sizes of circulations and of enstrophy."""
    energy = float(series["kinetic_energy"][0])
    if not energy > least_energy:
        energy = max(float(series["kinetic_energy"].max()), least_energy)
    drifts = {
        "divergence_max": float(series["divergence"].max()),
        "total_vorticity_drift": _drift(series["total_vorticity"], circulation),
        "energy_drift": _drift(series["kinetic_energy"], energy),
        "enstrophy_drift": _drift(series["enstrophy"], enstrophy),
        "circulation_drift": max(
            [_drift(series[k], circulation) for k in series if k.startswith("boundary_circulation")]
            or [_drift(series["total_vorticity"], circulation)]
        ),
    }
    if "total_dye" in series:
        drifts["dye_drift"] = _drift(series["total_dye"], float(series["absolute_dye"][0]))
    return drifts


def _remedy_for_losses(models: Mapping[str, FluidModel]) -> str:
    # of the integrators that keep energy, volumes have `energy` alone
    alternative = "energy" if any(m.context.is_volume for m in models.values()) else "conservative"
    return f"integrator {alternative}, or a finer or more regular mesh"


def _remedy_by_steps(losses: Mapping[str, float], smallest_step: float) -> str:
    """Steps that bring the largest loss below half its limit; "" where none exceeds it."""
    worst = max(losses.values(), default=0.0)
    if worst <= MAX_LOSS_SHARE or not smallest_step:
        return ""
    step = smallest_step * (0.5 * MAX_LOSS_SHARE / worst) ** (1.0 / LOSS_ORDER)
    return f"steps of {step:.2g} s, or integrator energy"


def _linear_solver_accuracy(models: Mapping[str, FluidModel]) -> dict[str, Any]:
    """Fields of `accuracy` of a run whose steps were solved by conjugate gradients; none otherwise."""
    solvers = [model.space.factor.iterative for model in models.values()]
    iterative = [solver for solver in solvers if solver is not None]
    if not iterative:
        return {}
    return {
        "step_solver": iterative[0].name,
        "step_solver_iterations": max(solver.most_iterations for solver in iterative),
        "step_solver_residual": max(solver.residual for solver in iterative),
    }


def _scheme_losses(
    series: Mapping[str, NDArray], totals: NDArray, models: Mapping[str, FluidModel], least_energy: float
) -> tuple[dict[str, float], float]:
    """Shares of energy and enstrophy that the transport lost, where it books them, and what the first is of.

    They are shares of the largest value over the steps and of what walls without slip supplied. Of the
    `TOTALS` of the frames only those that every run has count: at the start and at the end.
    """
    if "loss_sizes" not in series:
        return {}, 0.0
    largest = np.maximum(series["loss_sizes"][-1], np.maximum(totals[0], totals[-1]))
    _, least_enstrophy = _scales(totals[0], largest, models, least_energy)
    sizes = np.maximum(largest[:2], [least_energy, least_enstrophy]) + series["supplies"][-1]
    losses = {
        f"{name}_lost_by_scheme": float(series[f"lost_{name}"][-1]) / (size or 1.0)
        for name, size in zip(("energy", "enstrophy"), sizes.tolist())
        if f"lost_{name}" in series
    }
    return losses, float(sizes[0])


def _keeps_energy(models: Mapping[str, FluidModel]) -> bool:
    """Whether nothing but the steps in time changes the kinetic energy of integrators that conserve it."""
    return all(
        model.setting.effects <= IDLE_EFFECTS
        and not model.setting.is_open
        and (model.context.is_volume or model.setting.evolve_harmonic or not len(model.space.harmonic))
        for model in models.values()
    )


def _warn_of_losses(losses: Mapping[str, float], integrator: str, remedy: str) -> None:
    for name, share in losses.items():
        if share > MAX_LOSS_SHARE:
            log.warning(
                "integrator %s lost %.2g %% of the %s (warned of above %.0f %%): take %s",
                integrator, 100.0 * share, name.split("_")[0], 100.0 * MAX_LOSS_SHARE, remedy,
            )  # fmt: skip


def _warn_of_circulation(drift: float, integrator: str, remedy: str) -> None:
    if drift > MAX_LOSS_SHARE:
        log.warning(
            "integrator %s changed the circulation along a boundary loop, which is constant, by %.2g %% of "
            "the vorticity (warned of above %.0f %%): take %s",
            integrator, 100.0 * drift, 100.0 * MAX_LOSS_SHARE, remedy,
        )  # fmt: skip


def _warn_of_unresolved_vorticity(models: Mapping[str, FluidModel]) -> None:
    for name, model in models.items():
        if not model.context.is_volume:
            energy = model.flows.energy(model.start)
            warn_of_unresolved_vorticity(name, model.space, model.start["vorticity"], energy)


def _warn_of_lost_transport(last: TrajectoryFrame | None, models: Mapping[str, FluidModel]) -> None:
    start = 0
    for model in models.values():
        space, here = model.space, slice(start, start + model.space.n)
        start += space.n
        if not model.context.is_volume:
            at_end = [] if last is None else [last.vertex["vorticity"][here] * space.mass]
            duration = model.scene.time.duration
            warn_of_lost_transport(model.setting, [model.start["vorticity"], *at_end], duration)


def _corrections(counts: NDArray, energy: float, integrator: str, remedy: str) -> dict[str, float]:
    """In how many parts of steps each correction acted; warn where the last resort took much `energy`."""
    steps, *acted, removed = counts.tolist()
    share = removed / (energy or 1.0)
    by_name = {name: int(count) for name, count in zip(CORRECTIONS, acted)}
    if share > MAX_LOSS_SHARE:
        log.warning(
            "integrator %s scaled the flow in %d of %d steps, a last resort that took %.2g %% of the energy "
            "(warned of above %.0f %%): take %s",
            integrator, by_name["scaling"], int(steps), 100.0 * share, 100.0 * MAX_LOSS_SHARE, remedy,
        )  # fmt: skip
    return {"steps": int(steps), **by_name, CORRECTIONS[-1]: share}


def _at_end(series: Mapping[str, NDArray], what: str, names: list[str]) -> list[float]:
    circulations: list[float] = []
    for name in names:
        if f"{what}_{name}" in series:
            circulations += np.atleast_1d(series[f"{what}_{name}"][-1]).tolist()
    return circulations


def _scales(
    start: NDArray, largest: NDArray, models: Mapping[str, FluidModel], least_energy: float
) -> tuple[float, float]:
    """Sizes that changes of circulations and of enstrophy are relative to, from `TOTALS`.

    Their own sizes at the start, or the largest after a start whose vorticity is rounding; or, where that
    never exceeds the rounding of the flow, what the terms that cancel in it amount to. Vorticity at the start
    that has less than `MESH_VORTICITY_SHARE` of the energy counts as if it had this share.
    """
    terms = [model.flows.circulation_terms() for model in models.values()]
    energy, enstrophy, vorticity = largest.tolist()
    speed = math.sqrt(2.0 * max(energy, least_energy))
    circulation = speed * sum(t for t, _ in terms)
    if not (energy > least_energy and vorticity > VORTICITY_ROUNDING * circulation):
        return circulation, speed**2 * sum(t for _, t in terms)
    _, enstrophy_start, vorticity_start = start.tolist()
    if not vorticity_start > VORTICITY_ROUNDING * circulation:
        return vorticity, enstrophy
    growth = _growth_of_mesh_vorticity(models, enstrophy_start)
    return math.sqrt(growth) * vorticity_start, growth * enstrophy_start


def _growth_of_mesh_vorticity(models: Mapping[str, FluidModel], enstrophy: float) -> float:
    """Factor of the enstrophy at the start with which its vorticity has the least share of the energy, or 1.

    At most that of a flow which turns as a whole. 1 of volumes, and where walls make the vorticity.
    """
    rotational = energy = area = 0.0
    for model in models.values():
        if model.context.is_volume or model.setting.no_slip:
            return 1.0
        vorticity = model.start["vorticity"]
        rotational += 0.5 * float(model.space.stream_function_change(vorticity) @ vorticity)
        energy += model.flows.energy(model.start)
        area += model.flows.measure
    if not rotational < MESH_VORTICITY_SHARE * energy:
        return 1.0
    as_a_whole = energy / (area * enstrophy) if enstrophy else 1.0
    by_share = MESH_VORTICITY_SHARE * energy / rotational if rotational > 0 else as_a_whole
    return max(min(by_share, as_a_whole), 1.0)


def _drift(values: NDArray, scale: float) -> float:
    """Largest |q - q0| over the frames, over the scale (or the largest |q|, or 1)."""
    largest = float(np.abs(values - values[0]).max())
    return largest / (scale or float(np.abs(values).max()) or 1.0)


def generator_circulations(last: TrajectoryFrame | None, models: Mapping[str, FluidModel]) -> list[float]:
    """Circulation at the end along edge loops that generate the homology, object by object.

    Along an edge the velocity is the mean of its faces'.
    """
    circulations: list[float] = []
    if last is None:
        return circulations
    start = 0
    for model in models.values():
        if model.context.is_volume:
            start += model.space.n
            continue
        space = model.space
        vorticity = last.vertex["vorticity"][start : start + space.n] * space.mass
        start += space.n
        if harmonic_count(space.mesh) == 0:
            continue
        circulations += _loops(model, vorticity, last)
    return circulations


def _loops(model: FluidModel, vorticity: NDArray, last: TrajectoryFrame) -> list[float]:
    from ddgcli.algorithms.hodge.homology import generator_loops

    space = model.space
    coefficients = last.scalar.get(f"harmonic_coefficients_{model.context.name}", ())
    time = last.time if model.setting.needs_time else 0.0
    flux = space.side_flux(space.stream_function(vorticity, time), np.atleast_1d(coefficients))
    velocity = space.face_velocity(flux)
    along = (velocity[:, None] * np.conj(space.side)).real * space.side_sign
    topology = space.mesh.topology
    on_edge = sum_by_index(space.side_edge, along, topology.n_edges) / topology.edge_face_count
    circulations = []
    for loop in generator_loops(space.mesh):
        tail, head = loop, np.roll(loop, -1)
        edge = edge_indices(topology.edges, np.stack([tail, head], axis=1))
        circulations.append(float(np.sum(np.where(topology.edges[edge, 0] == tail, 1, -1) * on_edge[edge])))
    return circulations


def assembled(
    scene: Scene, models: Mapping[str, FluidModel], schedule: Schedule, account: Account
) -> dict[str, Any]:
    """What a scene would build, for a dry run.

    Parameters
    ----------
    scene : Scene
    models : mapping of str to FluidModel
    schedule : Schedule
    account : Account

    Returns
    -------
    dict
    """
    return {
        "steps": schedule.steps,
        "frames": schedule.n_frames,
        "integrator": scene.time.integrator,
        "effects": [effect.name for effect, _, _ in scene.effects],
        "fluids": {name: model.space.assembled() for name, model in models.items()},
    }


def face_arrays(contexts: Sequence[FluidContext]) -> dict[str, NDArray]:
    """Constant arrays on faces for the trajectory: `wraps` where a grid is periodic.

    It marks the faces that, drawn between the vertices' positions, would span the grid.

    Parameters
    ----------
    contexts : sequence of FluidContext
        Of all fluids.

    Returns
    -------
    dict of str to ndarray
    """
    extent = [(np.ptp(context.points[context.cells], axis=1), context.period) for context in contexts]
    marked = np.concatenate([crosses_side(size, period).any(axis=1) for size, period in extent])
    return {"wraps": marked.astype(np.int8)} if marked.any() else {}
