"""Transfer of vertex functions between an input and its intrinsic triangulation."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.algorithms.delaunay.common_subdivision import CommonSubdivision
from ddgcli.errors import ParameterError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.fields import finite_values
from ddgcli.mesh.vectors import row_matrix
from ddgcli.operators.laplacian import galerkin_mass, lumped_vertex_area


def transfer(cut: CommonSubdivision, values: NDArray, *, to: str) -> NDArray[np.float64]:
    """Vertex values whose interpolant is nearest in L2 to the interpolant on the other triangulation.

    Parameters
    ----------
    cut : CommonSubdivision
    values : (n,) or (n, k) ndarray
        On the vertices of the input (`to="intrinsic"`) or of the intrinsic triangulation (`to="input"`).
    to : {'intrinsic', 'input'}

    Returns
    -------
    ndarray
        Values on the vertices of the other triangulation; 0 at vertices that no face uses.

    Notes
    -----
    Both interpolants are linear on the triangles of the subdivision, so the integrals are exact. The integral
    of the function over the surface is preserved. After Gillespie, Sharp, Crane 2021, section 6.
    """
    if to not in ("intrinsic", "input"):
        raise ParameterError(f"{to!r} is not one of intrinsic, input", parameter="to")
    source, target = cut.from_input, cut.from_intrinsic
    if to == "input":
        source, target = target, source
    mass = galerkin_mass(cut.mesh)
    normal = csr_array(target.T @ mass @ target)
    rhs = target.T @ (mass @ (source @ np.asarray(values, dtype=np.float64)))
    vertices = np.flatnonzero(normal.diagonal() > 0)
    result = np.zeros((target.shape[1], *rhs.shape[1:]))
    result[vertices] = Factor(normal[vertices][:, vertices]).solve(rhs[vertices])
    return result


@dataclass(frozen=True, eq=False)
class TransferResult:
    """A function on the vertices of the input, transferred to an intrinsic triangulation.

    Parameters
    ----------
    input_values : (n, ...) ndarray
    values : (n', ...) ndarray of float64
        The values on the intrinsic vertices that are nearest in L2.
    change : float
        L2 norm of the difference of the two interpolants, relative to that of the input's.
    integral_residual : float
        Difference of the two integrals, each in the metric of its triangulation, relative to the L2 norm
        times the square root of the area; the largest over components.
    """

    input_values: NDArray
    values: NDArray[np.float64]
    change: float
    integral_residual: float


def check_transferable(arrays: dict[str, NDArray], reserved: Collection[str]) -> None:
    """Raise an error for arrays with a reserved name, and for arrays of anything but finite numbers.

    Parameters
    ----------
    arrays : dict of str to ndarray
    reserved : collection of str
        Names of arrays of the output.

    Raises
    ------
    ParameterError
    """
    for name, values in arrays.items():
        if name in reserved:
            raise ParameterError(f"the output has its own array {name!r}; rename yours", parameter="arrays")
        if values.dtype.kind not in "fiub":
            raise ParameterError(
                f"the array {name!r} has type {values.dtype}; use an array of numbers", parameter="arrays"
            )
        finite_values(values, "vertex", parameter="arrays", what=f"the array {name!r}")


def transfer_to_intrinsic(cut: CommonSubdivision, arrays: dict[str, NDArray]) -> dict[str, TransferResult]:
    """Transfer functions on the input's vertices to the intrinsic triangulation, by `transfer` in one solve.

    Parameters
    ----------
    cut : CommonSubdivision
    arrays : dict of str to (n, ...) ndarray

    Returns
    -------
    dict of str to TransferResult
        With the relative L2 change of the interpolant, and the relative change of the integral.
    """
    columns = {name: row_matrix(np.asarray(a, dtype=np.float64)) for name, a in arrays.items()}
    whole = np.concatenate(list(columns.values()), axis=1)
    transferred = transfer(cut, whole, to="intrinsic")
    bounds = np.cumsum([0, *(c.shape[1] for c in columns.values())])
    result = {}
    for (name, before), begin, end in zip(columns.items(), bounds[:-1], bounds[1:]):
        after = transferred[:, begin:end]
        size = _norm(cut, cut.from_input @ before)
        change = _norm(cut, cut.from_intrinsic @ after - cut.from_input @ before)
        difference = lumped_vertex_area(cut.intrinsic) @ after - lumped_vertex_area(cut.input) @ before
        scale = size * np.sqrt(face_area(cut.input.side_length).sum()) or 1.0
        result[name] = TransferResult(
            arrays[name],
            after.reshape(-1, *arrays[name].shape[1:]),
            change / (size or 1.0),
            float(np.abs(difference).max(initial=0.0) / scale),
        )
    return result


def _norm(cut: CommonSubdivision, values: NDArray) -> float:
    """L2 norm of the function that is linear on the pieces, from its values (v, k) at the corners."""
    a, b, c = (values[corner] for corner in cut.mesh.faces.T)
    products = a * a + b * b + c * c + a * b + b * c + c * a
    return float(np.sqrt((face_area(cut.mesh.side_length) / 6.0) @ products.sum(axis=1)))
