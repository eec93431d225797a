"""State of a fluid: named arrays, so that a phase that needs another one adds it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

# what holds energy and enstrophy in `circulation` and `covector`: mixing in the smooth step, the filter, and
# as a last resort scaling the flow; the energy that scaling took
CORRECTIONS = ("smooth_step", "filter", "scaling", "scaled_energy")


TIME = "time"  # of a state, where the conditions at its boundary or what it shows depend on it


@dataclass(frozen=True, eq=False)
class FluidState:
    """A fluid at one time.

    Parameters
    ----------
    arrays : dict of str to ndarray
        Of shapes that do not change during a run: the checkpoint.
    memo : dict
        What was computed from these arrays; it saves work and holds nothing else.
    """

    arrays: dict[str, NDArray]
    memo: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> NDArray:
        return self.arrays[name]

    @property
    def time(self) -> float:
        """In seconds; 0 where nothing depends on it."""
        return float(self.arrays[TIME][0]) if TIME in self.arrays else 0.0

    def with_passive(self, **arrays: NDArray) -> FluidState:
        """The state with other values of arrays that the flow does not depend on."""
        return FluidState({**self.arrays, **arrays}, self.memo)

    def replaced(self, **arrays: NDArray) -> FluidState:
        """The state with other values of some arrays."""
        return FluidState({**self.arrays, **arrays})
