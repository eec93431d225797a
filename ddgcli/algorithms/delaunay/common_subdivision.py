"""The common subdivision of an input surface and an intrinsic triangulation of it, as an ordinary mesh.

Which edges cross, and in which order, comes from integers alone (`normal_coordinates`); where they cross is
then measured by unfolding the strip of input faces under each intrinsic edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array

from ddgcli.algorithms.delaunay.normal_coordinates import BaseEdges, Crossings, base_edges_of, crossings_of
from ddgcli.algorithms.delaunay.overlay_lines import in_order, lines_over
from ddgcli.algorithms.delaunay.overlay_pieces import cut_faces
from ddgcli.algorithms.delaunay.triangulation import Flipped
from ddgcli.errors import MeshError, SolveError
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.topology import sorted_sides
from ddgcli.mesh.triangle_mesh import TriangleMesh

INPUT_VERTEX, STEINER_POINT, CROSSING = 0, 1, 2


@dataclass(frozen=True, eq=False)
class Base:
    """The triangulation whose edges the normal coordinates count: the input, with Steiner points inserted.

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
    def itself(cls, mesh: TriangleMesh) -> Base:
        """The input without Steiner points."""
        return cls(mesh, mesh, np.arange(mesh.n_faces), csr_array(eye_array(mesh.n_vertices)))

    @cached_property
    def real_side(self) -> NDArray[np.bool_]:
        """(3m,) True at sides that lie on input edges."""
        twin = self.mesh.topology.side_twin.ravel()
        mine, other = np.repeat(self.input_face, 3), self.input_face[np.maximum(twin, 0) // 3]
        return (twin < 0) | (mine != other)


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
    from_input, from_intrinsic : (v, n) sparse arrays
        Values at the vertices from those at the vertices of either triangulation, linear on its faces.
    corner : (t, 3) ndarray of int64
        Where each triangle's corners lie in its intrinsic face: the flat number 3f+k of a corner of the face,
        or 3m + h for half-crossing h.
    half_side, half_along : (c,) ndarray
        Intrinsic side of each half-crossing, and its share of the side's length from the tail.
    edge_start, edge_vertex : ndarray of int64
        Intrinsic edge e (as `topology.edges`) runs through edge_vertex[edge_start[e]:edge_start[e + 1]].
    length_residual : float
        Largest difference between an intrinsic edge's length and that of its straight line over the input
        faces, relative to the length.
    """

    input: TriangleMesh
    intrinsic: IntrinsicMesh
    mesh: TriangleMesh
    input_face: NDArray[np.int64]
    intrinsic_face: NDArray[np.int64]
    vertex_kind: NDArray[np.int64]
    from_input: csr_array
    from_intrinsic: csr_array
    corner: NDArray[np.int64]
    half_side: NDArray[np.int64]
    half_along: NDArray[np.float64]
    edge_start: NDArray[np.int64]
    edge_vertex: NDArray[np.int64]
    length_residual: float

    def curves(self) -> list[NDArray[np.float64]]:
        """Every intrinsic edge as a polyline (k, 3) on the input surface."""
        return np.split(self.mesh.points[self.edge_vertex], self.edge_start[1:-1])


def common_subdivision(flipped: Flipped, base: Base) -> CommonSubdivision:
    """The common subdivision of an input and the triangulation that tracked flips made of it.

    Parameters
    ----------
    flipped : Flipped
        Of `flip_to_delaunay(base.mesh, track=True)`.
    base : Base

    Raises
    ------
    MeshError
        When the flips were not tracked.
    SolveError
        When chains of crossings do not fit the base triangulation (a bug, never a matter of geometry).
    """
    if flipped.crossings is None:
        raise MeshError("the flips were not tracked; call flip_to_delaunay(..., track=True)")
    mesh = flipped.mesh
    twin = mesh.topology.side_twin
    every = crossings_of(flipped.crossings, twin)
    edges = base_edges_of(every, mesh.topology.side_tail)
    table = SideTable(base.mesh)
    base_side = _crossed_sides(base.mesh, table, edges)
    along, share, residual = lines_over(mesh, base.mesh, every, base_side)

    real = base.real_side[base_side]
    counted = np.add.reduceat(np.append(real, False).astype(np.int64), np.append(every.start, len(real)))[:-1]
    counted = np.where(every.count > 0, counted, 0)
    crossings = crossings_of(counted.reshape(-1, 3), twin)
    holder = _faces_without_arcs(flipped, base, table, every, base_side)
    inside = base.input_face[base_side // 3][real]
    beyond = base.input_face[np.maximum(base.mesh.topology.side_twin.ravel(), 0)[base_side] // 3][real]
    n_crossings, number = _numbers(crossings)
    pieces = cut_faces(crossings, inside, beyond, holder)
    triangles = np.concatenate([mesh.faces.ravel(), mesh.n_vertices + number])[pieces.corner]

    first = np.flatnonzero(crossings.side < twin.ravel()[crossings.side])
    chosen = np.flatnonzero(real)[first]
    share = in_order(share[chosen], base_side[chosen], edges.step[every.across[chosen]], base.mesh)
    vertices = _Vertices(mesh, base, base_side[chosen], share, crossings.side[first], along[chosen])
    half_along = np.empty(len(number))
    half_along[first], half_along[crossings.across[first]] = along[chosen], 1.0 - along[chosen]
    edge_start, edge_vertex = _edge_chains(mesh, crossings, number, n_crossings)
    return CommonSubdivision(
        input=base.input,
        intrinsic=mesh,
        mesh=TriangleMesh.from_arrays(vertices.points(), triangles),
        input_face=pieces.input_face,
        intrinsic_face=pieces.face,
        vertex_kind=vertices.kind(),
        from_input=vertices.from_input(),
        from_intrinsic=vertices.from_intrinsic(),
        corner=pieces.corner,
        half_side=crossings.side,
        half_along=half_along,
        edge_start=edge_start,
        edge_vertex=edge_vertex,
        length_residual=residual,
    )


def _crossed_sides(mesh: TriangleMesh, table: SideTable, edges: BaseEdges) -> NDArray[np.int64]:
    """The base side of each half-crossing, from the right of its side to the left."""
    one = np.flatnonzero(np.arange(len(edges.reverse)) < edges.reverse)
    side = np.empty(len(edges.reverse), dtype=np.int64)
    side[one] = table.between(edges.tail[one], edges.head[one])
    side[edges.reverse[one]] = mesh.topology.side_twin.ravel()[side[one]]
    return side[edges.chain]


class SideTable:
    """The sides of a mesh by their ends."""

    def __init__(self, mesh: TriangleMesh) -> None:
        topology = mesh.topology
        self.n = np.int64(max(topology.n_vertices, 1))
        self.key, self.side = sorted_sides(topology.side_tail, topology.side_head, topology.n_vertices)

    def between(self, tail: NDArray, head: NDArray) -> NDArray[np.int64]:
        """The side that runs from each tail to each head."""
        wanted = tail * self.n + head
        place = np.minimum(np.searchsorted(self.key, wanted), len(self.key) - 1)
        if not np.array_equal(self.key[place], wanted):
            raise SolveError("a chain of crossings joins two vertices that no input edge joins")
        return self.side[place]


def _numbers(c: Crossings) -> tuple[int, NDArray[np.int64]]:
    """Number of crossings, and the crossing that each half-crossing is a half of."""
    first = np.arange(len(c.side)) < c.across
    number = np.cumsum(first) - 1
    return int(first.sum()), np.where(first, number, number[c.across])


def _faces_without_arcs(
    flipped: Flipped, base: Base, table: SideTable, every: Crossings, base_side: NDArray
) -> NDArray[np.int64]:
    """(m,) input face of intrinsic faces that no input edge crosses; anything for the others."""
    mesh = flipped.mesh
    holder = np.full(mesh.n_faces, -1, dtype=np.int64)
    shared = np.flatnonzero(flipped.crossings.ravel() < 0)  # type: ignore[union-attr]
    side = table.between(mesh.topology.side_tail[shared], mesh.topology.side_head[shared])
    holder[shared // 3] = base.input_face[side // 3]
    holder[every.side // 3] = base.input_face[base_side // 3]
    return holder


@dataclass(frozen=True, eq=False)
class _Vertices:
    """Vertices of the subdivision: those of the base, then crossings at a share of a base and an own side."""

    mesh: IntrinsicMesh
    base: Base
    base_side: NDArray[np.int64]
    share: NDArray[np.float64]
    side: NDArray[np.int64]
    along: NDArray[np.float64]

    def points(self) -> NDArray[np.float64]:
        topology, points = self.base.mesh.topology, self.base.mesh.points
        tail, head = points[topology.side_tail[self.base_side]], points[topology.side_head[self.base_side]]
        head -= tail
        head *= self.share[:, None]
        head += tail
        return np.concatenate([points, head])

    def kind(self) -> NDArray[np.int64]:
        n_input = self.base.input.n_vertices
        counts = [n_input, self.base.mesh.n_vertices - n_input, len(self.side)]
        return np.repeat([INPUT_VERTEX, STEINER_POINT, CROSSING], counts)

    def from_input(self) -> csr_array:
        """Crossings lie on inner edges of the input, which end at its vertices: no Steiner point does."""
        topology = self.base.mesh.topology
        return _followed(
            self.base.interpolation, topology.side_tail, topology.side_head, self.base_side, self.share
        )

    def from_intrinsic(self) -> csr_array:
        topology = self.mesh.topology
        vertices = csr_array(eye_array(topology.n_vertices))
        return _followed(vertices, topology.side_tail, topology.side_head, self.side, self.along)


def _followed(first: csr_array, tail: NDArray, head: NDArray, side: NDArray, share: NDArray) -> csr_array:
    """The rows of a matrix, and then those that interpolate at a share of sides."""
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


def _edge_chains(
    mesh: IntrinsicMesh, c: Crossings, number: NDArray, n_crossings: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Vertices of the subdivision along every intrinsic edge, from end to end."""
    topology = mesh.topology
    twin = topology.side_twin.ravel()
    side = np.flatnonzero((twin < 0) | (np.arange(len(twin)) < twin))  # in the order of topology.edges
    count = c.count[side] + 2
    start = np.concatenate([[0], np.cumsum(count)])
    chain = np.empty(start[-1], dtype=np.int64)
    chain[start[:-1]], chain[start[1:] - 1] = topology.side_tail[side], topology.side_head[side]
    inner = np.repeat(start[:-1] + 1, c.count[side]) + _counted(c.count[side])
    source = np.repeat(c.start[side], c.count[side]) + _counted(c.count[side])
    chain[inner] = mesh.n_vertices + number[source]
    return start, chain


def _counted(count: NDArray) -> NDArray[np.int64]:
    """0 .. count-1 for each count, one after the other."""
    return np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
