"""Effect `attach`: vertices of a shell tied to another shell, or carried by an obstacle."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ddgcli.mechanics.terms import FixedCoordinates, Mode, Potential, PrescribedMotion
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.vectors import row_dot
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.obstacle_motion import middle_of, motion_of
from ddgcli.scenes.sections import Key, Section
from ddgcli.scenes.units import quantity, vector
from ddgcli.simulation.effects import Effect

STIFFNESS_FACTOR = 10.0  # default stiffness of a tie over Young's modulus times thickness
# difference step for the acceleration of an obstacle, over the shortest interval between key frames
ACCELERATION_STEP = 1e-5
KEY: Key = ("effects", "attach")


class Attach(Section):
    """Ties between a shell and another shell or an obstacle."""

    object: str = Field(description="shell")
    to: str = Field(description="other shell, or obstacle")
    name: str | None = Field(None, description="of the reaction force on an obstacle; default attach")
    vertices: list[int] | None = Field(None, description="vertex indices of the shell")
    box: list[vector("m")] | None = Field(
        None, min_length=2, max_length=2, description="two opposite corners, [[x, y, z], [x, y, z]]"
    )
    to_vertices: list[int] | None = Field(
        None, description="of the other shell, one for each vertex; default: the nearest at the start"
    )
    stiffness: (
        quantity("N/m", "of a tie between shells; default: 10 times Young's modulus times thickness", gt=0)
        | None
    ) = None


class Ties(Potential):
    """Springs between pairs of vertices: energy k/2 (|x_b - x_a| - l)^2, l the distance at the start."""

    name = "attach"

    def __init__(self, pairs: NDArray, length: NDArray, stiffness: NDArray | float) -> None:
        self.stencil, self.length = pairs, length
        self.stiffness = np.broadcast_to(np.asarray(stiffness, dtype=float), length.shape)

    def _span(self, x: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Vectors between the vertices (t, 3), lengths (t,), and directions (t, 3), 0 where the length is."""
        span = x[self.stencil[:, 1]] - x[self.stencil[:, 0]]
        size = np.sqrt(row_dot(span, span))
        return span, size, span / np.where(size > 0, size, 1.0)[:, None]

    def energy(self, x: NDArray) -> float:
        return 0.5 * float(np.sum(self.stiffness * (self._span(x)[1] - self.length) ** 2))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        _, size, unit = self._span(x)
        force = (self.stiffness * (size - self.length))[:, None] * unit
        return sum_by_index(self.stencil, np.stack([-force, force], axis=1), len(x))

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        _, size, unit = self._span(x)
        across = 1 - np.divide(self.length, size, out=np.zeros_like(size), where=size > 0)
        if mode != "exact":
            across = np.maximum(across, 0.0)
        outer = unit[:, :, None] * unit[:, None, :]
        block = self.stiffness[:, None, None] * (outer + across[:, None, None] * (np.eye(3) - outer))
        return np.block([[block, -block], [-block, block]])


def build(parameters: Attach, context: ShellContext) -> list[Any]:
    scene = context.scene
    other = scene.find(parameters.to, (*KEY, "to"), ("shell", "obstacle"))
    if parameters.object == parameters.to:
        raise ValueError("object and to name the same shell; a shell is attached to another one")
    vertices = context.selection(parameters.vertices, parameters.box, KEY)
    if other.role == "shell":
        return []  # `between` makes the ties, when both shells are known
    if parameters.to_vertices is not None or parameters.stiffness is not None:
        raise ValueError("to_vertices and stiffness are for ties to another shell; an obstacle holds exactly")
    kinds = FixedCoordinates | PrescribedMotion
    fixed_terms = [term for terms in context.terms.values() for term in terms if isinstance(term, kinds)]
    if any(term.mask[vertices].any() for term in fixed_terms):
        raise ValueError("a vertex is already held by another effect; leave it out of one of them")
    mask = np.zeros((context.mesh.n_vertices, 3), dtype=bool)
    mask[vertices] = True
    if not other.moving:
        return [FixedCoordinates(mask)]
    if other.mesh is None:
        middle = middle_of(other)
    else:
        points = np.asarray(context.obstacles[other.name].mesh.points) * (other.scale or 1.0)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    motion, points = motion_of(other, middle), np.asarray(context.mesh.points)[vertices]
    body = motion.pose(0.0).body(points)
    step = ACCELERATION_STEP * (float(np.diff(other.times).min()) if other.times else 1.0)

    def carried(time: float) -> tuple[NDArray, NDArray, NDArray]:
        pose = motion.pose(time)
        x = pose.points(body)
        before, after = motion.pose(time - step), motion.pose(time + step)
        change = after.velocities(after.points(body)) - before.velocities(before.points(body))
        return x, pose.velocities(x), change / (2 * step)

    return [PrescribedMotion(mask, carried)]


def coupled(parameters: Attach) -> list[tuple[str, str]]:
    """Names of the two objects that the ties couple."""
    return [(parameters.object, parameters.to)]


def between(parameters: Attach, contexts: dict[str, tuple[ShellContext, NDArray]]) -> list[Ties]:
    """Ties between the two shells, as a potential of the vertices of their group."""
    if parameters.object not in contexts or parameters.to not in contexts:
        return []
    (context, rows), (other, other_rows) = contexts[parameters.object], contexts[parameters.to]
    x, y = np.asarray(context.mesh.points), np.asarray(other.mesh.points)
    whole, other_whole = context.vertices_at_start, other.vertices_at_start
    if parameters.to_vertices is None:
        vertices = np.unique(whole[context.selection(parameters.vertices, parameters.box, KEY)])
        # the first n vertices of a broken shell are those of the whole one
        sites = y[: other_whole.max() + 1]
        targets = np.array([int(np.argmin(((sites - x[v]) ** 2).sum(axis=1))) for v in vertices])
    else:
        if parameters.vertices is None or len(parameters.vertices) != len(parameters.to_vertices):
            raise ValueError("to_vertices needs vertices with as many entries")
        outside = [v for v in parameters.to_vertices if not 0 <= v <= other_whole.max()]
        if outside:
            raise ValueError(f"vertex {outside[0]} is outside 0..{other_whole.max()} of {parameters.to!r}")
        context.selection(parameters.vertices, None, KEY)
        vertices, targets = np.array(parameters.vertices), np.array(parameters.to_vertices)
    length = np.sqrt(((y[targets] - x[vertices]) ** 2).sum(axis=1))
    shell = context.shell
    default = STIFFNESS_FACTOR * float(shell.young or 0) * float(shell.thickness or 0)
    # copies of a vertex that has split share its tie: no energy comes or goes with a crack
    own, number = np.nonzero(whole[:, None] == vertices)
    far, other_number = np.nonzero(other_whole[:, None] == targets)
    copy, other_copy = np.nonzero(number[:, None] == other_number)
    tie = number[copy]
    stiffness = float(parameters.stiffness or default) / np.bincount(tie)[tie]
    pairs = np.stack([rows[own[copy]], other_rows[far[other_copy]]], axis=1)
    return [Ties(pairs, length[tie], stiffness)]


EFFECT = Effect(
    "attach",
    Attach,
    build,
    "ties: one pass over them; obstacles: none, carried coordinates leave the system",
    ("shell",),
    repeatable=True,
    pairs=coupled,
    between=between,
)
