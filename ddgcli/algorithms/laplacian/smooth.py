"""Smoothing by implicit mean curvature flow, and by its conformalized variant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array

from ddgcli.algorithms.laplacian.implicit_step import MIN_MASS, ImplicitStep
from ddgcli.algorithms.laplacian.laplace_operator import MASS_FUNCTIONS, LaplaceOperator, laplace_operator
from ddgcli.choices import SMOOTHING_FLOWS
from ddgcli.errors import MeshError, ParameterError, SolveError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.linalg.constrain import Dirichlet
from ddgcli.mesh.require import require
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_dot
from ddgcli.operators.laplacian import lumped_vertex_area
from ddgcli.operators.mollify import mollify_mesh
from ddgcli.progress import ProgressCallback
from ddgcli.representation import short_repr

# Bound of the weights, which have no unit and are about 1. Without it and MIN_MASS a limb that has shrunk to
# a line has weights of 1e13 and masses of 1e-40, and the solution has no correct digit.
MAX_WEIGHT = 1e5
# Batches of Delaunay flips in a step. Ordinary surfaces need some dozens; around a part that has collapsed to
# a line rounding decides the flips, which take minutes. The negative weight of a remaining edge is set to 0.
MAX_FLIP_ROUNDS = 200
# Share of the first area below which the surface counts as vanished.
VANISHED_AREA = 1e-9
# Share of a vertex's first area below which it lies on a part that pinches off, and share of the energy left
# below which energy above a steady state is rounding.
THIN_AREA, STEADY_ENERGY = 1e-3, 1e-6
# Of the energy left: a smaller excess is not compared with the steady state, which takes a factorisation.
MIN_CAPPED_SHARE = 1e-3
# Growth of the bounding box, as a share of its diagonal, that rounding explains.
BOX_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class SmoothingResult:
    """A surface after mean curvature flow, and what the flow changed.

    Parameters
    ----------
    mesh : TriangleMesh
    area : list of float
        Before and after every step.
    residual : float
        Largest relative residual of the steps.
    time : float
        Time at the end; less than required if the surface vanished before.
    box_growth : float
        Largest distance of a vertex from the first bounding box, relative to its diagonal. Mean curvature
        flow never leaves the box (maximum principle).
    collapsed : int
        Vertices whose area has fallen below 1e-8 of the time step (of the first area of the surface, if that
        is less): parts that have become lines or points.
    collapse_time : float or None
        Start of the first step with a collapsed vertex.
    time_error : float
        Estimate of what the steps left too much of the area (`conformalized`: of the Dirichlet energy of the
        positions), relative to what is left; at most 1, where the flow has ended before. On surfaces that
        approach a steady state with a fixed boundary, no more than the distance to it.
    """

    mesh: TriangleMesh
    area: list[float]
    residual: float
    time: float
    box_growth: float = 0.0
    collapsed: int = 0
    collapse_time: float | None = None
    time_error: float = 0.0

    __repr__ = short_repr

    @property
    def has_vanished(self) -> bool:
        """Whether nearly no area is left."""
        return _has_vanished(self.area)

    @property
    def in_box(self) -> bool:
        """Whether the maximum principle holds up to rounding."""
        return self.box_growth <= BOX_TOLERANCE


def smooth(
    mesh: TriangleMesh,
    time: float,
    *,
    steps: int = 10,
    flow: str = "mean-curvature",
    operator: str | None = None,
    mass: str = "lumped",
    progress: ProgressCallback | None = None,
) -> SmoothingResult:
    """Smooth by mean curvature flow dx/dt = (Laplacian of x) = -2 H n for `time`, in length squared.

    Backward Euler, (M + dt L) x' = M x; boundary vertices stay. A sphere of radius r shrinks as r^2 - 4 t.

    Parameters
    ----------
    mesh : TriangleMesh
    time : float
        In length^2.
    steps : int
    flow : {'mean-curvature', 'conformalized'}
        With L and M of the surface at the start of each step (M. Desbrun et al., "Implicit fairing of
        irregular meshes using diffusion and curvature flow", 1999), which pinches thin parts off; or with the
        L of the first surface throughout and M of each step, which keeps angles and does not pinch
        (M. Kazhdan, J. Solomon, M. Ben-Chen, "Can mean-curvature flow be modified to be
        non-singular?", 2012).
    operator, mass : str
        See `laplace_operator`. With weights that are not negative and a diagonal mass (the defaults) each new
        point is a weighted mean of old ones.
    progress : callable, optional
        Called with the number of finished steps and of all steps.

    Returns
    -------
    SmoothingResult

    Raises
    ------
    ParameterError
        For a time that is not positive, no step, or an unknown flow.
    """
    require(mesh, "smoothing", sized=False)
    _check(time, steps, flow)
    stepper = _Stepper(mesh, time / steps, flow, operator, mass)
    low, high = mesh.bounding_box
    diagonal = float(np.linalg.norm(high - low))
    area = [float(face_area(mesh.side_length).sum())]
    worst = reached = growth = excess = 0.0
    collapsed, collapse_time = 0, None
    reducible: list[float] = []
    for step in range(steps):
        if progress is not None:
            progress(step, steps)
        try:
            moved, residual, thin = stepper.step(mesh)
        except (SolveError, MeshError):
            break
        if not np.isfinite(moved.points).all():
            break
        collapsed = max(collapsed, thin)
        if thin and collapse_time is None:
            collapse_time = reached
        excess += stepper.excess(mesh, moved)
        if reducible or excess > MIN_CAPPED_SHARE * stepper.energy(moved):
            reducible = reducible or [stepper.reducible_energy(mesh)]
            reducible.append(stepper.reducible_energy(moved))
        outside = float(np.maximum(moved.points - high, low - moved.points).max())
        growth = max(growth, outside / diagonal)
        mesh, worst, reached = moved, max(worst, residual), time * (step + 1) / steps
        area.append(float(face_area(mesh.side_length).sum()))
        if _has_vanished(area):
            break
    left = stepper.energy(mesh)
    if reducible and not stepper.has_thinned(mesh):
        excess = min(excess, _most_excess(reducible, left))
    time_error = min(1.0, excess / left) if left > 0 else 0.0
    return SmoothingResult(mesh, area, worst, reached, growth, collapsed, collapse_time, time_error)


def _most_excess(reducible: list[float], left: float) -> float:
    """Bound of the energy that steps left over, if every step approached a steady state.

    `reducible`: energy above the harmonic surface of the same boundary, before and after every step. Where
    there is no steady state, as between two rings too far apart, a surface comes near one and then leaves it.
    """
    before, after = np.array(reducible[:-1]), np.array(reducible[1:])
    if ((after >= before) & (after > STEADY_ENERGY * left)).any():
        return np.inf
    ratio = after[-1] / before[-1] if before[-1] > 0 else 0.0
    return float(after[-1] / (1.0 - ratio) if ratio < 1.0 else after[-1])


def _has_vanished(area: list[float]) -> bool:
    return area[-1] < VANISHED_AREA * area[0]


def _check(time: float, steps: int, flow: str) -> None:
    if not 0 < time < np.inf:
        raise ParameterError(f"must be positive and finite, not {time:g}", parameter="time")
    if steps < 1:
        raise ParameterError(f"must be at least 1, not {steps}", parameter="steps")
    if flow not in SMOOTHING_FLOWS:
        raise ParameterError(f"{flow!r} is not one of {', '.join(SMOOTHING_FLOWS)}", parameter="flow")


class _Stepper:
    """Backward Euler steps, and measures of what they leave over."""

    def __init__(self, mesh: TriangleMesh, dt: float, flow: str, operator: str | None, mass: str) -> None:
        self.dt, self.operator, self.mass = dt, operator, mass
        self.fixed = mesh.topology.boundary_vertex | ~mesh.topology.referenced_vertex
        self.first_area = lumped_vertex_area(mesh)
        # a vertex that stays is not thin because a step is longer than the area
        self.collapsed_mass = MIN_MASS * min(1.0, float(self.first_area.sum()) / dt)
        low, high = mesh.bounding_box
        self.centre = low / 2 + high / 2
        conformalized = flow == "conformalized"
        self.stiffness = bounded_stiffness(laplace_operator(mesh, operator, mass)) if conformalized else None
        self.implicit = ImplicitStep(self.fixed, self.centre)
        self.system: tuple[TriangleMesh, csr_array, csr_array] | None = None

    def step(self, mesh: TriangleMesh) -> tuple[TriangleMesh, float, int]:
        """The moved mesh, the relative residual, and the number of collapsed vertices."""
        if self.fixed.all():
            return mesh, 0.0, 0
        stiffness, mass = self._matrices(mesh)
        vertex_mass = mass @ np.ones(mesh.n_vertices)
        collapsed = int(((vertex_mass < self.collapsed_mass) & ~self.fixed).sum())
        return *self.implicit.step(mesh, stiffness, mass), collapsed

    def excess(self, mesh: TriangleMesh, moved: TriangleMesh) -> float:
        """Energy that a step left over, at the rate at its end; at each vertex at most the area it had.

        The flow loses the energy |L x|^2 / m in unit time. Where a surface shrinks the rate grows, and the
        step takes about that of its start; where noise decays the rate falls, and nothing is left over.
        """
        if self.fixed.all():
            return 0.0
        ones = np.ones(mesh.n_vertices)
        _, mass = self._matrices(mesh)
        try:
            stiffness, mass_at_end = self._matrices(moved)
        except (SolveError, MeshError):  # of a surface that has vanished: the next step ends the flow
            return 0.0
        force = stiffness @ (moved.points - self.centre)
        force[self.fixed] = 0.0
        rate = row_dot(force, force) / np.maximum(mass_at_end @ ones, MIN_MASS)
        possible = float(np.minimum(rate, self.dt * (mass @ ones)).sum())
        return max(0.0, possible - (self.energy(mesh) - self.energy(moved)))

    def reducible_energy(self, mesh: TriangleMesh) -> float:
        """Energy above that of the harmonic surface with the same boundary; infinite for closed surfaces.

        It is what long steps have left over near a steady state, where the rate times the step is more.
        """
        if mesh.topology.is_closed or self.fixed.all():
            return np.inf
        try:
            stiffness, _ = self._matrices(mesh)
            points = mesh.points - self.centre
            regular = MIN_MASS * eye_array(mesh.n_vertices, format="csr")  # of closed components
            problem = Dirichlet(stiffness + regular, self.fixed, pivot=False)
            rest = points - problem.solve(points[problem.fixed], MIN_MASS * points)
        except (SolveError, MeshError):
            return np.inf
        return 0.5 * float(np.sum(rest * (stiffness @ rest)))

    def has_thinned(self, mesh: TriangleMesh) -> bool:
        """Whether a vertex has lost nearly all of its area, as on a neck that pinches off."""
        thin = lumped_vertex_area(mesh) < THIN_AREA * self.first_area
        return bool((thin & ~self.fixed).any())

    def energy(self, mesh: TriangleMesh) -> float:
        """Energy whose gradient flow this is: the area, or the Dirichlet energy of the positions."""
        if self.stiffness is None:
            return float(face_area(mesh.side_length).sum())
        points = mesh.points - self.centre
        return 0.5 * float(np.sum(points * (self.stiffness @ points)))

    def _matrices(self, mesh: TriangleMesh) -> tuple[csr_array, csr_array]:
        """L and M/dt, cached for the last mesh."""
        if self.system is None or self.system[0] is not mesh:
            self.system = (mesh, *self._assembled(mesh))
        return self.system[1:]

    def _assembled(self, mesh: TriangleMesh) -> tuple[csr_array, csr_array]:
        if self.stiffness is not None:
            surface, _ = mollify_mesh(mesh)
            return self.stiffness, csr_array(MASS_FUNCTIONS[self.mass](surface) / self.dt)
        laplace = laplace_operator(mesh, self.operator, self.mass, max_rounds=MAX_FLIP_ROUNDS)
        return bounded_stiffness(laplace), csr_array(laplace.mass / self.dt)


def bounded_stiffness(laplace: LaplaceOperator) -> csr_array:
    """Stiffness with weights of at most `MAX_WEIGHT`, not negative for Delaunay operators.

    The Delaunay property makes the weights of `intrinsic-delaunay` and `tufted` non-negative inside; negative
    ones come from triangles without area, or from boundary edges, whose ends stay fixed.
    """
    off = laplace.stiffness.tocoo()
    inside = off.row != off.col
    least = 0.0 if laplace.name in ("intrinsic-delaunay", "tufted") else -MAX_WEIGHT
    weight = np.clip(-off.data[inside], least, MAX_WEIGHT)
    row, col = off.row[inside], off.col[inside]
    n = off.shape[0]
    degree = sum_by_index(row, weight, n)
    return csr_array(diags_array(degree, format="csr") - csr_array((weight, (row, col)), shape=(n, n)))


def latest_end(mesh: TriangleMesh) -> float:
    """Time by which mean curvature flow has ended a closed surface.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    float
        In length^2; infinite for surfaces with boundary.

    Notes
    -----
    A surface inside a sphere stays inside as both flow: the sphere of radius r ends at r^2 / 4.
    """
    if not mesh.topology.is_closed:
        return np.inf
    low, high = mesh.bounding_box
    outward = mesh.points[mesh.topology.referenced_vertex] - (low / 2 + high / 2)
    return float(row_dot(outward, outward).max()) / 4


def sensible_times(mesh: TriangleMesh) -> tuple[float, float]:
    """Two smoothing times: one that removes noise, and one that changes the shape.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    noise, shape : float
        Squared mean edge length, and a thousandth of the area; in length^2.
    """
    length = mesh.side_length
    return float(length.mean()) ** 2, 1e-3 * float(face_area(length).sum())
