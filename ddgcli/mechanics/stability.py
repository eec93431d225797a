"""Longest stable steps of explicit schemes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import Mode, Potential

MAX_POWERS = 60  # power iterations for the largest eigenvalue


def stable_step(system: System, x: NDArray, reach: float) -> float:
    """Largest step of an explicit scheme that is stable.

    The frequency is that of the elastic terms at `x`, plus the largest expected stiffness of the barriers.
    Damping with rate c shortens the step, because explicit schemes use the velocity before the step.

    Parameters
    ----------
    system : System
    x : (n, 3) ndarray of float64
        Positions in m.
    reach : float
        Step times angular frequency below which the scheme is stable.

    Returns
    -------
    float
        In s; inf without a limit.
    """
    if not np.isfinite(reach):
        return np.inf
    elastic = [p for p in system.potentials if len(p.stencil)]
    barrier = sum((b.expected_stiffness(x) for b in system.barriers), np.zeros(len(x)))
    square = _largest_rate(system, elastic, x, "material") + float((barrier / system.mass).max())
    for p in system.potentials:
        if p.low_rank is not None:
            square += float(np.sum(p.low_rank(x) ** 2 / system.mass[:, None]))
    frozen = system.frozen(x, 0.0)
    c = _largest_rate(system, frozen, np.zeros_like(x), "exact")
    if not square + c > 0:
        return np.inf
    return 0.9 * 2 * reach / (c + np.sqrt(c * c + 4 * square))


def _largest_rate(system: System, terms: Sequence[Potential], x: NDArray, mode: Mode) -> float:
    """Largest eigenvalue of M^-1 K by power iteration, K the sum of element blocks at x."""
    if not terms:
        return 0.0
    from ddgcli.mechanics.hessian import assembly_of_terms, blocks_of  # not needed with loads alone

    assembly = assembly_of_terms(system.free, terms)
    build = assembly.block_matrix if assembly.by_vertex else assembly.matrix
    by_pairs = iter(assembly.by_pairs)
    blocks = chain.from_iterable(blocks_of(p, by_pairs, x, mode) for p in terms)
    stiffness = build(blocks, np.zeros(len(x)))
    mass = np.repeat(system.mass, 3).reshape(-1, 3)
    w, largest = np.random.default_rng(0).normal(size=x.shape), 0.0
    for _ in range(MAX_POWERS):
        w = system.only_free(w)
        norm = np.sqrt(np.sum(mass * w**2))
        if not norm > 0:
            return 0.0
        w /= norm
        # internal unknowns are held at 0; free, they could only lower the rate
        kw = assembly.scatter(stiffness @ assembly.gather(w))
        largest = float(np.sum(w * kw))
        w = kw / mass
    return largest
