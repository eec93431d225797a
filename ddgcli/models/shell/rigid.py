"""Effect `rigid`: edges that keep their lengths exactly."""

# mypy: disable-error-code="valid-type"

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from ddgcli.mechanics.constraints import RigidEdges
from ddgcli.models.shell.context import ShellContext
from ddgcli.scenes.sections import Section
from ddgcli.scenes.units import vector
from ddgcli.simulation.effects import Effect


class Rigid(Section):
    """Edges of constant length: given ones, those between some vertices, or all."""

    object: str | None = Field(None, description="shell; needed where the scene has several")
    edges: list[list[int]] | None = Field(None, description="pairs of vertex indices")
    vertices: list[int] | None = Field(None, description="every edge between two of these vertices")
    box: list[vector("m")] | None = Field(
        None, min_length=2, max_length=2, description="every edge between two vertices in this box"
    )

    @field_validator("edges")
    @classmethod
    def _pairs(cls, edges: list[list[int]] | None) -> list[list[int]] | None:
        for pair in edges or []:
            if len(pair) != 2:
                raise ValueError(f"an edge is a pair of vertices [a, b], not {pair}")
        return edges


def build(parameters: Rigid, context: ShellContext) -> list[RigidEdges]:
    time = context.scene.time
    if time.integrator != "verlet":
        raise ValueError(f'constraints are kept by the scheme "verlet", not by "{time.integrator}"')
    for effect, _, _ in context.scene.effects:
        if effect.name in ("handle", "attach"):
            raise ValueError(
                f"rigid edges together with {effect.name} are not computed; leave one of them out"
            )
    edges = _selected_edges(parameters, context)
    edges = edges[~_fixed_vertices(context)[edges].all(axis=1)]
    if not len(edges):
        raise ValueError("pins hold every one of these edges already; leave rigid out, or pin fewer vertices")
    x = np.asarray(context.mesh.points)
    return [RigidEdges(edges, np.linalg.norm(x[edges[:, 1]] - x[edges[:, 0]], axis=1))]


def _selected_edges(parameters: Rigid, context: ShellContext) -> NDArray[np.int64]:
    """(e, 2) edges that the section selects; ValueError for pairs that are not edges, and without any."""
    edges = np.asarray(context.mesh.topology.edges)
    if parameters.edges is not None:
        if parameters.vertices is not None or parameters.box is not None:
            raise ValueError("give edges, or vertices, or a box, or none of them for all edges")
        edge_rows = np.sort(np.array(parameters.edges, dtype=np.int64).reshape(-1, 2), axis=1)
        mesh_edges = {(int(a), int(b)) for a, b in np.sort(edges, axis=1)}
        for a, b in edge_rows:
            if (int(a), int(b)) not in mesh_edges:
                raise ValueError(f"no edge joins the vertices [{a}, {b}]; name two that share a face")
        edges = np.unique(edge_rows, axis=0)
    elif parameters.vertices is not None or parameters.box is not None:
        vertices = context.selection(parameters.vertices, parameters.box, ("effects", "rigid"))
        edges = edges[np.isin(edges, vertices).all(axis=1)]
    if not len(edges):
        raise ValueError("no edge joins two of these vertices; name neighbours, or a larger box")
    return edges


def _fixed_vertices(context: ShellContext) -> NDArray[np.bool_]:
    """(n,) whether pins hold each vertex in all directions; an edge between two of them is rigid already."""
    fixed = np.zeros((context.mesh.n_vertices, 3), dtype=bool)
    for term in context.terms.get("pin", []):
        fixed |= term.mask
    return np.asarray(fixed.all(axis=1))


EFFECT = Effect("rigid", Rigid, build, "one factorisation of an e x e matrix per step, e edges", ("shell",))
