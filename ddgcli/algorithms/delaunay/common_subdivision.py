"""The common subdivision of an input surface and an intrinsic triangulation of it, as an ordinary mesh.

Integers alone (`normal_coordinates`) determine which edges cross, and in which order; unfolding the strip of
input faces under each intrinsic edge gives the positions of the crossings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array

from ddgcli.algorithms.delaunay.normal_coordinates import (
    BLOCK_SIZE,
    STEP_BITS,
    BaseEdges,
    Crossings,
    base_edges_of,
    crossings_of,
)
from ddgcli.algorithms.delaunay.overlay_lines import in_order, lines_over
from ddgcli.algorithms.delaunay.overlay_pieces import Labels, Names, cut_faces
from ddgcli.algorithms.delaunay.triangulation import IntrinsicDelaunay
from ddgcli.errors import MeshError, SolveError
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.topology import Topology, sorted_sides
from ddgcli.mesh.triangle_mesh import TriangleMesh

PlaceLines = Callable[[TriangleMesh, NDArray, NDArray, NDArray], tuple[NDArray, NDArray, float]]
INPUT_VERTEX, STEINER_POINT, CROSSING = 0, 1, 2


@dataclass(frozen=True, eq=False)
class BaseTriangulation:
    """The triangulation that normal coordinates refer to: the input with Steiner points inserted.

    Parameters
    ----------
    input : TriangleMesh
    mesh : TriangleMesh
        Its first vertices are the input's; every face lies in one input face.
    input_face : (m,) ndarray of int64
        Input face that holds each face.
    interpolation : (n, n_input) sparse array
        Values at its vertices from values at the input's.
    """

    input: TriangleMesh
    mesh: TriangleMesh
    input_face: NDArray[np.int64]
    interpolation: csr_array

    @classmethod
    def itself(cls, mesh: TriangleMesh) -> BaseTriangulation:
        """The input without Steiner points."""
        return cls(mesh, mesh, np.arange(mesh.n_faces), csr_array(eye_array(mesh.n_vertices)))

    @cached_property
    def beside(self) -> NDArray[np.int64]:
        """(3m, 2) input face that holds the face of a side, and the one beyond (-1: the boundary)."""
        here = np.repeat(self.input_face, 3)
        twin = self.mesh.topology.side_twin.ravel()
        return np.stack([here, np.where(twin < 0, -1, here.take(twin, mode="wrap"))], axis=1)

    @cached_property
    def real_side(self) -> NDArray[np.bool_]:
        """(3m,) True at sides that lie on input edges."""
        return self.beside[:, 0] != self.beside[:, 1]


@dataclass(frozen=True, eq=False)
class CommonSubdivision:
    """The surface cut along the edges of both triangulations.

    Parameters
    ----------
    input : TriangleMesh
    intrinsic : IntrinsicMesh
    mesh : TriangleMesh
        Input vertices first, then Steiner points, then crossings; convex pieces cut into fans.
    input_face, intrinsic_face : (t,) ndarray of int64
        Face of either triangulation that holds each triangle.
    vertex_kind : (v,) ndarray of int64
        0 input vertex, 1 Steiner point, 2 crossing of an input edge with an intrinsic edge.
    length_residual : float
        Largest difference between an intrinsic edge's length and that of its straight line over the input
        faces, relative to the length.
    crossings : CrossingPositions
        Positions of the crossings; properties are computed from them on demand.
    lifted : CommonSubdivision, optional
        For a one-sided surface, the subdivision of its double cover; `corner` and `half_side` are valid only
        there.
    """

    input: TriangleMesh
    intrinsic: IntrinsicMesh
    mesh: TriangleMesh
    input_face: NDArray[np.int64]
    intrinsic_face: NDArray[np.int64]
    vertex_kind: NDArray[np.int64]
    length_residual: float
    crossings: CrossingPositions
    lifted: CommonSubdivision | None = None

    @cached_property
    def from_input(self) -> csr_array:
        """(v, n) values at the vertices from those at the input's, linear on its faces."""
        return self.crossings.from_input()

    @cached_property
    def from_intrinsic(self) -> csr_array:
        """(v, n') values at the vertices from those at the intrinsic triangulation's, linear on its faces."""
        return self.crossings.from_intrinsic()

    @cached_property
    def corner(self) -> NDArray[np.int64]:
        """(t, 3) positions of each triangle's corners in its intrinsic face.

        The flat index 3f+k of a corner of the face, or 3m + h for half-crossing h.
        """
        n = len(self.crossings.halves.count)
        return cut_faces(self.crossings.halves, Names(np.arange(n), n, 0), self.crossings.labels).corner

    @cached_property
    def half_side(self) -> NDArray[np.int64]:
        """(c,) intrinsic side of each half-crossing."""
        side = self.crossings.side
        return np.stack([side, self.intrinsic.topology.side_twin.ravel()[side]], axis=1).ravel()

    @cached_property
    def half_along(self) -> NDArray[np.float64]:
        """(c,) share of the side's length at which a half-crossing lies, from the tail."""
        along = self.crossings.along
        return np.stack([along, 1.0 - along], axis=1).ravel()

    @cached_property
    def edge_start(self) -> NDArray[np.int64]:
        """(e + 1,) start of the vertices of each intrinsic edge (as `topology.edges`) in `edge_vertex`."""
        number = self.crossings.halves.count[self._first_side] + 2
        return list_starts(number)

    @cached_property
    def edge_vertex(self) -> NDArray[np.int64]:
        """Vertices along each intrinsic edge, from end to end."""
        topology, start = self.intrinsic.topology, self.edge_start
        chain = np.full(start[-1], -1, dtype=np.int64)
        chain[start[:-1]] = topology.side_tail[self._first_side]
        chain[start[1:] - 1] = topology.side_head[self._first_side]
        chain[chain < 0] = np.arange(self.crossings.n_before, self.mesh.n_vertices)
        return chain

    @property
    def _first_side(self) -> NDArray[np.int64]:
        """The first side of each intrinsic edge."""
        twin = self.intrinsic.topology.side_twin.ravel()
        return np.flatnonzero((twin < 0) | (np.arange(len(twin)) < twin))

    def curves(self) -> list[NDArray[np.float64]]:
        """Every intrinsic edge as a polyline (k, 3) on the input surface."""
        return np.split(self.mesh.points[self.edge_vertex], self.edge_start[1:-1])


