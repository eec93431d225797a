"""Limit of stretch that ends a run: no material stretches further."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import SolveError
from ddgcli.mechanics.system import System
from ddgcli.mechanics.terms import PlasticMemory
from ddgcli.mesh.vectors import vector_length
from ddgcli.models.shell.groups import Group

MAX_STRETCH = 100.0  # length of an edge over its rest length; rubber breaks at 10


def has_stretch_limit(system: System) -> bool:
    """Whether the limit applies: `stretching`, a law of small strains, resists, and nothing is plastic.

    Parameters
    ----------
    system : System

    Returns
    -------
    bool
    """
    resisted = any(potential.name == "stretching" for potential in system.potentials)
    return resisted and not any(isinstance(term, PlasticMemory) for term in system.memories)


class StretchLimit:
    """End a run when an edge is longer than MAX_STRETCH times its rest length.

    Laws of small strains are invalid there, and steps become shorter and shorter. The lengths are computed
    again only when a vertex has moved by half the smallest margin below the limits, so that most steps cost
    only one difference of positions.

    Parameters
    ----------
    group : Group
    """

    def __init__(self, group: Group) -> None:
        edges = {name: rows[context.mesh.topology.edges] for name, (context, rows) in group.rows().items()}
        self.tail, self.head = np.concatenate(list(edges.values())).T
        self.names = np.repeat(list(edges), [len(rows) for rows in edges.values()])
        self.checked = np.concatenate([np.asarray(context.mesh.points) for context in group.shells.values()])
        self.max_length = MAX_STRETCH * self._lengths(self.checked)
        self.allowed_move = 0.0  # move of a vertex from `checked` up to which no check is needed

    def _lengths(self, x: NDArray) -> NDArray[np.float64]:
        return vector_length(x[self.head] - x[self.tail])

    def check(self, x: NDArray, time: float) -> None:
        """Raise an error, which names the shell, if an edge is too long.

        Parameters
        ----------
        x : (n, 3) ndarray
            Positions in m.
        time : float
            In s.

        Raises
        ------
        SolveError
        """
        if np.sqrt(3.0) * np.abs(x - self.checked).max() <= self.allowed_move:
            return
        length = self._lengths(x)
        worst = int(np.argmax(length / self.max_length))
        if length[worst] > self.max_length[worst]:
            stretch = MAX_STRETCH * length[worst] / self.max_length[worst]
            raise SolveError(
                f"t = {time:.6g} s, object {self.names[worst]}: an edge is {stretch:.3g} times as long as at "
                "rest, which no material bears; lessen the loads, velocities and motions of handles, or take "
                "a stiffer one"
            )
        self.checked, self.allowed_move = x, 0.5 * float((self.max_length - length).min())
