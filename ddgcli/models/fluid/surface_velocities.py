"""The discrete velocities of an incompressible flow on a surface: stream functions and vorticities.

A velocity is a flux U through every edge (from the left of the edge to its right), closed around every face:
it is constant in each face and its divergence vanishes exactly. It is the derivative of a stream function phi
(with prescribed values on the boundary, 0 on walls) plus a combination of harmonic flows:

    U = d phi + sum_j c_j h_j,      u = grad phi x n,      vorticity = - Laplacian phi,

positive where the flow turns counter-clockwise seen from the tip of the normal. Everything is intrinsic: only
the topology and the side lengths are read.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.geometry.intrinsic import face_area
from ddgcli.geometry.unfolding import corner_position, unfold
from ddgcli.linalg.constrain import Dirichlet
from ddgcli.mesh.intrinsic_mesh import SurfaceMesh
from ddgcli.mesh.ragged import unique_keys
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.models.fluid.boundary_motion import InTime
from ddgcli.models.fluid.boundary_velocity import BoundaryVelocity
from ddgcli.models.fluid.cells import cell_area
from ddgcli.models.fluid.flow_mesh import require_flow
from ddgcli.models.fluid.natural_outflow import NaturalOutflow
from ddgcli.operators.laplacian import stiffness


@dataclass(eq=False)
class SurfaceVelocities:
    """Velocities on one surface.

    Parameters
    ----------
    mesh : TriangleMesh or IntrinsicMesh
        Oriented, manifold, every face with area.
    harmonic : (b, e) ndarray
        Orthonormal harmonic flows as fluxes; (0, e) where the scene has none.
    timer : callable, optional
        Makes the context manager in which a system is solved, for accounts of time.
    boundary_values : (n,) ndarray, optional
        Stream function on the boundary vertices (others are not read): the flux that enters between two of
        them is the difference of their values. Default 0: walls.
    open_vertices : (n,) ndarray of bool, optional
        Boundary vertices whose stream function is free (natural outflow): no tangential velocity there.
    open_sides : (s, 2) ndarray, optional
        Tail and head of the boundary sides of natural outflows, the surface on the left.
    to_space : callable, optional
        Turns face velocities in planar frames (m,) into vectors in space (m, 3), for observations.
    name : str
    values_in_time : InTime, optional
        Boundary values that depend on time; `boundary_values` are those of the start.
    prescribed_velocity : BoundaryVelocity, optional
        Velocities at boundary vertices that frames and pressures take.
    """

    mesh: SurfaceMesh
    harmonic: NDArray[np.float64]
    timer: Callable[[], AbstractContextManager[Any]] = nullcontext
    boundary_values: NDArray[np.float64] | None = None
    open_vertices: NDArray[np.bool_] | None = None
    open_sides: NDArray[np.int64] | None = None
    to_space: Callable[[NDArray], NDArray] | None = None
    name: str = ""
    values_in_time: InTime | None = None
    prescribed_velocity: BoundaryVelocity | None = None

    def __post_init__(self) -> None:
        require_flow(self.mesh)
        topology = self.mesh.topology
        self.faces = topology.faces
        self.corners = np.ascontiguousarray(self.faces.T)  # (3, m): columns are read one by one
        self.n = topology.n_vertices
        self.mass = cell_area(self.mesh)
        self.inverse_mass = np.divide(1.0, self.mass, out=np.zeros(self.n), where=self.mass > 0)
        self.inside = topology.referenced_vertex & ~topology.boundary_vertex
        self.stiffness = stiffness(self.mesh)
        fixed = ~self.inside | self._pinned()
        if self.open_vertices is not None:
            fixed &= ~self.open_vertices
        solver = Dirichlet(self.stiffness, np.flatnonzero(fixed))
        self.free, self.factor = solver.free, solver.factor
        self.rim = np.flatnonzero(topology.boundary_vertex & fixed)  # where the stream function is given
        self.lift = self._lift(solver, self.boundary_values)
        self.lift_in_time: InTime | None = None
        if self.values_in_time is not None:
            values = self.values_in_time
            self.lift_in_time = InTime(lambda time: self._lift(solver, values.at(time)), values.times)
        corner = corner_position(unfold(self.mesh))
        complex_corner = corner[..., 0] + 1j * corner[..., 1]
        # planar frame of each face; side j runs from corner j to corner j+1
        self.corner = complex_corner
        self.side = complex_corner[:, NEXT] - complex_corner
        self.area = face_area(self.mesh.side_length)
        self.side_edge = topology.side_edge
        self.side_sign = topology.side_sign.astype(np.float64)
        self.open_stream_functions = np.zeros((0, self.n))  # (b, n): minus what the harmonic flows have
        if self.open_sides is not None and len(self.harmonic):
            self.harmonic, self.open_stream_functions = self._orthogonal_to_open_flows(self.harmonic)

    def _lift(self, solver: Dirichlet, values: NDArray | None) -> NDArray[np.float64] | None:
        """(n,) stream function without vorticity that has the boundary values; None for walls."""
        if values is None:
            return None
        on_boundary = self.mesh.topology.boundary_vertex
        return solver.solve(np.where(on_boundary, values, 0.0)[solver.fixed])

    def lift_at(self, time: float) -> NDArray[np.float64] | None:
        """(n,) stream function without vorticity that the boundary prescribes at a time; None for walls."""
        return self.lift if self.lift_in_time is None else self.lift_in_time.at(time)

    @property
    def lifts(self) -> list[NDArray[np.float64]]:
        """The (n,) `lift_at` some times of the run; none between walls."""
        times = [0.0] if self.lift_in_time is None else self.lift_in_time.times
        return [lift for lift in map(self.lift_at, times) if lift is not None]

    @cached_property
    def stream_flux(self) -> NDArray[np.float64]:
        """(m, 3) largest sizes in the run of the fluxes of the flow that the boundary prescribes [m^2/s]."""
        sizes = (np.abs(self.side_flux(lift, np.zeros(0))) for lift in self.lifts)
        return reduce(np.maximum, sizes, np.zeros_like(self.side_sign))

    @cached_property
    def largest_stream_flux(self) -> float:
        """Largest flux through a side of the flow without vorticity that the boundary prescribes [m^2/s]."""
        return float(self.stream_flux.max(initial=0.0))

    def _orthogonal_to_open_flows(self, harmonic: NDArray) -> tuple[NDArray, NDArray]:
        """(b, e) harmonic flows that also fulfil the condition of natural outflows, orthonormal again.

        With the stream functions (b, n) that this takes from them.
        """
        ends = self.mesh.topology.edges
        flows, phi = np.array(harmonic), np.zeros((len(harmonic), self.n))
        for j in range(len(flows)):
            around = self.circulation_around(self.edge_inner * flows[j])
            phi[j, self.free] = self.factor.solve(around[self.free])
            flows[j] -= phi[j, ends[:, 1]] - phi[j, ends[:, 0]]
        lower = np.linalg.cholesky(flows @ (self.edge_inner * flows).T)
        return np.linalg.solve(lower, flows), np.linalg.solve(lower, phi)

    @cached_property
    def outflow(self) -> NaturalOutflow | None:
        """Sides of natural outflows; None without them."""
        sides, vertices = self.open_sides, self.open_vertices
        if sides is None or vertices is None or not len(sides):
            return None
        return NaturalOutflow(self.mesh, sides, vertices)

    def _pinned(self) -> NDArray[np.bool_]:
        """One vertex of every component without boundary."""
        topology = self.mesh.topology
        label = topology.vertex_component
        pinned = np.zeros(self.n, dtype=bool)
        vertices = np.flatnonzero(label >= 0)
        _, first = np.unique(label[vertices], return_index=True)
        pinned[vertices[first]] = True
        open_ = unique_keys(label[topology.boundary_vertex])
        pinned[np.isin(label, open_)] = False
        return pinned

    @cached_property
    def edge_inner(self) -> NDArray[np.float64]:
        """(e,) cotangent star: the inner product of closed fluxes is a' star b."""
        opposite = -(self.side[:, NEXT] * np.conj(self.side[:, PREVIOUS])).real  # at corner j+2
        cotan = opposite / (2.0 * self.area[:, None])
        n_edges = self.mesh.topology.n_edges
        return 0.5 * sum_by_index(self.side_edge, cotan, n_edges)

    # ------------------------------------------------------------------ from vorticity to velocity

    def stream_function(self, vorticity: NDArray, time: float = 0.0) -> NDArray[np.float64]:
        """(n,) phi of integrated vorticity (n,), with the boundary values; pinned on closed components."""
        phi, lift = self.stream_function_change(vorticity), self.lift_at(time)
        return phi if lift is None else phi + lift

    def stream_function_change(self, vorticity: NDArray) -> NDArray[np.float64]:
        """(n,) linear part of `stream_function`: what a change of the vorticity adds."""
        phi = np.zeros(self.n)
        if len(self.free):
            with self.timer():
                phi[self.free] = self.factor.solve(vorticity[self.free], refine=False)
        return phi

    def side_flux(self, phi: NDArray, coefficients: NDArray) -> NDArray[np.float64]:
        """(m, 3) flux through side j, along which phi rises by it."""
        first, second, third = phi.take(self.corners)
        flux = np.stack([second - first, third - second, first - third]).T
        if len(coefficients):
            flux += (coefficients @ self.harmonic)[self.side_edge] * self.side_sign
        return flux

    def edge_flux(self, phi: NDArray, coefficients: NDArray) -> NDArray[np.float64]:
        """(e,) flux through every edge."""
        ends = self.mesh.topology.edges
        flux = phi[ends[:, 1]] - phi[ends[:, 0]]
        return flux + coefficients @ self.harmonic if len(coefficients) else flux

    def face_velocity(self, side_flux: NDArray) -> NDArray[np.complex128]:
        """(m,) velocity in the planar frame of each face."""
        first, last = side_flux[:, 0], side_flux[:, 2]
        return (first * self.side[:, 2] - last * self.side[:, 0]) / (2.0 * self.area)

    def centred(self, phi: NDArray) -> NDArray[np.float64]:
        """phi with mean zero on every component without boundary."""
        topology = self.mesh.topology
        label, count = topology.vertex_component, topology.n_components
        in_component = label >= 0
        weight = sum_by_index(label[in_component], self.mass[in_component], count)
        mean = sum_by_index(label[in_component], (self.mass * phi)[in_component], count) / weight
        mean[unique_keys(label[topology.boundary_vertex])] = 0.0
        return np.where(in_component, phi - mean[np.maximum(label, 0)], 0.0)

    # ------------------------------------------------------------------ from velocity to vorticity

    def circulation_around(self, edge_circulation: NDArray) -> NDArray[np.float64]:
        """(n,) sum of (e,) circulations along dual edges, counter-clockwise around every vertex."""
        ends = self.mesh.topology.edges
        head = sum_by_index(ends[:, 1], edge_circulation, self.n)
        return head - sum_by_index(ends[:, 0], edge_circulation, self.n)

    def of_face_velocity(
        self, velocity: NDArray, along_boundary: NDArray | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Vorticity (n,) and harmonic coefficients of any face velocities (m,): the nearest flow has them.

        At boundary vertices the cell is closed by the boundary sides, with the velocity of their faces
        (nothing at natural outflows) or `along_boundary` (s, 2), integrals for tail and head.
        """
        if along_boundary is None:
            along_boundary = self._along_boundary(velocity)
        closing, at_outflows = self.of_boundary_integrals(along_boundary)
        return self._around(velocity) + closing, self.harmonic_part(velocity) + at_outflows

    def vorticity_of_face_velocity(self, velocity: NDArray) -> NDArray[np.float64]:
        """(n,) vorticity alone of `of_face_velocity`."""
        closing = sum_by_index(self.boundary_sides[2], self._along_boundary(velocity), self.n)
        return self._around(velocity) + closing

    def _around(self, velocity: NDArray) -> NDArray[np.float64]:
        """(n,) circulation of face velocities around the cells, by sides opposite corners."""
        along = (velocity[:, None] * np.conj(self.side[:, NEXT])).real
        return 0.5 * sum_by_index(self.faces, along, self.n)

    def _along_boundary(self, velocity: NDArray) -> NDArray[np.float64]:
        """(s, 2) integrals of face velocities along the boundary sides, for tail and head."""
        face, k, ends = self.boundary_sides
        along = np.repeat(0.5 * (velocity[face] * np.conj(self.side[face, k])).real[:, None], 2, axis=1)
        if self.open_vertices is not None:  # a flow has no tangential velocity there
            along[self.open_vertices[ends]] = 0.0
        return along

    def of_boundary_integrals(self, along: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Vorticity (n,) and harmonic coefficients (b,) of integrals along the boundary.

        `along` (s, 2) is the velocity's along `boundary_sides`, weighted by the hat functions of tail and
        head. It closes the cells there. Harmonic flows that cross natural outflows have its share, too, so
        that a gradient has neither.
        """
        vorticity = sum_by_index(self.boundary_sides[2], along, self.n)
        if not len(self.open_stream_functions):
            return vorticity, np.zeros(len(self.harmonic))
        return vorticity, -(self.open_stream_functions @ vorticity)

    @cached_property
    def boundary_sides(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Face (s,), number (s,) and tail and head (s, 2) of the sides along the boundary."""
        face, k = np.nonzero(self.mesh.topology.side_twin < 0)
        return face, k, np.stack([self.faces[face, k], self.faces[face, NEXT[k]]], axis=1)

    def harmonic_part(self, velocity: NDArray) -> NDArray[np.float64]:
        """(b,) inner products of face velocities with the harmonic flows.

        The transpose of `face_velocity` acts on the velocity, and not on each flow.
        """
        if not len(self.harmonic):
            return np.zeros(0)
        sides = [0, 2]
        by_flux = 0.5 * (velocity[:, None] * np.conj(self.side[:, [2, 0]])).real * [1.0, -1.0]
        by_edge = sum_by_index(
            self.side_edge[:, sides], by_flux * self.side_sign[:, sides], self.harmonic.shape[1]
        )
        return self.harmonic @ by_edge
