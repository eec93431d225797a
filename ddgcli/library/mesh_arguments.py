"""Conversion of the `mesh` argument of library functions to a mesh object."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.errors import MeshError
from ddgcli.library.arguments import checked_arguments
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnyMesh
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh

P = ParamSpec("P")
R = TypeVar("R")

KIND_CLASS: dict[str, type] = {
    "surface": TriangleMesh,
    "intrinsic": IntrinsicMesh,
    "tetrahedra": TetMesh,
    "curve": CurveSet,
}
KIND_PHRASE = {
    "surface": "a triangle surface in space",
    "intrinsic": "an intrinsic triangulation",
    "tetrahedra": "tetrahedra",
    "curve": "curves",
}
MIN_QUADRILATERALS = 3  # two tetrahedra may legitimately share only an edge


class MeshHolder(Protocol):
    """Object with an attribute `mesh`: the content of a mesh file, the result of a measurement."""

    @property
    def mesh(self) -> Any: ...


MeshLike = AnyMesh | tuple[ArrayLike, ArrayLike] | MeshHolder


def as_mesh(mesh: MeshLike) -> AnyMesh:
    """Mesh of an argument that may be a pair of arrays.

    Every function of the library passes its `mesh` argument through this conversion.

    Parameters
    ----------
    mesh : mesh, (points, cells) pair, or object with `mesh`, with `vertices` and `faces`, or of meshio
        A pair holds points (n, 2) or (n, 3) and cells (m, 3), (m, 4) or (m, 2): triangles, tetrahedra or
        segments; quadrilaterals are refused. A mesh that is used several times is better converted once,
        since it keeps its topology.

    Returns
    -------
    TriangleMesh, TetMesh, CurveSet or IntrinsicMesh

    Raises
    ------
    MeshError
        When the argument is none of these, or the arrays do not make a mesh.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> V, F = [[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]
    >>> ddg.as_mesh((V, F)).n_faces
    1
    """
    if isinstance(mesh, AnyMesh):
        _refuse_raw_arrays(mesh)
        return mesh
    if isinstance(mesh, (tuple, list)) and len(mesh) == 2:
        try:
            return _mesh_of_pair(*mesh)
        except MeshError:
            raise
        except (TypeError, ValueError) as error:
            raise MeshError(f"the pair (points, cells) holds no arrays of numbers: {error}") from error
    own_mesh = getattr(mesh, "mesh", None)
    if isinstance(own_mesh, AnyMesh):
        return own_mesh
    cells_dict = getattr(mesh, "cells_dict", None)
    if hasattr(mesh, "points") and isinstance(cells_dict, dict):  # of meshio
        return as_mesh((mesh.points, _cells_of_meshio(cells_dict)))
    if hasattr(mesh, "vertices") and hasattr(mesh, "faces"):  # such as trimesh.Trimesh
        return as_mesh((mesh.vertices, mesh.faces))
    raise MeshError(
        f"{type(mesh).__name__} is not a mesh; give a mesh, a pair (points, faces) of arrays, or what "
        "read_mesh returns"
    )


def _refuse_raw_arrays(mesh: AnyMesh) -> None:
    """Raise MeshError for a mesh whose constructor was called with raw faces or lists."""
    name = type(mesh).__name__
    if isinstance(mesh, (TriangleMesh, IntrinsicMesh)):
        is_raw = not isinstance(mesh.topology, Topology)
    else:
        is_raw = not isinstance(mesh.tetrahedra if isinstance(mesh, TetMesh) else mesh.lines, np.ndarray)
    if is_raw or not isinstance(getattr(mesh, "points", None), (np.ndarray, type(None))):
        raise MeshError(
            f"this {name} holds raw arrays, which its constructor does not check; make it by "
            f"`ddg.as_mesh((points, cells))`"
            + ("" if name == "IntrinsicMesh" else f" or `ddg.{name}.from_arrays`")
        )


def _mesh_of_pair(points: ArrayLike, cells: ArrayLike) -> AnyMesh:
    """Mesh of the kind that follows from the number of corners of a cell."""
    corners = np.shape(cells)[1] if np.ndim(cells) == 2 else 0
    if corners == 4:
        _refuse_vtk_faces(np.asarray(cells))
        mesh = TetMesh.from_arrays(points, cells)
        _refuse_quadrilaterals(mesh.tetrahedra)
        return mesh
    if corners == 2:
        return CurveSet.from_arrays(points, cells)
    return TriangleMesh.from_arrays(points, cells)


def _cells_of_meshio(cells: dict[str, NDArray]) -> NDArray:
    """Cells of the one kind that a mesh of meshio has, apart from lines and points of a surface or solid."""
    kinds = [kind for kind, of_kind in cells.items() if len(of_kind) and kind not in ("vertex", "line")]
    if len(kinds) == 1 and kinds[0] in ("triangle", "tetra"):
        return cells[kinds[0]]
    raise MeshError(
        f"this mesh of meshio holds cells of the kinds {', '.join(cells) or 'none'}; pass those of one kind, "
        'such as `(mesh.points, mesh.cells_dict["triangle"])`'
    )


def _refuse_vtk_faces(cells: NDArray) -> None:
    """Raise an error for triangles as VTK writes them: each with its number of corners, 3, before it."""
    if len(cells) and np.all(cells[:, 0] == 3) and np.any(cells[:, 1:] == 3):
        raise MeshError(
            "every cell begins with 3, as the faces of VTK begin with their number of corners; pass the "
            "corners alone, cells[:, 1:]"
        )


def _refuse_quadrilaterals(cells: NDArray) -> None:
    """Raise an error for cells that look like quadrilaterals: no two share three vertices.

    Neighbouring quadrilaterals share two vertices, neighbouring tetrahedra share three.
    """
    corner = np.sort(cells, axis=1)
    if len(cells) < MIN_QUADRILATERALS or len(np.unique(corner)) == corner.size:
        return
    faces = np.concatenate([np.delete(corner, k, axis=1) for k in range(4)])
    if len(np.unique(faces, axis=0)) == len(faces):
        raise MeshError(
            f"of the {len(cells)} cells of four vertices, no two share a face of three, as tetrahedra do; "
            "divide quadrilaterals Q into triangles: np.concatenate([Q[:, [0, 1, 2]], Q[:, [0, 2, 3]]])"
        )


def mesh_of_kind(mesh: MeshLike, kinds: tuple[str, ...], subject: str) -> Any:
    """Mesh of an argument, refused where it is not of one of the kinds.

    Parameters
    ----------
    mesh : see `as_mesh`
    kinds : tuple of str
        Of KIND_CLASS.
    subject : str
        Subject of the message.
    """
    converted = as_mesh(mesh)
    if isinstance(converted, tuple(KIND_CLASS[kind] for kind in kinds)):
        return converted
    kind = next(name for name, cls in KIND_CLASS.items() if isinstance(converted, cls))
    remedy = "; pass their boundary, mesh.boundary" if kind == "tetrahedra" and "surface" in kinds else ""
    accepted = " or ".join(KIND_PHRASE[name] for name in kinds)
    raise MeshError(f"{subject} takes {accepted}, not {KIND_PHRASE[kind]}{remedy}")


def accepts_arrays(
    *kinds: str,
) -> Callable[[Callable[Concatenate[Any, P], R]], Callable[Concatenate[MeshLike, P], R]]:
    """Decorator: convert the first argument, `mesh`, by `as_mesh`, and refuse meshes of other kinds.

    The other arguments are checked by `checked_arguments`.

    Parameters
    ----------
    *kinds : str
        Of KIND_CLASS.
    """

    def decorate(function: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[MeshLike, P], R]:
        checked = checked_arguments(function)

        @functools.wraps(function)
        def call(mesh: MeshLike, *args: P.args, **kwargs: P.kwargs) -> R:
            return checked(mesh_of_kind(mesh, kinds, function.__name__), *args, **kwargs)

        return call

    return decorate
