"""Effect `particles`: points that move with the flow, and their paths.

A particle follows the flow of mid-step (mean of the step's ends) by the velocity that is linear between the
vertices: of second order. Every frame has the positions as `particles_NAME`, x, y, z of one after another.
"""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ddgcli.choices import PARTICLES
from ddgcli.models.fluid.context import FluidContext
from ddgcli.models.fluid.extent import plane_axes
from ddgcli.models.fluid.phases import FluidSetting, Phase, PhaseRequest, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import vector
from ddgcli.simulation.effects import Effect
from ddgcli.simulation.model import Observation

MAX_PARTICLES = 1_000_000
MAX_DRAWS = 1_000  # times that seeds are drawn until enough lie in the box
POINT_TOLERANCE = 1e-6  # of the fluid's size: how far from it a seed may lie
CELL, WEIGHT = "particle_cell", "particle_weight"


class SeedBox(Section):
    """A box along the axes; seeds outside are not taken."""

    corner: vector("m")
    size: vector("m")


class ParticlesSection(Section):
    """Seeds at random over the fluid (evenly), or at points."""

    count: int | None = Field(
        None, ge=1, le=MAX_PARTICLES, description="seeds at random, evenly over the fluid"
    )
    box: SeedBox | None = Field(None, description="part of space in which `count` seeds lie; default all")
    seed: int = Field(0, ge=0, description="of the random numbers")
    points: list[vector("m")] | None = Field(None, description="seeds; on a surface the nearest points of it")
    object: str | None = Field(None, description="fluid; by default all")

    @model_validator(mode="after")
    def _one_kind(self) -> ParticlesSection:
        if (self.count is None) == (self.points is None):
            raise ValueError("give either count or points")
        if self.points is not None and (not self.points or self.box is not None):
            raise ValueError("points is a list of at least one point, without box")
        return self


def random_seeds(
    context: FluidContext, size: NDArray, section: ParticlesSection
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Cells (k,) and weights (k, 3 or 4) of seeds drawn evenly by the sizes (m,) of the cells."""
    rng, corners, count = np.random.default_rng(section.seed), context.cells.shape[1], section.count or 0
    share = size / size.sum()
    cells, weights, present = [], [], 0
    for _ in range(MAX_DRAWS):
        cell = rng.choice(len(size), count, p=share)
        weight = rng.dirichlet(np.ones(corners), count)
        inside = np.ones(count, dtype=bool)
        if section.box is not None:
            apart = positions(context, cell, weight) - np.array(section.box.corner)
            inside = ((apart >= 0) & (apart <= np.array(section.box.size))).all(axis=1)
        cells.append(cell[inside])
        weights.append(weight[inside])
        present += int(inside.sum())
        if present >= count:
            return np.concatenate(cells)[:count], np.concatenate(weights)[:count]
    raise ValueError(f"the box holds {present} of {count} seeds after {MAX_DRAWS} draws; move or enlarge it")


def positions(context: FluidContext, cell: NDArray, weight: NDArray) -> NDArray[np.float64]:
    """(k, 3) places; on a periodic grid within one period of the first corner of the cell."""
    corner = context.points[context.cells[cell]]
    apart = context.unwrapped(corner - corner[:, :1])
    return corner[:, 0] + np.einsum("ki,kia->ka", weight, apart)


def placed_seeds(context: FluidContext, points: NDArray) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Cells and weights of points in a volume, or of the nearest points of a surface."""
    cells = context.points[context.cells]
    reach = POINT_TOLERANCE * float(np.ptp(context.points, axis=0).max())
    in_plane, cell_of_point, weights = plane_axes(context) is not None, [], []
    for number, point in enumerate(points):
        if context.is_volume:
            edge = cells[:, 1:] - cells[:, :1]
            last = np.linalg.solve(edge.transpose(0, 2, 1), (point - cells[:, 0])[..., None])[..., 0]
            weight = np.column_stack([1.0 - last.sum(axis=1), last])
            best = int(np.argmax(weight.min(axis=1)))
            outside = weight[best].min() < -POINT_TOLERANCE
        else:
            from ddgcli.geometry.surface_points import nearest_on_triangle

            flat = cells[:, :1] + context.unwrapped(cells - cells[:, :1])
            weight, distance = nearest_on_triangle(point, flat)
            best = int(np.argmin(distance))
            outside = in_plane and bool(distance[best] > reach)
        if outside:
            raise ValueError(f"point {number} at {point.tolist()} lies outside of {context.name!r}; move it")
        cell_of_point.append(best)
        weights.append(weight[best])
    return np.array(cell_of_point), np.clip(np.array(weights), 0.0, 1.0)


class ParticlesPhase:
    """Cells and barycentric coordinates of the particles in the state; positions in the frames."""

    effect = "particles"
    step_stage: Literal["transport", "source", "tracer"] = "tracer"
    order = 2

    def __init__(self, setting: FluidSetting, section: ParticlesSection) -> None:
        self.setting, context = setting, setting.context
        if section.points is not None:
            self.cell, self.weight = placed_seeds(context, np.array(section.points, dtype=np.float64))
        else:
            size = setting.volume.volume if context.is_volume else setting.space.area
            self.cell, self.weight = random_seeds(context, size, section)

    def start(self) -> dict[str, NDArray]:
        return {CELL: self.cell, WEIGHT: self.weight}

    def advance(self, step: Step, state: FluidState) -> FluidState:
        carried = self._in_volume if self.setting.context.is_volume else self._on_surface
        cell, weight = carried(step, state)
        return state.with_passive(**{CELL: cell, WEIGHT: weight})

    def _on_surface(self, step: Step, state: FluidState) -> tuple[NDArray, NDArray]:
        space, tracing = self.setting.space, self.setting.tracing
        flux = 0.5 * (space.flow(step.before).side_flux + space.flow(state).side_flux)
        moved = tracing.backwards(tracing.corners(flux), state[CELL], state[WEIGHT], -step.dt)
        return moved.face, moved.barycentric

    def _in_volume(self, step: Step, state: FluidState) -> tuple[NDArray, NDArray]:
        space, paths = self.setting.volume, self.setting.volume_paths
        velocity = space.vertex_means(0.5 * (space.cell_velocity(step.before) + space.cell_velocity(state)))
        here = positions(self.setting.context, state[CELL], state[WEIGHT])
        cell, points = paths.carried(velocity, state[CELL], here, -step.dt)
        return cell, paths.barycentric(cell, points)

    def distance(self, a: FluidState, b: FluidState, start: FluidState, duration: float) -> float:
        """Largest distance of two positions of a particle, relative to the size of the fluid."""
        context = self.setting.context
        first, second = (positions(context, state[CELL], state[WEIGHT]) for state in (a, b))
        apart = np.linalg.norm(context.unwrapped(first - second), axis=1)
        return float(apart.max(initial=0.0) / np.ptp(context.points, axis=0).max())

    def observed(self, state: FluidState) -> Observation:
        context = self.setting.context
        places = positions(context, state[CELL], state[WEIGHT])
        return Observation(None, {}, {PARTICLES + context.name: places.ravel()})


def build(parameters: ParticlesSection, context: FluidContext) -> list[PhaseRequest]:
    def make(setting: FluidSetting) -> Phase:
        return ParticlesPhase(setting, parameters)

    return [PhaseRequest(make)]


EFFECT = Effect("particles", ParticlesSection, build, "one trace per particle and step", ("fluid",))
