"""Effect `load`: dead forces on vertices, tractions, moments on edges."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ddgcli.geometry.hinges import angle_gradient, hinge_frame, hinges
from ddgcli.mechanics.terms import DeadLoad, Mode, Potential
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.vectors import vector_length
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.hinge import angle_hessian, wrapped
from ddgcli.models.shell.ramp import RampSection
from ddgcli.scenes.units import quantity, vector
from ddgcli.simulation.effects import Effect

KINDS = ("force", "traction", "line_force", "moment")


class Load(RampSection):
    """One of force, traction, line_force and moment."""

    object: str | None = Field(None, description="shell; needed where the scene has several")
    force: vector("N", "total force, shared by the vertices in proportion to their area") | None = None
    traction: vector("Pa", "force per rest area, over the whole shell or the vertices given") | None = None
    moment: quantity("N", "moment per length, folding towards convex; see edge, vertices, box") | None = None
    line_force: vector("N/m", "force per rest length of the boundary edges between the vertices") | None = (
        None
    )
    vertices: list[int] | None = None
    box: list[vector("m")] | None = Field(
        None, min_length=2, max_length=2, description="two opposite corners, [[x, y, z], [x, y, z]]"
    )
    edge: list[int] | None = Field(
        None,
        min_length=2,
        max_length=2,
        description="of a moment: ends of an interior edge, on whose two faces it acts",
    )

    @model_validator(mode="after")
    def _one(self) -> Load:
        loads = [k for k in KINDS if getattr(self, k) is not None]
        if len(loads) != 1:
            raise ValueError(f"give one of {', '.join(KINDS)}, found {' and '.join(loads) or 'none'}")
        places = [k for k in ("edge", "vertices", "box") if getattr(self, k) is not None]
        if self.moment is None and self.edge is not None:
            raise ValueError("an edge needs a moment")
        if self.moment is not None and len(places) != 1:
            raise ValueError(
                "a moment needs one of edge = [a, b] (an interior edge), vertices and box (boundary edges "
                f"there); here: {' and '.join(places) or 'none'}"
            )
        return self


class HingeMoment(Potential):
    """Opposite couples on the two faces of an edge: energy -moment (angle - rest), moment in N m."""

    name = "load"

    def __init__(self, stencil: NDArray, moment: NDArray, rest: NDArray) -> None:
        self.stencil, self.moment, self.rest = stencil, moment, rest

    @property
    def is_zero(self) -> bool:
        return not np.any(self.moment)

    def scaled(self, factor: float) -> HingeMoment:
        """The moment times a factor."""
        return HingeMoment(self.stencil, factor * self.moment, self.rest)

    def energy(self, x: NDArray) -> float:
        angle = wrapped(hinge_frame(x, self.stencil).angle - self.rest)
        return -float(np.sum(self.moment * angle))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        slope = angle_gradient(hinge_frame(x, self.stencil))
        return sum_by_index(self.stencil, -self.moment[:, None, None] * slope, len(x))

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        if mode != "exact":
            return np.zeros((len(self.stencil), 12, 12))
        return -self.moment[:, None, None] * angle_hessian(hinge_frame(x, self.stencil))


def build(parameters: Load, context: ShellContext) -> list[Any]:
    load: Any = _constant_load(parameters, context)
    on_boundary = parameters.moment is not None and parameters.edge is None
    load = parameters.ramped(load)
    if not on_boundary:
        return [load]
    from ddgcli.models.shell.edge_moment import EdgeTurns

    return [load, EdgeTurns(load)]


def _constant_load(parameters: Load, context: ShellContext) -> Potential:
    """The load before its ramp is applied."""
    if parameters.moment is not None and parameters.edge is None:
        from ddgcli.models.shell.edge_moment import edge_moment

        vertices = context.selection(parameters.vertices, parameters.box, ("effects", "load"))
        return edge_moment(context, vertices, float(parameters.moment))
    if parameters.moment is not None:
        return _moment(parameters, context)
    area = context.vertex_area
    everywhere = parameters.traction is not None and parameters.vertices is None and parameters.box is None
    vertices = (
        np.arange(len(area))
        if everywhere
        else context.selection(parameters.vertices, parameters.box, ("effects", "load"))
    )
    force = np.zeros((len(area), 3))
    if parameters.force is not None:
        force[vertices] = (area[vertices] / area[vertices].sum())[:, None] * np.array(parameters.force)
    elif parameters.line_force is not None:
        force = boundary_share(context, vertices)[:, None] * np.array(parameters.line_force)
    else:
        force[vertices] = area[vertices, None] * np.array(parameters.traction)
    return DeadLoad("load", force)


def boundary_share(context: ShellContext, vertices: NDArray) -> NDArray[np.float64]:
    """(n,) half the total rest length of the boundary edges at each vertex that join two of `vertices`."""
    topology, x = context.mesh.topology, np.asarray(context.mesh.points)
    edges = topology.edges[topology.boundary_edges]
    edges = edges[np.isin(edges, vertices).all(axis=1)]
    if not len(edges):
        raise ValueError("no boundary edge joins two of the vertices; line_force acts on boundary edges")
    half = 0.5 * vector_length(x[edges[:, 1]] - x[edges[:, 0]])
    return sum_by_index(edges, np.stack([half, half], axis=1), len(x))


def _moment(parameters: Load, context: ShellContext) -> HingeMoment:
    stencil = hinges(context.mesh.topology)
    ends = np.sort(np.array(parameters.edge))
    edge = np.flatnonzero((np.sort(stencil[:, :2], axis=1) == ends).all(axis=1))
    if len(edge) == 0:
        raise ValueError(
            f"no interior edge joins the vertices {parameters.edge}; a moment acts between two faces"
        )
    x = np.asarray(context.mesh.points)
    f = hinge_frame(x, stencil[edge])
    return HingeMoment(stencil[edge], float(parameters.moment or 0) * f.length, f.angle)


EFFECT = Effect("load", Load, build, "one addition per step", ("shell",), repeatable=True)
