"""Straightest geodesics (the exponential map), thousands at once.

A straightest geodesic has equal surface angles on its left and right at every point: straight inside faces,
straight across an unfolded edge, halving the total angle at a vertex (Polthier and Schmies, "Straightest
Geodesics on Polyhedral Surfaces"). It exists and is unique for every start and direction.
"""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.algorithms.tracing.batch import AT_BOUNDARY, GAVE_UP, REACHED, SNAP, Start, Traces, Walk
from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.face_frames import to_face_frame, to_space
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.geometry.unfolding import APEX, Fans, Unfolding, unfold, vertex_fans
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.triangle_mesh import vector_length

__all__ = ["AT_BOUNDARY", "GAVE_UP", "REACHED", "Tracer", "Traces", "check_start", "trace"]

STATUS_TEXT = ("reached", "boundary", "gave up")
LINES_AT_ONCE = 16_384  # what belongs to so many lines stays in the cache
TELL_EVERY = 64  # crossings
ALONG = 1e-12  # of a unit direction: as much may point out of a face without area

_log = logging.getLogger("ddgcli")


class Tracer:
    """A mesh made ready for tracing; keep it where many calls walk on the same mesh.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented. Edges with three or more faces stop lines as the boundary does.

    Raises
    ------
    MeshError
        When the faces are not consistently oriented, or there are none.
    """

    def __init__(self, mesh: SurfaceMesh) -> None:
        topology = mesh.topology
        if topology.n_faces == 0:
            raise MeshError("no triangles; tracing needs a surface")
        if not topology.is_oriented:
            bad = topology.misoriented_edges
            a, b = topology.edges[bad[0]]
            raise MeshError(
                f"{len(bad)} edges join faces of opposite orientation (first: vertices {a}-{b}); "
                "tracing needs consistently oriented faces: turn those faces round"
            )
        self.mesh = mesh
        self.unfolding: Unfolding = unfold(mesh)

    @property
    def fans(self) -> Fans:
        """Angles around vertices; made when the first line meets a vertex."""
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
        max_crossings: int = 100_000,
        progress: ProgressCallback | None = None,
    ) -> Traces:
        """As the function `trace`; `progress(done, total)` hears how much length has been walked."""
        start = check_start(self.mesh, face, barycentric, direction, length)
        _refuse_flat_starts(self, start, np.atleast_2d(np.asarray(direction, dtype=np.float64)))
        if at_boundary not in ("stop", "reflect"):
            raise ParameterError(f"at_boundary must be 'stop' or 'reflect', found {at_boundary!r}")
        return self.walked(
            start, at_boundary=at_boundary, record=record, max_crossings=max_crossings, progress=progress
        )

    def walked(
        self, start: Start, *, at_boundary: str = "stop", record: bool = False, max_crossings: int = 100_000,
        progress: ProgressCallback | None = None,
    ) -> Traces:  # fmt: skip
        """As `trace`, from starts known to be right (unit directions in the frames of the faces)."""
        parts, done, total = [], 0.0, float(start.length.sum())
        for first in range(0, max(len(start.face), 1), LINES_AT_ONCE):
            some = start.part(first, first + LINES_AT_ONCE)
            walk = Walk(self.unfolding, lambda: self.fans, some, at_boundary == "reflect", record)
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                walk.begin()
                while len(walk.line) and walk.steps < max_crossings:
                    walk.advance(min(TELL_EVERY, max_crossings - walk.steps))
                    if progress is not None:
                        progress(min(done + walk.walked(), total), total)
                walk.finish()
                walk.abandon()
            parts.append(walk.result())
            done += float(some.length.sum())
        lines = Traces.joined(parts)
        stuck = np.flatnonzero(lines.status == GAVE_UP)
        if len(stuck):
            _log.warning(
                f"{len(stuck)} lines were given up (first: line {stuck[0]}) after {max_crossings} crossings "
                "or at a vertex without angles; they end short of their length"
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
    max_crossings: int = 100_000,
) -> Traces:
    """Walk straight on from points of a surface.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented. (`Tracer(mesh).trace` saves the set-up when called again.)
    face : (k,) array_like of int
    barycentric : (k, 3) array_like of float
        Start points: inside faces, on edges (one zero) or at vertices (two zeros).
    direction : (k, 3) or (k, 2) array_like of float
        In space (projected to the plane of the face) or in the planar frame of the face (corner 0 at the
        origin, corner 1 on +x, corner 2 above). Its size does not matter. At an edge or vertex a direction
        that leaves the face is continued into the neighbour, unfolded.
    length : (k,) array_like of float
        Not negative, in the mesh's length unit.
    at_boundary : {'stop', 'reflect'}
        Stop there, or go on as on the surface glued to its mirror image: reflected, as light is.
    record : bool
        Keep every crossing.
    max_crossings : int
        A line that has crossed so many sides and vertices is given up, with a warning.

    Returns
    -------
    Traces

    Raises
    ------
    MeshError, ParameterError
        On faces out of range, barycentric coordinates that do not sum to 1 or are negative, directions
        without a part in the plane, negative lengths; on starts within a face without area from which the
        direction leads out of the line that the face is.

    Notes
    -----
    A line that passes a vertex closer than 1e-12 of the side it crosses goes through that vertex. On which
    side a line passes a vertex of non-zero curvature changes its end by a finite amount: such lines are
    ill-conditioned, on the polyhedron itself.
    """
    return Tracer(mesh).trace(
        face, barycentric, direction, length,
        at_boundary=at_boundary, record=record, max_crossings=max_crossings,
    )  # fmt: skip


