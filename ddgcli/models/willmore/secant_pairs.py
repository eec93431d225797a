"""Second derivatives of an energy from the last steps: quasi-Newton motions of limited memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.linalg.secant import secant_solve

MAX_PAIRS = 5
LEAST_PRODUCT = 1e-12  # of motion and change of the gradient over their norms: others show no convexity


@dataclass(frozen=True, eq=False)
class SecantPairs:
    """Motions of the last steps and the changes of the gradient over them, the oldest first.

    Parameters
    ----------
    motions, changes : tuple of (k, 3) ndarray

    Notes
    -----
    J. Nocedal, "Updating quasi-Newton matrices with limited storage", 1980.
    """

    motions: tuple[NDArray[np.float64], ...] = ()
    changes: tuple[NDArray[np.float64], ...] = ()

    def with_pair(self, motion: NDArray, change: NDArray) -> SecantPairs:
        """With the last step's pair, if the energy was convex over it, in place of the oldest."""
        size = np.sqrt(np.vdot(motion, motion) * np.vdot(change, change))
        if not np.vdot(motion, change) > LEAST_PRODUCT * size:
            return self
        return SecantPairs((*self.motions, motion)[-MAX_PAIRS:], (*self.changes, change)[-MAX_PAIRS:])

    def motion(self, gradient: NDArray, solve: Callable[[NDArray], NDArray]) -> NDArray[np.float64]:
        """Minus the inverse Hessian of these pairs on the gradient (k, 3).

        Parameters
        ----------
        gradient : (k, 3) ndarray
        solve : callable
            A preconditioner's inverse, (k, 3) to (k, 3): it stands for the inverse Hessian where no pair
            does, and is only ever made smaller.
        """
        return -secant_solve(gradient, list(zip(self.motions, self.changes)), solve, scaled=True)

    def arrays(self, n: int) -> dict[str, NDArray]:
        """As arrays of fixed shape (MAX_PAIRS, n, 3), zero where there is no pair."""
        arrays = {name: np.zeros((MAX_PAIRS, n, 3)) for name in ("pair_motions", "pair_changes")}
        for k, (motion, change) in enumerate(zip(self.motions, self.changes)):
            arrays["pair_motions"][k, : len(motion)] = motion
            arrays["pair_changes"][k, : len(motion)] = change
        return arrays

    @classmethod
    def of_arrays(cls, arrays: dict[str, NDArray], count: int) -> SecantPairs:
        """The pairs of `arrays`, for `count` vertices that move."""
        if "pair_motions" not in arrays:
            return cls()
        motions, changes = (np.asarray(arrays[f"pair_{name}"])[:, :count] for name in ("motions", "changes"))
        nonzero = [k for k in range(len(motions)) if motions[k].any()]
        return cls(tuple(motions[k] for k in nonzero), tuple(changes[k] for k in nonzero))
