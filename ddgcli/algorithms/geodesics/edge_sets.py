"""Edge sets of a surface: from arrays of vertex pairs, from marks on elements, from the boundary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError, ParameterError
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.edge_lookup import edge_indices
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.midpoint_subdivision import MidpointSubdivision
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.triangle_mesh import TriangleMesh

POINT_TOLERANCE = 1e-6  # between points of a curve and vertices, relative to the longest side of the mesh


@dataclass(frozen=True, eq=False)
class EdgeSet:
    """Edges of a mesh with directions.

    Parameters
    ----------
    edge : (k,) ndarray of int64
        Rows of `topology.edges`, without repetition.
    sign : (k,) ndarray of int64
        +1 where the direction is from the lower to the higher vertex, -1 against it, 0 where there is none.
    """

    edge: NDArray[np.int64]
    sign: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.edge)

    def curves(self, mesh: SurfaceMesh) -> NDArray[np.int64]:
        """(k,) index of the connected curve of each edge, in the order of the lowest vertices."""
        ends = mesh.topology.edges[self.edge]
        vertex, local = np.unique(ends, return_inverse=True)
        i, j = local.reshape(-1, 2).T
        return connected_labels(i, j, len(vertex))[1][i]

    def is_closed(self, mesh: SurfaceMesh) -> bool:
        """Whether an even number of edges meets at every vertex: no curve has an end."""
        ends = mesh.topology.edges[self.edge]
        return bool((np.bincount(ends.ravel()) % 2 == 0).all())


def edge_set(mesh: SurfaceMesh, array: NDArray, place: str = "", *, parameter: str | None = None) -> EdgeSet:
    """Edge set of an array.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    array : ndarray
        (k, 2) vertex pairs, each an edge of the mesh, directed from the first to the second; or marks that
        are not zero on chosen edges (the sign is the direction), or on vertices or faces.
        Marked vertices stand for the edges between them, labels of faces for the edges between faces of
        different labels, with the higher label on the left.
    place : {'edge', 'vertex', 'face', 'pairs', ''}
        Elements of the array; empty: by the shape and length.
    parameter : str, optional
        Named in errors.

    Returns
    -------
    EdgeSet

    Raises
    ------
    ParameterError
        When the array fits no elements, a pair is not an edge, or the set is empty.
    MeshError
        For a mesh without edges.
    """
    array = np.asarray(array)
    topology = mesh.topology
    if topology.n_edges == 0:
        raise MeshError("no triangles; edges on a surface need a surface")
    if array.ndim == 2 and array.shape[1] == 2 and place in ("", "pairs"):
        edges = _of_pairs(mesh, array, parameter)
    else:
        if array.ndim == 2 and array.shape[1] == 1:
            array = array[:, 0]
        sizes = {"edge": topology.n_edges, "vertex": mesh.n_vertices, "face": mesh.n_faces}
        place = place or next((name for name, size in sizes.items() if array.shape == (size,)), "")
        if array.shape != (sizes.get(place, -1),):
            raise ParameterError(
                f"the array of shape {array.shape} is neither (k, 2) vertex pairs nor one value for each of "
                f"{topology.n_edges} edges, {mesh.n_vertices} vertices or {mesh.n_faces} faces; give "
                "one of these",
                parameter=parameter,
            )
        edges = _of_marks(mesh, array, place)
    if not len(edges):
        raise ParameterError("the set has no edge; mark at least one", parameter=parameter)
    return edges


def _of_pairs(mesh: SurfaceMesh, pairs: NDArray, parameter: str | None) -> EdgeSet:
    """Edges of directed vertex pairs; a pair in both directions has none."""
    pairs = pairs.astype(np.float64)
    whole = (pairs == np.floor(pairs)) & (pairs >= 0) & (pairs < mesh.n_vertices)
    bad = np.flatnonzero(~whole.all(axis=1))
    if len(bad):
        raise ParameterError(
            f"row {bad[0]} ({pairs[bad[0], 0]:g}, {pairs[bad[0], 1]:g}) is not a pair of vertices "
            f"0..{mesh.n_vertices - 1}",
            parameter=parameter,
        )
    ends = pairs.astype(np.int64)
    edges, (i, j) = mesh.topology.edges, ends.T
    edge = edge_indices(edges, ends)
    missing = np.flatnonzero(edge < 0)
    if len(missing):
        row = missing[0]
        raise ParameterError(
            f"row {row}: vertices {i[row]} and {j[row]} are not joined by an edge; list the edges one by one",
            parameter=parameter,
        )
    direction = np.where(edges[edge, 0] == i, 1, -1)
    unique, of = np.unique(edge, return_inverse=True)
    return EdgeSet(unique, np.sign(np.bincount(of, direction)).astype(np.int64))


def _of_marks(mesh: SurfaceMesh, marks: NDArray, place: str) -> EdgeSet:
    """Edges that marks on edges, vertices or faces choose."""
    topology = mesh.topology
    if place == "edge":
        edge = np.flatnonzero(marks)
        directed = bool((marks < 0).any())  # marks without signs have no directions
        return EdgeSet(edge, np.sign(marks[edge]).astype(np.int64) * directed)
    if place == "vertex":
        edge = np.flatnonzero((marks[topology.edges] != 0).all(axis=1))
        return EdgeSet(edge, np.zeros(len(edge), dtype=np.int64))
    side = topology.interior_sides
    label, across = marks[side // 3], marks[topology.side_twin.ravel()[side] // 3]
    border_side = side[label != across]
    edge, first = np.unique(topology.side_edge.ravel()[border_side], return_index=True)
    along = topology.side_sign.ravel()[border_side[first]].astype(np.int64)
    higher = label[label != across][first] > across[label != across][first]
    return EdgeSet(edge, np.where(higher, along, -along))


def subdivided_edge_set(edges: EdgeSet, mesh: TriangleMesh, subdivision: MidpointSubdivision) -> EdgeSet:
    """The same curves on a subdivided mesh.

    Parameters
    ----------
    edges : EdgeSet
        Edges of `mesh`.
    mesh : TriangleMesh
    subdivision : MidpointSubdivision
        Subdivision of `mesh`.

    Returns
    -------
    EdgeSet
        Edges of `subdivision.mesh`.
    """
    pairs, row = subdivision.edge_pieces(mesh.topology.edges[edges.edge])
    pieces = edge_indices(subdivision.mesh.topology.edges, pairs)
    along = np.where(pairs[:, 0] < pairs[:, 1], 1, -1)
    order = np.argsort(pieces)
    return EdgeSet(pieces[order], (along * edges.sign[row])[order])


def joined_curves(mesh: SurfaceMesh, sets: Sequence[EdgeSet]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Edges of several sets in turn, and the curve of each.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sets : sequence of EdgeSet
        Connected edges of a set are one curve.

    Returns
    -------
    edge, curve : (k,) ndarray of int64
    """
    edges, curves, count = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)], 0
    for edge_set in sets:
        curve = edge_set.curves(mesh)
        edges.append(edge_set.edge)
        curves.append(curve + count)
        count += int(curve.max(initial=-1)) + 1
    return np.concatenate(edges), np.concatenate(curves)


