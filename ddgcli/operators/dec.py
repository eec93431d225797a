"""Exterior derivatives as integer incidence matrices: d1 @ d0 is exactly zero."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ddgcli.mesh.topology import Topology


def d0(topology: Topology) -> csr_array:
    """(e, n) int8 derivative of vertex functions: value at the edge's head minus value at its tail."""
    e = topology.n_edges
    values = np.tile(np.array([-1, 1], dtype=np.int8), e)
    matrix = csr_array(
        (values, topology.edges.ravel(), np.arange(0, 2 * e + 1, 2)), shape=(e, topology.n_vertices)
    )
    matrix.sum_duplicates()
    return matrix


def d1(topology: Topology) -> csr_array:
    """(m, e) int8 derivative of edge values: sum around each face, with the sides' signs."""
    m = topology.n_faces
    matrix = csr_array(
        (topology.side_sign.ravel(), topology.side_edge.ravel(), np.arange(0, 3 * m + 1, 3)),
        shape=(m, topology.n_edges),
    )
    matrix.sum_duplicates()
    return matrix
