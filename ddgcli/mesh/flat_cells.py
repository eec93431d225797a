"""Removal of flat tetrahedra (slivers) so that the others fill the same body."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.cell_complex import CellComplex
from ddgcli.mesh.cell_moves import Move, boundary_loss, collapse, edge_removal, moves_at
from ddgcli.mesh.coincident_faces import flat_gaps
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.vectors import vector_length

MAX_DEPTH = 3  # changes before one that removes the flat cell
MAX_DEGREE = 30  # edges that are removed before a vertex
MAX_FAILURES = 60  # searches without success before the other flat cells are left
MAX_MOVES = 500  # that the search for a chain of changes at one flat cell looks at


@dataclass(frozen=True, eq=False)
class FlatCellRepair:
    """Tetrahedra after the removal of flat ones.

    Parameters
    ----------
    tetrahedra : (k, 4) ndarray of int64
    origin : (k,) ndarray of int64
        Input cell of each; for a cell that replaces others, the nearest of those.
    merged : dict of int to int
        Vertices that no longer exist, and those in their place.
    flat : (f,) ndarray of int64
        Flat cells that are left.
    gaps : int
        Flat gaps that are closed.
    """

    tetrahedra: NDArray[np.int64]
    origin: NDArray[np.int64]
    merged: dict[int, int]
    flat: NDArray[np.int64]
    gaps: int = 0


def without_flat_cells(mesh: TetMesh) -> FlatCellRepair:
    """Remove flat cells: at the boundary alone, inside by changes of the cells around them.

    A flat cell with one side on the boundary disappears. Inside, the cells round an edge or at a face are
    replaced, after up to two further changes nearby; or a vertex of the flat cell merges into another of its
    vertices. Cells that name a vertex twice disappear. Flat gaps, where a flat cell is missing, close in the
    same way.

    Parameters
    ----------
    mesh : TetMesh

    Returns
    -------
    FlatCellRepair
    """
    ordered = np.sort(mesh.tetrahedra, axis=1)
    proper = np.flatnonzero((ordered[:, 1:] != ordered[:, :-1]).all(axis=1))
    cells = TetMesh(mesh.points, mesh.tetrahedra[proper])
    gaps = flat_gaps(cells, merged=False)
    if len(gaps):
        sides = np.concatenate([np.sort(cells.boundary.faces, axis=1), gaps[:, :3]])
        _, first, index = np.unique(sides, axis=0, return_index=True, return_inverse=True)
        neighbour = cells.boundary_cell[first[index.ravel()[-len(gaps) :]]]
        filled = _repaired(mesh.points, np.concatenate([cells.tetrahedra, gaps]))
        origin = np.concatenate([proper, proper[neighbour]])[filled.origin]
        if len(filled.flat) == 0:
            return replace(filled, origin=origin, gaps=len(gaps))
    result = _repaired(mesh.points, cells.tetrahedra)
    return replace(result, origin=proper[result.origin])


def _repaired(points: NDArray, tetrahedra: NDArray) -> FlatCellRepair:
    cells = CellComplex(points, tetrahedra)
    pending = TetMesh(points, tetrahedra).flat_tetrahedra.tolist()
    steps = [_remove, _remove_by_chain, _remove_by_merge, _remove_with_vertex]
    failures: dict[tuple[str, int], frozenset[int]] = {}
    while pending:
        for step in steps:
            n_removed, pending = _sweep(cells, pending, step, failures)
            if n_removed:
                break
        else:
            break
    corners, origin = cells.arrays()
    flat = TetMesh(points, corners).flat_tetrahedra
    return FlatCellRepair(corners, origin, cells.merged, flat)


def _sweep(
    cells: CellComplex,
    pending: list[int],
    step: Callable[[CellComplex, int], list[int] | None],
    failures: dict[tuple[str, int], frozenset[int]],
) -> tuple[int, list[int]]:
    """Apply a step to each flat cell; the number of successes, and the flat cells that are left or new.

    A search that failed at a cell is tried again only where the cells around it (`failures`) have changed;
    after `MAX_FAILURES` none is tried.
    """
    n_removed, left = 0, []
    for cell in pending:
        if cell in cells.removed:
            continue
        near = frozenset(cells.near(cell))
        key = (step.__name__, cell)
        is_tried = step is _remove or (failures.get(key) != near and len(failures) < MAX_FAILURES)
        new = step(cells, cell) if is_tried else None
        if new is None and is_tried and step is not _remove:
            failures[key] = near
        if new is None:
            left.append(cell)
        else:
            n_removed += 1
            left += new
    return n_removed, [cell for cell in left if cell not in cells.removed]


def _apply(cells: CellComplex, move: Move) -> list[int]:
    """Make a change, and return the flat ones of the new cells."""
    if move.merges:
        cells.merged[move.merges[0]] = move.merges[1]
    return cells.flat(cells.replace(move.old, move.new))


def _best_removal(cells: CellComplex, cell: int) -> Move | None:
    if loss := boundary_loss(cells, cell):
        return loss
    moves = [move for move in moves_at(cells, cell) if move.gain > 0]
    return max(moves, key=lambda move: (move.gain, move.quality), default=None)


def _remove(cells: CellComplex, cell: int) -> list[int] | None:
    """Remove a flat cell by one change; the flat cells among the new ones, or None without such a change."""
    move = _best_removal(cells, cell)
    return None if move is None else _apply(cells, move)


def _remove_by_chain(cells: CellComplex, cell: int) -> list[int] | None:
    """Remove a flat cell by a change that others make possible, the shortest chain first."""
    for depth in range(1, MAX_DEPTH):
        flat = _search(cells, cell, depth, [MAX_MOVES])
        if flat is not None:
            return flat
    return None


def _search(cells: CellComplex, cell: int, depth: int, budget: list[int]) -> list[int] | None:
    near = {cell}
    for corner in cells.corners(cell):
        a, b, c = (vertex for vertex in cells.corners(cell) if vertex != corner)
        near |= cells.around(a, b, c)
    moves = {(move.old, move.new): move for one in sorted(near) for move in moves_at(cells, one)}
    budget[0] -= 10 * len(near)
    for move in sorted(moves.values(), key=lambda move: -move.quality):
        if move.gain < 0 or budget[0] < 0:
            continue
        added = cells.replace(move.old, move.new)
        flat = cells.flat(added)
        if move.gain > 0:
            return flat
        targets = flat if cell in cells.removed else [cell]
        for target in targets:
            budget[0] -= 10
            if last := _best_removal(cells, target):
                return flat + _apply(cells, last)
            if depth > 1 and (rest := _search(cells, target, depth - 1, budget)) is not None:
                return flat + rest
        cells.restore(move.old, added)
    return None


def _remove_by_merge(cells: CellComplex, cell: int) -> list[int] | None:
    """Remove a flat cell by the collapse of an edge at one of its corners, the shortest possible."""
    for vertex in cells.corners(cell):
        for move in _collapses(cells, vertex):
            if move.gain > 0:
                return _apply(cells, move)
    return None


def _collapses(cells: CellComplex, vertex: int) -> Iterator[Move]:
    """Collapses of the edges at a vertex, the shortest first."""
    others = sorted({v for cell in cells.around(vertex) for v in cells.corners(cell)} - {vertex})
    length = vector_length(cells.points[others] - cells.points[vertex])
    for k in np.argsort(length, kind="stable").tolist():
        move = collapse(cells, vertex, others[k])
        if move is not None:
            yield move


def _remove_with_vertex(cells: CellComplex, cell: int) -> list[int] | None:
    """Remove a flat cell with one of its vertices, whose edges are removed until one of them can collapse."""
    for vertex in cells.corners(cell):
        exchanges: list[tuple[tuple[int, ...], list[int]]] = []
        gain = 0
        for _ in range(MAX_DEGREE):
            last = next((move for move in _collapses(cells, vertex) if move.gain + gain > 0), None)
            if last is not None:
                flat = [one for _, added in exchanges for one in cells.flat(set(added) - cells.removed)]
                return flat + _apply(cells, last)
            others = sorted({v for near in cells.around(vertex) for v in cells.corners(near)} - {vertex})
            moves = [move for other in others if (move := edge_removal(cells, vertex, other)) is not None]
            if not moves:
                break
            move = max(moves, key=lambda move: (move.gain, move.quality))
            exchanges.append((move.old, cells.replace(move.old, move.new)))
            gain += move.gain
        for old, added in reversed(exchanges):
            cells.restore(old, added)
    return None
