"""Motion of shells that break: from one crack to the next their meshes are fixed, and so is their model."""

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
MAX_EPOCHS = 4  # models that are kept: halves of a step go back to earlier ones


@dataclass(frozen=True, eq=False)
class BreakingMotion:
    """State of a group of shells some of which break.

    Parameters
    ----------
    motion : Motion
        Of the vertices of the current surfaces.
    opened : (h,) ndarray of bool
        Which interior edges of the whole surfaces are open, shell after shell.
    released : float
        Joules that cracks have taken from the stored energy.
    """

    motion: Motion
    opened: NDArray[np.bool_]
    released: float = 0.0


@dataclass(frozen=True, eq=False)
class Epoch:
    """The surfaces between two cracks, and their model."""

    surfaces: dict[str, SplitSurface]
    group: Group
    system: System
    model: Model[Motion]


class Breaking:
    """Model of a group of shells in which edges open.

    Parameters
    ----------
    group : Group
        The shells, whole.
    strengths : dict of str to Strength
        Of the shells that break.
    build : callable Group -> (System, Model)
        The model of a group of shells.
    account : Account
        Of these models.
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
        """Open edges of each shell that breaks."""
        return dict(zip(self._strengths, np.split(opened, self._ends[1:-1])))

    def _epoch(self, opened: NDArray[np.bool_]) -> Epoch:
        """Surfaces and model of these open edges; the last few are kept."""
        key = opened.tobytes()
        if key not in self._epochs:
            shells, surfaces = dict(self._group.shells), {}
            for name, edges in self._by_shell(opened).items():
                surface = split_surface(shells[name].mesh.topology, edges)
                surfaces[name] = surface
                shells[name] = split_context(shells[name], surface.faces, surface.origin)
            calls, group = dict(self._account.calls), replace(self._group, shells=shells)
            with without_warnings():  # the whole shells have issued these warnings
                system, model = self._build(group)
            self._account.calls = calls  # a resumed run builds other epochs than a whole one
            while len(self._epochs) >= MAX_EPOCHS:
                del self._epochs[next(iter(self._epochs))]
            self._epochs[key] = Epoch(surfaces, group, system, model)
        return self._epochs[key]

    def _rescue(self, state: BreakingMotion, time: float, dt: float) -> BreakingMotion:
        rescue: Any = self._epoch(state.opened).model.rescue
        return self._stepped(state, rescue, time, dt)

    def _opened(self, opened: NDArray[np.bool_], epoch: Epoch, x: NDArray) -> NDArray[np.bool_]:
        """All open edges at positions x of an epoch's vertices."""
        points = epoch.group.split(x)
        beyond = [
            strength.exceeded(points[name], epoch.surfaces[name].faces)
            for name, strength in self._strengths.items()
        ]
        return opened | np.concatenate(beyond)

    def _stepped(self, state: BreakingMotion, advance: Callable, time: float, dt: float) -> BreakingMotion:
        """A step of the present surfaces; then every edge beyond its limits opens."""
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
            # pieces would be too near to others: the edges open in a later step
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
            "pieces": float(whole + sum(surface.pieces for surface in epoch.surfaces.values())),
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
    """Vertex of an epoch that each vertex of a later epoch was."""
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
        Of shells of the group.
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
    # in the order of the shells, whatever that of the effects is
    ordered = {name: strengths[name] for name in group.shells if name in strengths}
    return Breaking(group, ordered, build, account).model()


def split_context(context: ShellContext, faces: NDArray, origin: NDArray) -> ShellContext:
    """The context of a shell that has come apart."""
    points = np.asarray(context.mesh.points)[origin]
    arrays = {name: values[origin] for name, values in context.arrays.items()}
    mesh = TriangleMesh(points, Topology(faces, len(points)))
    return replace(context, mesh=mesh, arrays=arrays, terms={}, input_vertex=origin)


def with_faces(observation: Observation, context: ShellContext) -> Observation:
    """An observation that carries its faces and the vertices of the whole surface."""
    vertex = {**observation.vertex, "input_vertex": context.vertices_at_start}
    return replace(observation, vertex=vertex, faces=np.asarray(context.mesh.faces))


def whole_model(model: Model, shells: dict[str, ShellContext]) -> Model:
    """Model of shells that stay whole, whose observations carry their faces, beside shells that break.

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
    """Observations of shells that carry their faces."""
    observation: Any = model.observe(state)
    return {name: with_faces(arrays, shells[name]) for name, arrays in observation.items()}


def contexts_of_frame(
    shells: dict[str, ShellContext], trajectory_frame: TrajectoryFrame
) -> dict[str, ShellContext]:
    """Contexts of the shells as they are in a frame.

    Parameters
    ----------
    shells : dict of str to ShellContext
        At the start.
    trajectory_frame : TrajectoryFrame
        With `faces` and `input_vertex`.

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
