"""Pair meshes of the effect `contact`: shell against mesh obstacle, itself, another shell."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.shapes import box
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell.barrier import MIN_START_DISTANCE, STANDARD_GRAVITY, slip_speed
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.obstacle import Obstacle
from ddgcli.models.shell.obstacle_motion import motion_of
from ddgcli.models.shell.pair_contact import (
    MovingPairBarrier,
    MovingPairFriction,
    PairBarrier,
    PairFriction,
    PairMesh,
    ipctk,
)

SELF_GAP_FRACTION = 0.5  # of the least distance at the start between parts that are not adjacent
log = logging.getLogger("ddgcli")


def obstacle_pairs(parameters: Any, context: ShellContext, obstacle: Obstacle) -> list[Any]:
    """Barrier and friction between a shell and a mesh or a box.

    Parameters
    ----------
    parameters : object
        Of the effect `contact`.
    context : ShellContext
    obstacle : Obstacle

    Returns
    -------
    list
        Terms of the shell.
    """
    solid = _obstacle_mesh(context, obstacle)
    points = np.asarray(solid.points)
    motion = motion_of(obstacle, 0.5 * (points.min(axis=0) + points.max(axis=0)))
    shell, n = context.mesh, context.mesh.n_vertices
    mesh = PairMesh(
        np.arange(n), np.concatenate([shell.points, points]),
        np.concatenate([shell.topology.edges, solid.topology.edges + n]),
        np.concatenate([shell.faces, solid.faces + n]),
        [(context.shell.name, 0, 0), (obstacle.name, n, shell.n_faces)],
        np.repeat([0, 1], [n, len(points)]), motion,
    )  # fmt: skip
    kind = (MovingPairBarrier, MovingPairFriction) if obstacle.moving else (PairBarrier, PairFriction)
    velocity = motion.pose(0.0).velocity
    return _pair_terms(parameters, [context], mesh, obstacle.name, kind, velocity)


def _obstacle_mesh(context: ShellContext, obstacle: Obstacle) -> TriangleMesh:
    """Triangles of an obstacle, in the coordinates of its motion."""
    if obstacle.box is not None:
        solid = box(1, 1, 1, obstacle.box.size)
        return solid.moved(np.asarray(solid.points) + np.array(obstacle.box.corner))
    mesh = context.obstacles[obstacle.name].mesh
    return mesh.moved(np.asarray(mesh.points) * (obstacle.scale or 1.0))


def self_pairs(parameters: Any, context: ShellContext) -> list[Any]:
    """Barrier and friction of a shell with itself; gap and stiffness are those of the whole shell.

    Parameters
    ----------
    parameters : object
        Of the effect `contact`.
    context : ShellContext

    Returns
    -------
    list
        Terms of the shell.
    """
    whole = context.whole
    shell = whole.mesh
    mesh = PairMesh(
        np.arange(shell.n_vertices), np.asarray(shell.points), shell.topology.edges, np.asarray(shell.faces),
        [(context.shell.name, 0, 0)],
    )  # fmt: skip
    gap, pressure = _gap_and_pressure(parameters, [whole], mesh, "")
    if _may_break(context):
        from ddgcli.models.shell.crack_contact import InsetPairMesh, largest_gap

        gap = _gap_of_pieces(gap, largest_gap(whole), context.shell.name)
        if context.input_vertex is not None:
            mesh = InsetPairMesh(context, gap)
    slip = slip_speed(parameters.slip, [whole])
    return _terms(parameters, mesh, "", (PairBarrier, PairFriction), gap, pressure, slip)


def _may_break(context: ShellContext) -> bool:
    """Whether an effect `fracture` is about this shell."""
    fractures = [section for effect, section, _ in context.scene.effects if effect.name == "fracture"]
    return any(section.object in (None, context.shell.name) for section in fractures)


def _gap_of_pieces(gap: float, largest: float, name: str) -> float:
    """The gap of a shell that may break, at most `largest`, with a warning where that is less."""
    if gap > largest:
        log.warning(
            "contact: the gap of %s with itself is %.3g m, not %.3g m: pieces may be single faces, and the "
            "smallest has no room for more",
            name, largest, gap,
        )  # fmt: skip
    return min(gap, largest)


def shell_pairs(
    parameters: Any, contexts: dict[str, tuple[ShellContext, NDArray]], pair: list[str]
) -> list[Any]:
    """Barrier and friction between two shells, over the rows of their group.

    Parameters
    ----------
    parameters : object
        Of the effect `contact`.
    contexts : dict of str to (ShellContext, (n,) ndarray)
        With the rows of each shell.
    pair : list of two str

    Returns
    -------
    list
        Terms of the group.
    """
    (first, rows), (second, other) = contexts[pair[0]], contexts[pair[1]]
    a, b, n = first.mesh, second.mesh, first.mesh.n_vertices
    mesh = PairMesh(
        np.concatenate([rows, other]), np.concatenate([a.points, b.points]),
        np.concatenate([a.topology.edges, b.topology.edges + n]), np.concatenate([a.faces, b.faces + n]),
        [(pair[0], 0, 0), (pair[1], n, a.n_faces)],
        np.repeat([0, 1], [n, b.n_vertices]),
    )  # fmt: skip
    return _pair_terms(parameters, [first, second], mesh, "", (PairBarrier, PairFriction))


def _pair_terms(
    parameters: Any,
    contexts: list[ShellContext],
    mesh: PairMesh,
    obstacle: str,
    kind: tuple[type[PairBarrier], type[PairFriction]],
    velocity: Any = (0.0, 0.0, 0.0),
) -> list[Any]:
    gap, pressure = _gap_and_pressure(parameters, contexts, mesh, obstacle, velocity)
    slip = slip_speed(parameters.slip, contexts, np.array(velocity))
    return _terms(parameters, mesh, obstacle, kind, gap, pressure, slip)


def _gap_and_pressure(
    parameters: Any,
    contexts: list[ShellContext],
    mesh: PairMesh,
    obstacle: str,
    velocity: Any = (0.0, 0.0, 0.0),
) -> tuple[float, float]:
    """Gap in m, and pressure in Pa at half of it; ValueError where surfaces intersect at the start."""
    _require_implicit(contexts[0])
    start = mesh.joined(_start(contexts, mesh), 0.0)
    intersection = mesh.intersection(start)
    if intersection:
        raise ValueError(f"{intersection} at the start; move one of them")
    gap = float(parameters.gap or max(context.shell.thickness or 0 for context in contexts))
    gap = _admissible_gap(mesh, start, gap, alone=not obstacle and len(contexts) == 1)
    density = max(float(context.shell.density or 0) for context in contexts)
    drop = density * _impact(contexts, start, np.array(velocity))
    pressure = float(parameters.stiffness or max(2 * drop / gap, 10 * STANDARD_GRAVITY * density))
    return gap, pressure


def _terms(
    parameters: Any,
    mesh: PairMesh,
    obstacle: str,
    kind: tuple[type[PairBarrier], type[PairFriction]],
    gap: float,
    pressure: float,
    slip: float,
) -> list[Any]:
    barrier = kind[0](mesh, gap, pressure, obstacle)
    if not parameters.friction:
        return [barrier]
    return [barrier, kind[1](barrier, parameters.friction, slip)]


def _start(contexts: list[ShellContext], mesh: PairMesh) -> NDArray[np.float64]:
    """Positions over the system's rows, as far as this pair mesh reads them."""
    points = np.concatenate([np.asarray(context.mesh.points) for context in contexts])
    x = np.zeros((int(mesh.rows.max()) + 1, 3))
    x[mesh.rows] = points
    return x


