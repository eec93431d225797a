"""Fast marching on triangles, in batches: approximate distance that any triangulation can carry (chapter 6).

A stencil is a triangle (a, b, c) that may hand the distances of a and b on to c. Where a face is obtuse at c
no front can be handed on safely, so the faces beyond the opposite side are unfolded until a vertex falls into
the sector in which both halves are acute (R. Kimmel, J. Sethian, "Computing geodesic paths on manifolds",
1998). Vertices are settled in buckets of distance instead of one by one; each bucket runs until nothing
in it improves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.algorithms.distance.sources import Sources, checked_sources, face_frame
from ddgcli.algorithms.distance.window_tables import BOUNDARY, SideTables, side_tables
from ddgcli.errors import MeshError
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.topology import NEXT

MOST_UNFOLDINGS = 30
BUCKET = 1.5  # mean sides settled together


@dataclass(frozen=True, eq=False)
class Stencils:
    """Triangles (a, b, c) by which distance reaches c, seen with a at the origin and b at (length, 0).

    Parameters
    ----------
    base : (k, 2) ndarray of int64
        a, b; the same twice for a straight path along an edge.
    shape : (k, 5) ndarray of float64
        length of ab, c's x and y (y > 0), lengths of ac and bc; divided by `scale`. All zero but for the last
        two where a = b.
    start, at, apex : ndarrays of int64
        Stencils that use vertex v as a or b: at[start[v] : start[v + 1]], and the c of each of them.
    mean_side : float
        Of the triangulation, divided by `scale`.
    scale : float
    """

    base: NDArray[np.int64]
    shape: NDArray[np.float64]
    start: NDArray[np.int64]
    at: NDArray[np.int64]
    apex: NDArray[np.int64]
    mean_side: float
    scale: float


@dataclass(frozen=True, eq=False)
class MarchedDistance:
    """Distances by fast marching.

    Parameters
    ----------
    distance : (n,) ndarray of float64
        inf where no source reaches.
    nearest_source : (n,) ndarray of int64
        -1 where no source reaches.
    rounds, updates : int
        Work done.
    """

    distance: NDArray[np.float64]
    nearest_source: NDArray[np.int64]
    rounds: int
    updates: int


def marching_stencils(mesh: SurfaceMesh) -> Stencils:
    """Stencils of a surface: one for each acute corner, two for each obtuse one.

    They are those of the intrinsic Delaunay triangulation where there is one: less obtuse and shorter, so
    that few unfoldings are left and the error falls. On other surfaces (three faces on an edge, mixed
    orientation) those of the mesh as it is. Edges that were flipped away still carry straight paths, so that
    no distance is longer than a path along edges.
    """
    triangulation, gone = _delaunay_if_surface(mesh)
    tables = side_tables(triangulation)
    ids, (length, _, _, left, right) = tables.ids, tables.shape.T
    obtuse = (length * length > (left * left + right * right) * (1 + 1e-12)).nonzero()[0]
    row, vertex, where = _unfolded(tables, obtuse)
    side = obtuse.take(row)
    first, second = _halves(tables.shape.take(side, axis=0), where)
    tail, head = (ends.ravel().take(gone) for ends in (mesh.faces, mesh.faces[:, NEXT]))
    straight = np.zeros((len(gone), 5))
    straight[:, 3:] = mesh.side_length.ravel().take(gone)[:, None] / tables.scale
    # an obtuse corner is reached by two stencils: one in the place of its own, one more
    pairs = np.stack([vertex, ids[:, 1].take(side)], axis=1), np.stack([tail, tail], axis=1)
    base = np.concatenate([ids[:, :2], *pairs])
    base[side, 1] = vertex
    apex = np.concatenate([ids[:, 2], ids[:, 2].take(side), head])
    shape = np.concatenate([tables.shape, second, straight])
    shape[side] = first
    a, b = base.T
    # of a triangle that has a vertex twice only the edges are left
    shape[(a == b) | (a == apex) | (b == apex), 1] = np.nan
    start, at = _users(base, len(base) - len(gone), mesh.n_vertices)
    return Stencils(base, shape, start, at, apex.take(at), float(length.mean()), tables.scale)


def _users(base: NDArray, n_triangles: int, n_vertices: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Stencils that use vertex v: at[start[v] : start[v + 1]]; after the triangles come the straight ones."""
    first = np.arange(len(base) + 1)
    first += np.minimum(first, n_triangles)
    vertex = np.empty(first[-1], dtype=np.int32 if first[-1] < 2**31 else np.int64)
    vertex[: 2 * n_triangles], vertex[2 * n_triangles :] = base[:n_triangles].ravel(), base[n_triangles:, 0]
    uses = np.ones(len(vertex), dtype=np.int8), vertex, first.astype(vertex.dtype)
    users = csr_array(uses, shape=(len(base), n_vertices)).tocsc()
    return users.indptr.astype(np.int64), users.indices.astype(np.int64)


