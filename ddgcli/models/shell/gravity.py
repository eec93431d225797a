"""Effect `gravity`: a constant acceleration."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import numpy as np

from ddgcli.evolve.effects import Effect
from ddgcli.evolve.terms import DeadLoad
from ddgcli.models.scene import Section
from ddgcli.models.scene_units import vector
from ddgcli.models.shell.context import ShellContext


class Gravity(Section):
    """Weight: energy -m g . x."""

    acceleration: vector("m/s^2", "acceleration") = (0.0, 0.0, -9.81)


def build(parameters: Gravity, context: ShellContext) -> list[DeadLoad]:
    return [DeadLoad("gravity", context.mass[:, None] * np.array(parameters.acceleration))]


EFFECT = Effect("gravity", Gravity, build, "one addition a step", ("shell",))