def _require_implicit(context: ShellContext) -> None:
    time = context.scene.time
    explicit = time.integrator in ("verlet", "symplectic-euler", "avi")
    if explicit or (time.integrator == "newmark" and 2 * time.beta < time.gamma):
        raise ValueError(
            f"contact of meshes and self_contact need an implicit scheme, found {time.integrator!r}; "
            'write integrator = "newmark" with beta = 0.25, "implicit-euler", "bdf2" or "static"'
        )


def _admissible_gap(mesh: PairMesh, start: NDArray, gap: float, alone: bool) -> float:
    """The gap, less where a shell's own parts are nearer at the start: they must rest without contact."""
    library = ipctk()
    pairs = library.NormalCollisions()
    pairs.build(mesh.mesh, start, gap, 0.0, library.LBVH())
    if not len(pairs):
        return gap
    least = float(np.sqrt(pairs.compute_minimum_distance(mesh.mesh, start)))
    if not least > 0:
        raise ValueError(f"{_names(mesh)} touch at the start (distance 0); move one of them")
    if not alone and least < MIN_START_DISTANCE * gap:
        largest = least / MIN_START_DISTANCE
        raise ValueError(
            f"{_names(mesh)} start {least:.3g} m apart, nearly in touch for a gap of {gap:.3g} m: contact "
            f"would repel them violently; move one of them, or write a gap below {largest:.2g} m"
        )
    if not alone:
        return gap
    log.warning(
        "contact: parts of %s start %.3g m apart, nearer than the gap of %.3g m; their gap is %.3g m",
        mesh.labels[0][0], least, gap, SELF_GAP_FRACTION * least,
    )  # fmt: skip
    return SELF_GAP_FRACTION * least


def _names(mesh: PairMesh) -> str:
    names = [repr(label[0]) for label in mesh.labels]
    return f"parts of {names[0]}" if len(names) == 1 else " and ".join(names)


def _impact(contexts: list[ShellContext], start: NDArray, velocity: NDArray) -> float:
    """Energy per mass of a fall through the height of everything, with the initial velocities."""
    speeds = [np.array(context.shell.velocity) - velocity for context in contexts]
    kinetic = 0.5 * max(float(v @ v) for v in speeds)
    if len(contexts) == 2:
        kinetic = 0.5 * float(np.sum(np.square(speeds[0] - speeds[1])))
    return kinetic + STANDARD_GRAVITY * float(np.ptp(start, axis=0).max())
