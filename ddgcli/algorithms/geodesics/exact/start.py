"""Start of a wavefront at vertices and points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.tables import WindowTables
from ddgcli.algorithms.geodesics.exact.targets import WindowTargets
from ddgcli.algorithms.geodesics.exact.wavefront import Wavefront
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.geometry.unfolding import vertex_fans
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.topology import PREVIOUS


def start_wavefront(
    mesh: SurfaceMesh,
    sources: Sources,
    points: SurfacePoints,
    tables: WindowTables,
    dominance_every: int,
    directions: bool,
    *,
    slack: float,
    max_crossings: int = 0,
    max_rounds: float = np.inf,
) -> tuple[Wavefront, WindowTargets]:
    """Create a wavefront that has left the sources, and its targets.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources
        Of which the vertices and the points start windows.
    points : SurfacePoints
        Targets.
    tables : WindowTables
    dominance_every : int
    directions : bool
        As for `exact_distance`.
    slack : float
        The tolerance, in side lengths.
    max_crossings : int
        Faces that a window may cross; 0: any number.
    max_rounds : float
        After which the wavefront raises SolveError.

    Returns
    -------
    wavefront : Wavefront
    targets : WindowTargets
    """
    targets = WindowTargets(tables, points)
    wavefront = Wavefront(
        tables, slack=slack, dominance_every=dominance_every,
        targets=targets if len(points) else None, directions=directions,
        max_crossings=max_crossings, max_rounds=max_rounds,
    )  # fmt: skip
    _start(wavefront, mesh, sources)
    return wavefront, targets


def _start(wavefront: Wavefront, mesh: SurfaceMesh, sources: Sources) -> None:
    """Launch every source; a point at a corner of its face is that vertex."""
    vertices, indices = [sources.vertex], [np.arange(len(sources.vertex))]
    for values_by_kind, of_curves in zip((vertices, indices), sources.curve_vertices(mesh)):
        values_by_kind.append(of_curves)
    inner = []
    for i, (face, weights) in enumerate(zip(sources.points.face, sources.points.barycentric)):
        source = len(sources.vertex) + i
        if weights.max() >= 1 - 1e-14:
            vertices.append(mesh.faces[face, [np.argmax(weights)]])
            indices.append(np.array([source]))
        else:
            inner.append((source, int(face), weights))
    vertex, index = np.concatenate(vertices), np.concatenate(indices)
    vertex, first = np.unique(vertex, return_index=True)
    if len(vertex):
        begin = None
        if wavefront.side_turn is not None:
            begin = vertex_fans(mesh).angle_before.reshape(-1, 3)[:, PREVIOUS].ravel()
        wavefront.start_vertex(vertex, index[first], begin)
    for index_of, inside, at in inner:
        _start_point(wavefront, index_of, inside, at)


def _start_point(wavefront: Wavefront, source: int, face: int, weights: NDArray) -> None:
    """Launch a source inside a face, or on a side and so in all faces of that edge."""
    tables = wavefront.tables
    origin = wavefront.origins.add(np.array([-1]), np.array([source]), np.zeros(1))
    own = _side_angles(tables, face)
    triangles = [(face, weights, own)]
    for j in np.flatnonzero(weights[[2, 0, 1]] <= 1e-14):  # side j is opposite corner j + 2
        for other, same_way in tables.across(3 * face + int(j)):
            g, i = divmod(other, 3)
            tail, head = weights[j], weights[(j + 1) % 3]
            mirrored = np.zeros(3)
            mirrored[i], mirrored[(i + 1) % 3] = (tail, head) if same_way else (head, tail)
            its = _side_angles(tables, g)
            triangles.append((g, mirrored, its + (own[j] + np.pi - its[i])))
    for g, w, along in triangles:
        if wavefront.targets is not None:
            wavefront.targets.update_from_point(g, w, int(origin[0]))
        side = 3 * g + np.arange(3)
        length, ax, ay = tables.shape[side, :3].T
        apex = w[[2, 0, 1]]
        x, y = w[[1, 2, 0]] * length + apex * ax, apex * ay
        wavefront.improve(
            tables.ids[side, 0],
            np.hypot(x, y),
            np.repeat(origin, 3),
            departure=along + np.arctan2(-y, -x),
        )
        wavefront.launch(side, x, y, np.repeat(origin, 3), turn=along - np.pi)


def _side_angles(tables: WindowTables, face: int) -> NDArray[np.float64]:
    """(3,) directions of the sides of a face, in the frame of side 0."""
    length, x, y = tables.shape[3 * face, :3]
    return np.array([0.0, np.pi - np.arctan2(y, length - x), np.pi + np.arctan2(y, x)])
