"""Faces laid out in the plane, and the angles around vertices, for tracing lines on a surface.

Two planar frames, both from lengths alone:

- the frame of face f: corner 0 at the origin, corner 1 on the positive x axis, corner 2 above it;
- the frame of side 3f+j: its tail at the origin, its head on the positive x axis, the face above it.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import corner_angle, face_area
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.topology import NEXT, PREVIOUS, Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh, unit_side_blocks
from ddgcli.mesh.vectors import cross, dot, row_cross, row_dot, vector_length

APEX, TURN, TWIN = 0, 1, 3  # columns of Unfolding.side
ANGLE_TOLERANCE = 1e-14  # radians by which directions along a boundary may lie beyond it
_CACHE_LINE = 64  # bytes; a row of Unfolding.side fills one

# meshes are immutable, so that cached layouts stay valid
_UNFOLDING_TYPE: WeakKeyDictionary[SurfaceMesh, Unfolding] = WeakKeyDictionary()
_FANS: WeakKeyDictionary[SurfaceMesh, Fans] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Unfolding:
    """Every face in the plane, in the frame of each of its sides; lengths divided by `scale`.

    Parameters
    ----------
    scale : float
        The longest side; all lengths here are in units of it.
    side : (3m, 4) ndarray of complex128
        In the frame of the side, one cache line each: the apex (column APEX); -conj(unit direction) of the
        previous and of the next side (TURN, TURN + 1), by which a heading is multiplied to have it in the
        frame of that side's twin; the flat indices of those twins, -1 for none (two int64 in column TWIN).
    length : (3m,) ndarray of float64
    has_flat : bool
        Some faces have no height, so that lengths cannot be computed from it.
    direction : (m, 3, 2) ndarray of float64
        Unit direction of side j in the frame of its face.
    """

    scale: float
    side: NDArray[np.complex128]
    length: NDArray[np.float64]
    has_flat: bool
    direction: NDArray[np.float64]


def unfold(mesh: SurfaceMesh) -> Unfolding:
    """Lay every face out in the plane, in the frame of each of its sides.

    The layout is cached as long as the mesh exists.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    Unfolding

    Notes
    -----
    Heights come from cross products where the mesh has positions (accurate on caps), from Kahan's ordering of
    Heron's formula where it has only lengths.
    """
    if mesh not in _UNFOLDING_TYPE:
        _UNFOLDING_TYPE[mesh] = _layout(mesh)
    return _UNFOLDING_TYPE[mesh]


def _layout(mesh: SurfaceMesh) -> Unfolding:
    length = mesh.side_length
    scale = float(length.max(initial=0.0)) or 1.0
    length = length / scale
    doubled_area = 2.0 * _area(mesh, scale)
    previous, following = length[:, PREVIOUS], length[:, NEXT]
    with np.errstate(divide="ignore", invalid="ignore"):
        x = 0.5 * (length + (previous - following) * ((previous + following) / length))
        y = doubled_area[:, None] / length
        if isinstance(mesh, TriangleMesh):
            vector = mesh.side_vector / scale
            x = -row_dot(vector, vector[:, PREVIOUS]) / length
    flat = length <= 0
    x, y = np.where(flat, 0.0, x), np.where(flat, previous, y)
    next_cos, next_sin = _unit(x - length, y)
    prev_cos, prev_sin = _unit(-x, -y)
    table = cache_lines(length.size)
    turns = (x, y, -prev_cos, prev_sin, -next_cos, next_sin)
    for column, value in enumerate(turns):
        table[:, column] = value.ravel()
    twin = mesh.topology.side_twin
    glued = table.view(np.int64)
    glued[:, 2 * TWIN], glued[:, 2 * TWIN + 1] = twin[:, PREVIOUS].ravel(), twin[:, NEXT].ravel()
    has_flat = bool(min(np.abs(prev_sin).min(initial=1.0), np.abs(next_sin).min(initial=1.0)) < 1e-150)
    direction = np.zeros((len(length), 3, 2))
    direction[:, 0, 0] = 1.0
    direction[:, 1, 0], direction[:, 1, 1] = next_cos[:, 0], next_sin[:, 0]
    direction[:, 2, 0], direction[:, 2, 1] = prev_cos[:, 0], prev_sin[:, 0]
    return Unfolding(scale, table.view(np.complex128), length.ravel(), has_flat, direction)


def cache_lines(n: int) -> NDArray[np.float64]:
    """Uninitialised rows of 64 bytes that are aligned to cache lines.

    A random row then lies in one line instead of two.

    Parameters
    ----------
    n : int

    Returns
    -------
    (n, 8) ndarray of float64
    """
    buffer = np.empty(8 * n + 8)
    skip = -buffer.ctypes.data % _CACHE_LINE // 8
    return buffer[skip : skip + 8 * n].reshape(n, 8)


def _area(mesh: SurfaceMesh, scale: float) -> NDArray[np.float64]:
    if isinstance(mesh, TriangleMesh):
        vector = mesh.side_vector / scale
        return 0.5 * vector_length(row_cross(vector[:, 0], vector[:, 1]))
    return face_area(mesh.side_length / scale)


def _unit(x: NDArray, y: NDArray) -> tuple[NDArray, NDArray]:
    size = np.hypot(x, y)
    size = np.where(size > 0, size, 1.0)
    return x / size, y / size


def corner_position(unfolding: Unfolding, face: NDArray | None = None) -> NDArray[np.float64]:
    """Corners of faces in their own planar frames: corner 0 at the origin, corner 1 on the x axis.

    Parameters
    ----------
    unfolding : Unfolding
    face : (k,) ndarray of int64, optional
        By default all faces.

    Returns
    -------
    (k, 3, 2) ndarray of float64
        In the length unit of the mesh.
    """
    first = 3 * np.arange(len(unfolding.direction)) if face is None else 3 * face
    corners = np.zeros((len(first), 3, 2))
    corners[:, 1, 0] = unfolding.length[first]
    corners[:, 2] = unfolding.side[first, APEX, None].view(np.float64)
    return corners * unfolding.scale


@dataclass(frozen=True, eq=False)
class Fans:
    """Corners in counter-clockwise order around each vertex, with the angles from the first side on.

    A corner is named by the flat index 3f+k of the side that leaves it. A vertex where the surface pinches
    has several fans.

    Parameters
    ----------
    start : (c+1,) ndarray of int64
        Fan c holds `corner[start[c]:start[c+1]]`.
    corner : (3m,) ndarray of int64
    fan : (3m,) ndarray of int64
        Fan of each corner.
    angle_before : (3m,) ndarray of float64
        By corner: angle from the fan's first side to the side that leaves this corner.
    angle_before_sorted : (3m,) ndarray of float64
        The same in the order of `corner`.
    corner_angle : (3m,) ndarray of float64
    total_angle : (c,) ndarray of float64
    is_open : (c,) ndarray of bool
        The fan ends at the boundary (or at an edge with three or more faces).
    vertex : (c,) ndarray of int64
    """

    start: NDArray[np.int64]
    corner: NDArray[np.int64]
    fan: NDArray[np.int64]
    angle_before: NDArray[np.float64]
    angle_before_sorted: NDArray[np.float64]
    corner_angle: NDArray[np.float64]
    total_angle: NDArray[np.float64]
    is_open: NDArray[np.bool_]
    vertex: NDArray[np.int64]

    def angle_of(self, corner: NDArray, angle: NDArray) -> NDArray[np.float64]:
        """Angle from the fan's first side, of directions at `angle` from the sides of corners.

        Directions are those of the plane of the corner's face, unfolded by at most half a turn; a whole turn
        more or less where that alone lies in an open fan.
        """
        fan, middle = self.fan[corner], 0.5 * self.corner_angle[corner]
        turned = middle + (angle - middle + np.pi) % (2 * np.pi) - np.pi + self.angle_before[corner]
        other = turned - np.copysign(2 * np.pi, turned)
        last = self.total_angle[fan]
        outside = (turned < -ANGLE_TOLERANCE) | (turned > last + ANGLE_TOLERANCE)
        return np.where(self.is_open[fan] & outside & (other >= 0.0) & (other <= last), other, turned)

    def locate(self, fan: NDArray, angle: NDArray) -> NDArray[np.int64]:
        """Corner of `fan` whose interval of angles holds `angle` (clipped to the fan's range)."""
        low, high = self.start[fan].copy(), self.start[fan + 1].copy()
        while True:
            open_ = high - low > 1
            if not open_.any():
                return self.corner[low]
            middle = (low + high) // 2
            up = self.angle_before_sorted[middle] <= angle
            low = np.where(open_ & up, middle, low)
            high = np.where(open_ & ~up, middle, high)


def counterclockwise_corner(topology: Topology) -> NDArray[np.int64]:
    """(3m,) next corner counter-clockwise around the same vertex, -1 after the last; for oriented faces."""
    return topology.side_twin[:, PREVIOUS].ravel()


def vertex_fans(mesh: SurfaceMesh) -> Fans:
    """Order the corners around every vertex of an oriented mesh counter-clockwise.

    The fans are cached as long as the mesh exists.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Consistently oriented.

    Returns
    -------
    Fans
    """
    if mesh not in _FANS:
        _FANS[mesh] = _ordered_fans(mesh)
    return _FANS[mesh]


def _ordered_fans(mesh: SurfaceMesh) -> Fans:
    topology = mesh.topology
    corner_of_angle = face_corner_angle(mesh).ravel()
    after = counterclockwise_corner(topology)
    n = len(after)
    first, is_open = _first_corners(after)
    fan = np.full(n, -1, dtype=np.int64)
    rank = np.zeros(n, dtype=np.int64)
    angle_before = np.zeros(n)
    total = np.zeros(len(first))
    here, name, turn = first.copy(), np.arange(len(first)), 0
    while len(here):
        fan[here], rank[here], angle_before[here] = name, turn, total[name]
        total[name] += corner_of_angle[here]
        here = after[here]
        going = (here >= 0) & (here != first[name])
        here, name, turn = here[going], name[going], turn + 1
    order = np.lexsort((rank, fan))
    start = np.searchsorted(fan[order], np.arange(len(first) + 1))
    return Fans(
        start, order, fan, angle_before, angle_before[order], corner_of_angle, total, is_open,
        topology.side_tail[first],
    )  # fmt: skip


def _first_corners(after: NDArray) -> tuple[NDArray, NDArray]:
    """First corner of each fan (clockwise end of an open fan, lowest of a closed one); is it open."""
    n = len(after)
    has_before = np.zeros(n + 1, dtype=bool)
    has_before[after] = True  # -1 writes to the last, unused entry
    beginning = np.flatnonzero(~has_before[:n])
    least = np.arange(n)
    jump = np.where(after >= 0, after, np.arange(n))
    while True:  # pointer doubling: the lowest corner within 1, 2, 4, ... steps
        lower = np.minimum(least, least[jump])
        if np.array_equal(lower, least):
            break
        least, jump = lower, jump[jump]
    in_open = np.zeros(n, dtype=bool)
    here = beginning
    while len(here):
        in_open[here] = True
        here = after[here]
        here = here[here >= 0]
    closed = np.flatnonzero((least == np.arange(n)) & ~in_open)
    first = np.concatenate([beginning, closed])
    return first, np.arange(len(first)) < len(beginning)


def face_corner_angle(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Interior angle at each corner, from positions where the mesh has them, else from lengths.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh

    Returns
    -------
    (m, 3) ndarray of float64
        In radians; pi/2 beside a side of length zero.
    """
    if not isinstance(mesh, TriangleMesh):
        return corner_angle(mesh.side_length)
    angle = np.empty((mesh.n_faces, 3))
    for faces, side in unit_side_blocks(mesh):
        normal = cross(side[:, 0], side[:, 1])
        double_area = np.sqrt(dot(normal, normal))
        for j in range(3):
            inner = -dot(side[:, j], side[:, j - 1])
            angle[faces, j] = np.where(
                (double_area == 0) & (inner == 0), 0.5 * np.pi, np.arctan2(double_area, inner)
            )
    return angle
