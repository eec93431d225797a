"""Triangulation of holes: a patch of new triangles, as large as those around it, for each boundary loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from ddgcli.errors import MeshError, ParameterError, counted
from ddgcli.geometry.extrinsic import dihedral_angle, folded_edges
from ddgcli.linalg.constrain import Dirichlet
from ddgcli.mesh.boundary import boundary_vertex_loops
from ddgcli.mesh.edge_lookup import edge_indices
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.require import require
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import uniform_stiffness

RIM_DISTANCE = 0.7  # of inner points of a patch from its rim, in units of their spacing
MAX_CHORD_ROUNDS = 4


def fill_loops(mesh: TriangleMesh, fill: int | str = "all") -> tuple[TriangleMesh, NDArray[np.bool_]]:
    """Close boundary loops of an oriented manifold with patches of new triangles.

    The loop is laid on a circle by its lengths, a triangular lattice with the spacing of the loop's vertices
    inside; the Delaunay triangles of both are the patch, and inner vertices lie at the means of their
    neighbours (a membrane).

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
    step = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    angle = 2.0 * np.pi * (np.cumsum(step) - step) / step.sum()
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    inner = _lattice(2.0 * np.pi / len(loop))
    for _ in range(MAX_CHORD_ROUNDS):
        flat = np.concatenate([circle, inner])
        try:
            simplices = Delaunay(flat, qhull_options="Qbb Qc Qz Qt").simplices
        except QhullError:  # vertices of an edge without length lie on one point of the circle
            raise _without_area(loop[::-1]) from None
        patch = _oriented(flat, simplices.astype(np.int64))
        chords = _chords(patch, len(loop))
        double = edge_indices(mesh.topology.edges, loop[chords]) >= 0
        if not double.any():
            break
        # an edge of the mesh already joins the ends of such a chord: a vertex goes between
        inner = np.concatenate([inner, flat[chords[double]].mean(axis=1)])
    else:
        raise MeshError("a boundary loop is too narrow to be filled; subdivide the surface")
    return _membrane(ring, patch, len(inner)), patch


def _lattice(spacing: float) -> NDArray[np.float64]:
    """(k, 2) points of a triangular lattice in the unit disc, away from its rim."""
    reach = int(np.ceil(2.0 / spacing)) + 1
    i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    points = spacing * np.stack([i + 0.5 * j, np.sqrt(0.75) * j], axis=-1).reshape(-1, 2)
    return points[np.hypot(*points.T) < 1.0 - RIM_DISTANCE * spacing]


def _oriented(flat: NDArray, faces: NDArray) -> NDArray[np.int64]:
    """Faces counter-clockwise, without those of no area."""
    a, b, c = (flat[faces[:, k]] for k in range(3))
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    faces = np.where((doubled < 0)[:, None], faces[:, ::-1], faces)
    return faces[np.abs(doubled) > 1e-14]


def _chords(patch: NDArray, count: int) -> NDArray[np.int64]:
    """(k, 2) edges of a patch between vertices of its loop that are not neighbours on it."""
    edges = np.sort(np.concatenate([patch[:, [0, 1]], patch[:, [1, 2]], patch[:, [2, 0]]]), axis=1)
    apart = edges[:, 1] - edges[:, 0]
    return np.unique(edges[(edges[:, 1] < count) & (apart > 1) & (apart < count - 1)], axis=0)


def _membrane(ring: NDArray, patch: NDArray, n_inner: int) -> NDArray[np.float64]:
    """(n_inner, 3) points at the means of their neighbours, within a ring."""
    if not n_inner:
        return np.zeros((0, 3))
    n, n_ring = len(ring) + n_inner, len(ring)
    surface = TriangleMesh(np.concatenate([ring, np.zeros((n_inner, 3))]), Topology(patch, n))
    return Dirichlet(uniform_stiffness(surface), np.arange(n_ring)).solve(ring)[n_ring:]
