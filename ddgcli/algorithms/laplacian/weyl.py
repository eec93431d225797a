"""Number of eigenpairs by Weyl's law; imports no numpy, so that a dry run can count them before any work."""

from __future__ import annotations

import math
from collections.abc import Sequence

__all__ = ["pairs_for_times"]

MAX_SIGNATURE_PAIRS, SIGNATURE_TAIL = 300, 1e-6
LARGEST_EIGENVALUE = 1e200  # its powers do not overflow


def pairs_for_times(measure: float, dimension: int, times: Sequence[float], n_vertices: int) -> int:
    """Number of eigenpairs that resolve the heat kernel at the shortest time.

    Parameters
    ----------
    measure : float
        Area of a surface, volume of tetrahedra.
    dimension : {2, 3}
    times : sequence of float
        In length^2.
    n_vertices : int

    Returns
    -------
    int
        At most `MAX_SIGNATURE_PAIRS`, and at most `n_vertices`.
    """
    largest = min(-math.log(SIGNATURE_TAIL) / min(times), LARGEST_EIGENVALUE)
    n_pairs = measure * (largest / (4 * math.pi) if dimension == 2 else largest**1.5 / (6 * math.pi**2))
    return min(math.ceil(min(n_pairs, MAX_SIGNATURE_PAIRS)) + 10, MAX_SIGNATURE_PAIRS, n_vertices)
