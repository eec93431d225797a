"""Ramps of loads and pressures: factors that are piecewise linear in time."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field, field_validator, model_validator

from ddgcli.mechanics.terms import RampedLoad
from ddgcli.scenes.key_frames import require_ascending
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity


class RampSection(Section):
    """Keys of an effect whose strength may change in time."""

    times: list[quantity("s")] | None = Field(None, min_length=2, description="of a ramp, ascending")
    factors: list[quantity("")] | None = Field(
        None, description="factor on the effect at each time, linear in between and constant outside"
    )

    @field_validator("times")
    @classmethod
    def _ascending(cls, times: list[float] | None) -> list[float] | None:
        require_ascending(times or [])
        return times

    @model_validator(mode="after")
    def _one_length(self) -> RampSection:
        if len(self.times or []) != len(self.factors or []):
            raise ValueError("a ramp needs times and factors of one length")
        return self

    def ramped(self, potential: Any) -> Any:
        """The potential scaled by the ramp; unchanged without a ramp."""
        if self.times is None or self.factors is None:
            return potential
        return RampedLoad(potential, np.array(self.times), np.array(self.factors))
