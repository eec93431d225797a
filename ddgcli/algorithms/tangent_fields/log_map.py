"""Logarithmic map: direction and distance of every vertex from a source.

Distance and direction are those of the exact shortest path on the polyhedron: the windows of the distance
also store their rotation against the source. No equation is solved, so the map has no smoothing error. It
jumps across the cut locus, as the true map does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.exact_distance import ExactDistance, exact_distance
from ddgcli.algorithms.geodesics.shortest_paths import last_segment
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tracing.lines import LineStart
from ddgcli.algorithms.tracing.trace import END_STATUS, Tracer, Traces
from ddgcli.errors import ParameterError
from ddgcli.geometry.face_frames import planar_difference, relative_position
from ddgcli.geometry.unfolding import SurfaceMesh
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import vector_length
from ddgcli.progress import ProgressCallback

MAX_CHECKED_VERTICES = 250  # to which lines are traced from the source
VERTEX_TOLERANCE = 1e-9  # relative to a side; lines that pass a vertex more closely are not checked


@dataclass(frozen=True, eq=False)
class LogMap:
    """Directions and distances from one source.

    Parameters
    ----------
    log_map : (n, 2) ndarray of float64
        Coordinates in the tangent plane of the source: the norm is the distance, the angle that of the
        shortest path, counter-clockwise from the x axis. At a vertex surface angles are multiplied by
        2 pi / total angle; on the boundary they are unchanged. inf at unreached vertices.
    axis : dict
        The x axis: towards a vertex (`towards_vertex`) or along side 0 of a face (`face`), and in space.
    miss : float, optional
        Largest distance between a vertex and the end of the straightest line that leaves the source with the
        vertex's coordinates, relative to the largest distance; of at most 250 vertices without bends.
    skew : dict, optional
        Quantiles by area of |cos| of the angle between the gradients of distance and direction on faces.
    """

    log_map: NDArray[np.float64]
    axis: dict[str, Any]
    miss: float | None = None
    skew: dict[str, float] | None = None


def require_single_source(sources: Sources) -> None:
    """Raise an error if there are several sources.

    Parameters
    ----------
    sources : Sources

    Raises
    ------
    ParameterError
    """
    if len(sources) != 1:
        raise ParameterError(
            f"a tangent frame has exactly one source, not {len(sources)}", parameter="sources"
        )


class SourceFrame:
    """Tangent frame of a source: its x axis, and straightest lines from it."""

    def __init__(self, tracer: Tracer, sources: Sources) -> None:
        require_single_source(sources)
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
                        "no tangent plane there; use another source",
                        parameter="sources",
                    )
        if self.vertex >= 0:
            fans = tracer.fans
            own = np.flatnonzero(fans.vertex == self.vertex)
            if len(own) != 1:
                raise ParameterError(
                    f"vertex {self.vertex} joins {len(own)} fans of faces; use another source",
                    parameter="sources",
                )
            self.fan = int(own[0])
            self.first = int(fans.corner[fans.start[self.fan]])
            if not fans.is_open[self.fan]:
                self.scale = 2 * np.pi / float(fans.total_angle[self.fan])

    def axis(self) -> dict[str, Any]:
        """Description of the x axis."""
        mesh = self.tracer.mesh
        axis: dict[str, Any] = (
            {"towards_vertex": int(mesh.topology.side_head[self.first])}
            if self.vertex >= 0
            else {"face": self.face}
        )
        if isinstance(mesh, TriangleMesh):
            side = self.first if self.vertex >= 0 else 3 * self.face
            vector = mesh.side_vector.reshape(-1, 3)[side]
            axis["x_axis"] = (vector / (float(vector_length(vector)) or 1.0)).tolist()
        return axis

    def lines(self, angle: NDArray, length: NDArray) -> Traces:
        """Trace straightest lines from the source at unscaled angles."""
        k, unfolding = len(angle), self.tracer.unfolding
        if self.vertex < 0:
            face, barycentric = np.full(k, self.face), np.tile(self.barycentric, (k, 1))
            z = np.exp(1j * angle)
        else:
            fans = self.tracer.fans
            fan = np.full(k, self.fan)
            total = fans.total_angle[self.fan]
            angle = np.clip(angle, 0.0, total) if fans.is_open[self.fan] else angle % total
            corner = fans.locate(fan, angle)
            face, j = np.divmod(corner, 3)
            barycentric = np.eye(3)[j]
            z = unfolding.direction[face, j] @ [1, 1j] * np.exp(1j * (angle - fans.angle_before[corner]))
        return self.tracer.trace_checked(
            LineStart(face, barycentric, np.stack([z.real, z.imag], axis=1), length), record=True
        )


def log_map(
    mesh: SurfaceMesh, exact: ExactDistance, sources: Sources, progress: ProgressCallback | None = None
) -> LogMap:
    """Logarithmic map of one source at all vertices.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented.
    exact : ExactDistance
        Of that source on this mesh; recomputed if it has no directions.
    sources : Sources
        One vertex or surface point.
    progress : callable, optional
        Called with the number of final and of all vertices, if the distance is recomputed.

    Returns
    -------
    LogMap
    """
    source_frame = SourceFrame(Tracer(mesh), sources)
    if exact.departure is None:
        exact = exact_distance(mesh, sources, directions=True, progress=progress)
    departure = np.asarray(exact.departure)
    far, here = ~np.isfinite(exact.distance), exact.distance == 0
    angle = np.where(far | here, 0.0, departure * source_frame.scale)
    distance = np.where(far, 0.0, exact.distance)
    mapped = np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1)
    mapped[far] = np.inf
    return LogMap(mapped, source_frame.axis(), miss=_miss(source_frame, exact, departure))


def _miss(source_frame: SourceFrame, exact: ExactDistance, departure: NDArray) -> float:
    """Largest distance between traced lines and their vertices, relative to the largest distance.

    Lines are compared in the middle of their last face, where no vertex is near.
    """
    mesh, unfolding = source_frame.tracer.mesh, source_frame.tracer.unfolding
    straight = np.flatnonzero(np.isfinite(exact.distance) & (exact.side >= 0))
    straight = straight[exact.origin_vertex[straight] == source_frame.vertex]
    if not len(straight):
        return 0.0
    vertex = straight[
        np.linspace(0, len(straight) - 1, min(len(straight), MAX_CHECKED_VERTICES)).astype(np.int64)
    ]
    face, apex, crossing = last_segment(mesh, exact, vertex)
    middle, last = 0.5 * (apex + crossing), planar_difference(unfolding, face, crossing, apex)
    length = exact.distance[vertex] - 0.5 * np.hypot(last[:, 0], last[:, 1])
    lines = source_frame.lines(departure[vertex], length)
    gap = planar_difference(unfolding, face, middle, lines.barycentric)
    away = length  # in another face: an upper bound
    if mesh.points is not None:
        chord = relative_position(mesh, lines.face, lines.barycentric) - relative_position(mesh, face, middle)
        away = vector_length(chord)
    miss = np.where(lines.face == face, vector_length(gap), away)
    checked = ~_through_a_vertex(lines) & ~_stopped_at_three_faces(mesh, lines)
    return float(miss[checked].max(initial=0.0) / exact.distance[straight].max())


def _through_a_vertex(lines: Traces) -> NDArray[np.bool_]:
    """(k,) lines that pass a vertex."""
    at_vertex = lines.path_barycentric.max(axis=1) >= 1 - VERTEX_TOLERANCE
    at_vertex[lines.path_start[:-1]] = False
    owner = np.repeat(np.arange(len(lines.face)), np.diff(lines.path_start))
    return np.bincount(owner[at_vertex], minlength=len(lines.face)) > 0


def _stopped_at_three_faces(mesh: SurfaceMesh, lines: Traces) -> NDArray[np.bool_]:
    """(k,) lines that stopped at an edge of three or more faces, beyond which the path continues."""
    edge = mesh.topology.side_edge[lines.face, NEXT[np.argmin(lines.barycentric, axis=1)]]
    return (lines.status != END_STATUS) & (mesh.topology.edge_face_count[edge] > 2)
