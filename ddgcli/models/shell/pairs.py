"""Contact by pairs for the effect `contact`: of a shell with a mesh obstacle, itself, or another shell."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import face_area
from ddgcli.geometry.surface_points import largest_distance
from ddgcli.mesh.bisection import bisected
from ddgcli.mesh.shapes import box
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell.barrier import (
    MIN_START_DISTANCE,
    REPULSION_DISTANCE,
    fall_acceleration,
    slip_speed,
    stopping_pressure,
)
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.obstacle import Obstacle
from ddgcli.models.shell.obstacle_motion import PlacedMotion, motion_of
from ddgcli.models.shell.pair_contact import (
    MovingPairBarrier,
    MovingPairFriction,
    PairBarrier,
    PairFriction,
    PairMesh,
    ipctk,
)

MAX_SIDE_RATIO = 1.5  # ratio of sides of an obstacle and of the shell above which the obstacle is refined
MAX_OBSTACLE_FACES = 20_000  # limit of this refinement, because each search for pairs visits all faces
# gap of a shell with itself, over the least distance at the start between parts that are not adjacent
SELF_GAP_FRACTION = 0.5
log = logging.getLogger("ddgcli")


def obstacle_pairs(parameters: Any, context: ShellContext, obstacle: Obstacle) -> list[Any]:
    """Barrier and friction between a shell and a mesh or a box.

    Parameters
    ----------
    parameters : object
        Section of the effect `contact`.
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
    mesh, velocity = _pair_mesh(context, obstacle, solid, motion), motion.pose(0.0).velocity
    gap, pressure = _gap_and_pressure(parameters, [context], mesh, obstacle.name, velocity)
    fine, scale = _fine_obstacle(context, solid)
    kind = (MovingPairBarrier, MovingPairFriction) if obstacle.moving else (PairBarrier, PairFriction)
    slip = slip_speed(parameters.slip, [context], np.array(velocity))
    mesh = _pair_mesh(context, obstacle, fine, motion, scale)
    return _terms(parameters, mesh, obstacle.name, kind, gap, pressure, slip)


def _pair_mesh(
    context: ShellContext, obstacle: Obstacle, solid: TriangleMesh, motion: PlacedMotion, scale: float = 1.0
) -> PairMesh:
    """Pair mesh of a shell and the triangles of an obstacle."""
    shell, n = context.mesh, context.mesh.n_vertices
    return PairMesh(
        np.arange(n), np.concatenate([shell.points, solid.points]),
        np.concatenate([shell.topology.edges, solid.topology.edges + n]),
        np.concatenate([shell.faces, solid.faces + n]),
        [(context.shell.name, 0, 0), (obstacle.name, n, shell.n_faces)],
        np.repeat([0, 1], [n, solid.n_vertices]), motion,
        np.repeat([1.0, scale], [n, solid.n_vertices]),
    )  # fmt: skip


def _mean_side(mesh: TriangleMesh) -> float:
    return float(mesh.side_length.mean())


def _fine_obstacle(context: ShellContext, solid: TriangleMesh) -> tuple[TriangleMesh, float]:
    """An obstacle refined to sides about as short as those of a shell, and a factor for its weights.

    The weight of a pair is the area around its two elements: if the edges of the obstacle are a hundred times
    as long as those of the shell, it is ten thousand times too large along its edges, and a sixth of what it
    should be within its faces. The factor replaces refinement where this would give too many faces; it is 1
    if the sides are short enough.
    """
    longest = MAX_SIDE_RATIO * _mean_side(context.mesh)
    size = max(longest, 2.0 * float(np.sqrt(face_area(solid.side_length).sum() / MAX_OBSTACLE_FACES)))
    while (marked := solid.side_length.max(axis=1) > size).any() and solid.n_faces < MAX_OBSTACLE_FACES:
        solid = bisected(solid, marked).mesh
    return solid, min(1.0, longest / float(solid.side_length.max()))


def _obstacle_mesh(context: ShellContext, obstacle: Obstacle) -> TriangleMesh:
    """Triangle mesh of an obstacle, in the coordinates of its motion."""
    if obstacle.box is not None:
        solid = box(1, 1, 1, obstacle.box.size)
        return solid.moved_unchecked(np.asarray(solid.points) + np.array(obstacle.box.corner))
    mesh = context.obstacles[obstacle.name].mesh
    return mesh.moved_unchecked(np.asarray(mesh.points) * (obstacle.scale or 1.0))


