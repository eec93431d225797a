"""Longest stable steps of explicit schemes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mechanics.system import System
from ddgcli.mesh.scatter import sum_by_index


def stable_step(system: System, x: NDArray, reach: float) -> float:
    """Largest step of a scheme that is stable while step times frequency is below `reach`.

    The frequency w is that of the elastic terms at `x` and of the barriers where they are expected stiffest.
    Damping of rate c shortens the step: explicit schemes take the velocity from before.
    """
    if not np.isfinite(reach):
        return np.inf
    elastic = [(p.stencil, p.blocks(x, "material")) for p in system.potentials if len(p.stencil)]
    barrier = sum((b.stiffest() for b in system.barriers), np.zeros(len(x)))
    square = _largest_rate(system, elastic) + float((barrier / system.mass).max())
    for p in system.potentials:
        if hasattr(p, "low_rank"):
            square += float(np.sum(p.low_rank(x) ** 2 / system.mass[:, None]))
    frozen = system.frozen(x, 0.0)
    c = _largest_rate(system, [(p.stencil, p.blocks(np.zeros_like(x), "exact")) for p in frozen])
    if not square + c > 0:
        return np.inf
    return 0.9 * 2 * reach / (c + np.sqrt(c * c + 4 * square))


def _largest_rate(system: System, elements: list[tuple[NDArray, NDArray]]) -> float:
    """Largest eigenvalue of M^-1 K by power iteration, K the sum of element blocks."""
    w = np.random.default_rng(0).normal(size=(len(system.mass), 3))
    largest = 0.0
    for _ in range(60 if elements else 0):
        w = np.where(system.free, w, 0.0)
        norm = np.sqrt(np.sum(system.mass[:, None] * w**2))
        if not norm > 0:
            return 0.0
        w /= norm
        kw = np.zeros_like(w)
        for stencil, blocks in elements:
            # internal unknowns are held: free, they could only lower the rate
            inner = np.zeros((max(int(stencil.max(initial=0)) + 1 - len(w), 0), 3))
            whole = np.concatenate([w, inner])
            local = np.einsum("kij,kj->ki", blocks, whole[stencil].reshape(len(stencil), -1))
            kw += sum_by_index(stencil, local.reshape(*stencil.shape, 3), len(whole))[: len(w)]
        largest = float(np.sum(w * kw))
        w = kw / system.mass[:, None]
    return largest
