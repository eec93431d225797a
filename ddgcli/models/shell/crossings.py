"""Intersections of shells with themselves and each other at the end of a run without contact between them."""

from __future__ import annotations

import json
import logging
from collections import Counter
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intersections import bounded_intersections
from ddgcli.mechanics.system import System
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.groups import Order
from ddgcli.scenes.scene import Scene
from ddgcli.simulation.frames import joined_mesh
from ddgcli.simulation.outcome import Outcome

Pair = tuple[str, str]  # names of two shells in order, or twice that of one
MAX_LISTED = 3  # pairs of shells in a warning
# depth over the extent of the shells above which faces cross; rounding alone makes touching faces cross less
LEAST_DEPTH = 1e-6
log = logging.getLogger("ddgcli")


def crossings(
    outcome: Outcome, shells: dict[str, ShellContext], systems: dict[str, System], order: Order
) -> dict[str, int | None]:
    """Count pairs of faces that cross at the end of a run; warn if shells have more than at the start.

    Shells that `contact` keeps apart do not count, and neither do faces at ties between two shells.

    Parameters
    ----------
    outcome : Outcome
    shells : dict of str to ShellContext
        At the start.
    systems : dict of str to System
        At the end.
    order : Order
        At the end.

    Returns
    -------
    dict of str to int or None
        `self_intersections`, None if unknown; empty if contact keeps all shells apart.
    """
    scene, names = next(iter(shells.values())).scene, list(shells)
    apart = _kept_apart(scene, names)
    if len(apart) == len(names) * (len(names) + 1) // 2:
        return {}
    joined, owner = joined_mesh([context.mesh for context in shells.values()])
    start = cast(TriangleMesh, joined)
    faces = np.asarray(outcome.end.faces if outcome.end.faces is not None else start.faces)
    tied = _tied_vertices(systems, order)[faces].any(axis=1)
    depth = LEAST_DEPTH * float(np.ptp(np.asarray(start.points), axis=0).max())

    def counts(points: NDArray, faces: NDArray) -> Counter[Pair] | None:
        pairs = bounded_intersections(points, faces, depth=depth)
        if pairs is None:
            return None
        numbers = np.sort(owner[pairs], axis=1)
        numbers = numbers[(numbers[:, 0] == numbers[:, 1]) | ~tied[pairs].any(axis=1)]
        kinds, sizes = np.unique(numbers, axis=0, return_counts=True)
        by_name = {(names[a], names[b]): int(size) for (a, b), size in zip(kinds, sizes)}
        return Counter({pair: size for pair, size in by_name.items() if pair not in apart})

    at_end = counts(np.asarray(outcome.end.points), faces)
    if at_end is None:
        log.warning("too many faces lie side by side at the end: whether shells cross is unknown")
        return {"self_intersections": None}
    if at_end:
        at_start = counts(np.asarray(start.points), np.asarray(start.faces)) or Counter()
        more = [pair for pair in at_end if at_end[pair] > at_start[pair]]
        if more:
            _warn(scene, more, at_end, at_start)
    return {"self_intersections": at_end.total()}


def _kept_apart(scene: Scene, names: list[str]) -> set[Pair]:
    """Pairs of shells (of one shell for self-contact) that the effect `contact` keeps apart."""
    apart: set[Pair] = set()
    for effect, parameters, _ in scene.effects:
        if effect.name == "contact":
            own = parameters.self_contact
            apart |= {(name, name) for name in names if own is True or (own and name in own)}
            for pair in parameters.pairs:
                if set(pair) <= set(names):
                    first, second = sorted(pair, key=names.index)
                    apart.add((first, second))
    return apart


def _tied_vertices(systems: dict[str, System], order: Order) -> NDArray[np.bool_]:
    """Whether each vertex is tied to another shell: at seams faces may cross, and contact is not possible."""
    owners = np.concatenate([np.full(count, name) for name, count in order])
    tied = np.zeros(len(owners), dtype=bool)
    for name, system in systems.items():
        rows = np.flatnonzero(owners == name)
        for term in system.potentials:
            if term.name == "attach":  # its module is loaded only where a scene names it
                tied[rows[term.stencil]] = True
    return tied


def _warn(scene: Scene, more: list[Pair], at_end: Counter[Pair], at_start: Counter[Pair]) -> None:
    """Warn which shells cross and how often, and name the keys of `contact` that prevent it."""
    alone = [a for a, b in more if a == b]
    different = [[a, b] for a, b in more if a != b]
    examples = [
        f"{a} with {'itself' if a == b else b} {at_end[a, b]} ({at_start[a, b]})"
        for a, b in more[:MAX_LISTED]
    ]
    further = f", and {len(more) - MAX_LISTED} more" if len(more) > MAX_LISTED else ""
    keys = []
    if alone:
        keys.append(f"self_contact = {json.dumps(alone) if len(alone) <= MAX_LISTED else 'true'}")
    if different:
        end = ", ...]" if len(different) > MAX_LISTED else "]"
        keys.append(f"pairs = {json.dumps(different[:MAX_LISTED])[:-1]}{end}")
    has_contact = scene.has_effect("contact")
    remedy = (
        f"add to contact: {' and '.join(keys)}" if has_contact else f"write contact = {{ {', '.join(keys)} }}"
    )
    log.warning(
        "shells pass through %s, which no effect of the scene prevents; pairs of faces that cross at the end "
        "(at the start): %s%s; %s",
        "themselves" if not different else "each other" if not alone else "themselves and each other",
        ", ".join(examples), further, remedy,
    )  # fmt: skip
