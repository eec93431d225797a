"""The `input` block of the summary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ddgcli.mesh.fields import AnyMesh


def input_facts(mesh: AnyMesh) -> dict[str, Any]:
    """Sizes and topology of a mesh; of tetrahedra, the topology of their boundary surface."""
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.tet_mesh import TetMesh

    if isinstance(mesh, TetMesh):
        facts = input_facts(mesh.boundary)
        return {**facts, "vertices": mesh.n_vertices, "tetrahedra": len(mesh.tetrahedra)}
    if isinstance(mesh, CurveSet):
        return mesh.describe()
    topology = mesh.topology
    return {
        "vertices": mesh.n_vertices,
        "faces": topology.n_faces,
        "components": topology.n_components,
        "boundary_loops": topology.boundary_loops,
        "euler_characteristic": topology.euler_characteristic,
        "genus": topology.genus,
        "manifold": topology.is_manifold,
        "oriented": topology.is_oriented,
        "closed": topology.is_closed,
    }


def reason_of_no_genus(facts: Mapping[str, Any]) -> str:
    """Why a surface with this `input` block has no genus."""
    return "cannot be oriented" if facts["manifold"] else "is not manifold"