def self_pairs(parameters: Any, context: ShellContext) -> list[Any]:
    """Barrier and friction of a shell with itself; gap and stiffness are those of the unbroken shell.

    Parameters
    ----------
    parameters : object
        Section of the effect `contact`.
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
    """Whether an effect `fracture` applies to this shell."""
    fractures = [section for effect, section, _ in context.scene.effects if effect.name == "fracture"]
    return any(section.object in (None, context.shell.name) for section in fractures)


def _gap_of_pieces(gap: float, largest: float, name: str) -> float:
    """The gap of a shell that may break, limited to `largest`, with a warning if this makes it smaller."""
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
    """Barrier and friction between two shells of a group.

    Parameters
    ----------
    parameters : object
        Section of the effect `contact`.
    contexts : dict of str to (ShellContext, (n,) ndarray)
        Context of each shell, and indices of its vertices in the group.
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
        np.repeat([0, 1], [n, b.n_vertices]), scales=_scales_of(a, b),
    )  # fmt: skip
    gap, pressure = _gap_and_pressure(parameters, [first, second], mesh, "")
    slip = slip_speed(parameters.slip, [first, second])
    return _terms(parameters, mesh, "", (PairBarrier, PairFriction), gap, pressure, slip)


def _scales_of(a: TriangleMesh, b: TriangleMesh) -> NDArray[np.float64]:
    """Factors on the lengths of two shells, so that the coarser one weighs pairs like the finer one."""
    ratio = MAX_SIDE_RATIO * _mean_side(a) / _mean_side(b)
    factors = [min(1.0, MAX_SIDE_RATIO**2 / ratio), min(1.0, ratio)]
    return np.repeat(factors, [a.n_vertices, b.n_vertices])


def _gap_and_pressure(
    parameters: Any,
    contexts: list[ShellContext],
    mesh: PairMesh,
    obstacle: str,
    velocity: Any = (0.0, 0.0, 0.0),
) -> tuple[float, float]:
    """Gap in m, and pressure in Pa at half the gap; ValueError if surfaces intersect at the start."""
    _require_implicit(contexts[0])
    start = mesh.joined(_start(contexts, mesh), 0.0)
    intersection = mesh.intersection(start)
    if intersection:
        raise ValueError(f"{intersection} at the start; move one of them")
    gap = float(parameters.gap or max(context.shell.thickness or 0 for context in contexts))
    gap = _admissible_gap(mesh, start, gap, alone=not obstacle and len(contexts) == 1)
    density = max(float(context.shell.density or 0) for context in contexts)
    energy = density * _impact(contexts, mesh, start, np.array(velocity))
    pressure = float(parameters.stiffness or stopping_pressure(contexts[0].scene, energy, density, gap))
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
    """Initial positions of the vertices of a system, up to the last one that the pair mesh uses."""
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
    """The gap, reduced if parts of one shell are nearer at the start: they must start without contact."""
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
        if least < REPULSION_DISTANCE * gap:
            log.warning(
                "contact: %s start %.3g m apart, within the gap of %.3g m: contact repels them violently; "
                "move one of them, or write a smaller gap",
                _names(mesh), least, gap,
            )  # fmt: skip
        return gap
    log.warning(
        "contact: parts of %s start %.3g m apart, nearer than the gap of %.3g m; their gap is %.3g m",
        mesh.labels[0][0], least, gap, SELF_GAP_FRACTION * least,
    )  # fmt: skip
    return SELF_GAP_FRACTION * least


def _names(mesh: PairMesh) -> str:
    names = [repr(label[0]) for label in mesh.labels]
    return f"parts of {names[0]}" if len(names) == 1 else " and ".join(names)


def _impact(contexts: list[ShellContext], mesh: PairMesh, start: NDArray, velocity: NDArray) -> float:
    """Energy per mass of the first fall, in J/kg; the height of self-contact is the extent of the shell."""
    speeds = [np.array(context.shell.velocity) - velocity for context in contexts]
    kinetic = 0.5 * max(float(v @ v) for v in speeds)
    if len(contexts) == 2:
        kinetic = 0.5 * float(np.sum(np.square(speeds[0] - speeds[1])))
    if len(mesh.labels) == 1:
        height = float(np.ptp(start, axis=0).max())
    else:
        height = _height(mesh, start, of=0)
        if len(contexts) == 2:  # either may be the one that falls
            height = min(height, _height(mesh, start, of=1))
    return kinetic + fall_acceleration(contexts[0].scene) * height


def _height(mesh: PairMesh, start: NDArray, of: int) -> float:
    """Largest distance in m of the vertices of one surface of a pair mesh from the other."""
    first_vertex, first_face = mesh.labels[1][1:]
    vertices = slice(None, first_vertex) if of == 0 else slice(first_vertex, None)
    faces = slice(first_face, None) if of == 0 else slice(None, first_face)
    surface = Topology(np.ascontiguousarray(mesh.faces[faces], dtype=np.int64), len(start))
    return largest_distance(TriangleMesh(start, surface), start[vertices])