def _refuse_flat_starts(tracer: Tracer, start: Start, direction: NDArray) -> None:
    """A face without area has no plane: only directions along it lead anywhere.

    In its own frame a direction at a corner is one of the unfolded fan; in space it has no such meaning.
    """
    flat = np.flatnonzero(tracer.unfolding.side[3 * start.face, APEX].imag <= 0)
    if not len(flat):
        return
    if direction.shape[1] == 2:
        out = np.abs(start.direction[flat, 1]) > ALONG
        out &= (start.barycentric[flat] > SNAP).sum(axis=1) > 1
    else:
        given = np.broadcast_to(direction, (len(start.face), 3))[flat]
        along = to_space(tracer.mesh, start.face[flat], start.direction[flat])  # type: ignore[arg-type]
        out = vector_length(np.cross(given, along)) > ALONG * vector_length(given)
    if out.any():
        bad = flat[out][0]
        raise ParameterError(
            f"line {bad} starts in face {start.face[bad]}, which has no area, and leads out of it; "
            "start in the face beside it"
        )


def check_start(
    mesh: SurfaceMesh, face: ArrayLike, barycentric: ArrayLike, direction: ArrayLike, length: ArrayLike
) -> Start:
    """Arrays of the right shape and range, directions as unit vectors in the planar frame of the face."""
    points = SurfacePoints.checked(np.atleast_1d(face), np.atleast_2d(barycentric), mesh.n_faces)
    face, barycentric = points.face, points.barycentric
    k = len(face)
    if len(barycentric) != k:
        raise ParameterError(
            f"{k} faces but {len(barycentric)} barycentric coordinates; give one triple a face"
        )
    length = np.broadcast_to(np.asarray(length, dtype=np.float64), (k,))
    bad = np.flatnonzero(~(length >= 0) | ~np.isfinite(length))
    if len(bad):
        raise ParameterError(
            f"line {bad[0]} has length {length[bad[0]]:g}; lengths must be finite and not negative"
        )
    direction = np.atleast_2d(np.asarray(direction, dtype=np.float64))
    if direction.ndim != 2 or direction.shape[1] not in (2, 3) or len(direction) not in (1, k):
        raise ParameterError(f"directions must have shape ({k}, 3) or ({k}, 2), found {direction.shape}")
    direction = np.broadcast_to(direction, (k, direction.shape[1]))
    if not np.isfinite(direction).all():
        bad = np.flatnonzero(~np.isfinite(direction).all(axis=1))
        raise ParameterError(f"line {bad[0]} has a direction that is not finite; give three finite numbers")
    size = np.abs(direction).max(axis=1, initial=0.0)
    planar = direction / np.where(size > 0, size, 1.0)[:, None]
    if direction.shape[1] == 3:
        planar = to_face_frame(mesh, face, planar)
    norm = np.hypot(planar[:, 0], planar[:, 1])
    bad = np.flatnonzero((norm <= 1e-14) | (size == 0))
    if len(bad):
        raise ParameterError(
            f"line {bad[0]} has no direction within face {face[bad[0]]} "
            "(zero, across its plane, or a face without area); give a direction along the surface"
        )
    return Start(face, barycentric, np.ascontiguousarray(planar / norm[:, None]), length)
