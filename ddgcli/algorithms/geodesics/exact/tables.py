"""Constants of the sides of a surface for window propagation, and the sides across them.

A side h = 3f + j has its own frame: v0 at the origin, v1 at (length, 0), the face above, its third
vertex (the apex) at (apex_x, apex_y) with apex_y >= 0. All values come from side lengths, so any intrinsic
metric is valid. Lengths are divided by a power of two near the longest side of the component: exact, and safe
at any scale.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.exact.shadow import corner_turns
from ddgcli.geometry.intrinsic import corner_angle, face_area
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import group_by_key, list_starts, repeat_with_place
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS, Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import vector_length

BOUNDARY = (
    -1
)  # crossing a side with this code leads nowhere; codes below it are -2 - side: several faces follow
BLOCK = 8192  # faces
FLAT_ANGLE = 2 * np.pi - 1e-9  # at a larger angle a shortest path may pass through the vertex


@dataclass(frozen=True, eq=False)
class SideTables:
    """Constants of the sides, packed by rows for one gather per window.

    Parameters
    ----------
    shape : (3m, 5) ndarray of float64
        length, apex_x, apex_y, |v0 apex|, |v1 apex|; divided by `scale`.
    ids : (3m, 5) ndarray of int64
        v0, v1, apex, and the sides entered when leaving by (v0, apex) and by (apex, v1), or their codes.
    mirrored : (3m,) ndarray of bool, or None
        True where the side across runs the same way (faces of opposite orientation); None where none does.
    edge_sides : tuple of two ndarrays and (3m,) ndarray, or None
        (start, sides) of each edge and the edge of each side, when some edge has three faces or more.
    plain : bool
        Every side has one side across that runs the other way, or none.
    scale : (n,) ndarray of float64
        A power of two for each component, on its vertices; true length = scale * length here.
    """

    shape: NDArray[np.float64]
    ids: NDArray[np.int64]
    mirrored: NDArray[np.bool_] | None
    edge_sides: tuple[NDArray, NDArray, NDArray, NDArray] | None
    plain: bool
    scale: NDArray[np.float64]

    def code(self, side: NDArray) -> NDArray[np.int64]:
        """Side across each side, or its code: column (v0, apex) of the next side of the face."""
        face, j = np.divmod(side, 3)
        return self.ids[3 * face + (j + 1) % 3, 3]

    def across(self, side: int) -> list[tuple[int, bool]]:
        """Sides across `side`, each with whether it runs the same way."""
        code = int(self.code(np.array([side]))[0])
        if code == BOUNDARY:
            return []
        if code > BOUNDARY:
            return [(code, bool(self.mirrored is not None and self.mirrored[side]))]
        rows, sides, same = self.across_many(np.array([side]))
        return [(int(s), bool(m)) for s, m in zip(sides, same)]

    def across_many(self, sides: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """(row, side, same way) for every side across each of `sides`, which lie on edges with 3+ faces."""
        if self.edge_sides is None:
            raise ValueError("no edge of this surface has three faces")
        start, on_edge, edge, sign = self.edge_sides
        count = start[edge[sides] + 1] - start[edge[sides]]
        row, offset = repeat_with_place(np.arange(len(sides)), count)
        neighbour = on_edge[start[edge[sides[row]]] + offset]
        other = neighbour != sides[row]
        row, neighbour = row[other], neighbour[other]
        return row, neighbour, sign[neighbour] == sign[sides[row]]


@dataclass(frozen=True, eq=False)
class WindowTables(SideTables):
    """Side tables, with the vertices around which paths may bend and the angles there.

    Parameters
    ----------
    bends : (n,) ndarray of bool
        Vertices that a shortest path may pass through: saddles, boundary, non-manifold, degenerate.
    angle, turn : (3m,) ndarrays of float64
        Angle at the apex of each side, and where it begins around the apex (counter-clockwise; nan: unknown).
    total_angle : (n,) ndarray of float64
        Angle around each vertex, inf where the faces around it leave a gap.
    around_start, around : ndarrays of int64
        Sides opposite vertex v: around[around_start[v] : around_start[v + 1]].
    """

    bends: NDArray[np.bool_]
    angle: NDArray[np.float64]
    turn: NDArray[np.float64]
    total_angle: NDArray[np.float64]
    around_start: NDArray[np.int64]
    around: NDArray[np.int64]

    @property
    def n_vertices(self) -> int:
        return len(self.bends)


def side_tables(mesh: SurfaceMesh) -> SideTables:
    """Shapes and neighbours of the sides, on any surface: open, non-manifold, not oriented, degenerate."""
    topology = mesh.topology
    scale, faces = component_scales(mesh), topology.faces
    shape = side_shapes(mesh, scale.take(faces[:, 0]), np.empty((mesh.n_faces, 3, 5)))
    code, mirrored, edge_sides = sides_across(topology)
    ids = np.empty((len(shape), 5), dtype=np.int64)
    columns = faces, faces[:, NEXT], faces[:, PREVIOUS], code[:, PREVIOUS], code[:, NEXT]
    for number, column in enumerate(columns):
        ids[:, number] = column.ravel()
    return SideTables(shape, ids, mirrored, edge_sides, code is topology.side_twin, scale)


def window_tables(mesh: SurfaceMesh) -> WindowTables:
    """Constants of the sides of a surface of any topology, for the propagation of windows.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    WindowTables
    """
    sides, topology, n = side_tables(mesh), mesh.topology, mesh.n_vertices
    shape, ids = sides.shape, sides.ids
    angle = corner_angle(shape[:, 0].reshape(-1, 3))
    bends, inaccurate = _bends(topology, shape, angle)
    turn, total = np.full(angle.shape, np.nan), np.full(n, np.inf)
    if sides.plain:
        turn, total = corner_turns(topology, angle, np.flatnonzero(topology.referenced_vertex & ~inaccurate))
    start, around = group_by_key(ids[:, 2], np.arange(len(ids)), n)
    return WindowTables(
        shape,
        ids,
        sides.mirrored,
        sides.edge_sides,
        sides.plain,
        sides.scale,
        bends,
        angle[:, PREVIOUS].ravel(),
        turn[:, PREVIOUS].ravel(),
        total,
        start,
        around,
    )


def incoming_directions(tables: WindowTables, side: NDArray, crossing: NDArray) -> NDArray[np.float64]:
    """Directions back along paths that reach apexes, as angles around them.

    Parameters
    ----------
    tables : WindowTables
    side, crossing : (k,) ndarray
        As in `Wavefront.improve`.

    Returns
    -------
    (k,) ndarray of float64
        In radians; nan if unknown.
    """
    side = np.where(side < -1, -2 - side, side)
    _, ax, ay, _, _ = tables.shape.take(side, axis=0).T
    angle = tables.turn.take(side) + np.arctan2(ay * crossing, ay * ay - ax * (crossing - ax))
    angle[side < 0] = np.nan
    return angle


def component_scales(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Power of two above the longest side of each component and at most twice it, which scales exactly.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (n,) ndarray of float64
        On the vertices of the components; 1 where no side is longer than 0, and at vertices of no face.
    """
    topology = mesh.topology
    longest = np.zeros(topology.n_components + 1)  # the last one of vertices of no face
    if topology.n_components == 1:
        longest[0] = mesh.side_length.max()
    else:
        np.maximum.at(longest, topology.face_component, mesh.side_length.max(axis=1, initial=0.0))
    scale = np.where(longest > 0, 2.0 ** np.frexp(longest)[1], 1.0)
    return scale.take(topology.vertex_component)


