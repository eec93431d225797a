"""Height polynomials over the neighbours of vertices, all at once: the fits, and the curvature of a fit.

Coordinates are scaled along the axes of each neighbourhood, so that thin cells are fitted as well as square
ones. The normal equations consist of moments of the coordinates, which are cheaper than products of rows;
elimination solves them for thousands of vertices at a time.
"""

from __future__ import annotations

from functools import cached_property
from math import comb

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.frames import PrincipalCurvatures, eigen_2x2, tangent_frame
from ddgcli.algorithms.curvature.regions import Regions, chunks, cosines, regions_of_range
from ddgcli.mesh.ragged import list_starts

LOW_TERM_PENALTY = 1e-12  # of the low terms, so that three neighbours determine a fit too
_MIN_PIVOT = 1e-7  # of the low terms, a share of the number of neighbours, below which a fit is repeated
_MIN_SINGULAR_VALUE = 1e-6  # relative: coefficients that the neighbours determine less are the least ones
_RIGHT_ANGLE = 1e-9  # cosine of normals at a right angle, whatever their rounding
_MIN_SAME_SIDE = 3  # neighbours, the vertex itself aside, that determine a fit: fewer show no curvature
_MIN_SPREAD = 1e-20  # of the squared spread across over that along: below, the neighbours lie on a line
_MAX_PAIRS = 40_000  # neighbours handled at once: the working arrays stay in the cache


class Basis:
    """Terms x^a y^b of polynomials.

    Parameters
    ----------
    high : list of (int, int)
        Exponents of the penalised terms, which are eliminated first.
    low : list of (int, int)
        Exponents of the terms up to degree two.
    """

    def __init__(self, high: list[tuple[int, int]], low: list[tuple[int, int]]) -> None:
        self.terms, self.n_high = high + low, len(high)

    @cached_property
    def weight(self) -> NDArray[np.float64]:
        """(p,) weights of Bombieri's norm, which a rotation of the coordinates does not change.

        The axes of a neighbourhood that spreads equally in all directions are arbitrary.
        """
        return np.array([1.0 / comb(a + b, a) for a, b in self.terms])

    @cached_property
    def is_high(self) -> NDArray[np.bool_]:
        """(p,) the penalised terms."""
        return np.arange(len(self.terms)) < self.n_high

    @cached_property
    def moment_powers(self) -> list[tuple[int, int]]:
        """Exponents of the products of two terms."""
        most = 2 * max(a + b for a, b in self.terms)
        return [(a, b) for a in range(most + 1) for b in range(most + 1 - a)]

    @cached_property
    def moment_index(self) -> NDArray[np.int64]:
        """(p, p) place of the product of two terms among `moment_powers`."""
        return np.array(
            [[self.moment_powers.index((a + c, b + d)) for c, d in self.terms] for a, b in self.terms]
        )


LOW_TERMS = [(2, 0), (1, 1), (0, 2), (1, 0), (0, 1), (0, 0)]
QUADRATIC = Basis([], LOW_TERMS)
CUBIC = Basis([(3, 0), (2, 1), (1, 2), (0, 3)], LOW_TERMS)
QUARTIC = Basis([(4, 0), (3, 1), (2, 2), (1, 3), (0, 4), (3, 0), (2, 1), (1, 2), (0, 3)], LOW_TERMS)


