"""T-junctions: boundary vertices inside boundary edges, where a surface has a slit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.ragged import repeat_with_place, unique_keys
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_dot

SAMPLES_OF_A_BLOCK = 100_000
ROUNDINGS = 4.0  # of single precision, in which STL and most PLY files hold coordinates


def t_junctions(mesh: TriangleMesh, distance: float = 0.0) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sides on the boundary and the boundary vertices on them, in their order along each side.

    Parameters
    ----------
    mesh : TriangleMesh
    distance : float
        Of a vertex from the side (length units); 0: `ROUNDINGS` of single precision of the coordinates.
        Vertices as close to an end of the side are not on it.

    Returns
    -------
    side : (k,) ndarray of int64
        Flat numbers, ascending.
    vertex : (k,) ndarray of int64
    """
    size = float(np.abs(mesh.points).max(initial=0.0)) or 1.0
    points = mesh.points / size  # products of coordinates stay in the range of numbers
    limit = distance / size or ROUNDINGS * float(np.finfo(np.float32).eps)
    topology = mesh.topology
    side = np.flatnonzero(topology.edge_face_count[topology.side_edge.ravel()] == 1)
    candidates = np.flatnonzero(topology.boundary_vertex)
    if not len(side):
        return side, candidates[:0]
    tail, head = topology.side_tail[side], topology.side_head[side]
    row, vertex = _near_pairs(points[tail], points[head], points[candidates], limit)
    vertex = candidates[vertex]
    start, along = points[tail[row]], points[head[row]] - points[tail[row]]
    length = np.linalg.norm(along, axis=1)
    unit = along / np.maximum(length, np.finfo(float).tiny)[:, None]
    place = row_dot(points[vertex] - start, unit)
    gap = np.linalg.norm(points[vertex] - start - place[:, None] * unit, axis=1)
    on_edge = (gap <= limit) & (place > limit) & (place < length - limit)
    on_edge &= (mesh.faces[side[row] // 3] != vertex[:, None]).all(axis=1)
    row, vertex, place = row[on_edge], vertex[on_edge], place[on_edge]
    order = np.lexsort((place, row))
    row, vertex, place = row[order], vertex[order], place[order]
    apart = np.ones(len(row), dtype=bool)  # of several vertices at one place the first one
    apart[1:] = (row[1:] != row[:-1]) | (np.diff(place) > limit)
    return side[row[apart]], vertex[apart]


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
