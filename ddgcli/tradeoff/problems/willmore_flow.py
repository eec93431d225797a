"""Willmore flow: energy or area at a fixed time by step, against a run with small steps."""

from __future__ import annotations

import itertools
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.mesh.require import require
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import setup
from ddgcli.models.willmore.energies import ENERGIES
from ddgcli.models.willmore.option_checks import chosen_scheme, schemes_of
from ddgcli.models.willmore.report import FLAT_ENERGY
from ddgcli.simulation.account import Account
from ddgcli.simulation.model import RunFailed
from ddgcli.simulation.time_loop import evolve
from ddgcli.tradeoff.candidates import (
    NO_OPTIONS,
    Candidate,
    CommandOptions,
    ErrorNorms,
    MeshLimit,
    Problem,
    Reference,
    relative_to_each,
)
from ddgcli.tradeoff.richardson import mesh_limit, remaining_error
from ddgcli.tradeoff.smooth_surface import smoothly_subdivided

FLOW_OPTIONS = ("flow", "energy", "boundary", "fix_area", "fix_volume")
STEPS = (2, 4, 8, 16)
TOLERANCES = (1e-3, 1e-4, 1e-5)
REFINEMENTS, MESH_STEPS = (2, 1), 16  # of the limits of fine meshes
REFERENCE_STEPS = (64, 16, 8)  # runs with 1/2, 1/4 and 1/8 as many steps give the uncertainty


def problem(
    mesh: TriangleMesh, *, options: CommandOptions = NO_OPTIONS, error_part: str = "both", **_: Any
) -> Problem:
    """Energy after a fixed time; for `mean-curvature` flow the area, which that flow lowers.

    The default time is a thousandth of the fourth power of the surface's radius, for `mean-curvature` a
    hundredth of its square.

    `options` may contain `duration`, `steps`, `step`, `tolerance`, `integrator`, `flow`, `energy`,
    `boundary`, `fix_area`, `fix_volume`.
    """
    require(mesh, "willmore-flow", faces=True, sized=True)
    radius = float(np.sqrt(face_area(mesh.side_length).sum() / (4 * np.pi)))
    fixed_options = {name: options[name] for name in FLOW_OPTIONS if name in options}
    flow = fixed_options.get("flow", "quadratic")
    curvature = flow == "mean-curvature"
    span = options.get("duration") or (1e-2 * radius**2 if curvature else 1e-3 * radius**2 * radius**2)
    if "step" in options:
        span = options["step"] * options["steps"] if "steps" in options else options.get("duration", span)
        counts = sorted({max(1, round(span / (options["step"] * f))) for f in (4.0, 2.0, 1.0, 0.5)})
    else:
        counts = [options["steps"]] if "steps" in options else list(STEPS)
    tolerances = (options["tolerance"],) if "tolerance" in options else TOLERANCES
    lowered = _lowered(fixed_options)
    work = 1e-2 + 1e-5 * mesh.n_faces
    flow_options = setup.FlowOptions(flow=flow, timed=True, integrator=options.get("integrator"))
    schemes = (chosen_scheme(flow_options),) if flow_options.integrator else schemes_of(flow)
    return Problem(
        candidates=[
            *(
                _candidate(mesh, fixed_options, span, s, {"step": span / n}, n * work)
                for n in counts
                for s in schemes
            ),
            *(
                _candidate(mesh, fixed_options, span, schemes[0], {"tolerance": t}, 4 * t**-0.3 * work)
                for t in tolerances
            ),
        ],
        references=[
            (1.875 * steps * work, partial(_reference, mesh, fixed_options, span, steps))
            for steps in REFERENCE_STEPS
        ],
        error=partial(relative_to_each, least=_least(lowered)),
        error_scale=f"the {lowered} of the reference at t = {span:.6g}",
        place=lowered,
        query=f"run of {span:.3g}",
        error_part=error_part,
        remark="" if lowered == "area" else _remark(mesh, fixed_options),
        mesh_limits=[
            (MESH_STEPS * 4.5**times * 1.5 * work, partial(_fine_meshes, mesh, fixed_options, span, times))
            for times in REFINEMENTS
        ],
    )


def _remark(mesh: TriangleMesh, fixed_options: CommandOptions) -> str:
    """What the errors do not contain: the distance of the energy from an integral."""
    name = setup.chosen_energy(mesh.topology, setup.FlowOptions(timed=True, **fixed_options))
    if ENERGIES[name].converges:
        return ""
    return (
        f"the limit of energy {name} depends on how the edges lie; its distance from int H^2 is not an error"
    )


