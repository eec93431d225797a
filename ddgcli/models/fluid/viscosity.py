"""Effect `viscosity`."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.phases import FluidSetting, Phase, PhaseRequest
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect


class ViscositySection(Section):
    """Friction within the fluid."""

    nu: quantity("m^2/s", "kinematic viscosity; 0: no friction", ge=0)
    kind: Literal["hodge", "bochner", "deformation"] = Field(
        "hodge", description="Laplacian; on the unit sphere a rigid turn decays at 2 nu, nu, or not at all"
    )
    object: str | None = Field(None, description="fluid; by default all")


def build(parameters: ViscositySection, context: FluidContext) -> list[PhaseRequest]:
    if parameters.nu == 0:
        return []

    def make(setting: FluidSetting) -> Phase:
        setting.viscosity = parameters.nu
        if context.is_volume:
            from ddgcli.models.fluid.volume_viscosity import VolumeDiffusion

            if parameters.kind != "hodge":
                raise ValueError(f"kind {parameters.kind} is one of surfaces; a volume takes hodge")
            return VolumeDiffusion(setting, parameters.nu)
        from ddgcli.models.fluid.diffusion import Diffusion, VelocityDiffusion, VorticityDiffusion

        space, nu, kind = setting.space, parameters.nu, parameters.kind
        if kind == "hodge" and not setting.no_slip:
            return Diffusion(setting, VorticityDiffusion(space, nu))
        if not space.mesh.topology.is_closed and not setting.no_slip:
            raise ValueError(
                f"kind {kind} on a surface with boundary needs boundary no-slip; with free slip there is "
                "kind hodge"
            )
        scheme = VelocityDiffusion(
            space, nu, kind, setting.wall_circulation, setting.slip, setting.evolve_harmonic
        )
        if kind != "hodge" or not context.obstacles:
            return Diffusion(setting, scheme)
        from ddgcli.models.fluid.forces import obstacle_forces

        return Diffusion(setting, scheme, obstacle_forces(setting, scheme))

    return [PhaseRequest(make)]


EFFECT = Effect(
    "viscosity", ViscositySection, build, "one factorisation, then four solves per step", ("fluid",)
)
