"""What each command requires of its mesh: a table, and the first requirement that a mesh does not meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ddgcli.errors import MeshError, counted
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.require import refuse_flat_faces, require, require_area
from ddgcli.mesh.require_solid import (
    refuse_folds,
    require_manifold_body,
    require_manifold_cells,
    require_sized_solid,
)
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True)
class Requirement:
    """Properties that a command requires of its mesh.

    Parameters
    ----------
    kinds : tuple of str
        Of 'surface', 'tetrahedra', 'curve'.
    surface : dict
        Arguments of `require` for a surface.
    boundary : dict
        Arguments of `require` for the boundary of tetrahedra.
    area, every_area, volume : bool
        At least one face with area; every face with area; every tetrahedron with volume.
    positive_volume : bool
        No tetrahedron of negative volume, and none on the side of a face where its neighbour lies.
    manifold_cells : bool
        No face of more than two tetrahedra.
    instead : str
        Why the command takes no mesh, or "".
    """

    kinds: tuple[str, ...] = ("surface",)
    surface: dict[str, bool] = field(default_factory=dict)
    boundary: dict[str, bool] = field(default_factory=dict)
    area: bool = False
    every_area: bool = False
    volume: bool = False
    positive_volume: bool = False
    manifold_cells: bool = False
    instead: str = ""


_MANIFOLD = {"manifold": True, "oriented": True}
# `info` reports them under `accepts`; tests compare each row with the command
REQUIREMENTS = {
    "info": Requirement(
        ("surface", "tetrahedra", "curve"), {"faces": False, "sized": False}, {"faces": False, "sized": False}
    ),
    "repair": Requirement(
        ("surface", "tetrahedra"), {"faces": False, "sized": False}, {"faces": False, "sized": False}
    ),
    "curvature": Requirement(("surface", "tetrahedra", "curve"), area=True),
    "delaunay": Requirement(
        surface={"sized": False, "extent": True, "manifold_edges": True, "oriented": True, "one_sided": True},
        area=True,
    ),
    "laplacian": Requirement(("surface", "tetrahedra"), area=True, volume=True, manifold_cells=True),
    "hodge": Requirement(
        ("surface", "tetrahedra"),
        {**_MANIFOLD, "one_sided": True},
        {"manifold": True},
        volume=True,
        manifold_cells=True,
    ),
    "dec": Requirement(
        ("surface", "tetrahedra"),
        _MANIFOLD,
        {"faces": True},
        every_area=True,
        volume=True,
        manifold_cells=True,
    ),
    "geodesic": Requirement(surface={"sized": False}),
    "shell-sim": Requirement(every_area=True),
    "fluid-sim": Requirement(
        ("surface", "tetrahedra"),
        _MANIFOLD,
        {"faces": True},
        every_area=True,
        volume=True,
        positive_volume=True,
        manifold_cells=True,
    ),
    "willmore-flow": Requirement(surface=_MANIFOLD, every_area=True),
    "curve-flow": Requirement(("curve",)),
    "tradeoff": Requirement(),
    "frames": Requirement((), instead="it takes the trajectory of a simulation (.vtkhdf)"),
    "view": Requirement(
        ("surface", "tetrahedra", "curve"), {"faces": False, "sized": False}, {"faces": False}
    ),
    "batch": Requirement((), instead="it takes inputs and, after --, the command to run on them"),
    "examples": Requirement((), instead="it takes the folder to copy to"),
    "check": Requirement((), instead="it takes a stored summary (.json)"),
}
_PHRASE = {"surface": "a surface", "tetrahedra": "tetrahedra", "curve": "a curve"}


def kind_of(mesh: TriangleMesh | TetMesh | CurveSet) -> str:
    """Kind of a mesh, as the requirements of the commands name it.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or CurveSet

    Returns
    -------
    {'surface', 'tetrahedra', 'curve'}
    """
    return "tetrahedra" if isinstance(mesh, TetMesh) else "curve" if isinstance(mesh, CurveSet) else "surface"


def kind_error(
    mesh: TriangleMesh | TetMesh | CurveSet, kinds: Sequence[str], subject: str = "it", path: str = ""
) -> str | None:
    """Why a command does not take a mesh of this kind, with a remedy.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or CurveSet
    kinds : sequence of {'surface', 'tetrahedra', 'curve'}
        What the command takes.
    subject : str
        Subject of the message, such as the name of a command.
    path : str
        Path of the mesh file, for the remedy, if it is not that of the input.

    Returns
    -------
    str or None
        None if the mesh has one of the kinds.
    """
    kind = kind_of(mesh)
    if kind in kinds:
        return None
    bounded = kind == "tetrahedra" and "surface" in kinds
    advice = f"; take their boundary, `boundary_mesh{path and f'={path}'}`" if bounded else ""
    return f"holds {_PHRASE[kind]}; {subject} takes {' or '.join(_PHRASE[k] for k in kinds)}{advice}"


def unmet_need(mesh: TriangleMesh | TetMesh | CurveSet, command: str) -> str | None:
    """First requirement of a command that a mesh does not meet, with a remedy.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or CurveSet
    command : str
        Name of the command, a key of `REQUIREMENTS`.

    Returns
    -------
    str or None
        None if the mesh meets all.
    """
    requirement = REQUIREMENTS[command]
    if requirement.instead:
        return requirement.instead
    if message := kind_error(mesh, requirement.kinds):
        return message
    try:
        if isinstance(mesh, TetMesh):
            of_boundary = {**requirement.boundary, "manifold": False}
            if len(mesh.tetrahedra):  # of which all may lie inside
                of_boundary["faces"] = False
            require(mesh.boundary, "it", **of_boundary)
            require_sized_cells(mesh, command)
            if requirement.boundary.get("manifold"):
                require_manifold_body(mesh, "it")
            return None
        elif isinstance(mesh, TriangleMesh):
            require(mesh, "it", **requirement.surface)
            if requirement.area:
                require_area(mesh)
        require_sized_cells(mesh, command)
    except MeshError as error:
        return str(error)
    return None


def require_sized_cells(mesh: TriangleMesh | TetMesh | CurveSet, command: str) -> None:
    """Raise an error for faces without area, and for tetrahedra that the command does not take.

    This is the one check of tetrahedra, of all commands: flat, repeated, overlapping and inverted cells.
    `warn_of_solid` warns of what no command refuses.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or CurveSet
    command : str
        Name of the command, a key of `REQUIREMENTS`.

    Raises
    ------
    MeshError
    """
    requirement = REQUIREMENTS[command]
    if isinstance(mesh, TetMesh):
        if requirement.volume:
            require_sized_solid(mesh)
        if requirement.manifold_cells:
            require_manifold_cells(mesh)
        if requirement.positive_volume:
            refuse_folds(mesh)
        if requirement.positive_volume and (mesh.signed_volume < 0).any():
            bad = np.flatnonzero(mesh.signed_volume < 0)
            what = counted(len(bad), "tetrahedron is inverted", "tetrahedra are inverted")
            raise MeshError(f"{what} (first: {bad[0]}); {remedy('inverted')}")
    elif isinstance(mesh, TriangleMesh) and requirement.every_area:
        refuse_flat_faces(mesh.flat_faces, mesh.topology, **requirement.surface)
