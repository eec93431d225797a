"""Fluids of a scene as models for the loop: a space and phases for each, since nothing couples them."""

from __future__ import annotations

import importlib
import logging
from collections.abc import Callable, Iterable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import InfiniteValueError, MeshError, counted
from ddgcli.mesh.requirements import require_sized_cells
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.effect_parts import BoundaryPart, Harmonic, Initial
from ddgcli.models.fluid.flow_mesh import harmonic_count, require_flow
from ddgcli.models.fluid.phases import FluidSetting, Phase, PhaseRequest, Step, TransportPhase
from ddgcli.models.fluid.scene import DEFAULT_VOLUME_INTEGRATOR, OPEN_TRANSPORTS, TRANSPORTS
from ddgcli.models.fluid.sources import SourceSequence
from ddgcli.models.fluid.space import FlowSpace
from ddgcli.models.fluid.state import TIME, FluidState
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.models.fluid.time_resolution import warn_of_unresolved_expressions
from ddgcli.models.fluid.triangulation import with_triangulation
from ddgcli.scenes.scene import Scene
from ddgcli.scenes.sections import Key
from ddgcli.scenes.shapes import place
from ddgcli.simulation.account import Account
from ddgcli.simulation.effects import Effect
from ddgcli.simulation.model import Cause, Model, Observation, StepRejected

if TYPE_CHECKING:
    from ddgcli.models.fluid.conditions import BoundaryConditions

log = logging.getLogger("ddgcli")

SURFACE_EFFECTS = ("rotation", "harmonic")  # volumes hold the harmonic flows from the start
SPEED_ROUNDING = 1e-9  # of the speed that forces would give, up to which a flow is their rounding
SAMPLED_SHARES = (0.0, 0.37, 0.71)  # of the run, at which forces are evaluated for it
MAX_QUARTERINGS = 10  # of a first step that is rejected
MAX_HARMONIC_FLOWS = 2_000  # kept as a dense basis


def contexts(
    scene: Scene, read: Callable[[str], Any], load: Callable[[str], NDArray]
) -> dict[str, tuple[FluidContext, str]]:
    """Context of every fluid of a scene, and the SHA-256 of its mesh file.

    Parameters
    ----------
    scene : Scene
    read : callable
        Reads a mesh file.
    load : callable
        Reads an array file.

    Returns
    -------
    dict of str to (FluidContext, str)

    Raises
    ------
    SceneError
        For a mesh that carries no flow, at its place in the scene.
    """
    by_name: dict[str, tuple[FluidContext, str]] = {}
    for number, section in enumerate(scene.objects):
        if section.role != "fluid":
            continue
        try:
            placement = place(section, read, volumes=True)
            _require_mesh(placement.mesh)
        except ValueError as error:
            scene.refuse(("object", number), f"object {section.name!r}: {error}")
        period = np.zeros(3)
        if section.grid is not None:
            size = np.array(section.grid.size) * section.scale
            period[:2] = [size[k] if axis in section.grid.periodic else 0.0 for k, axis in enumerate("xy")]
        context = FluidContext(section.name, placement.mesh, placement.vertex, placement.face, period, load)
        context = _cut(scene, number, context, read)
        try:
            context = with_triangulation(context, section.triangulation)
        except ValueError as error:
            scene.refuse(("object", number), f"object {section.name!r}: {error}")
        first = next((one for one, _ in by_name.values()), context)
        if context.is_volume != first.is_volume:
            kinds = ("surface", "volume") if context.is_volume else ("volume", "surface")
            scene.refuse(
                ("object", number),
                f"{first.name!r} is a {kinds[0]} and {section.name!r} a {kinds[1]}, which one trajectory "
                "cannot hold; nothing couples fluids: write a scene for each",
            )
        by_name[section.name] = context, placement.sha256
    return by_name


def with_default_integrator(scene: Scene, fluids: Iterable[FluidContext]) -> Scene:
    """The scene with the default integrator of volumes, where it names none and its fluids are volumes.

    Parameters
    ----------
    scene : Scene
    fluids : iterable of FluidContext

    Returns
    -------
    Scene
    """
    if scene.has_default_integrator and any(fluid.is_volume for fluid in fluids):
        return scene.with_integrator(DEFAULT_VOLUME_INTEGRATOR)
    return scene


def _require_mesh(mesh: Any) -> None:
    if isinstance(mesh, TetMesh):
        require_sized_cells(mesh, "fluid-sim")
    else:
        require_flow(mesh)


