"""Effect `initial`: the flow at the start."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.vectors import row_dot
from ddgcli.models.fluid.boundary_sides import GAUSS_SHARES, BoundarySides
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.effect_parts import Initial
from ddgcli.models.fluid.flow_mesh import harmonic_count
from ddgcli.models.fluid.flows import FLOWS, KEYS, VOLUME_FLOWS, NamedFlow, VolumeFlow
from ddgcli.models.fluid.lost_gradient import warn_of_lost_gradient, warn_of_normal_velocity
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import quantity, vector
from ddgcli.simulation.effects import Effect

log = logging.getLogger("ddgcli")
NAMED_FLOWS: dict[str, NamedFlow | VolumeFlow] = {**FLOWS, **VOLUME_FLOWS}
ROUNDING_SHARE = 1e-24  # of the energy: vorticity below it is the rounding of a gradient
MAX_LOST_ENERGY_SHARE = 0.01  # share of the energy of an initial velocity that no discrete flow holds
REST_SPEED_SHARE = (
    1e-9  # root mean square speed over the strength, up to which a named flow counts as at rest
)
BALANCE_TOLERANCE = 1e-10  # total vorticity over the total of its terms that counts as zero


class InitialSection(Section):
    """One of vorticity, velocity and flow."""

    vorticity: str | None = Field(
        None, description="vertex array of the mesh, .npy, or expression in x, y, z [1/s]"
    )
    velocity: str | list[str | float] | None = Field(
        None, description="array on faces or vertices, .npy, or three numbers or expressions [m/s]"
    )
    flow: str | None = Field(None, description=f"by name: {', '.join(NAMED_FLOWS)}")
    strength: quantity("m/s", "speed of a named flow; negative reverses it") = 1.0
    core: quantity("m", "radius of its vortices", gt=0) | None = None
    separation: quantity("m", "distance of their centres", gt=0) | None = None
    center: vector("m", "between them; default the centroid of the surface") | None = None
    direction: vector("", "from one to the other") | None = None
    object: str | None = Field(None, description="fluid; by default all")

    @model_validator(mode="after")
    def _check_source(self) -> InitialSection:
        sources = [k for k in ("vorticity", "velocity", "flow") if getattr(self, k) is not None]
        if len(sources) != 1:
            raise ValueError(
                f"give one of vorticity, velocity and flow, found {' and '.join(sources) or 'none'}"
            )
        if self.flow is not None and self.flow not in NAMED_FLOWS:
            raise ValueError(f"no flow {self.flow!r}; known: {', '.join(NAMED_FLOWS)}")
        if isinstance(self.velocity, list) and len(self.velocity) != 3:
            raise ValueError("velocity takes three numbers or expressions")
        self._refuse_ignored()
        if self.direction is not None and not any(self.direction):
            raise ValueError("the direction must not be zero")
        return self

    def _refuse_ignored(self) -> None:
        keys = NAMED_FLOWS[self.flow].keys if self.flow is not None else ()
        for key in (*KEYS, "strength"):
            if key in self.model_fields_set and key not in (*keys, *(("strength",) if self.flow else ())):
                what = f"flow {self.flow!r}" if self.flow is not None else "vorticity or velocity"
                takes = ", ".join(("strength", *keys)) if self.flow is not None else "none of such keys"
                raise ValueError(f"{key} has no effect on {what}, which takes {takes}; take it out")


def build(parameters: InitialSection, context: FluidContext) -> list[Initial]:
    if context.is_volume:
        from ddgcli.models.fluid.volume_effects import initial

        return [initial(parameters, context)]
    if (source := parameters.velocity) is not None:
        vectors = context.face_vectors(source)

        def of_velocity(space: SurfaceSpace) -> dict[str, NDArray]:
            velocity = context.to_frames(space, vectors)
            squares = row_dot(vectors, vectors), np.abs(velocity) ** 2
            warn_of_normal_velocity(context.name, *(0.5 * float(space.area @ square) for square in squares))
            along = _along_boundary(context, space, source)
            vorticity, coefficients = space.of_face_velocity(velocity, along)
            # its mean is rounding alone, of these terms
            terms = 0.5 * sum_by_index(
                space.faces, np.abs(velocity)[:, None] * np.abs(space.side[:, NEXT]), space.n
            )
            vorticity = balanced(space, vorticity, terms)
            share = _warn_of_lost_energy(context, space, velocity, vorticity, coefficients)
            if share < ROUNDING_SHARE:
                vorticity = np.zeros_like(vorticity)
            return {"vorticity": vorticity, "coefficients": coefficients}

        return [Initial(of_velocity)]
    if parameters.flow is not None:
        if parameters.flow not in FLOWS:
            raise ValueError(f"flow {parameters.flow!r} is one of volumes; surfaces have {', '.join(FLOWS)}")
        omega = FLOWS[parameters.flow].vorticity(context, parameters)
        if not np.isfinite(omega).all():
            raise ValueError(f"flow {parameters.flow!r} is not finite on this surface")
    else:
        omega = context.scalar(str(parameters.vorticity), "vorticity")

    def of_vorticity(space: SurfaceSpace) -> dict[str, NDArray]:
        vorticity = omega * space.mass
        vorticity = balanced(space, vorticity, np.abs(vorticity))
        if parameters.flow is not None:
            _warn_of_rest(parameters, space, vorticity)
        elif vorticity.any() and not vorticity[space.free].any():
            _warn_of_still_vorticity(context.name, space)
        return {"vorticity": vorticity}

    return [Initial(of_vorticity)]


def _along_boundary(
    context: FluidContext, space: SurfaceSpace, source: str | list[Any]
) -> NDArray[np.float64] | None:
    """(s, 2) integrals of the velocity along the boundary sides; None for those of the faces."""
    ends = space.boundary_sides[2]
    sides = BoundarySides(context, ends)
    vectors = context.vectors_along(source, ends, GAUSS_SHARES, sides.points)
    if vectors is None:
        if len(ends):
            log.warning(
                "the initial velocity of %s has no values along the boundary: its vorticity there errs by up "
                "to two thirds of the largest on any mesh; give it on vertices or as expressions",
                context.name,
            )  # fmt: skip
        return None
    along = sides.integrals(vectors)
    if space.open_vertices is not None:  # a flow has no tangential velocity at natural outflows
        along[space.open_vertices[ends]] = 0.0
    return along


def _warn_of_lost_energy(
    context: FluidContext, space: SurfaceSpace, velocity: NDArray, vorticity: NDArray, coefficients: NDArray
) -> float:
    """Report a velocity of which the flow lacks much: harmonic flows left out by the scene, or a gradient.

    Returns the share of the energy that the flow of the vorticity has.
    """
    whole = 0.5 * float(np.sum(space.area * np.abs(velocity) ** 2))
    phi = space.stream_function(vorticity)
    share = space.kinetic_energy(phi, np.zeros(len(space.harmonic))) / (whole or 1.0)
    if len(space.harmonic) or not harmonic_count(space.mesh):
        if space.lift is None:
            warn_of_lost_gradient(context.name, whole, space.kinetic_energy(phi, coefficients))
        return share
    energy_without = space.kinetic_energy(phi, np.zeros(0))
    if whole - energy_without > MAX_LOST_ENERGY_SHARE * whole:
        log.warning(
            "%.3g %% of the energy of the initial velocity of %s is left out: its gradient part, and its "
            "harmonic part, which the effect harmonic = {} keeps",
            100.0 * (whole - energy_without) / whole, context.name,
        )  # fmt: skip
    return share


def _warn_of_rest(parameters: InitialSection, space: SurfaceSpace, vorticity: NDArray) -> None:
    """Report a flow by name that does not move the fluid, such as a wave of a sphere on a flat square."""
    phi = space.stream_function(vorticity)
    energy = space.kinetic_energy(phi, np.zeros(len(space.harmonic)))
    speed = float(np.sqrt(energy) / np.sqrt(0.5 * space.area.sum()))
    if speed <= REST_SPEED_SHARE * abs(parameters.strength) and parameters.strength:
        log.warning(
            "flow %r leaves the fluid at rest on this surface: its vorticity is zero, constant or on walls "
            "alone; give another flow or other keys (such as center), or vorticity",
            parameters.flow,
        )


def _warn_of_still_vorticity(name: str, space: SurfaceSpace) -> None:
    """Report vorticity at walls alone, where the velocity has none to turn."""
    remedy = "give a vorticity that differs from zero at vertices inside"
    if not len(space.free):
        remedy = (
            "no vertex of its mesh is inside: give its grid more cells, or split the faces of its mesh in "
        )
        remedy += "four (`laplacian` with `subdivide=1` writes that)"
    log.warning("the initial vorticity of %s, on walls alone, leaves the fluid at rest; %s", name, remedy)


def balanced(space: SurfaceSpace, vorticity: NDArray, terms: NDArray) -> NDArray[np.float64]:
    """Integrated vorticity (n,) without its mean on every closed component.

    A warning reports a mean that is more than rounding of `terms` (n,), sizes of what the vorticity sums.
    """
    topology = space.mesh.topology
    label = topology.vertex_component
    closed = np.ones(topology.n_components, dtype=bool)
    closed[unique_keys(label[topology.boundary_vertex])] = False
    total = space.component_vorticity(vorticity)
    size = space.component_vorticity(terms)
    area = space.component_vorticity(space.mass)
    mean = np.where(closed, total / area, 0.0)
    if np.any(closed & (np.abs(total) > BALANCE_TOLERANCE * size)):
        worst = float(mean[np.argmax(np.abs(mean))])
        log.warning(
            "on a closed surface the vorticity sums to zero: its mean (%.6g 1/s) was subtracted", worst
        )
    in_component = label >= 0
    without_mean = np.where(in_component, vorticity - space.mass * mean[np.maximum(label, 0)], 0.0)
    rounding = np.where(closed, space.component_vorticity(without_mean) / area, 0.0)
    return np.where(in_component, without_mean - space.mass * rounding[np.maximum(label, 0)], 0.0)


EFFECT = Effect("initial", InitialSection, build, "none after the start", ("fluid",), repeatable=True)
