"""Account of what a transport loses, with the sizes that its losses are relative to, step by step.

The account is part of the state and the flow does not depend on it. Frames are too few to judge losses by:
between two of them walls can drive a flow and stop it again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ddgcli.models.fluid.phases import FluidSetting
from ddgcli.models.fluid.state import CORRECTIONS, FluidState
from ddgcli.simulation.model import Observation

Total = Literal["energy", "enstrophy"]
SIZES = ("energy", "enstrophy", "vorticity")  # largest values that are booked; the last is the absolute one


class LossAccount:
    """Account of the transport of one fluid.

    Parameters
    ----------
    setting : FluidSetting
    totals : tuple of {'energy', 'enstrophy'}
        What the transport may lose.
    corrects : bool
        Whether the transport counts `CORRECTIONS`.
    enstrophy : callable state -> float, optional
        What the transport conserves in place of the enstrophy.
    """

    def __init__(
        self,
        setting: FluidSetting,
        totals: tuple[Total, ...],
        corrects: bool = False,
        enstrophy: Callable[[FluidState], float] | None = None,
    ) -> None:
        self.setting, self.space, self.totals, self.corrects = setting, setting.space, totals, corrects
        self.enstrophy = enstrophy or self.space.total_enstrophy

    def start(self) -> dict[str, NDArray]:
        """Arrays of the account before the first step."""
        arrays = {"losses": np.zeros(2), "loss_sizes": np.zeros(len(SIZES)), "supplies": np.zeros(2)}
        return {**arrays, "corrections": np.zeros(1 + len(CORRECTIONS))} if self.corrects else arrays

    def booked(
        self,
        before: FluidState,
        after: FluidState,
        dt: float,
        acted: NDArray | None = None,
        added: float = 0.0,
    ) -> FluidState:
        """The state after a step of the transport with the step booked.

        `acted` are its `CORRECTIONS`, `added` is the enstrophy that walls added in it.
        """
        largest = np.maximum(self._sizes(before), self._sizes(after, ends=True))
        arrays = {
            "losses": before["losses"] + self._losses(before, after) + [0.0, added],
            "loss_sizes": np.maximum(before["loss_sizes"], largest),
            "supplies": before["supplies"] + dt * self._supply(before),
        }
        if acted is not None:
            arrays["corrections"] = before["corrections"] + np.array([1, *acted])
        return after.with_passive(**arrays)

    def _losses(self, before: FluidState, after: FluidState) -> NDArray[np.float64]:
        energy, enstrophy = self.space.energy, self.enstrophy
        return np.array(
            [
                energy(before) - energy(after) if "energy" in self.totals else 0.0,
                enstrophy(before) - enstrophy(after) if "enstrophy" in self.totals else 0.0,
            ]
        )

    def _sizes(self, state: FluidState, ends: bool = False) -> NDArray[np.float64]:
        """The `SIZES` of a flow; 0 for those at the end of a step that would cost a solve for little."""
        energy = 0.0 if ends and "energy" not in self.totals else self.space.energy(state)
        if "enstrophy" not in self.totals:
            return np.array([energy, 0.0, 0.0])
        vorticity = float(np.abs(state["vorticity"]).sum())
        return np.array([energy, self.space.total_enstrophy(state), vorticity])

    def _supply(self, state: FluidState) -> NDArray[np.float64]:
        """Energy and enstrophy a second by which walls without slip renew a flow.

        In a steady flow friction takes 2 nu Z of the energy E a second, Z the enstrophy, which walls supply.
        """
        nu, energy = self.setting.wall_friction, self.space.energy(state)
        if not (nu > 0 and energy > 0):
            return np.zeros(2)
        enstrophy = self.space.total_enstrophy(state)
        return 2.0 * nu * enstrophy * np.array([1.0, enstrophy / energy])

    def observed(self, state: FluidState) -> Observation:
        """Losses, their sizes and the corrections of a frame."""
        lost = dict(zip(("energy", "enstrophy"), state["losses"].tolist()))
        scalar = {f"lost_{total}": lost[total] for total in self.totals}
        names = ("loss_sizes", "supplies", *(("corrections",) if self.corrects else ()))
        return Observation(None, {}, {**scalar, **{name: state[name] for name in names}})