def _cut(scene: Scene, number: int, context: FluidContext, read: Callable[[str], Any]) -> FluidContext:
    """The context without the scene's obstacles."""
    sections = [(k, section) for k, section in enumerate(scene.objects) if section.role == "obstacle"]
    if not sections:
        return context
    from ddgcli.models.fluid.obstacles import require_apart, signed_distance, without_obstacles

    place: Key = ("object", number)
    try:
        obstacles = []
        for k, section in sections:
            place = ("object", k)
            obstacles.append((section.name, *signed_distance(section, read)))
            if section.refine:
                from ddgcli.models.fluid.obstacle_refinement import refined

                context = refined(context, obstacles[-1][1], section.refine)
        place = ("object", number)
        cut = without_obstacles(context, obstacles)
        require_apart(cut)
        _require_mesh(cut.mesh)
    except ValueError as error:
        scene.refuse(place, f"object {scene.objects[int(place[1])].name!r}: {error}")
    if cut.division:
        log.warning("%s", cut.division)
    return cut


EffectPart = Initial | BoundaryPart | Harmonic | PhaseRequest
PlacedEffectParts = list[tuple[Key, str, EffectPart]]


def effect_parts_of(scene: Scene, context: FluidContext) -> PlacedEffectParts:
    """(place in the scene, effect, part) of all that the scene's effects build for one fluid."""

    def make(effect: Effect, parameters: Any, key: Key) -> PlacedEffectParts:
        target = getattr(parameters, "object", None)
        if target is not None:
            scene.find(target, (*key, "object"), ("fluid",))
            if target != context.name:
                return []
        return [(key, effect.name, effect_part) for effect_part in effect.build(parameters, context)]

    return [entry for effect_parts in scene.build(make) for entry in effect_parts]


def build(scene: Scene, fluids: dict[str, FluidContext], account: Account) -> dict[str, FluidModel]:
    """One model for each fluid; nothing is assembled that no effect requires.

    Parameters
    ----------
    scene : Scene
    fluids : dict of str to FluidContext
    account : Account

    Returns
    -------
    dict of str to FluidModel
    """
    return {
        name: FluidModel(scene, number, fluids[name], account)
        for number, name in enumerate(section.name for section in scene.objects)
        if name in fluids
    }


