"""Boundary faces of a solid that lie on each other: at the same positions, or as the sides of a flat gap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.ragged import repeated_rows
from ddgcli.mesh.repair import merged_points
from ddgcli.mesh.tet_mesh import FLAT_POSITION_TOLERANCE, TetMesh, relative_volume

MAX_FACES_AT_EDGE = 8  # of the boundary, whose pairs are compared


def crack_faces(mesh: TetMesh) -> NDArray[np.int64]:
    """Boundary faces at the positions of an earlier one of the same component: a crack.

    Parameters
    ----------
    mesh : TetMesh

    Returns
    -------
    (k,) ndarray of int64
        Indices of faces of `mesh.boundary`.
    """
    faces = mesh.boundary.faces
    corners = np.sort(merged_points(mesh.points)[1][faces], axis=1)
    return repeated_rows(np.column_stack([corners, mesh.vertex_component[faces[:, 0]]]))


def flat_gaps(mesh: TetMesh, *, merged: bool = True) -> NDArray[np.int64]:
    """Flat tetrahedra of which all four sides are boundary faces, and which are no cells of the mesh.

    A flat cell between others leaves such a gap where it is missing: two pairs of faces over the two
    diagonals of four corners, or one face over three.

    Parameters
    ----------
    mesh : TetMesh
    merged : bool
        Count vertices at one position as one.

    Returns
    -------
    (k, 4) ndarray of int64
        Corners, ascending; of vertices at one position, any.
    """
    place = merged_points(mesh.points)[1] if merged else np.arange(mesh.n_vertices)
    faces = place[mesh.boundary.faces]
    pair, corners = _pairs_at_edges(np.sort(faces, axis=1))
    keys, index = np.unique(corners, axis=0, return_inverse=True)
    side = np.unique(np.column_stack([np.repeat(index.ravel(), 2), pair.ravel()]), axis=0)
    n_sides = np.bincount(side[:, 0], minlength=len(keys))
    vertex = np.zeros(int(place.max(initial=-1)) + 1, dtype=np.int64)
    vertex[place] = np.arange(mesh.n_vertices)
    gaps = keys[n_sides >= 4]
    is_flat = np.abs(relative_volume(mesh.points[vertex[gaps]])) <= FLAT_POSITION_TOLERANCE
    gaps = gaps[is_flat]
    cells = np.sort(place[mesh.tetrahedra], axis=1)
    cells = cells[np.isin(cells[:, 0], gaps[:, 0])]
    is_cell = np.zeros(len(cells) + len(gaps), dtype=bool)
    is_cell[repeated_rows(np.concatenate([cells, gaps]))] = True
    return np.sort(vertex[gaps[~is_cell[len(cells) :]]], axis=1)


def _pairs_at_edges(faces: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs (k, 2) of faces with an edge in common, and their four corners (k, 4), ascending."""
    side = faces[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2)
    order = np.lexsort(side.T[::-1])
    side, face = side[order], order // 3
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for distance in range(1, MAX_FACES_AT_EDGE):
        rows = np.flatnonzero((side[distance:] == side[:-distance]).all(axis=1))
        if len(rows) == 0:
            break
        pairs.append(np.column_stack([face[rows], face[rows + distance]]))
    pair = np.concatenate(pairs)
    corners = np.sort(faces[pair].reshape(-1, 6), axis=1)
    is_new = np.ones(corners.shape, dtype=bool)
    is_new[:, 1:] = corners[:, 1:] != corners[:, :-1]
    is_quad = is_new.sum(axis=1) == 4
    return pair[is_quad], corners[is_quad][is_new[is_quad]].reshape(-1, 4)
