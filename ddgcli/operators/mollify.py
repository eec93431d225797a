"""Lengths mended where a triangle has no area, so that cotangents exist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError
from ddgcli.geometry.intrinsic import degenerate_faces, triangle_excess
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

# least excess of a mended triangle, relative to its mean side
SPARE = 1e-8
MAX_ROUNDS = 50


@dataclass(frozen=True, eq=False)
class Mollified:
    """A mesh whose triangles all have area.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        The input itself where nothing had to be mended.
    faces : (k,) ndarray of int64
        Degenerate faces of the input.
    edges : int
        Number of edges that were lengthened.
    largest_change : float
        Largest lengthening, relative to the mean edge length.
    """

    mesh: TriangleMesh | IntrinsicMesh
    faces: NDArray[np.int64]
    edges: int = 0
    largest_change: float = 0.0

    def __str__(self) -> str:
        return (
            f"{len(self.faces)} degenerate faces (first: face {self.faces[0]}) were mollified: {self.edges} "
            f"edges lengthened by at most {self.largest_change:.1e} of the mean edge length"
        )


def mollified(mesh: TriangleMesh | IntrinsicMesh) -> Mollified:
    """The mesh with edges lengthened as little as makes every triangle non-degenerate.

    A face whose sides satisfy the triangle inequality with no more than rounding to spare has its three edges
    lengthened by the same amount, until its excess is SPARE times its mean side; neighbours that this spoils
    follow. Where nothing is degenerate nothing changes. After N. Sharp, K. Crane, "A Laplacian for
    nonmanifold triangle meshes", 2020, who lengthen every edge of the mesh alike.

    Raises
    ------
    MeshError
        When no face has an area: there is no surface to speak of.
    """
    length = mesh.side_length
    bad = degenerate_faces(length)
    if len(bad) == 0:
        return Mollified(mesh, bad)
    if len(bad) == len(length):
        raise MeshError(
            f"none of the {len(length)} faces has an area; a Laplacian needs a surface: check the coordinates"
        )
    side_edge = mesh.topology.side_edge
    original = np.zeros(mesh.topology.n_edges)
    original[side_edge] = length
    edge_length = _lengthened(original, side_edge, bad, float(length.mean()))
    change = edge_length - original
    mended = IntrinsicMesh(mesh.topology, edge_length[side_edge], mesh.points)
    return Mollified(mended, bad, int((change > 0).sum()), float(change.max() / original.mean()))


def _lengthened(edge_length: NDArray, side_edge: NDArray, bad: NDArray, mean: float) -> NDArray[np.float64]:
    """(e,) edge lengths that leave no face degenerate, in rounds over the faces still short of spare."""
    edge_length = edge_length.copy()
    short = bad
    for _ in range(MAX_ROUNDS):
        sides = edge_length[side_edge[short]]
        spare = SPARE * np.maximum(sides.mean(axis=1), SPARE * mean)
        missing = spare - triangle_excess(sides).min(axis=1) + np.finfo(float).eps * sides.max(axis=1) * 4
        more = np.zeros(len(edge_length))
        np.maximum.at(more, side_edge[short].ravel(), np.repeat(np.maximum(missing, 0.0), 3))
        edge_length += more
        short = degenerate_faces(edge_length[side_edge])
        if len(short) == 0:
            return edge_length
    return edge_length + SPARE * mean
