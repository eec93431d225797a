"""Curvature from local fits: a height polynomial over the neighbours of every vertex, all at once.

The polynomial has degree four. Generalised cross-validation chooses one penalty for the terms of degree
three and four of the whole mesh: clean data get the accuracy of a quartic fit, noisy data the stability of a
quadratic one. Coordinates are scaled along the axes of each neighbourhood, so that thin cells are fitted as
well as square ones. The normal equations consist of moments of the coordinates, which are cheaper than
products of rows; elimination solves them for thousands of vertices at a time.
"""

from __future__ import annotations

import logging
from math import comb

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.faces import Faces
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures, eigen_2x2, tangent_frame
from ddgcli.algorithms.curvature.neighbours import neighbourhoods
from ddgcli.algorithms.curvature.regions import Regions, chunks, larger, listed
from ddgcli.algorithms.curvature.vertex_balls import map_blocks, vertex_balls
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.triangle_mesh import TriangleMesh

# exponents of x and y; the penalised terms first, so that elimination leaves the system of the low ones
_HIGH_TERMS = [(4, 0), (3, 1), (2, 2), (1, 3), (0, 4), (3, 0), (2, 1), (1, 2), (0, 3)]
_LOW_TERMS = [(2, 0), (1, 1), (0, 2), (1, 0), (0, 1), (0, 0)]
_TERMS = _HIGH_TERMS + _LOW_TERMS
_MOMENT_POWERS = [(a, b) for a in range(9) for b in range(9 - a)]
# weights of Bombieri's norm, which a rotation of the coordinates does not change: the axes of a neighbourhood
# that spreads equally in all directions are arbitrary
_TERM_WEIGHT = np.array([1.0 / comb(a + b, a) for a, b in _TERMS])
_IS_HIGH = np.arange(len(_TERMS)) < len(_HIGH_TERMS)
_MOMENT_INDEX = np.array([[_MOMENT_POWERS.index((a + c, b + d)) for c, d in _TERMS] for a, b in _TERMS])

_PENALTIES = (1e-6, 1e-4, 1e-2, 1.0, 1e2, 1e4)  # from a quartic fit to a quadratic one
QUADRATIC_PENALTY = _PENALTIES[-1]
_PENALTY_SAMPLE_SIZE = 96  # vertices whose fits choose among the penalties
_LOW_TERM_PENALTY = 1e-12  # of the low terms, so that three neighbours determine a fit too
_MIN_PIVOT = 1e-7  # of the low terms, a share of the number of neighbours, below which a fit is repeated
_MIN_SINGULAR_VALUE = 1e-6  # relative: coefficients that the neighbours determine less are the least ones
_RIGHT_ANGLE = 1e-9  # cosine of normals at a right angle, whatever their rounding
_MIN_NEIGHBOURS = 15  # below which a third ring is added
_MAX_PAIRS = 40_000  # neighbours handled at once: the working arrays stay in the cache


def quadric(
    mesh: TriangleMesh,
    faces: Faces,
    normal: NDArray,
    radius: float | NDArray | None = None,
    *,
    noisy: bool = False,
    jobs: int = 1,
) -> PrincipalCurvatures:
    """Principal curvatures of polynomial fits over rings of neighbours (`neighbourhoods`) or a ball.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Of the mesh.
    normal : (3, n) ndarray
        Approximate unit normals.
    radius : float or (n,) ndarray, optional
        Of the ball, or of that of each vertex; a vertex whose ball holds fewer neighbours than its two rings
        keeps the rings.
    noisy : bool
        Whether noise is averaged in balls: by quadratic fits, over planes normal to the area vectors of the
        balls, as single normals are far off and stairs are no noise of single vertices.
    jobs : int
        Threads that fit blocks of vertices; the result does not depend on it.

    Returns
    -------
    PrincipalCurvatures
    """
    regions = neighbourhoods(mesh, faces, normal, _MIN_NEIGHBOURS)
    if radius is not None:
        regions = larger(regions, vertex_balls(mesh, radius, jobs=jobs))
    columns = faces.points
    if noisy and radius is not None:
        from ddgcli.algorithms.curvature.area_vectors import averaged_normals  # imports scipy.sparse

        normal, penalty = averaged_normals(faces, normal, regions), QUADRATIC_PENALTY
    else:
        penalty = _sampled_penalty(columns, normal, regions)
    logging.getLogger("ddgcli").info("quadric: penalty %g on the terms of degree three and four", penalty)
    gradient, hessian = fit_forms(columns, normal, regions, penalty, jobs=jobs)
    return principal_of_forms(gradient, hessian, normal)


