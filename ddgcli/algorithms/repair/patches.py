"""Triangulation of holes: a patch of new triangles, as large as those around it, for each boundary loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ddgcli.algorithms.repair.polygon_triangulation import (
    NotAPolygonError,
    points_inside,
    polygon_triangles,
)
from ddgcli.errors import MeshError, ParameterError, counted
from ddgcli.geometry.extrinsic import dihedral_angle, folded_edges
from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.linalg.constrain import Dirichlet
from ddgcli.mesh.boundary import boundary_vertex_loops
from ddgcli.mesh.edge_lookup import edge_indices
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.require import require
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, tangents
from ddgcli.operators.laplacian import uniform_stiffness

RIM_DISTANCE = 0.7  # of inner points of a patch from its rim, in units of their spacing
RIM_SAMPLES = 4  # points of an edge of the rim from which inner points keep that distance
MAX_CHORD_ROUNDS = 4
GOOD_ANGLE = np.radians(120.0)  # of a patch, above which the other one is tried


def fill_loops(mesh: TriangleMesh, fill: int | str = "all") -> tuple[TriangleMesh, NDArray[np.bool_]]:
    """Close boundary loops of an oriented manifold with patches of new triangles.

    The loop is projected onto the plane in which it encloses the largest area, a triangular lattice with the
    spacing of the loop's vertices inside; the Delaunay triangles of both are the patch, and the height of an
    inner vertex is the mean of its neighbours' (a membrane). Where the projection crosses itself, or has
    angles above 120 degrees that the following has not, the loop is laid on a circle by its lengths instead,
    and the position of an inner vertex is the mean of its neighbours'.

    Parameters
    ----------
    mesh : TriangleMesh
        Oriented manifold with boundary.
    fill : int or 'all'
        Index of a vertex on the loop to close.

    Returns
    -------
    TriangleMesh
        Vertices and faces of the mesh first.
    (n,) ndarray of bool
        Whether a vertex is new.

    Raises
    ------
    MeshError, ParameterError
        When there is no such loop, or a loop encloses no area or bounds a flat piece.
    """
    if isinstance(fill, str) and fill != "all":
        raise ParameterError(
            f"{fill!r} is not a vertex index; name one on the loop, or all", parameter="fill"
        )
    require(mesh, "filling", manifold=True, oriented=True)
    loops = boundary_vertex_loops(mesh.topology)
    if not loops:
        raise MeshError("the surface is closed and has no boundary loop to fill; leave `fill` out")
    if fill != "all":
        loops = [vertices for vertices in loops if fill in vertices]
        if not loops:
            on_boundary = np.flatnonzero(mesh.topology.boundary_vertex)
            raise ParameterError(
                f"vertex {fill} is on no boundary loop (vertex {on_boundary[0]} is)", parameter="fill"
            )
    n, points, faces = mesh.n_vertices, [mesh.points], [mesh.faces]
    for vertices in loops:
        inner, patch = _patch(mesh, vertices[::-1])
        corners = np.concatenate([mesh.points[vertices[::-1]], inner])
        if len(TriangleMesh.from_arrays(corners, patch).flat_faces):
            raise _without_area(vertices)
        numbers = np.concatenate([vertices[::-1], sum(map(len, points)) + np.arange(len(inner))])
        points.append(inner)
        faces.append(numbers[patch])
    all_points = np.concatenate(points)
    closed = TriangleMesh(all_points, Topology(np.concatenate(faces), len(all_points)))
    _refuse_folded_patches(mesh, closed, loops)
    return closed, np.arange(len(all_points)) >= n


def _without_area(vertices: NDArray) -> MeshError:
    return MeshError(
        f"the boundary loop through vertex {vertices[0]} runs back along itself: its patch has faces "
        "without area; leave `fill` out, or name another loop by one of its vertices"
    )


def _refuse_folded_patches(mesh: TriangleMesh, closed: TriangleMesh, loops: list[NDArray]) -> None:
    """Raise MeshError for a loop at all of whose edges its patch folds back onto a flat surface."""
    folded = np.zeros(closed.n_vertices, dtype=np.int64)
    np.add.at(folded, closed.topology.edges[folded_edges(dihedral_angle(closed))].ravel(), 1)
    flat = [vertices for vertices in loops if (folded[vertices] > 1).all()]
    if not flat:
        return
    component = mesh.topology.vertex_component
    others = [vertices for vertices in loops if (folded[vertices] <= 1).any()]
    if not others:
        advice = "leave `fill` out"
    elif {component[v[0]] for v in others} & {component[v[0]] for v in flat}:
        advice = f"name another loop by one of its vertices, such as `fill={others[0][0]}`"
    else:
        advice = f"{remedy('components')}, then fill its loops"
    raise MeshError(
        f"{counted(len(flat), 'boundary loop bounds', 'boundary loops bound')} flat pieces, onto which "
        f"patches would fold (first: through vertex {flat[0][0]}); {advice}"
    )


def _patch(mesh: TriangleMesh, loop: NDArray) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(k, 3) inner points and (m, 3) faces, numbered from the loop's vertices on, for one loop."""
    ring = mesh.points[loop]
    on_plane = _plane_patch(mesh, loop)
    largest = np.inf if on_plane is None else _largest_angle(ring, *on_plane)
    if on_plane is not None and largest <= GOOD_ANGLE:
        return on_plane
    on_circle = _circle_patch(mesh, loop)
    return on_circle if on_plane is None or _largest_angle(ring, *on_circle) < largest else on_plane


