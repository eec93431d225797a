"""From a mesh and options to a flow."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError, ParameterError
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import step_rules as rules
from ddgcli.models.willmore.component_ends import ComponentEnds
from ddgcli.models.willmore.constraints import area
from ddgcli.models.willmore.endings import EMPTY_PATCH, immovable
from ddgcli.models.willmore.energies import (
    DEFAULT_ENERGY,
    ENERGIES,
    EnergyDefinition,
)
from ddgcli.models.willmore.films import FILM_CONVENTIONS, film_constraints, film_energy
from ddgcli.models.willmore.flow import Flow
from ddgcli.models.willmore.flow_options import FlowOptions, chosen_boundary, chosen_energy, is_film
from ddgcli.models.willmore.helfrich_energy import unit_curvature, with_curvature
from ddgcli.models.willmore.least_energies import (
    EnergyBounds,
    is_spheres,
    is_torus,
    least_energy,
    lower_bound,
)
from ddgcli.models.willmore.observation import relative_distance
from ddgcli.models.willmore.option_checks import TIME_OPTIONS, check_options, chosen_scheme
from ddgcli.models.willmore.remesh_step import RemeshTarget
from ddgcli.models.willmore.scaled import centred_at_unit_size
from ddgcli.models.willmore.second_energy import second_energy
from ddgcli.models.willmore.self_intersections import self_intersections
from ddgcli.models.willmore.state import FlowState, Remeshing
from ddgcli.models.willmore.step_lengths import first_step
from ddgcli.simulation.model import Ending, Model, Schedule, check_times, flow_schedule

MAX_STEPS = 1000  # of a flow without steps or duration
MAX_REMESHED_FACES, MIN_REMESHED_FACES = 5e6, 40  # about twice as many result
DEFAULT_FRAME_COUNT = 50
# default length of timed steps, in radius^4 (mean curvature flow: radius^2) of the sphere of the same area
DEFAULT_STEP, DEFAULT_CURVATURE_FLOW_STEP = 5e-3, 2e-3

UNBOUNDED_ENERGIES = ("hinge", "quadratic", "circle-angle")  # no least energy of smooth surfaces is theirs


def free_vertices(topology: Topology, boundary: str, region: NDArray | None = None) -> NDArray[np.int64]:
    """Vertices that move: those of the region, if one is given, that no boundary condition holds.

    `fixed` holds the boundary, `clamped` also its neighbours (and so the normals), `free` nothing.
    """
    fixed = np.array(topology.boundary_vertex) & (boundary != "free")
    if boundary == "clamped":
        fixed[topology.faces[fixed[topology.faces].any(axis=1)]] = True
    inside = True if region is None else region
    return np.flatnonzero(topology.referenced_vertex & ~fixed & inside)


def _ending_at_start(free: NDArray, boundary: str, region: NDArray | None) -> Ending | None:
    """Why no vertex moves, if none does; a region without vertices is that of patches of single triangles."""
    if len(free):
        return None
    if region is not None and not region.any():
        return EMPTY_PATCH
    return immovable(boundary, in_region=region is not None)


def region_mask(region: NDArray, topology: Topology) -> NDArray[np.bool_]:
    """Vertices of the region that an array describes.

    Parameters
    ----------
    region : (n,) or (k,) ndarray
        One value a vertex, not zero inside the region; or any other count of vertex indices from 0.
    topology : Topology

    Returns
    -------
    (n,) ndarray of bool

    Raises
    ------
    ParameterError
        When the array is of neither form, or the region is empty or the whole surface.
    """
    n, values = topology.n_vertices, region
    if values.ndim != 1 or not np.isfinite(values).all():
        raise ParameterError("must have one finite number per row", parameter="region")
    if len(values) == n:
        mask = values != 0
    else:
        wrong = (values != np.round(values)) | (values < 0) | (values >= n)
        if wrong.any():
            raise ParameterError(
                f"has {len(values)} values, neither one for each of the {n} vertices nor vertex indices from "
                f"0 to {n - 1} (first wrong: {values[wrong][0]:g})",
                parameter="region",
            )
        mask = np.zeros(n, dtype=bool)
        mask[values.astype(np.int64)] = True
    mask &= topology.referenced_vertex
    if not mask.any():
        raise ParameterError("has no vertex of the surface; mark at least one", parameter="region")
    if mask[topology.referenced_vertex].all():
        raise ParameterError("is the whole surface; leave `region` out", parameter="region")
    return mask


def _moving_components(
    topology: Topology, options: FlowOptions, free: NDArray, film: bool
) -> NDArray[np.int64] | None:
    """Index of the component of each vertex of those that keep their own area and volume, -1 elsewhere.

    None where at most one moves, or nothing is kept.

    Raises
    ------
    MeshError
        Where a flow would keep the sum of several, which exchange area and volume.
    """
    moving = unique_keys(topology.vertex_component[free])
    if len(moving) < 2 or not (options.fix_area or options.fix_volume):
        return None
    if options.remesh:
        raise MeshError(
            f"remeshing takes one component at a time where area or volume is kept, and {len(moving)} move; "
            f"leave `remesh` out, or {remedy('components', topology)}"
        )
    if film:
        names = " and ".join(f"`{name}`" for name in ("fix_area", "fix_volume") if getattr(options, name))
        raise MeshError(
            f"`flow=mean-curvature` with {names} would keep the sum of {len(moving)} components, which "
            "exchange it; name the vertices of one by `region` (the others stay), or "
            f"{remedy('components', topology)}"
        )
    number = np.full(topology.n_components + 1, -1)
    number[moving] = np.arange(len(moving))
    return number[topology.vertex_component]


def _remesh_target(
    unit: TriangleMesh, options: FlowOptions, scale: float, kind: str, energy: str
) -> RemeshTarget | None:
    """Lengths of edges at unit size; None where faces stay.

    Raises
    ------
    ParameterError
        Where faces cannot change, or the length would make far too many.
    """
    if options.remesh is None:
        if options.remesh_adaptive:
            raise ParameterError("needs `remesh`, a length or mean", parameter="remesh_adaptive")
        return None
    if kind != "descent" or options.timed:
        raise ParameterError(
            f"changes the faces of flows to rest: leave {TIME_OPTIONS} out, and use `flow=quadratic` or "
            "`flow=circle-angle`",
            parameter="remesh",
        )
    if not ENERGIES[energy].keeps_triangles:
        raise ParameterError(
            f"changes what energy {energy!r} depends on; use `energy=cotan`", parameter="remesh"
        )
    mean = float(unit.side_length.mean())
    length = mean if options.remesh == "mean" else float(options.remesh) / scale
    size = area(unit)
    counts = MAX_REMESHED_FACES, MIN_REMESHED_FACES
    low, high = (f"{scale * math.sqrt(size / n):.3g}" for n in counts)  # those that are printed are taken
    if not float(low) <= length * scale * (1.0 + 1e-12) or not length * scale <= float(high) * (1.0 + 1e-12):
        raise ParameterError(f"must be from {low} to {high} on a surface of this size", parameter="remesh")
    return RemeshTarget(length, options.remesh_adaptive)


def build(mesh: TriangleMesh, options: FlowOptions, region: NDArray | None = None) -> tuple[Flow, Model]:
    """The flow of a mesh, and the model that the time loop drives.

    Parameters
    ----------
    mesh : TriangleMesh
    options : FlowOptions
    region : (n,) ndarray of bool, optional
        Vertices that may move; all others stay, and with them the tangent planes beside the region.

    Returns
    -------
    Flow, Model

    Raises
    ------
    MeshError, ParameterError
        On a mesh or an option that the flow cannot take.
    """
    topology = mesh.topology
    energy_name, boundary = chosen_energy(topology, options), chosen_boundary(options)
    kind = options.flow if options.flow in ("conformal", "newton") else "descent"
    check_options(mesh, options, region, energy_name, boundary, kind)
    unit, centre, scale = centred_at_unit_size(mesh)
    free = free_vertices(topology, boundary, region)
    film = is_film(options, topology)
    constraints = film_constraints(unit, options, film, _moving_components(topology, options, free, film))
    curvature = unit_curvature(unit, options, scale)
    definition = ENERGIES[energy_name]
    energy_kind = film_energy(unit, options) if film else with_curvature(definition.builder(unit), curvature)
    start_energy = energy_kind(topology).value(unit.points)
    if not math.isfinite(start_energy):
        raise MeshError(
            f"the {energy_name} energy is not finite here: at some vertex the faces' normals cancel; "
            "unfold it or use `energy=cotan`"
        )
    has_second = options.flow not in ("conformal", "mean-curvature")
    second = second_energy(energy_name, unit, constraints, curvature) if has_second else None
    to_rest = kind != "conformal" and not (options.timed or film)
    is_unconstrained = not constraints.active and len(free) == np.count_nonzero(topology.referenced_vertex)
    is_bounded = not (film or energy_name in UNBOUNDED_ENERGIES)
    cannot_crumple = second is None and topology.is_closed and energy_name == DEFAULT_ENERGY
    reported = ENERGIES if options.report_energy else {}
    flow = Flow(
        topology=topology, energy_kind=energy_kind,
        convention=_convention(definition, options, film, curvature), free=free, constraints=constraints,
        mean_curvature=options.flow == "mean-curvature" and not film, scheme=chosen_scheme(options),
        timed=options.timed, stop=options.stop, centre=centre, scale=scale, area=area(unit),
        original=mesh.points,
        bounds=_energy_bounds(
            unit, options, energy_name, curvature, start_energy, is_bounded, to_rest and is_unconstrained
        ),
        ending_at_start=_ending_at_start(free, boundary, region),
        keeps_triangles=not options.timed and kind != "conformal" and (film or definition.keeps_triangles),
        of_area=film, kind=kind, of_surface=definition.of_surface,
        remesh=_remesh_target(unit, options, scale, kind, energy_name),
        by_pairs=to_rest and kind == "descent" and cannot_crumple and not options.remesh,
        energy_power=(3 if options.fix_area else 2) if film else 0,
        reported={name: reported_definition.builder(unit) for name, reported_definition in reported.items()},
        second=second,
    )  # fmt: skip
    return flow, _model(flow, unit, start_energy, options)


def _energy_bounds(
    unit: TriangleMesh,
    options: FlowOptions,
    energy_name: str,
    curvature: float,
    start_energy: float,
    is_bounded: bool,
    has_free_shape: bool,
) -> EnergyBounds:
    """What is known of the energies within reach; a surface with a free shape goes to rest unconstrained."""
    keeps_both = options.fix_area and options.fix_volume
    least = least_energy(unit, keeps_both) if is_bounded and not curvature else 0.0
    is_newton_vesicle = options.flow == "newton" and keeps_both and energy_name == DEFAULT_ENERGY
    n_vertices = 1 if options.remesh else unit.n_vertices  # how many a remeshed surface has is open
    becomes_round = has_free_shape and is_spheres(unit.topology)
    return EnergyBounds(
        least,
        lower_bound(unit, least, start_energy, curvature * is_bounded, is_newton_vesicle),
        rules.round_energy(energy_name, least, n_vertices) if becomes_round else math.inf,
        has_free_shape and least > 0.0 and is_torus(unit.topology),
    )


def _convention(definition: EnergyDefinition, options: FlowOptions, film: bool, curvature: float) -> str:
    """What the energy measures, in words and formulas."""
    convention = FILM_CONVENTIONS[options.fix_area] if film else definition.convention
    if curvature:
        return f"int (H - H0)^2 dA, H0 = {options.spontaneous_curvature:g}; int H^2 dA: {convention}"
    return convention


def _model(flow: Flow, unit: TriangleMesh, start_energy: float, options: FlowOptions) -> Model:
    """The model that the time loop drives, from a surface of unit size and its energy."""
    start = FlowState(
        unit.points, flow.topology, start_energy, 0.0, first_step(flow.kind, flow.area, flow.of_area),
        ending=flow.ending_at_start,
        remeshing=Remeshing(None if flow.remesh is None else np.arange(unit.n_vertices)),
        self_intersections=self_intersections(unit),
        ends=ComponentEnds.none(flow.topology.n_components if flow.mean_curvature else 0),
    )  # fmt: skip
    order = 1 if flow.scheme == "semi-implicit" else 2
    return Model(
        start, flow.advance, flow.observe, flow.pack, flow.unpack,
        distance=lambda a, b: relative_distance(a, b, flow.area), order=order,
        stop=flow.ending, clock=lambda state: state.time,
        time_unit="length^2" if options.flow == "mean-curvature" else "length^4",
        usual_step=default_step(flow),
    )  # fmt: skip


def default_step(flow: Flow) -> float:
    """Step of a flow in time where none is chosen.

    Parameters
    ----------
    flow : Flow

    Returns
    -------
    float
        In the input's unit of time.
    """
    radius = math.sqrt(flow.area / (4.0 * math.pi)) * flow.scale
    return DEFAULT_CURVATURE_FLOW_STEP * radius**2 if flow.mean_curvature else DEFAULT_STEP * radius**4


def schedule(flow: Flow, time_options: Mapping[str, Any]) -> Schedule:
    """When a flow steps and records.

    Without a step or a duration the descent chooses its own steps, at most MAX_STEPS, each of them a frame.

    Parameters
    ----------
    flow : Flow
    time_options : mapping
        `steps`, `duration`, `step`, `frame_every`, `tolerance`.

    Returns
    -------
    Schedule

    Raises
    ------
    ParameterError
        For options without the time that they divide.
    """
    if not flow.timed:
        check_times(time_options)
        if time_options.get("frame_every") is not None:
            raise ParameterError(
                "needs `step` or `duration`: without them every step is a frame", parameter="frame_every"
            )
        return Schedule(1.0, time_options.get("steps") or MAX_STEPS)
    return flow_schedule(time_options, default_step(flow), max_steps=MAX_STEPS, n_frames=DEFAULT_FRAME_COUNT)
