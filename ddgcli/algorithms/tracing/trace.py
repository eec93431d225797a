"""Trace straightest geodesics (the exponential map) from many starting points at once.

A straightest geodesic has equal surface angles on its left and right at every point. It is straight inside
faces and across an unfolded edge, and it halves the total angle at a vertex (Polthier and Schmies,
"Straightest Geodesics on Polyhedral Surfaces"). It exists and is unique for every start and direction.
"""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.algorithms.tracing.batch import VERTEX_TOLERANCE, TraceBatch
from ddgcli.algorithms.tracing.lines import BOUNDARY_STATUS, END_STATUS, FAILURE_STATUS, LineStart, Traces
from ddgcli.choices import MAX_CROSSINGS, TRACE_BOUNDARIES
from ddgcli.errors import MeshError, ParameterError, counted, renamed_parameters
from ddgcli.geometry.face_frames import to_face_frame, to_space
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.geometry.unfolding import APEX, Fans, Unfolding, unfold, vertex_fans
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.require import refuse_repeated_vertices
from ddgcli.mesh.vectors import row_cross, vector_length
from ddgcli.progress import ProgressCallback

__all__ = [
    "BOUNDARY_STATUS", "END_STATUS", "FAILURE_STATUS", "Tracer", "Traces", "check_lengths", "check_start",
    "trace",
]  # fmt: skip

STATUS_TEXT = ("reached", "boundary", "gave up")
BATCH_SIZE = 16_384  # lines; their state fits in the cache
PROGRESS_INTERVAL = 64  # crossings between two calls of the progress callback
NORMAL_TOLERANCE = 1e-12  # largest component of a unit direction across the line of a face without area

_log = logging.getLogger("ddgcli")


class Tracer:
    """Tracer of straightest geodesics on one mesh. Its set-up is shared by all calls.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented. Edges with three or more faces stop lines as the boundary does.

    Raises
    ------
    MeshError
        When the faces are not consistently oriented, one names a vertex twice, or there are none.
    """

    def __init__(self, mesh: SurfaceMesh) -> None:
        topology = mesh.topology
        if topology.n_faces == 0:
            raise MeshError("no triangles; tracing needs a surface")
        refuse_repeated_vertices(mesh)  # their sides would end lines
        if not topology.is_oriented:
            bad = topology.misoriented_edges
            a, b = topology.edges[bad[0]]
            raise MeshError(
                f"{counted(len(bad), 'edge joins', 'edges join')} faces of opposite orientation "
                f"(first: vertices {a}-{b}); "
                f"tracing needs consistently oriented faces: {remedy('orientation')}"
            )
        self.mesh = mesh
        self.unfolding: Unfolding = unfold(mesh)

    @property
    def fans(self) -> Fans:
        """Angles around vertices; computed when the first line meets a vertex."""
        return vertex_fans(self.mesh)

    def trace(
        self,
        face: ArrayLike,
        barycentric: ArrayLike,
        direction: ArrayLike,
        length: ArrayLike,
        *,
        at_boundary: str = "stop",
        record: bool = False,
        max_crossings: int = MAX_CROSSINGS,
        progress: ProgressCallback | None = None,
    ) -> Traces:
        """Trace lines as the function `trace` does; `progress` is called with the traced and the total
        length."""
        start = self.checked_start(face, barycentric, direction, length)
        if at_boundary not in TRACE_BOUNDARIES:
            raise ParameterError(
                f"must be {' or '.join(TRACE_BOUNDARIES)}, not {at_boundary!r}", parameter="at_boundary"
            )
        return self.trace_checked(
            start, at_boundary=at_boundary, record=record, max_crossings=max_crossings, progress=progress
        )

    def checked_start(
        self, face: ArrayLike, barycentric: ArrayLike, direction: ArrayLike, length: ArrayLike
    ) -> LineStart:
        """Checked starts of lines, as the function `trace` takes them."""
        start = check_start(self.mesh, face, barycentric, direction, length)
        _refuse_flat_starts(self, start, np.atleast_2d(np.asarray(direction, dtype=np.float64)))
        return start

    def trace_checked(
        self, start: LineStart, *, at_boundary: str = "stop", record: bool = False,
        max_crossings: int = MAX_CROSSINGS,
        progress: ProgressCallback | None = None,
    ) -> Traces:  # fmt: skip
        """Trace lines from checked starts (unit directions in the planar frames of the faces)."""
        batches, finished_length, total = [], 0.0, float(start.length.sum())
        is_idle = False
        for first in range(0, max(len(start.face), 1), BATCH_SIZE):
            starts = start.subset(first, first + BATCH_SIZE)
            batch = TraceBatch(self.unfolding, lambda: self.fans, starts, at_boundary == "reflect", record)
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                batch.begin()
                # a line that crosses all these sides without growing longer is among sides without length
                max_idle_crossings, traced, since = PROGRESS_INTERVAL + len(batch.length), -1.0, 0
                while len(batch.line) and batch.steps < max_crossings:
                    if batch.traced_length() > traced:
                        traced, since = batch.traced_length(), batch.steps
                    elif batch.steps - since > max_idle_crossings:
                        is_idle = True
                        break
                    batch.advance(min(PROGRESS_INTERVAL, max_crossings - batch.steps))
                    if progress is not None:
                        progress(min(finished_length + batch.traced_length(), total), total)
                batch.finish()
                batch.abandon()
            batches.append(batch.result())
            finished_length += float(starts.length.sum())
        lines = Traces.concatenate(batches)
        abandoned = np.flatnonzero(lines.status == FAILURE_STATUS)
        if len(abandoned):
            where = ", among sides without length or at a vertex without angles" if is_idle else ""
            lines_text = f"{counted(len(abandoned), 'line', 'lines')} (first: line {abandoned[0]})"
            _log.warning(
                f"{lines_text} stopped short of the length, after {max_crossings} crossings{where}; give "
                "shorter lengths"
            )
        return lines