def _largest_angle(ring: NDArray, inner: NDArray, patch: NDArray) -> float:
    points = np.concatenate([ring, inner])
    return float(corner_angle(TriangleMesh(points, Topology(patch, len(points))).side_length).max())


def _circle_patch(mesh: TriangleMesh, loop: NDArray) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Patch of a loop that is laid on a circle by its lengths."""
    ring = mesh.points[loop]
    step = _edge_lengths(ring)
    angle = 2.0 * np.pi * (np.cumsum(step) - step) / step.sum()
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    spacing = 2.0 * np.pi / len(loop)
    inner = _lattice(spacing)
    inner = inner[np.hypot(*inner.T) < 1.0 - RIM_DISTANCE * spacing]
    try:
        inner, patch = _triangulated(mesh, loop, circle, inner)
    except NotAPolygonError:  # vertices of an edge without length lie on one point of the circle
        raise _without_area(loop[::-1]) from None
    return _membrane(ring, patch, len(inner)), patch


def _plane_patch(mesh: TriangleMesh, loop: NDArray) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """Patch of a loop that is projected onto a plane; None where its edges cross, or leave no room.

    On a circle the corners of a jagged rim would be straight, and its patch would have needles there.
    """
    centre = mesh.points[loop].mean(axis=0)
    unit = float(np.linalg.norm(mesh.points[loop] - centre, axis=1).max())
    ring = (mesh.points[loop] - centre) / unit
    area = row_cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0, keepdims=True)
    size = float(np.linalg.norm(area))
    if size == 0.0:
        return None
    normal = area / size
    axes = np.stack(tangents(normal[0]))
    rim, spacing = ring @ axes.T, float(_edge_lengths(ring).mean())
    inner = _lattice(spacing)
    inner = inner[points_inside(rim, inner)]
    samples = rim + np.arange(RIM_SAMPLES)[:, None, None] / RIM_SAMPLES * (np.roll(rim, -1, axis=0) - rim)
    far = cKDTree(samples.reshape(-1, 2)).query(inner)[0] > RIM_DISTANCE * spacing
    try:
        inner, patch = _triangulated(mesh, loop, rim, inner[far])
    except (NotAPolygonError, MeshError):
        return None
    height = _membrane(ring @ normal.T, patch, len(inner))
    return centre + unit * (inner @ axes + height @ normal), patch


def _triangulated(
    mesh: TriangleMesh, loop: NDArray, rim: NDArray, inner: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(k, 2) inner points and (m, 3) Delaunay triangles within a counter-clockwise polygon of a loop."""
    for _ in range(MAX_CHORD_ROUNDS):
        patch = polygon_triangles(rim, inner)
        chords = _chords(patch, len(loop))
        double = edge_indices(mesh.topology.edges, loop[chords]) >= 0
        if not double.any():
            return inner, patch
        # an edge of the mesh already joins the ends of such a chord: a vertex goes between
        inner = np.concatenate([inner, np.concatenate([rim, inner])[chords[double]].mean(axis=1)])
    raise MeshError("a boundary loop is too narrow to be filled; subdivide the surface")


def _edge_lengths(ring: NDArray) -> NDArray[np.float64]:
    """(n,) lengths of the edges from a point of a ring to the next."""
    return np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)


def _lattice(spacing: float) -> NDArray[np.float64]:
    """(k, 2) points of a triangular lattice in the unit disc."""
    reach = int(np.ceil(2.0 / spacing)) + 1
    i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    points = spacing * np.stack([i + 0.5 * j, np.sqrt(0.75) * j], axis=-1).reshape(-1, 2)
    return points[np.hypot(*points.T) < 1.0]


def _chords(patch: NDArray, count: int) -> NDArray[np.int64]:
    """(k, 2) edges of a patch between vertices of its loop that are not neighbours on it."""
    edges = np.sort(np.concatenate([patch[:, [0, 1]], patch[:, [1, 2]], patch[:, [2, 0]]]), axis=1)
    apart = edges[:, 1] - edges[:, 0]
    return np.unique(edges[(edges[:, 1] < count) & (apart > 1) & (apart < count - 1)], axis=0)


def _membrane(values: NDArray, patch: NDArray, n_inner: int) -> NDArray[np.float64]:
    """(n_inner, k) means of their neighbours' values at inner points; (n, k) values on the ring."""
    if not n_inner:
        return np.zeros((0, values.shape[1]))
    n_ring = len(values)
    n = n_ring + n_inner
    surface = TriangleMesh(np.zeros((n, 3)), Topology(patch, n))
    return Dirichlet(uniform_stiffness(surface), np.arange(n_ring)).solve(values)[n_ring:]
