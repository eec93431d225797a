"""Each verb states its needs; a mesh that breaks one is refused in a sentence with the mend."""

from __future__ import annotations

from dataclasses import dataclass

from ddgcli.errors import MeshError
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.tet_mesh import TetMesh
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


@dataclass(frozen=True)
class Need:
    """What a command asks of its mesh.

    Parameters
    ----------
    kinds : tuple of str
        Of 'surface', 'tetrahedra', 'curve'.
    manifold, oriented, closed : bool
        Of surfaces, and of the boundary of tetrahedra.
    instead : str
        Why no mesh is taken at all, where that is so.
    """

    kinds: tuple[str, ...] = ("surface",)
    manifold: bool = False
    oriented: bool = False
    closed: bool = False
    instead: str = ""


# what `info` answers under `accepts`; tests hold each row against what the command does
NEEDS = {
    "info": Need(("surface", "tetrahedra", "curve")),
    "curvature": Need(("surface", "curve")),
    "delaunay": Need(manifold=True, oriented=True),
    "laplacian": Need(),
    "hodge": Need(("surface", "tetrahedra"), manifold=True, oriented=True),
    "geodesic": Need(),
    "shell-sim": Need(),
    "fluid-sim": Need(manifold=True, oriented=True),
    "willmore-flow": Need(manifold=True, oriented=True),
    "tradeoff": Need(),
    "frames": Need((), instead="it takes the trajectory of a simulation (.vtkhdf)"),
    "check": Need((), instead="it takes a stored summary (.json)"),
}


def why_not(mesh: TriangleMesh | TetMesh | CurveSet, verb: str) -> str | None:
    """Why a command will not take the mesh, with the mend; None where it will."""
    need = NEEDS[verb]
    if need.instead:
        return need.instead
    kind = {TetMesh: "tetrahedra", CurveSet: "curve"}.get(type(mesh), "surface")
    if kind not in need.kinds:
        return f"holds {'a ' * (kind == 'curve')}{kind}; it takes {' or '.join(need.kinds)}"
    if kind == "curve" or verb == "info":
        return None
    surface = mesh.boundary if isinstance(mesh, TetMesh) else mesh
    try:
        require(surface, "it", manifold=need.manifold, oriented=need.oriented, closed=need.closed)  # type: ignore[arg-type]
    except MeshError as error:
        return str(error)
    return None
