"""Each verb states its needs; a mesh that breaks one is refused in a sentence with the mend."""

from __future__ import annotations

from ddgcli.errors import MeshError
from ddgcli.mesh.triangle_mesh import TriangleMesh


def require(
    mesh: TriangleMesh,
    verb: str,
    *,
    faces: bool = True,
    manifold: bool = False,
    oriented: bool = False,
    closed: bool = False,
) -> None:
    """Raise MeshError naming the first culprit and the mend when `mesh` lacks a property."""
    topology = mesh.topology
    if faces and topology.n_faces == 0:
        raise MeshError(f"no triangles; {verb} needs a surface")
    if manifold and len(topology.nonmanifold_edges):
        bad = topology.nonmanifold_edges
        a, b = topology.edges[bad[0]]
        raise MeshError(
            f"{len(bad)} edges have more than two faces (first: vertices {a}-{b}); "
            f"{verb} needs a manifold mesh: split the surface there"
        )
    if manifold and len(topology.nonmanifold_vertices):
        bad = topology.nonmanifold_vertices
        raise MeshError(
            f"{len(bad)} vertices join several fans of faces (first: vertex {bad[0]}); "
            f"{verb} needs a manifold mesh: duplicate such vertices, one for each fan"
        )
    if oriented and not topology.is_oriented:
        bad = topology.misoriented_edges
        a, b = topology.edges[bad[0]]
        raise MeshError(
            f"{len(bad)} edges join faces of opposite orientation (first: vertices {a}-{b}); "
            f"{verb} needs consistently oriented faces"
        )
    if closed and not topology.is_closed:
        a, b = topology.edges[topology.boundary_edges[0]]
        raise MeshError(
            f"the surface has {topology.boundary_loops} boundary loops (first edge: vertices {a}-{b}); "
            f"{verb} needs a closed surface: fill the holes"
        )
