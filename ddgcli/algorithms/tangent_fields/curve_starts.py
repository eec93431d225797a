"""Points where integral curves start: given sources, or random ones."""

from __future__ import annotations

import numpy as np

from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.errors import MeshError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.mesh.require import require
from ddgcli.mesh.triangle_mesh import TriangleMesh


def random_starts(mesh: TriangleMesh, k: int, seed: int = 0) -> SurfacePoints:
    """Random points on a surface, uniformly distributed over its area.

    Parameters
    ----------
    mesh : TriangleMesh
    k : int
    seed : int

    Returns
    -------
    SurfacePoints

    Raises
    ------
    MeshError
        For a mesh without area.
    """
    rng = np.random.default_rng(seed)
    require(mesh, "random starts")
    area = face_area(mesh.side_length)
    if not area.any():
        raise MeshError("no face has an area; random starts need one")
    face = rng.choice(mesh.n_faces, size=k, p=area / area.sum())
    return SurfacePoints(face, rng.dirichlet(np.ones(3), k))


def starts_at(mesh: TriangleMesh, sources: Sources) -> SurfacePoints:
    """Sources as surface points; vertices as corners of one of their faces.

    Parameters
    ----------
    mesh : TriangleMesh
    sources : Sources

    Returns
    -------
    SurfacePoints
        The vertices first.
    """
    vertices = sources.vertex.tolist()
    face = np.array([np.flatnonzero((mesh.faces == v).any(axis=1))[0] for v in vertices], dtype=np.int64)
    corner = (mesh.faces[face] == sources.vertex[:, None]).astype(np.float64)
    points = sources.points
    return SurfacePoints(
        np.concatenate([face, points.face]), np.concatenate([corner.reshape(-1, 3), points.barycentric])
    )