@dataclass(frozen=True, eq=False)
class CrossingPositions:
    """The crossings of intrinsic edges with input edges, in the order of the intrinsic sides.

    Parameters
    ----------
    intrinsic : IntrinsicMesh
    base : BaseTriangulation
    halves : Crossings
    labels : Labels
        Labels of the crossings with input edges only.
    share, along : (x,) ndarray of float64
        Positions: shares of the lengths of the base side (`labels.crossed`) and of the intrinsic side, from
        their tails.
    """

    intrinsic: IntrinsicMesh
    base: BaseTriangulation
    halves: Crossings
    labels: Labels
    share: NDArray[np.float64]
    along: NDArray[np.float64]

    @property
    def n_before(self) -> int:
        """Vertices of the subdivision before the crossings."""
        return self.base.mesh.n_vertices

    @property
    def side(self) -> NDArray[np.int64]:
        """(x,) first side of each edge crossed."""
        return np.repeat(self.halves.side, self.halves.count[self.halves.side])

    def points(self) -> NDArray[np.float64]:
        """(v, 3) vertices of the subdivision: those of the base, then the crossings."""
        topology, corners = self.base.mesh.topology, self.base.mesh.points
        points = np.empty((self.n_before + len(self.share), 3))
        points[: self.n_before] = corners
        for begin in range(0, len(self.share), BLOCK_SIZE):
            block = slice(begin, begin + BLOCK_SIZE)
            side = self.labels.crossed[block]
            tail = corners.take(topology.side_tail.take(side), axis=0)
            along = corners.take(topology.side_head.take(side), axis=0)
            along -= tail
            along *= self.share[block, None]
            at = self.n_before + begin
            np.add(tail, along, out=points[at : at + len(side)])
        return points

    def kind(self) -> NDArray[np.int64]:
        """(v,) kinds of the vertices."""
        n_input = self.base.input.n_vertices
        counts = [n_input, self.n_before - n_input, len(self.share)]
        return np.repeat([INPUT_VERTEX, STEINER_POINT, CROSSING], counts)

    def from_input(self) -> csr_array:
        """Values at the vertices from those at the input's: crossings lie on edges between input vertices."""
        topology = self.base.mesh.topology
        return _followed(
            self.base.interpolation, topology.side_tail, topology.side_head, self.labels.crossed, self.share
        )

    def from_intrinsic(self) -> csr_array:
        """Values at the vertices from those at the intrinsic triangulation's."""
        topology = self.intrinsic.topology
        vertices = csr_array(eye_array(topology.n_vertices))
        return _followed(vertices, topology.side_tail, topology.side_head, self.side, self.along)


def common_subdivision(
    flipped: IntrinsicDelaunay, base: BaseTriangulation, *, place_lines: PlaceLines = lines_over
) -> CommonSubdivision:
    """The common subdivision of an input and its intrinsic triangulation by tracked flips.

    Parameters
    ----------
    flipped : IntrinsicDelaunay
        As returned by `flip_to_delaunay(base.mesh, track=True)`.
    base : BaseTriangulation
    place_lines : callable
        Positions of crossings along edges and base sides, as `lines_over` gives them.

    Returns
    -------
    CommonSubdivision

    Raises
    ------
    MeshError
        When the flips were not tracked, or the surface is one-sided (see `one_sided_subdivision`).
    SolveError
        When chains of crossings do not fit the base triangulation (a bug, independent of the geometry).
    """
    if flipped.crossings is None:
        raise MeshError("the flips were not tracked; call flip_to_delaunay(..., track=True)")
    if flipped.cover is not None:
        raise MeshError("the surface is one-sided; call one_sided_subdivision")
    mesh = flipped.mesh
    positions, residual = _crossing_positions(flipped, base, place_lines)
    names = Names(mesh.faces.ravel(), positions.n_before, 1)
    pieces = cut_faces(positions.halves, names, positions.labels)
    points = positions.points()
    return CommonSubdivision(
        input=base.input,
        intrinsic=mesh,
        mesh=TriangleMesh(points, Topology(pieces.corner, len(points))),
        input_face=pieces.input_face,
        intrinsic_face=pieces.face,
        vertex_kind=positions.kind(),
        length_residual=residual,
        crossings=positions,
    )


