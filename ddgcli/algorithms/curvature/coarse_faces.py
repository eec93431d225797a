"""Round surfaces whose faces are so large that fits over two rings cover much of the surface."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.frames import area_normals
from ddgcli.algorithms.curvature.neighbours import is_sheared, neighbourhoods, turning
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh

LARGE_BEND = 0.25  # radians an edge: two rings of a sphere then turn by a right angle
EVEN_SHARE = 0.45  # of the mean square of the bends of a vertex, that the squared mean is where it is round
LARGE_TURNING = (
    0.2  # of the normal over the rings, mean of 1 - cos: 0.1 on a sphere of 162 vertices, 0.35 of 42
)
SAMPLE_SIZE = 1000  # vertices whose rings are searched


def warn_of_coarse_faces(mesh: TriangleMesh, faces: Faces, dihedral: NDArray) -> None:
    """Report that most vertices are round and bend so much that their fits are too large.

    On a sphere of 42 vertices fits are a half too large, on one of 162 they are 1 % off. Vertices on a crease
    have sharp edges beside flat ones, and are not round. Edges of sheared faces bend much where the normal
    turns little over the rings that the fits use.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Faces of the mesh.
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
    if 2 * n_coarse <= n_used or not _turns_over_rings(mesh, faces, np.flatnonzero(is_coarse)):
        return
    logging.getLogger("ddgcli").warning(
        "the faces are coarse: at %d of %d vertices the edges bend by more than %g rad, where fits over "
        "two rings can be a half too large; refine the surface%s",
        n_coarse, n_used, LARGE_BEND, "" if is_sheared(mesh, faces) else ", or use `scheme=cotan`",
    )  # fmt: skip


def _turns_over_rings(mesh: TriangleMesh, faces: Faces, vertices: NDArray) -> bool:
    """Whether the normal turns much over the rings of most of these vertices."""
    few = vertices[:: max(1, len(vertices) // SAMPLE_SIZE)]
    normal = area_normals(faces)
    rings = neighbourhoods(mesh, faces, normal, few)
    return float(np.median(turning(normal[:, few], normal, rings))) > LARGE_TURNING