def _delaunay_if_surface(mesh: SurfaceMesh) -> tuple[SurfaceMesh, NDArray[np.int64]]:
    """The triangulation to march on, and the sides of `mesh` whose edges it does not have."""
    from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay

    try:
        flipped = flip_to_delaunay(mesh, tell_gone=True)
    except MeshError:
        return mesh, np.zeros(0, dtype=np.int64)
    return flipped.mesh, flipped.gone


def _halves(shape: NDArray, where: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shapes of the stencils (a, w, c) and (w, b, c), w at the places `where` in the frames of ab."""
    length, x, y, left, right = shape.T
    apex, middle = x + 1j * y, np.hypot(where.real - x, where.imag - y)
    halves = []
    for p, q, from_p, from_q in ((0.0, where, left, middle), (where, length, middle, right)):
        size = np.abs(q - p)
        to = (apex - p) * np.conj(q - p) / size
        halves.append(np.stack([size, to.real, np.abs(to.imag), from_p, from_q], axis=1))
    return halves[0], halves[1]


def _unfolded(tables: SideTables, obtuse: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """For sides opposite obtuse corners: the vertex beyond that makes two acute halves, and its place.

    Returns (row of `obtuse`, vertex, place in the side's frame as a complex number) where unfolding met one;
    it stops at the boundary, at edges of three faces, and after MOST_UNFOLDINGS faces.
    """
    length, x, y = tables.shape.take(obtuse, axis=0).T[:3]
    apex = x + 1j * y
    # the sector beyond the side: at right angles or less to both arms, seen from the apex
    arm_a, arm_b = -apex, length - apex
    row, p, q = np.arange(len(obtuse)), np.zeros(len(obtuse), dtype=complex), length + 0j
    code, mirrored = _across(tables, obtuse)
    found: list[tuple[NDArray, NDArray, NDArray]] = []
    for _ in range(MOST_UNFOLDINGS):
        go = (code > BOUNDARY).nonzero()[0]
        row, p, q, code, mirrored = (part.take(go) for part in (row, p, q, code, mirrored))
        if not len(row):
            break
        # face of side `code` below the segment p -> q; its own frame runs q -> p, or p -> q where mirrored
        size, x, y = tables.shape.take(code, axis=0).T[:3]
        place = p + (np.where(mirrored, x, size - x) - 1j * y) * (q - p) / size
        to = place - apex.take(row)
        a, b = arm_a.take(row), arm_b.take(row)
        near_a = to.real * a.real + to.imag * a.imag >= 0
        near_b = to.real * b.real + to.imag * b.imag >= 0
        inside = (near_a & near_b & (y > 0)).nonzero()[0]
        found.append((row.take(inside), tables.ids[:, 2].take(code.take(inside)), place.take(inside)))
        # too near the arm to a: the sector leaves by the side towards b, and the other way round
        on = ((near_a ^ near_b) & (y > 0)).nonzero()[0]
        row, code, flip, towards_q, place = (part.take(on) for part in (row, code, mirrored, near_a, place))
        p, q = np.where(towards_q, place, p.take(on)), np.where(towards_q, q.take(on), place)
        # leaving (q -> p frame): towards q by (v0, apex), towards p by (apex, v1); the other way if mirrored
        face, j = np.divmod(code, 3)
        code, mirrored = _across(tables, 3 * face + (j + np.where(towards_q != flip, 2, 1)) % 3)
        mirrored = mirrored ^ flip
    rows, vertices, places = (np.concatenate(part) for part in zip(*found)) if found else (row, row, p)
    return rows, vertices, places


def _across(tables: SideTables, side: NDArray) -> tuple[NDArray, NDArray]:
    """Side across each side (negative: none, or several), and whether it runs the same way."""
    face, j = np.divmod(side, 3)
    code = tables.ids[3 * face + (j + 1) % 3, 3]
    same = np.zeros(len(side), dtype=bool) if tables.mirrored is None else tables.mirrored[side]
    return code, same


def marched_distance(
    mesh: SurfaceMesh,
    sources: Sources | NDArray | list[int] | int,
    *,
    stencils: Stencils | None = None,
    planar: bool = False,
) -> MarchedDistance:
    """Distance to the nearest source by fast marching.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources, vertex number or array of vertex numbers
    stencils : Stencils, optional
        `marching_stencils(mesh)`, to share among calls.
    planar : bool
        Fronts are straight lines, as published (first order). Default: circles about an unfolded point
        source, which are exact on flat pieces seen from the source.
    """
    sources = checked_sources(mesh, sources)
    stencils = stencils or marching_stencils(mesh)
    march = _March(stencils, mesh.n_vertices, several=len(sources) > 1, planar=planar)
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex, value, number = _first_values(mesh, sources, stencils.scale)
        march.lower(vertex, value, number if len(sources) > 1 else None)
        march.run()
    nearest = np.where(np.isfinite(march.distance), march.source, -1)
    return MarchedDistance(march.distance * stencils.scale, nearest, march.rounds, march.updates)


def _first_values(mesh: SurfaceMesh, sources: Sources, scale: float) -> tuple[NDArray, NDArray, NDArray]:
    """Vertices at and around the sources, their straight distances, and the numbers of the sources."""
    points = sources.points
    frame = face_frame(mesh.side_length[points.face] / scale)
    reach = np.linalg.norm(frame - np.einsum("kc,kcd->kd", points.barycentric, frame)[:, None], axis=2)
    vertex = np.concatenate([sources.vertex, mesh.faces[points.face].ravel()])
    value = np.concatenate([np.zeros(len(sources.vertex)), reach.ravel()])
    k = len(sources.vertex)
    return vertex, value, np.concatenate([np.arange(k), np.repeat(k + np.arange(len(points)), 3)])


class _March:
    """Distances so far, and the vertices whose change has not been handed on."""

    def __init__(self, stencils: Stencils, n: int, *, several: bool, planar: bool) -> None:
        self.stencils, self.wave = stencils, _plane if planar else _circle
        self.distance = np.full(n, np.inf)
        self.several, self.source = several, np.zeros(n, dtype=np.int64)
        self.waiting = np.zeros(n, dtype=bool)
        self.bucket = BUCKET * stencils.mean_side
        self.stop, self.count = stencils.start[1:], np.diff(stencils.start)
        self.number = np.arange(4096)
        self.rounds = self.updates = 0

    def lower(self, vertex: NDArray, value: NDArray, source: NDArray | None) -> None:
        """Lower distances (and note the sources, where there are several); the vertices wait to hand on."""
        np.minimum.at(self.distance, vertex, value)
        won = (value == self.distance.take(vertex)).nonzero()[0]
        vertex = vertex.take(won)
        if source is not None:
            self.source[vertex] = source.take(won)
        self.waiting[vertex] = True

    def run(self) -> None:
        """Hand on, nearest bucket first, until nothing waits."""
        while True:
            vertex = self.waiting.nonzero()[0]
            if not len(vertex):
                return
            value = self.distance.take(vertex)
            least = float(value.min())
            now = (value < max(least + self.bucket, math.nextafter(least, math.inf))).nonzero()[0]
            vertex = vertex.take(now)
            self.waiting[vertex] = False
            self.rounds += 1
            self._hand_on(vertex, value.take(now))

    def _hand_on(self, vertex: NDArray, value: NDArray) -> None:
        """Lower what lies beyond the vertices by the stencils they are in; what is nearer cannot fall."""
        stencils, count = self.stencils, self.count.take(vertex)
        ahead = count.cumsum()
        if ahead[-1] > len(self.number):
            self.number = np.arange(2 * ahead[-1])
        use = (self.stop.take(vertex) - ahead).repeat(count)
        use += self.number[: ahead[-1]]
        apex = stencils.apex.take(use)
        dc = self.distance.take(apex)
        may = (dc > value.repeat(count)).nonzero()[0]
        k, apex, dc = stencils.at.take(use.take(may)), apex.take(may), dc.take(may)
        base = stencils.base.take(k, axis=0)
        da, db = self.distance.take(base).T
        length, x, y, by_a, by_b = stencils.shape.take(k, axis=0).T
        by_a, by_b = by_a + da, by_b + db
        found = self.wave(da, db, length, x, y)
        source = None
        if self.several:
            source_a, source_b = self.source.take(base).T
            source = np.where(by_a <= by_b, source_a, source_b)
            found[source_a != source_b] = np.inf  # fronts of two sources make no common circle
        np.minimum(found, by_a, out=found)
        np.minimum(found, by_b, out=found)
        dc *= 1 - 1e-14  # less is rounding
        better = (found < dc).nonzero()[0]
        self.updates += len(may)
        self.lower(apex.take(better), found.take(better), None if source is None else source.take(better))


def _circle(da: NDArray, db: NDArray, length: NDArray, x: NDArray, y: NDArray) -> NDArray[np.float64]:
    """Distance of c from the point below ab at da from a and db from b; inf where its ray misses ab."""
    sx = da - db
    sx *= da + db
    sx /= length
    sx += length
    sx *= 0.5
    depth = da - sx
    depth *= da + sx
    np.sqrt(depth, out=depth)
    run, rise = x - sx, y + depth
    depth /= rise
    depth *= run
    cross = np.add(depth, sx, out=depth)
    run *= run
    rise *= rise
    run += rise
    return _caused(np.sqrt(run, out=run), cross, da, db, length)


def _plane(da: NDArray, db: NDArray, length: NDArray, x: NDArray, y: NDArray) -> NDArray[np.float64]:
    """Distance of c behind a straight front at a and b; inf where its normal through c misses ab."""
    along = (db - da) / length
    across = np.sqrt(1.0 - along * along)
    cross = x - y * along / across
    return _caused(da + along * x + across * y, cross, da, db, length)


def _caused(value: NDArray, cross: NDArray, da: NDArray, db: NDArray, length: NDArray) -> NDArray[np.float64]:
    """The values, inf where the ray crosses beside ab or c would come before a or b."""
    sound = cross >= 0
    sound &= cross <= length
    sound &= value >= np.maximum(da, db)
    return np.where(sound, value, np.inf)
