"""Linear systems of Newton's method: by a factorisation, or by conjugate gradients if factors do not fit."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.linalg import low_rank
from ddgcli.linalg.backends import direct_solver, displacement_solver
from ddgcli.linalg.factor import Factor
from ddgcli.mechanics.assembly import Assembly
from ddgcli.mechanics.system import LINEAR_SOLVER, System
from ddgcli.mesh.vectors import row_cross


class HessianSolver:
    """Solver of linear systems with positive definite Hessians of one assembly.

    The kind of solver is chosen once, from the pattern, before a matrix is assembled. Conjugate gradients
    only reduce the error by a factor (`linalg.displacements`), because Newton's method corrects the rest.

    Attributes
    ----------
    assembly : Assembly
    error : float
        Largest expected error of a solution, relative to its largest entry.
    """

    def __init__(self, assembly: Assembly) -> None:
        self.assembly = assembly
        self._factor: Factor | None = None
        self._solve: low_rank.Operator | None = None  # with the low-rank term
        name = displacement_solver(assembly.graph, 3)
        self._iterative: Any = None
        if name:
            from ddgcli.linalg.displacements import BlockIterative  # few runs need it

            self._iterative = BlockIterative(name)
        self.error = 10 * self._iterative.reduction if name else 0.0

    @property
    def iterative(self) -> str | None:
        """Name of the iterative solver; None if the matrices are factorised."""
        return self._iterative.name if self._iterative else None

    @property
    def by_blocks(self) -> bool:
        """Whether matrices with (3, 3) blocks are preferred."""
        return self._iterative is not None

    def release(self) -> None:
        """Free the memory of the last iterative solver, before the next matrix is assembled."""
        if self._iterative:
            self._solve = None
            self._iterative.release()

    def factorise(self, system: System, matrix: Any, y: NDArray, columns: NDArray | None) -> None:
        """Prepare solves with a matrix plus U U^T, where `columns` are U and `y` (n, 3) the positions.

        Raises
        ------
        SolveError
            If the factorisation detects that the matrix is not positive definite.
        """
        if self._iterative:
            from ddgcli.linalg.displacements import RigidMotions

            motions = RigidMotions(self._rigid_motions(y), self.assembly.by_vertex)
            self._iterative.prepare(matrix, motions)
            system.cache[LINEAR_SOLVER] = self._iterative
            self._solve = low_rank.solver(self._iterative.solve, columns)
            return
        if self._factor is None:
            self._factor = Factor(matrix, pivot=False, solver=direct_solver(matrix))
            if not self._factor.repeats:  # results must not depend on where a run was resumed
                self._factor.refactor(matrix)
        else:
            self._factor.refactor(matrix)
        self._solve = low_rank.solver(partial(self._factor.solve, refine=False), columns)

    def solve(self, rhs: NDArray) -> NDArray[np.float64]:
        """Solution with the last matrix; SolveError where conjugate gradients do not converge."""
        return self._solve(rhs)  # type: ignore[misc]

    def _rigid_motions(self, y: NDArray) -> NDArray[np.float64]:
        """Columns over the unknowns: translations, rotations, and 1 at internal unknowns if there are any."""
        from_middle, motion = y - y.mean(axis=0), np.empty_like(y)
        modes = np.empty((self.assembly.size, 6))
        for axis in range(3):
            motion[:] = np.eye(3)[axis]
            modes[:, axis] = self.assembly.gather(motion)
            modes[:, 3 + axis] = self.assembly.gather(row_cross(np.eye(3)[axis], from_middle))
        internal = self.assembly.internal
        if internal:
            own = np.zeros((len(modes), 1))
            own[-internal:] = 1.0
            modes = np.hstack([modes, own])
        return modes
