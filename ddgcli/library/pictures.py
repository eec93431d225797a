"""Pictures of meshes, arrays and curves."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.errors import OutputError, ParameterError, named_array
from ddgcli.io.output_file import atomic_output
from ddgcli.library.arguments import checked_arguments
from ddgcli.library.mesh_arguments import MeshLike, as_mesh
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.plots.array import draw_array
from ddgcli.plots.curve import draw_curves
from ddgcli.plots.page import FORMATS, size_in_inches
from ddgcli.plots.raster import VIEWS
from ddgcli.plots.viewpoint import curve_interest

__all__ = ["write_picture"]


@checked_arguments
def write_picture(
    path: str | os.PathLike[str],
    mesh: MeshLike,
    values: str | ArrayLike | None = None,
    *,
    name: str = "",
    curves: Sequence[ArrayLike] = (),
    view: str | tuple[float, float] | None = None,
    up: Literal["x", "y", "z"] | None = None,
    edges: bool = False,
    size: tuple[int, int] = (1400, 1050),
) -> None:
    """Write a picture of a surface or of curves, coloured by an array.

    Parameters
    ----------
    path : str or path
        `.png`, `.svg` or `.pdf`.
    mesh : mesh, (points, cells) pair, or object with a mesh and arrays
        Of tetrahedra the boundary is drawn. Curves are drawn alone, in colours of numbers on their vertices.
    values : str or array_like, optional
        Name of a vertex or face array of `mesh`, such as "mean_curvature" of a Measurement; or (n,) or (m,)
        numbers, (n, 2) flat coordinates or (n, 3) or (m, 3) vectors.
    name : str
        Label of the colour bar; by default the name of the array.
    curves : sequence of (k, 3) array_like
        Polylines on the surface, such as `shortest_paths(...).polylines`.
    view : {'x', 'y', 'z', 'iso'} or (float, float), optional
        Direction to look along, or elevation and azimuth in degrees; by default the one that shows
        most of the curves, or of large values.
    up : {'x', 'y', 'z'}, optional
        Axis that points up on the page.
    edges : bool
        Draw the sides of the faces.
    size : (int, int)
        Width and height in pixels.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    OutputError
        For another extension, or a path that cannot be written.
    ParameterError
        For an array that the mesh does not have, or of another length; for `curves` or `edges` on curves.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ddg.write_picture("torus.png", ddg.curvature(ddg.torus(24, 12)), "mean_curvature")
    """
    if os.path.splitext(path)[1].lower() not in FORMATS:
        raise OutputError(f"{os.fspath(path)}: pictures are {', '.join(FORMATS)}")
    if isinstance(view, str) and view not in VIEWS:
        raise ParameterError(f"{view!r} is not one of {', '.join(VIEWS)}", parameter="view")
    if up not in (None, "x", "y", "z"):
        raise ParameterError(f"{up!r} is not one of x, y, z", parameter="up")
    shape = as_mesh(mesh)
    shape = shape.boundary if isinstance(shape, TetMesh) else shape
    array = _array_of(mesh, values)
    look: dict[str, Any] = {"view": view, "up": up, **size_in_inches(size)}
    label = name or (values if isinstance(values, str) else "")
    with atomic_output(os.fspath(path)) as target:
        if isinstance(shape, CurveSet):
            if len(curves) or edges:
                raise ParameterError(
                    "consists of curves, and `curves` and `edges` are drawn on a surface", parameter="mesh"
                )
            _draw_curve_set(target, shape, array, label, look)
            return
        if not isinstance(shape, TriangleMesh):
            raise ParameterError(
                "is an intrinsic triangulation and has no positions; draw its input mesh",
                parameter="mesh",
            )
        _check_length(array, (shape.n_vertices, shape.n_faces))
        if len(curves):
            look["interest"] = curve_interest(
                shape, [np.asarray(curve, dtype=np.float64) for curve in curves]
            )
        draw_array(target, shape, label, array, curves=curves, edges=edges, **look)


def _draw_curve_set(
    target: str, shape: CurveSet, array: NDArray | None, label: str, look: dict[str, Any]
) -> None:
    _check_length(array, (shape.n_vertices,))
    if array is not None and array.ndim > 1:
        raise ParameterError(f"has shape {array.shape}; curves are coloured by numbers", parameter="values")
    paths = shape.paths
    draw_curves(
        target, [shape.points[vertices] for vertices, _ in paths],
        None if array is None else [array[vertices] for vertices, _ in paths],
        closed=[is_closed for _, is_closed in paths], label=label, **look,
    )  # fmt: skip


def _array_of(mesh: Any, values: str | ArrayLike | None) -> NDArray | None:
    """The array itself, or the array of that name of the object."""
    if values is None:
        return None
    if isinstance(values, str):
        arrays = {**getattr(mesh, "face", {}), **getattr(mesh, "vertex", {})}
        return np.asarray(named_array(arrays, values, parameter="values"), dtype=np.float64)
    return np.asarray(values, dtype=np.float64)


def _check_length(array: NDArray | None, lengths: tuple[int, ...]) -> None:
    if array is not None and (array.ndim == 0 or len(array) not in lengths):
        counts = " or ".join(map(str, lengths))
        raise ParameterError(f"has shape {array.shape}; it needs {counts} entries", parameter="values")
