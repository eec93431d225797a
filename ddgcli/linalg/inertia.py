"""Negative eigenvalues of an indefinite matrix, by multifrontal elimination with dense symmetric pivots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvalsh_tridiagonal, ldl

from ddgcli.linalg.assembly_tree import AssemblyLevel, FrontalGroup
from ddgcli.linalg.multifrontal import MAX_CACHED_ENTRIES, inverse_triangles


@dataclass(frozen=True, eq=False)
class Inertia:
    """Inertia of a real symmetric matrix A, and the terms of a quadratic form of its inverse.

    Parameters
    ----------
    negative : int
        Number of negative eigenvalues, by Sylvester's law.
    energy : (n,) ndarray of float64
        Terms whose sum over a connected component of A is that of b^T A^-1 b, for a load b.
    """

    negative: int
    energy: NDArray[np.float64]


def inertia(levels: list[AssemblyLevel], data: NDArray, load: NDArray) -> Inertia:
    """Inertia of the matrix with the entries `data`, in the pattern of the levels.

    Frontal matrices whose pivots are positive definite are eliminated by Cholesky in stacks, the others, at
    most one for each negative eigenvalue and the chunk around it, by LDL^T with pivoting inside of each.
    Factors are not stored.

    Parameters
    ----------
    load : (n,) ndarray
        The load b of `Inertia.energy`.

    Raises
    ------
    numpy.linalg.LinAlgError
        A block of pivots is singular.
    """
    rest, energy, negative = np.append(load, 0.0), np.zeros(len(load) + 1), 0  # the last entry is padding
    memory = np.zeros(levels[0].size)
    for k, level in enumerate(levels):
        memory[level.place] += data[level.entry]
        memory[level.padding] = 1.0
        above = np.zeros(levels[k + 1].size if k + 1 < len(levels) else 0)
        for group in level.groups:
            negative += _eliminate(group, memory, above, rest, energy)
        memory = above
    return Inertia(negative, energy[:-1])


def _eliminate(group: FrontalGroup, memory: NDArray, above: NDArray, load: NDArray, energy: NDArray) -> int:
    """Eliminate a group and add its updates to the level above; the number of its negative pivots."""
    g, s = group.pivot.shape
    f = s + group.update.shape[1]
    stack = memory[group.start : group.start + g * f * f].reshape(g, f, f)
    step, negative = max(1, MAX_CACHED_ENTRIES // (f * f)), 0
    for begin in range(0, g, step):
        chunk = slice(begin, begin + step)
        frontal, pivot = stack[chunk], group.pivot[chunk]
        loads = load[pivot]
        try:
            update, change, energy[pivot] = _by_cholesky(frontal, loads)
        except np.linalg.LinAlgError:
            update, change = np.empty((len(frontal), f - s, f - s)), np.empty((len(frontal), f - s))
            for i, one in enumerate(frontal):
                update[i], change[i], energy[pivot[i]], count = _by_ldl(one, loads[i])
                negative += count
        np.subtract.at(load, group.update[chunk].ravel(), change.ravel())
        if f > s:
            place = group.row[chunk][:, :, None] + group.column[chunk][:, None, :]
            np.add.at(above, place.ravel(), (frontal[:, s:, s:] - update).ravel())
    return negative


def _by_cholesky(frontal: NDArray, load: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """B P^-1 B^T, B P^-1 b and energies of (g, f, f) frontal matrices with pivots P > 0 and load b (g, s)."""
    s = load.shape[1]
    inverse = inverse_triangles(np.linalg.cholesky(frontal[:, :s, :s]))
    below = frontal[:, s:, :s] @ inverse.swapaxes(1, 2)
    reduced = inverse @ load[:, :, None]
    return below @ below.swapaxes(1, 2), (below @ reduced)[:, :, 0], reduced[:, :, 0] ** 2


def _by_ldl(frontal: NDArray, load: NDArray) -> tuple[NDArray, NDArray, NDArray, int]:
    """The same of one (f, f) frontal matrix with any pivots, and the number of negative ones."""
    s = len(load)
    lower, below = np.tril(frontal[:s, :s]), frontal[s:, :s]
    pivots = lower + np.tril(lower, -1).T
    _, blocks, _ = ldl(pivots)
    negative = int((eigvalsh_tridiagonal(np.diag(blocks), np.diag(blocks, -1)) < 0).sum())
    solved = np.linalg.solve(pivots, np.column_stack([below.T, load]))
    change = below @ solved
    return change[:, :-1], change[:, -1], load * solved[:, -1], negative
