"""T-junctions: boundary vertices inside boundary edges, where a surface has a slit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.component_sides import component_extents
from ddgcli.mesh.ragged import repeat_with_place, unique_keys
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_dot

SAMPLES_OF_A_BLOCK = 100_000
SINGLE_PRECISION = float(np.finfo(np.float32).eps)  # in which STL and most PLY files hold coordinates
ROUNDINGS = 2.0  # one of the vertex and one of the side
MAX_SHARE = 0.01  # of the length of a side: a vertex farther from it is not on it, whatever the rounding


def t_junctions(mesh: TriangleMesh, distance: float = 0.0) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sides on the boundary and the boundary vertices on them, in their order along each side.

    Parameters
    ----------
    mesh : TriangleMesh
    distance : float
        Largest distance of a vertex from the side (length units); 0: that of rounding to single precision.
        If all coordinates are single-precision numbers, that is two units in the last place along each axis;
        otherwise the coordinates may have been moved since, and it is 2.4e-7 of the extent of the
        component. In both cases at most a hundredth of the side. Vertices as close to an end of the side
        are not on it.

    Returns
    -------
    side : (k,) ndarray of int64
        Flat indices, ascending.
    vertex : (k,) ndarray of int64
    """
    size = float(np.abs(mesh.points).max(initial=0.0)) or 1.0
    points = mesh.points / size  # products of coordinates stay in the floating-point range
    topology = mesh.topology
    side = np.flatnonzero(topology.edge_face_count[topology.side_edge.ravel()] == 1)
    candidates = np.flatnonzero(topology.boundary_vertex)
    if not len(side):
        return side, candidates[:0]
    tail, head = topology.side_tail[side], topology.side_head[side]
    length = np.linalg.norm(points[head] - points[tail], axis=1)
    box = np.full(points.shape, distance / size) if distance else _roundings(mesh) / size
    farthest = float(np.linalg.norm(box, axis=1).max())
    most = np.full(len(side), distance / size) if distance else np.minimum(MAX_SHARE * length, farthest)
    row, vertex = _near_pairs(points[tail], points[head], points[candidates], float(most.max()))
    vertex = candidates[vertex]
    start, length = points[tail[row]], length[row]
    unit = (points[head[row]] - start) / np.maximum(length, np.finfo(float).tiny)[:, None]
    place = row_dot(points[vertex] - start, unit)
    gap = points[vertex] - start - place[:, None] * unit
    moved = np.maximum(np.maximum(box[tail[row]], box[head[row]]), box[vertex])
    limit = np.minimum(most[row], np.linalg.norm(moved, axis=1))
    on_edge = (np.linalg.norm(gap, axis=1) <= limit) & (np.abs(gap) <= _largest_gap(unit, moved)).all(axis=1)
    on_edge &= (place > limit) & (place < length - limit)
    on_edge &= (mesh.faces[side[row] // 3] != vertex[:, None]).all(axis=1)
    row, vertex, place, limit = row[on_edge], vertex[on_edge], place[on_edge], limit[on_edge]
    order = np.lexsort((place, row))
    row, vertex, place, limit = row[order], vertex[order], place[order], limit[order]
    apart = np.ones(len(row), dtype=bool)  # of several vertices at one place the first one
    apart[1:] = (row[1:] != row[:-1]) | (np.diff(place) > limit[1:])
    return side[row[apart]], vertex[apart]


def _roundings(mesh: TriangleMesh) -> NDArray[np.float64]:
    """(n, 3) displacements of vertices along the axes that rounding to single precision explains."""
    points = mesh.points
    with np.errstate(over="ignore", under="ignore"):
        is_single = np.array_equal(points.astype(np.float32), points)
    if is_single:
        return ROUNDINGS * SINGLE_PRECISION * np.abs(points)
    # the coordinates may have been moved since: those of the component about its own middle count
    extent = ROUNDINGS * SINGLE_PRECISION * np.append(component_extents(mesh), 0.0)
    return np.repeat(extent.take(mesh.topology.vertex_component)[:, None], 3, axis=1)


def _largest_gap(unit: NDArray, box: NDArray) -> NDArray[np.float64]:
    """(k, 3) largest components, across lines of direction `unit`, of displacements within boxes."""
    across = np.eye(3) - unit[:, :, None] * unit[:, None, :]
    # rounding of the products themselves
    return np.einsum("nij,nj->ni", np.abs(across), box) * (1.0 + 1e-9)


def _near_pairs(
    tail: NDArray, head: NDArray, points: NDArray, limit: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Segments and points near them: all pairs within the limit, and others.

    Points are searched around samples of the segments, as far apart as a segment is long on average: twice
    as many samples as segments at most.
    """
    from scipy.spatial import cKDTree  # runs that only warn of pieces do without

    length = np.linalg.norm(head - tail, axis=1)
    spacing = max(float(length.mean()), limit, np.finfo(float).tiny)
    count = np.maximum(np.ceil(length / spacing), 1.0).astype(np.int64)
    row, rank = repeat_with_place(np.arange(len(count)), count)
    share = ((rank + 0.5) / count[row])[:, None]
    samples = (1.0 - share) * tail[row] + share * head[row]
    radius = (0.5 * float((length / count).max()) + limit) * (1.0 + 1e-9)
    tree, pair_blocks = cKDTree(points), []
    for begin in range(0, len(samples), SAMPLES_OF_A_BLOCK):
        block = cKDTree(samples[begin : begin + SAMPLES_OF_A_BLOCK])
        near = block.sparse_distance_matrix(tree, radius, output_type="ndarray")
        pair_blocks.append(unique_keys(row[begin + near["i"]] * np.int64(len(points)) + near["j"]))
    pairs = unique_keys(np.concatenate(pair_blocks))
    return pairs // len(points), pairs % len(points)
