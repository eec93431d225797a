"""Contact between the pieces of a shell that breaks, whose surfaces are inset along the cracks.

The two sides of a new crack touch, and a barrier cannot be evaluated at distance 0. Contact therefore uses
each piece without a margin along its cracks that is wider than half the gap: pieces that have not moved are
farther apart than the gap, and a crack opens without a force. Pieces can overlap by at most two margins.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, kron

from ddgcli.geometry.intrinsic import corner_angle, half_angle_tangent
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import vector_length
from ddgcli.models.shell.context import ShellContext
from ddgcli.models.shell.pair_contact import PairMesh

MARGIN = 0.9  # over the gap; more than one half, because of crack tips and of surfaces bent where they crack
MAX_MARGIN = 0.5  # over the inradius of the smallest face
# lower bound of the length of the mean face direction at a vertex, which is 0 where the faces close a turn
MIN_MEAN_DIRECTION = 0.3


class InsetPairMesh(PairMesh):
    """A broken shell without a margin along its cracks.

    The vertices for contact are linear combinations of those of the shell, with constant weights.

    Parameters
    ----------
    context : ShellContext
        Context of the broken shell.
    gap : float
        In m.
    """

    def __init__(self, context: ShellContext, gap: float) -> None:
        mesh = context.mesh
        self.weights = inset_weights(mesh, context.vertices_at_start, MARGIN * gap)
        super().__init__(
            np.arange(mesh.n_vertices), self.weights @ np.asarray(mesh.points), mesh.topology.edges,
            np.asarray(mesh.faces), [(context.shell.name, 0, 0)],
        )  # fmt: skip
        self._solid_weights = csr_array(kron(self.weights, np.eye(3)))

    def _with(self, own: NDArray, of_obstacle: Any, time: float) -> NDArray[np.float64]:
        return np.asfortranarray(self.weights @ own)

    def scatter(self, gradient: NDArray, n: int) -> NDArray[np.float64]:
        return self.weights.T @ gradient.reshape(-1, 3)

    def scatter_matrix(self, hessian: Any, n: int) -> csc_array:
        return csc_array(self._solid_weights.T @ csc_array(hessian) @ self._solid_weights)


def largest_gap(whole: ShellContext) -> float:
    """Largest gap whose margin is at most half the inradius of each face.

    Parameters
    ----------
    whole : ShellContext

    Returns
    -------
    float
        In m.
    """
    radius = 2 * whole.face_area / whole.mesh.side_length.sum(axis=1)
    return MAX_MARGIN / MARGIN * float(radius.min())


def inset_weights(mesh: TriangleMesh, origin: NDArray, margin: float) -> csr_array:
    """(n, n) weights that move the split vertices of a mesh at rest away from their cracks.

    Parameters
    ----------
    mesh : TriangleMesh
    origin : (n,) ndarray of int
        Index in the unbroken mesh of each vertex; vertices with the same index were split.
    margin : float
        Distance in m that the moved vertices have from the outer sides of the faces around them.
    """
    faces, n, side = mesh.faces, mesh.n_vertices, mesh.side_length
    tangent = half_angle_tangent(side)
    # the integral of the unit vectors over a corner is tan(angle / 2) times the sum of its unit sides
    ahead, behind = tangent / side, tangent / np.roll(side, 1, axis=1)
    vector = mesh.side_vector
    corner = ahead[..., None] * vector - behind[..., None] * np.roll(vector, 1, axis=1)
    mean = vector_length(sum_by_index(faces.ravel(), corner.reshape(-1, 3), n))
    angle = sum_by_index(faces.ravel(), corner_angle(side).ravel(), n)
    split = np.bincount(origin)[origin] > 1
    distance = margin / np.sin(0.5 * np.minimum(np.where(split, angle, np.pi), np.pi))
    mean = np.where(angle > np.pi, np.maximum(mean, MIN_MEAN_DIRECTION), mean)
    scale = np.where(split, distance / mean, 0.0)
    rows, columns = np.tile(faces.ravel(), 2), [np.roll(faces, -1, axis=1), np.roll(faces, 1, axis=1)]
    values = scale[rows] * np.concatenate([ahead.ravel(), behind.ravel()])
    moved = csr_array((values, (rows, np.concatenate([c.ravel() for c in columns]))), shape=(n, n))
    own_weight = csr_array((1 - sum_by_index(rows, values, n), (np.arange(n), np.arange(n))), shape=(n, n))
    return csr_array(moved + own_weight)
