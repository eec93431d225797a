"""Motion of shells that break. Between two cracks (an epoch) the meshes and the model do not change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import without_warnings
from ddgcli.mechanics.system import Motion, System
from ddgcli.mechanics.terms import PlasticMemory
from ddgcli.mesh.fields import TrajectoryFrame
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.cracks import SplitSurface, Strength, split_surface
from ddgcli.models.shell.groups import Group
from ddgcli.scenes.scene import Scene
from ddgcli.simulation.account import Account
from ddgcli.simulation.model import Arrays, Model, Observation

Build = Callable[[Group], tuple[System, Model[Motion]]]
MAX_EPOCHS = 4  # cached models; a step that is halved returns to an earlier one


@dataclass(frozen=True, eq=False)
class BreakingMotion:
    """State of a group of shells some of which break.

    Parameters
    ----------
    motion : Motion
        Motion of the vertices of the current surfaces.
    opened : (h,) ndarray of bool
        Whether each interior edge of the unbroken surfaces is open, shell after shell.
    released : float
        Stored energy that the cracks have released, in J.
    """

    motion: Motion
    opened: NDArray[np.bool_]
    released: float = 0.0


@dataclass(frozen=True, eq=False)
class Epoch:
    """The surfaces between two cracks, and their model: constant until the next crack."""

    surfaces: dict[str, SplitSurface]
    group: Group
    system: System
    model: Model[Motion]


class Breaking:
    """Model of a group of shells in which edges open.

    Parameters
    ----------
    group : Group
        The unbroken shells.
    strengths : dict of str to Strength
        Limits of the shells that can break.
    build : callable Group -> (System, Model)
        Builds the model of a group of shells.
    account : Account
        Account of these models.
    """

    def __init__(self, group: Group, strengths: dict[str, Strength], build: Build, account: Account) -> None:
        self._group, self._strengths, self._build, self._account = group, strengths, build, account
        self._epochs: dict[bytes, Epoch] = {}
        self._ends = np.cumsum([0, *(len(strength) for strength in strengths.values())])

    def model(self) -> Model[BreakingMotion]:
        """The model for the time loop."""
        whole = np.zeros(self._ends[-1], dtype=bool)
        epoch = self._epoch(whole)
        first = epoch.model
        return Model(
            BreakingMotion(first.start, whole),
            lambda state, time, dt: self._stepped(state, self._epoch(state.opened).model.advance, time, dt),
            self._observe, self._pack, self._unpack,
            order=first.order,
            rescue=None if first.rescue is None else self._rescue,
        )  # fmt: skip

    def _by_shell(self, opened: NDArray[np.bool_]) -> dict[str, NDArray[np.bool_]]:
        """Open edges of each shell that can break."""
        return dict(zip(self._strengths, np.split(opened, self._ends[1:-1])))

    def _epoch(self, opened: NDArray[np.bool_]) -> Epoch:
        """Surfaces and model for these open edges; the last few are cached."""
        key = opened.tobytes()
        if key not in self._epochs:
            shells, surfaces = dict(self._group.shells), {}
            for name, edges in self._by_shell(opened).items():
                surface = split_surface(shells[name].mesh.topology, edges)
                surfaces[name] = surface
                shells[name] = split_context(shells[name], surface.faces, surface.origin)
            calls, group = dict(self._account.calls), replace(self._group, shells=shells)
            with without_warnings():  # building the unbroken shells has issued them
                system, model = self._build(group)
            # a resumed run builds other epochs than an uninterrupted one, and must report the same calls
            self._account.calls = calls
            while len(self._epochs) >= MAX_EPOCHS:
                del self._epochs[next(iter(self._epochs))]
            self._epochs[key] = Epoch(surfaces, group, system, model)
        return self._epochs[key]

    def _rescue(self, state: BreakingMotion, time: float, dt: float) -> BreakingMotion:
        rescue: Any = self._epoch(state.opened).model.rescue
        return self._stepped(state, rescue, time, dt)

    def _opened(self, opened: NDArray[np.bool_], epoch: Epoch, x: NDArray) -> NDArray[np.bool_]:
        """Open edges, and those beyond a limit at positions x of an epoch's vertices."""
        points = epoch.group.split(x)
        beyond = [
            strength.exceeded(points[name], epoch.surfaces[name].faces)
            for name, strength in self._strengths.items()
        ]
        return opened | np.concatenate(beyond)

    def _stepped(self, state: BreakingMotion, advance: Callable, time: float, dt: float) -> BreakingMotion:
        """Advance the current surfaces by a step; then open every edge beyond its limits."""
        motion, epoch = advance(state.motion, time, dt), self._epoch(state.opened)
        with self._account.within("fracture"):
            opened = self._opened(state.opened, epoch, motion.x)
        if (opened == state.opened).all():
            return replace(state, motion=motion)
        later = self._epoch(opened)
        rows = earlier_rows(epoch, later)
        memory = tuple(
            cast(PlasticMemory, after).carried(before, arrays, rows)
            for before, after, arrays in zip(epoch.system.memories, later.system.memories, motion.memory)
        )
        before = epoch.system.with_memory_at(motion.memory).at(motion.time)
        after = later.system.with_memory_at(memory).at(motion.time)
        x, v = motion.x[rows], motion.v[rows]
        energy, later_energy = before.energies(motion.x), after.energies(x)
        released = sum(energy.values()) - sum(later_energy.values())
        pushed = released < 0 and later_energy.get("contact", 0.0) > energy.get("contact", 0.0)
        if pushed or any(barrier.outside(x) is not None for barrier in after.barriers):
            # the pieces would be too close to each other; the edges open in a later step
            return replace(state, motion=motion)
        past = motion.past and (motion.past[0][rows], motion.past[1][rows], motion.past[2])
        a = after.acceleration(x, v, dt)
        split = replace(motion, x=x, v=v, a=a, memory=memory, past=past)
        return BreakingMotion(split, opened, state.released + released)

    def _observe(self, state: BreakingMotion) -> dict[str, Observation]:
        epoch = self._epoch(state.opened)
        observation: Any = observed_with_faces(epoch.model, epoch.group.shells, state.motion)
        first = next(iter(observation))
        whole = len(self._group.shells) - len(epoch.surfaces)
        scalar = {
            **observation[first].scalar,
            "cracks": float(state.opened.sum()),
            "pieces": float(whole + sum(surface.n_pieces for surface in epoch.surfaces.values())),
            "fracture_energy": state.released,
        }
        return {**observation, first: replace(observation[first], scalar=scalar)}

    def _pack(self, state: BreakingMotion) -> Arrays:
        own = {"opened": state.opened.astype(np.uint8), "released": np.array([state.released])}
        return {**own, **self._epoch(state.opened).model.pack(state.motion)}

    def _unpack(self, arrays: Arrays) -> BreakingMotion:
        opened = np.asarray(arrays["opened"]).astype(bool)
        motion = self._epoch(opened).model.unpack(arrays)
        return BreakingMotion(motion, opened, float(arrays["released"][0]))