def fit_forms(
    columns: NDArray, normal: NDArray, regions: Regions, penalty: float, *, jobs: int = 1
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """First and second derivatives of the surface as heights over approximate tangent planes.

    Parameters
    ----------
    columns : (3, n) ndarray
        Coordinates.
    normal : (3, n) ndarray
        Unit normals; they need only be near the true ones.
    regions : Regions
        Neighbour vertices of each vertex, itself included.
    penalty : float
        Weight of the squared coefficients of degree three and four, a share of the number of neighbours.
    jobs : int
        Threads; each fits a block of vertices, and the blocks do not depend on their number.

    Returns
    -------
    gradient : (2, n) ndarray
        z_x and z_y in the frame of `tangent_frame(normal)`.
    hessian : (3, n) ndarray
        z_xx, z_xy and z_yy.
    """
    n = columns.shape[1]
    gradient, hessian = np.zeros((2, n)), np.zeros((3, n))
    vertex_frame = np.concatenate([*tangent_frame(normal), normal])

    def fit(block: tuple[int, int]) -> None:
        begin, end = block
        start, member = _same_side(vertex_frame[6:9], begin, end, regions)
        x, y, z = local_coordinates(columns, columns[:, begin:end], vertex_frame[:, begin:end], start, member)
        x, y, axes = _scaled(x, y, start)
        matrix, right = _normal_equations(x, y, z, start)
        count = np.diff(start)
        # fewer data than terms: the low terms have precedence
        share = np.where(count > len(_TERMS), penalty, np.maximum(penalty, 1.0))
        _add_penalty(matrix, share, count)
        low, pivot = _solve_low(matrix, right)
        singular = pivot < _MIN_PIVOT * count
        for size in np.unique(count[singular]):
            some = np.flatnonzero(singular & (count == size))
            own = start[some, None] + np.arange(size)
            low[:, some] = _least_coefficients(x[own], y[own], z[own], share[some])
        gradient[:, begin:end], hessian[:, begin:end] = _unscaled(low, axes)

    blocks = chunks(regions, _MAX_PAIRS)
    for _ in map_blocks(fit, list(blocks), jobs):
        pass
    return gradient, hessian


def local_coordinates(
    columns: NDArray, centre: NDArray, vertex_frame: NDArray, start: NDArray, member: NDArray
) -> list[NDArray]:
    """Coordinates of the neighbours in the frame of their vertex.

    Parameters
    ----------
    columns : (3, n) ndarray of float64
        Positions of all vertices.
    centre : (3, c) ndarray of float64
        Origins of the frames.
    vertex_frame : (9, c) ndarray of float64
        Three orthonormal axes, the normal last.
    start, member : ndarray of int
        Ragged lists of the neighbours of the c vertices.

    Returns
    -------
    list of three (p,) ndarray of float64
        x, y and height z.
    """
    count = np.diff(start)
    offset = [np.take(c, member) - np.repeat(o, count) for c, o in zip(columns, centre)]
    local = []
    for axis in (vertex_frame[0:3], vertex_frame[3:6], vertex_frame[6:9]):
        along = offset[0] * np.repeat(axis[0], count)
        along += offset[1] * np.repeat(axis[1], count)
        along += offset[2] * np.repeat(axis[2], count)
        local.append(along)
    return local


def _same_side(normal: NDArray, begin: int, end: int, regions: Regions) -> tuple[NDArray, NDArray]:
    """Neighbours whose normals are less than a right angle from their vertex's: heights are a function.

    A vertex left with fewer than the six terms of a quadratic polynomial, as at the corners of a tetrahedron
    and on tubes of four sides, keeps those below 120 degrees.
    """
    # whole indices once, as each np.take would convert them
    member = regions.member[regions.start[begin] : regions.start[end]].astype(np.intp, copy=False)
    start = regions.start[begin : end + 1] - regions.start[begin]
    count = np.diff(start)
    cosine = np.take(normal[0], member) * np.repeat(normal[0, begin:end], count)
    cosine += np.take(normal[1], member) * np.repeat(normal[1, begin:end], count)
    cosine += np.take(normal[2], member) * np.repeat(normal[2, begin:end], count)
    keep = cosine > _RIGHT_ANGLE
    if keep.all():
        return start, member
    n_members = np.add.reduceat(keep, start[:-1], dtype=np.int64)
    if n_members.min() < len(_LOW_TERMS):
        keep |= np.repeat(n_members < len(_LOW_TERMS), count) & (cosine > -0.5 + _RIGHT_ANGLE)
        n_members = np.add.reduceat(keep, start[:-1], dtype=np.int64)
    return list_starts(n_members), member[keep]


def _sum(values: NDArray, start: NDArray) -> NDArray[np.float64]:
    return np.add.reduceat(values, start[:-1])


def _scaled(x: NDArray, y: NDArray, start: NDArray) -> tuple[NDArray, NDArray, tuple[NDArray, ...]]:
    """Coordinates along the axes of greatest and least spread, scaled to spread one, and these axes."""
    count = np.diff(start)
    xx, xy, yy = _sum(x * x, start), _sum(x * y, start), _sum(y * y, start)
    small, large, cos, sin = eigen_2x2(xx, xy, yy)
    large = np.where(large > 0, large, 1.0)
    small = np.where(small > 1e-20 * large, small, large)
    axes = (cos, sin, np.sqrt(count / large), np.sqrt(count / small))
    c, s, sx, sy = (np.repeat(a, count) for a in axes)
    return (c * x + s * y) * sx, (c * y - s * x) * sy, axes


def _normal_equations(x: NDArray, y: NDArray, z: NDArray, start: NDArray) -> tuple[NDArray, NDArray]:
    """(p, p, c) matrices and (p, c) right-hand sides of the least-squares fits."""
    powers_x, powers_y = _powers(x), _powers(y)
    moment = np.zeros((len(_MOMENT_POWERS), len(start) - 1))
    right = np.zeros((len(_TERMS), len(start) - 1))
    for k, (a, b) in enumerate(_MOMENT_POWERS):
        if a + b == 0:
            moment[k], right[_TERMS.index((0, 0))] = np.diff(start), _sum(z, start)
            continue
        term = powers_x[a] if b == 0 else powers_y[b] if a == 0 else powers_x[a] * powers_y[b]
        moment[k] = _sum(term, start)
        if (a, b) in _TERMS:
            right[_TERMS.index((a, b))] = _sum(term * z, start)
    return moment[_MOMENT_INDEX], right


def _powers(x: NDArray) -> list[NDArray]:
    powers = [x, x]
    for _ in range(2, 9):
        powers.append(powers[-1] * x)
    return powers


def _add_penalty(matrix: NDArray, share: NDArray | float, count: NDArray) -> None:
    """Add the penalties of the terms to the diagonals of (p, p, c) matrices, in place."""
    diagonal = np.arange(len(_TERMS))
    high = (_IS_HIGH * _TERM_WEIGHT)[:, None]
    matrix[diagonal, diagonal] += (high * share + _LOW_TERM_PENALTY * _TERM_WEIGHT[:, None]) * count


def _least_coefficients(x: NDArray, y: NDArray, z: NDArray, share: NDArray) -> NDArray[np.float64]:
    """The low coefficients (6, k) of fits that the (k, m) neighbours do not determine: the least of the best.

    The normal equations square the condition number, so their solutions would consist of rounding errors.
    """
    root = np.sqrt(_TERM_WEIGHT)
    rows = np.stack([x**a * y**b for a, b in _TERMS], axis=2) / root
    penalty = np.sqrt(share[:, None] * x.shape[1])[..., None] * np.diag(_IS_HIGH.astype(float))
    inverse = np.linalg.pinv(np.concatenate([rows, penalty], axis=1), rcond=_MIN_SINGULAR_VALUE)
    solved = (inverse[:, :, : x.shape[1]] @ z[..., None])[..., 0] / root
    return solved.T[len(_HIGH_TERMS) :]


def _solve_low(matrix: NDArray, right: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The low coefficients of many symmetric systems, by elimination of one unknown after another.

    Also the smallest pivot of each system among them.
    """
    p = len(matrix)
    least = np.full(matrix.shape[2], np.inf)
    for j in range(p):
        pivot = matrix[j, j]
        if j >= len(_HIGH_TERMS):
            least = np.minimum(least, pivot)
        inverse = np.divide(1.0, pivot, out=np.zeros_like(pivot), where=pivot > 0)
        row = matrix[j, j + 1 :]
        factor = row * inverse
        matrix[j + 1 :, j + 1 :] -= factor[:, None] * row
        right[j + 1 :] -= factor * right[j]
        matrix[j, j + 1 :], right[j] = factor, right[j] * inverse
    for j in range(p - 2, len(_HIGH_TERMS) - 1, -1):
        right[j] -= np.einsum("kn,kn->n", matrix[j, j + 1 :], right[j + 1 :])
    return right[len(_HIGH_TERMS) :], least


def _unscaled(low: NDArray, axes: tuple[NDArray, ...]) -> tuple[NDArray, NDArray]:
    """Gradient (2, c) and Hessian (3, c) in the frame, from coefficients in scaled, turned coordinates."""
    cos, sin, sx, sy = axes
    xx, xy, yy, x, y = low[:5]
    xx, xy, yy, x, y = 2 * xx * sx * sx, xy * sx * sy, 2 * yy * sy * sy, x * sx, y * sy
    gradient = np.stack([cos * x - sin * y, sin * x + cos * y])
    hessian = np.stack(
        [
            cos * cos * xx - 2 * cos * sin * xy + sin * sin * yy,
            cos * sin * (xx - yy) + (cos * cos - sin * sin) * xy,
            sin * sin * xx + 2 * cos * sin * xy + cos * cos * yy,
        ]
    )
    return gradient, hessian


def _sampled_penalty(columns: NDArray, normal: NDArray, regions: Regions) -> float:
    """`cross_validated_penalty` of a sample of vertices with small and large neighbourhoods."""
    able = sampled_regions(columns, columns, regions, _PENALTY_SAMPLE_SIZE)
    return cross_validated_penalty(columns, normal, listed(regions, able), able)


def cross_validated_penalty(columns: NDArray, normal: NDArray, some: Regions, vertices: NDArray) -> float:
    """Penalty whose fits over the regions of some vertices predict their data best.

    Parameters
    ----------
    columns, normal : (3, n) ndarray of float64
        Positions, and unit normals.
    some : Regions
        Of the k vertices.
    vertices : (k,) ndarray of int64

    Returns
    -------
    float
        Of the terms of degree three and four, relative.

    Notes
    -----
    Generalised cross-validation: the least of residual / (data - degrees of freedom)^2, in the mean of the
    logarithms, so that a few creases do not decide for all.
    """
    if len(vertices) == 0:
        return _PENALTIES[-1]
    return _best_penalty(*_systems(columns, normal, some, vertices))


def sampled_regions(columns: NDArray, centre: NDArray, regions: Regions, most: int) -> NDArray[np.int64]:
    """Choose about `most` regions with enough vertices to test a fit, small and large ones.

    Parameters
    ----------
    columns : (3, n) ndarray of float64
        Positions.
    centre : (3, k) ndarray of float64
        Centres of the regions.
    regions : Regions
    most : int

    Returns
    -------
    (c,) ndarray of int64
        Numbers of regions, ordered by their size where there are more than `most`, so that the choice does
        not depend on the numbering of the vertices.
    """
    count = regions.count
    able = np.flatnonzero((count > len(_TERMS) + 3) & (count <= 400))
    if len(able) > most:
        size = _squared_offset(columns, centre, regions)[able]
        able = able[np.argsort(size, kind="stable")][:: len(able) // most]
    return able


def _systems(
    columns: NDArray, normal: NDArray, some: Regions, vertices: NDArray
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Normal equations (k, p, p), right-hand sides (k, p, 1), squared heights and counts of some vertices."""
    vertex_frame = np.concatenate([*tangent_frame(normal[:, vertices]), normal[:, vertices]])
    x, y, z = local_coordinates(columns, columns[:, vertices], vertex_frame, some.start, some.member)
    x, y, _ = _scaled(x, y, some.start)
    matrix, right = _normal_equations(x, y, z, some.start)
    return matrix.transpose(2, 0, 1), right.T[..., None], _sum(z * z, some.start), some.count


def polynomial_residuals(
    columns: NDArray, normal: NDArray, some: Regions, vertices: NDArray, degrees: tuple[int, ...]
) -> NDArray[np.float64]:
    """Standard deviation of the heights around each vertex from their fits of some degrees.

    An unbiased estimate of the noise of vertices along the normal, where the surface itself is a polynomial
    of that degree.

    Parameters
    ----------
    columns, normal : (3, n) ndarray of float64
        Positions, and unit normals.
    some : Regions
        Of the k vertices.
    vertices : (k,) ndarray of int64
    degrees : tuple of d ints
        Up to 4.

    Returns
    -------
    (d, k) ndarray of float64
        A length; NaN where a region has too few vertices for a fit.
    """
    matrix, right, squared, count = _systems(columns, normal, some, vertices)
    deviation = []
    for degree in degrees:
        low = np.array([k for k, (a, b) in enumerate(_TERMS) if a + b <= degree])
        low_block = matrix[:, low[:, None], low] + _LOW_TERM_PENALTY * count[:, None, None] * np.eye(len(low))
        explained = np.einsum("nij,nij->n", right[:, low], _inverse(low_block) @ right[:, low])
        free = np.where(count > len(low), count - len(low), np.nan)
        deviation.append(np.sqrt(np.maximum(squared - explained, 0.0) / free))
    return np.stack(deviation)


def _best_penalty(matrix: NDArray, right: NDArray, squared: NDArray, count: NDArray) -> float:
    flat = squared <= 0
    squared = np.where(flat, 1.0, squared)
    scores = []
    for penalty in _PENALTIES:
        weight = np.diag(_TERM_WEIGHT * (penalty * _IS_HIGH + _LOW_TERM_PENALTY))
        inverse = _inverse(matrix + weight * count[:, None, None])
        fitted = inverse @ right
        explained = np.einsum("nij,nij->n", 2 * right - matrix @ fitted, fitted)
        degrees = np.einsum("nij,nji->n", inverse, matrix)
        rest = np.maximum(1.0 - explained / squared, 1e-26)
        scores.append(float(np.log(rest / (count - degrees) ** 2).mean()))
    return _PENALTIES[int(np.argmin(scores))]


def _inverse(matrix: NDArray) -> NDArray[np.float64]:
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError:  # a sampled vertex whose neighbours lie on a line
        return np.linalg.pinv(matrix, hermitian=True)


def _squared_offset(columns: NDArray, centre: NDArray, regions: Regions) -> NDArray[np.float64]:
    """(k,) squared distance from each centre to the mean of its region: a size that needs no frame."""
    total = np.zeros(len(regions.start) - 1)
    for begin, end in chunks(regions, _MAX_PAIRS):
        member = regions.member[regions.start[begin] : regions.start[end]].astype(np.intp, copy=False)
        start = regions.start[begin : end + 1] - regions.start[begin]
        count = np.diff(start)
        for c, o in zip(columns, centre):
            mean = np.zeros(end - begin)
            mean[count > 0] = np.add.reduceat(np.take(c, member), start[:-1][count > 0])
            total[begin:end] += (mean / np.maximum(count, 1) - o[begin:end]) ** 2
    return total


def principal_of_forms(gradient: NDArray, hessian: NDArray, normal: NDArray) -> PrincipalCurvatures:
    """Principal curvatures and directions of height fields over tangent frames.

    Parameters
    ----------
    gradient : (2, n) ndarray of float64
        Of the height at the vertex, in the frame of `tangent_frame(normal)`.
    hessian : (3, n) ndarray of float64
        xx, xy, yy, in 1/length.
    normal : (3, n) ndarray of float64
        Unit normals.

    Returns
    -------
    PrincipalCurvatures
        Positive where the height curves away from the normal.
    """
    first, second = tangent_frame(normal)
    gx, gy = gradient
    stretch = np.sqrt(1 + gx * gx + gy * gy)
    # Cholesky factor of the metric: the form in an orthonormal basis of the fitted tangent plane
    l11 = np.sqrt(1 + gx * gx)
    l21, l22 = gx * gy / l11, stretch / l11
    xx, xy, yy = -hessian / stretch
    ratio = l21 / l11
    low, high, cos, sin = eigen_2x2(
        xx / (l11 * l11),
        (xy - ratio * xx) / (l11 * l22),
        (yy - 2 * ratio * xy + ratio * ratio * xx) / (l22 * l22),
    )

    def lifted(c: NDArray, s: NDArray) -> NDArray[np.float64]:
        v = s / l22
        u = (c - l21 * v) / l11
        return u * first + v * second + (u * gx + v * gy) * normal

    return PrincipalCurvatures(low, high, lifted(-sin, cos), lifted(cos, sin), low * high)
