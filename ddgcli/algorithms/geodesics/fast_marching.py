"""Fast marching on triangles, in batches: approximate distance on any triangulation.

A stencil is a triangle (a, b, c) that updates the distance of c from those of a and b. Where a face is obtuse
at c, the update is not monotone, so the faces beyond the opposite side are unfolded until a vertex falls into
the sector in which both halves are acute (R. Kimmel, J. Sethian, "Computing geodesic paths on manifolds",
1998). Vertices are processed in buckets of distance instead of one by one; each bucket runs until nothing in
it improves. So c may be nearer than a or b, as happens next to a source; on a flat piece the result is then
still the straight line (requiring c to be farthest would cost some percent of accuracy on the first edges).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.curve_wavefronts import CurveWavefronts, curve_wavefronts
from ddgcli.algorithms.geodesics.exact.tables import BOUNDARY, component_scales, side_shapes, sides_across
from ddgcli.algorithms.geodesics.near_points import near_distances
from ddgcli.algorithms.geodesics.sources import Sources, VertexDistances, check_sources, corner_distance
from ddgcli.errors import MeshError, SolveError
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import list_starts, sorted_keys
from ddgcli.mesh.sides import next_side
from ddgcli.mesh.topology import NEXT, PREVIOUS

MAX_UNFOLDED_FACES = 30
BUCKET_WIDTH = 1.5  # in mean side lengths
MAX_ROUNDS_PER_VERTEX = 20  # known meshes need less than one


@dataclass(frozen=True, eq=False)
class Stencils:
    """Triangles (a, b, c) that update the distance of c, in frames with a at the origin and b at (length, 0).

    Parameters
    ----------
    corner : (k, 3) ndarray of int64
        a, b, c; a = b for a straight path along an edge.
    shape : (k, 5) ndarray of float64
        length of ab, c's x and y (y > 0), lengths of ac and bc; divided by `scale`. Length 0 means
        the paths from a and b to c alone.
    start, at, apex : ndarrays of int64
        Stencils that use vertex v as a or b: at[start[v] : start[v + 1]], and the c of each of them.
    mean_side : float
        Mean side length of the triangulation, divided by `scale`.
    longest : float
        Longest ac, divided by `scale`.
    scale : (n,) ndarray of float64
        Scale of each component, on its vertices: scaled lengths are about 1.

    Notes
    -----
    Every edge carries a path in both directions: from a to c in each stencil, against the sides of its face.
    """

    corner: NDArray[np.int64]
    shape: NDArray[np.float64]
    start: NDArray[np.int64]
    at: NDArray[np.int64]
    apex: NDArray[np.int64]
    mean_side: float
    longest: float
    scale: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FastMarchingDistance(VertexDistances):
    """Distances by fast marching.

    Parameters
    ----------
    rounds, updates : int
        Number of rounds and of stencil updates.
    stencils : Stencils
    """

    rounds: int
    updates: int
    stencils: Stencils


def fast_marching_stencils(mesh: SurfaceMesh) -> Stencils:
    """Stencils of a surface for fast marching: one for each acute corner, two for each obtuse one.

    They are those of the intrinsic Delaunay triangulation if it exists: it has fewer obtuse corners and
    shorter edges, which needs fewer unfoldings and lowers the error. On other surfaces (edges with three
    faces, mixed orientation) they are those of the mesh itself. Flipped edges still carry straight paths,
    so that no distance is longer than a path along edges.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    Stencils
    """
    triangulation, flipped_sides = _delaunay_if_surface(mesh)
    scale, (across, mirrored, _) = component_scales(triangulation), sides_across(triangulation.topology)
    code, faces = across.ravel(), triangulation.faces
    face_scale = scale.take(faces[:, 0])
    # sides without a side across in opposite direction: their own stencils only run against them
    lone = (code <= BOUNDARY if mirrored is None else (code <= BOUNDARY) | mirrored).nonzero()[0]
    length = triangulation.side_length / face_scale[:, None]
    obtuse = _obtuse(length)
    # rows: straight ones, one for each side, and one more for each obtuse corner with an unfolding
    first, last = len(flipped_sides) + len(lone), len(flipped_sides) + len(lone) + length.size
    corner = np.empty((last + len(obtuse), 3), dtype=np.int64)
    shape = np.empty((last + len(obtuse), 5))
    _straight(corner[: len(flipped_sides)], shape[: len(flipped_sides)], mesh, flipped_sides, scale)
    _straight(
        corner[len(flipped_sides) : first], shape[len(flipped_sides) : first], triangulation, lone, scale
    )
    of_sides, shapes = corner[first:last], shape[first:last]
    for k, column in enumerate((faces, faces[:, NEXT], faces[:, PREVIOUS])):
        of_sides.reshape(-1, 3, 3)[:, :, k] = column
    side_shapes(triangulation, face_scale, shapes.reshape(-1, 3, 5))
    row, vertex, where = _unfolded(of_sides, shapes, code, mirrored, obtuse)
    side, rows = obtuse.take(row), last + len(row)
    corner[last:rows] = of_sides.take(side, axis=0)
    corner[last:rows, 0] = of_sides[side, 1] = vertex
    shapes[side], shape[last:rows] = _halves(shapes.take(side, axis=0), where)
    corner, shape = corner[:rows], shape[:rows]
    shape[_collapsed(corner), 0] = 0.0
    start, at = _users(corner, first, mesh.n_vertices)
    apex, longest = corner[:, 2].take(at), float(shape[:, 3].max(initial=0.0))
    return Stencils(corner, shape, start, at, apex, float(length.mean()), longest, scale)


def _collapsed(corner: NDArray) -> NDArray[np.bool_]:
    """Triangles with a repeated vertex: only their edges carry distance."""
    a, b, c = corner.T
    return (a == b) | (a == c) | (b == c)


def _obtuse(length: NDArray) -> NDArray[np.int64]:
    """Sides opposite obtuse corners."""
    square = length * length
    half = 0.5 * (1 + 1e-12) * (square[:, 0] + square[:, 1] + square[:, 2])
    return (square > half[:, None]).ravel().nonzero()[0]


def _straight(corner: NDArray, shape: NDArray, mesh: SurfaceMesh, side: NDArray, scale: NDArray) -> None:
    """Fill in stencils along sides of a mesh, from tail to head."""
    corner[:, 0] = corner[:, 1] = mesh.faces.ravel().take(side)
    corner[:, 2] = mesh.faces.ravel().take(next_side(side))
    shape[:, :3] = 0.0
    shape[:, 3] = shape[:, 4] = mesh.side_length.ravel().take(side) / scale.take(corner[:, 0])


def _users(corner: NDArray, n_straight: int, n_vertices: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Stencils that use vertex v: at[start[v] : start[v + 1]]; the first ones are straight, of one vertex."""
    vertex = np.concatenate([corner[:n_straight, 0], corner[n_straight:, :2].ravel()])
    start = list_starts(np.bincount(vertex, minlength=n_vertices))
    _, place = sorted_keys(vertex, n_vertices, overwrite=True)
    straight = np.flatnonzero(place < n_straight)
    alone = place.take(straight)
    place += n_straight  # places n + 2k and n + 2k + 1, after n straight ones: of stencil n + k
    place >>= 1
    place[straight] = alone
    return start, place


