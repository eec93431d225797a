"""Groups of shells that effects couple: each group moves as one system."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.models.shell.context import ShellContext
from ddgcli.scenes.scene import Scene
from ddgcli.simulation.outcome import Outcome

# name of the system and number of vertices of each shell, in the order of the scene
Order = Sequence[tuple[str, int]]


@dataclass(frozen=True, eq=False)
class Group:
    """Shells of one system, their vertices one after another.

    Parameters
    ----------
    shells : dict of str to ShellContext
    shell_indices : tuple of int
        Index of each shell among all shells of the scene.
    """

    shells: dict[str, ShellContext]
    shell_indices: tuple[int, ...]

    @property
    def name(self) -> str:
        """Names of the shells, joined by +."""
        return "+".join(self.shells)

    @property
    def ends(self) -> NDArray[np.int64]:
        """First vertex of each shell, then the total number of vertices."""
        return np.cumsum([0, *(context.mesh.n_vertices for context in self.shells.values())])

    def split(self, values: NDArray) -> dict[str, NDArray]:
        """(n, ...) values, split by shell."""
        return dict(zip(self.shells, np.split(values, self.ends[1:-1])))

    def rows(self) -> dict[str, tuple[ShellContext, NDArray]]:
        """Context of each shell, and indices of its vertices in the group."""
        ends = self.ends
        return {
            name: (context, np.arange(ends[k], ends[k + 1]))
            for k, (name, context) in enumerate(self.shells.items())
        }


def groups(scene: Scene, shells: dict[str, ShellContext]) -> list[Group]:
    """Groups of coupled shells, in the order of their first shells.

    Parameters
    ----------
    scene : Scene
    shells : dict of str to ShellContext

    Returns
    -------
    list of Group
    """
    leader = {name: name for name in shells}

    def first(name: str) -> str:
        while leader[name] != name:
            name = leader[name]
        return name

    for effect, parameters, _ in scene.effects:
        for a, b in effect.pairs(parameters) if effect.pairs is not None else ():
            if a in shells and b in shells:
                leader[first(b)] = first(a)
    members: dict[str, list[str]] = {}
    for name in shells:
        members.setdefault(first(name), []).append(name)
    indices = {name: k for k, name in enumerate(shells)}
    return [
        Group({name: shells[name] for name in names}, tuple(indices[name] for name in names))
        for names in members.values()
    ]


def terms_between(scene: Scene, group: Group) -> list[Any]:
    """Terms of effects that couple the shells of a group.

    Parameters
    ----------
    scene : Scene
    group : Group

    Returns
    -------
    list
    """
    terms: list[Any] = []
    for effect, parameters, key in scene.effects:
        if effect.between is not None:
            try:
                terms += effect.between(parameters, group.rows())
            except ValueError as error:
                scene.refuse(key, f"{effect.name}: {error}")
    return terms


def points_at_end(outcome: Outcome, systems: Iterable[str], order: Order) -> dict[str, NDArray]:
    """Vertex positions of each system in the last frame, where the shells of a scene are concatenated.

    Parameters
    ----------
    outcome : Outcome
    systems : iterable of str
        Names of the systems.
    order : Order

    Returns
    -------
    dict of str to (n_k, 3) ndarray of float64
    """
    points = np.asarray(outcome.end.points)
    pieces = np.split(points, np.cumsum([count for _, count in order])[:-1])
    return {
        name: np.concatenate([piece for (owner, _), piece in zip(order, pieces) if owner == name])
        for name in systems
    }
