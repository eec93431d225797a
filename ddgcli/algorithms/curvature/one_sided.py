"""Signs on one-sided surfaces: their double cover has two sides, and one copy of each vertex is measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.frames import PrincipalCurvatures, unit_normals
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.double_cover import cover_vertices
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.topology import NEXT
from ddgcli.mesh.triangle_mesh import TriangleMesh


def double_covered(mesh: TriangleMesh) -> tuple[TriangleMesh, NDArray[np.int64]]:
    """The double cover of a manifold surface in space, and one copy of each vertex there.

    Parameters
    ----------
    mesh : TriangleMesh
        Manifold; faces may be turned at will.

    Returns
    -------
    cover : TriangleMesh
        Consistently oriented; both copies of a vertex lie at its place.
    copy : (n,) ndarray of int64
        Copies of neighbours are neighbours in the cover but across a seam; 0 at vertices without faces.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    topology = mesh.topology
    vertices = cover_vertices(topology)
    faces, size = vertices.faces, len(vertices.below)
    cover = TriangleMesh.from_arrays(mesh.points[vertices.below], faces)
    ends = faces.ravel(), faces[:, NEXT].ravel()
    graph = csr_array((np.ones(faces.size), ends), shape=(size, size))
    _, first_face = np.unique(topology.face_component, return_index=True)
    # edges from a first corner of each component: every vertex takes the copy that is nearer to it
    steps = dijkstra(graph, indices=vertices.corner[first_face, 0], unweighted=True, min_only=True)
    index = np.arange(size)
    near, far = steps, steps[vertices.mirror]
    is_nearer = (near < far) | ((near == far) & (index < vertices.mirror))
    copy = np.zeros(mesh.n_vertices, dtype=np.int64)
    copy[vertices.below[is_nearer]] = index[is_nearer]
    return cover, copy


def unsigned_normals(mesh: TriangleMesh, faces: Faces) -> NDArray[np.float64]:
    """Vertex normals of a one-sided surface that is not manifold, with the sign of one face.

    Where faces of opposite orientation meet, it is the line nearest to the normals of the star.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Faces of the mesh.

    Returns
    -------
    (3, n) ndarray of float64
        Unit vectors.
    """
    normal = unit_normals(faces)
    seam = unique_keys(mesh.topology.edges[mesh.topology.misoriented_edges])
    place = np.full(mesh.n_vertices, -1)
    place[seam] = np.arange(len(seam))
    scatter, some = np.zeros((len(seam), 3, 3)), np.zeros((len(seam), 3))
    for corner in faces.corner:
        here = np.flatnonzero(place[corner] >= 0)
        at, vector = place[corner[here]], faces.doubled[:, here].T
        np.add.at(scatter, at, vector[:, :, None] * vector[:, None, :])
        some[at] = vector
    line = np.linalg.eigh(scatter)[1][:, :, 2]
    normal[:, seam] = (line * np.where((line * some).sum(axis=1) < 0, -1.0, 1.0)[:, None]).T
    return normal


def of_copies(cover: PrincipalCurvatures, copy: NDArray, referenced: NDArray) -> PrincipalCurvatures:
    """Values at the vertices of a surface from those at their copies in its double cover.

    Parameters
    ----------
    cover : PrincipalCurvatures
        Curvatures at the vertices of the cover.
    copy : (n,) ndarray of int64
        One copy of each vertex.
    referenced : (n,) ndarray of bool
        Vertices with faces; the others get zero.

    Returns
    -------
    PrincipalCurvatures
    """
    low, high, gaussian = (
        np.where(referenced, values[copy], 0.0) for values in (cover.low, cover.high, cover.gaussian)
    )
    one, other = (d[:, copy] if d.size else d for d in (cover.low_direction, cover.high_direction))
    return PrincipalCurvatures(low, high, one, other, gaussian)
