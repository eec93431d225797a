"""The registry of effects: a table of names; a module is imported only when a scene names its effect."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from ddgcli.errors import SceneError


@dataclass(frozen=True)
class Effect:
    """Description of an effect, the `EFFECT` of its module.

    Parameters
    ----------
    name : str
        Its key under [effects].
    parameters : type
        A `Section`: the keys it takes, with units, defaults and one line each.
    build : callable
        `build(parameters, context)` returns terms for the models; the types of `context` and of the terms
        depend on the simulator (docs/effects.md).
    cost : str
        Cost of a step, in one line.
    roles : tuple of str
        Roles of the objects that it acts on; a scene without such an object is an error.
    repeatable : bool
        Whether `[[effects.NAME]]` may occur several times.
    acts_on_all : bool
        Whether the effect acts on every object of its roles if the scene has several and its key `object`
        is missing; otherwise such a scene is an error.
    pairs : callable, optional
        `pairs(parameters)`: names of objects that the effect couples, which then move as one system.
    between : callable, optional
        `between(parameters, contexts)` returns terms that act between the objects of such a system.
    """

    name: str
    parameters: type
    build: Callable[[Any, Any], Any]
    cost: str
    roles: tuple[str, ...]
    repeatable: bool = False
    acts_on_all: bool = False
    pairs: Callable[[Any], list[tuple[str, str]]] | None = None
    between: Callable[[Any, Any], list[Any]] | None = None


@dataclass(frozen=True)
class EffectTable:
    """Effects of one simulator: name -> (module, one line).

    Parameters
    ----------
    command : str
    entries : dict of str to (str, str)
    """

    command: str
    entries: dict[str, tuple[str, str]]

    def __iter__(self) -> Iterator[str]:
        return iter(self.entries)

    def load(self, name: str) -> Effect:
        """Import the effect's module and return its `EFFECT`; SceneError names the nearest effect."""
        if name not in self.entries:
            raise SceneError(self.unknown(name))
        return importlib.import_module(self.entries[name][0]).EFFECT

    def unknown(self, name: str) -> str:
        """Message for an effect that is not in the table."""
        hint = nearest(name, list(self.entries))
        return f"no effect {name!r}{hint}; {self.command} has {', '.join(self.entries)}"


def nearest(name: str, names: list[str]) -> str:
    """Suggestion of a similar name, for error messages.

    Parameters
    ----------
    name : str
    names : list of str

    Returns
    -------
    str
        Such as `; did you mean 'x'?`; empty without a similar name.
    """
    near = difflib.get_close_matches(name, names, 1, cutoff=0.55)
    return f"; did you mean {near[0]!r}?" if near else ""