class FluidModel:
    """A fluid put together: its space, and the phases of its steps."""

    def __init__(self, scene: Scene, number: int, context: FluidContext, account: Account) -> None:
        self.context, self.account, self.scene = context, account, scene
        declared = effect_parts_of(scene, context)
        if context.is_volume:
            self.setting = self._volume_setting(declared)
        else:
            self.setting = self._surface_setting(declared, number)
        self.space = self.setting.space
        self.transport = self._transport()
        requested = [
            self._phase(key, name, effect_part)
            for key, name, effect_part in declared
            if isinstance(effect_part, PhaseRequest)
        ]
        phases = [phase for phase in requested if phase is not None]
        self.setting.phases += phases
        self.sources = SourceSequence(phases, list(scene.kind.effects), account)
        self.tracers = [phase for phase in phases if phase.step_stage == "tracer"]
        self.start = self._start(declared)
        self._check_time_resolution()

    # ------------------------------------------------------------------ assembly

    def _surface_setting(self, declared: PlacedEffectParts, number: int) -> FluidSetting:
        context, account = self.context, self.account
        harmonic = next(
            (effect_part for _, _, effect_part in declared if isinstance(effect_part, Harmonic)), None
        )
        conditions = self._conditions(declared)
        in_time = conditions.in_time if conditions else None
        try:
            space = SurfaceSpace(
                context.mesh, _harmonic_flows(context, harmonic), lambda: account.within("solver"),
                conditions.boundary_values if conditions else None,
                conditions.open_vertices if conditions else None,
                conditions.open_sides if conditions and conditions.is_open else None,
                to_space=context.to_space, name=context.name,
                values_in_time=in_time.boundary_values if in_time else None,
                prescribed_velocity=conditions.velocity if conditions else None,
            )  # fmt: skip
        except MeshError as error:
            self.scene.refuse(("object", number), f"object {context.name!r}: {error}")
        return FluidSetting(
            context, space, frozenset(name for _, name, _ in declared),
            conditions is not None and conditions.no_slip,
            in_time.wall_circulation if in_time else conditions.wall_circulation if conditions else None,
            harmonic is not None and harmonic.evolve,
            conditions.slip if conditions else None, conditions is not None and conditions.is_open,
            needs_time=in_time is not None,
        )  # fmt: skip

    def _volume_setting(self, declared: PlacedEffectParts) -> FluidSetting:
        from ddgcli.models.fluid.volume_conditions import volume_conditions
        from ddgcli.models.fluid.volume_space import VolumeSpace

        context, account = self.context, self.account
        for key, effect, _ in declared:
            if effect in SURFACE_EFFECTS:
                self.scene.refuse(
                    key, f"{effect} acts on surfaces; take it out for the volume {context.name!r}"
                )
        space = VolumeSpace(context.mesh, None, lambda: account.within("solver"), context.name)
        sections = [
            (key, effect_part) for key, _, effect_part in declared if isinstance(effect_part, BoundaryPart)
        ]
        if sections:
            try:
                own = [effect_part for _, effect_part in sections]
                space.conditions = volume_conditions(context, own, space, self.scene.time.duration)
            except ValueError as error:
                self.scene.refuse(sections[0][0], f"boundary: {error}")
        friction = space.conditions is not None and bool(space.conditions.friction.any())
        return FluidSetting(
            context, space, frozenset(name for _, name, _ in declared), friction,  # type: ignore[arg-type]
            is_open=space.conditions is not None and space.conditions.is_open,
            needs_time=space.conditions is not None and space.conditions.velocity_in_time is not None,
        )  # fmt: skip

    def _conditions(self, declared: PlacedEffectParts) -> BoundaryConditions | None:
        """Conditions of the effect `boundary`; None without it."""
        sections = [
            (key, effect_part) for key, _, effect_part in declared if isinstance(effect_part, BoundaryPart)
        ]
        if not sections:
            return None
        from ddgcli.models.fluid.conditions import boundary_conditions

        try:
            own = [effect_part for _, effect_part in sections]
            return boundary_conditions(self.context, own, self.scene.time.duration)
        except ValueError as error:
            self.scene.refuse(sections[0][0], f"boundary: {error}")

    def _transport(self) -> TransportPhase:
        """The phase of the integrator that [time] names."""
        scene, dimension = self.scene, self.flows.dimension
        modules = TRANSPORTS[scene.time.integrator]
        if dimension not in modules:
            names = " or ".join(name for name, dimensions in TRANSPORTS.items() if dimension in dimensions)
            message = f"{scene.time.integrator} does not exist in {dimension}-D; take {names}"
            scene.refuse(("time", "integrator"), message)
        if self.setting.is_open and scene.time.integrator not in OPEN_TRANSPORTS:
            names = " or ".join(name for name in OPEN_TRANSPORTS if dimension in TRANSPORTS[name])
            message = f"{scene.time.integrator} has no inflow and outflow; take {names}"
            scene.refuse(("time", "integrator"), message)
        return importlib.import_module(modules[dimension]).transport(self.setting, scene.time)

    def _check_time_resolution(self) -> None:
        time = self.scene.time
        if time.tolerance is None:
            step = min(time.step, self.step_limit())
            warn_of_unresolved_expressions(self.scene, self.context, step, time.duration)

    def _phase(self, key: Key, effect: str, effect_part: PhaseRequest) -> Phase | None:
        try:
            return effect_part.make(self.setting)
        except ValueError as error:
            self.scene.refuse(key, f"{effect}: {error}")

    def _start(self, declared: PlacedEffectParts) -> FluidState:
        arrays = self.flows.rest()
        for key, effect, effect_part in declared:
            if isinstance(effect_part, Initial):
                try:
                    change = effect_part.make(self.space)
                except ValueError as error:
                    self.scene.refuse(key, f"{effect}: {error}")
                for name, values in change.items():
                    arrays[name] = arrays[name] + values
        for phase in self.phases:
            arrays.update(phase.start())
        if self.setting.needs_time:
            arrays[TIME] = np.zeros(1)
        return FluidState(arrays)

    @property
    def flows(self) -> FlowSpace:
        """The flow space, of a surface or of a volume."""
        return self.space

    @property
    def phases(self) -> list[Phase]:
        return [self.transport, *self.sources.phases, *self.tracers]

    def model(self) -> Model[FluidState]:
        """Model for the time loop."""
        order = min(phase.order for phase in (self.transport, *self.sources.phases))
        return Model(
            self.start, self.advance, self.observe, self.pack, self.unpack,
            distance=self.distance, order=order,
        )  # fmt: skip

    def distance(self, a: FluidState, b: FluidState) -> float:
        """Relative distance of two flows, or of what they carry where that is larger."""
        duration = self.scene.time.duration
        carried = (phase.distance(a, b, self.start, duration) for phase in self.tracers)
        return max(self.flows.distance(a, b, self.reference, self.rounding_energy), *carried, 0.0)

    @cached_property
    def reference(self) -> FluidState:
        """Flow whose size errors of adaptive steps are relative to: the start, or after rest a first step.

        What interpolation loses of the first speeds is the same share of them however short the step.
        """
        schedule = self.scene.schedule()
        state, dt = self.start, schedule.first_dt or schedule.dt
        if self.flows.energy(state) > self.rounding_energy:
            return state
        for _ in range(MAX_QUARTERINGS):
            try:
                return self.advance(state, 0.0, dt)
            except StepRejected:
                dt *= 0.25
        return state

    @cached_property
    def rounding_energy(self) -> float:
        """Energy up to which a flow is the rounding of forces that the pressure balances.

        That of a share of the speed that they give within the run, or over the size of the fluid.
        """
        duration, flows = self.scene.time.duration, self.flows
        largest = 0.0
        for force in self.sources.forces:
            for share in SAMPLED_SHARES:
                try:
                    acceleration = force.cell_acceleration(self.start, share * duration)
                except InfiniteValueError:
                    continue
                size = np.linalg.norm(acceleration, axis=1)
                largest = max(largest, float(size[np.isfinite(size)].max(initial=0.0)))
        speed = SPEED_ROUNDING * min(largest * duration, float(np.sqrt(largest * flows.size)))
        return 0.5 * flows.measure * speed**2

    # ------------------------------------------------------------------ steps

    def step_limit(self) -> float:
        """Longest step that is stable at the start, where the integrator has a limit; else infinity."""
        return self.transport.step_limit(self.start)

    def advance(self, state: FluidState, time: float, dt: float) -> FluidState:
        """One symmetric step, of second order: see `phases`."""
        half = 0.5 * dt
        if self.setting.needs_time and state.time != time:  # times are k dt: by rounding not the last end
            state = self.flows.restated(state, time)
        balance = None if self.sources.friction is None else self.transport.balance(state, dt)
        for phase in self.sources.phases:
            state = self.sources.advanced(phase, Step(time, half, state, balance), state)
        whole = Step(time, dt, state, balance)
        state = self.transport.advance(whole, state)
        if self.setting.needs_time:
            state = state.replaced(**{TIME: np.array([time + dt])})
        for phase in self.tracers:
            with self.account.within(phase.effect):
                state = phase.advance(whole, state)
        for phase in reversed(self.sources.phases):
            state = self.sources.advanced(phase, Step(time + half, half, state, balance), state)
        if not all(np.isfinite(values).all() for values in state.arrays.values()):
            raise StepRejected(Cause.NOT_FINITE)
        return state

    def observe(self, state: FluidState) -> Observation:
        """What the space and the phases show of a state."""
        observations = [self.flows.observed(state), *(phase.observed(state) for phase in self.phases)]
        vertex = {name: values for observation in observations for name, values in observation.vertex.items()}
        return Observation(
            None,
            vertex,
            {name: value for observation in observations for name, value in observation.scalar.items()},
        )

    def pack(self, state: FluidState) -> dict[str, NDArray]:
        """The arrays of a state, those without entries left out."""
        return {name: values for name, values in state.arrays.items() if len(values)}

    def unpack(self, arrays: dict[str, NDArray]) -> FluidState:
        return FluidState({name: arrays.get(name, values) for name, values in self.start.arrays.items()})


def _harmonic_flows(context: FluidContext, harmonic: Harmonic | None) -> NDArray[np.float64]:
    """(b, e) basis of the harmonic flows; (0, e) without the effect."""
    topology, count = context.mesh.topology, harmonic_count(context.mesh)
    if harmonic is None:
        if count:
            log.info(
                "%s has %s; they exist where the scene names the effect harmonic",
                context.name, counted(count, "harmonic flow", "harmonic flows"),
            )  # fmt: skip
        return np.zeros((0, topology.n_edges))
    if count > MAX_HARMONIC_FLOWS:
        raise MeshError(
            f"the surface has {count} harmonic flows, more than {MAX_HARMONIC_FLOWS}; leave the effect out"
        )
    from ddgcli.algorithms.hodge.harmonic import harmonic_basis

    return harmonic_basis(context.mesh, "normal").forms
