"""Backward Euler step of mean curvature flow: of `smooth`, and of the flow in time of `models.willmore`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from ddgcli.linalg.constrain import Dirichlet
from ddgcli.mesh.triangle_mesh import TriangleMesh

MIN_MASS = 1e-8  # of a row of M/dt, beside weights of L of about 1


class ImplicitStep:
    """Steps (M/dt + L) x' = M/dt x of one connectivity, which share the analysis of their matrices.

    Parameters
    ----------
    fixed : (n,) ndarray of bool
        Vertices that stay.
    centre : (3,) ndarray, optional
        Origin of the positions in the solves; default 0.

    Notes
    -----
    G. Dziuk, "An algorithm for evolutionary surfaces", 1990. The area never grows.
    """

    def __init__(self, fixed: NDArray[np.bool_], centre: NDArray | None = None) -> None:
        self.fixed = fixed
        self.centre = np.zeros(3) if centre is None else centre
        self._problem: Dirichlet | None = None

    def step(self, mesh: TriangleMesh, stiffness: csr_array, mass: csr_array) -> tuple[TriangleMesh, float]:
        """Surface after a step, and the relative residual of its system.

        Parameters
        ----------
        mesh : TriangleMesh
        stiffness : (n, n) csr_array
            L.
        mass : (n, n) csr_array
            M/dt, of which vertices that move get at least MIN_MASS.

        Returns
        -------
        TriangleMesh, float

        Raises
        ------
        SolveError
        """
        lack = np.maximum(MIN_MASS - mass @ np.ones(mesh.n_vertices), 0.0)
        lack[self.fixed] = 0.0
        mass = mass + diags_array(lack, format="csr")
        if self._problem is None:
            self._problem = Dirichlet(mass + stiffness, self.fixed, pivot=False)
        else:
            self._problem.refactor(mass + stiffness)
        points = mesh.points - self.centre
        rhs = mass @ points
        moved = self._problem.solve(points[self._problem.fixed], rhs)
        positions = np.where(self.fixed[:, None], mesh.points, moved + self.centre)
        return mesh.moved_unchecked(positions), self._problem.residual(moved, rhs)
