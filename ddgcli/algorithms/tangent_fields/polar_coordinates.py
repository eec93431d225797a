"""Geodesic polar coordinates by fast marching: a faster, approximate logarithmic map.

If the distance of c comes from the edge ab, it comes from a point source unfolded below that edge, and the
line to c crosses ab between the lines to a and b: the direction of c at the real source lies between those
of a and b (E. Melvaer, M. Reimers, "Geodesic Polar Coordinates on Polygonal Meshes", 2012). As unit complex
numbers the directions solve a triangular system in the order of the distances. An error near the source
persists along the whole line, so the nearest vertices have exact directions.
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
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh, SurfaceMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh

N_EXACT_DIRECTIONS = 200  # vertices around the source
MARGIN = 1.2  # fast marching distances near the source have smaller relative errors
MIN_DEPTH_RATIO = 0.1  # of an unfolded source below ab, relative to its distance to a and b


def fast_marching_log_map(mesh: SurfaceMesh, approximate: FastMarchingDistance, sources: Sources) -> LogMap:
    """Logarithmic map of one source at all vertices, by fast marching.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented.
    approximate : FastMarchingDistance
        From that source, on this mesh or one with the same vertices and metric.
    sources : Sources
        One vertex or surface point.

    Returns
    -------
    LogMap
        Norms are the fast marching distances. `miss` is None; `skew` measures the deviation of the directions
        from geodesic polar coordinates.
    """
    require_single_source(sources)
    distance, far = approximate.distance, ~np.isfinite(approximate.distance)
    radius = _radius(approximate, sources, mesh)
    face, near, at = submesh_near_source(mesh, distance <= MARGIN * radius, sources)
    centre = SourceFrame(Tracer(near), at)
    exact = exact_distance(near, at, limit=radius, directions=True)
    exact_vertices = np.flatnonzero((exact.distance > 0) & (exact.distance <= radius) & ~far)
    start = np.exp(1j * centre.scale * np.asarray(exact.departure)[exact_vertices])
    unit = _propagate_directions(approximate.stencils, distance, exact_vertices, start)
    mapped = np.where(far, 0.0, distance) * unit
    coordinates = np.stack([mapped.real, mapped.imag], axis=1)
    coordinates[far] = np.inf
    axis = centre.axis()
    if "face" in axis:
        axis["face"] = int(face[axis["face"]])
    return LogMap(coordinates, axis, skew=direction_skew(mesh, distance, unit))


def _radius(approximate: FastMarchingDistance, sources: Sources, mesh: SurfaceMesh) -> float:
    """Distance within which directions are exact: that of the N_EXACT_DIRECTIONS-th vertex.

    It is larger if edges of the source are longer: distances that come from the source itself have no
    parents.
    """
    stencils, distance = approximate.stencils, approximate.distance
    reached = distance[np.isfinite(distance)]
    k = min(N_EXACT_DIRECTIONS, len(reached) - 1)
    radius = float(np.partition(reached, k)[k])
    ends = mesh.faces[sources.points.face].ravel()
    for v in np.append(sources.vertex, ends[distance[ends] == 0]):
        row = stencils.at[stencils.start[v] : stencils.start[v + 1]]
        c = stencils.corner[row, 2]
        edge = stencils.shape[row, 3] * stencils.scale.take(c)
        direct = (stencils.corner[row, 0] == v) & (distance[c] >= edge * (1 - 1e-9))
        ends = np.append(ends, c[direct])
    return max(radius, float(distance[ends].max(initial=0.0)) * (1 + 1e-9))


def submesh_near_source(
    mesh: SurfaceMesh, near: NDArray, sources: Sources
) -> tuple[NDArray, SurfaceMesh, Sources]:
    """Submesh of the faces at some vertices, with the source on it.

    Vertices keep their indices, and complete fans of faces keep their first corners.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    near : (n,) ndarray of bool
    sources : Sources

    Returns
    -------
    face : (k,) ndarray of int64
        Faces with a vertex in `near`, ascending.
    submesh : TriangleMesh or IntrinsicMesh
    sources : Sources
        On the submesh.
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
    submesh: SurfaceMesh
    if isinstance(mesh, TriangleMesh):
        submesh = TriangleMesh(mesh.points, topology)
    else:
        submesh = IntrinsicMesh(topology, mesh.side_length[face], mesh.points)
    at = SurfacePoints(np.searchsorted(face, points.face), points.barycentric)
    return face, submesh, Sources(sources.vertex, at)


def _propagate_directions(
    stencils: Stencils, distance: NDArray, exact_vertices: NDArray, start: NDArray
) -> NDArray[np.complex128]:
    """(n,) unit directions of lines at the source, from those of `exact_vertices`; 0 at the source."""
    n, distance = len(distance), distance / stencils.scale
    fixed = np.zeros(n, dtype=np.complex128)
    fixed[exact_vertices] = start
    parents, late = _parents(stencils, distance, np.isfinite(distance) & (fixed == 0))
    order = np.argsort(distance, kind="stable")
    unit = _units(parents.solve(fixed, order))
    # at the cut locus lines come from two sides: use one of them, not their mean
    again, apart = len(late.child) > 0, (unit[parents.a] * unit[parents.b].conj()).real < 0
    if apart.any():
        parents, again = parents.with_one_parent(apart), True
    if again:
        fixed[late.child] = late.weight_a * unit[late.a] + late.weight_b * unit[late.b]
        parents = parents.without(late.child, n)
        unit = _units(parents.solve(fixed, order))
    return unit


