"""Connectivity of a triangle mesh, without positions and lengths.

Side conventions, the same everywhere from kernel to file: side `j` of face `f` runs from corner `j` to
corner `j+1 (mod 3)` and is opposite corner `j+2 (mod 3)`. A side's flat index is `3*f + j` (a halfedge).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.frozen import FrozenArrays, frozen
from ddgcli.mesh.ragged import sorted_keys, unique_keys

NEXT = np.array([1, 2, 0])
PREVIOUS = np.array([2, 0, 1])
# from the flat index of a corner to those of the next and the previous corner of its face
NEXT_OFFSET, PREVIOUS_OFFSET = NEXT - np.arange(3), PREVIOUS - np.arange(3)
MAX_ROTATION_STEPS = 500  # corners of a vertex up to which rotation about all vertices at once is cheap


@dataclass(frozen=True, eq=False)
class Topology(FrozenArrays):
    """Connectivity of a triangle mesh; may be a Delta-complex when its gluing is given.

    Parameters
    ----------
    faces : (m, 3) ndarray of int64
        Vertex at corner k.
    n_vertices : int
    gluing : (m, 3) ndarray of int64, optional
        Flat index of the side glued to side j, -1 on the boundary. When it is absent, sides with the same
        two end vertices are one edge (a simplicial mesh, possibly non-manifold). When it is given, edges are
        the pairs of glued sides: self-edges and several edges between two vertices are legal.
    twisted : (m, 3) ndarray of bool, optional
        With a gluing: True at sides that run along their edge in the same direction as the side glued to
        them, as one-sided surfaces have them; none by default.
    """

    faces: NDArray[np.int64]
    n_vertices: int
    gluing: NDArray[np.int64] | None = field(default=None, repr=False)
    twisted: NDArray[np.bool_] | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        return f"Topology({self.n_vertices} vertices, {len(self.faces)} faces)"

    def __post_init__(self) -> None:
        object.__setattr__(self, "faces", frozen(np.asarray(self.faces, dtype=np.int64).reshape(-1, 3)))
        if self.gluing is not None:
            object.__setattr__(self, "gluing", frozen(np.asarray(self.gluing, dtype=np.int64)))
        if self.twisted is not None:
            object.__setattr__(self, "twisted", frozen(np.asarray(self.twisted, dtype=bool)))

    @property
    def n_faces(self) -> int:
        return len(self.faces)

    @cached_property
    def side_tail(self) -> NDArray[np.int64]:
        """(3m,) vertex at which side 3f+j starts."""
        return frozen(self.faces.ravel())

    @cached_property
    def side_head(self) -> NDArray[np.int64]:
        """(3m,) vertex at which side 3f+j ends."""
        head = np.empty_like(self.side_tail)
        # shift all, then fix every third: copying two columns and then one takes twice as long
        head[:-1] = self.side_tail[1:]
        head[2::3] = self.side_tail[::3]
        return frozen(head)

    @cached_property
    def repeated_vertex_faces(self) -> NDArray[np.int64]:
        """Indices of the faces that name a vertex twice."""
        return frozen(unique_keys(np.flatnonzero(self.side_tail == self.side_head) // 3))

    @cached_property
    def _edge_numbering(self) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
        """(edges (e, 2), side_edge (m, 3), side_sign (m, 3), edge_face_count (e,), side_twin (m, 3))."""
        if self.gluing is not None:
            return self._glued_edges(self.gluing)
        tail, head, n = self.side_tail, self.side_head, max(self.n_vertices, 1)
        key, order = sorted_sides(np.minimum(tail, head), np.maximum(tail, head), n)
        sign = 2 * (tail <= head).view(np.int8) - np.int8(1)
        is_first = np.ones(len(key), dtype=bool)
        np.not_equal(key[1:], key[:-1], out=is_first[1:])
        first = np.flatnonzero(is_first)
        count = np.diff(first, append=len(key))
        edges = np.empty((len(first), 2), dtype=np.int64)
        key = key.take(first)
        np.floor_divide(key, n, out=edges[:, 0])
        np.subtract(key, edges[:, 0] * n, out=edges[:, 1])
        side_edge = np.empty(len(order), dtype=np.int64)
        side_edge[order] = np.cumsum(is_first) - 1
        pair = first.compress(count == 2)
        # of a closed surface every side has a twin
        twin = np.empty_like(order) if 2 * len(pair) == len(order) else np.full(len(order), -1)
        one, other = order.take(pair), order.take(pair + 1)
        twin[one], twin[other] = other, one
        by_face = (frozen(array.reshape(-1, 3)) for array in (side_edge, sign, twin))
        side_edge, sign, twin = by_face
        return frozen(edges), side_edge, sign, frozen(count), twin

    def _glued_edges(self, gluing: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
        twin = gluing.ravel()
        side = np.arange(len(twin))
        first = (twin < 0) | (side < twin)
        index = np.cumsum(first) - 1
        side_edge = np.where(first, index, index[np.maximum(twin, 0)])
        edges = np.stack([self.side_tail[first], self.side_head[first]], axis=1)
        along = first if self.twisted is None else first | self.twisted.ravel()
        sign = np.where(along, 1, -1).astype(np.int8)
        count = np.bincount(side_edge, minlength=len(edges))
        side_edge, sign = frozen(side_edge.reshape(-1, 3)), frozen(sign.reshape(-1, 3))
        return frozen(edges), side_edge, sign, frozen(count), gluing

    @property
    def edges(self) -> NDArray[np.int64]:
        """(e, 2) end vertices; lower index first for a simplicial mesh, along the first side when glued."""
        return self._edge_numbering[0]

    @property
    def side_edge(self) -> NDArray[np.int64]:
        """(m, 3) edge number of side j."""
        return self._edge_numbering[1]

    @property
    def side_sign(self) -> NDArray[np.int8]:
        """(m, 3) +1 where side j runs along its edge, -1 where it runs against it."""
        return self._edge_numbering[2]

    @property
    def n_edges(self) -> int:
        return len(self.edges)

    @property
    def edge_face_count(self) -> NDArray[np.int64]:
        """(e,) number of sides on each edge."""
        return self._edge_numbering[3]

    @property
    def side_twin(self) -> NDArray[np.int64]:
        """(m, 3) flat index of the side glued to side j; -1 on the boundary and on edges with 3+ faces."""
        return self._edge_numbering[4] if self.gluing is None else self.gluing

    @cached_property
    def interior_sides(self) -> NDArray[np.int64]:
        """(h,) flat index of the first side of each edge that has two sides."""
        twin = self.side_twin.ravel()
        return frozen(np.flatnonzero(np.arange(len(twin)) < twin))  # a side without twin has -1

    @cached_property
    def boundary_edges(self) -> NDArray[np.int64]:
        """Indices of the edges with one face."""
        return frozen(np.flatnonzero(self.edge_face_count == 1))

    @cached_property
    def nonmanifold_edges(self) -> NDArray[np.int64]:
        """Indices of the edges with three or more faces (or with one face twice)."""
        return frozen(np.flatnonzero(self.edge_face_count > 2))

    @cached_property
    def boundary_vertex(self) -> NDArray[np.bool_]:
        """(n,) True at the ends of boundary edges."""
        mask = np.zeros(self.n_vertices, dtype=bool)
        mask[self.edges[self.boundary_edges]] = True
        return frozen(mask)

    @cached_property
    def referenced_vertex(self) -> NDArray[np.bool_]:
        """(n,) True where a face uses the vertex."""
        mask = np.zeros(self.n_vertices, dtype=bool)
        mask[self.faces] = True
        return frozen(mask)

    @cached_property
    def nonmanifold_vertices(self) -> NDArray[np.int64]:
        """Vertices whose faces form more than one fan around them (edges with 3+ faces join their fans)."""
        if self.first_corner is not None:
            return frozen(np.zeros(0, dtype=np.int64))
        fans = self.corner_fans
        vertex_of_fan = np.full(int(fans.max(initial=-1)) + 1, -1, dtype=np.int64)
        vertex_of_fan[fans.ravel()] = self.faces.ravel()
        count = np.bincount(vertex_of_fan, minlength=self.n_vertices)
        return frozen(np.flatnonzero(count > 1))

    @cached_property
    def corner_fans(self) -> NDArray[np.int64]:
        """(m, 3) index of the fan (corners joined across shared edges) that holds corner k."""
        if self.first_corner is not None:
            corner, lowest = np.arange(3 * self.n_faces), np.zeros(self.n_vertices, dtype=np.int64)
            lowest[self.side_tail[::-1]] = corner[::-1]
            first = lowest[self.side_tail]
            return frozen((np.cumsum(first == corner) - 1)[first].reshape(-1, 3))
        side_edge = self.side_edge.ravel()
        n_corners = len(side_edge)
        tail_corner = np.arange(n_corners)
        head_corner = (tail_corner // 3) * 3 + NEXT[tail_corner % 3]
        forward = self.side_sign.ravel() > 0
        low_corner = np.where(forward, tail_corner, head_corner)
        high_corner = np.where(forward, head_corner, tail_corner)
        order = np.argsort(side_edge, kind="stable")
        same = side_edge[order][1:] == side_edge[order][:-1]
        a, b = order[:-1][same], order[1:][same]
        tail = np.concatenate([low_corner[a], high_corner[a]])
        head = np.concatenate([low_corner[b], high_corner[b]])
        return frozen(connected_labels(tail, head, n_corners)[1].reshape(-1, 3))

    @cached_property
    def first_corner(self) -> NDArray[np.int64] | None:
        """(n,) corner (flat index) of each vertex from which rotation by `corner_after` visits all of them.

        None where rotation does not visit all corners of some vertex, and where it is not tried: on edges of
        three faces, surfaces without consistent orientation, gluings, and vertices of very many faces. The
        entries of vertices without a face have no meaning.
        """
        if self.gluing is not None or len(self.nonmanifold_edges) or not self.is_oriented:
            return None
        vertex, twin = self.side_tail, self.side_twin.ravel()
        n_corners = np.bincount(vertex, minlength=self.n_vertices)
        most = int(n_corners.max(initial=0))
        if most > MAX_ROTATION_STEPS:
            return None
        # a side starts at its corner's vertex; the side before it ends there, and its twin starts there
        after = np.empty_like(twin)
        after[1:] = twin[:-1]
        after[::3] = twin[2::3]
        first_corner = np.zeros(self.n_vertices, dtype=np.int64)
        first_corner[vertex] = np.arange(len(vertex))
        # at a boundary the first corner is the one that no rotation leads to
        first = np.flatnonzero(twin < 0)
        first_corner[vertex[first]] = first
        # vertices of most corners first: those that still rotate after each step are the first ones
        start = first_corner.take(np.argsort((most - n_corners).astype(np.uint16), kind="stable"))
        n_rotating = np.cumsum(np.bincount(n_corners, minlength=most + 2)[::-1])[::-1]
        place = start
        for step in range(1, most):
            place = after.take(place[: n_rotating[step + 1]])
            if place.min() < 0 or (place == start[: len(place)]).any():
                return None
        return frozen(first_corner)

    def corner_after(self, corner: NDArray) -> NDArray[np.int64]:
        """Next corner (flat index) about the vertex of each corner; -1 after the last one at a boundary."""
        return self.side_twin.ravel().take(corner + PREVIOUS_OFFSET.take(corner % 3))

    @cached_property
    def _vertex_components(self) -> tuple[int, NDArray[np.int64]]:
        _, label = connected_labels(self.edges[:, 0], self.edges[:, 1], self.n_vertices)
        labels = np.flatnonzero(np.bincount(label[self.referenced_vertex]))
        rank = np.full(label.max(initial=-1) + 1, -1, dtype=np.int64)
        rank[labels] = np.arange(len(labels))
        return len(labels), frozen(rank[label])

    @property
    def n_components(self) -> int:
        """Number of components joined by shared vertices; unreferenced vertices do not count."""
        return self._vertex_components[0]

    @property
    def vertex_component(self) -> NDArray[np.int64]:
        """(n,) component of each vertex, -1 where no face uses it."""
        return self._vertex_components[1]

    @property
    def face_component(self) -> NDArray[np.int64]:
        """(m,) component of each face."""
        return self.vertex_component[self.faces[:, 0]]

    @property
    def euler_characteristic(self) -> int:
        """V - E + F of the vertices that faces use."""
        return int(self.referenced_vertex.sum()) - self.n_edges + self.n_faces

    @cached_property
    def boundary_loops(self) -> int:
        """Number of connected sets of boundary edges."""
        ends = self.edges[self.boundary_edges]
        if len(ends) == 0:
            return 0
        vertices, local = np.unique(ends, return_inverse=True)
        local = local.reshape(-1, 2)
        return connected_labels(local[:, 0], local[:, 1], len(vertices))[0]

    @property
    def is_manifold(self) -> bool:
        """No edge with three faces, no vertex with several fans."""
        return len(self.nonmanifold_edges) == 0 and len(self.nonmanifold_vertices) == 0

    @property
    def is_closed(self) -> bool:
        """No boundary edge."""
        return self.n_faces > 0 and len(self.boundary_edges) == 0

    @cached_property
    def misoriented_edges(self) -> NDArray[np.int64]:
        """Numbers of two-sided edges whose two faces traverse them in the same direction."""
        side, sign = self.interior_sides, self.side_sign.ravel()
        clash = side[sign[side] == sign[self.side_twin.ravel()[side]]]
        return frozen(np.sort(self.side_edge.ravel()[clash]))

    @property
    def is_oriented(self) -> bool:
        """Every two-sided edge is traversed once in each direction."""
        return len(self.misoriented_edges) == 0

    @cached_property
    def _cover_component(self) -> NDArray[np.int64]:
        """(m, 2) component of the double cover in which each face lies, as it is and reversed."""
        twin = self.side_twin.ravel()
        side = np.flatnonzero((twin >= 0) & (np.arange(len(twin)) <= twin))
        a, b = side // 3, twin[side] // 3
        sign = self.side_sign.ravel()
        clash = sign[side] == sign[twin[side]]
        # the double cover: face f as it is (2f) and reversed (2f+1)
        tail, head = np.concatenate([2 * a, 2 * a + 1]), np.concatenate([2 * b + clash, 2 * b + ~clash])
        return connected_labels(tail, head, 2 * self.n_faces)[1].reshape(-1, 2)

    @cached_property
    def one_sided_face(self) -> NDArray[np.bool_]:
        """(m,) True at faces of pieces (faces joined through two-sided edges) that have no orientation."""
        if self.is_oriented:
            return frozen(np.zeros(self.n_faces, dtype=bool))
        return frozen(self._cover_component[:, 0] == self._cover_component[:, 1])

    @cached_property
    def orientable_component(self) -> NDArray[np.bool_]:
        """(c,) whether each component can be oriented."""
        result = np.ones(self.n_components, dtype=bool)
        result[self.face_component[self.one_sided_face]] = False
        return frozen(result)

    @cached_property
    def faces_to_turn(self) -> NDArray[np.bool_]:
        """(m,) True at faces to reverse so that every orientable piece is oriented.

        At most half of the faces of each piece; none in one-sided pieces.
        """
        if self.is_oriented:
            return frozen(np.zeros(self.n_faces, dtype=bool))
        turned, piece, share = self._turned_share
        return frozen((turned ^ (share > 0.5)[piece]) & ~self.one_sided_face)

    @property
    def undecided_piece(self) -> NDArray[np.int64]:
        """(m,) index of the piece of each face where half the faces would be turned, elsewhere -1."""
        if self.is_oriented:
            return np.full(self.n_faces, -1)
        _, piece, share = self._turned_share
        return np.where((share == 0.5)[piece] & ~self.one_sided_face, piece, -1)

    @cached_property
    def _turned_share(self) -> tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.float64]]:
        """(m,) faces turned against the first of their piece, (m,) pieces, and the turned share of each."""
        copies = self._cover_component
        turned = copies[:, 0] > copies[:, 1]
        _, piece = np.unique(copies.min(axis=1), return_inverse=True)
        return turned, piece, np.bincount(piece, weights=turned) / np.maximum(np.bincount(piece), 1)

    @property
    def face_turn(self) -> NDArray[np.bool_] | None:
        """`faces_to_turn`, None where a piece has no orientation."""
        return None if self.one_sided_face.any() else self.faces_to_turn

    @property
    def is_orientable(self) -> bool:
        """Whether faces can be reversed so that every two-sided edge is traversed in both directions."""
        return self.face_turn is not None

    @property
    def genus(self) -> int | None:
        """Total genus of an orientable manifold surface, summed over components; None otherwise."""
        if self.n_faces == 0 or not self.is_manifold or not (self.is_oriented or self.is_orientable):
            return None
        return (2 * self.n_components - self.boundary_loops - self.euler_characteristic) // 2


def sorted_sides(low: NDArray, high: NDArray, n_vertices: int) -> tuple[NDArray, NDArray]:
    """Sort sides by their end vertices.

    Parameters
    ----------
    low, high : (k,) ndarray of int64
        Lower and higher vertex of each side.
    n_vertices : int

    Returns
    -------
    key : (k,) ndarray
        low * n_vertices + high, ascending.
    order : (k,) ndarray of int64
        The sides in that order, stable.
    """
    n = max(n_vertices, 1)
    key = low * np.int64(n)
    key += high
    return sorted_keys(key, n * n, overwrite=True)


def check_faces(faces: NDArray, n_vertices: int, *, copy: bool = True) -> NDArray[np.int64]:
    """Convert faces to the form that a mesh stores, or raise an error for the first bad one.

    Parameters
    ----------
    faces : (m, 3) ndarray of integers
    n_vertices : int
    copy : bool
        If not, an array that has this form already is returned itself.

    Returns
    -------
    (m, 3) ndarray of int64

    Raises
    ------
    MeshError
        For another shape or type, or a vertex index out of range.
    """
    faces = np.asarray(faces)
    if faces.size == 0:
        return np.zeros((0, 3), dtype=np.int64)
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(f"faces must have shape (m, 3), not {faces.shape}")
    if not np.issubdtype(faces.dtype, np.integer):
        raise MeshError(f"face indices must be whole numbers, not {faces.dtype}")
    if faces.min() < 0 or faces.max() >= n_vertices:
        outside = (faces < 0) | (faces >= n_vertices)
        bad = int(np.argmax(outside.any(axis=1)))
        vertex = faces[bad][outside[bad]][0]
        raise MeshError(
            f"face {bad} names vertex {vertex}, outside 0..{n_vertices - 1}; correct the face list"
        )
    return faces.astype(np.int64, copy=copy)