def fit_forms(
    columns: NDArray,
    normal: NDArray,
    regions: Regions,
    penalty: float,
    centre: NDArray,
    centre_normal: NDArray,
    *,
    basis: Basis = QUARTIC,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """First and second derivatives of the surface as heights over approximate tangent planes.

    Parameters
    ----------
    columns, normal : (3, n) ndarray
        Coordinates and unit normals of all vertices: a fit takes the members on its own side.
    regions : Regions
        Neighbour vertices of each of k vertices, itself included.
    penalty : float
        Weight of the squared coefficients of degree three and four, a share of the number of neighbours.
    centre, centre_normal : (3, k) ndarray
        Coordinates of the k vertices, and unit normals of the planes; these need only be near the true ones.
    basis : Basis
        Terms of the polynomials: without high ones the penalty has no effect.

    Returns
    -------
    gradient : (2, k) ndarray
        z_x and z_y in the frame of `tangent_frame(centre_normal)`.
    hessian : (3, k) ndarray
        z_xx, z_xy and z_yy.
    """
    k = centre.shape[1]
    gradient, hessian = np.zeros((2, k)), np.zeros((3, k))
    axes = np.concatenate([*tangent_frame(centre_normal), centre_normal])
    for begin, end in chunks(regions, _MAX_PAIRS):
        own = slice(begin, end)
        planes = centre[:, own], axes[:, own]
        block = regions_of_range(regions, begin, end)
        gradient[:, own], hessian[:, own] = _fit(columns, normal, block, penalty, *planes, basis)
    return gradient, hessian


def fitted_gradient(
    columns: NDArray, normal: NDArray, regions: Regions, values: NDArray
) -> NDArray[np.float64]:
    """Tangential gradients at vertices of a function with known values, by cubic fits to it.

    Parameters
    ----------
    columns, normal : (3, n) ndarray
        As in `fit_forms`.
    regions : Regions
        Neighbour vertices of each vertex, itself included.
    values : (n,) ndarray

    Returns
    -------
    (3, n) ndarray of float64
        Zero where the neighbours determine no cubic polynomial.
    """
    first, second = tangent_frame(normal)
    start, member = regions.start, regions.member.astype(np.intp, copy=False)
    count = np.diff(start)
    x, y, _ = local_coordinates(columns, columns, np.concatenate([first, second, normal]), start, member)
    x, y, axes = scaled(x, y, start)
    rise = values[member] - np.repeat(values, count)
    matrix, right = normal_equations(x, y, rise, start, CUBIC)
    has_fit = count >= len(CUBIC.terms)
    low, pivot = _solve_low(matrix, right, CUBIC.n_high)
    along, across = _unscaled(low, axes)[0]
    return np.where(has_fit & (pivot >= _MIN_PIVOT * count), along * first + across * second, 0.0)


def _fit(
    columns: NDArray,
    normal: NDArray,
    regions: Regions,
    penalty: float,
    centre: NDArray,
    axes: NDArray,
    basis: Basis,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """`fit_forms` for c vertices that are fitted at once, over planes with axes (9, c)."""
    start, member = _same_side(axes[6:9], normal, regions)
    x, y, z = local_coordinates(columns, centre, axes, start, member)
    x, y, scales = scaled(x, y, start)
    matrix, right = normal_equations(x, y, z, start, basis)
    count = np.diff(start)
    # fewer data than terms: the low terms have precedence
    share = np.where(count > len(basis.terms), penalty, np.maximum(penalty, 1.0))
    _add_penalty(matrix, share, count, basis)
    low, pivot = _solve_low(matrix, right, basis.n_high)
    singular = pivot < _MIN_PIVOT * count
    for size in np.unique(count[singular]):
        some = np.flatnonzero(singular & (count == size))
        place = start[some, None] + np.arange(size)
        low[:, some] = _least_coefficients(x[place], y[place], z[place], share[some], basis)
    return _unscaled(low, scales)


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


def _same_side(centre: NDArray, normal: NDArray, regions: Regions) -> tuple[NDArray, NDArray]:
    """Neighbours whose normals are less than a right angle from their vertex's: heights are a function.

    A vertex left with fewer than the six terms of a quadratic polynomial, as at the corners of a tetrahedron
    and on tubes of four sides, keeps those below 120 degrees; one left with fewer than three neighbours, as
    at the corner of a cube that is cut off, keeps all.
    """
    # whole indices once, as each np.take would convert them
    start, member = regions.start, regions.member.astype(np.intp, copy=False)
    count = np.diff(start)
    cosine = cosines(centre, normal, count, member)
    keep = cosine > _RIGHT_ANGLE
    if keep.all():
        return start, member
    n_members = np.add.reduceat(keep, start[:-1], dtype=np.int64)
    if n_members.min() < len(LOW_TERMS):
        keep |= np.repeat(n_members < len(LOW_TERMS), count) & (cosine > -0.5 + _RIGHT_ANGLE)
        n_members = np.add.reduceat(keep, start[:-1], dtype=np.int64)
        keep |= np.repeat(n_members < 1 + _MIN_SAME_SIDE, count)
        n_members = np.add.reduceat(keep, start[:-1], dtype=np.int64)
    return list_starts(n_members), member[keep]


def sums(values: NDArray, start: NDArray) -> NDArray[np.float64]:
    """Sum values over ragged lists.

    Parameters
    ----------
    values : (p,) ndarray of float64
    start : (c + 1,) ndarray of int
        Starts of the lists, none of which is empty.

    Returns
    -------
    (c,) ndarray of float64
    """
    return np.add.reduceat(values, start[:-1])


def scaled(x: NDArray, y: NDArray, start: NDArray) -> tuple[NDArray, NDArray, tuple[NDArray, ...]]:
    """Scale coordinates to spread one along the axes of greatest and least spread.

    Parameters
    ----------
    x, y : (p,) ndarray of float64
    start : (c + 1,) ndarray of int
        Starts of the lists of c vertices.

    Returns
    -------
    x, y : (p,) ndarray of float64
        Along these axes.
    axes : tuple of four (c,) ndarray of float64
        Cosine and sine of the first axis, and the two factors.
    """
    count = np.diff(start)
    xx, xy, yy = sums(x * x, start), sums(x * y, start), sums(y * y, start)
    _, large, cos, sin = eigen_2x2(xx, xy, yy)
    large = np.where(large > 0, large, 1.0)
    c, s = np.repeat(cos, count), np.repeat(sin, count)
    along, across = c * x + s * y, c * y - s * x
    small = sums(across * across, start)  # the other eigenvalue would be a difference of large numbers
    small = np.where(small > _MIN_SPREAD * large, small, large)
    axes = (cos, sin, np.sqrt(count / large), np.sqrt(count / small))
    return along * np.repeat(axes[2], count), across * np.repeat(axes[3], count), axes


def normal_equations(
    x: NDArray, y: NDArray, z: NDArray, start: NDArray, basis: Basis = QUARTIC
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normal equations of the least-squares fits of heights.

    Parameters
    ----------
    x, y, z : (p,) ndarray of float64
        Scaled coordinates, and heights.
    start : (c + 1,) ndarray of int
        Starts of the lists of c vertices.
    basis : Basis

    Returns
    -------
    matrix : (t, t, c) ndarray of float64
    right : (t, c) ndarray of float64
    """
    terms, moment_powers = basis.terms, basis.moment_powers
    most = moment_powers[-1][0]
    powers_x, powers_y = _powers(x, most), _powers(y, most)
    moment = np.zeros((len(moment_powers), len(start) - 1))
    right = np.zeros((len(terms), len(start) - 1))
    for k, (a, b) in enumerate(moment_powers):
        if a + b == 0:
            moment[k], right[terms.index((0, 0))] = np.diff(start), sums(z, start)
            continue
        term = powers_x[a] if b == 0 else powers_y[b] if a == 0 else powers_x[a] * powers_y[b]
        moment[k] = sums(term, start)
        if (a, b) in terms:
            right[terms.index((a, b))] = sums(term * z, start)
    return moment[basis.moment_index], right


def _powers(x: NDArray, most: int) -> list[NDArray]:
    powers = [x, x]
    for _ in range(2, most + 1):
        powers.append(powers[-1] * x)
    return powers


def _add_penalty(matrix: NDArray, share: NDArray | float, count: NDArray, basis: Basis) -> None:
    """Add the penalties of the terms to the diagonals of (p, p, c) matrices, in place."""
    diagonal = np.arange(len(basis.terms))
    high = (basis.is_high * basis.weight)[:, None]
    matrix[diagonal, diagonal] += (high * share + LOW_TERM_PENALTY * basis.weight[:, None]) * count


def _least_coefficients(
    x: NDArray, y: NDArray, z: NDArray, share: NDArray, basis: Basis
) -> NDArray[np.float64]:
    """The low coefficients (6, k) of fits that the (k, m) neighbours do not determine: the least of the best.

    The normal equations square the condition number, so their solutions would consist of rounding errors.
    """
    root = np.sqrt(basis.weight)
    rows = np.stack([x**a * y**b for a, b in basis.terms], axis=2) / root
    penalty = np.sqrt(share[:, None] * x.shape[1])[..., None] * np.diag(basis.is_high.astype(float))
    inverse = np.linalg.pinv(np.concatenate([rows, penalty], axis=1), rcond=_MIN_SINGULAR_VALUE)
    solved = (inverse[:, :, : x.shape[1]] @ z[..., None])[..., 0] / root
    return solved.T[basis.n_high :]


def _solve_low(
    matrix: NDArray, right: NDArray, n_high: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The low coefficients of many symmetric systems, by elimination of one unknown after another.

    Also the smallest pivot of each system among them.
    """
    p = len(matrix)
    least = np.full(matrix.shape[2], np.inf)
    for j in range(p):
        pivot = matrix[j, j]
        if j >= n_high:
            least = np.minimum(least, pivot)
        inverse = np.divide(1.0, pivot, out=np.zeros_like(pivot), where=pivot > 0)
        row = matrix[j, j + 1 :]
        factor = row * inverse
        matrix[j + 1 :, j + 1 :] -= factor[:, None] * row
        right[j + 1 :] -= factor * right[j]
        matrix[j, j + 1 :], right[j] = factor, right[j] * inverse
    for j in range(p - 2, n_high - 1, -1):
        right[j] -= np.einsum("kn,kn->n", matrix[j, j + 1 :], right[j + 1 :])
    return right[n_high:], least


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


def principal_of_forms(gradient: NDArray, hessian: NDArray, normal: NDArray) -> PrincipalCurvatures:
    """Principal curvatures and directions of height fields over tangent frames.

    Parameters
    ----------
    gradient : (2, n) ndarray of float64
        Gradient of the height at the vertex, in the frame of `tangent_frame(normal)`.
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
