"""Faces turned to agree with their neighbours, where that can be done."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ddgcli.mesh.topology import Topology


@dataclass(frozen=True, eq=False)
class Orientation:
    """Which faces to turn over.

    Parameters
    ----------
    turn : (m,) ndarray of bool
        The fewer faces of each component joined across edges; none where a component is one-sided.
    orientable : bool
    """

    turn: NDArray[np.bool_]
    orientable: bool


def orientation(topology: Topology) -> Orientation:
    """Two copies of every face, one turned: neighbours that agree join like copies, others unlike ones.

    A component of faces is one-sided when a face is joined to its own other copy.
    """
    m = topology.n_faces
    twin = topology.side_twin.ravel()
    side = np.flatnonzero((twin >= 0) & (np.arange(len(twin)) < twin))
    a, b = side // 3, twin[side] // 3
    sign = topology.side_sign.ravel()
    unlike = (sign[side] == sign[twin[side]]).astype(np.int64)
    rows = np.concatenate([a, a + m])
    cols = np.concatenate([b + m * unlike, b + m * (1 - unlike)])
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, cols)), shape=(2 * m, 2 * m))
    label = connected_components(graph, directed=False)[1]
    as_is, turned = label[:m], label[m:]
    one_sided = as_is == turned
    # each two-sided component appears twice; the copy that keeps the more faces is taken
    kept = np.bincount(as_is, minlength=label.max(initial=0) + 1)
    turn = ~one_sided & (kept[turned] > kept[as_is])
    tie = ~one_sided & (kept[turned] == kept[as_is])
    turn |= tie & (turned < as_is)
    return Orientation(turn, not bool(one_sided.any()))
