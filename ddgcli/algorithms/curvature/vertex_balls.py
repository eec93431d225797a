"""The vertices in the ball around every vertex, connected to it inside that ball."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.ball_blocks import (
    blocks_of_leaf,
    connected,
    leaves,
    lists_of,
    neighbours_among,
    packed,
    point_tree,
    unpacked,
    within,
)
from ddgcli.algorithms.curvature.regions import Regions, joined
from ddgcli.algorithms.curvature.rings import adjacency
from ddgcli.mesh.ragged import list_starts, ranges
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.workers import results_in_order

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

SAMPLE_SIZE = 64  # of balls, for their mean size


class VertexBalls(NamedTuple):
    """Balls around vertices: the vertices within a distance that edges inside the ball connect to the centre.

    Parameters
    ----------
    columns : (3, n) ndarray of float64
        Positions.
    radii : (n,) ndarray of float64
        Radius of the ball around each vertex.
    first_neighbour, neighbour : ndarray of int64
        Ragged lists of the neighbours of the vertices.
    tree : cKDTree
        k-d tree of the positions.
    """

    columns: NDArray
    radii: NDArray
    first_neighbour: NDArray
    neighbour: NDArray
    tree: cKDTree

    @classmethod
    def of(cls, mesh: TriangleMesh, radius: float | NDArray) -> VertexBalls:
        """Prepare the balls of a mesh.

        Parameters
        ----------
        mesh : TriangleMesh
        radius : float or (n,) ndarray
            Radius of all balls, or of the ball around each vertex.

        Returns
        -------
        VertexBalls
        """
        near = adjacency(mesh.topology)
        lists = near.indptr.astype(np.int64), near.indices.astype(np.int64)
        radii = np.broadcast_to(radius, mesh.n_vertices)
        return cls(np.ascontiguousarray(mesh.points.T), radii, *lists, point_tree(mesh.points))

    def around(self, centres: NDArray) -> Regions:
        """Vertices in the balls around some vertices that lie near each other.

        Parameters
        ----------
        centres : (b,) ndarray of int64
            Ascending.

        Returns
        -------
        Regions
            The members of a ball in ascending order, the vertex itself among them.
        """
        return joined([self._block(*block) for block in blocks_of_leaf(self.tree, self.radii, centres)])

    def mean_size(self) -> float:
        """Mean number of vertices in the balls around a sample, connected or not.

        Returns
        -------
        float
        """
        sample = slice(None, None, max(1, self.tree.n // SAMPLE_SIZE))
        sizes = self.tree.query_ball_point(self.tree.data[sample], self.radii[sample], return_length=True)
        return float(sizes.mean())

    def _block(self, owner: NDArray, near: NDArray) -> Regions:
        inside = within(self.columns, near, self.columns[:, owner], self.radii[owner])
        seed = np.zeros_like(inside)
        seed[np.searchsorted(near, owner), np.arange(len(owner))] = True
        lists = neighbours_among(near, self.first_neighbour, self.neighbour)
        start, place = lists_of(unpacked(connected(packed(seed), packed(inside), *lists), len(owner)))
        return Regions(start, near[place].astype(np.int32))


def vertex_balls(mesh: TriangleMesh, radius: float | NDArray, *, jobs: int = 1) -> Regions:
    """Vertices within a distance in space of each vertex, connected to it by edges inside that ball.

    Parameters
    ----------
    mesh : TriangleMesh
    radius : float or (n,) ndarray
        Radius of all balls, or of the ball around each vertex.
    jobs : int
        Processes that handle blocks; the result does not depend on it.

    Returns
    -------
    Regions
        As those of `VertexBalls.around`.
    """
    balls = VertexBalls.of(mesh, radius)
    tasks = ((leaf,) for leaf in leaves(balls.tree))
    blocks = list(results_in_order(_around, tasks, jobs, prepare=VertexBalls, arguments=balls))
    count = np.zeros(mesh.n_vertices, dtype=np.int64)
    for owner, of_block in blocks:
        count[owner] = of_block.count
    start = list_starts(count)
    member = np.zeros(start[-1], dtype=np.int32)
    for owner, of_block in blocks:
        member[ranges(start[owner], of_block.count)[0]] = of_block.member
    return Regions(start, member)


def _around(balls: VertexBalls, centres: NDArray) -> tuple[NDArray, Regions]:
    return centres, balls.around(centres)