def _units(vectors: NDArray) -> NDArray[np.complex128]:
    size = np.abs(vectors)
    return np.divide(vectors, size, out=np.zeros_like(vectors), where=size > 0)


@dataclass(frozen=True, eq=False)
class _Parents:
    """Vertices (k,) with the two vertices and weights that determine their directions."""

    child: NDArray[np.int64]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    weight_a: NDArray[np.float64]
    weight_b: NDArray[np.float64]

    def with_one_parent(self, where: NDArray) -> _Parents:
        """Parents with only the one of larger weight, where `where`."""
        more = self.weight_a >= self.weight_b
        weight_a, weight_b = np.where(where, more, self.weight_a), np.where(where, ~more, self.weight_b)
        return replace(self, weight_a=weight_a, weight_b=weight_b)

    def without(self, vertex: NDArray, n: int) -> _Parents:
        """Parents of all other children."""
        stays = np.ones(n, dtype=bool)
        stays[vertex] = False
        stays = stays.take(self.child)
        return _Parents(
            self.child[stays], self.a[stays], self.b[stays], self.weight_a[stays], self.weight_b[stays]
        )

    def solve(self, fixed: NDArray, order: NDArray) -> NDArray[np.complex128]:
        """(n,) directions from the fixed ones; parents precede their children in `order`."""
        n = len(order)
        place = np.empty(n, dtype=np.int64)
        place[order] = np.arange(n)
        rows, columns = (
            matrix_indices(place[np.concatenate([*ends, order])], n)
            for ends in ((self.child, self.child), (self.a, self.b))
        )
        values = np.concatenate([-self.weight_a, -self.weight_b, np.ones(n)])
        system = csr_array((values, (rows, columns)), shape=(n, n))
        directions = np.empty(n, dtype=np.complex128)
        directions[order] = spsolve_triangular(system, fixed[order], lower=True, unit_diagonal=True)
        return directions


def _parents(stencils: Stencils, distance: NDArray, selected: NDArray) -> tuple[_Parents, _Parents]:
    """Best stencils of vertices: among those with nearer a and b; and among the others, if better.

    The first form a triangular system. The others are few: next to edges as long as the distance to the
    source.
    """
    row = selected.take(stencils.corner[:, 2]).nonzero()[0]
    corner = stencils.corner.take(row, axis=0)
    da, db, dc = distance.take(corner).T
    length, x, y, along, _ = stencils.shape.take(row, axis=0).T
    with np.errstate(divide="ignore", invalid="ignore"):
        value_c, cross = circular_update(da, db, length, x, y)
        share = cross / length
        # length of the line to c up to ab
        depth = np.sqrt(np.maximum(da * da * (1 - share) + db * db * share - cross * (length - cross), 0.0))
        valid = (share >= 0) & (share <= 1) & (depth > MIN_DEPTH_RATIO * np.minimum(da, db))
        ordered = dc > np.maximum(da, db)
        value = np.where(valid & ordered, value_c, np.where(da < dc, da + along, np.inf))
        best, least = _least(value, corner[:, 2], len(distance))
        value = np.where(
            valid & ~ordered & (value_c < least.take(corner[:, 2]) * (1 - 1e-12)), value_c, np.inf
        )
        late, _ = _least(value, corner[:, 2], len(distance))
        straight = ~(valid & ordered).take(best)
        weight_a = np.where(straight, 1.0, ((1 - share) * da / depth).take(best))
        weight_b = np.where(straight, 0.0, (share * db / depth).take(best))
        a, b, c = corner.take(best, axis=0).T
        of_late = ((1 - share) * da / depth).take(late), (share * db / depth).take(late)
    la, lb, lc = corner.take(late, axis=0).T
    return _Parents(c, a, b, weight_a, weight_b), _Parents(lc, la, lb, *of_late)


def _least(value: NDArray, vertex: NDArray, n: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Indices of the least finite value of each vertex, ascending by vertex; and the least values (n,)."""
    least = np.full(n, np.inf)
    np.minimum.at(least, vertex, value)
    number = np.full(n, -1)
    won = (np.isfinite(value) & (value == least.take(vertex))).nonzero()[0]
    number[vertex[won]] = won
    return number[number >= 0], least


def direction_skew(mesh: SurfaceMesh, distance: NDArray, unit: NDArray) -> dict[str, float] | None:
    """How far the gradients of distance and direction are from orthogonal, which Gauss's lemma demands.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    distance : (n,) ndarray of float64
    unit : (n,) ndarray of complex128
        Direction as a unit complex number; 0 where unknown.

    Returns
    -------
    dict or None
        `median` and `p90` of |cos| of the angle between both on faces; None without a face to measure on.
    """
    corner = unit[mesh.faces]
    turn = np.angle(corner * corner[:, :1].conj()) * float(mesh.side_length.max())  # in units of length
    (ax, bx), (ay, by), area = face_gradient(mesh, np.stack([distance[mesh.faces], turn]))
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.abs(ax * bx + ay * by) / np.sqrt((ax * ax + ay * ay) * (bx * bx + by * by))
    use = np.isfinite(cosine) & (area > 0) & (corner != 0).all(axis=1)
    if not use.any():
        return None
    shares = shares_by_area(cosine[use], area[use])
    return {name: shares[name] for name in ("median", "p90")}  # large across the cut locus
