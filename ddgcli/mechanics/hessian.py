"""Hessian of the function that an implicit step minimises: the sum of what its terms have."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csc_array

from ddgcli.mechanics.assembly import Assembly
from ddgcli.mechanics.increment import Increment
from ddgcli.mechanics.pair_blocks import have_distinct_vertices
from ddgcli.mechanics.pieces import pieces_of, stencils_of
from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import Mode, Potential


def assembly_of(system: System, increment: Increment) -> Assembly:
    """Pattern of the Hessian of a system, with the stencils of its terms.

    Parameters
    ----------
    system : System
    increment : Increment
        The implicit step, with its dissipation.

    Returns
    -------
    Assembly
    """
    terms = [p for p in system.potentials if len(p.stencil)]
    terms += [p for p in increment.frozen if p.hessian is None]
    return assembly_of_terms(system.free, terms)


def assembly_of_terms(free: NDArray[np.bool_], terms: Sequence[Potential]) -> Assembly:
    """Pattern of the Hessian of potentials over the free coordinates.

    Parameters
    ----------
    free : (n, 3) ndarray of bool
    terms : sequence of Potential

    Returns
    -------
    Assembly
    """
    by_pairs, stencils = [], []
    for p in terms:
        own = stencils_of(p)
        stencils += own
        by_pairs += [p.pair_blocks is not None and all(map(have_distinct_vertices, own))] * len(own)
    return Assembly(free, stencils, by_pairs)


def blocks_of(potential: Any, by_pairs: Iterator[bool], x: NDArray, mode: Mode) -> Iterator[NDArray]:
    """Blocks of the Hessian of the elements of each piece of a potential.

    Parameters
    ----------
    potential : Potential or PotentialPieces
    by_pairs : iterator of bool
        For each piece, whether to give the blocks of pairs of vertices.
    x : (n, 3) ndarray of float64
    mode : str
        Which terms of the Hessian: exact, or positive semidefinite.

    Yields
    ------
    ndarray of float64
    """
    for piece, own_x in pieces_of(potential, x):
        yield piece.pair_blocks(own_x, mode) if next(by_pairs) else piece.blocks(own_x, mode)


def total_hessian(
    system: System,
    increment: Increment,
    assembly: Assembly,
    y: NDArray,
    mode: Mode,
    shift: float,
    *,
    by_blocks: bool = False,
) -> csc_array | bsr_array:
    """Hessian of the function that an implicit step minimises, plus `shift` times the masses.

    Parameters
    ----------
    system : System
    increment : Increment
    assembly : Assembly
        Of both.
    y : (n, 3) ndarray of float64
        Where to evaluate.
    mode : str
        Which terms of the Hessian: exact, or positive semidefinite.
    shift : float
    by_blocks : bool
        With (3, 3) blocks if the unknowns are those of whole vertices.

    Returns
    -------
    csc_array or bsr_array
        Over the free coordinates and the internal unknowns.
    """
    changing: list[Any] = []
    blocks = _blocks(system, increment, assembly, y, mode, changing)
    with system.account.within("solver"):
        build = assembly.block_matrix if by_blocks and assembly.by_vertex else assembly.matrix
        matrix = build(blocks, (increment.a + shift) * system.mass)
        return with_changing(matrix, system.free, changing)


def _blocks(
    system: System, increment: Increment, assembly: Assembly, y: NDArray, mode: Mode, changing: list[Any]
) -> Iterator[NDArray]:
    """Blocks of each term in turn, each when the one before is summed; Hessians are added to `changing`."""
    by_pairs = iter(assembly.by_pairs)
    for potential in system.potentials:
        if potential.is_dead:
            continue
        if potential.hessian is not None:
            with system.account.within(potential.name):
                changing.append(potential.hessian(y, mode))
            continue
        pieces = blocks_of(potential, by_pairs, y, mode)
        for _ in stencils_of(potential):
            with system.account.within(potential.name):
                block = next(pieces)
            yield block
            del block
    for potential in increment.frozen:
        with system.account.within(potential.name):
            if potential.hessian is not None:
                hessian = potential.hessian(increment.velocity(y), mode)
                changing.append(None if hessian is None else increment.c * hessian)
                continue
            block = increment.c * potential.blocks(increment.velocity(y), mode)
        yield block
        del block


def with_changing(
    matrix: csc_array | bsr_array, free: NDArray[np.bool_], hessians: Sequence[Any]
) -> csc_array | bsr_array:
    """The Hessian over the unknowns plus those of elements that change from place to place.

    Parameters
    ----------
    matrix : (f, f) csc_array or bsr_array
        The free coordinates, then internal unknowns.
    free : (n, 3) ndarray of bool
    hessians : sequence of (3n, 3n) sparse arrays or None
    """
    for hessian in hessians:
        if hessian is not None and hessian.nnz:
            free_block = csc_array(hessian if free.all() else hessian[free.ravel()][:, free.ravel()])
            free_block.resize(matrix.shape)
            if isinstance(matrix, bsr_array):
                matrix = bsr_array(matrix + free_block.tobsr((3, 3)))
            else:
                matrix = csc_array(matrix + free_block)
    return matrix
