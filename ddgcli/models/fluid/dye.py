"""Effect `dye`: a passive concentration carried by the flow."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from pydantic import Field, model_validator

from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.phases import FluidSetting, Phase, PhaseRequest
from ddgcli.scenes.sections import Section
from ddgcli.simulation.effects import Effect


class DyeSection(Section):
    """Dye, followed backwards along the flow: its amount is kept, and it never leaves its bounds.

    Through an inflow comes the amount that is there at the start; an outflow takes what reaches it.

    Either `amount`, `source` or both.
    """

    amount: str = Field("0", description="at the start: vertex array, .npy, or expression in x, y, z")
    source: str | None = Field(None, description="amount added a second: expression in x, y, z, t")
    object: str | None = Field(None, description="fluid; by default all")

    @model_validator(mode="after")
    def _some_dye(self) -> DyeSection:
        if "amount" not in self.model_fields_set and self.source is None:
            raise ValueError("dye needs amount or source")
        return self


def build(parameters: DyeSection, context: FluidContext) -> list[PhaseRequest]:
    amount = context.scalar(parameters.amount, "dye")

    def make(setting: FluidSetting) -> Phase:
        from ddgcli.models.fluid.tracer import Source, SurfaceTracer, TracerPhase

        source = None if parameters.source is None else Source(context, parameters.source)
        if context.is_volume:
            from ddgcli.models.fluid.volume_effects import VolumeTracer

            return TracerPhase("dye", amount, VolumeTracer(setting), source)
        return TracerPhase("dye", amount, SurfaceTracer(setting.space, setting.tracing), source)

    return [PhaseRequest(make)]


EFFECT = Effect("dye", DyeSection, build, "one trace per vertex and two solves per step", ("fluid",))
