"""Properties of tetrahedra that algorithms require, and errors for meshes without them."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError, counted
from ddgcli.mesh.coincident_faces import flat_gaps
from ddgcli.mesh.flat_cells import without_flat_cells
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.require import check_size
from ddgcli.mesh.tet_mesh import FLAT_POSITION_TOLERANCE, TetMesh
from ddgcli.mesh.vectors import vector_length

MAX_TRIED = 50  # flat cells for whose message the repair is tried
_REPAIRED: WeakKeyDictionary[TetMesh, int] = WeakKeyDictionary()  # flat cells that the repair leaves


def require_sized_solid(mesh: TetMesh) -> None:
    """Raise an error for flat tetrahedra, or volumes that leave the floating-point range.

    Parameters
    ----------
    mesh : TetMesh

    Raises
    ------
    MeshError
    """
    ends = mesh.points[mesh.edges]
    if len(ends):
        check_size(float(vector_length(ends[:, 1] - ends[:, 0]).max()), dimension=3)
    refuse_flat_cells(mesh.flat_tetrahedra, len(mesh.tetrahedra), mesh)


def require_manifold_body(mesh: TetMesh, subject: str) -> None:
    """Raise an error for tetrahedra without boundary, or that meet where they share no faces.

    Parameters
    ----------
    mesh : TetMesh
    subject : str
        Subject of the message, such as the name of a command.

    Raises
    ------
    MeshError
    """
    if len(mesh.tetrahedra) and mesh.boundary.n_faces == 0:
        raise MeshError(
            "the tetrahedra have no boundary, which is impossible for a body in space; remove one"
        )
    topology = mesh.boundary.topology
    if len(bad := topology.nonmanifold_edges):
        a, b = topology.edges[bad[0]]
        where = f"{counted(len(bad), 'edge', 'edges')} (first: vertices {a}-{b})"
    elif len(bad := topology.nonmanifold_vertices):
        where = f"{counted(len(bad), 'vertex', 'vertices')} (first: vertex {bad[0]})"
    else:
        return
    raise MeshError(
        f"bodies of tetrahedra touch along {where} without sharing faces there; {subject} needs a manifold "
        f"boundary: {remedy('flat gaps' if _has_closable_gaps(mesh) else 'touching bodies')}"
    )


def _has_closable_gaps(mesh: TetMesh) -> bool:
    """Whether bodies touch at gaps that flat cells have left, and that the repair closes."""
    n_gaps = len(flat_gaps(mesh, merged=False))
    return n_gaps > MAX_TRIED or (n_gaps > 0 and without_flat_cells(mesh).gaps > 0)


def require_manifold_cells(mesh: TetMesh) -> None:
    """Raise an error for a face of more than two tetrahedra.

    Parameters
    ----------
    mesh : TetMesh

    Raises
    ------
    MeshError
    """
    bad = np.flatnonzero(np.bincount(mesh.cell_triangle.ravel()) > 2)
    if len(bad):
        cells = np.flatnonzero((mesh.cell_triangle == bad[0]).any(axis=1))
        repeated = len(mesh.duplicate_tetrahedra) > 0
        raise MeshError(
            f"{counted(len(bad), 'face has', 'faces have')} more than two tetrahedra (first: vertices "
            f"{'-'.join(map(str, mesh.triangles[bad[0]]))} of tetrahedra {', '.join(map(str, cells[:4]))}); "
            + (remedy("duplicate cells") if repeated else "remove all but two at each")
        )


def refuse_flat_cells(flat: NDArray, n_cells: int, mesh: TetMesh | None = None) -> None:
    """Raise an error with the count and the first of the flat tetrahedra, if there are any.

    Parameters
    ----------
    flat : (k,) ndarray of int64
        Tetrahedra without volume.
    n_cells : int
    mesh : TetMesh, optional
        Names the repair only if it removes all of them, as far as `MAX_TRIED` of them show.

    Raises
    ------
    MeshError
    """
    if len(flat) == 0:
        return
    threshold = f"{FLAT_POSITION_TOLERANCE:.0e} of the longest edge cubed"
    if len(flat) == n_cells:  # their removal would leave nothing
        which = f"none of the {n_cells} tetrahedra has a" if n_cells > 1 else "the only tetrahedron has no"
        raise MeshError(f"{which} volume above {threshold}; check the coordinates")
    n_left = 0 if mesh is None else _flat_cells_after_repair(mesh)
    advice = (
        f"no repair removes {n_left} of them; move vertices, or mesh the body again"
        if n_left
        else remedy("no volume")
    )
    what = counted(len(flat), "tetrahedron is", "tetrahedra are")
    raise MeshError(
        f"{what} flat, with a volume of at most {threshold} (first: tetrahedron {flat[0]}); {advice}"
    )


def _flat_cells_after_repair(mesh: TetMesh) -> int:
    """Number of flat cells that the repair leaves; 0 where there are too many to try."""
    if len(mesh.flat_tetrahedra) > MAX_TRIED:
        return 0
    if mesh not in _REPAIRED:
        _REPAIRED[mesh] = len(without_flat_cells(mesh).flat)
    return _REPAIRED[mesh]


def refuse_folds(mesh: TetMesh) -> None:
    """Raise an error for neighbours on one side of their common face, which overlap.

    Parameters
    ----------
    mesh : TetMesh

    Raises
    ------
    MeshError
    """
    if message := fold_message(mesh):
        raise MeshError(f"{message}; move vertices, or mesh the body again")


def fold_message(mesh: TetMesh) -> str:
    """Count and first of the faces with both tetrahedra on one side; empty where there are none.

    Parameters
    ----------
    mesh : TetMesh

    Returns
    -------
    str
    """
    folds = mesh.folded_triangles
    if len(folds) == 0:
        return ""
    return (
        f"{counted(len(folds), 'face has', 'faces have')} both tetrahedra on one side (first: vertices "
        f"{'-'.join(map(str, mesh.triangles[folds[0]].tolist()))}), so that these overlap"
    )
