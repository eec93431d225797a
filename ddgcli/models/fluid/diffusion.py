"""Viscosity: implicit steps of second order for the three meanings it has on a curved surface.

The weak form, for all discrete flows w, is

    (du/dt, w) = - nu [ (curl u, curl w) - m (K u, w) ],

K the Gaussian curvature and m = 0, 1, 2 for the Hodge, the Bochner and the deformation Laplacian (2 div Def,
the physical one): a mode l of the unit sphere decays at nu l(l+1), nu (l(l+1) - 1), nu (l(l+1) - 2).
On a no-slip wall the cell of a boundary vertex is closed by the wall, at rest or in motion along itself; on a
free-slip wall the vorticity vanishes, which is the natural condition of the weak form.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, csc_array, csr_array, diags_array, eye_array

from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.linalg.eigen import smallest_eigenpairs
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.models.fluid.boundary_motion import InTime
from ddgcli.models.fluid.phases import FlowPhase, FluidSetting, Step
from ddgcli.models.fluid.state import FluidState
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.operators.dec import d0
from ddgcli.simulation.model import Observation

CURVATURE_SHARE = {"hodge": 0.0, "bochner": 1.0, "deformation": 2.0}
SPONGE_RINGS = 8
N_RIGID_TURNS = 3  # independent ones of a sphere, the most that any surface has
ANGLE_ROUNDING = 1e-12
GAMMA = 1.0 - np.sqrt(0.5)
Forces = tuple[NDArray, NDArray]  # rates of change of vorticity (n,) and harmonic coefficients (b,)


@dataclass(eq=False)
class Decay:
    """x' = - G^-1 (A x + b) by the two-stage diagonally implicit method, L-stable and second order.

    Parameters
    ----------
    G, A : (k, k) sparse arrays
        Symmetric; G positive definite.
    b : (k,) ndarray, or 0
    neutral : (k, q) ndarray, optional
        Eigenvectors of A, orthonormal in G, whose eigenvalue counts as zero.

    Notes
    -----
    R. Alexander, "Diagonally implicit Runge-Kutta methods for stiff O.D.E.'s", 1977.
    """

    G: csr_array
    A: csr_array
    b: NDArray[np.float64] | float = 0.0
    neutral: NDArray[np.float64] | None = None
    _factors: dict[float, Factor] = field(default_factory=dict)

    def step(
        self,
        x: NDArray,
        dt: float,
        source: NDArray | float = 0.0,
        b_of_stages: tuple[NDArray, NDArray] | None = None,
    ) -> NDArray[np.float64]:
        """x after a time dt, `source` added to G x'; one factorisation for each step length met.

        `b_of_stages` holds b after GAMMA dt and after dt, where it depends on time.
        """
        if dt not in self._factors:
            if len(self._factors) > 3:
                self._factors.clear()
            self._factors[dt] = Factor(csc_array(self.G + GAMMA * dt * self.A))
        factor = self._factors[dt]
        b_first, b_second = b_of_stages or (self.b, self.b)
        first = factor.solve(source - (self.A @ x + b_first), refine=False)
        between = x + (1.0 - GAMMA) * dt * first
        second = factor.solve(source - (self.A @ between + b_second), refine=False)
        after = x + dt * ((1.0 - GAMMA) * first + GAMMA * second)
        if self.neutral is None:
            return after
        b = self.b if b_of_stages is None else (1.0 - GAMMA) * b_first + GAMMA * b_second
        return after + self.neutral @ (self.neutral.T @ (self.G @ (x - after) + dt * (source - b)))


class VorticityDiffusion:
    """Hodge viscosity on closed surfaces and with free-slip walls: M omega' = - nu L omega."""

    def __init__(self, space: SurfaceSpace, nu: float) -> None:
        self.space = space
        inside = self.inside = np.flatnonzero(space.inside)
        self.decay = Decay(
            diags_array(space.mass[inside]).tocsr(), (nu * space.stiffness[inside][:, inside]).tocsr()
        )

    def boundary_vorticity(self, phi: NDArray, coefficients: NDArray, time: float) -> NDArray[np.float64]:
        """(k,) vorticity of the cells of the space's `rim` vertices: none."""
        return np.zeros(len(self.space.rim))

    def step(
        self,
        vorticity: NDArray,
        coefficients: NDArray,
        dt: float,
        forces: Forces | None = None,
        time: float = 0.0,
        coefficients_time: float | None = None,
    ) -> tuple[NDArray, NDArray]:
        force, mean_force = forces or (np.zeros(self.space.n), 0.0)
        omega, mass = np.zeros_like(vorticity), self.space.mass
        inside = self.inside
        omega[inside] = self.decay.step(vorticity[inside] / mass[inside], dt, force[inside])
        # constants are what the rounding of a long step changes most: dt nu L has no part along them
        after = mass * self.space.centred(omega)
        return after, coefficients + dt * mean_force


