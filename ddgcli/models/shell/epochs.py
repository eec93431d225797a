"""Motion of a shell that breaks: from one crack to the next its mesh is fixed, and so is its model."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.system import Motion, System
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
log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False)
class BreakingMotion:
    """State of a shell that breaks.

    Parameters
    ----------
    motion : Motion
        Of the vertices of the present surface.
    opened : (h,) ndarray of bool
        Interior edges of the whole surface that are open.
    released : float
        Joules that cracks have taken from the stored energy.
    """

    motion: Motion
    opened: NDArray[np.bool_]
    released: float = 0.0


@dataclass(frozen=True, eq=False)
class Epoch:
    """The surface between two cracks, and its model."""

    surface: SplitSurface
    system: System
    model: Model[Motion]


class Breaking:
    """Model of a shell whose edges open.

    Parameters
    ----------
    group : Group
        The shell alone, whole.
    strength : Strength
    build : callable Group -> (System, Model)
        The model of a group of shells.
    account : Account
        Of these models.
    """

    def __init__(self, group: Group, strength: Strength, build: Build, account: Account) -> None:
        ((self._name, self._context),) = group.shells.items()
        self._group, self._strength, self._build, self._account = group, strength, build, account
        self._epochs: dict[bytes, Epoch] = {}
        self._edges = len(strength)

    def model(self) -> Model[BreakingMotion]:
        """The model for the time loop."""
        whole = np.zeros(self._edges, dtype=bool)
        epoch = self._epoch(whole)
        first = epoch.model
        return Model(
            BreakingMotion(first.start, whole),
            lambda state, time, dt: self._stepped(state, self._epoch(state.opened).model.advance, time, dt),
            self._observe, self._pack, self._unpack,
            order=first.order,
            rescue=None if first.rescue is None else self._rescue,
        )  # fmt: skip

    def _epoch(self, opened: NDArray[np.bool_]) -> Epoch:
        """Surface and model of these open edges; the last few are kept."""
        key = opened.tobytes()
        if key not in self._epochs:
            surface = split_surface(self._context.mesh.topology, opened)
            context = split_context(self._context, surface.faces, surface.origin)
            calls = dict(self._account.calls)
            with _quiet():  # what the whole shell is warned of has been said
                system, model = self._build(replace(self._group, shells={self._name: context}))
            self._account.calls = calls  # a resumed run builds other epochs than a whole one
            while len(self._epochs) >= MAX_EPOCHS:
                del self._epochs[next(iter(self._epochs))]
            self._epochs[key] = Epoch(surface, system, model)
        return self._epochs[key]

    def _rescue(self, state: BreakingMotion, time: float, dt: float) -> BreakingMotion:
        rescue: Any = self._epoch(state.opened).model.rescue
        return self._stepped(state, rescue, time, dt)

    def _stepped(self, state: BreakingMotion, advance: Callable, time: float, dt: float) -> BreakingMotion:
        """A step of the present surface; then every edge beyond its limits opens."""
        motion, epoch = advance(state.motion, time, dt), self._epoch(state.opened)
        with self._account.within("fracture"):
            opened = state.opened | self._strength.exceeded(motion.x, epoch.surface.faces)
        if (opened == state.opened).all():
            return replace(state, motion=motion)
        later = self._epoch(opened)
        rows = epoch.surface.faces.ravel()[later.surface.corner]
        before, after = epoch.system.at(motion.time), later.system.at(motion.time)
        x, v = motion.x[rows], motion.v[rows]
        released = _stored(before, motion.x) - _stored(after, x)
        past = motion.past and (motion.past[0][rows], motion.past[1][rows], motion.past[2])
        split = replace(motion, x=x, v=v, a=after.acceleration(x, v, dt), past=past)
        return BreakingMotion(split, opened, state.released + released)

    def _observe(self, state: BreakingMotion) -> dict[str, Observation]:
        epoch = self._epoch(state.opened)
        seen: Any = epoch.model.observe(state.motion)
        observation = with_faces(seen[self._name], epoch.surface.faces, epoch.surface.origin)
        scalar = {
            **observation.scalar,
            "cracks": float(state.opened.sum()),
            "pieces": float(epoch.surface.pieces),
            "fracture_energy": state.released,
        }
        return {self._name: replace(observation, scalar=scalar)}

    def _pack(self, state: BreakingMotion) -> Arrays:
        own = {"opened": state.opened.astype(np.uint8), "released": np.array([state.released])}
        return {**own, **self._epoch(state.opened).model.pack(state.motion)}

    def _unpack(self, arrays: Arrays) -> BreakingMotion:
        opened = np.asarray(arrays["opened"]).astype(bool)
        motion = self._epoch(opened).model.unpack(arrays)
        return BreakingMotion(motion, opened, float(arrays["released"][0]))


def breaking_model(
    scene: Scene, group: Group, parameters: Any, build: Build, account: Account
) -> Model[BreakingMotion]:
    """Model of a shell with the effect `fracture`.

    Parameters
    ----------
    scene : Scene
    group : Group
        Refused where the shell is coupled to others.
    parameters : Fracture
    build : callable Group -> (System, Model)
    account : Account
    """
    if len(group.shells) > 1:
        scene.refuse(
            ("effects", "fracture"),
            f"fracture: {' and '.join(group.shells)} touch or are attached, and shells break alone; "
            "leave their contact out",
        )
    ((_, context),) = group.shells.items()
    flat = any(effect.name == "bending" and section.rest == "flat" for effect, section, _ in scene.effects)
    strength = Strength(context.mesh, parameters.strain, parameters.angle, flat)
    return Breaking(group, strength, build, account).model()


def split_context(context: ShellContext, faces: NDArray, origin: NDArray) -> ShellContext:
    """The context of a shell that has come apart."""
    points = np.asarray(context.mesh.points)[origin]
    arrays = {name: values[origin] for name, values in context.arrays.items()}
    mesh = TriangleMesh(points, Topology(faces, len(points)))
    return replace(context, mesh=mesh, arrays=arrays, terms={}, input_vertex=origin)


def with_faces(observation: Observation, faces: NDArray, origin: NDArray) -> Observation:
    """An observation that carries its faces and the vertices of the whole surface."""
    vertex = {**observation.vertex, "input_vertex": origin}
    return replace(observation, vertex=vertex, faces=faces)


def whole_model(model: Model, shells: dict[str, ShellContext]) -> Model:
    """A model of shells that stay whole, whose observations carry their faces."""

    def observe(state: Any) -> dict[str, Observation]:
        seen: Any = model.observe(state)
        meshes = {name: shells[name].mesh for name in seen}
        return {
            name: with_faces(seen[name], np.asarray(mesh.faces), np.arange(mesh.n_vertices))
            for name, mesh in meshes.items()
        }

    return replace(model, observe=observe)


def contexts_of_frame(
    shells: dict[str, ShellContext], trajectory_frame: TrajectoryFrame
) -> dict[str, ShellContext]:
    """Contexts of the shells as they are in a frame."""
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


def _stored(system: System, x: NDArray) -> float:
    return float(sum(system.energies(x).values()))


@contextmanager
def _quiet() -> Iterator[None]:
    """No warnings of the program."""
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)
