"""Repairs of meshes; each returns the new mesh and the changed elements."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot

# odd multipliers without a pattern in their bits, one per coordinate, from the generator splitmix64
HASH_FACTORS = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB], dtype=np.uint64)
MIN_SIGNED_SHARE = 1e-9  # |sum| over the sum of |terms| below which the sign is rounding


def merged_points(points: NDArray) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Unique positions in order of first appearance, and the unique position of each point.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
        Compared exactly, with -0 equal to 0.

    Returns
    -------
    points : (k, 3) ndarray of float64
    index : (n,) ndarray of int64
    """
    columns = np.array(np.asarray(points).T, dtype=np.float64, order="C")
    columns += 0.0  # -0 becomes 0
    if columns.size == 0:
        return columns.T, np.zeros(0, dtype=np.int64)
    order, is_first = _equal_positions(columns)
    run = np.flatnonzero(is_first)
    first = order[run]
    is_unique = np.zeros(len(order), dtype=bool)
    is_unique[first] = True
    index = np.empty(len(order), dtype=np.int64)
    index[order] = np.repeat((np.cumsum(is_unique) - 1)[first], np.diff(run, append=len(order)))
    return np.ascontiguousarray(columns[:, is_unique].T), index


def _equal_positions(columns: NDArray) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """An order in which equal columns are neighbours, ascending by index; where a new position begins.

    Hashes with the index of the column in their low bits are sorted: one pass over one array instead of one
    per coordinate. Different positions of one hash are sorted by their coordinates.
    """
    n_points = columns.shape[1]
    n_bits = np.uint64((n_points - 1).bit_length())
    key = _position_hash(columns)
    key >>= n_bits
    key <<= n_bits
    key |= np.arange(n_points, dtype=np.uint64)
    key.sort()
    order = (key & np.uint64((1 << int(n_bits)) - 1)).astype(np.int64)
    key >>= n_bits
    is_first = _differs_from_previous(columns, order)
    collision = key[1:] == key[:-1]
    collision &= is_first[1:]
    if collision.any():
        which = np.flatnonzero(np.isin(key, key[1:][collision]))
        candidates = order[which]
        order[which] = candidates[np.lexsort((*columns[:, candidates], key[which]))]
        is_first = _differs_from_previous(columns, order)
    return order, is_first


def _differs_from_previous(columns: NDArray, order: NDArray) -> NDArray[np.bool_]:
    differs = np.zeros(len(order), dtype=bool)
    differs[0] = True
    for column in columns:
        ordered = column[order]
        differs[1:] |= ordered[1:] != ordered[:-1]
    return differs


def _position_hash(columns: NDArray) -> NDArray[np.uint64]:
    """A hash of each column, in its high bits: its bits, folded and multiplied coordinate by coordinate."""
    mixed = np.zeros(columns.shape[1], dtype=np.uint64)
    folded = np.empty_like(mixed)
    for column, factor in zip(columns, HASH_FACTORS):
        mixed ^= column.view(np.uint64)
        np.right_shift(mixed, np.uint64(32), out=folded)
        mixed ^= folded
        mixed *= factor
    return mixed


def oriented(mesh: TriangleMesh) -> tuple[TriangleMesh, NDArray[np.bool_]]:
    """Orient the faces of a surface consistently.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    mesh : TriangleMesh
    turn : (m,) ndarray of bool
        The reversed faces, at most half of each connected piece.

    Raises
    ------
    MeshError
        The surface is not orientable.
    """
    if not mesh.topology.is_orientable:
        raise MeshError(
            f"the surface is not orientable (it contains a Moebius band); {remedy('one side', mesh.topology)}"
        )
    turn = faces_to_turn(mesh)
    return reverse_faces(mesh, turn), turn


def faces_to_turn(mesh: TriangleMesh) -> NDArray[np.bool_]:
    """Faces to reverse so that every orientable piece is oriented, at most half of each piece.

    If exactly half would be reversed, the orientation is that of positive volume or, for flat pieces, the one
    whose area vector has a positive component along z (else y, else x), so it does not depend on indices.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    (m,) ndarray of bool
    """
    turn, piece = mesh.topology.faces_to_turn, mesh.topology.undecided_piece
    rows = np.flatnonzero(piece >= 0)
    if not len(rows):
        return turn
    _, label = np.unique(piece[rows], return_inverse=True)
    size = float(np.abs(mesh.points).max())
    a, b, c = (mesh.points[mesh.faces[rows, k]] / (size or 1.0) for k in range(3))
    vector = row_cross(b - a, c - a) * np.where(turn[rows], -1.0, 1.0)[:, None]
    centre, count = a + b + c, np.bincount(label)
    middle = np.stack([np.bincount(label, weights=column) for column in centre.T], axis=1) / count[:, None]
    volume = row_dot(vector, centre - middle[label])
    largest = np.linalg.norm(vector, axis=1) * np.linalg.norm(centre - middle[label], axis=1)
    reverse = np.zeros(len(count))
    for value, terms in ((volume, largest), *((vector[:, k], np.abs(vector).sum(axis=1)) for k in (2, 1, 0))):
        total, most = np.bincount(label, weights=value), np.bincount(label, weights=terms)
        reverse = np.where((reverse == 0) & (np.abs(total) > MIN_SIGNED_SHARE * most), total, reverse)
    turn = turn.copy()
    turn[rows] ^= (reverse < 0)[label]
    return turn


def reverse_faces(mesh: TriangleMesh, turn: NDArray) -> TriangleMesh:
    """Reverse the orientation of some faces.

    Parameters
    ----------
    mesh : TriangleMesh
    turn : (m,) ndarray of bool

    Returns
    -------
    TriangleMesh
    """
    faces = np.where(turn[:, None], mesh.faces[:, ::-1], mesh.faces)
    return TriangleMesh.from_arrays(mesh.points, faces)


def one_vertex_a_fan(mesh: TriangleMesh) -> tuple[TriangleMesh, NDArray[np.int64]]:
    """Duplicate vertices that join several fans of faces, so that each fan has its own.

    The first fan of a vertex keeps its index; the others get new indices after all vertices.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    mesh : TriangleMesh
    original : (n',) ndarray of int64
        Input vertex of each vertex.
    """
    n = mesh.n_vertices
    if len(mesh.topology.nonmanifold_vertices) == 0:
        return mesh, np.arange(n)
    fan = mesh.topology.corner_fans.ravel()
    vertex = np.empty(fan.max() + 1, dtype=np.int64)
    vertex[fan] = mesh.faces.ravel()
    order = np.argsort(vertex, kind="stable")
    further = order[1:][vertex[order[1:]] == vertex[order[:-1]]]
    number = vertex.copy()
    number[further] = n + np.arange(len(further))
    original = np.concatenate([np.arange(n), vertex[further]])
    return TriangleMesh.from_arrays(mesh.points[original], number[fan].reshape(-1, 3)), original
