"""Implicit steps of linear systems: one solve with a matrix that never changes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array

from ddgcli.linalg.factor import Factor
from ddgcli.mechanics.system import System

MAX_MATRICES = 8  # factorisations that are kept, of steps of different lengths


class ConstantMatrices:
    """Factorisations of the masses plus the matrices of the potentials, which are quadratic axis by axis."""

    def __init__(self) -> None:
        self._factors: dict[float, Factor] = {}

    def solve(self, system: System, a: float, g: NDArray) -> NDArray[np.float64]:
        """(n, 3) solution for a right-hand side g with a times the masses; 0 where held."""
        rows = system.free[:, 0]
        if a not in self._factors:
            if len(self._factors) >= MAX_MATRICES:
                self._factors.clear()
            whole = diags_array(a * system.mass).tocsr()
            for potential in system.potentials:
                if len(potential.stencil):
                    whole = whole + potential.matrix  # type: ignore[attr-defined]
            self._factors[a] = Factor(csc_array(whole[rows][:, rows]))
        x = np.zeros_like(g)
        x[rows] = self._factors[a].solve(g[rows])
        return x
