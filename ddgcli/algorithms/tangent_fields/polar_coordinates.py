"""Geodesic polar coordinates by fast marching: the logarithmic map in a fraction of the exact one's time.

Where the distance of c comes from the edge ab, it comes from a point source unfolded below that edge, and the
line to c crosses ab between the lines to a and b: c leaves the real source between the directions of a and b
(E. Melvaer, M. Reimers, "Geodesic Polar Coordinates on Polygonal Meshes", 2012). Written as unit numbers the
directions are solutions of a triangular system, in the order of the distances. An error made near the source
is kept along the whole line, so the nearest vertices take the exact directions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve_triangular

from ddgcli.algorithms.geodesics.certificate import face_gradient, shares_by_area
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.fast_marching import FastMarchingDistance, Stencils, circular_update
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.log_map import LogMap, SourceFrame, require_single_source
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh, SurfaceMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh

NEAR = 200  # vertices around the source whose directions are exact
MARGIN = 1.2  # marched distances near the source are off by less
SKEW = 0.1  # a source unfolded closer to ab than this share of its distance to a and b tells no directions


def fast_marching_log_map(mesh: SurfaceMesh, marched: FastMarchingDistance, sources: Sources) -> LogMap:
    """Logarithmic map of one source at all vertices, by fast marching.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented.
    marched : FastMarchingDistance
        From that source, on this mesh or one with the same vertices and metric.
    sources : Sources
        One vertex or surface point.

    Returns
    -------
    LogMap
        Sizes are the marched distances. Without `miss`; `skew` tells how far the directions are from
        geodesic polar coordinates.
    """
    require_single_source(sources)
    distance, far = marched.distance, ~np.isfinite(marched.distance)
    radius = _radius(marched, sources, mesh)
    face, near, at = _near_part(mesh, distance <= MARGIN * radius, sources)
    centre = SourceFrame(Tracer(near), at)
    exact = exact_distance(near, at, limit=radius, directions=True)
    known = np.flatnonzero((exact.distance > 0) & (exact.distance <= radius) & ~far)
    start = np.exp(1j * centre.scale * np.asarray(exact.departure)[known])
    unit = _handed_on(marched.stencils, distance, known, start)
    mapped = np.where(far, 0.0, distance) * unit
    coordinates = np.stack([mapped.real, mapped.imag], axis=1)
    coordinates[far] = np.inf
    axis = centre.axis()
    if "face" in axis:
        axis["face"] = int(face[axis["face"]])
    return LogMap(coordinates, axis, skew=_skew(mesh, distance, unit))


def _radius(marched: FastMarchingDistance, sources: Sources, mesh: SurfaceMesh) -> float:
    """Distance within which directions are to be exact: that of the NEAR-th vertex.

    More where the source's own edges reach farther: what comes from the source itself has no parents.
    """
    stencils, distance = marched.stencils, marched.distance
    reached = distance[np.isfinite(distance)]
    k = min(NEAR, len(reached) - 1)
    radius = float(np.partition(reached, k)[k])
    ends = mesh.faces[sources.points.face].ravel()
    for v in np.append(sources.vertex, ends[distance[ends] == 0]):
        row = stencils.at[stencils.start[v] : stencils.start[v + 1]]
        c, edge = stencils.corner[row, 2], stencils.shape[row, 3] * stencils.scale
        direct = (stencils.corner[row, 0] == v) & (distance[c] >= edge * (1 - 1e-9))
        ends = np.append(ends, c[direct])
    return max(radius, float(distance[ends].max(initial=0.0)) * (1 + 1e-9))


def _near_part(mesh: SurfaceMesh, near: NDArray, sources: Sources) -> tuple[NDArray, SurfaceMesh, Sources]:
    """The faces at vertices where `near` (n,), ascending, the mesh that they make, and the source on it.

    Vertices keep their numbers, and fans of faces that are complete their first corners.
    """
    points = sources.points
    face = np.flatnonzero(near[mesh.faces].any(axis=1))
    gluing = mesh.topology.gluing
    if gluing is not None:
        number = np.full(mesh.n_faces, -1)
        number[face] = np.arange(len(face))
        there = np.where(gluing[face] >= 0, number[gluing[face] // 3], -1)
        gluing = np.where(there >= 0, 3 * there + gluing[face] % 3, -1)
    topology = Topology(mesh.faces[face], mesh.n_vertices, gluing)
    part: SurfaceMesh
    if isinstance(mesh, TriangleMesh):
        part = TriangleMesh(mesh.points, topology)
    else:
        part = IntrinsicMesh(topology, mesh.side_length[face], mesh.points)
    at = SurfacePoints(np.searchsorted(face, points.face), points.barycentric)
    return face, part, Sources(sources.vertex, at)


def _handed_on(
    stencils: Stencils, distance: NDArray, known: NDArray, start: NDArray
) -> NDArray[np.complex128]:
    """(n,) unit directions in which lines leave the source, from those of the vertices `known`; 0 at it."""
    n, distance = len(distance), distance / stencils.scale
    given = np.zeros(n, dtype=np.complex128)
    given[known] = start
    parents, late = _parents(stencils, distance, np.isfinite(distance) & (given == 0))
    order = np.argsort(distance, kind="stable")
    unit = _units(parents.solved(given, order))
    # at the cut locus lines come from two sides: one of them will do, their mean would not
    again, apart = len(late.child) > 0, (unit[parents.a] * unit[parents.b].conj()).real < 0
    if apart.any():
        parents, again = parents.by_one(apart), True
    if again:
        given[late.child] = late.weight_a * unit[late.a] + late.weight_b * unit[late.b]
        parents = parents.without(late.child, n)
        unit = _units(parents.solved(given, order))
    return unit


def _units(vectors: NDArray) -> NDArray[np.complex128]:
    size = np.abs(vectors)
    return np.divide(vectors, size, out=np.zeros_like(vectors), where=size > 0)


@dataclass(frozen=True, eq=False)
class _Parents:
    """Vertices (k,) with those whose directions make theirs, and the parts of these."""

    child: NDArray[np.int64]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    weight_a: NDArray[np.float64]
    weight_b: NDArray[np.float64]

    def by_one(self, where: NDArray) -> _Parents:
        """There, by the parent alone that has the larger part."""
        more = self.weight_a >= self.weight_b
        weight_a, weight_b = np.where(where, more, self.weight_a), np.where(where, ~more, self.weight_b)
        return replace(self, weight_a=weight_a, weight_b=weight_b)

    def without(self, vertex: NDArray, n: int) -> _Parents:
        """Those of other children."""
        stays = np.ones(n, dtype=bool)
        stays[vertex] = False
        stays = stays.take(self.child)
        return _Parents(
            self.child[stays], self.a[stays], self.b[stays], self.weight_a[stays], self.weight_b[stays]
        )

    def solved(self, given: NDArray, order: NDArray) -> NDArray[np.complex128]:
        """(n,) directions, from those given; parents come before their children in `order`."""
        n = len(order)
        place = np.empty(n, dtype=np.int64)
        place[order] = np.arange(n)
        rows, columns = (
            place[np.concatenate([*ends, order])] for ends in ((self.child, self.child), (self.a, self.b))
        )
        values = np.concatenate([-self.weight_a, -self.weight_b, np.ones(n)])
        system = csr_array((values, (rows, columns)), shape=(n, n))
        found = np.empty(n, dtype=np.complex128)
        found[order] = spsolve_triangular(system, given[order], lower=True, unit_diagonal=True)
        return found


def _parents(stencils: Stencils, distance: NDArray, wanted: NDArray) -> tuple[_Parents, _Parents]:
    """By which stencil each wanted vertex is nearest: of those with a and b nearer; of others, if better.

    The first make a triangular system. The others are few: next to an edge as long as the way to the source.
    """
    row = wanted.take(stencils.corner[:, 2]).nonzero()[0]
    corner = stencils.corner.take(row, axis=0)
    da, db, dc = distance.take(corner).T
    length, x, y, along = stencils.shape.take(row, axis=0).T
    with np.errstate(divide="ignore", invalid="ignore"):
        found, cross = circular_update(da, db, length, x, y)
        share = cross / length
        # of the line to c the part as far as ab
        depth = np.sqrt(np.maximum(da * da * (1 - share) + db * db * share - cross * (length - cross), 0.0))
        sound = (share >= 0) & (share <= 1) & (depth > SKEW * np.minimum(da, db))
        ordered = dc > np.maximum(da, db)
        value = np.where(sound & ordered, found, np.where(da < dc, da + along, np.inf))
        best, least = _least(value, corner[:, 2], len(distance))
        value = np.where(sound & ~ordered & (found < least.take(corner[:, 2]) * (1 - 1e-12)), found, np.inf)
        late, _ = _least(value, corner[:, 2], len(distance))
        straight = ~(sound & ordered).take(best)
        weight_a = np.where(straight, 1.0, ((1 - share) * da / depth).take(best))
        weight_b = np.where(straight, 0.0, (share * db / depth).take(best))
        a, b, c = corner.take(best, axis=0).T
        of_late = ((1 - share) * da / depth).take(late), (share * db / depth).take(late)
    la, lb, lc = corner.take(late, axis=0).T
    return _Parents(c, a, b, weight_a, weight_b), _Parents(lc, la, lb, *of_late)


def _least(value: NDArray, vertex: NDArray, n: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Numbers of the least finite values of each vertex, ascending by vertex; and the least values (n,)."""
    least = np.full(n, np.inf)
    np.minimum.at(least, vertex, value)
    number = np.full(n, -1)
    won = (np.isfinite(value) & (value == least.take(vertex))).nonzero()[0]
    number[vertex[won]] = won
    return number[number >= 0], least


def _skew(mesh: SurfaceMesh, distance: NDArray, unit: NDArray) -> dict[str, float] | None:
    """|cos| of the angle between the gradients of distance and direction on faces; Gauss's lemma: 0."""
    corner = unit[mesh.faces]
    turn = np.angle(corner * corner[:, :1].conj()) * float(mesh.side_length.max())  # as large as lengths
    (ax, bx), (ay, by), area = face_gradient(mesh, np.stack([distance[mesh.faces], turn]))
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.abs(ax * bx + ay * by) / np.sqrt((ax * ax + ay * ay) * (bx * bx + by * by))
    use = np.isfinite(cosine) & (area > 0) & (corner != 0).all(axis=1)
    if not use.any():
        return None
    shares = shares_by_area(cosine[use], area[use])
    return {name: shares[name] for name in ("median", "p90")}  # across the cut locus it is large
