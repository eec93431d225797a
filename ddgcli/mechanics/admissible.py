"""Admissible positions and moves: they cross no barrier, and prescribed vertices have their positions."""

from __future__ import annotations

from numpy.typing import NDArray

from ddgcli.mechanics.increment import worst_vertex
from ddgcli.mechanics.system import System
from ddgcli.simulation.model import StepRejected


def collision_free_fraction(system: System, y: NDArray, move: NDArray) -> float:
    """Largest fraction of a move that crosses no barrier.

    Parameters
    ----------
    system : System
    y, move : (n, 3) ndarray of float64

    Returns
    -------
    float
        In (0, 1].
    """
    t = 1.0
    for barrier in system.barriers:
        with system.account.within(barrier.name):
            t = min(t, barrier.collision_free_fraction(y, move))
    return t


def admissible_start(system: System, x: NDArray, since: float) -> NDArray:
    """Initial positions of a step that are admissible for the barriers and prescribed vertices at its end.

    Vertices near moving obstacles are displaced with these; prescribed vertices have their positions at the
    time of the system.

    Parameters
    ----------
    system : System
        The system at the end of the step.
    x : (n, 3) ndarray of float64
        Positions at the time `since`.
    since : float
        In s.

    Returns
    -------
    (n, 3) ndarray of float64

    Raises
    ------
    StepRejected
        If a barrier prevents a vertex from reaching its position.
    """
    return _with_prescribed(system, _moved_with_obstacles(system, x, since))


def _moved_with_obstacles(system: System, x: NDArray, since: float) -> NDArray:
    moving = [barrier for barrier in system.barriers if barrier.carried is not None]
    for barrier in moving:
        with system.account.within(barrier.name):
            moved = barrier.carried(x, since)
        if moved is None:
            raise StepRejected("barrier crossed")
        move = system.only_free(moved - x)
        if move.any():
            for other in system.barriers:
                if other not in moving and other.collision_free_fraction(x, move) < 1.0:
                    raise StepRejected("barrier crossed", worst_vertex(move))
            x = x + move
    for barrier in moving:
        crossed = barrier.outside(x)
        if crossed is not None:
            raise StepRejected("barrier crossed", f"vertex {crossed[0]}", crossed[1])
    return x


def _with_prescribed(system: System, x: NDArray) -> NDArray:
    moved = system.prescribed_state(x, x, x)[0]
    if moved is not x and collision_free_fraction(system, x, moved - x) < 1.0:
        raise StepRejected("barrier crossed", worst_vertex(moved - x))
    return moved
