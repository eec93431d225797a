"""Effect `harmonic`: flows without vorticity or divergence, round handles and holes."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ddgcli.errors import counted
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.effect_parts import Harmonic, Initial
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect


class HarmonicSection(Section):
    """Keep the harmonic part of the flow, and let it change or not."""

    kind: Literal["frozen", "evolved"] = Field(
        "evolved", description="frozen: constant in time; evolved: by Euler's equation"
    )
    coefficients: list[quantity("m^2/s", "")] | None = Field(
        None, description="at the start, of the orthonormal basis; added to those of the initial flow"
    )
    object: str | None = Field(None, description="fluid; by default all")


def build(parameters: HarmonicSection, context: FluidContext) -> list[Harmonic | Initial]:
    harmonic = Harmonic(parameters.kind == "evolved")
    coefficients = parameters.coefficients
    if coefficients is None:
        return [harmonic]

    def start(space: SurfaceSpace) -> dict[str, NDArray]:
        if len(coefficients) != len(space.harmonic):
            raise ValueError(
                f"{counted(len(coefficients), 'coefficient', 'coefficients')}; the surface {context.name!r} "
                f"has {counted(len(space.harmonic), 'harmonic flow', 'harmonic flows')}"
            )
        return {"coefficients": np.array(coefficients)}

    return [harmonic, Initial(start)]


EFFECT = Effect(
    "harmonic",
    HarmonicSection,
    build,
    "a basis at the start; one inner product per basis flow and evaluation",
    ("fluid",),
)