class VelocityDiffusion:
    """Every kind, in the unknowns of the velocity: stream function and harmonic coefficients.

    `moving` (n,) is what boundary sides with a prescribed velocity add to the circulation around the cells of
    their vertices, or a function of time; at the vertices `slip` (n,) of free-slip walls the vorticity
    vanishes.
    Unless they `evolve`, harmonic coefficients are constant and act on the stream function as a given flux.
    """

    def __init__(
        self,
        space: SurfaceSpace,
        nu: float,
        kind: str,
        moving: NDArray | InTime | None = None,
        slip: NDArray | None = None,
        evolve: bool = True,
    ) -> None:
        self.space, self.nu, self.evolve = space, nu, evolve
        self.wall, self.in_time = moving, space.lift_in_time is not None or isinstance(moving, InTime)
        self.moving = self.moving_at(0.0)
        self.active = np.ones(space.n) if slip is None else np.where(slip, 0.0, 1.0)
        flows = csr_array(space.harmonic.T)
        derivative = d0(space.mesh.topology).astype(np.float64)[:, space.free]
        basis = block_array([[derivative, flows]]).tocsr() if flows.shape[1] else derivative
        star = diags_array(space.edge_inner)
        self.curl = (d0(space.mesh.topology).astype(np.float64).T @ star @ basis).tocsr()
        gram = block_array(
            [[space.stiffness[space.free][:, space.free], None], [None, eye_array(flows.shape[1])]]
        ) if flows.shape[1] else space.stiffness[space.free][:, space.free]  # fmt: skip
        self.weight = weight = self.active * space.inverse_mass * outflow_friction(space, nu)
        A = self.curl.T @ diags_array(weight) @ self.curl
        share, neutral = CURVATURE_SHARE[kind], None
        self.by_curvature: csr_array | None = None  # rates by fluxes (e,), those of the boundary included
        if share:
            by_curvature = share * (basis.T @ diags_array(curvature_star(space)))
            A = A - by_curvature @ basis
            self.by_curvature = None if space.lift is None else csr_array(by_curvature)
        A = A.tocsr()
        self.matrix = matrix = nu * A
        drag = self._drag(0.0)
        gram, n_free = gram.tocsr(), len(space.free)
        self.coupling = matrix[:n_free, n_free:]
        if not evolve:
            matrix, gram, drag = matrix[:n_free, :n_free], gram[:n_free, :n_free], drag[:n_free]
        if kind == "deformation":
            curvature = face_curvature(space)
            if float((curvature * space.area).max()) > ANGLE_ROUNDING:  # of a flat surface A is not negative
                k = matrix.shape[0]
                neutral = growing_flows(A[:k, :k], gram, share * float(curvature.max()))
        self.decay = Decay(gram, matrix, drag, neutral)

    def free_stream_function(self, vorticity: NDArray) -> NDArray[np.float64]:
        """Stream function at the free vertices, without the part that the boundary values bring."""
        return self.space.factor.solve(vorticity[self.space.free], refine=False)

    def boundary_vorticity(self, phi: NDArray, coefficients: NDArray, time: float) -> NDArray[np.float64]:
        """(k,) vorticity of the cells of the space's `rim` vertices, which the flow determines, in m^2/s.

        `phi` (n,) is the whole stream function, in m^2/s; `coefficients` (b,) are those of harmonic fields.
        """
        rim, (of_phi, of_coefficients) = self.space.rim, self._circulation_at_rim
        circulation = of_phi @ phi + of_coefficients @ coefficients
        wall = self.wall.at(time) if isinstance(self.wall, InTime) else self.wall
        return self.active[rim] * (circulation if wall is None else circulation + wall[rim])

    @cached_property
    def _circulation_at_rim(self) -> tuple[csr_array, csr_array]:
        """Circulations around the cells of the `rim` vertices by stream functions and by coefficients."""
        rim = self.space.rim
        return csr_array(self.space.stiffness[rim]), self.curl[rim, len(self.space.free) :]

    def moving_at(self, time: float, coefficients_time: float | None = None) -> NDArray[np.float64]:
        """(n,) what the boundary adds to the circulation around the cells of its vertices at a time.

        With what it takes from harmonic coefficients that are those of the time `coefficients_time`: walls
        without slip would stop the difference at once, and steps would be of first order.
        """
        wall, lift, space = self.wall, self.space.lift_at(time), self.space
        moving = (
            wall.at(time) if isinstance(wall, InTime) else np.zeros(self.space.n) if wall is None else wall
        )
        if lift is not None:
            moving = moving + space.stiffness @ lift
        shift = self._shift(time, coefficients_time)
        return moving + self.curl[:, len(space.free) :] @ shift if len(shift) else moving

    def _shift(self, time: float, coefficients_time: float | None) -> NDArray[np.float64]:
        """(b,) what a time takes from harmonic coefficients of another; without entries if nothing."""
        space = self.space
        if coefficients_time is None or space.lift_in_time is None or not len(space.harmonic):
            return np.zeros(0)
        return space.lifted_part_at(coefficients_time) - space.lifted_part_at(time)

    def _drag(self, time: float, coefficients_time: float | None = None) -> NDArray[np.float64]:
        drag = self.nu * (self.curl.T @ (self.weight * self.moving_at(time, coefficients_time)))
        lift = self.space.lift_at(time)
        if self.by_curvature is None or lift is None:
            return drag
        prescribed = self.space.edge_flux(lift, self._shift(time, coefficients_time))
        return drag - self.nu * (self.by_curvature @ prescribed)

    def rate(self, flow: NDArray, time: float = 0.0) -> NDArray[np.float64]:
        """Rates of change of `vorticity` at the free vertices and of the coefficients, if they evolved."""
        return -(self.matrix @ flow + self._drag(time))

    def step(
        self,
        vorticity: NDArray,
        coefficients: NDArray,
        dt: float,
        forces: Forces | None = None,
        time: float = 0.0,
        coefficients_time: float | None = None,
    ) -> tuple[NDArray, NDArray]:
        phi, free = self.free_stream_function(vorticity), self.space.free
        push, turn = (np.zeros(len(free)), 0.0) if forces is None else (forces[0][free], forces[1])
        drags = None
        if self.in_time:
            size = self.decay.G.shape[0]
            first, second = (
                self._drag(time + share * dt, coefficients_time)[:size] for share in (GAMMA, 1.0)
            )
            drags = first, second
        if self.evolve:
            source = np.append(push, turn + np.zeros(len(coefficients)))
            after = self.decay.step(np.concatenate([phi, coefficients]), dt, source, drags)
        else:
            after = self.decay.step(phi, dt, push - self.coupling @ coefficients, drags)
            after = np.concatenate([after, coefficients])
        moving = self.moving_at(time + dt, coefficients_time) if self.in_time else self.moving
        return self.active * (self.curl @ after + moving), after[len(free) :]


