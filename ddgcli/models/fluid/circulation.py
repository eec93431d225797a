"""Advection by circulation: each dual loop is carried backwards and takes the circulation found there.

By Kelvin's theorem the circulation along a loop that moves with the flow stays. The circulation of each dual
edge is measured once and counted with opposite signs for its two loops, so that the total vorticity is
exact; the new flow is the one whose circulations against all discrete flows agree (a projection).

The velocity between the centres of faces is interpolated, which smooths a little at every step, however
short: long steps lose less. On acute triangles a step of length zero is the identity.

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
        self.dual = hinge + self.turn * (centre[self.right] - head) - centre[self.left]

    def deformation_rate(self, velocity: NDArray) -> float:
        """Largest difference of the velocities on both sides of an edge, over the size of the two faces."""
        difference = np.abs(velocity[self.left] - self.turn * velocity[self.right])
        size = np.sqrt(0.5 * (self.space.area[self.left] + self.space.area[self.right]))
        return float((difference / size).max(initial=0.0))

    def edge_circulation(self, velocity: NDArray, dt: float) -> NDArray[np.float64]:
        """(e,) circulation along every dual edge carried backwards by dt; 0 on the boundary."""
        transport = self.transport
        nodes = transport.nodes(velocity)
        every = np.arange(len(velocity))
        moved = transport.backwards(nodes, every, transport.centre, velocity, dt)
        left, right = self.left, self.right
        span = self.dual + self.turn * moved.shift[right] - moved.shift[left]
        mean = 0.5 * (moved.velocity[left] + self.turn * moved.velocity[right])
        found = np.zeros(self.space.mesh.topology.n_edges)
        found[self.edge] = (mean * np.conj(span)).real
        return found

    def step(
        self, vorticity: NDArray, coefficients: NDArray, dt: float, evolve_harmonic: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Vorticity and harmonic coefficients after dt."""
        space = self.space
        phi = space.stream_function(vorticity)
        velocity = space.face_velocity(space.side_flux(phi, coefficients))
        found = self.edge_circulation(velocity, dt)
        after = space.circulation_around(found)
        after = np.where(space.inside, after, self._along_walls(vorticity, velocity, dt))
        self._keep_total(after, vorticity)
        if evolve_harmonic and len(coefficients):
            coefficients = space.harmonic @ found
        return after, coefficients

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
