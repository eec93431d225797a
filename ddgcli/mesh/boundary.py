"""Boundary loops of oriented manifold surfaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import Topology


def boundary_vertex_loops(topology: Topology) -> list[NDArray[np.int64]]:
    """Vertices of each boundary loop of an oriented manifold surface.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    list of (k,) ndarray of int64
        Each loop from its lowest vertex, in the direction of the sides of its faces (the surface on the
        left).
    """
    side = np.flatnonzero(topology.side_twin.ravel() < 0)
    following = dict(zip(topology.side_tail[side].tolist(), topology.side_head[side].tolist()))
    loops = []
    while following:
        start = min(following)
        loop, vertex = [start], following.pop(start)
        while vertex != start:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(np.array(loop))
    return loops
