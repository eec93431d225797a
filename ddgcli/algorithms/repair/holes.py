"""Small holes filled with triangles of least area.

The triangulation of a boundary loop is the one of least total area among all without new vertices, by dynamic
programming over the loop [G. Barequet and M. Sharir, "Filling gaps in the boundary of a polyhedron", 1995].
Triangles without area are the last choice: a loop with straight parts has others. Where a loop is straight as
a whole, such as that of a removed face without area, the face beyond its longest edge is divided instead.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ddgcli.algorithms.repair.steps import RepairedMesh
from ddgcli.mesh.boundary import boundary_vertex_loops
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import cross, dot

SLIVER_AREA = 1e-9  # of the longest side squared; triangles with less are the last choice
CACHED_TRIANGLES = 1 << 13  # whose costs are computed at once
SHAPE_WEIGHT = 1e-6  # of the squared sides beside twice the area: decides where areas are equal


def fill_holes(repaired: RepairedMesh, most_edges: int) -> RepairedMesh:
    """Fill every boundary loop of at most `most_edges` edges.

    A loop that cannot be closed without an edge or a face that exists already stays open: that of a single
    face would be filled by the same face. Of a triangle without area
    the longest edge is flipped, so that both new faces have one, or a vertex of three faces left out.

    Parameters
    ----------
    repaired : RepairedMesh
        An oriented manifold.
    most_edges : int

    Returns
    -------
    RepairedMesh
        `changes` counts the loops.
    """
    mesh = repaired.mesh
    both_on_boundary = mesh.topology.boundary_vertex[mesh.topology.edges].all(axis=1)
    edges = mesh.topology.edges[both_on_boundary]
    added, filled = [mesh.faces], 0
    alone = (mesh.topology.edge_face_count == 1)[mesh.topology.side_edge].all(axis=1)
    single = {tuple(sorted(face)) for face in mesh.faces[alone].tolist()}
    for loop in boundary_vertex_loops(mesh.topology):
        if len(loop) <= most_edges and tuple(sorted(loop.tolist())) not in single:
            triangles = least_area_triangles(mesh.points, loop[::-1], edges)
            filled += triangles is not None
            added += [triangles] if triangles is not None else []
    faces = np.concatenate(added)
    source = np.concatenate([repaired.input_face, np.full(len(faces) - mesh.n_faces, -1)])
    closed = TriangleMesh.from_arrays(mesh.points, faces)
    if filled and len(closed.flat_faces):
        faces, index = _without_flat_faces(closed, mesh.n_faces)
        closed, source = TriangleMesh.from_arrays(mesh.points, faces), source[index]
    return RepairedMesh(closed, repaired.input_vertex, source, filled)


def _without_flat_faces(mesh: TriangleMesh, first: int) -> tuple[NDArray, NDArray[np.int64]]:
    """Faces with the longest edge flipped of each face from `first` on without area; the old index of each.

    Where the new edge exists as the third one of a vertex, the three faces of this vertex become one. A face
    stays where it has no neighbour there, or a new face would have no area either.
    """
    faces, index = mesh.faces.copy(), np.arange(mesh.n_faces)
    flat = mesh.flat_faces[mesh.flat_faces >= first]
    beside = np.flatnonzero(np.isin(faces, faces[flat]).sum(axis=1) > 1)
    face_of = {side: face for face in beside.tolist() for side in _sides(faces[face])}
    changed: set[int] = set()
    for face in flat.tolist():
        old, new = ([], []) if face in changed else _replacement(mesh.points, faces, face, face_of)
        if not new or len(TriangleMesh.from_arrays(mesh.points, np.array(new)).flat_faces):
            continue
        changed.update(old)
        for side in [side for k in old for side in _sides(faces[k])]:
            del face_of[side]
        for k, corners in zip(old, new):
            faces[k], index[k] = corners, old[0]
            face_of |= dict.fromkeys(_sides(faces[k]), k)
        index[old[len(new) :]] = -1
    return faces[index >= 0], index[index >= 0]


def _replacement(
    points: NDArray, faces: NDArray, face: int, face_of: dict[tuple[int, int], int]
) -> tuple[list[int], list[list[int]]]:
    """Numbers of faces, first the one beyond the longest edge of `face`, and what takes their place."""
    j = int(np.linalg.norm(points[faces[face, NEXT]] - points[faces[face]], axis=1).argmax())
    a, b, x = np.roll(faces[face], -j).tolist()
    if (other := face_of.get((b, a))) is None:
        return [], []
    c = next(int(v) for v in faces[other] if v not in (a, b))
    ahead, behind = face_of.get((c, x)), face_of.get((x, c))
    if ahead is None and behind is None:
        return [other, face], [[x, a, c], [c, b, x]]
    if ahead is not None and ahead == face_of.get((x, b)):  # b has no other face
        return [other, face, ahead], [[x, a, c]]
    if behind is not None and behind == face_of.get((a, x)):
        return [other, face, behind], [[c, b, x]]
    return [], []


def _sides(face: NDArray) -> list[tuple[int, int]]:
    a, b, c = face.tolist()
    return [(a, b), (b, c), (c, a)]


def least_area_triangles(points: NDArray, loop: NDArray, edges: NDArray) -> NDArray[np.int64] | None:
    """(k-2, 3) triangles of least total area over a loop of k vertices, in its order.

    Diagonals that are among the (e, 2) `edges` are not used; None where no triangulation is left.
    """
    k = len(loop)
    corner = (points[loop] - points[loop].mean(axis=0)).T
    sides = corner - np.roll(corner, 1, axis=1)
    sliver_cost = np.sqrt(dot(sides, sides)).sum() ** 2  # above any area
    forbidden = _joined_pairs(loop, edges)
    # by first corner and number of sides of a chord; `_to` by last corner
    cost, cost_to = np.full((2, k, k), np.inf)
    cost[:, 1] = cost_to[:, 1] = 0.0
    squared, squared_to = _squared_chords(corner)
    apex = np.zeros((k, k), dtype=np.int64)
    for gap in range(2, k):
        chord = sliding_window_view(corner, gap + 1, axis=1)
        step = max(1, CACHED_TRIANGLES // gap)
        for begin in range(0, k - gap, step):
            end = min(begin + step, k - gap)
            here, there = slice(begin, end), slice(begin + gap, end + gap)
            ahead, back = slice(1, gap), slice(gap - 1, 0, -1)
            total = _triangle_costs(
                chord[:, here], squared[here, ahead], squared_to[there, back], squared[here, gap, None],
                sliver_cost,
            )  # fmt: skip
            total += cost[here, ahead]
            total += cost_to[there, back]
            best, first = total.argmin(axis=1), np.arange(begin, end)
            least = total[first - begin, best]
            if gap < k - 1:
                least[forbidden[first, first + gap]] = np.inf
            cost[first, gap] = cost_to[first + gap, gap] = least
            apex[first, gap] = first + 1 + best
    if not np.isfinite(cost[0, k - 1]):
        return None
    triangles, intervals = [], [(0, k - 1)]
    while intervals:
        i, j = intervals.pop()
        if j - i > 1:
            middle = int(apex[i, j - i])
            triangles.append((loop[i], loop[middle], loop[j]))
            intervals += [(i, middle), (middle, j)]
    return np.array(triangles, dtype=np.int64)


def _squared_chords(corner: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(k, k) squared length of the chord over d sides from corner i on, and of that up to corner i."""
    k = corner.shape[1]
    one, other = np.arange(k)[:, None], np.arange(k)
    chords = [corner[:, one] - corner[:, np.clip(one + sign * other, 0, k - 1)] for sign in (1, -1)]
    return dot(chords[0], chords[0]), dot(chords[1], chords[1])


def _triangle_costs(
    chord: NDArray, ahead: NDArray, back: NDArray, across: NDArray, sliver_cost: float
) -> NDArray[np.float64]:
    """(c, g - 1) costs of the triangles between the ends of chords and the corners between them.

    `chord` has the (3, c, g + 1) corners, `ahead`, `back` and `across` the squared lengths of the sides.
    """
    normal = cross(chord[:, :, 1:-1] - chord[:, :, :1], chord[:, :, -1:] - chord[:, :, :1])
    area = np.sqrt(dot(normal, normal))
    longest = np.maximum(np.maximum(ahead, back), across)
    area += sliver_cost * (area <= SLIVER_AREA * longest)
    area += SHAPE_WEIGHT * (ahead + back + across)
    return area


def _joined_pairs(loop: NDArray, edges: NDArray) -> NDArray[np.bool_]:
    """(k, k) whether an edge joins two vertices of a loop."""
    k, order = len(loop), np.argsort(loop)
    place = np.searchsorted(loop, edges, sorter=order).clip(max=k - 1)
    place = order[place]
    i, j = place[(loop[place] == edges).all(axis=1)].T
    joined = np.zeros((k, k), dtype=bool)
    joined[i, j] = joined[j, i] = True
    return joined
