"""Effect `contact`: shells do not pass through obstacles, each other or themselves; Coulomb friction."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ddgcli.geometry.solids import Surface
from ddgcli.models.shell.barrier import (
    MIN_START_DISTANCE,
    REPULSION_DISTANCE,
    Barrier,
    Friction,
    MovingBarrier,
    MovingFriction,
    closest_part,
    fall_acceleration,
    slip_speed,
    stopping_pressure,
)
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.obstacle import Obstacle
from ddgcli.models.shell.obstacle_motion import PlacedMotion, middle_of, motion_of, surface_of
from ddgcli.models.shell.surfaces import PosedSurface
from ddgcli.scenes.sections import Key, Section
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect

ENERGY_SAFETY_FACTOR = 2.0  # waves may bring a vertex more than the energy of its own fall
# pressure of the barrier at half its range, over stiffness times range
HALF_RANGE_SLOPE = 2 * 0.5 * np.log(2) + 0.5
KEY: Key = ("effects", "contact")
log = logging.getLogger("ddgcli")


class Contact(Section):
    """A barrier between surfaces, zero beyond `gap`, infinite where they touch."""

    pairs: list[list[str]] = Field([], description='[["shell", "obstacle or other shell"], ...]')
    self_contact: list[str] | bool = Field(
        False, description="shells that do not pass through themselves; true: all; needs the extra contact"
    )
    sharp: bool = Field(
        False, description="boxes meet edges and faces too, not only vertices; needs the extra contact"
    )
    friction: quantity("", "coefficient of friction", ge=0) = 0.0
    gap: quantity("m", "distance at which contact begins; default: the thickness", gt=0) | None = None
    stiffness: quantity("Pa", "pressure at half the gap; default: what stops the first fall", gt=0) | None = (
        None
    )
    slip: (
        quantity("m/s", "speed below which friction grows in proportion; default: see the manual", gt=0)
        | None
    ) = None

    @model_validator(mode="after")
    def _something(self) -> Contact:
        if not self.pairs and not self.self_contact:
            raise ValueError('give pairs = [["shell", "obstacle"]], self_contact = true or both')
        if self.slip is not None and not self.friction:
            raise ValueError("slip has no effect without friction; take it out")
        return self


def build(parameters: Contact, context: ShellContext) -> list[Any]:
    if parameters.sharp and not _has_box(parameters, context):
        raise ValueError("sharp has no effect without a pair with an obstacle that is a box; take it out")
    terms: list[Any] = []
    for pair in parameters.pairs:
        obstacle = _obstacle_of(pair, parameters.pairs, context)
        if obstacle is not None:
            terms += _with_obstacle(parameters, context, obstacle)
    if _meets_itself(parameters, context):
        from ddgcli.models.shell.pairs import self_pairs

        terms += self_pairs(parameters, context)
    return terms


def _has_box(parameters: Contact, context: ShellContext) -> bool:
    names = {name for pair in parameters.pairs for name in pair}
    return any(o.name in names and getattr(o, "box", None) is not None for o in context.scene.objects)


def _with_obstacle(parameters: Contact, context: ShellContext, obstacle: Obstacle) -> list[Any]:
    if obstacle.mesh is not None or (parameters.sharp and obstacle.box is not None):
        from ddgcli.models.shell.pairs import obstacle_pairs

        return obstacle_pairs(parameters, context, obstacle)
    shell = context.shell
    surface, motion = surface_of(obstacle), motion_of(obstacle, middle_of(obstacle))
    start = PosedSurface(surface, motion.pose(0.0))
    gap, density = float(parameters.gap or shell.thickness or 0), float(shell.density or 0)
    energy = density * impact(context, start, motion)
    pressure = float(parameters.stiffness or stopping_pressure(context.scene, energy, density, gap))
    weight = pressure / (HALF_RANGE_SLOPE * gap) * context.vertex_area
    closest = closest_part(ENERGY_SAFETY_FACTOR * energy * HALF_RANGE_SLOPE / (pressure * gap))
    barrier: Barrier
    if obstacle.moving:
        barrier = MovingBarrier(surface, motion, gap, weight, closest, 0.0)
    else:
        at_origin = obstacle.rotation is None and not any(obstacle.position)
        barrier = Barrier(surface if at_origin else start, gap, weight, closest)
    barrier.obstacle = obstacle.name
    _require_apart(barrier, context, gap)
    if not parameters.friction:
        return [barrier]
    slip = slip_speed(parameters.slip, [context], motion.pose(0.0).velocity)
    if isinstance(barrier, MovingBarrier):
        return [barrier, MovingFriction(barrier, parameters.friction, slip)]
    return [barrier, Friction(barrier, parameters.friction, slip)]


def _require_apart(barrier: Barrier, context: ShellContext, gap: float) -> None:
    """ValueError for a shell that starts inside an obstacle, on it, or too close to it."""
    distance = barrier.surface.gap(np.asarray(context.mesh.points))[0]
    nearest = int(np.argmin(distance))
    least, vertex = float(distance[nearest]), f"vertex {nearest} of {context.shell.name!r}"
    if least < 0:
        raise ValueError(f"{vertex} starts {-least:.3g} m inside {barrier.obstacle!r}; move one of them")
    apart = f"move one of them, so that {gap:.3g} m (the gap) are between them"
    if not least > 0:
        raise ValueError(f"{vertex} starts on {barrier.obstacle!r} (distance 0); {apart}")
    if least < MIN_START_DISTANCE * gap:
        raise ValueError(
            f"{vertex} starts {least:.3g} m from {barrier.obstacle!r}, nearly in touch for a gap "
            f"of {gap:.3g} m: contact would repel it violently; {apart}"
        )
    if least < REPULSION_DISTANCE * gap:
        log.warning(
            "contact: %s starts %.3g m from %r, within the gap of %.3g m: contact repels it violently; %s",
            vertex, least, barrier.obstacle, gap, apart,
        )  # fmt: skip


def impact(context: ShellContext, surface: Surface, motion: PlacedMotion) -> float:
    """Energy per mass with which the shell first falls onto a surface, in J/kg."""
    height = float(np.clip(surface.gap(np.asarray(context.mesh.points))[0], 0, None).max())
    velocity = np.array(context.shell.velocity) - motion.pose(0.0).velocity
    return 0.5 * float(np.sum(np.square(velocity))) + fall_acceleration(context.scene) * height


def _meets_itself(parameters: Contact, context: ShellContext) -> bool:
    names = parameters.self_contact
    if isinstance(names, bool):
        return names
    for name in names:
        context.scene.find(name, (*KEY, "self_contact"), ("shell",))
    return context.shell.name in names


def coupled(parameters: Contact) -> list[tuple[str, str]]:
    """Pairs of names that contact couples."""
    return [(pair[0], pair[1]) for pair in parameters.pairs if len(pair) == 2]


def between(parameters: Contact, contexts: dict[str, tuple[ShellContext, NDArray]]) -> list[Any]:
    """Contact between the shells of a group; `contexts` maps a name to the shell's context and its rows."""
    terms: list[Any] = []
    for pair in parameters.pairs:
        if all(name in contexts for name in pair):
            from ddgcli.models.shell.pairs import shell_pairs

            terms += shell_pairs(parameters, contexts, pair)
    return terms


