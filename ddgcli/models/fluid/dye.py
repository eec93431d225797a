"""Effect `dye`: a passive amount carried by the flow."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from pydantic import Field

from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.phases import FluidSetting, Phase, PhaseRequest
from ddgcli.scenes.sections import Section
from ddgcli.simulation.effects import Effect


class DyeSection(Section):
    """Dye, followed backwards along the flow: its amount is kept, and it never leaves its bounds."""

    amount: str = Field(description="at the start: vertex array of the mesh, .npy, or expression in x, y, z")
    object: str | None = Field(None, description="fluid; by default all")


def build(parameters: DyeSection, context: FluidContext) -> list[PhaseRequest]:
    amount = context.scalar(parameters.amount, "dye")

    def make(setting: FluidSetting) -> Phase:
        from ddgcli.models.fluid.tracer import SurfaceTracer, TracerPhase

        if context.is_volume:
            from ddgcli.models.fluid.volume_effects import VolumeTracer

            return TracerPhase("dye", amount, VolumeTracer(setting))
        return TracerPhase("dye", amount, SurfaceTracer(setting.space, setting.tracing))

    return [PhaseRequest(make)]


EFFECT = Effect("dye", DyeSection, build, "a trace a vertex and two solves a step", ("fluid",))
