"""Locate circumcentres of intrinsic Delaunay faces, and find the faces that their insertion changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.delaunay.flips import SideArrays
from ddgcli.algorithms.delaunay.gluing import around

MAX_TRACE_STEPS = 1000
MIN_BARYCENTRIC = 1e-3  # least barycentric coordinate of a point in the intrinsic face that it cuts
# values of `Targets.status`: where a point to insert is, relative to the surface
INSIDE, OUTSIDE, ON_BOUNDARY, UNKNOWN = 0, 1, 2, 3


@dataclass(eq=False)
class Targets:
    """Positions of circumcentres, in the face of `side` laid out in the plane of complex numbers."""

    status: NDArray[np.int64]
    side: NDArray[np.int64]
    corners: NDArray[np.complex128]  # (k, 3) tail, head and apex of the side
    centre: NDArray[np.complex128]

    def __getitem__(self, rows: NDArray) -> Targets:
        return Targets(self.status[rows], self.side[rows], self.corners[rows], self.centre[rows])


def triangle_share(corners: NDArray, point: NDArray) -> NDArray[np.float64]:
    """Barycentric coordinates of points in planar triangles.

    Parameters
    ----------
    corners : (k, 3) ndarray of complex128
    point : (k,) ndarray of complex128

    Returns
    -------
    (k, 3) ndarray of float64
        Negative where the point lies outside.
    """
    away = corners - point[:, None]
    corner_area = planar_cross(away[:, [1, 2, 0]], away[:, [2, 0, 1]])
    return corner_area / planar_cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, None]


def pushed_inside(corners: NDArray, point: NDArray) -> NDArray[np.complex128]:
    """Move points into their triangles, far enough that no piece of a cut face is flat.

    Parameters
    ----------
    corners : (k, 3) ndarray of complex128
    point : (k,) ndarray of complex128

    Returns
    -------
    (k,) ndarray of complex128
        With no barycentric coordinate much below `MIN_BARYCENTRIC`.
    """
    share = np.maximum(triangle_share(corners, point), MIN_BARYCENTRIC)
    return (share * corners).sum(axis=1) / share.sum(axis=1)


def apex_of(state: SideArrays, side: NDArray) -> NDArray[np.complex128]:
    """Corner opposite each side, in the frame where the side runs from 0 to 1.

    Parameters
    ----------
    state : SideArrays
    side : (k,) ndarray of int64

    Returns
    -------
    (k,) ndarray of complex128
    """
    _, following, previous = around(side)
    t = state.tangent[following]
    return (1 + 1j * t) ** 2 / (1 + t * t) * (state.length[previous] / state.length[side])


def seek_circumcentres(state: SideArrays, face: NDArray) -> Targets:
    """Trace straight lines from Delaunay faces to their circumcentres.

    The circumdisk of a face is flat and contains no vertex, so the line across the longest side is unique.

    Parameters
    ----------
    state : SideArrays
        Side arrays of a Delaunay triangulation.
    face : (k,) ndarray of int64

    Returns
    -------
    Targets
        The face that contains each circumcentre, or the boundary side that the line meets.
    """
    tangent = state.tangent.reshape(-1, 3)[face]
    widest = tangent.argmax(axis=1)
    side = 3 * face + widest
    length = state.length[side]
    t = tangent[np.arange(len(face)), widest]
    centre = 0.5 * length * (1 + 0.5j * (1 / t - t))
    corners = np.stack([np.zeros(len(face)), length, apex_of(state, side) * length], axis=1)
    start = corners.mean(axis=1)
    targets = Targets(np.full(len(face), INSIDE), side, corners, centre)
    going = np.flatnonzero(t > 1.0)
    for _ in range(MAX_TRACE_STEPS):
        if len(going) == 0:
            return targets
        entered = state.twin[targets.side[going]]
        closed = entered >= 0
        targets.status[going[~closed]] = OUTSIDE
        going, entered = going[closed], entered[closed]
        left, right = targets.corners[going, 1], targets.corners[going, 0]
        apex = left + apex_of(state, entered) * (right - left)
        targets.side[going] = entered
        targets.corners[going] = np.stack([left, right, apex], axis=1)
        aim = targets.centre[going]
        beyond = (planar_cross(apex - right, aim - right) < 0) | (planar_cross(left - apex, aim - apex) < 0)
        going, left, right, apex, aim = going[beyond], left[beyond], right[beyond], apex[beyond], aim[beyond]
        # targets.corners holds tail and head of the side to leave by: the one that the line crosses
        apex_is_left = planar_cross(aim - start[going], apex - start[going]) > 0
        _, following, previous = around(targets.side[going])
        targets.side[going] = np.where(apex_is_left, following, previous)
        targets.corners[going, 0] = np.where(apex_is_left, right, apex)
        targets.corners[going, 1] = np.where(apex_is_left, apex, left)
        targets.corners[going, 2] = np.where(apex_is_left, left, right)
    targets.status[going] = UNKNOWN
    return targets


@dataclass(eq=False)
class Cavity:
    """Faces whose circumdisks hold the points of targets, and those around them, in pairs (some repeated).

    `encroached` is a boundary side whose diametral disk holds the point, -1 where there is none.
    """

    item: NDArray[np.int64]
    face: NDArray[np.int64]
    encroached: NDArray[np.int64]


def conflict_cavity(state: SideArrays, targets: Targets) -> Cavity:
    """Collect, from the face of each target outward, the faces that its insertion changes.

    Parameters
    ----------
    state : SideArrays
        Side arrays of a Delaunay triangulation.
    targets : Targets

    Returns
    -------
    Cavity
    """
    k = len(targets.side)
    encroached = np.full(k, -1)
    item, side, corners = np.arange(k), targets.side, targets.corners
    items, faces = [item], [side // 3]
    _, following, previous = around(side)
    item = np.tile(item, 3)
    side = np.concatenate([side, following, previous])
    ends = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    for _ in range(MAX_TRACE_STEPS):
        tail, head = ends.T
        twin, point = state.twin[side], targets.centre[item]
        within = ((tail - point) * np.conj(head - point)).real < -1e-12 * np.abs(head - tail) ** 2
        near = (twin < 0) & within
        encroached[item[near]] = side[near]
        inner = twin >= 0
        item, twin, tail, head, point = item[inner], twin[inner], head[inner], tail[inner], point[inner]
        items.append(item)
        faces.append(twin // 3)
        t = state.tangent[twin]
        centre = tail + (head - tail) * (0.5 + 0.25j * (1 / t - t))
        holds = np.abs(point - centre) < np.abs(tail - centre) * (1 - 1e-12)
        item, twin, tail, head = item[holds], twin[holds], tail[holds], head[holds]
        if len(item) == 0:
            break
        apex = tail + apex_of(state, twin) * (head - tail)
        _, following, previous = around(twin)
        item, side = np.tile(item, 2), np.concatenate([following, previous])
        ends = np.stack([np.concatenate([head, apex]), np.concatenate([apex, tail])], axis=1)
    return Cavity(np.concatenate(items), np.concatenate(faces), encroached)


def planar_cross(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Cross products of vectors in the plane of complex numbers."""
    return (np.conj(a) * b).imag