def side_shapes(mesh: SurfaceMesh, scale: float | NDArray, shape: NDArray) -> NDArray[np.float64]:
    """Shapes of faces in the frames of their sides: length, apex, lengths of both other sides.

    They are computed in blocks of faces that fit in the cache.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    scale : float or (m,) ndarray of float64
        Of all faces or of each; lengths are divided by it.
    shape : (m, 3, c) ndarray of float64
        Array to write to; its first c columns of `SideTables.shape`.

    Returns
    -------
    (3m, c) ndarray of float64
        The same memory by sides.

    Notes
    -----
    Heights come from cross products where the mesh has positions: lengths alone give the height of a cap only
    to the square root of rounding.
    """
    unit = np.broadcast_to(scale, mesh.n_faces)
    for start in range(0, mesh.n_faces, BLOCK):
        block = slice(start, start + BLOCK)
        length = mesh.side_length[block].T / unit[block]
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = _apexes(mesh, block, length, unit[block])
        flat = ~(length > 0)
        right, left = length[NEXT], length[PREVIOUS]
        np.copyto(x, 0.0, where=flat)
        np.copyto(y, left, where=flat)
        for column, value in zip(range(shape.shape[2]), (length, x, y, left, right)):
            shape[block, :, column] = value.T
    return shape.reshape(-1, shape.shape[2])


def _apexes(mesh: SurfaceMesh, block: slice, length: NDArray, scale: NDArray) -> tuple[NDArray, NDArray]:
    """(3, k) x and y of the apex over each side of a block of faces; not finite over sides without length."""
    if not isinstance(mesh, TriangleMesh):
        right, left = length[NEXT], length[PREVIOUS]
        x = 0.5 * (length + (left - right) * ((left + right) / length))
        return x, 2.0 * face_area(length.T) / length
    corner = mesh.points.take(mesh.faces[block].T.ravel(), axis=0).reshape(3, -1, 3)
    side = [np.ascontiguousarray((corner[(j + 1) % 3] - corner[j]).T) / scale for j in range(3)]
    (ax, ay, az), (bx, by, bz) = side[:2]
    normal = np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
    dot = [-(side[j] * side[(j + 2) % 3]).sum(axis=0) for j in range(3)]
    return np.stack(dot) / length, vector_length(normal.T) / length


