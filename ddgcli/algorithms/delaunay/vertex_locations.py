"""Locations, on the input surface, of the vertices of a triangulation under refinement."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.circumcentres import MIN_BARYCENTRIC, triangle_share
from ddgcli.algorithms.delaunay.flips import SideArrays
from ddgcli.algorithms.delaunay.gluing import around
from ddgcli.algorithms.delaunay.steiner_base import SteinerPoints
from ddgcli.algorithms.tracing.lines import LineStart
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.errors import SolveError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.geometry.unfolding import corner_position, vertex_fans
from ddgcli.mesh.topology import NEXT, sorted_sides
from ddgcli.mesh.triangle_mesh import TriangleMesh

MIN_EDGE_DISTANCE = 0.01  # distance from input edges, relative to that from the nearest vertex


@dataclass(eq=False)
class SurfaceLocations:
    """Points of intrinsic faces in the plane, and their positions on the input.

    `turn` is the angle from the layout to the planar frame of the input face; `valid` is False where the line
    to the point left the surface (it does not in exact arithmetic), `clear` where an input edge is too near.
    """

    valid: NDArray[np.bool_]
    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    point: NDArray[np.complex128]
    turn: NDArray[np.float64]
    clear: NDArray[np.bool_]

    def __getitem__(self, rows: NDArray) -> SurfaceLocations:
        return SurfaceLocations(**{name: value[rows] for name, value in vars(self).items()})

    def replace(self, place: NDArray, other: SurfaceLocations) -> None:
        for name, value in vars(other).items():
            getattr(self, name)[place] = value


class SideTable:
    """The sides of a mesh by their ends."""

    def __init__(self, mesh: TriangleMesh) -> None:
        topology = mesh.topology
        self.n = np.int64(max(topology.n_vertices, 1))
        self.key, self.side = sorted_sides(topology.side_tail, topology.side_head, topology.n_vertices)

    def between(self, tail: NDArray, head: NDArray) -> NDArray[np.int64]:
        """The side from each tail to the head."""
        key = tail * self.n + head
        place = np.minimum(np.searchsorted(self.key, key), len(self.key) - 1)
        if not np.array_equal(self.key[place], key):
            raise SolveError("a boundary side joins two vertices that no input edge joins")
        return self.side[place]


class VertexLocations:
    """Input face and barycentric coordinates of each vertex, and the location of further points.

    Directions at input vertices are angles from the first side of the vertex's fan; at Steiner points they
    are angles in the planar frame of the input face that holds the point.

    Parameters
    ----------
    mesh : TriangleMesh
        The input, manifold and oriented.
    scale : float
        Factor from the lengths of the triangulation to those of the input.
    """

    def __init__(self, mesh: TriangleMesh, scale: float) -> None:
        self.mesh, self.scale = mesh, scale
        self.tracer, self.fans = Tracer(mesh), vertex_fans(mesh)
        n = mesh.n_vertices
        self.fan = np.full(n, -1, dtype=np.int64)
        self.fan[self.fans.vertex] = np.arange(len(self.fans.vertex))
        self.face = np.full(n, -1, dtype=np.int64)
        self.barycentric = np.zeros((n, 3))
        self.edge = np.full(n, -1, dtype=np.int64)  # input side of boundary Steiner points
        self.edge_share = np.zeros(n)

    @cached_property
    def sides(self) -> SideTable:
        """The input's sides by their ends."""
        return SideTable(self.mesh)

    @property
    def n_steiner(self) -> int:
        return len(self.face) - self.mesh.n_vertices

    def steiner(self) -> SteinerPoints:
        """Positions of the Steiner points, in the order of their insertion."""
        n = self.mesh.n_vertices
        return SteinerPoints(self.face[n:], self.barycentric[n:], self.edge[n:], self.edge_share[n:])

    def add_inside(self, located: SurfaceLocations) -> NDArray[np.int64]:
        """New vertices inside input faces; returns their indices."""
        k = len(located.face)
        return self._add(located.face, located.barycentric, np.full(k, -1), np.zeros(k))

    def add_on_boundary(self, edge: NDArray, share: NDArray) -> NDArray[np.int64]:
        """New vertices at fractions of input boundary sides; returns their indices."""
        row, corner = np.arange(len(edge)), edge % 3
        barycentric = np.zeros((len(edge), 3))
        barycentric[row, corner] = 1.0 - share
        barycentric[row, (corner + 1) % 3] = share
        return self._add(edge // 3, barycentric, edge, share)

    def edge_direction(self, edge: NDArray) -> NDArray[np.float64]:
        """Angle of input sides in the planar frames of their faces."""
        x, y = self.tracer.unfolding.direction[edge // 3, edge % 3].T
        return np.arctan2(y, x)

    def _add(self, face: NDArray, barycentric: NDArray, edge: NDArray, share: NDArray) -> NDArray[np.int64]:
        first = len(self.face)
        self.face = np.concatenate([self.face, face])
        self.barycentric = np.concatenate([self.barycentric, barycentric])
        self.edge, self.edge_share = (
            np.concatenate([self.edge, edge]),
            np.concatenate([self.edge_share, share]),
        )
        return first + np.arange(len(face))

    def on_boundary(self, state: SideArrays, side: NDArray, share: NDArray) -> tuple[NDArray, NDArray]:
        """Input side, and fraction of it, of points at fractions of intrinsic boundary sides."""
        tail, head = state.tail[side], state.tail[around(side)[1]]
        edge = np.where(self.edge[tail] >= 0, self.edge[tail], self.edge[head])
        whole = np.flatnonzero(edge < 0)  # both ends are input vertices
        edge[whole] = self.sides.between(tail[whole], head[whole])
        low = np.where(self.edge[tail] >= 0, self.edge_share[tail], 0.0)
        high = np.where(self.edge[head] >= 0, self.edge_share[head], 1.0)
        return edge, low + share * (high - low)

    def locate(self, state: SideArrays, face: NDArray, corners: NDArray, point: NDArray) -> SurfaceLocations:
        """Locate points of intrinsic faces on the input; `corners` and `point` are in a planar layout."""
        k = np.arange(len(face))
        distance = np.abs(corners - point[:, None])
        near = distance.argmin(axis=1)
        start, following = corners[k, near], corners[k, (near + 1) % 3]
        side = 3 * face + near
        turn = np.angle((point - start) / (following - start))
        where, barycentric, heading = self._start(state.tail[side], state.direction[side] + turn)  # type: ignore[index]
        planar = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        ends = self.tracer.trace_checked(
            LineStart(where, barycentric, planar, distance[k, near] * self.scale)
        )
        locations = SurfaceLocations(
            valid=(ends.status == 0) & np.isfinite(ends.barycentric).all(axis=1),
            face=ends.face,
            barycentric=np.nan_to_num(ends.barycentric, nan=1 / 3),  # in a face without area
            point=point,
            turn=np.arctan2(ends.direction[:, 1], ends.direction[:, 0]) - np.angle(point - start),
            clear=np.ones(len(face), dtype=bool),
        )
        return self._off_input_edges(locations, corners, MIN_EDGE_DISTANCE * distance[k, near])

    def _off_input_edges(
        self, locations: SurfaceLocations, corners: NDArray, reach: NDArray
    ) -> SurfaceLocations:
        """Move points away from input edges, if they stay inside their intrinsic faces."""
        layout = corner_position(self.tracer.unfolding, locations.face) / self.scale
        places = layout[..., 0] + 1j * layout[..., 1]
        side = self.mesh.side_length[locations.face] / self.scale
        height = 2 * face_area(side)[:, None] / side[:, NEXT]
        least = np.minimum(np.divide(reach[:, None], height, out=np.ones_like(height), where=height > 0), 0.2)
        barycentric = np.maximum(locations.barycentric, least)
        barycentric /= barycentric.sum(axis=1, keepdims=True)
        shift = ((barycentric - locations.barycentric) * places).sum(axis=1)
        point = locations.point + shift * np.exp(-1j * locations.turn)
        moved = triangle_share(corners, point).min(axis=1) > 0.5 * MIN_BARYCENTRIC
        return SurfaceLocations(
            locations.valid,
            locations.face,
            np.where(moved[:, None], barycentric, locations.barycentric),
            np.where(moved, point, locations.point),
            locations.turn,
            moved,
        )

    def _start(self, vertex: NDArray, direction: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Face, barycentric coordinates, and angle in the frame of the face, for directions at vertices."""
        face, barycentric = self.face[vertex].copy(), self.barycentric[vertex].copy()
        heading = direction.copy()
        at_input = np.flatnonzero(vertex < self.mesh.n_vertices)
        fan = self.fan[vertex[at_input]]
        angle = np.mod(
            direction[at_input], np.where(self.fans.is_open[fan], np.inf, self.fans.total_angle[fan])
        )
        corner = self.fans.locate(fan, angle)
        face[at_input] = corner // 3
        barycentric[at_input] = np.eye(3)[corner % 3]
        x, y = self.tracer.unfolding.direction[corner // 3, corner % 3].T
        within = np.clip(angle - self.fans.angle_before[corner], 0.0, self.fans.corner_angle[corner])
        heading[at_input] = np.arctan2(y, x) + within
        return face, barycentric, heading
