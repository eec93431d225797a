"""Schema of the scenes of `shell-sim`: objects, integrators, effects."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import logging
from typing import Literal

from pydantic import Field, field_validator, model_validator

from ddgcli.choices import SHELL_FACE_ARRAYS
from ddgcli.models.shell.obstacle import Obstacle
from ddgcli.scenes.materials import DEFAULT_MATERIAL, KEYS, MATERIALS, filled
from ddgcli.scenes.scene import SceneKind
from ddgcli.scenes.sections import Section
from ddgcli.scenes.shapes import MovingObject
from ddgcli.scenes.units import quantity
from ddgcli.simulation.effects import EffectTable, nearest

EFFECTS = EffectTable(
    "shell-sim",
    {
        "stretching": ("ddgcli.models.shell.stretching", "Resistance of the surface to stretch and shear."),
        "bending": ("ddgcli.models.shell.bending", "Resistance to bending, about the input or about flat."),
        "gravity": ("ddgcli.models.shell.gravity", "A constant acceleration of every mass."),
        "load": ("ddgcli.models.shell.load", "Forces on vertices, tractions, moments on edges."),
        "pressure": ("ddgcli.models.shell.pressure", "Pressure or a gas inside a closed shell."),
        "wind": ("ddgcli.models.shell.wind", "Drag and lift of moving or still air on the faces."),
        "plasticity": ("ddgcli.models.shell.plasticity", "Plastic flow of the rest lengths and rest angles."),
        "fracture": ("ddgcli.models.shell.fracture", "Edges that open beyond a strain or an angle."),
        "rigid": ("ddgcli.models.shell.rigid", "Edges that keep their lengths exactly."),
        "pin": ("ddgcli.models.shell.pin", "Vertices held still, in all directions or some."),
        "handle": ("ddgcli.models.shell.handle", "Vertices moved along key frames, as a rigid body."),
        "attach": ("ddgcli.models.shell.attach", "Vertices tied to another shell or carried by an obstacle."),
        "damping": ("ddgcli.models.shell.damping", "Rayleigh damping by mass and by stiffness."),
        "contact": (
            "ddgcli.models.shell.contact",
            "Contact with obstacles, other shells and itself; friction.",
        ),
    },
)


class Shell(MovingObject):
    """A thin elastic shell, at rest as drawn."""

    role: Literal["shell"]
    material: str | None = Field(
        None,
        description=f"preset: {', '.join(MATERIALS)}",
        json_schema_extra={"enum": [*MATERIALS, None]},
    )
    density: quantity("kg/m^2", "mass per area", gt=0) | None = None
    thickness: quantity("m", "thickness", gt=0) | None = None
    young: quantity("Pa", "Young's modulus", gt=0) | None = None
    poisson: quantity("", "Poisson's ratio", gt=-1, le=0.5) | None = None
    face_arrays: list[str] = Field([], description=f"in every frame: {', '.join(SHELL_FACE_ARRAYS)}")

    @field_validator("face_arrays")
    @classmethod
    def _listed(cls, names: list[str]) -> list[str]:
        for name in names:
            if name not in SHELL_FACE_ARRAYS:
                hint = nearest(name, list(SHELL_FACE_ARRAYS))
                raise ValueError(f"no array {name!r}{hint}; known: {', '.join(SHELL_FACE_ARRAYS)}")
        return names

    @field_validator("material")
    @classmethod
    def _known(cls, name: str | None) -> str | None:
        if name is not None and name not in MATERIALS:
            hint = nearest(name, list(MATERIALS))
            raise ValueError(f"no material {name!r}{hint}; known: {', '.join(MATERIALS)}")
        return name

    @model_validator(mode="after")
    def _complete(self) -> Shell:
        values = {key: getattr(self, key) for key in KEYS}
        if self.material is None and None in values.values():
            logging.getLogger("ddgcli").warning(
                "object %s names no material: %s is taken for %s",
                self.name, DEFAULT_MATERIAL, ", ".join(k for k, v in values.items() if v is None),
            )  # fmt: skip
        for key, value in filled({"material": self.material, **values}).items():
            if key in KEYS and values[key] is None:
                object.__setattr__(self, key, value)
        return self


class NoParameters(Section):
    """A scheme without parameters."""


class NewmarkParameters(Section):
    """beta = 0 is explicit; gamma = 1/2 does not damp."""

    beta: quantity("", "weight of the new acceleration in the positions", ge=0, le=0.5) = 0.25
    gamma: quantity("", "weight of the new acceleration in the velocities", ge=0.5, le=1) = 0.5


class StaticParameters(Section):
    """Equilibria under growing loads."""

    load_steps: int = Field(
        1, ge=1, le=100000, description="equilibria under k / load_steps of every load that has no ramp"
    )
    arc_length: quantity("m", "root mean square move of a step along the path of equilibria", gt=0) | None = (
        None
    )


KIND = SceneKind(
    "shell-sim",
    {"shell": Shell, "obstacle": Obstacle},
    {
        "newmark": NewmarkParameters,
        "implicit-euler": NoParameters,
        "implicit-midpoint": NoParameters,
        "symplectic-euler": NoParameters,
        "verlet": NoParameters,
        "avi": NoParameters,
        "bdf2": NoParameters,
        "static": StaticParameters,
    },
    "newmark",
    EFFECTS,
    elsewhere={
        **dict.fromkeys(
            (
                "initial",
                "viscosity",
                "buoyancy",
                "force",
                "rotation",
                "dye",
                "particles",
                "boundary",
                "harmonic",
                "fluid",
            ),
            "fluid-sim",
        )
    },
)
