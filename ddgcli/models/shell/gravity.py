"""Effect `gravity`: a constant acceleration."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import numpy as np

from ddgcli.mechanics.terms import DeadLoad
from ddgcli.models.shell.context import ShellContext
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import vector
from ddgcli.simulation.effects import Effect


class Gravity(Section):
    """Weight: energy -m g . x."""

    acceleration: vector("m/s^2", "acceleration") = (0.0, 0.0, -9.81)


def build(parameters: Gravity, context: ShellContext) -> list[DeadLoad]:
    return [DeadLoad("gravity", context.mass[:, None] * np.array(parameters.acceleration))]


EFFECT = Effect("gravity", Gravity, build, "one addition per step", ("shell",))
