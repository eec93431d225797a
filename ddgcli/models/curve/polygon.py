"""Length, enclosed area and elastic energy of polylines, with their gradients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from ddgcli.mesh.curve import CurveSet, are_parallel, plane_normals
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.vectors import row_cross, row_dot, unit_vectors, vector_length

MIN_SEGMENT = 1e-12  # of the mean segment: shorter ones count as this long in weights 1 / length


@dataclass(frozen=True, eq=False)
class Polygons:
    """Connectivity of polylines.

    Parameters
    ----------
    tail, head : (s,) ndarray of int64
        Segments.
    curve : (n,) ndarray of int64
        Curve of each point.
    before, after : (j,) ndarray of int64
        Segments before and after each joint: a point between two segments.
    joint : (j,) ndarray of int64
        Points of the joints.
    closed : (c,) ndarray of bool
        By curve.
    normal : (c, 3) ndarray
        Unit normal of the plane of each curve; zero for space curves.
    """

    tail: NDArray[np.int64]
    head: NDArray[np.int64]
    curve: NDArray[np.int64]
    before: NDArray[np.int64]
    after: NDArray[np.int64]
    joint: NDArray[np.int64]
    closed: NDArray[np.bool_]
    normal: NDArray[np.float64]

    @property
    def n(self) -> int:
        return len(self.curve)

    @property
    def n_curves(self) -> int:
        return len(self.closed)

    @property
    def bounds_area(self) -> NDArray[np.bool_]:
        """(c,) curves that are closed and lie in a plane."""
        return self.closed & self.normal.any(axis=1)

    @cached_property
    def has_total_area(self) -> bool:
        """Whether all curves are closed and lie in parallel planes: else a sum of areas has no sign."""
        return bool(self.bounds_area.all()) and are_parallel(list(self.normal))

    def by_curve(self, points: NDArray, values: NDArray) -> NDArray[np.float64]:
        """(c,) sums by curve of values at points or segments (given by their tails)."""
        return sum_by_index(self.curve[points], values, self.n_curves)


def polygons(curves: CurveSet) -> Polygons:
    """Connectivity of a set of curves, and the normals of their planes.

    Parameters
    ----------
    curves : CurveSet
        All points belong to curves.

    Returns
    -------
    Polygons
    """
    n, paths = curves.n_vertices, curves.paths
    curve = np.full(n, -1, dtype=np.int64)
    normal = np.zeros((len(paths), 3))
    for k, ((path, _), plane) in enumerate(zip(paths, plane_normals(curves), strict=True)):
        curve[path] = k
        normal[k] = 0.0 if plane is None else plane
    tail, head = curves.lines.T
    leaving, entering = np.full(n, -1), np.full(n, -1)
    leaving[tail] = entering[head] = np.arange(len(tail))
    joint = np.flatnonzero((leaving >= 0) & (entering >= 0))
    closed = np.array([is_closed for _, is_closed in paths], dtype=bool)
    return Polygons(tail, head, curve, entering[joint], leaving[joint], joint, closed, normal)


@dataclass(frozen=True, eq=False)
class Geometry:
    """Segments and joints of polylines at given points.

    Parameters
    ----------
    edge, tangent : (s, 3) ndarray
        Segments and their unit vectors.
    length : (s,) ndarray
    dual_length : (n,) ndarray
        Half the length of the segments at each point.
    turning : (j,) ndarray
        Angle between successive segments in radians, from 0 to pi.
    """

    edge: NDArray[np.float64]
    tangent: NDArray[np.float64]
    length: NDArray[np.float64]
    dual_length: NDArray[np.float64]
    turning: NDArray[np.float64]


def geometry(mesh: Polygons, points: NDArray) -> Geometry:
    """Lengths, tangents and turning angles of polylines.

    Parameters
    ----------
    mesh : Polygons
    points : (n, 3) ndarray of float64

    Returns
    -------
    Geometry
    """
    edge = points[mesh.head] - points[mesh.tail]
    length, tangent = vector_length(edge), unit_vectors(edge)
    half = sum_by_index(np.concatenate([mesh.tail, mesh.head]), np.tile(length / 2, 2), mesh.n)
    t, u = tangent[mesh.before], tangent[mesh.after]
    turning = np.arctan2(vector_length(row_cross(t, u)), row_dot(t, u))
    return Geometry(edge, tangent, length, half, turning)


def gather(mesh: Polygons, values: NDArray) -> NDArray[np.float64]:
    """(n, 3) gradient by point of a function whose gradient by segment vector is `values` (s, 3)."""
    return sum_by_index(mesh.head, values, mesh.n) - sum_by_index(mesh.tail, values, mesh.n)


def length_gradient(mesh: Polygons, shape: Geometry) -> NDArray[np.float64]:
    """Gradient of the length: the difference of the unit tangents; -kappa N times the dual length.

    Parameters
    ----------
    mesh : Polygons
    shape : Geometry

    Returns
    -------
    (n, 3) ndarray of float64
        Without unit.
    """
    return gather(mesh, shape.tangent)


def enclosed_area(mesh: Polygons, points: NDArray) -> NDArray[np.float64]:
    """Signed areas that closed plane curves enclose.

    Parameters
    ----------
    mesh : Polygons
    points : (n, 3) ndarray of float64

    Returns
    -------
    (c,) ndarray of float64
        In length^2, positive to the left of the curve; 0 for other curves.
    """
    first = np.zeros(mesh.n_curves, dtype=np.int64)
    first[mesh.curve[::-1]] = np.arange(mesh.n)[::-1]
    area = area_form(mesh, points - points[first][mesh.curve])
    return np.where(mesh.bounds_area, area, 0.0)


def area_form(mesh: Polygons, vectors: NDArray) -> NDArray[np.float64]:
    """Sums over the segments of det(normal, v_tail, v_head) / 2.

    Parameters
    ----------
    mesh : Polygons
    vectors : (n, 3) ndarray of float64

    Returns
    -------
    (c,) ndarray of float64
        In the square of the vectors' unit.
    """
    normal = mesh.normal[mesh.curve[mesh.tail]]
    return mesh.by_curve(mesh.tail, row_dot(normal, row_cross(vectors[mesh.tail], vectors[mesh.head])) / 2)


def area_gradient(mesh: Polygons, points: NDArray) -> NDArray[np.float64]:
    """Gradient of the enclosed areas: (x_next - x_previous) x normal / 2.

    Parameters
    ----------
    mesh : Polygons
    points : (n, 3) ndarray of float64

    Returns
    -------
    (n, 3) ndarray of float64
        A length; 0 at points of curves that enclose no area.
    """
    edge = points[mesh.head] - points[mesh.tail]
    chord = sum_by_index(np.concatenate([mesh.tail, mesh.head]), np.tile(edge, (2, 1)), mesh.n)
    chord = np.where(mesh.bounds_area[mesh.curve][:, None], chord, 0.0)
    return row_cross(chord, mesh.normal[mesh.curve]) / 2


def turning_numbers(mesh: Polygons, shape: Geometry) -> NDArray[np.float64]:
    """Turning numbers of closed plane curves.

    Parameters
    ----------
    mesh : Polygons
    shape : Geometry

    Returns
    -------
    (c,) ndarray of float64
        0 for other curves.
    """
    t, u = shape.tangent[mesh.before], shape.tangent[mesh.after]
    sine = row_dot(row_cross(t, u), mesh.normal[mesh.curve[mesh.joint]])
    total = mesh.by_curve(mesh.joint, np.arctan2(sine, row_dot(t, u)))
    return np.where(mesh.bounds_area, np.round(total / (2 * np.pi)), 0.0)


def elastic_energy(mesh: Polygons, shape: Geometry) -> NDArray[np.float64]:
    """Elastic energies of polylines: sum of turning^2 / dual length, which is int kappa^2.

    A regular polygon has 4 pi^2 / length, the value of the circle of its length.

    Parameters
    ----------
    mesh : Polygons
    shape : Geometry

    Returns
    -------
    (c,) ndarray of float64
        In 1/length.
    """
    dual = np.maximum(shape.dual_length[mesh.joint], np.finfo(float).tiny)
    return mesh.by_curve(mesh.joint, shape.turning**2 / dual)


def elastic_gradient(mesh: Polygons, shape: Geometry) -> NDArray[np.float64]:
    """Gradient of the elastic energy.

    At a joint that turns by pi, where the energy has no gradient, the value is finite and of no use.

    Parameters
    ----------
    mesh : Polygons
    shape : Geometry

    Returns
    -------
    (n, 3) ndarray of float64
        In 1/length^2.
    """
    dual, angle = shape.dual_length[mesh.joint], shape.turning
    slope = 2.0 / np.maximum(np.sinc(angle / np.pi), 1e-8)  # -d(angle^2) / d(cos angle)
    t, u = shape.tangent[mesh.before], shape.tangent[mesh.after]
    by_tangent = np.zeros_like(shape.edge)
    by_tangent[mesh.before] -= (slope / dual)[:, None] * u
    by_tangent[mesh.after] -= (slope / dual)[:, None] * t
    by_dual = -0.5 * (angle / dual) ** 2
    segments = np.concatenate([mesh.before, mesh.after])
    by_length = sum_by_index(segments, np.tile(by_dual, 2), len(shape.length))
    along = row_dot(by_tangent, shape.tangent)[:, None] * shape.tangent
    length = np.maximum(shape.length, np.finfo(float).tiny)[:, None]
    return gather(mesh, (by_tangent - along) / length + by_length[:, None] * shape.tangent)


def stiffness(mesh: Polygons, length: NDArray) -> csr_array:
    """Stiffness matrix of second differences with weights 1 / length.

    Parameters
    ----------
    mesh : Polygons
    length : (s,) ndarray of float64
        Of the segments; very short ones count as longer.

    Returns
    -------
    (n, n) csr_array of float64
        Positive semidefinite, in 1/length.
    """
    mean = mesh.by_curve(mesh.tail, length) / np.bincount(mesh.curve[mesh.tail], minlength=mesh.n_curves)
    weight = 1.0 / np.maximum(length, MIN_SEGMENT * mean[mesh.curve[mesh.tail]] + np.finfo(float).tiny)
    i, j = mesh.tail, mesh.head
    rows, columns = np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])
    values = np.concatenate([weight, weight, -weight, -weight])
    return coo_array((values, (rows, columns)), shape=(mesh.n, mesh.n)).tocsr()


def vertex_tangents(mesh: Polygons, points: NDArray) -> NDArray[np.float64]:
    """Unit tangents at the points, along the chord of both neighbours.

    They are normal to the gradient of the area, so that normal motions lose area at the right rate.

    Parameters
    ----------
    mesh : Polygons
    points : (n, 3) ndarray of float64

    Returns
    -------
    (n, 3) ndarray of float64
        Zero at ends, and where the chord is zero.
    """
    tangent = np.zeros((mesh.n, 3))
    tangent[mesh.joint] = unit_vectors(points[mesh.head[mesh.after]] - points[mesh.tail[mesh.before]])
    return tangent


def circle_tangents(mesh: Polygons, points: NDArray) -> NDArray[np.float64]:
    """Unit tangents of the circles through each point and its neighbours.

    On uneven points the chord of both neighbours leans towards the longer segment. Normals to it differ
    between near neighbours by a fraction of that segment, and bending would keep such points where they are.

    Parameters
    ----------
    mesh : Polygons
    points : (n, 3) ndarray of float64

    Returns
    -------
    (n, 3) ndarray of float64
        Zero at ends.
    """
    tangent = np.zeros((mesh.n, 3))
    before, after = (points[mesh.head[k]] - points[mesh.tail[k]] for k in (mesh.before, mesh.after))
    squares = [row_dot(side, side)[:, None] for side in (before, after)]
    tangent[mesh.joint] = unit_vectors(squares[1] * before + squares[0] * after)
    return tangent
