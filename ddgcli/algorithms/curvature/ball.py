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

from ddgcli.algorithms.curvature.ball_blocks import ball_blocks
from ddgcli.algorithms.curvature.face_balls import Ball, FaceBalls
from ddgcli.algorithms.curvature.faces import Faces
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures
from ddgcli.algorithms.curvature.star import corrected_measures, corrected_principal, swapped_principal
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import ratio
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
        Of the mesh.
    normal : (3, n) ndarray of float64
        Unit vertex normals.
    radius : float
        Of the balls, in the length unit of the mesh.
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
    of_face = np.where(faces.area > 0, corrected_measures(faces, normal), 0.0).T
    surface = np.ascontiguousarray(of_face), faces.area
    measures = _sums(_Corrected, _corrected_sums, mesh, radius, surface, of_face.shape[1], jobs)
    return corrected_principal(measures, normal)


class _Corrected(NamedTuple):
    """A surface, whose balls sum corrected measures."""

    balls: FaceBalls
    of_face: NDArray
    area: NDArray


def _corrected_sums(surface: _Corrected, ball: Ball) -> NDArray[np.float64]:
    share = _cut(ball, ratio(ball.area, surface.area[ball.face]), len(surface.area))
    return ball.whole @ surface.of_face + share @ surface.of_face


def normal_cycle_in_balls(
    mesh: TriangleMesh,
    normal: NDArray,
    defect: NDArray,
    dihedral: NDArray,
    radius: float,
    *,
    jobs: int = 1,
) -> PrincipalCurvatures:
    """Principal curvatures from the normal cycle of the edges in balls around every vertex.

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
        Of the balls, in the length unit of the mesh.
    jobs : int
        Processes that handle blocks; the result does not depend on it.

    Returns
    -------
    PrincipalCurvatures

    References
    ----------
    CohenSteinerMorvan2003 in docs/references.bib.
    """
    sums = _sums(_normal_cycle, _normal_cycle_sums, mesh, radius, (defect, dihedral), 8, jobs)
    area, gauss = sums[6:]
    return swapped_principal(ratio(sums[:6], area), normal, ratio(gauss, area))


class _NormalCycle(NamedTuple):
    """A surface, whose balls sum the normal cycle of edges and the defects of vertices."""

    balls: FaceBalls
    of_side: list[NDArray]
    of_whole: NDArray
    of_fan: NDArray


def _normal_cycle(balls: FaceBalls, defect: NDArray, dihedral: NDArray) -> _NormalCycle:
    mesh, side = balls.mesh, balls.mesh.side_vector
    length = np.sqrt(np.einsum("fki,fki->fk", side, side))
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


def _normal_cycle_sums(surface: _NormalCycle, ball: Ball) -> NDArray[np.float64]:
    """Six entries of the tensors, areas, and sums of the defects, (b, 8)."""
    n_balls, n_faces = len(ball.vertex), len(surface.of_whole)
    sums = np.column_stack([ball.whole @ surface.of_whole, ball.fans @ surface.of_fan])
    for chord, values in zip(ball.chord, surface.of_side):
        sums[:, :6] += _cut(ball, chord, n_faces) @ values
    sums[:, 6] += sum_by_index(ball.owner, ball.area, n_balls)
    return sums


def _sums(
    prepare: Callable, of_ball: Callable, mesh: TriangleMesh, radius: float, surface: tuple, k: int, jobs: int
) -> NDArray[np.float64]:
    """(k, n) sums over all balls: of each block `of_ball(prepare(balls, *surface), ball)`."""
    sums = np.zeros((mesh.n_vertices, k))
    results = results_in_order(
        _block_sums,
        ball_blocks(mesh.points, radius),
        jobs,
        prepare=_prepared,
        arguments=(prepare, of_ball, mesh, radius, surface),
        modules=(__name__,),
    )
    for vertex, values in results:
        sums[vertex] = values
    return np.ascontiguousarray(sums.T)


def _prepared(
    prepare: Callable, of_ball: Callable, mesh: TriangleMesh, radius: float, surface: tuple
) -> tuple[Callable, NamedTuple]:
    return of_ball, prepare(FaceBalls(mesh, radius), *surface)


def _block_sums(
    shared: tuple[Callable, _Corrected | _NormalCycle], vertex: NDArray, near: NDArray
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    of_ball, surface = shared
    return vertex, of_ball(surface, surface.balls.around(vertex, near))


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
