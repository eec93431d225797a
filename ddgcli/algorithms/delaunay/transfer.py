"""Vertex functions carried between an input and its intrinsic triangulation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.algorithms.delaunay.common_subdivision import CommonSubdivision
from ddgcli.errors import ParameterError
from ddgcli.linalg.factor import Factor
from ddgcli.operators.laplacian import galerkin_mass


def transfer(cut: CommonSubdivision, values: NDArray, *, to: str) -> NDArray[np.float64]:
    """The vertex values whose interpolant is nearest in L2 to that of the values on the other triangulation.

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
    of the function over the surface is kept. After Gillespie, Sharp, Crane 2021, section 6.
    """
    if to not in ("intrinsic", "input"):
        raise ParameterError(f"functions go to 'intrinsic' or to 'input', found {to!r}")
    given, wanted = cut.from_input, cut.from_intrinsic
    if to == "input":
        given, wanted = wanted, given
    mass = galerkin_mass(cut.mesh)
    normal = csr_array(wanted.T @ mass @ wanted)
    rhs = wanted.T @ (mass @ (given @ np.asarray(values, dtype=np.float64)))
    used = np.flatnonzero(normal.diagonal() > 0)
    carried = np.zeros((wanted.shape[1], *rhs.shape[1:]))
    carried[used] = Factor(normal[used][:, used]).solve(rhs[used])
    return carried
