"""Round surfaces whose faces are so large that polynomial fits over two rings see much of the whole."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh

LARGE_BEND = 0.25  # radians an edge: two rings of a sphere then turn by a right angle
EVEN_SHARE = 0.45  # of the mean square of the bends of a vertex, that the squared mean is where it is round


def warn_of_coarse_faces(mesh: TriangleMesh, dihedral: NDArray) -> None:
    """Report that most vertices are round and bend so much that their fits are too large.

    On a sphere of 42 vertices fits are a half too large, on one of 162 they are 1 % off. Vertices on a crease
    have sharp edges beside flat ones, and are not round.

    Parameters
    ----------
    mesh : TriangleMesh
    dihedral : (e,) ndarray of float64
        Dihedral angles of the edges in radians.
    """
    ends, bend = mesh.topology.edges.T, np.abs(dihedral)
    degree, total, square = (
        sum_by_index(ends, np.stack([values, values]), mesh.n_vertices)
        for values in (np.ones(len(bend)), bend, bend * bend)
    )
    is_coarse = (total > LARGE_BEND * degree) & (total * total > EVEN_SHARE * square * degree)
    n_coarse, n_used = int(is_coarse.sum()), int(mesh.topology.referenced_vertex.sum())
    if 2 * n_coarse > n_used:
        logging.getLogger("ddgcli").warning(
            "the faces are coarse: at %d of %d vertices the edges bend by more than %g rad, where fits over "
            "two rings can be a half too large; refine the surface, or use `scheme=cotan`",
            n_coarse, n_used, LARGE_BEND,
        )  # fmt: skip
