"""The logarithmic map: for every vertex, in which direction and how far it lies from a source.

Distance and direction are those of the exact shortest path on the polyhedron: the path is walked back from
the vertex, and the direction in which it arrives is read at the source. No equation is solved, so the map
has no smoothing error; it jumps across the cut locus, as the true one does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curves.paths import seen_from, segment_vectors
from ddgcli.algorithms.curves.shortest_paths import shortest_paths, trace_back
from ddgcli.algorithms.distance.exact import ExactDistance
from ddgcli.algorithms.distance.sources import Sources
from ddgcli.algorithms.straightest.trace import Told, Tracer
from ddgcli.errors import ParameterError
from ddgcli.geometry.face_frames import planar_difference
from ddgcli.geometry.unfolding import SurfaceMesh
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh, vector_length

_SHORT = 1e-6  # lines are stopped this fraction of the shortest side around the source before it


@dataclass(frozen=True, eq=False)
class LogMap:
    """Directions and distances from one source.

    Parameters
    ----------
    log_map : (n, 2) ndarray of float64
        Coordinates in the tangent plane of the source: its size is the distance, its angle that of the
        shortest path, counter-clockwise from the x axis. At a vertex surface angles are multiplied by
        2 pi / total angle; on the boundary they are kept. inf where the source does not reach, or only
        across an edge of three or more faces.
    axis : dict
        The x axis: towards a vertex (`towards_vertex`) or along side 0 of a face (`face`), and in space.
    miss : float
        Largest distance at which a line walked back passes the source, relative to the largest distance;
        and of paths that had to be followed bend by bend, by what share their length is not the distance.
    lost : int
        Vertices with a distance but no direction: their shortest paths cross edges of three or more faces.
    """

    log_map: NDArray[np.float64]
    axis: dict[str, Any]
    miss: float
    lost: int


class _Centre:
    """The source and its angles: where the x axis lies and what angle a direction in a face has."""

    def __init__(self, tracer: Tracer, sources: Sources) -> None:
        if len(sources) != 1:
            raise ParameterError(f"--log-map is a map from one source; {len(sources)} were given")
        self.tracer, mesh = tracer, tracer.mesh
        self.vertex = int(sources.vertex[0]) if len(sources.vertex) else -1
        self.scale = 1.0
        if self.vertex < 0:
            self.face, self.barycentric = int(sources.points.face[0]), sources.points.barycentric[0]
            if self.barycentric.max() >= 1 - 1e-14:
                self.vertex = int(mesh.faces[self.face, np.argmax(self.barycentric)])
            elif self.barycentric.min() <= 1e-14:
                edge = mesh.topology.side_edge[self.face, NEXT[np.argmin(self.barycentric)]]
                if mesh.topology.edge_face_count[edge] > 2:
                    raise ParameterError(
                        f"the source lies on an edge of {mesh.topology.edge_face_count[edge]} faces and has "
                        "no tangent plane there; take another source"
                    )
        if self.vertex >= 0:
            fans = tracer.fans
            own = np.flatnonzero(fans.vertex == self.vertex)
            if len(own) != 1:
                raise ParameterError(
                    f"vertex {self.vertex} joins {len(own)} fans of faces; take another source"
                )
            self.fan = int(own[0])
            self.first = int(fans.corner[fans.start[self.fan]])
            if not fans.is_open[self.fan]:
                self.scale = 2 * np.pi / float(fans.total_angle[self.fan])

    def axis(self) -> dict[str, Any]:
        """What the x axis is."""
        mesh = self.tracer.mesh
        said: dict[str, Any] = (
            {"towards_vertex": int(mesh.topology.side_head[self.first])}
            if self.vertex >= 0
            else {"face": self.face}
        )
        if isinstance(mesh, TriangleMesh):
            side = self.first if self.vertex >= 0 else 3 * self.face
            vector = mesh.side_vector.reshape(-1, 3)[side]
            said["x_axis"] = (vector / (float(vector_length(vector)) or 1.0)).tolist()
        return said

    def seen_in(self, face: NDArray) -> NDArray[np.float64]:
        """(k, 3) the source in faces; nan where they do not hold it."""
        mesh = self.tracer.mesh
        if self.vertex >= 0:
            here = mesh.faces[face] == self.vertex
            return np.where(here.any(axis=1)[:, None], np.eye(3)[np.argmax(here, axis=1)], np.nan)
        k = len(face)
        return seen_from(mesh.topology, np.full(k, self.face), np.tile(self.barycentric, (k, 1)), face)

    def angle(self, face: NDArray, direction: NDArray) -> NDArray[np.float64]:
        """Angles of directions in the planar frames of faces that hold the source, not yet scaled."""
        unfolding, topology = self.tracer.unfolding, self.tracer.mesh.topology
        if self.vertex >= 0:
            corner = np.argmax(self.tracer.mesh.faces[face] == self.vertex, axis=1)
            before = self.tracer.fans.angle_before[3 * face + corner]
            return before + _turn(unfolding.direction[face, corner], direction)
        angle = np.arctan2(direction[:, 1], direction[:, 0])
        other = np.flatnonzero(face != self.face)
        if len(other):  # the source lies on the side j across which the other face is unfolded
            j = int(NEXT[np.argmin(self.barycentric)])
            twin = int(topology.side_twin[self.face, j])
            own = unfolding.direction[self.face, j]
            turned = _turn(
                np.tile(unfolding.direction[twin // 3, twin % 3], (len(other), 1)), direction[other]
            )
            angle[other] = np.arctan2(own[1], own[0]) + np.pi + turned
        return angle


def _turn(e: NDArray, d: NDArray) -> NDArray[np.float64]:
    return np.arctan2(e[:, 0] * d[:, 1] - e[:, 1] * d[:, 0], e[:, 0] * d[:, 0] + e[:, 1] * d[:, 1])


def log_map(mesh: SurfaceMesh, exact: ExactDistance, sources: Sources, told: Told | None = None) -> LogMap:
    """Logarithmic map of one source at all vertices.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented.
    exact : ExactDistance
        Of that source on this mesh.
    sources : Sources
        One vertex or surface point.
    told : callable, optional
        `told(done, total)` hears how much of the length of all paths has been walked.

    Returns
    -------
    LogMap
    """
    tracer = Tracer(mesh)
    centre = _Centre(tracer, sources)
    angle = np.full(mesh.n_vertices, np.nan)
    reached = np.isfinite(exact.distance) & (exact.distance > 0)
    from_source = exact.origin_vertex == centre.vertex if centre.vertex >= 0 else exact.origin_vertex < 0
    miss = _walked_angles(
        tracer, centre, exact, np.flatnonzero(reached & from_source & (exact.side >= 0)), angle, told
    )
    _adjacent_angles(tracer, centre, np.flatnonzero(reached & from_source & (exact.side < 0)), angle)
    for _ in range(mesh.n_vertices):  # beyond a bend: the direction of the path to the bend
        open_ = np.flatnonzero(reached & ~from_source & np.isnan(angle))
        known = angle[exact.origin_vertex[open_]]
        if not len(open_) or np.isnan(known).all():
            break
        angle[open_] = known
    lost = np.flatnonzero(reached & np.isnan(angle))
    if len(lost):
        miss = max(miss, _angles_of_paths(tracer, centre, exact, sources, lost, angle))
    dark = reached & np.isnan(angle)
    angle = angle * centre.scale
    far = ~np.isfinite(exact.distance) | dark
    angle = np.where(far | (exact.distance == 0), 0.0, angle)
    distance = np.where(far, 0.0, exact.distance)
    mapped = np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1)
    mapped[far] = np.inf
    return LogMap(mapped, centre.axis(), miss, int(dark.sum()))


def _walked_angles(
    tracer: Tracer,
    centre: _Centre,
    exact: ExactDistance,
    vertex: NDArray,
    angle: NDArray,
    told: Told | None,
) -> float:
    """Angles at which lines walked back arrive (nan where one does not), and by how much they miss."""
    mesh = tracer.mesh
    if not len(vertex):
        return 0.0
    around = ~np.isnan(centre.seen_in(np.arange(mesh.n_faces))[:, 0])
    near = _SHORT * float(mesh.side_length[around].min())
    vertex = vertex[np.argsort(exact.distance[vertex], kind="stable")]  # side by side they share faces
    lines = trace_back(tracer, exact, vertex, shorten=near, told=told)
    seen = centre.seen_in(lines.face)
    rest = planar_difference(tracer.unfolding, lines.face, lines.barycentric, np.nan_to_num(seen))
    size = np.hypot(rest[:, 0], rest[:, 1])
    arrived = ~np.isnan(seen[:, 0]) & (np.abs(size - near) <= 1e-3 * near) & (lines.status == 0)
    angle[vertex[arrived]] = centre.angle(lines.face[arrived], -lines.direction[arrived])
    beside = rest[:, 0] * lines.direction[:, 1] - rest[:, 1] * lines.direction[:, 0]
    return float(np.abs(beside[arrived]).max(initial=0.0) / exact.distance[vertex].max())


def _adjacent_angles(tracer: Tracer, centre: _Centre, vertex: NDArray, angle: NDArray) -> None:
    """Angles of vertices that share a face with the source and are reached inside it."""
    mesh = tracer.mesh
    faces = np.flatnonzero(~np.isnan(centre.seen_in(np.arange(mesh.n_faces))[:, 0]))
    wanted = np.zeros(mesh.n_vertices, dtype=bool)
    wanted[vertex] = True
    for k in range(3):
        face = faces[wanted[mesh.faces[faces, k]]]
        v = mesh.faces[face, k]
        corner = np.tile(np.eye(3)[k], (len(face), 1))
        away = planar_difference(tracer.unfolding, face, centre.seen_in(face), corner)
        ok = np.hypot(away[:, 0], away[:, 1]) > 0
        angle[v[ok]] = centre.angle(face[ok], away[ok])


def _angles_of_paths(
    tracer: Tracer, centre: _Centre, exact: ExactDistance, sources: Sources, vertex: NDArray, angle: NDArray
) -> float:
    """The careful way, path by path: lines that graze saddles, and what lies behind those.

    Targets whose path is not known (`shortest_paths` gives none) stay without an angle. Returns the largest
    relative difference between the length of a path and the distance.
    """
    made = shortest_paths(tracer.mesh, exact, sources, vertex.tolist(), tracer)
    paths = made.paths
    step = segment_vectors(tracer.mesh, paths)
    long_ = np.flatnonzero(np.hypot(step[:, 0], step[:, 1]) > 0)
    drawn = np.diff(paths.start) > 0
    first = long_[np.searchsorted(long_, paths.start[:-1][drawn])]
    angle[vertex[drawn]] = centre.angle(paths.face[first], step[first])
    return float(made.accuracy["path_length_residual"])
