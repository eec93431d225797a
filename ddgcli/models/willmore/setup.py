"""From a mesh and options to a flow."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.choices import WILLMORE_BOUNDARIES, WILLMORE_ENERGIES, WILLMORE_FLOWS
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.mesh.require import require
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.constraints import Constraints, area
from ddgcli.models.willmore.energies import DEFAULT, ENERGIES, OPEN_DEFAULT, SECOND, Energy
from ddgcli.models.willmore.flow import SCHEMES, Flow, FlowState, Stop, longest_step
from ddgcli.models.willmore.scaled import centred_at_unit_size
from ddgcli.simulation.time_loop import Model, Schedule

HELD = "no vertex can move: all lie on the boundary or, if that is clamped, beside it"
MOST_STEPS = 1000
FRAMES = 50
# default length of timed steps, in radius^4 (mean curvature flow: radius^2) of the sphere of the same area
TIMED, TIMED_CURVATURE = 5e-3, 2e-3


@dataclass(frozen=True)
class Wishes:
    """Options of a flow.

    Parameters
    ----------
    energy : str or None
        Of ENERGIES; None for the default, see `chosen_energy`.
    flow, boundary : str
        Of WILLMORE_FLOWS, WILLMORE_BOUNDARIES.
    fix_area, fix_volume : bool
    timed : bool
        Steps of a given length, by a time scheme; else the longest that descend.
    integrator : str or None
        Of SCHEMES of the flow; None for the default.
    stop : Stop
    """

    energy: str | None = None
    flow: str = "quadratic"
    boundary: str = "clamped"
    fix_area: bool = False
    fix_volume: bool = False
    timed: bool = False
    integrator: str | None = None
    stop: Stop = Stop()


def described(wishes: Wishes) -> dict[str, Any]:
    """The wishes as plain data."""
    return asdict(wishes)


def free_vertices(topology: Topology, boundary: str) -> NDArray[np.int64]:
    """Vertices that move: `fixed` holds the boundary, `clamped` also its neighbours (and so the normals)."""
    held = np.array(topology.boundary_vertex)
    if boundary == "clamped":
        held[topology.faces[held[topology.faces].any(axis=1)]] = True
    return np.flatnonzero(topology.referenced_vertex & ~held)


def chosen_energy(topology: Topology, wishes: Wishes) -> str:
    """The energy's name: the one asked for, else `gauss-map` on closed surfaces and `cotan` on open ones.

    Raises
    ------
    ParameterError
        When `gauss-map` is wished where it does not hold.
    """
    free_slope = wishes.boundary == "fixed" and not topology.is_closed
    if free_slope and wishes.energy == DEFAULT:
        raise ParameterError(
            f"energy {DEFAULT!r} leaves the faces at the boundary out, where the slope is free; use "
            f"--energy {OPEN_DEFAULT} or --boundary clamped"
        )
    return wishes.energy or (DEFAULT if topology.is_closed else OPEN_DEFAULT)


def _require_known(value: str, known: tuple[str, ...], what: str) -> None:
    if value not in known:
        raise ParameterError(f"{what} {value!r} is not available; choose one of {', '.join(known)}")


def schemes_of(flow: str) -> tuple[str, ...]:
    """Time schemes of a flow, the default first.

    Raises
    ------
    ParameterError
        When there is no such flow.
    """
    _require_known(flow, WILLMORE_FLOWS, "flow")
    return SCHEMES[flow]


def chosen_scheme(wishes: Wishes) -> str:
    """The time scheme's name: as wished, or the flow's default.

    Raises
    ------
    ParameterError
        When the flow has no such scheme, or follows no clock.
    """
    schemes = schemes_of(wishes.flow)
    if wishes.integrator is None:
        return schemes[0]
    if wishes.integrator not in schemes:
        raise ParameterError(
            f"integrator {wishes.integrator!r} is not available with --flow {wishes.flow}; choose "
            f"{' or '.join(schemes)}"
        )
    if not wishes.timed:
        raise ParameterError("--integrator needs --dt or --duration: else steps descend, and follow no clock")
    return wishes.integrator


def least_energy(topology: Topology) -> float:
    """Least int H^2 that a surface in space of this topology has: 4 pi a sphere, 2 pi^2 any other closed one.

    Notes
    -----
    T. J. Willmore, 1965; F. Marques, A. Neves, "Min-max theory and the Willmore conjecture", 2014.
    """
    n, component = topology.n_components, topology.vertex_component
    opened = np.bincount(component[topology.boundary_vertex], minlength=n) > 0
    vertices = np.bincount(component[topology.referenced_vertex], minlength=n)
    faces = np.bincount(topology.face_component, minlength=n)
    # a closed part has three sides a face, each shared by two
    least = np.where(2 * vertices - faces == 4, 4.0 * np.pi, 2.0 * np.pi**2)
    return float(least[~opened & (faces > 0)].sum())


def second_energy(chosen: str, topology: Topology, constraints: Constraints) -> Energy | None:
    """A second energy to look at where `gauss-map` may fall by crumpling.

    Where nothing is kept on closed parts of genus 0 it cannot: there it is never below 4 pi, and at 4 pi only
    on round spheres.
    """
    round_only = topology.euler_characteristic == 2 * topology.n_components and not constraints.active
    if chosen != DEFAULT or round_only or not topology.is_closed:
        return None
    return ENERGIES[SECOND].build(topology)


def build(mesh: TriangleMesh, wishes: Wishes) -> tuple[Flow, Model]:
    """The flow of a mesh, and the model that the time loop drives.

    Raises
    ------
    MeshError, ParameterError
        On a mesh or a wish that the flow cannot take.
    """
    chosen = chosen_energy(mesh.topology, wishes)
    _require_known(chosen, WILLMORE_ENERGIES, "energy")
    _require_known(wishes.boundary, WILLMORE_BOUNDARIES, "boundary")
    scheme = chosen_scheme(wishes)
    unit, centre, scale = centred_at_unit_size(mesh)
    topology = mesh.topology
    free = free_vertices(topology, wishes.boundary)
    if wishes.fix_volume:
        require(mesh, "`fix_volume`", closed=True)
    mean_curvature = wishes.flow == "mean-curvature"
    if mean_curvature and (wishes.fix_area or wishes.fix_volume):
        raise ParameterError("--flow mean-curvature keeps neither area nor volume; use --flow quadratic")
    constraints = Constraints(
        area(unit) if wishes.fix_area else None, enclosed_volume(unit) if wishes.fix_volume else None
    )
    if constraints.volume is not None and abs(constraints.volume) < 1e-9:
        raise MeshError("the surface encloses no volume; --fix-volume has nothing to keep")
    energy = ENERGIES[chosen].build(topology)
    started = energy.value(unit.points)
    if not math.isfinite(started):
        raise MeshError(
            f"the {chosen} energy is not finite here: at some vertex the faces' normals cancel; "
            "unfold it or use --energy cotan"
        )
    convention = ENERGIES[chosen].convention
    flow = Flow(
        topology, energy, convention, free, constraints, mean_curvature, scheme, wishes.timed, wishes.stop,
        centre, scale, area(unit), mesh.points,
        0.0 if chosen == "hinge" else least_energy(topology),
        None if mean_curvature else second_energy(chosen, topology, constraints),
    )  # fmt: skip
    start = FlowState(unit.points, started, 0.0, longest_step(flow), stopped="" if len(free) else HELD)
    model = Model(
        start, flow.advance, flow.observe, flow.pack, flow.unpack,
        distance=flow.distance, order=1 if scheme == "semi-implicit" else 2,
        stop=flow.reason, clock=lambda state: state.time,
    )  # fmt: skip
    return flow, model


def schedule(flow: Flow, given: Mapping[str, Any]) -> Schedule:
    """When to step and to show, from the options given: steps, duration, step, frame_every, tolerance.

    Without a step or a duration the descent chooses its own steps, at most MOST_STEPS, each of them a frame.
    """
    steps, duration, dt = given.get("steps"), given.get("duration"), given.get("step")
    every, tolerance = given.get("frame_every"), given.get("tolerance")
    if tolerance is not None and not duration:
        raise ParameterError("--tolerance needs --duration; it chooses the steps on the way there")
    if not flow.timed:
        if every is not None:
            raise ParameterError("--frame-every needs --dt or --duration: else every step is a frame")
        return Schedule(1.0, steps or MOST_STEPS)
    if dt is None:
        radius = math.sqrt(flow.area / (4.0 * math.pi)) * flow.scale
        own = TIMED_CURVATURE * radius**2 if flow.mean_curvature else TIMED * radius**4
        dt = own if duration is None else max(duration / MOST_STEPS, min(duration / FRAMES, own))
    if tolerance is not None and duration is not None:
        frames = max(1, math.ceil(duration / every - 1e-9)) if every else FRAMES
        return Schedule(duration / frames, frames, 1, tolerance, first_dt=min(dt, duration / frames))
    count = max(1, math.ceil(duration / dt - 1e-9)) if duration is not None else steps or MOST_STEPS
    dt = duration / count if duration is not None else dt
    return Schedule(dt, count, max(1, round(every / dt) if every else math.ceil(count / FRAMES)))
