"""Velocities at vertices from the fluxes through edges: of second order on irregular meshes too.

The velocity of a face is exact to first order only (its error changes sign from a face to the next), so that
slopes taken of it do not converge. At a vertex it is the slope of the quadratic stream function that fits the
fluxes through the edges there best (Zhang and Naga, "A new finite element gradient recovery method", 2005).
At the boundary it is what the quadratics of the neighbours inside have there. Where that is impossible or
would amplify noise, the vertex takes the mean value of its neighbours, and at the boundary the mean of its
faces. All of it is one sparse matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, dia_array, diags_array

from ddgcli.geometry.unfolding import Fans, vertex_fans
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.models.fluid.surface_space import SurfaceSpace

MIN_FIT_EDGES = 5  # edges that determine a quadratic function but for its constant
MAX_FIT_GAIN = 3.0  # of a fitted velocity over the velocities along the edges
MAX_BOUNDARY_GAIN = 8.0  # of a velocity at the boundary
MAX_SHARED_EDGES = 64  # of a fit that vertices at the boundary share: each has a row of its edges
NEIGHBOUR_PASSES = 2  # from vertices with a fit to their neighbours without one, and to those behind these


@dataclass(frozen=True, eq=False)
class Recovery:
    """Vertex velocities as a linear function of the side fluxes.

    Parameters
    ----------
    matrix : (n, 3m) sparse array of complex
        Side fluxes to vertex velocities, each in the frame of its vertex (angles stretched to a full turn,
        from the first side of its fan on).
    to_vertex : (m, 3) ndarray of complex
        Turns from the frame of a face to the frames of its corners' vertices.
    """

    matrix: csr_array
    to_vertex: NDArray[np.complex128]


def recovery(space: SurfaceSpace) -> Recovery:
    """Recovery of velocities at the vertices of a surface from the fluxes through its edges.

    Parameters
    ----------
    space : SurfaceSpace

    Returns
    -------
    Recovery
    """
    fans = vertex_fans(space.mesh)
    stretch = np.where(fans.is_open, 1.0, 2.0 * np.pi / fans.total_angle)[fans.fan]
    to_vertex = _vertex_frames(space, fans, stretch)
    fit = _fits(space, fans, stretch)
    fits = _moderate(space, fit.velocity, MAX_FIT_GAIN)
    at_rim = _at_boundary(space, fans, stretch, fit, fits)
    reached = _moderate(space, at_rim, MAX_BOUNDARY_GAIN)
    isolated = space.inside & ~fits
    fixed = _rows(fits) @ fit.velocity + _rows(reached) @ at_rim
    means = _rows(~fits & ~reached) @ _face_means(space, fans, to_vertex)
    matrix = fixed + means
    if isolated.any():
        fixed = fixed + _rows(~isolated) @ means
        from_neighbours = _rows(isolated) @ _mean_values(space, fans, stretch)
        for _ in range(NEIGHBOUR_PASSES):
            matrix = fixed + from_neighbours @ matrix
    return Recovery(csr_array(matrix), to_vertex)


def _rows(mask: NDArray[np.bool_]) -> dia_array:
    return diags_array(mask.astype(float))


def _moderate(space: SurfaceSpace, matrix: csr_array, most: float) -> NDArray[np.bool_]:
    """(n,) rows that amplify the velocities along the edges at most so many times, and are not empty."""
    gain = abs(matrix) @ space.mesh.side_length.ravel()
    return (gain > 0) & (gain <= most)


def _vertex_frames(space: SurfaceSpace, fans: Fans, stretch: NDArray) -> NDArray[np.complex128]:
    angle = fans.corner_angle
    bisector = stretch * (fans.angle_before + 0.5 * angle)
    along = np.exp(1j * np.angle(space.side).ravel()) * np.exp(0.5j * angle)
    return (np.exp(1j * bisector) / along).reshape(-1, 3)


class _Fit(NamedTuple):
    """Velocity (n, 3m) of the fitted quadratics at their vertices, and its slopes (n, 3m) along x and y."""

    velocity: csr_array
    along_x: csr_array
    along_y: csr_array


def _fits(space: SurfaceSpace, fans: Fans, stretch: NDArray) -> _Fit:
    """Fits at the inner vertices that have edges enough; rows of zeros elsewhere."""
    length = space.mesh.side_length.ravel()
    count = np.diff(fans.start)
    rows, columns = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    values = [np.zeros((0, 3), dtype=np.complex128)]
    for k in np.unique(count[~fans.is_open & (count >= MIN_FIT_EDGES)]):
        here = np.flatnonzero((count == k) & ~fans.is_open)
        corner = fans.corner[fans.start[here][:, None] + np.arange(k)]
        reach = length[corner]
        size = reach.mean(axis=1)[:, None]
        place = reach / size * np.exp(1j * (fans.angle_before * stretch)[corner])
        x, y = place.real, place.imag
        weight = size / reach
        terms = np.stack([x, y, 0.5 * x * x, x * y, 0.5 * y * y], axis=2) * weight[:, :, None]
        slope_x, slope_y, xx, xy, yy = (np.linalg.pinv(terms) * weight[:, None, :]).transpose(1, 0, 2) / size
        rows.append(np.repeat(fans.vertex[here], k))
        columns.append(corner.ravel())
        # slopes turned clockwise
        velocities = slope_y - 1j * slope_x, (xy - 1j * xx) / size, (yy - 1j * xy) / size
        values.append(np.stack(velocities, axis=-1).reshape(-1, 3))
    at, shape = (np.concatenate(rows), np.concatenate(columns)), (space.n, 3 * len(space.faces))
    return _Fit(*(csr_array((column, at), shape=shape) for column in np.concatenate(values).T))


def _at_boundary(
    space: SurfaceSpace, fans: Fans, stretch: NDArray, fit: _Fit, fits: NDArray[np.bool_]
) -> csr_array:
    """Velocity at boundary vertices: mean of what the fits at neighbours have there, by 1 / distance."""
    twin, tail, head = (
        space.mesh.topology.side_twin.ravel(),
        space.faces.ravel(),
        space.faces[:, NEXT].ravel(),
    )
    shared = fits & (np.bincount(tail, minlength=space.n) <= MAX_SHARED_EDGES)
    side = np.flatnonzero((twin >= 0) & shared[tail] & space.mesh.topology.boundary_vertex[head])
    angle, length = fans.angle_before * stretch, space.mesh.side_length.ravel()[side]
    total = sum_by_index(head[side], 1.0 / length, space.n)
    turn = np.exp(1j * (angle[twin[side]] + np.pi - angle[side])) / (length * total[head[side]])
    place = length * np.exp(1j * angle[side])

    def gather(factor: NDArray) -> csr_array:
        return csr_array((factor, (head[side], tail[side])), shape=(space.n, space.n))

    at_tail = gather(turn) @ fit.velocity
    return at_tail + gather(turn * place.real) @ fit.along_x + gather(turn * place.imag) @ fit.along_y


def _face_means(space: SurfaceSpace, fans: Fans, to_vertex: NDArray) -> csr_array:
    """Mean of the velocities of a vertex's faces, by angle."""
    vertex = space.faces.ravel()
    angle = fans.corner_angle.reshape(-1, 3)
    total = sum_by_index(vertex, angle.ravel(), space.n)
    turned = to_vertex * angle / total[space.faces] / (2.0 * space.area[:, None])
    first = 3 * np.repeat(np.arange(len(space.faces)), 3)
    values = np.concatenate([(turned * space.side[:, [2]]).ravel(), (-turned * space.side[:, [0]]).ravel()])
    columns = np.concatenate([first, first + 2])
    return csr_array((values, (np.tile(vertex, 2), columns)), shape=(space.n, 3 * len(space.faces)))


def _mean_values(space: SurfaceSpace, fans: Fans, stretch: NDArray) -> csr_array:
    """(n, n) mean value coordinates of the vertices among their neighbours, with the turns between frames.

    M. S. Floater, "Mean value coordinates", 2003: positive, and exact for linear functions.
    """
    twin = space.mesh.topology.side_twin.ravel()
    other = np.maximum(twin, 0)
    clockwise = other - other % 3 + NEXT[other % 3]  # the corner before, across the side that leaves this one
    half = np.tan(np.minimum(0.5 * fans.corner_angle * stretch, 1.5))
    weight = (half + np.where(twin >= 0, half[clockwise], 0.0)) / space.mesh.side_length.ravel()
    vertex, head = space.faces.ravel(), space.faces[:, NEXT].ravel()
    total = sum_by_index(vertex, weight, space.n)
    angle = fans.angle_before * stretch
    turn = np.exp(1j * (angle - angle[other] + np.pi))
    return csr_array((weight / total[vertex] * turn, (vertex, head)), shape=(space.n, space.n))