def boundary_set(mesh: SurfaceMesh) -> EdgeSet:
    """Boundary edges, directed with the surface on their left.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    EdgeSet

    Raises
    ------
    MeshError
        When the surface is closed.
    """
    topology = mesh.topology
    side = np.flatnonzero(topology.side_twin.ravel() < 0)
    side = side[topology.edge_face_count[topology.side_edge.ravel()[side]] == 1]
    if not len(side):
        raise MeshError("the surface is closed: it has no boundary; name other sources")
    edge, first = np.unique(topology.side_edge.ravel()[side], return_index=True)
    return EdgeSet(edge, topology.side_sign.ravel()[side[first]].astype(np.int64))


def curve_pairs(mesh: TriangleMesh, points: NDArray, lines: NDArray) -> NDArray[np.int64]:
    """Vertices of the mesh at the ends of the segments of curves in space.

    Parameters
    ----------
    mesh : TriangleMesh
    points : (p, 3) ndarray of float64
        Points of the curves.
    lines : (k, 2) ndarray of int64
        Points at the ends of each segment.

    Returns
    -------
    (k', 2) ndarray of int64
        Without segments both of whose ends are at the same vertex.

    Raises
    ------
    ParameterError
        For the first end that is at no vertex.
    """
    from scipy.spatial import cKDTree

    gap, vertex = cKDTree(mesh.points).query(points)
    longest = float(mesh.side_length.max(initial=0.0))
    ends = unique_keys(lines)
    far = ends[gap[ends] > POINT_TOLERANCE * longest]
    if len(far):
        point = far[0]
        raise ParameterError(
            f"point {point} of the curve is {gap[point]:.3g} from the nearest vertex; curves follow "
            "edges of the "
            "mesh: snap them to vertices, or insert their points into the mesh"
        )
    pairs = vertex[lines]
    return pairs[pairs[:, 0] != pairs[:, 1]]
