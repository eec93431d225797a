"""Net flux through the boundary of an incompressible flow, which must vanish."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FLUX_TOLERANCE = 1e-9  # net flux over the absolute flux that counts as quadrature error


def flux_imbalance(flux: NDArray[np.float64], natural: NDArray[np.bool_], largest: float = 0.0) -> str:
    """Net prescribed flux in words, such as `0.5 {unit} more flow out than in`; "" if it is rounding.

    Parameters
    ----------
    flux : (k,) ndarray of float64
        Outward flux through each piece of the boundary.
    natural : (k,) ndarray of bool
        Pieces whose flux is free; with one of them, every prescribed flux can be balanced.
    largest : float
        Absolute flux of the run at other times, whose rounding counts, too.

    Returns
    -------
    str
    """
    excess, whole = float(flux.sum()), max(float(np.abs(flux).sum()), largest)
    if natural.any() or abs(excess) <= FLUX_TOLERANCE * whole:
        return ""
    more, less = ("out", "in") if excess > 0 else ("in", "out")
    return f"{abs(excess):.6g} {{unit}} more flow {more} than {less}"