def outflow_friction(space: SurfaceSpace, nu: float) -> NDArray[np.float64] | float:
    """(n,) factor of the viscosity in the last cells before natural outflows.

    It rises linearly over `SPONGE_RINGS` rings of vertices to the viscosity at which a cell resolves the
    stream (cell Reynolds number 2), so that vortices leave without oscillations from cell to cell.
    """
    if space.open_sides is None or space.lift is None or not len(space.open_sides):
        return 1.0
    # speed times half the length of a side
    stream = 0.5 * float(np.quantile(space.stream_flux.max(axis=1), 0.9))
    edges = space.mesh.topology.edges
    ramp = np.zeros(space.n)
    ramp[space.open_sides] = 1.0
    for ring in range(1, SPONGE_RINGS):
        level = 1.0 - ring / SPONGE_RINGS
        near = ramp[edges].max(axis=1) > level
        ramp[edges[near]] = np.maximum(ramp[edges[near]], level)
    return 1.0 + ramp * max(stream / nu - 1.0, 0.0)


class Diffusion(FlowPhase):
    """The phase of viscosity; it shows the forces that walls without slip take."""

    effect = "viscosity"

    def __init__(
        self, setting: FluidSetting, scheme: VorticityDiffusion | VelocityDiffusion, forces: Any = None
    ) -> None:
        self.scheme, self.forces = scheme, forces
        setting.boundary_vorticity = scheme.boundary_vorticity

    def observed(self, state: FluidState) -> Observation:
        if self.forces is None:
            return Observation(None)
        return Observation(None, {}, {f"force_{name}": f for name, f in self.forces.of(state).items()})

    def advance(self, step: Step, state: FluidState) -> FluidState:
        return self.advance_forced(step, state, state)

    def advance_forced(self, step: Step, state: FluidState, forced: FluidState) -> FluidState:
        """The state after the span; `forced` is the state with what forces add in it."""
        names = ("vorticity", "coefficients")
        vorticity, coefficients = (state[name] for name in names)
        forces = None
        if forced is not state:
            forces = tuple((forced[name] - state[name]) / step.dt for name in names)
        vorticity, coefficients = self.scheme.step(
            vorticity, coefficients, step.dt, forces, step.time, state.time
        )
        return forced.replaced(vorticity=vorticity, coefficients=coefficients)