def _setup(mesh: TriangleMesh, fixed_options: CommandOptions, span: float, parameters: CommandOptions) -> Any:
    flow, model = setup.build(mesh, setup.FlowOptions(**{"timed": True, **fixed_options}))
    schedule = setup.schedule(flow, {**parameters, "duration": span, "frame_every": span})
    return model, schedule, _lowered(fixed_options)


def _lowered(fixed_options: CommandOptions) -> str:
    """Name of what the flow lowers."""
    return "area" if fixed_options.get("flow") == "mean-curvature" else "energy"


def _least(lowered: str) -> float:
    """Scale of the errors of smaller answers: the energy of flat surfaces is rounding."""
    return FLAT_ENERGY if lowered == "energy" else 0.0


def _answer(state: Any) -> NDArray[np.float64]:
    """Energy or area at the end."""
    model, schedule, name = state
    last = None
    for snapshot in evolve({"surface": model}, schedule, Account()):
        last = snapshot.observations["surface"].scalar[name]
        if snapshot.stopped:
            raise SolveError(f"the flow ends at time {snapshot.time:.4g}: {snapshot.stopped}")
    return np.array([last], dtype=np.float64)


def _candidate(
    mesh: TriangleMesh,
    fixed_options: CommandOptions,
    span: float,
    scheme: str,
    parameters: dict[str, float],
    work: float,
) -> Candidate:
    name, value = next(iter(parameters.items()))
    option = {"step": "dt"}.get(name, name)
    times = {option: repr(value), "duration": repr(span), "frame_every": repr(span)}
    return Candidate(
        scheme + (" adaptive" if name == "tolerance" else ""),
        {option: value},
        lambda: _setup(mesh, {**fixed_options, "integrator": scheme}, span, parameters),
        _answer,
        {"integrator": scheme, **times},
        work,
    )


def _reference(mesh: TriangleMesh, fixed_options: CommandOptions, span: float, steps: int) -> Reference:
    counts = [steps // 8, steps // 4, steps // 2, steps]
    runs = [_reference_run(mesh, fixed_options, span, n) for n in counts]
    lowered = _lowered(fixed_options)
    scale = max(abs(runs[-1]), _least(lowered)) or 1.0
    differences = ((b - a) / scale for a, b in itertools.pairwise(runs))
    gap = remaining_error(*differences, order=1.0 if lowered == "area" else 2.0)
    name = f"{steps} steps (uncertainty from {counts[2]}, {counts[1]} and {counts[0]} steps)"
    return Reference(name, np.array(runs[-1:]), gap)


def _reference_run(mesh: TriangleMesh, fixed_options: CommandOptions, span: float, steps: int) -> float:
    """Energy or area at the end of a run of the reference.

    Raises
    ------
    SolveError
        Names the run, and the time for which others may succeed: its step is not one of the caller's.
    """
    try:
        return float(_answer(_setup(mesh, fixed_options, span, {"step": span / steps}))[0])
    except RunFailed as error:
        run = f"{steps} step{'s' * (steps > 1)} over a time of {span:.3g}"
        raise SolveError(
            f"no reference: its run of {run} failed at {error}, with a `duration` of two such steps"
        ) from error


def _fine_meshes(mesh: TriangleMesh, fixed_options: CommandOptions, span: float, times: int) -> MeshLimit:
    """Limit of the energy or area at the end on meshes refined up to `times` times."""
    meshes = [mesh]
    for _ in range(times):
        meshes.append(smoothly_subdivided(meshes[-1]))
    coarse, fine = (
        [_answer(_setup(m, fixed_options, span, {"step": span / n})) for m in some]
        for n, some in ((MESH_STEPS // 2, meshes[:1]), (MESH_STEPS, meshes))
    )
    limit, other = mesh_limit(*fine)
    # the error in time of these runs: that of a method of first order, at the least
    errors = partial(relative_to_each, least=_least(_lowered(fixed_options)))
    in_time = 2.0 * errors(coarse[0], fine[0])
    uncertainty = ErrorNorms.of(errors(other, limit)) + ErrorNorms.of(in_time)
    return MeshLimit(f"meshes up to {2**times} times as fine, extrapolated", limit, uncertainty)
