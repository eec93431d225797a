"""Normal cycles and corrected measures in balls around every vertex; the sphere clips edges and faces.

The ball around a vertex holds the part of the surface within a distance in space that is connected to the
vertex inside the ball; other parts nearby do not count.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ddgcli.algorithms.curvature.face_balls import Ball, FaceBalls
from ddgcli.algorithms.curvature.faces import Faces
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures
from ddgcli.algorithms.curvature.star import corrected_measures, corrected_principal, swapped_principal
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import ratio


def corrected_in_balls(
    mesh: TriangleMesh, faces: Faces, normal: NDArray, radius: float
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

    Returns
    -------
    PrincipalCurvatures

    References
    ----------
    Lachaud2020 in docs/references.bib.
    """
    # a face without area has no share inside
    of_face = np.where(faces.area > 0, corrected_measures(faces, normal), 0.0).T
    of_face = np.ascontiguousarray(of_face)
    measures = np.zeros((mesh.n_vertices, of_face.shape[1]))
    for ball in FaceBalls(mesh, radius):
        share = _cut(ball, ratio(ball.area, faces.area[ball.face]), mesh.n_faces)
        measures[ball.begin : ball.end] = ball.whole @ of_face + share @ of_face
    return corrected_principal(np.ascontiguousarray(measures.T), normal)


def normal_cycle_in_balls(
    mesh: TriangleMesh, normal: NDArray, defect: NDArray, dihedral: NDArray, radius: float
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
        Of the balls, in the length unit of the mesh.

    Returns
    -------
    PrincipalCurvatures

    References
    ----------
    CohenSteinerMorvan2003 in docs/references.bib.
    """
    side = mesh.side_vector
    length = np.sqrt(np.einsum("fki,fki->fk", side, side))
    x, y, z = np.moveaxis(ratio(side, length[..., None]), -1, 0)
    # every edge is visited from both of its faces: half from each
    turn = 0.5 * dihedral[mesh.topology.side_edge]
    of_side = [
        np.stack([t * e for e in (a * a, b * b, c * c, b * c, c * a, a * b)], axis=-1)
        for t, a, b, c in zip(turn.T, x.T, y.T, z.T)
    ]
    balls = FaceBalls(mesh, radius)
    of_whole = sum(values * long[:, None] for values, long in zip(of_side, length.T))
    of_face = np.column_stack([of_whole, balls.face_area])
    of_fan = _defect_of_fans(mesh, defect, balls)
    tensor, area, gauss = np.zeros((mesh.n_vertices, 6)), np.zeros(mesh.n_vertices), np.zeros(mesh.n_vertices)
    for ball in balls:
        ball_rows = slice(ball.begin, ball.end)
        whole = ball.whole @ of_face
        tensor[ball_rows], area[ball_rows] = whole[:, :6], whole[:, 6]
        for chord, values in zip(ball.chord, of_side):
            tensor[ball_rows] += _cut(ball, chord, mesh.n_faces) @ values
        area[ball_rows] += sum_by_index(ball.owner, ball.area, ball.end - ball.begin)
        gauss[ball_rows] = ball.fans @ of_fan
    return swapped_principal(ratio(np.ascontiguousarray(tensor.T), area), normal, ratio(gauss, area))


def _defect_of_fans(mesh: TriangleMesh, defect: NDArray, balls: FaceBalls) -> NDArray[np.float64]:
    """Angle defects divided among the fans of their vertices in proportion to their corners."""
    corners = np.bincount(mesh.faces.ravel(), minlength=mesh.n_vertices)
    of_fan = np.bincount(mesh.topology.corner_fans.ravel(), minlength=balls.n_fans)
    return of_fan * (defect / np.maximum(corners, 1))[balls.fan_vertex]


def _cut(ball: Ball, values: NDArray, n_faces: int) -> csr_array:
    """Values of the faces that the sphere cuts, as a matrix from faces to owners."""
    count = np.bincount(ball.owner, minlength=ball.end - ball.begin)
    start = list_starts(count)
    return csr_array((values, ball.face, start), shape=(ball.end - ball.begin, n_faces))