def _crossing_positions(
    flipped: IntrinsicDelaunay, base: BaseTriangulation, place_lines: PlaceLines
) -> tuple[CrossingPositions, float]:
    """Positions of the crossings with input edges, and the length residual of the intrinsic edges."""
    mesh = flipped.mesh
    twin = mesh.topology.side_twin.ravel()
    halves = crossings_of(flipped.crossings, twin)  # type: ignore[arg-type]
    edges = base_edges_of(halves, mesh.topology.side_tail)
    shared = np.flatnonzero(flipped.crossings.ravel() < 0)  # type: ignore[union-attr]
    chain_side, shared_side = _base_sides(mesh, base.mesh, edges, shared)
    label, crossed = edges.label, np.empty_like(edges.label)
    side_of_label = np.stack([chain_side, chain_side[edges.reverse]], axis=1).ravel()
    for begin in range(0, len(label), BLOCK_SIZE):
        block = slice(begin, begin + BLOCK_SIZE)
        crossed[block] = side_of_label.take(label[block] >> STEP_BITS)

    side = halves.side
    count = halves.count[side]
    holder = np.full(mesh.n_faces, -1, dtype=np.int64)
    holder[shared // 3] = base.input_face[shared_side // 3]
    for faces, k in ((side // 3, 0), (twin[side] // 3, 1)):
        holder[faces] = base.beside[crossed[np.cumsum(count) - count], k]

    along, share, residual = place_lines(base.mesh, crossed, count, mesh.side_length.ravel()[side])
    if not base.real_side.all():  # edges inside input faces are auxiliary
        real = np.flatnonzero(base.real_side.take(crossed))
        crossed, label, along, share = (_moved_up(a, real) for a in (crossed, label, along, share))
        bounds = np.searchsorted(real, list_starts(count))
        n_crossings = np.zeros(len(twin), dtype=np.int64)
        n_crossings[side] = n_crossings[twin[side]] = np.diff(bounds)
        halves = crossings_of(n_crossings.reshape(-1, 3), twin)
    share = in_order(share, label, edges)
    return CrossingPositions(mesh, base, halves, Labels(crossed, base.beside, holder), share, along), residual


def _moved_up(array: NDArray, rows: NDArray) -> NDArray:
    """Elements of ascending numbers, in place."""
    for begin in range(0, len(rows), BLOCK_SIZE):
        block = slice(begin, begin + BLOCK_SIZE)
        array[block][: len(rows[block])] = array.take(rows[block])
    return array[: len(rows)]


def _base_sides(
    mesh: IntrinsicMesh, base: TriangleMesh, edges: BaseEdges, shared: NDArray
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The base side that each chain runs along, and the one that each shared side is.

    Together they are all base sides, so that sorting both by their ends matches them.
    """
    topology = mesh.topology
    tail = np.concatenate([edges.tail, topology.side_tail[shared]])
    head = np.concatenate([edges.head, topology.side_head[shared]])
    key, order = sorted_sides(tail, head, topology.n_vertices)
    base_key, base_order = sorted_sides(base.topology.side_tail, base.topology.side_head, topology.n_vertices)
    if not np.array_equal(key, base_key):
        raise SolveError("a chain of crossings joins two vertices that no input edge joins")
    side = np.empty_like(order)
    side[order] = base_order
    return side[: len(edges.tail)], side[len(edges.tail) :]


def _followed(first: csr_array, tail: NDArray, head: NDArray, side: NDArray, share: NDArray) -> csr_array:
    """The rows of a matrix, followed by rows that interpolate at a share of sides."""
    k, filled = len(side), len(first.data)
    columns, values = np.empty((k, 2), dtype=first.indices.dtype), np.empty((k, 2))
    columns[:, 0], columns[:, 1] = tail[side], head[side]
    np.subtract(1.0, share, out=values[:, 0])
    values[:, 1] = share
    indptr = np.concatenate([first.indptr, filled + 2 * np.arange(1, k + 1)])
    data, indices = np.append(first.data, values), np.append(first.indices, columns)
    matrix = csr_array((data, indices, indptr), shape=(first.shape[0] + k, first.shape[1]))
    matrix.sum_duplicates()  # a side from a vertex to itself
    return matrix
