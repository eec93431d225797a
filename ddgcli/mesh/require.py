"""Each verb states its needs; a mesh that breaks one is refused in a sentence with the mend."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ddgcli.errors import MeshError
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

FLAT = 1e-12  # area below this share of the longest side squared
THIN = 1e-8  # the same of a volume that is known from edge lengths only: their rounding squared
SIZES = (1e-140, 1e140)  # lengths whose squares, and sums of them, stay numbers


def require(
    mesh: TriangleMesh,
    verb: str,
    *,
    faces: bool = True,
    sized: bool = True,
    extent: bool = False,
    manifold: bool = False,
    manifold_edges: bool = False,
    oriented: bool = False,
    one_sided: bool = False,
    closed: bool = False,
) -> None:
    """Raise MeshError naming the first culprit and the mend when `mesh` lacks a property.

    Parameters
    ----------
    verb : str
        The subject of the message.
    faces : bool
        At least one triangle.
    sized, extent : bool
        Sides whose squares neither vanish nor overflow; at least one side longer than zero.
    manifold, manifold_edges : bool
        No edge with three faces, and (`manifold`) no vertex with several fans.
    oriented, closed : bool
    one_sided : bool
        With `oriented`: components that have no orientation are accepted.
    """
    topology = mesh.topology
    if faces and topology.n_faces == 0:
        raise MeshError(f"no triangles; {verb} needs a surface")
    if (sized or extent) and topology.n_faces:
        check_size(float(mesh.side_length.max()), in_range=sized)
    if (manifold or manifold_edges) and len(topology.nonmanifold_edges):
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
    bad = topology.misoriented_edges if oriented else topology.edges[:0, 0]
    if one_sided and len(bad):
        bad = bad[topology.orientable_component[topology.vertex_component[topology.edges[bad, 0]]]]
    if len(bad):
        a, b = topology.edges[bad[0]]
        raise MeshError(
            f"{len(bad)} edges join faces of opposite orientation (first: vertices {a}-{b}); "
            f"{verb} needs consistently oriented faces: {_how_to_orient(mesh, one_sided)}"
        )
    if closed and not topology.is_closed:
        a, b = topology.edges[topology.boundary_edges[0]]
        raise MeshError(
            f"the surface has {topology.boundary_loops} boundary loops (first edge: vertices {a}-{b}); "
            f"{verb} needs a closed surface: fill the holes"
        )


def _how_to_orient(mesh: TriangleMesh, one_sided: bool = False) -> str:
    turn = mesh.topology.faces_to_turn
    if not one_sided and mesh.topology.one_sided_face.any():
        return "this surface is one-sided and has none"
    return f"turn over {int(turn.sum())} of them (first: face {int(np.argmax(turn))})"


def check_size(longest: float, *, in_range: bool = True) -> None:
    """Refuse a length that is zero or, with `in_range`, whose square leaves the range of numbers."""
    if longest == 0:
        raise MeshError("every vertex is at the same place: there is no surface; mend the coordinates")
    if in_range and not SIZES[0] < longest < SIZES[1]:
        raise MeshError(
            f"the surface's size, {longest:.3g}, squared leaves the range of numbers; rescale the coordinates"
        )


@dataclass(frozen=True)
class Need:
    """What a command asks of its mesh.

    Parameters
    ----------
    kinds : tuple of str
        Of 'surface', 'tetrahedra', 'curve'.
    surface : dict
        What `require` is told of a surface.
    boundary : dict
        The same of the boundary of tetrahedra.
    area, every_area, volume : bool
        At least one face with area; every face with area; every tetrahedron with volume.
    instead : str
        Why no mesh is taken at all, where that is so.
    """

    kinds: tuple[str, ...] = ("surface",)
    surface: dict[str, bool] = field(default_factory=dict)
    boundary: dict[str, bool] = field(default_factory=dict)
    area: bool = False
    every_area: bool = False
    volume: bool = False
    instead: str = ""


_MANIFOLD = {"manifold": True, "oriented": True}
# what `info` answers under `accepts`; tests hold each row against what the command does
NEEDS = {
    "info": Need(
        ("surface", "tetrahedra", "curve"), {"faces": False, "sized": False}, {"faces": False, "sized": False}
    ),
    "repair": Need(surface={"faces": False, "sized": False}),
    "curvature": Need(("surface", "tetrahedra", "curve"), area=True),
    "delaunay": Need(
        surface={"sized": False, "extent": True, "manifold_edges": True, "oriented": True}, area=True
    ),
    "laplacian": Need(area=True),
    "hodge": Need(
        ("surface", "tetrahedra"), {**_MANIFOLD, "one_sided": True}, {"manifold": True}, volume=True
    ),
    "dec": Need(("surface", "tetrahedra"), _MANIFOLD, {"faces": True}, every_area=True, volume=True),
    "geodesic": Need(surface={"sized": False}),
    "shell-sim": Need(every_area=True),
    "fluid-sim": Need(surface=_MANIFOLD, every_area=True),
    "willmore-flow": Need(surface=_MANIFOLD, every_area=True),
    "tradeoff": Need(),
    "frames": Need((), instead="it takes the trajectory of a simulation (.vtkhdf)"),
    "view": Need(("surface", "tetrahedra", "curve"), {"faces": False, "sized": False}, {"faces": False}),
    "batch": Need((), instead="it takes inputs and, behind --, the command to run on them"),
    "examples": Need((), instead="it takes the folder to copy to"),
    "check": Need((), instead="it takes a stored summary (.json)"),
}


_PHRASE = {"surface": "a surface", "tetrahedra": "tetrahedra", "curve": "a curve"}


def kind_of(mesh: TriangleMesh | TetMesh | CurveSet) -> str:
    """'surface', 'tetrahedra' or 'curve'."""
    return "tetrahedra" if isinstance(mesh, TetMesh) else "curve" if isinstance(mesh, CurveSet) else "surface"


def wrong_kind(
    mesh: TriangleMesh | TetMesh | CurveSet, kinds: Sequence[str], verb: str = "it", path: str = "MESH"
) -> str | None:
    """Why a mesh is not of the `kinds` that `verb` takes, with the mend; None where it is."""
    kind = kind_of(mesh)
    if kind in kinds:
        return None
    mend = f"; ddgcli info {path} -o surface.ply writes their boundary" if kind == "tetrahedra" else ""
    return f"holds {_PHRASE[kind]}; {verb} takes {' or '.join(_PHRASE[k] for k in kinds)}{mend}"


def why_not(mesh: TriangleMesh | TetMesh | CurveSet, verb: str) -> str | None:
    """Why a command will not take the mesh, with the mend; None where it will."""
    need = NEEDS[verb]
    if need.instead:
        return need.instead
    if told := wrong_kind(mesh, need.kinds):
        return told
    try:
        if isinstance(mesh, TetMesh):
            require(mesh.boundary, "it", **need.boundary)
            if need.volume:
                _require_volume(mesh)
        elif isinstance(mesh, TriangleMesh):
            require(mesh, "it", **need.surface)
            if need.area:
                _require_area(mesh)
            if need.every_area:
                _require_every_area(mesh)
    except MeshError as error:
        return str(error)
    return None


def _require_area(mesh: TriangleMesh) -> None:
    side = mesh.side_vector / mesh.side_length.max()
    if (np.abs(np.cross(side[:, 0], side[:, 1])) <= FLAT).all():
        raise MeshError(f"none of the {mesh.n_faces} faces has an area; check the coordinates")


def _require_every_area(mesh: TriangleMesh) -> None:
    side = mesh.side_vector / np.maximum(mesh.side_length.max(axis=1), 1e-300)[:, None, None]
    flat = np.flatnonzero(~(np.linalg.norm(np.cross(side[:, 0], side[:, 1]), axis=1) > FLAT))
    if len(flat):
        raise MeshError(
            f"{len(flat)} faces have no area (first: face {flat[0]}); remove them, or mend their vertices"
        )


def _require_volume(mesh: TetMesh) -> None:
    edge = mesh.points[mesh.tetrahedra[:, 1:]] - mesh.points[mesh.tetrahedra[:, :1]]
    flat = np.flatnonzero(np.abs(mesh.signed_volume) <= THIN * np.abs(edge).max(axis=(1, 2)) ** 3)
    if len(flat):
        raise MeshError(
            f"{len(flat)} tetrahedra have no volume (first: tetrahedron {flat[0]}); remove or repair them"
        )
