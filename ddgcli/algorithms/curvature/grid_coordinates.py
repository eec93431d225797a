"""Coordinates on grids: rounded ones, and vertices that marching cubes places on the edges of voxels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

EQUAL_SHARE = 1e-5  # of an edge: coordinates that differ by less count as equal
MULTIPLE_TOLERANCE = 0.01  # of a step, from whole multiples of it
MAX_VALUE_SHARE = 0.5  # maximum number of different values of a coordinate, as a share of the vertices
MAX_STEPS = 1_000_000  # of the extent of a surface
MAX_STEP = 0.75  # of rounding, in edges
MAX_PRECISION = 16  # significant bits of rounded numbers: 11 of half precision, 8 of bfloat16
# of smaller numbers, that need all bits of a precision: a half where they were rounded to it
MIN_FULL_SHARE = 0.25
DOUBLE_BITS, MIN_EXPONENT = 53, -1074
PRECISION_SAMPLE = 500  # vertices that show that numbers are not rounded
MIN_SPANNING_SHARE = 0.01  # of the sides of faces, that are longer than a step
# of vertices on the edges of a grid: two coordinates are each shared by so many vertices, and by so many
# times more than the third; their share, and that of each axis among the directions of these edges
MIN_SHARING, MIN_SHARING_RATIO = 8, 4
MIN_GRID_SHARE, MIN_AXIS_SHARE = 0.8, 0.08


def rounding_deviation(ordered: NDArray, normal: NDArray, sides: NDArray, edge: float) -> float:
    """Standard deviation along the normals by which coordinates were rounded.

    Rounded coordinates are whole multiples of a step, up to a shift, and the step of each axis is the least
    difference of its coordinates. One coordinate alone may be rounded, as to the layers of a printer.

    Parameters
    ----------
    ordered : (3, n) ndarray of float64
        Coordinates of each axis in ascending order.
    normal : (3, k) ndarray of float64
        Unit normals.
    sides : (3, s) ndarray of float64
        Vectors along sides of faces.
    edge : float
        Mean edge length.

    Returns
    -------
    float
        A length; 0 where the coordinates are not rounded.
    """
    variance = np.zeros(3)
    for axis, values in enumerate(ordered):
        step = np.diff(_distinct(values, edge))
        if len(step) == 0 or len(step) > MAX_VALUE_SHARE * len(values):
            continue
        least = float(step.min())
        if step.sum() > MAX_STEPS * least or (
            np.abs(step / least - np.rint(step / least)).max() > MULTIPLE_TOLERANCE * (1 + len(step) ** 0.5)
        ):
            continue
        # the places of a regular grid are not rounded: its sides span one step
        spans_steps = np.mean(np.abs(sides[axis]) > 1.5 * least) > MIN_SPANNING_SHARE
        if least < MAX_STEP * edge and spans_steps:
            variance[axis] = least * least / 12
    return float(np.sqrt(np.mean(variance @ (normal * normal))))


def precision_steps(points: NDArray) -> NDArray[np.float64] | None:
    """Distances of neighbouring numbers of the precision to which all coordinates were rounded.

    The steps of half precision (numpy.float16) and bfloat16 grow with the magnitude of a number: small
    numbers need all bits as often as large ones. Multiples of one step need fewer, the smaller they are.

    Parameters
    ----------
    points : (n, 3) ndarray of float64

    Returns
    -------
    (3, n) ndarray of float64 or None
        0 where a coordinate is 0. None where numbers have more than MAX_PRECISION significant bits, or are
        multiples of one step.
    """
    if _significant_bits(points[:: max(1, len(points) // PRECISION_SAMPLE)]).max(initial=0) > MAX_PRECISION:
        return None
    bits, exponent = _significant_bits(points.T), np.frexp(points.T)[1]
    precision = int(bits.max(initial=0))
    if precision > MAX_PRECISION:
        return None
    is_full = (bits == precision) & (precision > 0)
    small = (bits > 0) & (exponent < exponent.max(where=is_full, initial=MIN_EXPONENT))
    if not small.any() or is_full[small].mean() < MIN_FULL_SHARE:
        return None
    return np.where(bits > 0, np.ldexp(1.0, exponent - precision), 0.0)


def _significant_bits(values: NDArray) -> NDArray[np.int64]:
    """Significant bits of each mantissa, without trailing zeros; 0 for zero."""
    mantissa = np.ldexp(np.frexp(values)[0], DOUBLE_BITS).astype(np.int64)
    last = np.frexp((mantissa & -mantissa).astype(np.float64))[1]  # 1 + the position of the lowest set bit
    return np.where(mantissa != 0, DOUBLE_BITS + 1 - last, 0)


def _distinct(ordered: NDArray, edge: float) -> NDArray[np.float64]:
    """Ascending values without repetition: of values that are equal up to the tolerance, the first."""
    return ordered[np.concatenate([[True], np.diff(ordered) > EQUAL_SHARE * edge])]


def on_grid_edges(points: NDArray, ordered: NDArray, edge: float) -> bool:
    """Whether nearly all vertices share two coordinates with many others and the third with few.

    Marching cubes places such vertices on the edges of a grid.

    Parameters
    ----------
    points, ordered : (3, n) ndarray of float64
        Positions, and the coordinates of each axis in ascending order.
    edge : float
        Mean edge length.

    Returns
    -------
    bool
    """
    if not _may_lie_on_grid_edges(ordered, edge):
        return False
    n_shared = np.zeros(points.shape, dtype=np.int64)
    for axis, values in enumerate(points):
        order = np.argsort(values, kind="stable")
        group = np.cumsum(np.concatenate([[0], np.diff(values[order]) > EQUAL_SHARE * edge]))
        n_shared[axis, order] = np.bincount(group)[group]
    third, second, _ = np.sort(n_shared, axis=0)
    on_edge = (second >= MIN_SHARING) & (MIN_SHARING_RATIO * third <= second)
    shares = np.bincount(n_shared.argmin(axis=0)[on_edge], minlength=3) / points.shape[1]
    return bool(on_edge.mean() > MIN_GRID_SHARE and shares.min() > MIN_AXIS_SHARE)


def _may_lie_on_grid_edges(ordered: NDArray, edge: float) -> bool:
    """Whether the numbers of equal coordinates allow a grid: False needs no order of the vertices."""
    n = ordered.shape[1]
    sizes = []
    for values in ordered:
        is_last = np.append(np.diff(values) > EQUAL_SHARE * edge, True)
        sizes.append(np.diff(np.flatnonzero(is_last), prepend=-1))
    if sum(int(size[size >= MIN_SHARING].sum()) for size in sizes) <= 2 * MIN_GRID_SHARE * n:
        return False
    largest = [int(size.max()) for size in sizes]
    for axis, size in enumerate(sizes):
        most = max(largest[:axis] + largest[axis + 1 :])
        if size[MIN_SHARING_RATIO * size <= most].sum() <= MIN_AXIS_SHARE * n:
            return False
    return True