def earlier_rows(epoch: Epoch, later: Epoch) -> NDArray[np.int64]:
    """For each vertex of a later epoch, its index in an earlier one."""
    rows = []
    for name, start in zip(epoch.group.shells, epoch.group.ends):
        if name in later.surfaces:
            own = epoch.surfaces[name].faces.ravel()[later.surfaces[name].corner]
        else:
            own = np.arange(epoch.group.shells[name].mesh.n_vertices)
        rows.append(start + own)
    return np.concatenate(rows)


def breaking_model(
    scene: Scene, group: Group, fractures: list[Any], build: Build, account: Account
) -> Model[BreakingMotion]:
    """Model of a group of shells with effects `fracture`.

    Parameters
    ----------
    scene : Scene
    group : Group
    fractures : list of Fracture
        Sections of the effect that name shells of the group.
    build : callable Group -> (System, Model)
    account : Account

    Returns
    -------
    Model
    """
    flat = any(effect.name == "bending" and section.rest == "flat" for effect, section, _ in scene.effects)
    strengths: dict[str, Strength] = {}
    for section in fractures:
        name = section.object or next(iter(group.shells))
        if name in strengths:
            scene.refuse(("effects", "fracture"), f"fracture: {name!r} has two of them; keep one")
        strengths[name] = Strength(group.shells[name].mesh, section.strain, section.angle, flat)
    # in the order of the shells, not of the effects
    ordered = {name: strengths[name] for name in group.shells if name in strengths}
    return Breaking(group, ordered, build, account).model()


def split_context(context: ShellContext, faces: NDArray, origin: NDArray) -> ShellContext:
    """Context of a broken shell, from that of the unbroken one."""
    points = np.asarray(context.mesh.points)[origin]
    arrays = {name: values[origin] for name, values in context.arrays.items()}
    mesh = TriangleMesh(points, Topology(faces, len(points)))
    return replace(context, mesh=mesh, arrays=arrays, terms={}, input_vertex=origin)


def with_faces(observation: Observation, context: ShellContext) -> Observation:
    """The observation with its faces, and the index in the unbroken shell of each vertex."""
    vertex = {**observation.vertex, "input_vertex": context.vertices_at_start}
    return replace(observation, vertex=vertex, faces=np.asarray(context.mesh.faces))


def whole_model(model: Model, shells: dict[str, ShellContext]) -> Model:
    """Model of unbreakable shells in a scene with breakable ones: its observations include the faces.

    Parameters
    ----------
    model : Model
    shells : dict of str to ShellContext

    Returns
    -------
    Model
    """

    def observe(state: Any) -> dict[str, Observation]:
        return observed_with_faces(model, shells, state)

    return replace(model, observe=observe)


def observed_with_faces(model: Model, shells: dict[str, ShellContext], state: Any) -> dict[str, Observation]:
    """Observations of the shells of a model, with their faces."""
    observation: Any = model.observe(state)
    return {name: with_faces(arrays, shells[name]) for name, arrays in observation.items()}


def contexts_of_frame(
    shells: dict[str, ShellContext], trajectory_frame: TrajectoryFrame
) -> dict[str, ShellContext]:
    """Contexts of the shells, broken as in a frame.

    Parameters
    ----------
    shells : dict of str to ShellContext
        Contexts at the start.
    trajectory_frame : TrajectoryFrame
        A frame with `faces` and `input_vertex`.

    Returns
    -------
    dict of str to ShellContext
    """
    faces, origin = np.asarray(trajectory_frame.faces), np.asarray(trajectory_frame.vertex["input_vertex"])
    present, first_face, first = {}, 0, 0
    for name, context in shells.items():
        own = faces[first_face : first_face + context.mesh.n_faces] - first
        count = (
            int(own.max()) + 1 if context.mesh.topology.referenced_vertex.all() else context.mesh.n_vertices
        )
        present[name] = split_context(context, own, origin[first : first + count].astype(np.int64))
        first_face, first = first_face + context.mesh.n_faces, first + count
    return present
