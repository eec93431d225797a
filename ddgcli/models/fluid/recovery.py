"""Velocities at vertices from the fluxes through edges: of second order on irregular meshes too.

The velocity of a face is exact to first order only (its error changes sign from a face to the next), so that
slopes taken of it do not converge. At a vertex it is the slope of the quadratic stream function that fits the
fluxes through the edges there best (Zhang and Naga, "A new finite element gradient recovery method", 2005).
At the boundary it is what the quadratics of the neighbours inside have there. Where that is impossible or
would amplify noise, the vertex takes the mean value of its neighbours, with half of what their slopes add,
and at the boundary the mean of its faces. All of it is one sparse matrix. Transport takes another, without
these slopes: with them, steps of `covector` on irregular triangles are a quarter less accurate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, reduce
from operator import add
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, dia_array, diags_array

from ddgcli.geometry.unfolding import Fans, vertex_fans
from ddgcli.linalg.indices import matrix_indices
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, Topology

MIN_FIT_EDGES = 5  # edges that determine a quadratic function but for its constant
MAX_FIT_GAIN = 3.0  # of a fitted velocity over the velocities along the edges
MAX_BOUNDARY_GAIN = 8.0  # of a velocity at the boundary
MAX_SHARED_EDGES = 64  # of a fit that vertices at the boundary share: each has a row of its edges
SINGULAR_SHIFT = 1e-12  # relative, keeps fits to edges along few directions solvable
BLOCK_EDGES = 1 << 15  # of fits at once, about what a cache holds
NEIGHBOUR_PASSES = (
    2  # from vertices with a fit to their neighbours without one, and to their neighbours in turn
)


@dataclass(frozen=True, eq=False)
class Recovery:
    """Vertex velocities as a linear function of the side fluxes.

    Parameters
    ----------
    fixed : (n, 3m) sparse array of complex
        Side fluxes to the velocities of vertices with a fit and at the boundary, each in the frame of its
        vertex (angles stretched to a full turn, from the first side of its fan on).
    means : (n, 3m) sparse array of complex
        To the means of the faces of the other vertices.
    from_neighbours : (n, n) sparse array of complex, optional
        To the velocities of the others from those of their neighbours; None where all vertices have a fit.
    half_slopes : (n, 3m) sparse array of complex, optional
        To half of what the neighbours' slopes add to these.
    faces : (m, 3) ndarray of int64
    to_vertex : (m, 3) ndarray of complex
        Turns from the frame of a face to the frames of its corners' vertices.
    """

    fixed: csr_array
    means: csr_array
    from_neighbours: csr_array | None
    half_slopes: csr_array | None
    faces: NDArray[np.int64]
    to_vertex: NDArray[np.complex128]

    @cached_property
    def matrix(self) -> csr_array:
        """(n, 3m) side fluxes to vertex velocities."""
        return self._completed(self.fixed if self.half_slopes is None else _sum(self.fixed, self.half_slopes))

    @cached_property
    def smooth_matrix(self) -> csr_array:
        """The same without the slopes, for what is carried: a vertex without a fit takes a mean."""
        return self.matrix if self.half_slopes is None else self._completed(self.fixed)

    def _completed(self, fixed: csr_array) -> csr_array:
        matrix = _sum(fixed, self.means)
        for _ in range(NEIGHBOUR_PASSES if self.from_neighbours is not None else 0):
            matrix = _sum(fixed, self.from_neighbours @ matrix)
        return csr_array(matrix)

    def smooth_at_corners(self, side_flux: NDArray) -> NDArray[np.complex128]:
        """(m, 3) vertex velocities of fluxes (m, 3) without slopes, in the planar frames of the faces."""
        return (self.smooth_matrix @ side_flux.ravel())[self.faces] * np.conj(self.to_vertex)


def recovery(mesh: SurfaceMesh, side: NDArray[np.complex128]) -> Recovery:
    """Recovery of velocities at the vertices of a surface from the fluxes through its edges.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
    side : (m, 3) ndarray of complex
        Sides of the faces in their planar frames.

    Returns
    -------
    Recovery
    """
    topology, fans = mesh.topology, vertex_fans(mesh)
    stretch = np.where(fans.is_open, 1.0, 2.0 * np.pi / fans.total_angle)[fans.fan]
    angle = fans.angle_before * stretch
    to_vertex = _vertex_frames(side, fans, stretch)
    velocity = _fits(mesh, fans, angle, np.ones(topology.n_vertices, dtype=bool)).velocity
    fits = np.diff(velocity.indptr) > 0
    isolated = topology.referenced_vertex & ~topology.boundary_vertex & ~fits
    fit = _fits(mesh, fans, angle, _beside(topology, isolated | topology.boundary_vertex), slopes=True)
    at_rim = _at_boundary(mesh, angle, fit, fits)
    reached = _moderate(mesh, at_rim.velocity, MAX_BOUNDARY_GAIN)
    at_others = _face_means(mesh, side, fans, to_vertex, ~fits & ~reached & ~isolated)
    fixed = _sum(velocity, _rows(reached) @ at_rim.velocity, at_others)
    means, from_neighbours, half_slopes = _face_means(mesh, side, fans, to_vertex, isolated), None, None
    if isolated.any():
        fit = _Fit(*(of_fit + _rows(reached) @ of_rim for of_fit, of_rim in zip(fit, at_rim)))
        from_neighbours, half_slopes = _from_neighbours(mesh, fans, stretch, fit, fits | reached, isolated)
    return Recovery(fixed, means, from_neighbours, half_slopes, topology.faces, to_vertex)


def _beside(topology: Topology, here: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n,) vertices of the faces that have one of the vertices `here`."""
    beside = np.zeros_like(here)
    beside[topology.faces[here[topology.faces].any(axis=1)]] = True
    return beside


