"""Contact between triangle meshes by vertex-face and edge-edge pairs, with the library `ipctk`.

Barrier and friction potentials, distances and continuous collision detection are those of [Li et al.,
"Incremental potential contact", 2020]. The pairs have the weights of [Li et al., "Convergent incremental
potential contact", 2023], so that the pressure does not depend on the mesh.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array

from ddgcli.mechanics.terms import (
    NO_ELEMENTS,
    BarrierPotential,
    Dissipation,
    Mode,
    Potential,
    TimedPositions,
    at_last_point,
)
from ddgcli.mesh.vectors import row_dot
from ddgcli.models.shell.barrier import carry_weight
from ddgcli.models.shell.near_pairs import REACH, NearPairs, largest_relative_move
from ddgcli.models.shell.obstacle_motion import PlacedMotion

INSTALL_LINE = "pip install 'ddgcli[contact]'"
# pressure between two parallel sheets half the range apart, over the stiffness; measured: 6.9 to 7.4
HALF_RANGE_PRESSURE = 7.0
CCD_FRACTION = 0.9  # fraction of the distance to an impact that a step may take


def ipctk() -> Any:
    """Import `ipctk` and make it single-threaded, so that every run gives the same numbers.

    Returns
    -------
    module

    Raises
    ------
    ValueError
        If it is not installed.
    """
    try:
        library = importlib.import_module("ipctk")
    except ImportError as error:
        raise ValueError(
            f"contact of meshes and self_contact need the library ipctk; run {INSTALL_LINE}"
        ) from error
    library.set_num_threads(1)
    return library


class PairMesh:
    """Surfaces that may touch: vertices of a system, followed by those of an obstacle.

    Parameters
    ----------
    rows : (k,) ndarray
        Indices of the vertices in the system.
    rest : (k + b, 3) ndarray
        Positions at the start; those of an obstacle in the coordinates of its motion.
    edges, faces : (e, 2), (m, 3) ndarray
    labels : list of (str, int, int)
        Name of each object, its first vertex and its first face, for messages.
    patches : (k + b,) ndarray of int, optional
        Patch of each vertex; contact within a patch is ignored. By default none is.
    motion : PlacedMotion, optional
        Motion of the obstacle.
    scales : (k + b,) ndarray of float64, optional
        Factor at each vertex on the lengths from which the weights of pairs are computed; by default 1.
    """

    def __init__(
        self,
        rows: NDArray,
        rest: NDArray,
        edges: NDArray,
        faces: NDArray,
        labels: list[tuple[str, int, int]],
        patches: NDArray | None = None,
        motion: PlacedMotion | None = None,
        scales: NDArray | None = None,
    ) -> None:
        library = ipctk()
        self.rows, self.rest, self.motion, self.labels = rows, rest, motion, labels
        self.edges, self.faces = (np.asfortranarray(a.astype(np.int32)) for a in (edges, faces))
        area_points = rest if scales is None else scales[:, None] * rest  # its areas are the weights of pairs
        self.mesh = library.CollisionMesh(np.asfortranarray(area_points), self.edges, self.faces)
        self.filter = None
        if patches is not None:
            self.filter = library.make_vertex_patches_filter(patches.astype(np.int32))
            self.mesh.can_collide = self.filter
        self._select: dict[int, csr_array | None] = {}
        self._near: NearPairs | None = None

    def joined(self, x: NDArray, time: float) -> NDArray[np.float64]:
        """Positions of all vertices, from those x of the system."""
        return self._with(x[self.rows], lambda pose, points: pose.points(points), time)

    def joined_velocities(self, v: NDArray, time: float) -> NDArray[np.float64]:
        """Velocities of all vertices, from those v of the system."""
        return self._with(v[self.rows], lambda pose, points: pose.velocities(pose.points(points)), time)

    def _with(self, own: NDArray, of_obstacle: Any, time: float) -> NDArray[np.float64]:
        if self.motion is None:
            return np.asfortranarray(own)
        obstacle = of_obstacle(self.motion.pose(time), self.rest[len(self.rows) :])
        return np.asfortranarray(np.concatenate([own, obstacle]))

    def scatter(self, gradient: NDArray, n: int) -> NDArray[np.float64]:
        """(n, 3) gradient over the system from that over the pair mesh."""
        total = np.zeros((n, 3))
        total[self.rows] = gradient.reshape(-1, 3)[: len(self.rows)]
        return total

    def scatter_matrix(self, hessian: Any, n: int) -> csc_array:
        """(3n, 3n) matrix over the system from that over the pair mesh."""
        count = 3 * len(self.rest)
        if n not in self._select:
            same = len(self.rows) == len(self.rest) == n and bool((self.rows == np.arange(n)).all())
            coordinate = (3 * self.rows[:, None] + np.arange(3)).ravel()
            ones = (np.ones(len(coordinate)), (coordinate, np.arange(len(coordinate))))
            self._select[n] = None if same else csr_array(ones, shape=(3 * n, count))
        select = self._select[n]
        matrix = csc_array(hessian)
        return matrix if select is None else csc_array(select @ matrix @ select.T)

    def near(self, gap: float, *positions: NDArray) -> NearPairs:
        """Superset of the pairs nearer than `gap` at these positions and on straight paths between them.

        All positions are within the reach of the first.
        """
        near = self._near
        if near is None or near.gap != gap or not near.cover(*positions):
            near = self._near = NearPairs(self.mesh, self.edges, self.faces, positions[0], gap)
        return near

    def begin_step(self) -> None:
        """Discard the cached pairs, so that a step does not depend on earlier ones."""
        self._near = None

    def collision_free_fraction(self, before: NDArray, after: NDArray, gap: float) -> float:
        """Largest fraction of a straight move of all vertices without a collision; 1.0 if there is none.

        For a short move, only pairs nearer than `gap` can shorten it: CCD_FRACTION leaves a tenth of the
        distance of a pair, which is at most twice the move.
        """
        library = ipctk()
        if largest_relative_move(after - before) <= REACH * gap:
            candidates = self.near(gap, before, after).candidates
        else:
            candidates = library.Candidates()
            candidates.build(self.mesh, before, after, 0.0, library.LBVH())
        if not len(candidates):
            return 1.0
        return float(
            candidates.compute_collision_free_stepsize(
                self.mesh, before, after, 0.0, library.AdditiveCCD(conservative_rescaling=CCD_FRACTION)
            )
        )

    def intersection(self, positions: NDArray) -> str:
        """Message that names the first edge and face that intersect, or ""."""
        library = ipctk()
        if not library.has_intersections(self.mesh, positions):
            return ""
        broad = library.LBVH()
        if self.filter is not None:
            broad.can_vertices_collide = self.filter
        broad.build(positions, self.edges, self.faces)
        pairs = sorted((c.edge_id, c.face_id) for c in broad.detect_edge_face_candidates())
        for edge, face in pairs:
            ends, corners = self.edges[edge], self.faces[face]
            if not set(ends) & set(corners) and library.is_edge_intersecting_triangle(
                *positions[ends], *positions[corners]
            ):
                return f"edge {self._edge_name(ends)} passes through {self._face_name(face)}"
        return "two faces intersect"

    def _label(self, vertex: int) -> tuple[str, int, int]:
        return next(label for label in reversed(self.labels) if vertex >= label[1])

    def _edge_name(self, ends: NDArray) -> str:
        name, first, _ = self._label(int(ends[0]))
        return f"{ends[0] - first}-{ends[1] - first} of {name!r}"

    def _face_name(self, face: int) -> str:
        name, _, first = self._label(int(self.faces[face][0]))
        return f"face {face - first} of {name!r}"


class PairBarrier(BarrierPotential):
    """Barrier potential of all pairs of a pair mesh that are nearer than `gap`.

    Parameters
    ----------
    mesh : PairMesh
    gap : float
        In m.
    pressure : float
        Pressure in Pa between parallel sheets half the gap apart.
    obstacle : str
        Name of the obstacle; "" for contact between shells.
    time : float
        Time in s of the pose of a moving obstacle.
    """

    name = "contact"
    stencil = NO_ELEMENTS  # the pairs change, so `hessian` returns the whole matrix

    def __init__(
        self, mesh: PairMesh, gap: float, pressure: float, obstacle: str = "", time: float = 0.0
    ) -> None:
        self.mesh, self.range, self.pressure, self.obstacle, self.time = mesh, gap, pressure, obstacle, time
        self.potential = ipctk().BarrierPotential(gap, pressure / HALF_RANGE_PRESSURE, True)

    @at_last_point
    def near(self, x: NDArray) -> tuple[Any, NDArray]:
        """Pairs nearer than the gap, and the positions of all vertices."""
        library, positions = ipctk(), self.mesh.joined(x, self.time)
        pairs = library.NormalCollisions()
        pairs.use_area_weighting = True
        pairs.collision_set_type = library.NormalCollisions.IMPROVED_MAX_APPROX
        if np.isfinite(positions).all():
            near = self.mesh.near(self.range, positions)
            if len(near.candidates):
                pairs.build(near.candidates, self.mesh.mesh, positions, self.range, 0.0)
        return pairs, positions

    def begin_step(self) -> None:
        """Discard cached pairs, so that a resumed run gives the same bits."""
        self.__dict__.pop("_last_near", None)
        self.mesh.begin_step()

    def energy(self, x: NDArray) -> float:
        pairs, positions = self.near(x)
        return float(self.potential(pairs, self.mesh.mesh, positions)) if len(pairs) else 0.0

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        pairs, positions = self.near(x)
        if not len(pairs):
            return np.zeros_like(x)
        return self.mesh.scatter(self.potential.gradient(pairs, self.mesh.mesh, positions), len(x))

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return np.zeros((0, 3, 3))

    def hessian(self, x: NDArray, mode: Mode) -> csc_array | None:
        """(3n, 3n) Hessian; None without near pairs."""
        pairs, positions = self.near(x)
        if not len(pairs) or mode == "material":
            return None
        method = _projection(mode)
        return self.mesh.scatter_matrix(
            self.potential.hessian(pairs, self.mesh.mesh, positions, method), len(x)
        )

    def collision_free_fraction(self, x: NDArray, move: NDArray) -> float:
        before, after = self.mesh.joined(x, self.time), self.mesh.joined(x + move, self.time)
        if not np.isfinite(after).all():
            return 0.0
        return self.mesh.collision_free_fraction(before, after, self.range)

    def outside(self, x: NDArray) -> tuple[int, float] | None:
        """Some vertex, with gap nan, if surfaces intersect."""
        if ipctk().has_intersections(self.mesh.mesh, self.mesh.joined(x, self.time)):
            return int(self.mesh.rows[0]), float("nan")
        return None

    def crosses(self, before: NDArray, after: NDArray) -> bool:
        """Whether surfaces collide along the straight path."""
        return self.collision_free_fraction(before, after - before) < 1.0

    def expected_stiffness(self, x: NDArray) -> NDArray[np.float64]:
        """Zero: pairs are an error with explicit schemes."""
        return np.zeros(1)


class MovingPairBarrier(PairBarrier):
    """Barrier of an obstacle that moves, at one time."""

    def at(self, time: float) -> MovingPairBarrier:
        if time == self.time:
            return self
        return MovingPairBarrier(self.mesh, self.range, self.pressure, self.obstacle, time)

    def travel_work(self, x: NDArray, before: TimedPositions, after: TimedPositions) -> float:
        """Energy in J that the obstacle adds between two times by its travel, with the force at x."""
        motion: Any = self.mesh.motion
        return -float(np.vdot(self.gradient(x), motion.travel(before, after)))

    def carried(self, x: NDArray, since: float) -> NDArray[np.float64] | None:
        """Positions x of an earlier time, with those near the obstacle moved along with it until now.

        None if surfaces would collide along the path.
        """
        mesh, rows = self.mesh, self.mesh.rows
        before = mesh.joined(x, since)
        motion: Any = mesh.motion
        travel = motion.pose(self.time).points(motion.pose(since).body(x[rows])) - x[rows]
        radius = 2 * (self.range + float(np.sqrt(row_dot(travel, travel).max())))
        candidates = ipctk().Candidates()
        candidates.build(mesh.mesh, before, radius, ipctk().LBVH())
        distance = candidates.compute_per_vertex_safe_distances(mesh.mesh, before, radius)[: len(rows)]
        weight = np.where(distance >= radius, 0.0, carry_weight(distance, travel, self.range))
        moved = x.copy()
        moved[rows] += weight[:, None] * travel
        after = mesh.joined(moved, self.time)
        return moved if mesh.collision_free_fraction(before, after, self.range) == 1.0 else None


class PairFriction(Dissipation):
    """Coulomb friction of a pair barrier, with the normal forces and planes at which it is frozen."""

    name = "contact"

    def __init__(self, barrier: PairBarrier, coefficient: float, slip: float) -> None:
        self.barrier, self.coefficient, self.slip = barrier, coefficient, slip
        self.obstacle, self.stencil = barrier.obstacle, barrier.stencil
        self.wall_time = barrier.time

    def frozen(self, x: NDArray, dt: float) -> PairSliding:
        library, barrier = ipctk(), self.barrier
        pairs, positions = barrier.near(x)
        sliding = library.TangentialCollisions()
        if len(pairs):
            sliding.build(barrier.mesh.mesh, positions, pairs, barrier.potential, self.coefficient)
        return PairSliding(barrier.mesh, sliding, library.FrictionPotential(self.slip), self.wall_time)


class MovingPairFriction(PairFriction):
    """Friction of an obstacle that moves, which can add energy."""

    active = True
    barrier: MovingPairBarrier

    def at(self, time: float) -> MovingPairFriction:
        return MovingPairFriction(self.barrier.at(time), self.coefficient, self.slip)

    def lagged(self, time: float) -> MovingPairFriction:
        """The friction with the normal forces of an earlier time."""
        friction = self.at(time)
        friction.wall_time = self.wall_time
        return friction


class PairSliding(Potential):
    """Friction of pairs as a potential of the velocities."""

    name = "contact"
    stencil = NO_ELEMENTS

    def __init__(self, mesh: PairMesh, pairs: Any, potential: Any, time: float) -> None:
        self.mesh, self.pairs, self.potential, self.time = mesh, pairs, potential, time

    def energy(self, x: NDArray) -> float:
        if not len(self.pairs):
            return 0.0
        return float(self.potential(self.pairs, self.mesh.mesh, self._velocities(x)))

    def _velocities(self, v: NDArray) -> NDArray[np.float64]:
        return self.mesh.joined_velocities(v, self.time)

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        if not len(self.pairs):
            return np.zeros_like(x)
        return self.mesh.scatter(
            self.potential.gradient(self.pairs, self.mesh.mesh, self._velocities(x)), len(x)
        )

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        return np.zeros((0, 3, 3))

    def hessian(self, x: NDArray, mode: Mode) -> csc_array | None:
        """(3n, 3n) Hessian; None without pairs."""
        if not len(self.pairs):
            return None
        matrix = self.potential.hessian(self.pairs, self.mesh.mesh, self._velocities(x), _projection(mode))
        return self.mesh.scatter_matrix(matrix, len(x))


def _projection(mode: Mode) -> Any:
    method = ipctk().PSDProjectionMethod
    return method.NONE if mode == "exact" else method.CLAMP
