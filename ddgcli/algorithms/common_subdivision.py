"""The common subdivision of an input surface and an intrinsic triangulation of it, as an ordinary mesh.

Which edges cross, and in which order, comes from integers alone (`normal_coordinates`); where they cross is
then measured by unfolding the strip of input faces under each intrinsic edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from ddgcli.algorithms.delaunay import Flipped
from ddgcli.algorithms.gluing import around
from ddgcli.algorithms.normal_coordinates import BaseEdges, Crossings, base_edges_of, crossings_of
from ddgcli.algorithms.overlay_pieces import cut_faces
from ddgcli.errors import MeshError, SolveError
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
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
        from scipy.sparse import eye_array

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
    base_side = _crossed_sides(base.mesh, edges)
    along, share, residual = _measure(mesh, base.mesh, every, base_side)

    real = base.real_side[base_side]
    counted = np.add.reduceat(np.append(real, False).astype(np.int64), np.append(every.start, len(real)))[:-1]
    counted = np.where(every.count > 0, counted, 0)
    crossings = crossings_of(counted.reshape(-1, 3), twin)
    holder = _faces_without_arcs(flipped, base, every, base_side)
    inside = base.input_face[base_side // 3][real]
    beyond = base.input_face[np.maximum(base.mesh.topology.side_twin.ravel(), 0)[base_side] // 3][real]
    n_crossings, number = _numbers(crossings)
    pieces = cut_faces(crossings, inside, beyond, holder)
    triangles = np.concatenate([mesh.faces.ravel(), mesh.n_vertices + number])[pieces.corner]

    first = np.flatnonzero(crossings.side < twin.ravel()[crossings.side])
    chosen = np.flatnonzero(real)[first]
    share = _in_order(share[chosen], base_side[chosen], edges.step[every.across[chosen]], base.mesh)
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


def _crossed_sides(mesh: TriangleMesh, edges: BaseEdges) -> NDArray[np.int64]:
    """The base side of each half-crossing, from the right of its side to the left."""
    one = np.flatnonzero(np.arange(len(edges.reverse)) < edges.reverse)
    side = np.empty(len(edges.reverse), dtype=np.int64)
    side[one] = sides_between(mesh, edges.tail[one], edges.head[one])
    side[edges.reverse[one]] = mesh.topology.side_twin.ravel()[side[one]]
    return side[edges.chain]


def sides_between(mesh: TriangleMesh, tail: NDArray, head: NDArray) -> NDArray[np.int64]:
    """The side that runs from each tail to each head."""
    n = np.int64(mesh.n_vertices)
    key = mesh.topology.side_tail * n + mesh.topology.side_head
    order = np.argsort(key)
    place = np.minimum(np.searchsorted(key[order], tail * n + head), len(key) - 1)
    side = order[place]
    if not np.array_equal(key[side], tail * n + head):
        raise SolveError("a chain of crossings joins two vertices that no input edge joins")
    return side


def _numbers(c: Crossings) -> tuple[int, NDArray[np.int64]]:
    """Number of crossings, and the crossing that each half-crossing is a half of."""
    first = np.arange(len(c.side)) < c.across
    number = np.cumsum(first) - 1
    return int(first.sum()), np.where(first, number, number[c.across])


def _faces_without_arcs(
    flipped: Flipped, base: Base, every: Crossings, base_side: NDArray
) -> NDArray[np.int64]:
    """(m,) input face of intrinsic faces that no input edge crosses; anything for the others."""
    mesh = flipped.mesh
    holder = np.full(mesh.n_faces, -1, dtype=np.int64)
    shared = np.flatnonzero(flipped.crossings.ravel() < 0)  # type: ignore[union-attr]
    side = sides_between(base.mesh, mesh.topology.side_tail[shared], mesh.topology.side_head[shared])
    holder[shared // 3] = base.input_face[side // 3]
    holder[every.side // 3] = base.input_face[base_side // 3]
    return holder


def _measure(
    mesh: IntrinsicMesh, base: TriangleMesh, c: Crossings, base_side: NDArray
) -> tuple[NDArray, NDArray, float]:
    """Where crossings lie, by unfolding the strip of base faces under each edge.

    Returns
    -------
    along : (c,) ndarray of float64
        Share of the intrinsic side's length, from its tail; nan on one of the two sides.
    share : (c,) ndarray of float64
        Share of the base side's length, from its tail.
    residual : float
        Largest relative difference between an edge's length and its straight line's.
    """
    twin = mesh.topology.side_twin.ravel()
    side = np.flatnonzero((c.count > 0) & (np.arange(len(twin)) < twin))
    side = side[np.argsort(-c.count[side], kind="stable")]
    along, share = np.full(len(c.side), np.nan), np.full(len(c.side), np.nan)
    if len(side) == 0:
        return along, share, 0.0
    count, start = c.count[side], c.start[side]
    right, left, end = _unfold(base, base_side, start, count)

    straight = np.abs(end)
    unit = np.where(straight > 0, straight, 1.0)
    turn = np.repeat(np.where(straight > 0, np.conj(end) / unit, 1.0), count)
    right *= turn
    left *= turn
    rise = left.imag - right.imag
    part = np.where(rise > 0, -right.imag / np.where(rise > 0, rise, 1.0), 0.5)
    np.clip(part, 0.0, 1.0, out=part)
    position = (right.real + part * (left.real - right.real)) / np.repeat(unit, count)
    mine = np.arange(len(part)) + np.repeat(start - (np.cumsum(count) - count), count)
    share[mine], along[mine] = part, np.clip(position, 0.0, 1.0)
    length = mesh.side_length.ravel()[side]
    return along, share, float((np.abs(straight - length) / length).max())


def _unfold(
    base: TriangleMesh, base_side: NDArray, start: NDArray, count: NDArray
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128]]:
    """Lay out the strips of faces under edges whose crossings begin at `start`, longest strips first.

    The plane is that of complex numbers, with the tail of each edge at 0.

    Returns
    -------
    right, left : (c,) ndarray of complex128
        Ends of the crossed sides, strip after strip.
    end : (k,) ndarray of complex128
        Heads of the edges.
    """
    apex, twin = _apex(base), base.topology.side_twin.ravel()
    place = np.cumsum(count) - count
    right, left = np.empty((2, int(count.sum())), dtype=np.complex128)
    here = base_side[start]
    length = base.side_length.ravel()[here]
    right[place], left[place] = -apex[here] * length, (1.0 - apex[here]) * length
    end = np.zeros(len(start), dtype=np.complex128)
    alive = len(start)
    longer = alive - np.cumsum(np.bincount(count))  # strips of more crossings than so many
    for step in range(1, int(count[0]) + 1):
        entered = twin[base_side[start[:alive] + step - 1]]
        previous = place[:alive] + step - 1
        p, q = left[previous], right[previous]
        corner = p + apex[entered] * (q - p)
        going = int(longer[step])
        end[going:alive] = corner[going:]
        now, entered = place[:going] + step, entered[:going]
        crossed = base_side[start[:going] + step]
        _, following, before = around(entered)
        keeps_right = crossed == following
        if not (keeps_right | (crossed == before)).all():
            raise SolveError("a chain of crossings leaves the strip of faces that it runs through")
        left[now] = np.where(keeps_right, corner[:going], p[:going])
        right[now] = np.where(keeps_right, q[:going], corner[:going])
        alive = going
    return right, left, end


def _apex(mesh: TriangleMesh) -> NDArray[np.complex128]:
    """(3m,) the corner opposite each side, in the frame where the side runs from 0 to 1."""
    side = mesh.side_vector
    to_apex = -side[:, [2, 0, 1]]
    squared = np.einsum("fij,fij->fi", side, side)
    squared[squared == 0.0] = 1.0
    x = np.einsum("fij,fij->fi", side, to_apex) / squared
    y = np.linalg.norm(np.cross(side[:, 0], to_apex[:, 0]), axis=1)[:, None] / squared
    return (x + 1j * y).ravel()


def _in_order(share: NDArray, base_side: NDArray, index: NDArray, base: TriangleMesh) -> NDArray[np.float64]:
    """Shares along base sides, exchanged where rounding put them in another order than the integers say."""
    twin = base.topology.side_twin.ravel()
    forward = base_side < twin[base_side]
    edge = np.where(forward, base_side, twin[base_side])
    total = np.bincount(edge, minlength=len(twin))[edge]
    along = np.where(forward, share, 1.0 - share)
    rank = np.where(forward, index, total - 1 - index)
    count = np.bincount(edge, minlength=len(twin))
    place = (np.cumsum(count) - count)[edge] + rank  # every rank of an edge occurs once
    owner, ordered = np.empty_like(edge), np.empty_like(along)
    owner[place], ordered[place] = edge, along
    if ((ordered[1:] < ordered[:-1]) & (owner[1:] == owner[:-1])).any():
        ordered = ordered[np.lexsort((ordered, owner))]
    along = ordered[place]
    return np.where(forward, along, 1.0 - along)


@dataclass(frozen=True, eq=False)
class _Vertices:
    """Vertices of the subdivision: those of the base, then crossings at a share of a base and an own side."""

    mesh: IntrinsicMesh
    base: Base
    base_side: NDArray[np.int64]
    share: NDArray[np.float64]
    side: NDArray[np.int64]
    along: NDArray[np.float64]

    def _on_base(self) -> csr_array:
        topology = self.base.mesh.topology
        return _interpolation(
            topology.side_tail, topology.side_head, self.base_side, self.share, topology.n_vertices
        )

    def points(self) -> NDArray[np.float64]:
        topology, points = self.base.mesh.topology, self.base.mesh.points
        tail, head = points[topology.side_tail[self.base_side]], points[topology.side_head[self.base_side]]
        return np.concatenate([points, tail + self.share[:, None] * (head - tail)])

    def kind(self) -> NDArray[np.int64]:
        n_input = self.base.input.n_vertices
        counts = [n_input, self.base.mesh.n_vertices - n_input, len(self.side)]
        return np.repeat([INPUT_VERTEX, STEINER_POINT, CROSSING], counts)

    def from_input(self) -> csr_array:
        return csr_array(self._on_base() @ self.base.interpolation)

    def from_intrinsic(self) -> csr_array:
        topology = self.mesh.topology
        return _interpolation(
            topology.side_tail, topology.side_head, self.side, self.along, topology.n_vertices
        )


def _interpolation(tail: NDArray, head: NDArray, side: NDArray, share: NDArray, n: int) -> csr_array:
    """(n + k, n) matrix: the vertices themselves, then points at a share of sides."""
    k = len(side)
    row = np.concatenate([np.arange(n), n + np.arange(k), n + np.arange(k)])
    column = np.concatenate([np.arange(n), tail[side], head[side]])
    value = np.concatenate([np.ones(n), 1.0 - share, share])
    return coo_array((value, (row, column)), shape=(n + k, n)).tocsr()


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