def trace(
    mesh: SurfaceMesh,
    face: ArrayLike,
    barycentric: ArrayLike,
    direction: ArrayLike,
    length: ArrayLike,
    *,
    at_boundary: str = "stop",
    record: bool = False,
    max_crossings: int = MAX_CROSSINGS,
) -> Traces:
    """Trace straightest geodesics from many starting points.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented. For repeated calls, `Tracer(mesh).trace` computes the set-up once.
    face : (k,) array_like of int
    barycentric : (k, 3) array_like of float
        LineStart points: inside faces, on edges (one zero) or at vertices (two zeros).
    direction : (k, 3) or (k, 2) array_like of float
        In space (projected to the plane of the face) or in the planar frame of the face (corner 0 at the
        origin, corner 1 on +x, corner 2 above). Its length is ignored. At an edge or vertex, a direction
        that leaves the face continues into the unfolded neighbour.
    length : (k,) array_like of float
        Non-negative, in the mesh's length unit.
    at_boundary : {'stop', 'reflect'}
        Stop at the boundary, or reflect there (as on the surface glued to its mirror image).
    record : bool
        Record the points where lines cross sides.
    max_crossings : int
        A line that has crossed this many sides and vertices is abandoned, with a warning.

    Returns
    -------
    Traces

    Raises
    ------
    MeshError, ParameterError
        A face is out of range, barycentric coordinates are negative or do not sum to 1, a direction has no
        component in the plane of its face, a length is negative, or a direction leads out of a face without
        area.

    Notes
    -----
    A line that passes a vertex closer than 1e-12 of the side it crosses goes through that vertex. Lines that
    pass a vertex of non-zero curvature closely are ill-conditioned on the polyhedron itself: their end
    depends on the side on which they pass it.
    """
    return Tracer(mesh).trace(
        face, barycentric, direction, length,
        at_boundary=at_boundary, record=record, max_crossings=max_crossings,
    )  # fmt: skip