def sides_across(topology: Topology) -> tuple[NDArray, NDArray | None, tuple | None]:
    """Side across each side of a surface that need not be manifold or oriented.

    Faces with a repeated vertex have no interior: they are left out, so that their two equal sides do not
    fold the surface; their edges still carry paths. Of several faces on the same vertices only one is used.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    code : ndarray of int64
        Side across each side; negative at the boundary and at edges of several faces.
    mirrored : (3m,) ndarray of bool or None
        Sides that run the same way as the side across; None if there are none.
    edge_sides : tuple or None
        Ragged lists of the sides of each edge; None if every edge has two sides at most.
    """
    if topology.gluing is not None:
        return topology.gluing, None, None
    faces = topology.faces
    collapsed = (faces == faces[:, NEXT]).any(axis=1)
    plain = topology.is_oriented and not len(topology.nonmanifold_edges) and not collapsed.any()
    if plain:
        return topology.side_twin, None, None
    collapsed |= _repeated(topology)
    edge, sign = topology.side_edge.ravel(), topology.side_sign.ravel()
    valid_sides = np.flatnonzero(np.repeat(~collapsed, 3))
    order = valid_sides[np.argsort(edge[valid_sides], kind="stable")]
    count = np.bincount(edge[valid_sides], minlength=topology.n_edges)
    start = list_starts(count)
    code = np.full(len(edge), BOUNDARY, dtype=np.int64)
    pair = start[:-1][count == 2]
    first, second = order[pair], order[pair + 1]
    code[first], code[second] = second, first
    many = valid_sides[count[edge[valid_sides]] > 2]
    code[many] = -2 - many
    mirrored = np.zeros(len(edge), dtype=bool)
    twofold = np.flatnonzero(code >= 0)
    mirrored[twofold] = sign[twofold] == sign[code[twofold]]
    return (
        code.reshape(-1, 3),
        mirrored if mirrored.any() else None,
        (start, order, edge, sign) if len(many) else None,
    )


def _repeated(topology: Topology) -> NDArray[np.bool_]:
    """(m,) True for faces whose three vertices an earlier face has already."""
    repeated = np.zeros(topology.n_faces, dtype=bool)
    suspects = np.flatnonzero((topology.edge_face_count[topology.side_edge] > 1).all(axis=1))
    _, first = np.unique(np.sort(topology.faces[suspects], axis=1), axis=0, return_index=True)
    repeated[suspects] = True
    repeated[suspects[first]] = False
    return repeated


def _bends(topology: Topology, shape: NDArray, angle: NDArray) -> tuple[NDArray, NDArray]:
    """(n,) vertices that shortest paths may pass through, and vertices whose angles are inaccurate."""
    faces = topology.faces
    total = sum_by_index(faces, angle, topology.n_vertices)
    bends = total > FLAT_ANGLE
    bends |= topology.boundary_vertex
    bends[topology.edges[topology.nonmanifold_edges]] = True
    inaccurate = np.zeros(len(bends), dtype=bool)
    length, height = shape[:, 0].reshape(-1, 3).T, shape[:, 2].reshape(-1, 3).T
    low, long = (reduce(least, values) for least, values in ((np.minimum, height), (np.maximum, length)))
    inaccurate[faces[~(low > 1e-8 * long)]] = True
    bends |= inaccurate
    bends[_pinched(topology, np.flatnonzero(~bends & topology.referenced_vertex))] = True
    return bends, inaccurate


def _pinched(topology: Topology, suspects: NDArray) -> NDArray[np.int64]:
    """Inner vertices among `suspects` whose faces form several fans."""
    if "nonmanifold_vertices" in vars(topology) or not topology.is_oriented:
        return topology.nonmanifold_vertices
    around = topology.side_twin[:, PREVIOUS].ravel()  # the next corner of the same vertex, counter-clockwise
    corner = np.empty(topology.n_vertices, dtype=np.int64)
    corner[topology.faces.ravel()] = np.arange(len(around))
    n_remaining = np.bincount(topology.faces.ravel(), minlength=topology.n_vertices)[suspects]
    first = here = corner[suspects]
    pinched = [suspects[:0]]
    while len(suspects):
        here, n_remaining = around[here], n_remaining - 1
        closed = here == first
        pinched.append(suspects[closed & (n_remaining > 0)])
        open_ = ~closed
        suspects, first, here, n_remaining = suspects[open_], first[open_], here[open_], n_remaining[open_]
    return np.concatenate(pinched)
