"""Advection by circulation: each dual loop is carried backwards and takes the circulation found there.

By Kelvin's theorem the circulation along a loop that moves with the flow stays. The circulation of each dual
edge is measured once and counted with opposite signs for its two loops, so that the total vorticity is
exact; the new flow is the one whose circulations against all discrete flows agree (a projection).

The velocity between the centres of faces is reconstructed in two ways: continuous, which smooths as an upwind
scheme does, and with a slope in each face, which is sharp but may grow. A step mixes in just as much of the
first as keeps energy and enstrophy from rising (where the first alone does). A step of length zero is the
identity.

S. Elcott et al., "Stable, circulation-preserving, simplicial fluids", ACM Transactions on Graphics, 2007.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.models.fluid.space import FlowSpace
from ddgcli.models.fluid.transport import Transport


class CirculationAdvection:
    """Dual edges of a surface, ready for steps of any length."""

    def __init__(self, space: FlowSpace) -> None:
        self.space = space
        self.transport = Transport(space)
        topology = space.mesh.topology
        twin = topology.side_twin.ravel()
        side = np.flatnonzero((twin >= 0) & (topology.side_sign.ravel() > 0))
        other = twin[side]
        self.edge = topology.side_edge.ravel()[side]
        self.left, self.right = side // 3, other // 3
        # from the frame of the right face to that of the left, unfolded about the edge
        turn = -space.side.ravel()[side] / space.side.ravel()[other]
        self.turn = turn / np.abs(turn)
        head = space.corner[self.right, (other % 3 + 1) % 3]
        hinge = space.corner.ravel()[side]
        centre = self.transport.centre_position
        far = hinge + self.turn * (centre[self.right] - head)
        middle = hinge + 0.5 * space.side.ravel()[side]
        self.near_part, self.far_part = middle - centre[self.left], far - middle
        self.share = self.transport.share.ravel()[side]
        size = np.sqrt(0.5 * (space.area[self.left] + space.area[self.right]))
        self.size = np.maximum(size, 0.5 * np.median(size)) if len(size) else size

    def deformation_rate(self, velocity: NDArray) -> float:
        """Largest difference of the velocities on both sides of an edge, over the size of the two faces.

        Faces far smaller than most count as larger: what folds among them is lost in their neighbours.
        """
        difference = np.abs(velocity[self.left] - self.turn * velocity[self.right])
        return float((difference / self.size).max(initial=0.0))

    def edge_circulations(self, velocity: NDArray, dt: float) -> tuple[NDArray, NDArray]:
        """(e,) circulation along every dual edge carried back by dt, smooth and sharp; 0 on the boundary.

        A dual edge runs from centre to centre through the middle of its side; each half has the velocity met
        by its centre. For dt = 0 this is the circulation of the flow itself, on every mesh.
        """
        transport = self.transport
        nodes = transport.nodes(velocity)
        every = np.arange(len(velocity))
        moved = transport.backwards(nodes, every, transport.centre, velocity, dt)
        left, right = self.left, self.right
        stretch = self.turn * moved.shift[right] - moved.shift[left]
        near = np.conj(self.near_part + self.share * stretch)
        far = np.conj(self.far_part + (1.0 - self.share) * stretch) * self.turn
        found = np.zeros((2, self.space.mesh.topology.n_edges))
        for row, met in enumerate((moved.velocity, moved.sharp)):
            found[row, self.edge] = (met[left] * near + met[right] * far).real
        return found[0], found[1]

    def step(
        self, vorticity: NDArray, coefficients: NDArray, dt: float, evolve_harmonic: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Vorticity and harmonic coefficients after dt."""
        space = self.space
        phi = space.stream_function(vorticity)
        velocity = space.face_velocity(space.side_flux(phi, coefficients))
        smooth, sharp = self.edge_circulations(velocity, dt)
        walls = self._along_walls(vorticity, velocity, dt)
        flows = []
        for found in (sharp, smooth):
            after = np.where(space.inside, space.circulation_around(found), walls)
            self._keep_total(after, vorticity)
            c = space.harmonic @ found if evolve_harmonic and len(coefficients) else coefficients
            flows.append((after, c))
        share = self._least_smoothing(phi, vorticity, coefficients, *flows)
        (a, c), (b, d) = flows
        return a + share * (b - a), c + share * (d - c)

    def _least_smoothing(
        self, phi: NDArray, vorticity: NDArray, coefficients: NDArray,
        sharp: tuple[NDArray, NDArray], smooth: tuple[NDArray, NDArray],
    ) -> float:  # fmt: skip
        """Least share of the smooth flow in a mixture that raises neither energy nor enstrophy; 1 at most."""
        space = self.space
        change, turn = smooth[0] - sharp[0], smooth[1] - sharp[1]
        phi_sharp, phi_change = space.stream_function(sharp[0]), space.stream_function(change)
        start = 2.0 * space.kinetic_energy(phi, vorticity, coefficients)
        energy = (
            phi_sharp @ (space.stiffness @ phi_sharp) + sharp[1] @ sharp[1] - start,
            2.0 * (phi_sharp @ (space.stiffness @ phi_change) + sharp[1] @ turn),
            phi_change @ (space.stiffness @ phi_change) + turn @ turn,
        )
        inverse = space.inverse_mass
        enstrophy = (
            sharp[0] @ (inverse * sharp[0]) - vorticity @ (inverse * vorticity),
            2.0 * (sharp[0] @ (inverse * change)),
            change @ (inverse * change),
        )
        return max(_first_root(*energy), _first_root(*enstrophy))

    def _along_walls(self, vorticity: NDArray, velocity: NDArray, dt: float) -> NDArray[np.float64]:
        """Vorticity of the cells at the boundary: carried along it, point by point."""
        space, transport = self.space, self.transport
        rim = np.flatnonzero(space.mesh.topology.boundary_vertex)
        if len(rim) == 0:
            return vorticity
        nodes = transport.nodes(velocity)
        face, corner = corner_of(space, rim)
        barycentric = np.eye(3)[corner]
        moved = transport.backwards(nodes, face, barycentric, nodes[1][face, corner], dt)
        omega = (vorticity * space.inverse_mass)[space.faces[moved.face]]
        after = np.array(vorticity)
        after[rim] = space.mass[rim] * np.einsum("ij,ij->i", omega, moved.barycentric)
        return after

    def _keep_total(self, after: NDArray, before: NDArray) -> None:
        """What the inner loops of a component gained comes from its boundary cells."""
        space = self.space
        rim = space.mesh.topology.boundary_vertex
        if not rim.any():
            return
        label = space.mesh.topology.vertex_component
        missing = space.component_vorticity(before) - space.component_vorticity(after)
        area = np.bincount(label[rim], weights=space.mass[rim], minlength=len(missing))
        share = np.divide(missing, area, out=np.zeros_like(missing), where=area > 0)
        after[rim] += space.mass[rim] * share[label[rim]]


def corner_of(space: FlowSpace, vertices: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(face, corner) of one face at each vertex."""
    flat = np.full(space.n, -1, dtype=np.int64)
    flat[space.faces.ravel()] = np.arange(space.faces.size)
    return flat[vertices] // 3, flat[vertices] % 3


def _first_root(constant: float, slope: float, curvature: float) -> float:
    """Least t in [0, 1] at which constant + slope t + curvature t^2 is not positive; 1 if there is none."""
    if constant <= 0.0:
        return 0.0
    inside = slope * slope - 4.0 * curvature * constant
    if inside < 0.0 or slope >= 0.0:
        return 1.0
    return min(1.0, 2.0 * constant / (-slope + inside**0.5))
