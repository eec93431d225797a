"""Local changes of tetrahedra that fill the same space: edge and face removal, collapse, loss of a flat cell.

L. A. Freitag and C. Ollivier-Gooch, "Tetrahedral mesh improvement using swapping and smoothing", 1997.
J. R. Shewchuk, "Two discrete optimization algorithms for the topological improvement of
tetrahedral meshes", 2002.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ddgcli.mesh.cell_complex import Cell, CellComplex
from ddgcli.mesh.tet_mesh import FLAT_POSITION_TOLERANCE, TET_EDGES, TET_FACES
from ddgcli.mesh.vectors import row_cross, row_dot, vector_length

MAX_RING = 10  # cells round an edge that is removed
FLAT_FACE_TOLERANCE = 1e-7  # area of a side of a flat cell, over its largest: the side is a line
VOLUME_TOLERANCE = 1e-12  # relative; rounding of sums
MAX_LOST_SHARE = 1e-4  # volume of a cell at the boundary that disappears, over the largest around it
GHOST = -1  # apex of the cones over the boundary, which close a body


@dataclass(frozen=True)
class Move:
    """Cells, and those that fill the same space.

    Parameters
    ----------
    old : tuple of int
        Indices of cells.
    new : tuple of tuple of int
        Corners, positively oriented.
    gain : int
        Flat cells among the old ones less those among the new.
    quality : float
        Least volume of a new cell over its longest edge cubed.
    merges : tuple of int
        Vertex that disappears, and the one that takes its place; empty if none does.
    """

    old: tuple[int, ...]
    new: tuple[Cell, ...]
    gain: int
    quality: float
    merges: tuple[int, ...] = ()


def moves_at(cells: CellComplex, cell: int) -> Iterator[Move]:
    """Changes of the cells at the edges and the faces of a cell.

    Parameters
    ----------
    cells : CellComplex
    cell : int

    Yields
    ------
    Move
    """
    corners = cells.corners(cell)
    candidates = [edge_removal(cells, corners[i], corners[j]) for i, j in TET_EDGES.tolist()]
    candidates += [face_removal(cells, cell, corner) for corner in corners]
    yield from (move for move in candidates if move is not None)


def boundary_loss(cells: CellComplex, cell: int) -> Move | None:
    """Loss of a flat cell one of whose two sides lies on the boundary: the other side takes its place there.

    So does the only face that three faces on the boundary leave.

    Parameters
    ----------
    cells : CellComplex
    cell : int

    Returns
    -------
    Move or None
        None where the boundary would change, or touch itself, and where the cell is no smaller than those
        around it, as in a thin body.
    """
    corners = cells.corners(cell)
    near = cells.near(cell) - {cell}
    volume, *others = np.abs(cells.volumes([corners, *map(cells.corners, near)])).tolist()
    if others and volume > MAX_LOST_SHARE * max(others):
        return None
    faces = [tuple(corners[i] for i in face) for face in TET_FACES.tolist()]
    is_outer = [len(cells.around(*face)) == 1 for face in faces]
    p = cells.points[np.array(faces)]
    normal = row_cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    area = vector_length(normal)
    k = int(area.argmax())
    side = row_dot(normal, normal[k]) / (area[k] ** 2 or 1.0)
    upper, lower = (sign * side > FLAT_FACE_TOLERANCE for sign in (1, -1))
    one_sided = any((outer[a].all() and not outer[b].any()) for outer in [np.array(is_outer)]
                    for a, b in ((upper, lower), (lower, upper)))  # fmt: skip
    rest = [corners[i] for i in range(4) if is_outer[i]]  # opposite the sides on the boundary
    if sum(is_outer) < 3 and not (one_sided and any(is_outer)):
        return None
    if sum(is_outer) in (1, 2) and _on_boundary(cells, *rest):
        return None
    return Move((cell,), (), 1, math.inf)


def _on_boundary(cells: CellComplex, *vertices: int) -> bool:
    """Whether a vertex or an edge belongs to a side of one cell alone."""
    around = cells.around(*vertices)
    for cell in around:
        corners = cells.corners(cell)
        for face in combinations(corners, 3):
            if set(vertices) <= set(face) and len(cells.around(*face)) == 1:
                return True
    return False


def edge_removal(cells: CellComplex, a: int, b: int) -> Move | None:
    """Replace the cells round an edge by two pyramids over the best triangulation of their ring.

    On the boundary, the two faces at the edge lie in one plane, and turn into those at the other diagonal.

    Parameters
    ----------
    cells : CellComplex
    a, b : int
        Ends of the edge.

    Returns
    -------
    Move or None
        None where every triangulation inverts cells, or the edge has more than `MAX_RING` cells.
    """
    around = sorted(cells.around(a, b))
    if not 2 <= len(around) <= MAX_RING:
        return None
    ring, is_closed = _ring([set(cells.corners(cell)) - {a, b} for cell in around])
    n = len(ring)
    if n < 3 or (not is_closed and cells.around(ring[0], ring[-1])):
        return None
    sides = [(a, b, ring[i], ring[(i + 1) % n]) for i in range(n)]
    shape = cells.shapes(sides)
    if not is_closed and abs(shape[-1]) > FLAT_POSITION_TOLERANCE:
        return None
    shape = shape if is_closed else shape[:-1]
    if shape.min() < -FLAT_POSITION_TOLERANCE:
        ring, shape = ring[::-1], -shape
    if shape.min() < -FLAT_POSITION_TOLERANCE:  # the cells fold over
        return None
    if n == 3 and cells.around(*ring):
        return None
    best = _best_pyramids(cells, a, b, ring)
    if best is None:
        return None
    n_flat, quality, new = best
    return Move(tuple(around), new, int((shape <= FLAT_POSITION_TOLERANCE).sum()) - n_flat, quality)


def _ring(pairs: Sequence[set[int]]) -> tuple[list[int], bool]:
    """Vertices of pairs in the order in which these join them, and whether they close; empty if branched."""
    next_to: dict[int, list[int]] = {}
    for first, second in pairs:
        next_to.setdefault(first, []).append(second)
        next_to.setdefault(second, []).append(first)
    ends = [vertex for vertex, others in next_to.items() if len(others) == 1]
    if len(ends) not in (0, 2) or max(map(len, next_to.values())) > 2:
        return [], False
    ring = [min(ends) if ends else min(next_to)]
    while len(ring) <= len(pairs):
        ahead = [vertex for vertex in next_to[ring[-1]] if vertex not in ring[-2:]]
        if not ahead or ahead[0] == ring[0]:
            break
        ring.append(ahead[0])
    return (ring, not ends) if len(ring) == len(next_to) else ([], False)


def _best_pyramids(
    cells: CellComplex, a: int, b: int, ring: list[int]
) -> tuple[int, float, tuple[Cell, ...]] | None:
    """Fewest flat cells, then largest least quality, of the triangulations of a ring with two poles.

    Dynamic programming over the chords, none of which is an edge already (G. T. Klincsek, 1980).
    """
    n = len(ring)
    triples = list(combinations(range(n), 3))
    pyramids: list[tuple[Cell, Cell]] = [
        ((a, ring[i], ring[j], ring[k]), (b, ring[i], ring[k], ring[j])) for i, j, k in triples
    ]
    shape = cells.shapes([cell for pair in pyramids for cell in pair]).reshape(-1, 2)
    is_flat = (shape <= FLAT_POSITION_TOLERANCE).sum(axis=1).tolist()
    least = shape.min(axis=1).tolist()
    by_triple = dict(zip(triples, zip(is_flat, least, pyramids)))
    best: dict[tuple[int, int], tuple[int, float, tuple[Cell, ...]]] = {
        (i, i + 1): (0, math.inf, ()) for i in range(n - 1)
    }
    for span in range(2, n):
        for i in range(n - span):
            j = i + span
            if span < n - 1 and cells.around(ring[i], ring[j]):
                continue
            for k in range(i + 1, j):
                n_flat, quality, pair = by_triple[i, k, j]
                left, right = best.get((i, k)), best.get((k, j))
                if quality < -FLAT_POSITION_TOLERANCE or left is None or right is None:
                    continue
                option = (n_flat + left[0] + right[0], min(quality, left[1], right[1]))
                other = best.get((i, j))
                if other is None or (option[0], -option[1]) < (other[0], -other[1]):
                    best[i, j] = (*option, (*pair, *left[2], *right[2]))
    return best.get((0, n - 1))


def face_removal(cells: CellComplex, cell: int, corner: int) -> Move | None:
    """Replace the two cells at a face by three round the line between their tips.

    Parameters
    ----------
    cells : CellComplex
    cell : int
    corner : int
        Tip of the cell over the face.

    Returns
    -------
    Move or None
        None on the boundary, or where a cell would be inverted.
    """
    a, b, c = (vertex for vertex in cells.corners(cell) if vertex != corner)
    beyond = cells.around(a, b, c) - {cell}
    if len(beyond) != 1:
        return None
    other = beyond.pop()
    (tip,) = set(cells.corners(other)) - {a, b, c}
    if cells.around(corner, tip):
        return None
    shape = cells.shapes([(a, b, c, corner), (a, c, b, tip)])
    if shape.min() < -FLAT_POSITION_TOLERANCE:
        b, c, shape = c, b, -shape
    new = ((tip, corner, a, b), (tip, corner, b, c), (tip, corner, c, a))
    after = cells.shapes(new)
    if min(shape.min(), after.min()) < -FLAT_POSITION_TOLERANCE:
        return None
    gain = int((shape <= FLAT_POSITION_TOLERANCE).sum()) - int((after <= FLAT_POSITION_TOLERANCE).sum())
    return Move((cell, other), new, gain, float(after.min()))


def collapse(cells: CellComplex, vertex: int, target: int) -> Move | None:
    """Merge a vertex inside the body, or one at the place of another, into that other.

    Parameters
    ----------
    cells : CellComplex
    vertex, target : int
        Ends of an edge.

    Returns
    -------
    Move or None
        None where the boundary or the topology would change, or a cell would be inverted.
    """
    around = sorted(cells.around(vertex))
    before = [cells.corners(cell) for cell in around]
    moved = [corners for corners in before if target not in corners]
    new = [(target if a == vertex else a, target if b == vertex else b, target if c == vertex else c,
            target if d == vertex else d) for a, b, c, d in moved]  # fmt: skip
    volume, volume_after = (float(np.abs(cells.volumes(group)).sum()) for group in (before, new))
    if not new or volume_after > volume * (1.0 + VOLUME_TOLERANCE):  # cells are inverted
        return None
    of_vertex, of_target = _link(cells, vertex), _link(cells, target)
    is_outer = any(GHOST in face for face in of_vertex)
    if is_outer and (cells.points[vertex] != cells.points[target]).any():
        return None
    of_edge = {face - {target} for face in of_vertex if target in face}
    if of_vertex & of_target or any(
        _subsets(of_vertex, size) & _subsets(of_target, size) != _subsets(of_edge, size) for size in (1, 2)
    ):
        return None
    shape, after = cells.shapes(before), cells.shapes(new)
    gain = int((np.abs(shape) <= FLAT_POSITION_TOLERANCE).sum())
    gain -= int((np.abs(after) <= FLAT_POSITION_TOLERANCE).sum())
    new = [(a, b, c, d) if value >= 0 else (b, a, c, d) for (a, b, c, d), value in zip(new, after)]
    return Move(tuple(around), tuple(new), gain, float(np.abs(after).min()), (vertex, target))


def _link(cells: CellComplex, vertex: int) -> set[frozenset[int]]:
    """Triangles opposite a vertex in its cells, and in cones over the boundary faces at it."""
    result = set()
    for cell in cells.around(vertex):
        others = [v for v in cells.corners(cell) if v != vertex]
        result.add(frozenset(others))
        for a, b in combinations(others, 2):
            if len(cells.around(vertex, a, b)) == 1:
                result.add(frozenset((a, b, GHOST)))
    return result


def _subsets(faces: set[frozenset[int]], size: int) -> set[frozenset[int]]:
    return {frozenset(subset) for face in faces for subset in combinations(face, size)}