def growing_flows(A: csr_array, G: csr_array, bound: float) -> NDArray[np.float64] | None:
    """Eigenvectors of A x = lambda G x with lambda < 0: rigid turns that errors of a mesh amplify.

    The decay rate of the deformation Laplacian is zero for them and positive for all other flows; the
    discrete rate is the difference of two terms with errors of their own.

    Parameters
    ----------
    A, G : (k, k) sparse arrays
        Symmetric; G positive definite.
    bound : float
        A + bound G is positive semidefinite.

    Returns
    -------
    (k, q) ndarray of float64, or None
        Orthonormal in G. None where there are none.
    """
    n, count = A.shape[0], N_RIGID_TURNS + 1
    while n:
        count = min(count, n)
        pairs = smallest_eigenpairs(csr_array(A + bound * G), G, count)
        growing = pairs.values < bound
        if count == n or not growing.all():
            return pairs.vectors[:, growing] if growing.any() else None
        count *= 2
    return None


def face_curvature(space: SurfaceSpace) -> NDArray[np.float64]:
    """(m,) Gaussian curvature, the mean of a face's vertices [1/m^2].

    A vertex of the boundary, whose angle defect is the turn of the boundary, has the mean of its neighbours
    inside, and 0 without any.
    """
    inside, topology = space.inside, space.mesh.topology
    defect = 2.0 * np.pi - sum_by_index(space.faces, corner_angle(space.mesh.side_length), space.n)
    curvature = np.where(inside, defect * space.inverse_mass, 0.0)
    ends = topology.edges
    summed, count = (
        sum_by_index(ends, np.stack([values[ends[:, 1]], values[ends[:, 0]]], axis=1), space.n)
        for values in (curvature, inside.astype(np.float64))
    )
    around = np.divide(summed, count, out=np.zeros(space.n), where=count > 0)
    return np.asarray(np.where(inside, curvature, around)[space.faces].mean(axis=1))


def curvature_star(space: SurfaceSpace) -> NDArray[np.float64]:
    """(e,) star of the inner product weighted by Gaussian curvature."""
    density = face_curvature(space)
    opposite = -(space.side[:, [1, 2, 0]] * np.conj(space.side[:, [2, 0, 1]])).real
    weight = 0.25 * density[:, None] * opposite / space.area[:, None]
    n_edges = space.mesh.topology.n_edges
    return sum_by_index(space.side_edge, weight, n_edges)
