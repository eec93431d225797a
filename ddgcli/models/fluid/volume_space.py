"""The discrete velocities of an incompressible flow in a tetrahedral mesh, and what is read off them.

A velocity is a flux U through every face, closed around every cell: it is constant in each cell and its
divergence vanishes exactly. The flow nearest to any cell velocities v is v minus the broken gradient of a
potential with one value per face (Crouzeix and Raviart, 1973):

    (grad p, grad q) = (v, grad q) - int g q,      u = v - grad p,

whose flux through a face is the same from both sides, and g on the boundary. The space holds the harmonic
flows of domains with holes and handles too. The circulation around the polygon through the centroids of the
faces at an edge is the inner product with the curl of the edge's Whitney form, which no gradient changes.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from ddgcli.errors import MeshError
from ddgcli.linalg.constrain import Dirichlet, components
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.requirements import require_sized_cells
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.tet_mesh import TET_FACES, TetMesh
from ddgcli.mesh.vectors import row_cross, row_dot
from ddgcli.models.fluid.boundary_motion import InTime
from ddgcli.models.fluid.state import TIME, FluidState
from ddgcli.models.fluid.volume_conditions import VolumeConditions, walls
from ddgcli.operators.averages import vertex_measure
from ddgcli.operators.dec import Complex, complex_of
from ddgcli.simulation.model import Observation

MAX_FIT_GAIN = 3.0  # of a fitted velocity over those of the cells
SINGULAR_SHIFT = 1e-9  # relative, keeps the equations of vertices with few cells solvable


@dataclass(eq=False)
class VolumeSpace:
    """Velocities in one tetrahedral mesh.

    Parameters
    ----------
    mesh : TetMesh
        Every tetrahedron of positive volume.
    conditions : VolumeConditions, optional
        Default: walls without friction.
    timer : callable, optional
        Makes the context manager in which a system is solved.
    name : str
    """

    mesh: TetMesh
    conditions: VolumeConditions | None = None
    timer: Callable[[], AbstractContextManager[Any]] = nullcontext
    name: str = ""
    dimension: ClassVar[int] = 3

    def __post_init__(self) -> None:
        require_sized_cells(self.mesh, "fluid-sim")
        self.complex: Complex = complex_of(self.mesh)
        self.cells, self.volume = self.mesh.tetrahedra, self.mesh.signed_volume
        self.n = self.mesh.n_vertices
        self.cell_face, self.sign = self.complex.cell_face, self.complex.cell_face_sign
        self.n_faces = self.complex.counts[2]
        corner = self.mesh.points[self.cells]
        self.centre = corner.mean(axis=1)
        wall = corner[:, TET_FACES]  # (k, 4, 3, 3)
        self.face_centre = wall.mean(axis=2)  # (k, 4, 3), of the faces of each cell
        # (k, 4, 3) outward area vectors; the slopes of the barycentric coordinates are -1/(3 V) of them
        self.area = 0.5 * row_cross(wall[:, :, 1] - wall[:, :, 0], wall[:, :, 2] - wall[:, :, 0])
        self.slope = -self.area / (3.0 * self.volume[:, None, None])
        self.mass = vertex_measure(self.cells, self.volume, self.n)
        self.inverse_mass = np.divide(1.0, self.mass, out=np.zeros(self.n), where=self.mass > 0)
        if self.conditions is None:
            self.conditions = walls(self)

    @cached_property
    def solver(self) -> Dirichlet:
        """Factorisation of the potential's matrix, made once."""
        return Dirichlet(self.face_stiffness, np.flatnonzero(self._fixed_potentials()))

    @property
    def factor(self) -> Factor:
        """Factorisation of the same matrix, over the potentials that are not fixed."""
        return self.solver.factor

    @cached_property
    def face_stiffness(self) -> csr_array:
        """(F, F) positive semidefinite Laplacian of functions linear in each cell; one value per face."""
        local = np.einsum("kia,kja->kij", self.area, self.area) / self.volume[:, None, None]
        rows = np.repeat(self.cell_face, 4, axis=1).ravel()
        columns = np.tile(self.cell_face, (1, 4)).ravel()
        return coo_array((local.ravel(), (rows, columns)), shape=(self.n_faces,) * 2).tocsr()

    def _fixed_potentials(self) -> NDArray[np.bool_]:
        """Faces of natural outflows, and one face of every component without."""
        fixed, label = np.array(self._conditions.natural), self.face_component
        names, first = np.unique(label, return_index=True)
        closed = ~np.isin(names, label[fixed])
        fixed[first[closed]] = True
        return fixed

    @cached_property
    def face_component(self) -> NDArray[np.int64]:
        """(F,) index of the component of every face; cells that share a face are connected."""
        rows = np.repeat(self.cell_face[:, 0], 3)
        links = coo_array(
            (np.ones(len(rows)), (rows, self.cell_face[:, 1:].ravel())), shape=(self.n_faces,) * 2
        )
        return components(links)[1]

    @property
    def _conditions(self) -> VolumeConditions:
        if self.conditions is None:
            raise MeshError("the space has no boundary conditions")
        return self.conditions

    # ------------------------------------------------------------------ velocities

    def broken_gradient(self, values: NDArray) -> NDArray[np.float64]:
        """(k, 3) slopes of functions linear in each cell, by their values (k, 4) at face centroids."""
        return np.einsum("ki,kia->ka", values, self.area) / self.volume[:, None]

    def projected(
        self, velocity: NDArray, inflow: bool = True, head: NDArray | None = None, time: float = 0.0
    ) -> NDArray[np.float64]:
        """(F,) fluxes of the discrete flow nearest to cell velocities (k, 3).

        Parameters
        ----------
        velocity : (k, 3) ndarray
        inflow : bool
            Whether the flow has the prescribed fluxes through the boundary (else none: changes of a flow).
        head : (F,) ndarray, optional
            Potential on the faces of natural outflows.
        time : float
            Of the prescribed fluxes.
        """
        potential = self.potential(velocity, inflow, head, time)
        nearest = velocity - self.broken_gradient(potential[self.cell_face])
        outward = np.einsum("ka,kia->ki", nearest, self.area) * self.sign
        return sum_by_index(self.cell_face, outward, self.n_faces) / self.face_count

    def potential(
        self, velocity: NDArray, inflow: bool = True, head: NDArray | None = None, time: float = 0.0
    ) -> NDArray[np.float64]:
        """(F,) values at face centroids of the potential that `projected` takes off."""
        through = np.einsum("ka,kia->ki", velocity, self.area)
        rhs = sum_by_index(self.cell_face, through, self.n_faces)
        if inflow:
            rhs -= self._conditions.flux_at(time)
        fixed = self.solver.fixed
        values = np.zeros(len(fixed)) if head is None else head[fixed]
        with self.timer():
            return self.solver.solve(values, rhs, refine=False)

    @cached_property
    def face_count(self) -> NDArray[np.int64]:
        """(F,) number of cells at each face."""
        return np.bincount(self.cell_face.ravel(), minlength=self.n_faces)

    def velocity(self, flux: NDArray) -> NDArray[np.float64]:
        """(k, 3) cell velocities of fluxes (F,)."""
        outward = flux[self.cell_face] * self.sign
        apart = self.face_centre - self.centre[:, None]
        return np.einsum("ki,kia->ka", outward, apart) / self.volume[:, None]

    def vertex_means(self, of_cells: NDArray) -> NDArray[np.float64]:
        """(n, 3) values at the vertices of the linear fields that fit cell vectors (k, 3) round them best."""
        return self._recovery @ of_cells

    def vertex_velocity(self, velocity: NDArray, time: float) -> NDArray[np.float64]:
        """(n, 3) `vertex_means` of cell velocities (k, 3), and what the boundary prescribes at a time."""
        means = self.vertex_means(velocity)
        if self._conditions.at_vertices is not None:
            vertices, there = self._conditions.at_vertices.at(time)
            means[vertices] = there
        return means

    @cached_property
    def _recovery(self) -> csr_array:
        """(n, k) least squares by volume; means where a fit is impossible or would amplify noise."""
        vertex, cell = self.cells.ravel(), np.repeat(np.arange(len(self.cells)), 4)
        apart = self.centre[cell] - self.mesh.points[vertex]
        size = np.cbrt(np.maximum(self.mass, np.finfo(float).tiny))[vertex]
        terms = np.column_stack([np.ones(len(cell)), apart / size[:, None]])
        weight = self.volume[cell]
        moment = np.zeros((self.n, 4, 4))
        for a in range(4):
            for b in range(4):
                moment[:, a, b] = sum_by_index(vertex, weight * terms[:, a] * terms[:, b], self.n)
        total = np.maximum(moment[:, 0, 0], np.finfo(float).tiny)
        moment = moment / total[:, None, None] + SINGULAR_SHIFT * np.eye(4)
        first = np.linalg.solve(moment, np.tile(np.eye(4)[:, :1], (self.n, 1, 1)))[..., 0]
        share = weight / total[vertex] * row_dot(terms, first[vertex])
        gain, whole = sum_by_index(vertex, np.abs(share), self.n), sum_by_index(vertex, share, self.n)
        usable = ((gain <= MAX_FIT_GAIN) & (np.abs(whole - 1.0) < 1e-6))[vertex]
        share = np.where(usable, share / whole[vertex], weight / total[vertex])
        return csr_array((share, (vertex, cell)), shape=(self.n, len(self.cells)))

    def vorticity(self, velocity: NDArray, time: float = 0.0) -> NDArray[np.float64]:
        """(n, 3) weak curl of cell velocities, lumped; closed by the velocity of walls with friction."""
        turning = -row_cross(self.slope, velocity[:, None]) * self.volume[:, None, None]
        total = sum_by_index(self.cells, turning, self.n)
        cell, i = self.boundary
        walls = self._conditions.velocity_at(time)
        along = np.where(self._conditions.friction[:, None], walls, velocity[cell])
        rim = row_cross(self.area[cell, i], along) / 3.0
        vertex = self.cells[cell[:, None], TET_FACES[i]]
        total += sum_by_index(vertex, np.repeat(rim[:, None], 3, axis=1), self.n)
        return total * self.inverse_mass[:, None]

    @cached_property
    def boundary(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Cell and local index of every boundary face."""
        cell, i = np.nonzero(self.face_count[self.cell_face] == 1)
        return cell, i

    def edge_circulation(self, velocity: NDArray) -> NDArray[np.float64]:
        """(e,) circulation around every edge, through the centroids of its faces."""
        from ddgcli.geometry.cells import TET_EDGES

        turns = np.stack([row_cross(self.slope[:, a], self.slope[:, b]) for a, b in TET_EDGES], axis=1)
        local = 2.0 * np.einsum("ka,kja->kj", velocity, turns) * self.volume[:, None]
        local *= self.complex.cell_edge_sign
        return sum_by_index(self.complex.cell_edge, local, self.complex.counts[1])

    # ------------------------------------------------------------------ states

    def rest(self) -> dict[str, NDArray]:
        """Fluxes (F,) of the flow without circulation that the boundary has."""
        still = np.zeros((len(self.cells), 3))
        return {"flux": self.projected(still) if self._conditions.is_open else np.zeros(self.n_faces)}

    @cached_property
    def stream_in_time(self) -> InTime | None:
        """Fluxes (F,) of the flow without circulation that the boundary has at a time; None if constant."""
        flux, still = self._conditions.flux_in_time, np.zeros((len(self.cells), 3))
        if flux is None:
            return None
        return InTime(lambda time: self.projected(still, time=time), flux.times)

    def restated(self, state: FluidState, time: float) -> FluidState:
        """The state with what the boundary prescribes at another time, its circulations as they were."""
        stream = self.stream_in_time
        if stream is None:
            return state
        flux = state["flux"] + (stream.at(time) - stream.at(state.time))
        return state.replaced(flux=flux, **{TIME: np.array([time])})

    def cell_velocity(self, state: FluidState) -> NDArray[np.float64]:
        """(k, 3) cell velocities of a state, computed once."""
        if "velocity" not in state.memo:
            state.memo["velocity"] = self.velocity(state["flux"])
        return state.memo["velocity"]

    def accelerated(self, state: FluidState, change: NDArray) -> FluidState:
        """The state with changes of velocity (k, 3) added, but for their gradient part."""
        return state.replaced(flux=state["flux"] + self.projected(change, inflow=False))

    def kinetic_energy(self, velocity: NDArray) -> float:
        return 0.5 * float(np.sum(self.volume[:, None] * velocity**2))

    def energy(self, state: FluidState) -> float:
        return self.kinetic_energy(self.cell_velocity(state))

    def _enstrophy(self, vorticity: NDArray) -> float:
        return 0.5 * float(np.sum(self.mass * row_dot(vorticity, vorticity)))

    def total_enstrophy(self, state: FluidState) -> float:
        return self._enstrophy(self.vorticity(self.cell_velocity(state), state.time))

    @property
    def measure(self) -> float:
        return float(self.volume.sum())

    @property
    def size(self) -> float:
        return float(np.cbrt(self.measure))

    def distance(self, a: FluidState, b: FluidState, start: FluidState, least_energy: float = 0.0) -> float:
        """L2 distance of the velocities, relative to the larger of `start` and `b`."""
        apart = self.kinetic_energy(self.cell_velocity(a) - self.cell_velocity(b))
        energy = max(self.energy(start), self.energy(b), least_energy)
        return float(np.sqrt(apart / (energy or 1.0)))

    def observed(self, state: FluidState) -> Observation:
        """Vorticity and velocity at vertices; energies, divergence and the sums of circulations."""
        velocity = self.cell_velocity(state)
        omega = self.vorticity(velocity, state.time)
        circulation = self.edge_circulation(velocity)
        around = self.complex.derivatives[0].T @ circulation
        net = (state["flux"][self.cell_face] * self.sign).sum(axis=1)
        size = float(np.abs(state["flux"]).max(initial=0.0))
        scalar = {
            "kinetic_energy": self.energy(state),
            "enstrophy": self._enstrophy(omega),
            "total_vorticity": float(np.abs(around).max(initial=0.0)),
            "absolute_vorticity": float(np.abs(circulation).sum()),
            "divergence": float(np.abs(net).max(initial=0.0)) / (size or 1.0),
        }
        vertex = {"vorticity": omega, "velocity": self.vertex_velocity(velocity, state.time)}
        vertex["speed"] = np.linalg.norm(vertex["velocity"], axis=1)
        return Observation(None, vertex, scalar)

    def circulation_terms(self) -> tuple[float, float]:
        """Bounds on the sum of circulations and on the enstrophy of a flow of kinetic energy 1/2."""
        length = np.linalg.norm(self.area, axis=2).sum(axis=1) / (3.0 * self.volume)
        reach = float(np.sqrt(self.volume).sum()) * float(length.max(initial=0.0))
        return reach, float((length**2).max(initial=0.0))

    def assembled(self) -> dict[str, Any]:
        """Counts for a dry run."""
        return {"vertices": self.n, "tetrahedra": len(self.cells), "fluxes": self.n_faces}