def _sum(*matrices: csr_array) -> csr_array:
    """Sum of matrices, of those with entries."""
    return reduce(add, (matrix for matrix in matrices[1:] if matrix.nnz), matrices[0])


def _matrix(values: NDArray, row: NDArray, column: NDArray, shape: tuple[int, int]) -> csr_array:
    at = (matrix_indices(row, *shape), matrix_indices(column, *shape))
    return csr_array((values, at), shape=shape)


def _rows(mask: NDArray[np.bool_]) -> dia_array:
    return diags_array(mask.astype(float))


def _moderate(mesh: SurfaceMesh, matrix: csr_array, most: float) -> NDArray[np.bool_]:
    """(n,) rows that are not empty and amplify the velocities along the edges at most by the limit."""
    gain = abs(matrix) @ mesh.side_length.ravel()
    return (gain > 0) & (gain <= most)


def _vertex_frames(side: NDArray, fans: Fans, stretch: NDArray) -> NDArray[np.complex128]:
    angle = fans.corner_angle
    bisector = stretch * (fans.angle_before + 0.5 * angle)
    along = np.exp(1j * np.angle(side).ravel()) * np.exp(0.5j * angle)
    return (np.exp(1j * bisector) / along).reshape(-1, 3)


class _Fit(NamedTuple):
    """Velocity (n, 3m) of the fitted quadratics at their vertices, and its slopes (n, 3m) along x and y."""

    velocity: csr_array
    along_x: csr_array | None = None
    along_y: csr_array | None = None


