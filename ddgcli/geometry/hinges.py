"""Hinges: the interior edges of a surface with their two faces, and the quadratic form of their bending."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import corner_cotan
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.topology import Topology


def hinges(topology: Topology) -> NDArray[np.int64]:
    """(h, 4) vertices x0, x1, x2, x3 of every edge with two faces that agree in orientation.

    x0 x1 is the edge, x2 the apex of the face (x0, x1, x2), x3 that of (x1, x0, x3).
    """
    faces, tail, head = topology.faces, topology.side_tail, topology.side_head
    side, other = hinge_sides(topology)
    apex = faces[side // 3, (side % 3 + 2) % 3]
    apex_other = faces[other // 3, (other % 3 + 2) % 3]
    return np.stack([tail[side], head[side], apex, apex_other], axis=1)


def hinge_sides(topology: Topology) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(h,) flat numbers of the sides in the first and in the second face of every hinge."""
    side = topology.interior_sides
    other = topology.side_twin.ravel()[side]
    agree = topology.side_tail[side] == topology.side_head[other]
    return side[agree], other[agree]


def hinge_cotans(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """(h, 4) coefficients c with |sum c_i x_i| = 2 |e| sin(angle / 2) where x is isometric to the mesh.

    Notes
    -----
    M. Bergou, M. Wardetzky, D. Harmon, D. Zorin, E. Grinspun, "A quadratic bending model for inextensible
    surfaces", 2006.
    """
    cotan = corner_cotan(mesh.side_length).ravel()
    side, other = hinge_sides(mesh.topology)

    def at(flat: NDArray, step: int) -> NDArray:
        return cotan[3 * (flat // 3) + (flat % 3 + step) % 3]

    tail, head = at(side, 0), at(side, 1)
    head_t, tail_t = at(other, 0), at(other, 1)
    return np.stack([head + head_t, tail + tail_t, -tail - head, -tail_t - head_t], axis=1)
