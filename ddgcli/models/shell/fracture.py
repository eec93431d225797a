"""Effect `fracture`: edges that stretch or bend too far open, and the surface breaks along them."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import Any

from pydantic import Field, model_validator

from ddgcli.geometry.hinges import hinges
from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.models.shell.context import ShellContext
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import Effect


class Fracture(Section):
    """Brittle edges: those beyond a strain or an angle open for good after the step."""

    object: str | None = Field(None, description="shell; needed where the scene has several")
    strain: quantity("", "an edge opens beyond this elongation, relative to its rest length", gt=0) | None = (
        None
    )
    angle: quantity("rad", "an edge opens beyond this change of its dihedral angle", gt=0) | None = None

    @model_validator(mode="after")
    def _one(self) -> Fracture:
        if self.strain is None and self.angle is None:
            raise ValueError("give strain, angle or both")
        return self


def build(parameters: Fracture, context: ShellContext) -> list[Any]:
    """Check that the scene allows cracks. They change the mesh between steps (see `epochs`): no term."""
    time, topology = context.scene.time, context.mesh.topology
    explicit = INTEGRATORS[time.integrator].reach(time) < float("inf") or time.integrator == "avi"
    if explicit or time.integrator == "static":
        raise ValueError(
            f'a piece may be one light triangle, so an implicit scheme is needed, not "{time.integrator}"; '
            'write integrator = "newmark", "implicit-euler" or "bdf2"'
        )
    if time.tolerance is not None:
        raise ValueError("the adaptive steps of `tolerance` compare unbroken states; write step = ...")
    interior = topology.n_edges - len(topology.boundary_edges)
    if interior != len(hinges(topology)):
        raise ValueError(
            "an edge has more than two faces, or faces of opposite orientation; run repair first"
        )
    if not topology.referenced_vertex.all():
        raise ValueError("some vertices belong to no face; run repair first")
    for effect, section, _ in context.scene.effects:
        _require_separable(context.shell.name, effect.name, section)
    return []


def _require_separable(shell: str, name: str, section: Any) -> None:
    """ValueError for an effect on a shell, or parameters of it, that cannot continue across a crack."""
    if getattr(section, "object", None) not in (None, shell) and getattr(section, "to", None) != shell:
        return
    if name == "bending" and section.model in ("quadratic", "cubic"):
        raise ValueError(
            f'bending with model = "{section.model}" assumes a whole surface; write model = "hinge"'
        )
    if name == "load" and (section.moment is not None or section.line_force is not None):
        raise ValueError("cracks make new boundary edges; give the load as force or traction")


EFFECT = Effect(
    "fracture", Fracture, build, "one pass over the interior edges per step", ("shell",), repeatable=True
)
