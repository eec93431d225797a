"""Normal cycles and corrected measures in balls around every vertex; the sphere clips edges and faces.

The ball around a vertex holds the part of the surface within a distance in space that is connected to the
vertex inside the ball; other parts nearby do not count.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.algorithms.curvature.ball_blocks import blocks_of_leaf, leaves, point_tree
from ddgcli.algorithms.curvature.face_balls import Ball, FaceBalls
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures
from ddgcli.algorithms.curvature.star import corrected_principal, measures_and_sizes, swapped_principal
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import ratio, row_dot
from ddgcli.workers import results_in_order


def corrected_in_balls(
    mesh: TriangleMesh, faces: Faces, normal: NDArray, radius: float, *, jobs: int = 1
) -> PrincipalCurvatures:
    """Principal curvatures from corrected measures of the faces in balls around the vertices.

    Faces on the rim of a ball count by the share of their area inside.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Faces of the mesh.
    normal : (3, n) ndarray of float64
        Unit vertex normals.
    radius : float
        Radius of the balls, in the length unit of the mesh.
    jobs : int
        Processes that handle blocks; the result does not depend on it.

    Returns
    -------
    PrincipalCurvatures

    References
    ----------
    Lachaud2020 in docs/references.bib.
    """
    # a face without area has no share inside
    of_face = np.where(faces.area > 0, measures_and_sizes(faces, normal), 0.0).T
    values = np.ascontiguousarray(of_face), faces.area
    measures = _sums(_corrected, mesh, radius, values, of_face.shape[1], jobs)
    return corrected_principal(measures, normal)


class _Corrected(NamedTuple):
    """Corrected measures (m, k) and areas (m,) of faces, which balls sum."""

    balls: FaceBalls
    of_face: NDArray
    area: NDArray

    def sums(self, ball: Ball) -> NDArray[np.float64]:
        """(b, k) measures."""
        share = _cut(ball, ratio(ball.area, self.area[ball.face]), len(self.area))
        return ball.whole @ self.of_face + share @ self.of_face


def _corrected(balls: tuple, of_face: NDArray, area: NDArray) -> _Corrected:
    return _Corrected(FaceBalls(*balls), of_face, area)


def normal_cycle_in_balls(
    mesh: TriangleMesh,
    normal: NDArray,
    defect: NDArray,
    dihedral: NDArray,
    radius: float,
    *,
    jobs: int = 1,
) -> PrincipalCurvatures:
    """Principal curvatures from the normal cycle of the edges in balls around the vertices.

    The tensor of the clipped edges is divided by the clipped area of the ball.

    Parameters
    ----------
    mesh : TriangleMesh
    normal : (3, n) ndarray of float64
        Unit vertex normals.
    defect : (n,) ndarray of float64
        Angle defects in radians.
    dihedral : (e,) ndarray of float64
        Dihedral angles in radians, positive where convex.
    radius : float
        Radius of the balls, in the length unit of the mesh.
    jobs : int
        Processes that handle blocks; the result does not depend on it.

    Returns
    -------
    PrincipalCurvatures

    References
    ----------
    CohenSteinerMorvan2003 in docs/references.bib.
    """
    sums = _sums(_normal_cycle, mesh, radius, (defect, dihedral), 8, jobs)
    area, gauss = sums[6:]
    return swapped_principal(ratio(sums[:6], area), normal, ratio(gauss, area))


class _NormalCycle(NamedTuple):
    """Normal cycle of a length 1 of each side, three of (m, 6), and of whole faces with their areas (m, 7).

    And the angle defects of fans. Balls sum all of them.
    """

    balls: FaceBalls
    of_side: list[NDArray]
    of_whole: NDArray
    of_fan: NDArray

    def sums(self, ball: Ball) -> NDArray[np.float64]:
        """(b, 8) six entries of the tensors, areas, and sums of the defects."""
        n_balls, n_faces = len(ball.vertex), len(self.of_whole)
        sums = np.column_stack([ball.whole @ self.of_whole, ball.fans @ self.of_fan])
        for chord, values in zip(ball.chord, self.of_side):
            sums[:, :6] += _cut(ball, chord, n_faces) @ values
        sums[:, 6] += sum_by_index(ball.owner, ball.area, n_balls)
        return sums


def _normal_cycle(of_balls: tuple, defect: NDArray, dihedral: NDArray) -> _NormalCycle:
    balls = FaceBalls(*of_balls)
    mesh, side = balls.mesh, balls.mesh.side_vector
    length = np.sqrt(row_dot(side, side))
    x, y, z = np.moveaxis(ratio(side, length[..., None]), -1, 0)
    # every edge is visited from both of its faces: half from each
    turn = 0.5 * dihedral[mesh.topology.side_edge]
    of_side = [
        np.stack([t * e for e in (a * a, b * b, c * c, b * c, c * a, a * b)], axis=-1)
        for t, a, b, c in zip(turn.T, x.T, y.T, z.T)
    ]
    of_whole = sum(values * long[:, None] for values, long in zip(of_side, length.T))
    of_whole = np.column_stack([of_whole, balls.face_area])
    return _NormalCycle(balls, of_side, of_whole, _defect_of_fans(mesh, defect, balls))


def _sums(
    prepare: Callable[..., _Corrected | _NormalCycle],
    mesh: TriangleMesh,
    radius: float,
    values: tuple,
    k: int,
    jobs: int,
) -> NDArray[np.float64]:
    """(k, n) sums over the balls around all vertices, of what `prepare` makes of the balls and values."""
    sums, tree = np.zeros((mesh.n_vertices, k)), point_tree(mesh.points)
    arguments = (mesh, radius, tree), *values
    tasks = ((leaf,) for leaf in leaves(tree))
    for vertex, of_balls in results_in_order(_leaf_sums, tasks, jobs, prepare=prepare, arguments=arguments):
        sums[vertex] = of_balls
    return np.ascontiguousarray(sums.T)


def _leaf_sums(
    surface: _Corrected | _NormalCycle, leaf: NDArray
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    balls = surface.balls
    blocks = blocks_of_leaf(balls.tree, balls.radii, leaf)
    return leaf, np.concatenate([surface.sums(balls.around(*block)) for block in blocks])


def _defect_of_fans(mesh: TriangleMesh, defect: NDArray, balls: FaceBalls) -> NDArray[np.float64]:
    """Angle defects divided among the fans of their vertices in proportion to their corners."""
    corners = np.bincount(mesh.faces.ravel(), minlength=mesh.n_vertices)
    of_fan = np.bincount(mesh.topology.corner_fans.ravel(), minlength=balls.n_fans)
    return of_fan * (defect / np.maximum(corners, 1))[balls.fan_vertex]


def _cut(ball: Ball, values: NDArray, n_faces: int) -> csr_array:
    """Values of the faces that the sphere cuts, as a matrix from faces to owners."""
    n_balls = len(ball.vertex)
    start = list_starts(np.bincount(ball.owner, minlength=n_balls))
    return csr_array((values, ball.face, start), shape=(n_balls, n_faces))
