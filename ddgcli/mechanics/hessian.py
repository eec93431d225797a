"""Hessian of the incremental potential of an implicit step, summed over the terms of a system."""

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
    """Assembly of the Hessian of a system, from the stencils of its terms.

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
    """Assembly of the Hessian of potentials over the free coordinates.

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
    """Hessian blocks of the elements, for each piece of a potential.

    Parameters
    ----------
    potential : Potential or PotentialPieces
    by_pairs : iterator of bool
        For each piece, whether to compute the blocks of vertex pairs instead of whole ones.
    x : (n, 3) ndarray of float64
    mode : str
        See `Potential.blocks`.

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
    """Hessian of the incremental potential of an implicit step, plus `shift` times the masses.

    Parameters
    ----------
    system : System
    increment : Increment
    assembly : Assembly
        Assembly for this system and increment.
    y : (n, 3) ndarray of float64
        Positions.
    mode : str
        See `Potential.blocks`.
    shift : float
    by_blocks : bool
        Whether to return (3, 3) blocks, if the assembly is `by_vertex`.

    Returns
    -------
    csc_array or bsr_array
        Rows are the free coordinates, then the internal unknowns.
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
    """Generate the blocks of each term, one at a time; append Hessians without elements to `changing`."""
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
    """Sum of the assembled Hessian and the Hessians of terms whose elements change with the positions.

    Parameters
    ----------
    matrix : (f, f) csc_array or bsr_array
        Rows are the free coordinates, then the internal unknowns.
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
