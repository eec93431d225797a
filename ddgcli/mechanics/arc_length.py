"""Arc-length method: equilibrium paths through limit points, with the load factor as an unknown.

M. A. Crisfield, "A fast incremental/iterative solution procedure that handles snap-through", 1981: positions
and load factor are corrected together until forces balance and the step from the last equilibrium has the
given length. The time of a motion is the load factor times the duration of the run.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError, SolveError
from ddgcli.linalg.factor import Factor
from ddgcli.mechanics.increment import Increment, worst_vertex
from ddgcli.mechanics.objective import MOVE_TOLERANCE, Objective
from ddgcli.mechanics.system import Motion, System
from ddgcli.simulation.model import StepRejected

MAX_CORRECTIONS = 25


def arc_step(system: System, motion: Motion, dt: float, parameters: Any) -> Motion:
    """Next equilibrium on the load path; at load factor 1 exactly if the step would pass it.

    Parameters
    ----------
    system : System
    motion : Motion
        The last equilibrium.
    dt : float
        Step in s, which sets the arc length.
    parameters : object
        Section [time] of the scene, with `duration`, `arc_length` and `load_steps`.

    Returns
    -------
    Motion
        At rest at the next equilibrium.

    Raises
    ------
    StepRejected
        If it does not converge; a shorter step may converge.
    """
    if system.prescribed:
        raise ParameterError("arc_length follows loads, and a handle moves in time; leave one of them out")
    duration = float(parameters.duration)
    length = float(parameters.arc_length) * dt * parameters.load_steps / duration
    before = None if not motion.past[2][0] > 0 else motion.x - motion.past[0]
    path = _Path(system, motion.x, duration, length)
    x, time, count = path.corrected(*path.predicted(motion.time, before))
    if time >= duration > motion.time:
        x, more = path.at_load(x, duration)
        time, count = duration, count + more
    still = np.zeros_like(x)
    return Motion(x, still, still, motion.newton + count, time=time)


class _Path:
    """Equations of one step from an equilibrium `x`."""

    def __init__(self, system: System, x: NDArray, duration: float, length: float) -> None:
        self.system, self.x, self.duration = system, x, duration
        self.weight = system.only_free(np.repeat(system.mass[:, None], 3, axis=1)) / system.mass.sum()
        self.length = length

    def _moves(self, y: NDArray, time: float) -> tuple[NDArray, NDArray, NDArray]:
        """Newton's move at fixed load, the move per second of load, and the gradient."""
        here = self.system.at(time)
        gradient = here.gradient(y)
        rate = (self.system.at(time + self.duration).gradient(y) - gradient) / self.duration
        objective = Objective(here)
        matrix = objective.hessian(Increment(0.0, y), y, "exact")
        rhs = np.stack([objective.gather(-gradient), objective.gather(-rate)], axis=1)
        if not rhs[:, 1].any():
            raise ParameterError("arc_length needs a load: no load of the scene acts on a free vertex")
        with self.system.account.within("solver"):
            try:
                moves = Factor(matrix).solve(rhs)
            except SolveError as error:
                raise StepRejected("singular", worst_vertex(gradient)) from error
        return objective.scatter(moves[:, 0]), objective.scatter(moves[:, 1]), gradient

    def _product(self, a: NDArray, b: NDArray) -> float:
        return float(np.sum(self.weight * a * b))

    def predicted(self, time: float, before: NDArray | None) -> tuple[NDArray, float]:
        """Positions and time after a tangent step that continues the last step, or increases the load."""
        _, tangent, _ = self._moves(self.x, time)
        scale = self.length / np.sqrt(self._product(tangent, tangent))
        if before is not None and self._product(tangent, before) < 0:
            scale = -scale
        return self.x + scale * tangent, time + scale

    def corrected(self, y: NDArray, time: float) -> tuple[NDArray, float, int]:
        """Equilibrium at the given arc length: positions, time, number of corrections."""
        tolerance = MOVE_TOLERANCE * self.system.size
        for count in range(1, MAX_CORRECTIONS + 1):
            fixed, rate, gradient = self._moves(y, time)
            away = y - self.x
            # linearised |away + fixed + s rate| = length
            slope = self._product(away, rate)
            lack = 0.5 * (self.length**2 - self._product(away, away)) - self._product(away, fixed)
            s = lack / slope if slope else np.inf
            move = fixed + s * rate
            size = float(np.abs(move).max())
            if not size <= 10 * self.system.size:
                raise StepRejected("arc length", worst_vertex(gradient), size)
            y, time = y + move, time + s
            if size <= tolerance:
                return y, time, count
        raise StepRejected("arc length", worst_vertex(gradient), size)

    def at_load(self, y: NDArray, time: float) -> tuple[NDArray, int]:
        """Equilibrium near `y` at a given time, by Newton's method, and the number of iterations."""
        tolerance = MOVE_TOLERANCE * self.system.size
        for count in range(1, MAX_CORRECTIONS + 1):
            move, _, gradient = self._moves(y, time)
            y, size = y + move, float(np.abs(move).max())
            if size <= tolerance:
                return y, count
            if not size <= 10 * self.system.size:
                break
        raise StepRejected("newton", worst_vertex(gradient), size)