def _obstacle_of(pair: list[str], pairs: list[list[str]], context: ShellContext) -> Obstacle | None:
    """The obstacle that a pair names together with this shell; None for any other pair."""
    scene = context.scene
    if [sorted(p) for p in pairs].count(sorted(pair)) > 1:
        scene.refuse((*KEY, "pairs"), f"the pair {pair} is listed more than once; keep one")
    if len(pair) != 2:
        scene.refuse(KEY, f"a pair of contact is two names, not {pair}")
    roles = sorted(scene.find(name, (*KEY, "pairs")).role for name in pair)
    if pair[0] == pair[1] and roles[0] == "shell":
        scene.refuse((*KEY, "pairs"), f'the pair {pair} is one shell; write self_contact = ["{pair[0]}"]')
    if "shell" not in roles:
        scene.refuse(
            (*KEY, "pairs"),
            f"contact pairs a shell with an obstacle or a shell, found {pair} ({' and '.join(roles)})",
        )
    if context.shell.name not in pair or roles == ["shell", "shell"]:
        return None
    return scene.find(pair[1] if pair[0] == context.shell.name else pair[0], KEY)


EFFECT = Effect(
    "contact",
    Contact,
    build,
    "a distance of each vertex, work only within the gap; meshes: pairs and collision times each iteration",
    ("shell",),
    pairs=coupled,
    between=between,
)