def _fits(
    mesh: SurfaceMesh, fans: Fans, angle: NDArray, here: NDArray[np.bool_], slopes: bool = False
) -> _Fit:
    """Fits at inner vertices of `here` (n,) that have edges enough and amplify little; else empty rows."""
    length, count, n_matrices = mesh.side_length.ravel(), np.diff(fans.start), 3 if slopes else 1
    rows, columns = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    values = [np.zeros((n_matrices, 0), dtype=np.complex128)]
    fitted = here[fans.vertex] & ~fans.is_open & (count >= MIN_FIT_EDGES)
    for k in np.unique(count[fitted]):
        alike = np.flatnonzero(fitted & (count == k))
        for block in np.array_split(alike, 1 + k * len(alike) // BLOCK_EDGES):
            corner = fans.corner[fans.start[block][:, None] + np.arange(k)]
            rows.append(np.repeat(fans.vertex[block], k))
            columns.append(corner.ravel())
            values.append(_quadratics(length[corner], angle[corner])[:n_matrices])
    row, column, value = np.concatenate(rows), np.concatenate(columns), np.concatenate(values, axis=1)
    moderate = sum_by_index(row, np.abs(value[0]) * length[column], len(here)) <= MAX_FIT_GAIN
    row, column, value = row[moderate[row]], column[moderate[row]], value[:, moderate[row]]
    return _Fit(*(_matrix(of_edges, row, column, (len(here), length.size)) for of_edges in value))


def _quadratics(reach: NDArray, angle: NDArray) -> NDArray[np.complex128]:
    """(3, c k) velocity and its slopes of fits to k fluxes each, through edges of length `reach` (c, k)."""
    size = reach.mean(axis=1)[:, None]
    place, weight = reach / size * np.exp(1j * angle), size / reach
    x, y = place.real, place.imag
    terms = np.stack([x, y, 0.5 * x * x, x * y, 0.5 * y * y], axis=1) * weight[:, None]
    moment = terms @ np.swapaxes(terms, 1, 2) + SINGULAR_SHIFT * np.eye(5)
    solved = np.linalg.solve(moment, terms * weight[:, None])
    slope_x, slope_y, xx, xy, yy = solved.transpose(1, 0, 2) / size
    # slopes turned clockwise
    return np.stack([slope_y - 1j * slope_x, (xy - 1j * xx) / size, (yy - 1j * xy) / size]).reshape(3, -1)


def _at_boundary(mesh: SurfaceMesh, angle: NDArray, fit: _Fit, fits: NDArray[np.bool_]) -> _Fit:
    """The fit at boundary vertices: mean of those of the neighbours there, by 1 / distance."""
    topology, n = mesh.topology, mesh.topology.n_vertices
    tail, head = topology.faces.ravel(), topology.faces[:, NEXT].ravel()
    shared = fits & (np.bincount(tail, minlength=n) <= MAX_SHARED_EDGES)
    side = np.flatnonzero((topology.side_twin.ravel() >= 0) & shared[tail] & topology.boundary_vertex[head])
    weight = 1.0 / mesh.side_length.ravel()[side]
    weight = weight / sum_by_index(head[side], weight, n)[head[side]]
    sides = _Sides(mesh, angle, side)
    cosine, sine = sides.gather(weight * sides.turn.real), sides.gather(weight * sides.turn.imag)
    return _Fit(
        sides.gather(weight) @ fit.velocity + sides.along(weight, fit),
        cosine @ fit.along_x - sine @ fit.along_y,
        sine @ fit.along_x + cosine @ fit.along_y,
    )


class _Sides:
    """Sides (s,) of faces along which the fits at their tails reach the vertices at their heads."""

    def __init__(self, mesh: SurfaceMesh, angle: NDArray, side: NDArray[np.int64]) -> None:
        topology = mesh.topology
        self.at = (topology.faces[:, NEXT].ravel()[side], topology.faces.ravel()[side])
        self.turn = np.exp(1j * (angle[topology.side_twin.ravel()[side]] + np.pi - angle[side]))  # of frames
        self.place = mesh.side_length.ravel()[side] * np.exp(1j * angle[side])  # of the head at the tail
        self.n = topology.n_vertices

    def gather(self, factor: NDArray) -> csr_array:
        """(n, n) matrix of vectors at the tails to sums at the heads, with a factor for every side."""
        return _matrix(factor * self.turn, *self.at, (self.n, self.n))

    def along(self, weight: NDArray, fit: _Fit) -> csr_array:
        """(n, 3m) what the slopes at the tails change on the way to the heads, weighted sums."""
        x, y = weight * self.place.real, weight * self.place.imag
        return self.gather(x) @ fit.along_x + self.gather(y) @ fit.along_y


def _face_means(
    mesh: SurfaceMesh, side: NDArray, fans: Fans, to_vertex: NDArray, here: NDArray[np.bool_]
) -> csr_array:
    """Mean of the velocities of a vertex's faces, by angle; rows of zeros but `here` (n,)."""
    faces, n = mesh.topology.faces, mesh.topology.n_vertices
    corner = np.flatnonzero(here[faces])
    vertex, face, angle = faces.ravel()[corner], corner // 3, fans.corner_angle[corner]
    total = sum_by_index(vertex, angle, n)
    first, last = side[face, 0], side[face, 2]
    turned = to_vertex.ravel()[corner] * angle / total[vertex] / (last * np.conj(first)).imag
    values = np.concatenate([-turned * last, turned * first])
    columns = np.concatenate([3 * face, 3 * face + 2])
    return _matrix(values, np.tile(vertex, 2), columns, (n, 3 * len(faces)))


def _from_neighbours(
    mesh: SurfaceMesh, fans: Fans, stretch: NDArray, fit: _Fit, fits: NDArray, isolated: NDArray
) -> tuple[csr_array, csr_array]:
    """Velocity of vertices without a fit: matrix (n, n) of those of the neighbours, and (n, 3m) of fluxes.

    Mean value coordinates (M. S. Floater, 2003: positive, and exact for linear functions) of the neighbours'
    velocities; where all of these have a fit, and half of what the slopes add on the way. Without slopes, and
    with the whole of them, it is off by second derivatives of opposite signs.
    """
    topology, angle = mesh.topology, fans.angle_before * stretch
    leaving = np.flatnonzero(isolated[topology.faces])
    entering = topology.side_twin.ravel()[leaving]
    clockwise = entering - entering % 3 + NEXT[entering % 3]
    half = np.tan(np.minimum(0.5 * fans.corner_angle * stretch, 1.5))
    weight = (half[leaving] + half[clockwise]) / mesh.side_length.ravel()[leaving]
    vertex = topology.faces.ravel()[leaving]
    weight = weight / sum_by_index(vertex, weight, topology.n_vertices)[vertex]
    sides = _Sides(mesh, angle, entering)
    without = sum_by_index(vertex, 1.0 - fits[topology.faces.ravel()[entering]], topology.n_vertices)
    return sides.gather(weight), sides.along(0.5 * weight * (without[vertex] == 0), fit)
