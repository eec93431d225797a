"""Mid-edge bending: a Kirchhoff-Love shell with linear displacements and one rotation per edge.

The director of an edge is the mean of the normals of its two faces, rotated about the edge by an angle a.
Relative to the normal of a face, the director at the midpoint of side j is rotated by
p_j = +- a_j + (angle_j - rest_j) / 2, so the second fundamental form of the face changes by
B = sum_j p_j l_j / A m_j m_j^T, with the outward conormal m_j, the length l_j and the area A at rest. The
energy per area is Koiter's for a plate, D/2 ((1 - nu) |B|^2 + nu (tr B)^2).

This is the Hellan-Herrmann-Johnson shell of lowest order (M. Neunteufel, J. Schoeberl, "The
Hellan-Herrmann-Johnson method for nonlinear shells", 2019) with the moments eliminated in every face; on flat
plates it is the Morley triangle, which converges on any mesh with bounded angles. The energy is quadratic in
the rotations a and in the angles, with matrices that depend only on the rest shape: the rotations follow from
the positions by one solve with a constant matrix. They have no inertia, as in the theory of thin shells, and
are not part of the state.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from ddgcli.geometry.extrinsic import face_area_vector
from ddgcli.geometry.hinges import HingeFrame, angle_gradient, hinge_frame, hinge_sides, hinges
from ddgcli.linalg.factor import Factor
from ddgcli.mechanics.terms import LinearOperator, Mode, at_last_point
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import dot, tangential, unit_vectors, vector_length
from ddgcli.models.shell.hinge import angle_hessian, wrapped
from ddgcli.models.shell.tensor_potential import TensorPotential

NODES = 9  # nodes of an element: 3 corners, 3 apexes across the sides, 3 rotations of the sides


@dataclass(frozen=True, eq=False)
class ClampedSides:
    """Sides of faces whose director keeps its direction.

    Parameters
    ----------
    side : (c,) ndarray of int
        Flat indices; both ends stay in a plane perpendicular to `direction`.
    direction : (c, 3) ndarray
        Unit vectors perpendicular to the side, at acute angles with the direction into the face.
    """

    side: NDArray[np.int64]
    direction: NDArray[np.float64]


NO_CLAMP = ClampedSides(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))


class MidedgeBending(TensorPotential):
    """Plate energy of the angles between faces, minimised over the rotations of the edges.

    Parameters
    ----------
    mesh : TriangleMesh
        The rest shape.
    rigidity, poisson : float
        D in N m, and Poisson's ratio.
    flat : bool
        Whether the shell is at rest when flat, not as in the input.
    clamps : ClampedSides

    Attributes
    ----------
    internal : int
        Number of edge rotations, the internal unknowns. In `blocks` the unknown is the rotation times the
        mean length of the edges.
    """

    name = "bending"

    def __init__(
        self,
        mesh: TriangleMesh,
        rigidity: float,
        poisson: float,
        flat: bool = False,
        clamps: ClampedSides = NO_CLAMP,
    ) -> None:
        topology, x = mesh.topology, np.asarray(mesh.points)
        faces, self.n = np.asarray(mesh.faces), mesh.n_vertices
        self.clamps = clamps
        clamped = np.zeros(faces.size, dtype=bool)
        clamped[clamps.side] = True
        every, first, second = hinges(topology), *hinge_sides(topology)
        bent = ~clamped[first]
        self.hinges, self._first, self._second = every[bent], first[bent], second[bent]
        self._clamp_corner = side_corners(topology)[clamps.side]
        self._angles(faces.size)
        unit = float(mesh.side_length.mean())
        self._slope = self._sign / unit  # derivative of the angle of a side by its internal unknown
        self.rigidity, self.poisson = rigidity, poisson
        area = vector_length(face_area_vector(mesh))  # from lengths, the area of needles would be rounding
        self.plate = plate_matrices(mesh.side_length, area, rigidity, poisson)
        self._conormals = conormal_products(mesh.side_length, area)
        self._matrices()
        self.stencil = self._stencil(faces)
        self.rest = np.zeros(len(self.hinges)) if flat else hinge_frame(x, self.hinges).angle
        self._clamp_rest = self._clamp_frame(x).angle

    # ------------------------------------------------------------ constants of the rest shape

    def _angles(self, sides: int) -> None:
        """Number the angles and the rotations: `_angle`, `_half_turn`, `_rotation`, `_sign` of every side."""
        h, c = len(self.hinges), len(self.clamps.side)
        self._angle, self._half_turn = np.zeros(sides, dtype=np.int64), np.zeros(sides)
        self._rotation, self._sign = np.full(sides, -1), np.ones(sides)
        for side in (self._first, self._second):
            self._angle[side], self._half_turn[side], self._rotation[side] = np.arange(h), 0.5, np.arange(h)
        self._sign[self._second] = -1.0
        self._angle[self.clamps.side], self._half_turn[self.clamps.side] = h + np.arange(c), 1.0
        self._sign[self.clamps.side] = 0.0
        alone = (self._rotation < 0) & (self._sign != 0)
        self._rotation[alone] = h + np.arange(np.count_nonzero(alone))
        self.internal = h + int(np.count_nonzero(alone))

    def _matrices(self) -> None:
        """Second derivatives of the energy by rotations (factorised), by both, and by angles."""
        rotation, angle = np.maximum(self._rotation, 0).reshape(-1, 3), self._angle.reshape(-1, 3)
        slope, half_turn = self._slope.reshape(-1, 3), self._half_turn.reshape(-1, 3)
        angles = len(self.hinges) + len(self.clamps.side)

        def summed(rows: NDArray, left: NDArray, columns: NDArray, right: NDArray, shape: tuple) -> csr_array:
            values = self.plate * left[:, :, None] * right[:, None, :]
            i, j = (
                np.broadcast_to(rows[:, :, None], values.shape),
                np.broadcast_to(columns[:, None, :], values.shape),
            )
            nonzero = values != 0  # a side without an angle or a rotation has no valid index
            matrix = coo_array((values[nonzero], (i[nonzero], j[nonzero])), shape=shape).tocsr()
            matrix.eliminate_zeros()
            return matrix

        k = self.internal
        self._solver = Factor(summed(rotation, slope, rotation, slope, (k, k))) if k else None
        self._mixed = summed(rotation, slope, angle, half_turn, (k, angles)) if k else csr_array((0, angles))
        self._stiffness = summed(angle, half_turn, angle, half_turn, (angles, angles))

    def _stencil(self, faces: NDArray) -> NDArray[np.int64]:
        across = np.repeat(faces[:, :1], 3, axis=1).ravel()
        across[self._first], across[self._second] = self.hinges[:, 3], self.hinges[:, 2]
        own = np.where(self._rotation >= 0, self.n + self._rotation, np.repeat(faces[:, 0], 3))
        return np.concatenate([faces, across.reshape(-1, 3), own.reshape(-1, 3)], axis=1).astype(np.int64)

    # ------------------------------------------------------------ geometry at positions x

    @at_last_point
    def _hinge_frame(self, x: NDArray) -> HingeFrame:
        return hinge_frame(x, self.hinges)

    @at_last_point
    def _clamp_frame(self, x: NDArray) -> HingeFrame:
        return one_sided_frame(x, self._clamp_corner, self.clamps.direction)

    @at_last_point
    def strain(self, x: NDArray) -> NDArray[np.float64]:
        """Changes of the angles of the hinges, then of the clamped sides."""
        return np.concatenate(
            [
                wrapped(self._hinge_frame(x).angle - self.rest),
                wrapped(self._clamp_frame(x).angle - self._clamp_rest),
            ]
        )

    def rotations(self, strain: NDArray) -> NDArray[np.float64]:
        """Rotations (times length) that minimise the energy for given changes of the angles."""
        return -self._solver.solve(self._mixed @ strain) if self._solver else np.zeros(0)

    def moments(self, strain: NDArray) -> NDArray[np.float64]:
        """Derivative of the minimal energy by the angles: moment times length of the edge, in N m."""
        return self._stiffness @ strain + self._mixed.T @ self.rotations(strain)

    @at_last_point
    def _moment(self, x: NDArray) -> NDArray[np.float64]:
        return self.moments(self.strain(x))

    def face_curvature(self, x: NDArray, added: NDArray | float = 0.0) -> NDArray[np.float64]:
        """(m, 3) rotation of the director relative to the face normal, at the midpoints of the sides.

        `added` are the rotations (times length) due to couples on edges.
        """
        strain = self.strain(x)
        rotation = np.concatenate([self.rotations(strain) + added, [0.0]])
        whole = np.concatenate([strain, [0.0]])
        angle = np.where(self._half_turn > 0, self._angle, len(strain))
        return (self._half_turn * whole[angle] + self._slope * rotation[self._rotation]).reshape(-1, 3)

    # ------------------------------------------------------------ the potential

    def energy(self, x: NDArray) -> float:
        return 0.5 * float(self.strain(x) @ self._moment(x))

    def gradient(self, x: NDArray) -> NDArray[np.float64]:
        return self.pulled_back(x, self._moment(x))

    def pulled_back(self, x: NDArray, moment: NDArray) -> NDArray[np.float64]:
        """(n, 3) gradient in the positions from the derivatives by the angles of hinges and clamped sides."""
        h = len(self.hinges)
        slope = moment[:h, None, None] * angle_gradient(self._hinge_frame(x))
        clamp_slope = moment[h:, None, None] * angle_gradient(self._clamp_frame(x))[:, :3]
        return sum_by_index(self.hinges, slope, len(x)) + sum_by_index(
            self._clamp_corner, clamp_slope, len(x)
        )

    def turned(self, x: NDArray, move: NDArray) -> NDArray[np.float64]:
        """Changes of the angles at x, to first order, by a move (n, 3) of the vertices."""
        slope, clamp_slope = (
            angle_gradient(self._hinge_frame(x)),
            angle_gradient(self._clamp_frame(x))[:, :3],
        )
        return np.concatenate(
            [
                np.einsum("hvi,hvi->h", slope, move[self.hinges]),
                np.einsum("hvi,hvi->h", clamp_slope, move[self._clamp_corner]),
            ]
        )

    def blocks(self, x: NDArray, mode: Mode) -> NDArray[np.float64]:
        """(m, 27, 27) Hessians in positions and rotations, which are independent unknowns here."""
        m = len(self.stencil)
        rate = np.zeros((3 * m, NODES, 3))
        slope = 0.5 * angle_gradient(self._hinge_frame(x))
        corner, opposite = np.arange(3), 3
        for side, order in ((self._first, (0, 1, 2, 3)), (self._second, (1, 0, 3, 2))):
            j = side % 3
            local = np.stack([j, (j + 1) % 3, (j + 2) % 3, opposite + j], axis=1)
            rate[side[:, None], local] = slope[:, order]
        clamp_side, j = self.clamps.side, self.clamps.side % 3
        rate[clamp_side[:, None], (j[:, None] + corner) % 3] = angle_gradient(self._clamp_frame(x))[:, :3]
        rate[np.arange(3 * m), 6 + np.arange(3 * m) % 3, 0] = self._slope
        rate = rate.reshape(m, 3, 3 * NODES)
        block = np.matmul(rate.transpose(0, 2, 1), np.matmul(self.plate, rate))
        if mode == "exact":
            self._add_geometric(x, block)
        return block

    def _add_geometric(self, x: NDArray, block: NDArray) -> None:
        """Add moment times Hessian of the angle; the term of a hinge goes to its first face."""
        h, moment = len(self.hinges), self._moment(x)
        terms = (
            (self._first, angle_hessian(self._hinge_frame(x)), moment[:h], 4),
            (self.clamps.side, angle_hessian(self._clamp_frame(x))[:, :9, :9], moment[h:], 3),
        )
        for side, hessian, weight, nodes in terms:
            weighted = weight[:, None, None] * hessian
            for j in range(3):
                own = np.flatnonzero(side % 3 == j)
                local = np.array([j, (j + 1) % 3, (j + 2) % 3, 3 + j])[:nodes]
                rows = (3 * local[:, None] + np.arange(3)).ravel()
                block[(side[own] // 3)[:, None, None], rows[:, None], rows] += weighted[own]

    # ------------------------------------------------------------ what other effects use

    def side_weights(self, side: NDArray, couple: NDArray) -> NDArray[np.float64]:
        """Derivatives by the angles of the potential of couples (N m) on boundary sides."""
        return self._mixed.T @ self.rotations_of(side, couple)

    def rotations_of(self, side: NDArray, couple: NDArray) -> NDArray[np.float64]:
        """(internal,) rotations (times length) due to couples (N m) on boundary sides."""
        force = sum_by_index(self._rotation[side], couple * self._slope[side], self.internal)
        return self._solver.solve(force) if self._solver else force

    def angle_stencils(self) -> list[NDArray]:
        """(h, 4) vertices of the hinges, and (c, 4) of the clamped sides (the last one unused)."""
        return [self.hinges, np.column_stack([self._clamp_corner, self._clamp_corner[:, 0]])]

    def angle_hessians(self, x: NDArray) -> NDArray[np.float64]:
        """(h + c, 12, 12) Hessians of the angles."""
        hinge_frames = self._hinge_frame(x), self._clamp_frame(x)
        return np.concatenate([angle_hessian(f) for f in hinge_frames])

    def couples(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """((c, 2) ends of the clamped sides, (c, 3) moments in N m that the clamp exerts on them)."""
        moment = self._moment(x)[len(self.hinges) :]
        return self._clamp_corner[:, :2], moment[:, None] * self._clamp_frame(x).u.T

    def moment_tensor(self, x: NDArray, added: NDArray | float = 0.0) -> NDArray[np.float64]:
        """(m, 2, 2) bending moments in N m per metre, along the first side of each face and across it."""
        second = np.einsum("mj,mjab->mab", self.face_curvature(x, added), self._conormals)
        trace = np.trace(second, axis1=1, axis2=2)[:, None, None]
        return self.rigidity * ((1 - self.poisson) * second + self.poisson * trace * np.eye(2))

    def material_operator(self, x: NDArray) -> LinearOperator:
        """Product of the material Hessian at x, the rotations eliminated, with velocities (n, 3)."""
        at = np.array(x)
        return lambda v: self.pulled_back(at, self.moments(self.turned(at, v)))


def plate_matrices(length: NDArray, area: NDArray, rigidity: float, poisson: float) -> NDArray[np.float64]:
    """(m, 3, 3) second derivatives of the bending energy of faces by the rotations p of their sides.

    Parameters
    ----------
    length : (m, 3) ndarray
        Lengths of the sides of the faces, in m.
    area : (m,) ndarray
        In m^2.
    """
    square = length**2
    doubled = 0.5 * (square.sum(axis=1)[:, None] - 2 * np.roll(square, -2, axis=1))
    # doubled[:, j]: product of sides j and j + 1 as vectors out of their common corner
    inner = np.zeros((len(length), 3, 3))  # l_j l_k m_j . m_k
    for j in range(3):
        k = (j + 1) % 3
        inner[:, j, j] = square[:, j]
        inner[:, j, k] = inner[:, k, j] = -doubled[:, j]
    outer = length[:, :, None] * length[:, None, :]
    return (rigidity / area)[:, None, None] * ((1 - poisson) * inner**2 / outer + poisson * outer)


def conormal_products(length: NDArray, area: NDArray) -> NDArray[np.float64]:
    """(m, 3, 2, 2) products l m m^T / A of the conormals m of the sides, with lengths l (m, 3) and areas A.

    The axes of a face are its first side and the direction perpendicular to it.
    """
    a, b, c = length.T
    along = (a**2 + c**2 - b**2) / (2 * a)  # apex over the first side, at height h
    height = 2 * area / a
    zero = np.zeros_like(a)
    outward = np.stack(  # l m: the sides turned by -90 degrees
        [np.stack([zero, -a], 1), np.stack([height, a - along], 1), np.stack([-height, along], 1)], axis=1
    )
    scale = 1 / (length * area[:, None])
    return scale[:, :, None, None] * outward[:, :, :, None] * outward[:, :, None, :]


def side_corners(topology: Topology) -> NDArray[np.int64]:
    """Tail, head and apex of every side.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    (3m, 3) ndarray of int64
    """
    apex = np.roll(np.asarray(topology.faces), -2, axis=1).ravel()
    return np.stack([topology.side_tail, topology.side_head, apex], axis=1)


def inward_directions(x: NDArray, corner: NDArray) -> NDArray[np.float64]:
    """Unit vectors perpendicular to sides, into their faces.

    Parameters
    ----------
    x : (n, 3) ndarray of float64
    corner : (c, 3) ndarray of int64
        Tail, head and apex of each side.

    Returns
    -------
    (c, 3) ndarray of float64
    """
    tail, head, apex = (x[corner[:, k]] for k in range(3))
    u = unit_vectors(head - tail)
    return unit_vectors(tangential(apex - tail, u))


def one_sided_frame(x: NDArray, corner: NDArray, direction: NDArray) -> HingeFrame:
    """Hinges between faces and half planes of fixed direction through their sides.

    Only the face moves, so gradient and Hessian have no terms of a second face.

    Parameters
    ----------
    x : (n, 3) ndarray of float64
    corner : (c, 3) ndarray of int64
        Tail, head and apex of each side.
    direction : (c, 3) ndarray of float64
        Unit vectors perpendicular to the sides, away from the half planes.

    Returns
    -------
    HingeFrame
    """
    c = len(corner)
    tail, head, apex = x[corner[:, 0]], x[corner[:, 1]], x[corner[:, 2]]
    length = np.sqrt(dot((head - tail).T, (head - tail).T))[:, None]
    points = np.concatenate([tail, head, apex, tail - length * direction])
    f = hinge_frame(points, np.arange(4 * c).reshape(4, c).T)
    return replace(f, nt=np.zeros_like(f.nt), ht=np.full(c, np.inf), st=np.zeros(c))
