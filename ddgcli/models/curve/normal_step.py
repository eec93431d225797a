"""One semi-implicit step of a curve flow, with the correction that meets its constraint.

A step is `x' = x + d + lambda b + s`: `d` solves `(M + dt P Q P) d = dt P F`, `b` the same system with the
gradient of a constraint, and `s` slides points along the curve. `M` holds dual lengths, `F` the negative
gradient, `Q` its linearisation with the weights of the start of the step, `P` the normal projection
(the identity without redistribution). Without `s` the length never rises in curvature flow (Dziuk 1994):
`d.F = d.M d / dt + d.Q d` and `|e'| - |e| <= |e'| (|e'| - |e|) / |e|`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csr_array, diags_array

from ddgcli.linalg.factor import Factor
from ddgcli.mesh.vectors import ratio, row_dot, tangential
from ddgcli.models.curve import polygon
from ddgcli.models.curve.flow_terms import CurveFlowTerms, CurveState
from ddgcli.simulation.model import StepRejected

STEP_LIMIT = 0.1  # squared radii of the circle of the shortest curve's length: beyond it points move freely
MAX_CONSTRAINT_ITERATIONS = 12
CONSTRAINT_TOLERANCE = 1e-14  # relative; iterations end there or after the number above
MAX_HALVINGS = 40  # of a step of elastic flow: the time of a tip is the fourth power of its radius


class NormalStep:
    """Linear system of one step, its motion, and the correction that meets the constraint.

    Parameters
    ----------
    flow : CurveFlowTerms
    state : CurveState
    dt : float
        In scaled units.
    """

    def __init__(self, flow: CurveFlowTerms, state: CurveState, dt: float) -> None:
        mesh = flow.mesh
        self.flow, self.state, self.dt = flow, state, dt
        self.shape = polygon.geometry(mesh, state.points)
        tangents = polygon.circle_tangents if flow.kind == "elastic" else polygon.vertex_tangents
        self.tangent = tangents(mesh, state.points)
        self.free = np.zeros(mesh.n, dtype=bool)
        self.free[mesh.joint] = True
        self.free &= state.active[mesh.curve]
        self._normal = flow.redistribute and not self._is_huge()
        self._points = np.flatnonzero(self.free)
        self._factor = Factor(self._matrix()) if len(self._points) else None
        self.motion = self._solve(-self._gradient())

    def _is_huge(self) -> bool:
        """True for a step of which the normal parts alone would not be the flow: points then move freely.

        Straightening a curve in one step needs motion along it, which the linearisation at the start of the
        step takes for a change of spacing.
        """
        if self.flow.kind == "elastic":
            return False
        length = self.flow.mesh.by_curve(self.flow.mesh.tail, self.shape.length)
        radius = length[self.state.active].min(initial=np.inf) / (2 * np.pi)
        return bool(self.dt > STEP_LIMIT * radius**2)

    def _matrix(self) -> csr_array:
        """`M + dt P Q P` on the free points: (k, k) by coordinate without P, (3k, 3k) with it."""
        rows = self._points
        stiffness = (self.dt * self._stiffness())[rows][:, rows].tocsr()
        mass = self.shape.dual_length[rows]
        if not self._normal:
            return stiffness + diags_array(mass)
        tangent, k = self.tangent[rows], len(rows)
        along = np.eye(3) - tangent[:, :, None] * tangent[:, None, :]
        row = np.repeat(np.arange(k), np.diff(stiffness.indptr))
        blocks = stiffness.data[:, None, None] * (along[row] @ along[stiffness.indices])
        blocks[row == stiffness.indices] += mass[:, None, None] * np.eye(3)
        return bsr_array((blocks, stiffness.indices, stiffness.indptr), shape=(3 * k, 3 * k)).tocsr()

    def projected(self, vectors: NDArray) -> NDArray[np.float64]:
        """(n, 3) vectors without their tangential parts, where points are redistributed."""
        if not self._normal:
            return vectors
        return tangential(vectors, self.tangent)

    def _stiffness(self) -> csr_array:
        mesh, shape = self.flow.mesh, self.shape
        matrix = polygon.stiffness(mesh, shape.length)
        if self.flow.kind != "elastic":
            return matrix
        joint_matrix = matrix[mesh.joint]
        weight = diags_array(2.0 / np.maximum(shape.dual_length[mesh.joint], np.finfo(float).tiny))
        return joint_matrix.T @ weight @ joint_matrix + (self.flow.length_penalty or 0.0) * matrix

    def _gradient(self) -> NDArray[np.float64]:
        mesh = self.flow.mesh
        if self.flow.kind != "elastic":
            return polygon.length_gradient(mesh, self.shape)
        gradient = polygon.elastic_gradient(mesh, self.shape)
        return gradient + (self.flow.length_penalty or 0.0) * polygon.length_gradient(mesh, self.shape)

    def _solve(self, force: NDArray) -> NDArray[np.float64]:
        """Motion by a force in one step."""
        motion = np.zeros(force.shape)
        if self._factor is not None:
            load = self.dt * self.projected(force)[self._points]
            solution = self._factor.solve(load.ravel() if self._normal else load)
            motion[self._points] = solution.reshape(-1, 3)
        return motion

    def constrained(self, points: NDArray) -> NDArray[np.float64]:
        """Points moved along the solution for the constraint's gradient until the constraint holds."""
        if self.flow.kind == "area-preserving":
            return self._with_area(points)
        if self.flow.kind == "elastic" and self.flow.length_penalty is None:
            return self._with_length(points)
        return points

    def _with_area(self, points: NDArray) -> NDArray[np.float64]:
        """Points of the first area; the gradient of the area at the mean of both points lets none rise.

        The area is quadratic: with that gradient g, A(x') - A(x) = g.(x' - x) = 0.
        """
        mesh, later = self.flow.mesh, points
        for _ in range(MAX_CONSTRAINT_ITERATIONS):
            middle = 0.5 * (self.state.points + later)
            direction = self._solve(polygon.area_gradient(mesh, middle))
            constant = polygon.enclosed_area(mesh, points) - self.flow.first_area
            linear = mesh.by_curve(np.arange(mesh.n), row_dot(polygon.area_gradient(mesh, points), direction))
            square = polygon.area_form(mesh, direction)
            discriminant = linear**2 - 4.0 * square * constant
            if (state_bad := self.state.active & ((discriminant < 0) | (linear == 0))).any():
                raise StepRejected("area", f"curve {int(np.argmax(state_bad))}")
            root = linear + np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), linear)
            factor = np.where(self.state.active, ratio(-2.0 * constant, root), 0.0)
            previous, later = later, points + factor[mesh.curve][:, None] * direction
            if np.abs(later - previous).max() <= CONSTRAINT_TOLERANCE:
                break
        return later

    def _with_length(self, points: NDArray) -> NDArray[np.float64]:
        """Points of the first length, by Newton's method for one factor per curve."""
        mesh, active = self.flow.mesh, self.state.active
        direction = self._solve(polygon.length_gradient(mesh, self.shape))
        for _ in range(MAX_CONSTRAINT_ITERATIONS):
            shape = polygon.geometry(mesh, points)
            excess = mesh.by_curve(mesh.tail, shape.length) - self.flow.first_length
            slope = mesh.by_curve(np.arange(mesh.n), row_dot(polygon.length_gradient(mesh, shape), direction))
            open_excess = active & (np.abs(excess) > CONSTRAINT_TOLERANCE * self.flow.first_length)
            if not open_excess.any():
                break
            factor = np.where(open_excess, ratio(-excess, slope), 0.0)
            points = points + factor[mesh.curve][:, None] * direction
        worst = np.max(np.where(active, np.abs(excess) / self.flow.first_length, 0.0))
        if not worst < 1e-9:
            raise StepRejected("length", value=float(worst), halvings=MAX_HALVINGS)
        return points