def check_lengths(
    mesh: SurfaceMesh,
    face: NDArray,
    length: NDArray,
    at_boundary: str = "stop",
) -> None:
    """Raise an error for lines that nothing ends before they are abandoned.

    No line is longer between two sides than the longest of them.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    face : (k,) ndarray of int64
        In which the lines start.
    length : (k,) ndarray of float64
    at_boundary : {'stop', 'reflect'}

    Raises
    ------
    ParameterError
    """
    most = MAX_CROSSINGS * float(mesh.side_length.max())
    too_long = length > most
    if not too_long.any():
        return
    topology = mesh.topology
    if at_boundary == "stop":  # there, and at edges of three faces
        ends = np.concatenate([topology.boundary_edges, topology.nonmanifold_edges])
        is_open = np.zeros(topology.n_components, dtype=bool)
        is_open[topology.vertex_component[topology.edges[ends, 0]]] = True
        too_long &= ~is_open[topology.vertex_component[mesh.faces[face, 0]]]
    if too_long.any():
        bad = int(np.argmax(too_long))
        raise ParameterError(
            f"line {bad} has length {length[bad]:g}, but a line ends after {MAX_CROSSINGS:,} crossings, here "
            f"after a length of {most:.3g} at most; give a shorter length",
            parameter="length",
        )


def _refuse_flat_starts(tracer: Tracer, start: LineStart, direction: NDArray) -> None:
    """Raise ParameterError for directions that lead out of a face without area: it has no plane.

    A planar direction at a corner is a direction of the unfolded fan and is allowed.
    """
    flat = np.flatnonzero(tracer.unfolding.side[3 * start.face, APEX].imag <= 0)
    if not len(flat):
        return
    if direction.shape[1] == 2:
        leaves = np.abs(start.direction[flat, 1]) > NORMAL_TOLERANCE
        leaves &= (start.barycentric[flat] > VERTEX_TOLERANCE).sum(axis=1) > 1
    else:
        in_space = np.broadcast_to(direction, (len(start.face), 3))[flat]
        along = to_space(tracer.mesh, start.face[flat], start.direction[flat])  # type: ignore[arg-type]
        leaves = vector_length(row_cross(in_space, along)) > NORMAL_TOLERANCE * vector_length(in_space)
    if leaves.any():
        bad = flat[leaves][0]
        raise ParameterError(
            f"line {bad} starts in face {start.face[bad]}, which has no area, and leads out of it; "
            "start in a neighbouring face",
            parameter="direction",
        )


def check_start(
    mesh: SurfaceMesh, face: ArrayLike, barycentric: ArrayLike, direction: ArrayLike, length: ArrayLike
) -> LineStart:
    """Check start points, directions and lengths; directions become unit vectors in the frames of the
    faces."""
    points = SurfacePoints.checked(np.atleast_1d(face), np.atleast_2d(barycentric), mesh.n_faces)
    face, barycentric = points.face, points.barycentric
    k = len(face)
    if len(barycentric) != k:
        raise ParameterError(
            f"{k} faces but {len(barycentric)} barycentric coordinates; give one triple per face",
            parameter="barycentric",
        )
    length = np.broadcast_to(np.asarray(length, dtype=np.float64), (k,))
    bad = np.flatnonzero(~(length >= 0) | ~np.isfinite(length))
    if len(bad):
        raise ParameterError(
            f"line {bad[0]} has length {length[bad[0]]:g}; lengths must be finite and not negative",
            parameter="length",
        )
    direction = np.atleast_2d(np.asarray(direction, dtype=np.float64))
    if direction.ndim != 2 or direction.shape[1] not in (2, 3) or len(direction) not in (1, k):
        raise ParameterError(
            f"must have shape ({k}, 3) or ({k}, 2), not {direction.shape}", parameter="direction"
        )
    direction = np.broadcast_to(direction, (k, direction.shape[1]))
    if not np.isfinite(direction).all():
        bad = np.flatnonzero(~np.isfinite(direction).all(axis=1))
        raise ParameterError(
            f"line {bad[0]} has a direction that is not finite; give three finite numbers",
            parameter="direction",
        )
    size = np.abs(direction).max(axis=1, initial=0.0)
    planar = direction / np.where(size > 0, size, 1.0)[:, None]
    if direction.shape[1] == 3:
        with renamed_parameters(vector="direction"):
            planar = to_face_frame(mesh, face, planar)
    norm = np.hypot(planar[:, 0], planar[:, 1])
    bad = np.flatnonzero((norm <= 1e-14) | (size == 0))
    if len(bad):
        raise ParameterError(
            f"line {bad[0]} has no direction within face {face[bad[0]]} "
            "(zero, across its plane, or a face without area); give a direction along the surface",
            parameter="direction",
        )
    return LineStart(face, barycentric, np.ascontiguousarray(planar / norm[:, None]), length)
