"""Fast marching on triangles, in batches: approximate distance that any triangulation can carry (chapter 6).

A stencil is a triangle (a, b, c) that may hand the distances of a and b on to c. Where a face is obtuse at c
no front can be handed on safely, so the faces beyond the opposite side are unfolded until a vertex falls into
the sector in which both halves are acute (R. Kimmel, J. Sethian, "Computing geodesic paths on manifolds",
1998). Vertices are settled in buckets of distance instead of one by one; each bucket runs until nothing
in it improves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from ddgcli.algorithms.distance.sources import Sources, checked_sources, face_frame
from ddgcli.algorithms.distance.window_tables import BOUNDARY, SideTables, side_tables
from ddgcli.errors import MeshError
from ddgcli.mesh.topology import NEXT
from ddgcli.operators.laplacian import SurfaceMesh

MOST_UNFOLDINGS = 30
BUCKET = 1.5  # mean sides settled together


@dataclass(frozen=True, eq=False)
class Stencils:
    """Triangles (a, b, c) by which distance reaches c, seen with a at the origin and b at (length, 0).

    Parameters
    ----------
    corner : (k, 3) ndarray of int64
        a, b, c.
    shape : (k, 5) ndarray of float64
        length of ab, c's x and y (y > 0), lengths of ac and bc; divided by `scale`. All zero but for the last
        two where a = b: a straight path along an edge.
    start, at : ndarrays of int64
        Stencils that use vertex v as a or b: at[start[v] : start[v + 1]].
    scale : float
    """

    corner: NDArray[np.int64]
    shape: NDArray[np.float64]
    start: NDArray[np.int64]
    at: NDArray[np.int64]
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
    triangulation = _delaunay_if_surface(mesh)
    tables = side_tables(triangulation)
    length, x, y, left, right = tables.shape.T
    obtuse = np.flatnonzero(length**2 > (left**2 + right**2) * (1 + 1e-12))
    row, vertex, where = _unfolded(tables, obtuse)
    side = obtuse[row]
    a, b, c = tables.ids[side, :3].T
    apex = np.stack([x[side], y[side]], axis=1)
    zero, end = np.zeros_like(where), np.stack([length[side], np.zeros(len(side))], axis=1)
    keep = np.ones(len(length), dtype=bool)
    keep[side] = False
    corner = np.concatenate(
        [tables.ids[keep, :3], np.stack([a, vertex, c], axis=1), np.stack([vertex, b, c], axis=1)]
    )
    shape = np.concatenate(
        [tables.shape[keep], _stencil_shape(zero, where, apex), _stencil_shape(where, end, apex)]
    )
    a, b, c = corner.T
    sound = (a != b) & (b != c) & (c != a)
    ends, length = _flipped_away(mesh, triangulation)
    length = length / tables.scale
    if not sound.all():  # of a triangle that has a vertex twice only the edges are left
        a, b, c = corner[~sound].T
        ends = np.concatenate([ends, np.stack([a, c], axis=1), np.stack([b, c], axis=1)])
        length = np.concatenate([length, shape[~sound, 3], shape[~sound, 4]])
        corner, shape = corner[sound], shape[sound]
    k = np.concatenate([np.arange(len(corner) + len(ends)), np.arange(len(corner))])
    corner = np.concatenate([corner, ends[:, [0, 0, 1]]])
    shape = np.concatenate([shape, length[:, None] * [0, 0, 0, 1, 1]])
    vertex = np.concatenate([corner[:, 0], corner[: len(k) - len(corner), 1]])
    user = coo_array((k, (vertex, k)), shape=(mesh.n_vertices, max(len(corner), 1))).tocsr()
    return Stencils(corner, shape, user.indptr.astype(np.int64), user.indices.astype(np.int64), tables.scale)


def _delaunay_if_surface(mesh: SurfaceMesh) -> SurfaceMesh:
    from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay

    try:
        return flip_to_delaunay(mesh).mesh
    except MeshError:
        return mesh


def _flipped_away(mesh: SurfaceMesh, now: SurfaceMesh) -> tuple[NDArray, NDArray]:
    """(l, 2) ends and (l,) lengths of the sides of `mesh` between vertices that no side of `now` joins."""
    changed = (mesh.faces != now.faces).any(axis=1).nonzero()[0]
    before, after = (
        np.stack([m.faces[changed].ravel(), m.faces[changed][:, NEXT].ravel()]) for m in (mesh, now)
    )
    keys = [ends.min(axis=0) * mesh.n_vertices + ends.max(axis=0) for ends in (before, after)]
    lost = ~np.isin(*keys)
    return before[:, lost].T, mesh.side_length[changed].ravel()[lost]


def _stencil_shape(p: NDArray, q: NDArray, apex: NDArray) -> NDArray[np.float64]:
    edge = q - p
    length = np.hypot(edge[:, 0], edge[:, 1])
    unit = edge / length[:, None]
    to = apex - p
    x = np.einsum("kd,kd->k", to, unit)
    y = np.abs(unit[:, 0] * to[:, 1] - unit[:, 1] * to[:, 0])
    far = apex - q
    return np.stack([length, x, y, np.hypot(to[:, 0], to[:, 1]), np.hypot(far[:, 0], far[:, 1])], axis=1)


def _unfolded(tables: SideTables, obtuse: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """For sides opposite obtuse corners: the vertex beyond that makes two acute halves, and its place.

    Returns (row of `obtuse`, vertex, (k, 2) place in the side's frame) where unfolding met one; it stops at
    the boundary, at edges of three faces, and after MOST_UNFOLDINGS faces.
    """
    length, ax, ay = tables.shape[obtuse, :3].T
    apex = np.stack([ax, ay], axis=1)
    # the sector beyond the side: at right angles or less to both arms, seen from the apex
    arm_a, arm_b = -apex, np.stack([length - ax, -ay], axis=1)
    row = np.arange(len(obtuse))
    p, q = np.zeros((len(row), 2)), np.stack([length, np.zeros(len(row))], axis=1)
    code, mirrored = _across(tables, obtuse)
    found: list[tuple[NDArray, NDArray, NDArray]] = []
    for _ in range(MOST_UNFOLDINGS):
        go = code > BOUNDARY
        row, p, q, code, mirrored = row[go], p[go], q[go], code[go], mirrored[go]
        if not len(row):
            break
        # face of side `code` below the segment p -> q; its own frame runs q -> p, or p -> q where mirrored
        size, x, y = tables.shape[code, :3].T
        from_p = np.where(mirrored, x, size - x)
        unit = (q - p) / np.hypot(*(q - p).T)[:, None]
        place = p + from_p[:, None] * unit + y[:, None] * np.stack([unit[:, 1], -unit[:, 0]], axis=1)
        to = place - apex[row]
        near_a = np.einsum("kd,kd->k", to, arm_a[row]) >= 0
        near_b = np.einsum("kd,kd->k", to, arm_b[row]) >= 0
        inside = near_a & near_b & (y > 0)
        vertex = tables.ids[code, 2]
        found.append((row[inside], vertex[inside], place[inside]))
        # too near the arm to a: the sector leaves by the side towards b, and the other way round
        on = np.flatnonzero(~inside & (near_a | near_b) & (y > 0))
        towards_q = near_a[on]
        p, q = (
            np.where(towards_q[:, None], place[on], p[on]),
            np.where(towards_q[:, None], q[on], place[on]),
        )
        # leaving (q -> p frame): towards q by (v0, apex), towards p by (apex, v1); the other way if mirrored
        first = towards_q != mirrored[on]
        face, j = np.divmod(code[on], 3)
        left_by = 3 * face + (j + np.where(first, 2, 1)) % 3
        flip = mirrored[on]
        row = row[on]
        code, mirrored = _across(tables, left_by)
        mirrored = mirrored ^ flip
    if not found:
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros((0, 2))
    rows, vertices, places = (np.concatenate(part) for part in zip(*found))
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
    march = _March(stencils, mesh.n_vertices, planar)
    with np.errstate(divide="ignore", invalid="ignore"):
        march.lower(*_first_values(mesh, sources, stencils.scale))
        march.run()
    return MarchedDistance(march.distance * stencils.scale, march.source, march.rounds, march.updates)


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

    def __init__(self, stencils: Stencils, n: int, planar: bool) -> None:
        self.stencils, self.wave = stencils, _plane if planar else _circle
        self.distance = np.full(n, np.inf)
        self.source = np.full(n, -1, dtype=np.int64)
        self.told = np.full(n, np.inf)  # the distance that was last handed on
        self.waiting = np.zeros(0, dtype=np.int64)
        self.bucket = BUCKET * float(stencils.shape[:, 3].mean()) if len(stencils.shape) else 1.0
        self._place = np.zeros(n, dtype=np.int64)
        self.rounds = self.updates = 0

    def lower(self, vertex: NDArray, value: NDArray, source: NDArray | int) -> None:
        """Lower distances; those that fall by more than rounding wait to be handed on."""
        better = (value < self.distance.take(vertex) * (1 - 1e-14)).nonzero()[0]
        vertex, value = vertex.take(better), value.take(better)
        np.minimum.at(self.distance, vertex, value)
        won = (value == self.distance.take(vertex)).nonzero()[0]
        vertex = vertex.take(won)
        self.source[vertex] = source.take(better.take(won)) if isinstance(source, np.ndarray) else source
        self.waiting = np.concatenate([self.waiting, vertex])

    def run(self) -> None:
        """Hand on, nearest bucket first, until nothing waits."""
        several = self.source.max(initial=-1) > 0
        while len(self.waiting):
            value = self.distance.take(self.waiting)
            fresh = (value < self.told.take(self.waiting)).nonzero()[0]
            if not len(fresh):
                return
            self.waiting, value = self.waiting.take(fresh), value.take(fresh)
            least = value.min()
            now = value < max(least + self.bucket, np.nextafter(least, np.inf))
            vertex = self._once(self.waiting[now])
            self.waiting = self.waiting[~now]
            self.told[vertex] = self.distance.take(vertex)
            self.rounds += 1
            self._hand_on(vertex, several)

    def _once(self, vertex: NDArray) -> NDArray[np.int64]:
        """The vertices without repetitions."""
        place = np.arange(len(vertex))
        self._place[vertex] = place
        return vertex[self._place.take(vertex) == place]

    def _hand_on(self, vertex: NDArray, several: bool) -> None:
        stencils = self.stencils
        start = stencils.start.take(vertex)
        count = stencils.start.take(vertex + 1) - start
        ahead = count.cumsum()
        k = stencils.at.take(np.arange(ahead[-1]) + (start - ahead + count).repeat(count))
        corner = stencils.corner.take(k, axis=0)
        da, db, dc = self.distance.take(corner).T
        may = (dc > np.minimum(da, db)).nonzero()[0]  # others cannot fall
        corner = corner.take(may, axis=0)
        da, db = da.take(may), db.take(may)
        shape = stencils.shape.take(k.take(may), axis=0).T
        by_a, by_b = da + shape[3], db + shape[4]
        value, wave = np.minimum(by_a, by_b), self.wave(da, db, *shape[:3])
        source: NDArray | int = 0
        if several:
            source_a, source_b, _ = self.source.take(corner).T
            source = np.where(by_a <= by_b, source_a, source_b)
            wave[source_a != source_b] = np.nan  # fronts of two sources make no common circle
        np.fmin(value, wave, out=value)
        self.updates += len(may)
        self.lower(corner[:, 2], value, source)


def _circle(da: NDArray, db: NDArray, length: NDArray, x: NDArray, y: NDArray) -> NDArray[np.float64]:
    """Distance of c from the point below ab at da from a and db from b; nan where its ray misses ab."""
    sx = 0.5 * (length + (da - db) * ((da + db) / length))
    depth = np.sqrt((da - sx) * (da + sx))
    run, rise = x - sx, y + depth
    cross = sx + run * (depth / rise)
    value = np.sqrt(run * run + rise * rise)
    value[~((cross >= 0) & (cross <= length) & (value >= da) & (value >= db))] = np.nan
    return value


def _plane(da: NDArray, db: NDArray, length: NDArray, x: NDArray, y: NDArray) -> NDArray[np.float64]:
    """Distance of c behind a straight front at a and b; nan where its normal through c misses ab."""
    along = (db - da) / length
    across = np.sqrt(1.0 - along * along)
    cross = x - y * along / across
    value = da + along * x + across * y
    value[~((cross >= 0) & (cross <= length) & (value >= da) & (value >= db))] = np.nan
    return value