def _delaunay_if_surface(mesh: SurfaceMesh) -> tuple[SurfaceMesh, NDArray[np.int64]]:
    """Triangulation for fast marching, and the sides of `mesh` whose edges are not in it."""
    from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay

    try:
        flipped = flip_to_delaunay(mesh, list_flipped=True)
    except MeshError:
        return mesh, np.zeros(0, dtype=np.int64)
    return flipped.mesh, flipped.flipped_sides


def _halves(shape: NDArray, where: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shapes of the stencils (a, w, c) and (w, b, c), w at the places `where` in the frames of ab."""
    length, x, y, left, right = shape.T
    apex = x + 1j * y
    middle = np.abs(where - apex)
    halves = []
    for p, q, from_p, from_q in ((0.0, where, left, middle), (where, length, middle, right)):
        size = np.abs(q - p)
        to = (apex - p) * np.conj(q - p) / size
        halves.append(np.stack([size, to.real, np.abs(to.imag), from_p, from_q], axis=1))
    return halves[0], halves[1]


def _unfolded(
    corner: NDArray, shape: NDArray, across: NDArray, mirrored: NDArray | None, obtuse: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """For sides opposite obtuse corners: a vertex beyond them that forms two acute halves, and its position.

    Returns (row of `obtuse`, vertex, position in the side's frame as a complex number) where it exists;
    unfolding stops at the boundary, at edges with three faces, and after MAX_UNFOLDED_FACES faces.
    """
    length, x, y = shape.take(obtuse, axis=0).T[:3]
    apex = x + 1j * y
    # the sector beyond the side: at most right angles to both arms at the apex
    arm_a, arm_b = -apex, length - apex
    row, p, q = np.arange(len(obtuse)), np.zeros(len(obtuse), dtype=complex), length + 0j
    side, flip = obtuse, np.zeros(len(obtuse), dtype=bool)  # flip: the face was entered mirrored
    hits: list[tuple[NDArray, NDArray, NDArray]] = []
    for _ in range(MAX_UNFOLDED_FACES):
        code = across.take(side)
        if mirrored is not None:
            flip = flip ^ mirrored.take(side)
        go = (code > BOUNDARY).nonzero()[0]
        row, p, q, code, flip = (array.take(go) for array in (row, p, q, code, flip))
        if not len(row):
            break
        # face of side `code` below the segment p -> q; its own frame runs q -> p, or p -> q where mirrored
        size, x, y = shape.take(code, axis=0).T[:3]
        place = p + (np.where(flip, x, size - x) - 1j * y) * (q - p) / size
        to = place - apex.take(row)
        a, b = arm_a.take(row), arm_b.take(row)
        near_a = to.real * a.real + to.imag * a.imag >= 0
        near_b = to.real * b.real + to.imag * b.imag >= 0
        inside = (near_a & near_b & (y > 0)).nonzero()[0]
        hits.append((row.take(inside), corner.take(code.take(inside), axis=0)[:, 2], place.take(inside)))
        # too near the arm to a: the sector leaves by the side towards b, and vice versa
        on = ((near_a ^ near_b) & (y > 0)).nonzero()[0]
        row, code, flip, towards_q, place = (array.take(on) for array in (row, code, flip, near_a, place))
        p, q = np.where(towards_q, place, p.take(on)), np.where(towards_q, q.take(on), place)
        # leaving (q -> p frame): towards q by (v0, apex), towards p by (apex, v1); the other way if mirrored
        face, j = np.divmod(code, 3)
        side = 3 * face + (j + np.where(towards_q != flip, 2, 1)) % 3
    rows, vertices, places = (np.concatenate(array) for array in zip(*hits)) if hits else (row, row, p)
    return rows, vertices, places


def fast_marching_distance(
    mesh: SurfaceMesh,
    sources: Sources | NDArray | list[int] | int,
    *,
    stencils: Stencils | None = None,
    planar: bool = False,
) -> FastMarchingDistance:
    """Distance to the nearest source by fast marching.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    sources : Sources, vertex index or array of vertex indices
    stencils : Stencils, optional
        `fast_marching_stencils(mesh)`, shared by several calls.
    planar : bool
        Wavefronts are straight lines, as published (first order). Default: circles around an unfolded point
        source, and straight lines beside straight pieces of a curve, which are exact on flat pieces visible
        from the source.

    Returns
    -------
    FastMarchingDistance

    References
    ----------
    KimmelSethian1998 in docs/references.bib.
    """
    sources = check_sources(mesh, sources)
    stencils = stencils or fast_marching_stencils(mesh)
    starts, number = sources.at_vertices(mesh)
    wavefronts = curve_wavefronts(mesh, sources, number) if sources.n_curves else None
    number = number if wavefronts is None else wavefronts.source
    solver = _FastMarching(
        stencils, mesh.n_vertices, store_sources=len(number) > 1, planar=planar, wavefronts=wavefronts
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex, value, start = _first_values(mesh, starts, stencils.scale)
        solver.lower(vertex, value, start if solver.store_sources else None)
        solver.run()
    nearest = np.where(np.isfinite(solver.distance), number[solver.source], -1)
    return FastMarchingDistance(
        solver.distance * stencils.scale, nearest, solver.rounds, solver.updates, stencils
    )


def _first_values(mesh: SurfaceMesh, sources: Sources, scale: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Vertices at and around the sources, their straight distances, and their sources."""
    points, k = sources.points, len(sources.vertex)
    length = mesh.side_length[points.face] / scale[mesh.faces[points.face, :1]]
    reach = corner_distance(length, points.barycentric)
    near, distance, point = near_distances(mesh, points)
    vertex = np.concatenate([sources.vertex, mesh.faces[points.face].ravel(), near])
    value = np.concatenate([np.zeros(k), reach.ravel(), distance / scale.take(near)])
    own = np.repeat(k + np.arange(len(points)), 3)
    return vertex, value, np.concatenate([np.arange(k), own, k + point])


class _FastMarching:
    """Upper bounds of the distances, and the vertices whose change has not been propagated.

    `source` is the nearest start of each vertex (`CurveWavefronts`, where sources are curves).
    """

    def __init__(
        self,
        stencils: Stencils,
        n: int,
        *,
        store_sources: bool,
        planar: bool,
        wavefronts: CurveWavefronts | None,
    ) -> None:
        self.stencils, self.local_update = stencils, _planar_update if planar else circular_update
        self.distance = np.full(n, np.inf)
        self.store_sources, self.source = store_sources, np.zeros(n, dtype=np.int64)
        self.wavefronts = wavefronts
        self.queued = np.zeros(n, dtype=bool)
        self.bucket, self.square = BUCKET_WIDTH * stencils.mean_side, stencils.longest**2
        self.stop, self.count = stencils.start[1:], np.diff(stencils.start)
        self.number = np.arange(4096)
        self.rounds = self.updates = 0

    def lower(self, vertex: NDArray, value: NDArray, source: NDArray | None) -> None:
        """Lower distances (and store their sources if `store_sources`); queue the vertices."""
        np.minimum.at(self.distance, vertex, value)
        self.queued[vertex] = True
        if source is not None:
            won = (value == self.distance.take(vertex)).nonzero()[0]
            vertex, source = vertex.take(won), source.take(won)
            self.source[vertex] = np.iinfo(np.int64).max
            np.minimum.at(self.source, vertex, source)  # of sources at equal distances the first

    def run(self) -> None:
        """Propagate, nearest bucket first, until the queue is empty."""
        while True:
            vertex = self.queued.nonzero()[0]
            if not len(vertex):
                return
            value = self.distance.take(vertex)
            least = float(np.minimum.reduce(value))
            now = (value < max(least + self.bucket, math.nextafter(least, math.inf))).nonzero()[0]
            vertex = vertex.take(now)
            self.queued[vertex] = False
            self.rounds += 1
            if self.rounds > MAX_ROUNDS_PER_VERTEX * (1000 + len(self.distance)):
                raise SolveError("fast marching does not converge on this mesh; use `method=exact`")
            self._propagate(vertex, value.take(now))

    def _propagate(self, vertex: NDArray, value: NDArray) -> None:
        """Update vertices by all stencils with the given vertices, except those that cannot change.

        A line through ab reaches c at an angle to ca that is at most right, so that a is farther than c by
        |ca|^2 / (2 |c|) at most.
        """
        stencils, count = self.stencils, self.count.take(vertex)
        ahead = count.cumsum()
        if ahead[-1] > len(self.number):
            self.number = np.arange(2 * ahead[-1])
        use = (self.stop.take(vertex) - ahead).repeat(count)
        use += self.number[: ahead[-1]]
        reached = self.distance.take(stencils.apex.take(use))
        farther = value.repeat(count)
        farther -= reached
        farther *= reached
        may = (farther <= 0.5 * self.square).nonzero()[0]
        k = stencils.at.take(use.take(may))
        corner = stencils.corner.take(k, axis=0)
        da, db, dc = self.distance.take(corner).T
        value_c, source = self._local_values(corner, da, db, stencils.shape.take(k, axis=0).T)
        dc *= 1 - 1e-14  # smaller improvements are rounding
        better = (value_c < dc).nonzero()[0]
        self.updates += len(may)
        source = None if source is None else source.take(better)
        self.lower(corner[:, 2].take(better), value_c.take(better), source)

    def _local_values(
        self, corner: NDArray, da: NDArray, db: NDArray, shape: NDArray
    ) -> tuple[NDArray[np.float64], NDArray[np.int64] | None]:
        """Distances of the third corners by a wavefront that crosses ab, or along ac or bc, and their starts.

        Both ends count, so that values do not depend on the orientation of the face: a value that is too
        large for a while takes part in updates, and wavefronts of other sources do not correct these.
        """
        length, x, y, by_a, by_b = shape
        along, along_b = by_a + da, by_b + db
        by_b_is_less = along_b < along
        along = np.minimum(along, along_b)
        value, cross = self.local_update(da, db, length, x, y)
        if not self.store_sources:
            return np.where((cross >= 0) & (cross <= length), value, along), None
        start, start_b = self.source.take(corner[:, :2]).T
        meets = start == start_b  # wavefronts of two sources form no common circle
        nearest = np.where(by_b_is_less, start_b, start)
        if self.wavefronts is None:
            return np.where(meets & (cross >= 0) & (cross <= length), value, along), nearest
        piece = self.wavefronts.common_piece(start, start_b)
        straight = (piece >= 0).nonzero()[0]
        value[straight], cross[straight] = _planar_update(
            *(array.take(straight) for array in (da, db, length, x, y))
        )
        meets[straight] = value[straight] <= along[straight]  # beside a vertex the wavefront is round
        meets &= (cross >= 0) & (cross <= length)
        return np.where(meets, value, along), np.where(meets & (piece >= 0), piece, nearest)


def circular_update(
    da: NDArray, db: NDArray, length: NDArray, x: NDArray, y: NDArray
) -> tuple[NDArray, NDArray]:
    """Distance of c from the point below side ab that has given distances to a and b.

    Parameters
    ----------
    da, db : (k,) ndarray of float64
        Distances of a and b.
    length : (k,) ndarray of float64
        Length of side ab.
    x, y : (k,) ndarray of float64
        Position of c in the frame of the side.

    Returns
    -------
    distance : (k,) ndarray of float64
    crossing : (k,) ndarray of float64
        Where the ray from the point to c crosses ab, from a.
    """
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
    return np.sqrt(run, out=run), cross


def _planar_update(
    da: NDArray, db: NDArray, length: NDArray, x: NDArray, y: NDArray
) -> tuple[NDArray, NDArray]:
    """Distance of c behind a straight wavefront at a and b, and the crossing of its normal through c with
    ab."""
    along = (db - da) / length
    across = np.sqrt(1.0 - along * along)
    return da + along * x + across * y, x - y * along / across
