"""Newton's method through large rotations, with the stress as an independent unknown (mixed Newton).

A finite move along a linearised rotation stretches the elements, and a Hessian with this spurious stress
allows only short moves. With the stress linearised in the move, moves can be long. D. Magisano, L. Leonetti,
G. Garcea, "How to improve efficiency and robustness of the Newton method in geometrically non-linear
structural problem discretized via displacement-based finite elements", 2017.
"""

from __future__ import annotations

import copy

import numpy as np

from ddgcli.errors import SolveError
from ddgcli.linalg.factor import negative_eigenvalues
from ddgcli.mechanics.hessian import total_hessian
from ddgcli.mechanics.increment import Increment, Point
from ddgcli.mechanics.objective import Objective
from ddgcli.mechanics.terms import Mode

MAX_TURNING_MOVES = 40
MAX_TURNING_MOVE = 0.3  # longest move over the object's size
END_OF_TURN = 1e-5  # move over the object's size below which ordinary Newton moves suffice
SHIFT_RATIO = 0.1  # factor on the shift in each move


def turned(objective: Objective, start: Point, shift: float) -> tuple[Point | None, int]:
    """A point of lower energy near an equilibrium, reached by long moves through rotations.

    Parameters
    ----------
    objective : Objective
    start : Point
    shift : float
        Multiple of the masses that is added to the Hessian of the first move; it decreases from move to move.

    Returns
    -------
    Point or None
        None if the moves do not converge, or increase the energy, and with contact or a gas.
    int
        Number of moves.
    """
    system, increment = objective.system, Increment(0.0, start.y)
    solver = objective.solver(increment)
    linearisable = any(p.linearised is not None for p in system.potentials)
    if not linearisable or system.barriers or solver.by_blocks or objective.columns(start.y) is not None:
        return None, 0
    y, assumed = start.y, copy.copy(system)
    mode: Mode = "projected"  # the stress at the start may be spurious, from earlier moves
    for count in range(1, MAX_TURNING_MOVES + 1):
        matrix = total_hessian(assumed, increment, solver.assembly, y, mode, shift)
        with system.account.within("solver"):
            definite = mode == "projected" or negative_eigenvalues(matrix) == 0
        if not definite:
            matrix = total_hessian(assumed, increment, solver.assembly, y, "projected", shift)
        mode = "exact"
        with system.account.within("solver"):
            try:
                solver.factorise(system, matrix, y, None)
                move = objective.scatter(solver.solve(objective.gather(-objective.gradient(increment, y))))
            except SolveError:
                return None, count
        size = float(np.abs(move).max())
        if not np.isfinite(size):
            return None, count
        move *= min(1.0, MAX_TURNING_MOVE * system.size / size) if size > 0 else 1.0
        assumed.potentials = [p if p.linearised is None else p.linearised(y, move) for p in system.potentials]
        y, shift = y + move, SHIFT_RATIO * shift
        if size <= END_OF_TURN * system.size:
            end = objective.at(increment, y)
            return (end if end.value < start.value else None), count
    return None, MAX_TURNING_MOVES
