"""A mesh with named arrays, checks of a user's arrays, and a frame of a trajectory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.errors import ParameterError, counted
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_matrix
from ddgcli.representation import short_repr

AnyMesh = TriangleMesh | TetMesh | IntrinsicMesh | CurveSet


@dataclass(frozen=True, eq=False)
class AnnotatedMesh:
    """A mesh and its named arrays; files use the same names.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh, IntrinsicMesh or CurveSet
    vertex, face, edge : dict of str to ndarray
        Arrays of leading length n, m (cells, for tetrahedra) and e (`topology.edges` order).
    whole : dict of str to ndarray
        Arrays that belong to the whole mesh.
    metadata : dict of str to str
        Provenance: command line, version, input and its SHA-256, options.
    """

    mesh: AnyMesh
    vertex: dict[str, NDArray] = field(default_factory=dict)
    face: dict[str, NDArray] = field(default_factory=dict)
    edge: dict[str, NDArray] = field(default_factory=dict)
    whole: dict[str, NDArray] = field(default_factory=dict)
    metadata: dict[str, Any] = field(default_factory=dict)

    __repr__ = short_repr


def surface_arrays(mesh: AnyMesh, face: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Arrays on the faces of a surface; on the boundary of tetrahedra, whose faces have those of their cells.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh, IntrinsicMesh or CurveSet
    face : mapping of str to (m, ...) ndarray
        Arrays on the faces or cells.

    Returns
    -------
    dict of str to (f, ...) ndarray
        In the order of `mesh.faces`, or of `mesh.boundary.faces`; empty for curves.
    """
    if isinstance(mesh, CurveSet):
        return {}
    if isinstance(mesh, TetMesh):
        return {name: values[mesh.boundary_cell] for name, values in face.items()}
    return dict(face)


def finite_values(
    values: ArrayLike, place: str, *, parameter: str | None = None, what: str = ""
) -> NDArray[np.float64]:
    """Convert a user's array to double precision, or raise an error for its first element that is not finite.

    Parameters
    ----------
    values : (k, ...) array_like
    place : str
        Kind of the elements, for the message.
    parameter : str, optional
        Parameter that holds the array, for messages.
    what : str
        Name of the array, for messages about parameters with several arrays.

    Returns
    -------
    (k, ...) ndarray of float64

    Raises
    ------
    ParameterError
    """
    array = np.asarray(values, dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(row_matrix(np.atleast_1d(array))).all(axis=1))
    if len(bad):
        subject = f"{what} is not" if what else "not"
        count = counted(len(bad), "such value", "such values")
        raise ParameterError(
            f"{subject} finite at {place} {bad[0]} ({count}); correct the array", parameter=parameter
        )
    return array


def checked_values(
    values: ArrayLike, count: int, place: str, *, parameter: str, widths: Sequence[int] = ()
) -> NDArray[np.float64]:
    """Convert a user's array with a number or a row of numbers for each element to double precision.

    Parameters
    ----------
    values : (count,) or (count, c) array_like
    count : int
        Elements of the mesh.
    place : str
        Kind of the elements, for messages.
    parameter : str
        Parameter that holds the array, for messages.
    widths : sequence of int, optional
        Lengths that rows may have, 1 for numbers. Default: any.

    Returns
    -------
    ndarray of float64
        Has the shape of `values`.

    Raises
    ------
    ParameterError
        For another shape, or values that are not finite.
    """
    shape = np.shape(values)
    width = shape[1] if len(shape) == 2 else 1
    if shape[:1] != (count,) or len(shape) > 2 or (widths and width not in widths):
        numbers = "one number, or a row of numbers," if not widths else "one number"
        if max(widths, default=1) > 1:
            numbers = f"{' or '.join(map(str, widths))} numbers"
        places = "vertices" if place == "vertex" else f"{place}s"
        raise ParameterError(
            f"an array of shape {shape}; use {numbers} for each of {count} {places}", parameter=parameter
        )
    return finite_values(values, place, parameter=parameter)


@dataclass(frozen=True, eq=False)
class TrajectoryFrame:
    """One frame of a trajectory.

    Parameters
    ----------
    step : int
    time : float
        Seconds.
    points : (n, 3) ndarray, or None where the surface does not move
    vertex : dict of str to ndarray
    scalar : dict of str to float
        Energies, momenta, step size, iterations, residuals.
    faces : (m, 3) ndarray of int, optional
        Of this frame, where they change during the run.
    face : dict of str to (m, ...) ndarray
    """

    step: int
    time: float
    points: NDArray | None
    vertex: dict[str, NDArray] = field(default_factory=dict)
    scalar: dict[str, float] = field(default_factory=dict)
    faces: NDArray | None = None
    face: dict[str, NDArray] = field(default_factory=dict)

    __repr__ = short_repr


def frames_of_equal_change(
    positions: Sequence[NDArray | None], values: Sequence[NDArray | None], count: int
) -> list[int]:
    """Indices of frames between which a motion changes by equal amounts.

    The change of a step is the root mean square of the displacements over the extent, and that of the values
    over their range.

    Parameters
    ----------
    positions, values : sequence of ndarray or None
        One entry per frame, None for a frame without positions or values.
    count : int
        How many to choose, at least 2.

    Returns
    -------
    list of int
        Ascending, at most `count`; the first and the last frame are included.
    """
    n = len(positions)
    if n <= count:
        return list(range(n))
    change = np.zeros(n - 1)
    for states in (positions, values):
        arrays = [np.nan_to_num(np.asarray(state, dtype=np.float64)) for state in states if state is not None]
        if len(arrays) < n or any(state.shape != arrays[0].shape for state in arrays):
            continue
        step = np.array([np.sqrt(np.mean((b - a) ** 2)) for a, b in zip(arrays, arrays[1:])])
        reach = max(float(state.max(initial=0.0) - state.min(initial=0.0)) for state in arrays)
        change += step / (reach or 1.0)
    total = np.concatenate([[0.0], np.cumsum(change)])
    if total[-1] <= 0:
        return [int(k) for k in np.linspace(0, n - 1, count).round()]
    inner_frames = np.searchsorted(total, total[-1] * np.arange(1, count - 1) / (count - 1))
    return sorted({0, n - 1, *(int(k) for k in inner_frames)})
