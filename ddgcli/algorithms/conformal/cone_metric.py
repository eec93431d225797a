"""Metrics with prescribed angle sums in a discrete conformal class, by Newton's method.

The angle sums are minus the gradient of a convex function of the logarithmic scale factors, twice
differentiable across Ptolemy flips, whose Hessian is the cotangent Laplacian of the scaled metric
(Springborn, Schroeder, Pinkall 2008; Springborn 2020; M. Gillespie, B. Springborn, K. Crane, "Discrete
Conformal Equivalence of Polyhedral Surfaces", 2021).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array

from ddgcli.algorithms.conformal.ptolemy import DecoratedTriangulation, flip_by_ptolemy
from ddgcli.algorithms.conformal.targets import ConformalTargets
from ddgcli.errors import SolveError, counted, without_warnings
from ddgcli.geometry.intrinsic import corner_angle, corner_cotan, triangle_excess
from ddgcli.linalg.constrain import Dirichlet
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import PREVIOUS
from ddgcli.operators.laplacian import stiffness
from ddgcli.progress import ProgressCallback
from ddgcli.representation import short_repr

log = logging.getLogger("ddgcli")

ANGLE_TOLERANCE = 1e-10  # radians by which angle sums may miss their targets
STOP_RESIDUAL = 1e-13  # radians; Newton's method continues below the tolerance while it gains
MAX_NEWTON_ITERATIONS = 200
MAX_HALVINGS = 40
LARGEST_STEP = 10.0  # change of a logarithmic scale factor in one iteration
REGULARIZATION = 1e-9  # of a Laplacian without degenerate faces
OVERSHOOT_SHARE = 0.1  # of the slope at the start that the slope at the end of a step may have


@dataclass(frozen=True, eq=False)
class ConeMetric:
    """A discretely conformal metric.

    Parameters
    ----------
    triangulation : DecoratedTriangulation
        Delaunay in the new metric, but for boundary edges.
    scale : (n,) ndarray of float64
        Logarithmic scale factors u: lengths are exp((u_i + u_j) / 2) times the plain ones.
    angle : (n,) ndarray of float64
        Angle sums, in radians.
    residual : float
        Largest difference of an angle sum from its target where the scale factor is free, in radians.
    iterations : int
    degenerate_faces : int
        Faces at the boundary whose lengths violate the triangle inequality.
    """

    triangulation: DecoratedTriangulation
    scale: NDArray[np.float64]
    angle: NDArray[np.float64]
    residual: float
    iterations: int
    degenerate_faces: int

    __repr__ = short_repr

    @property
    def converged(self) -> bool:
        return self.residual <= ANGLE_TOLERANCE and self.degenerate_faces == 0


def cone_metric(
    state: DecoratedTriangulation,
    n_vertices: int,
    targets: ConformalTargets,
    progress: ProgressCallback | None = None,
) -> ConeMetric:
    """Find the scale factors with the prescribed angle sums; `state` is changed in place.

    Parameters
    ----------
    state : DecoratedTriangulation
        Flipped in place.
    n_vertices : int
    targets : ConformalTargets
    progress : callable, optional

    Returns
    -------
    ConeMetric

    Notes
    -----
    A step of Newton's method is halved until the convex function still falls at its end, or nearly so, hence
    falls all along it; the function itself is not evaluated.
    """
    referenced = np.zeros(n_vertices, dtype=bool)
    referenced[state.tail] = True
    u = np.where(targets.fixed, targets.scale, 0.0)
    free = referenced & ~targets.fixed
    if targets.fixed.any():  # lengths times a constant have the same angles
        u[free] = targets.scale[targets.fixed].mean()
    work = _Newton(state, n_vertices, targets.angle, free, ~free)
    if not (targets.fixed & referenced).any():
        work.fixed = ~free
        work.fixed[np.flatnonzero(free)[0]] = True  # u is unique up to a constant
    best = work.measure(u)
    iterations = 0
    while best > STOP_RESIDUAL and iterations < MAX_NEWTON_ITERATIONS and free.any():
        next_u = work.step(u)
        iterations += 1
        if next_u is None:
            break
        u, before, best = next_u, best, work.measure(next_u)
        if progress is not None:
            progress(iterations, MAX_NEWTON_ITERATIONS)
        if best < ANGLE_TOLERANCE and best > 0.5 * before:
            break
    degenerate = int(work.degenerate.sum())
    if best > ANGLE_TOLERANCE or degenerate:
        log.warning(
            "the angle sums miss their targets by up to %.2g radians after %d iterations%s", best, iterations,
            f"; {counted(degenerate, 'triangle', 'triangles')} at the boundary without area: use `subdivide`"
            if degenerate
            else "",
        )  # fmt: skip
    return ConeMetric(state, u, work.angle, best, iterations, degenerate)


class _Newton:
    """Angle sums and steps of Newton's method."""

    def __init__(
        self, state: DecoratedTriangulation, n: int, target: NDArray, free: NDArray, fixed: NDArray
    ) -> None:
        self.state, self.n, self.target, self.free, self.fixed = state, n, target, free, fixed
        self.angle = np.zeros(n)
        self.length = np.zeros((state.n_faces, 3))
        self.degenerate: NDArray[np.bool_] = np.zeros(state.n_faces, dtype=bool)

    def measure(self, u: NDArray) -> float:
        """Flip to the Delaunay triangulation at u and compute its angle sums; the largest residual."""
        flip_by_ptolemy(self.state, u)
        length = self.state.scaled_length(u).reshape(-1, 3)
        self.length = length
        self.degenerate = np.any(triangle_excess(length) <= 0, axis=1)
        corner = corner_angle(length)  # pi opposite a side that is too long (Springborn et al. 2008)
        self.angle = sum_by_index(self.state.tail, corner.ravel(), self.n)
        return float(np.abs(self.angle - self.target)[self.free].max(initial=0.0))

    def step(self, u: NDArray) -> NDArray[np.float64] | None:
        """Scale factors after one step; None where no step lowers the function."""
        excess = np.where(self.free, self.angle - self.target, 0.0)
        direction = self._direction(excess)
        slope = float(excess @ direction)
        if not slope > 0:
            return None
        share = min(1.0, LARGEST_STEP / np.abs(direction).max())
        for _ in range(MAX_HALVINGS):
            new = u + share * direction
            try:
                self.measure(new)
                end_slope = float((self.angle - self.target)[self.free] @ direction[self.free])
            except (SolveError, FloatingPointError):
                end_slope = -np.inf
            if end_slope >= -OVERSHOOT_SHARE * slope:
                return new
            share *= 0.5
        self.measure(u)
        return None

    def _direction(self, excess: NDArray) -> NDArray[np.float64]:
        """Step of Newton's method: the cotangent Laplacian of the scaled metric times it is the excess."""
        with without_warnings():  # the lengths are those of an iterate
            L = stiffness(self.state.mesh(self.length.ravel(), self.n))
        if self.degenerate.any():  # angles of degenerate faces are constant, others keep the matrix definite
            L = _without_faces(L, self.state, self.length, self.degenerate)
        problem = Dirichlet(L, np.flatnonzero(self.fixed))
        direction = problem.solve(np.zeros(int(self.fixed.sum())), excess)
        if self.fixed[self.free].any():
            direction -= np.where(self.free, direction[self.free].mean(), 0.0)
        return direction


def _without_faces(
    L: csr_array, state: DecoratedTriangulation, length: NDArray, left_out: NDArray
) -> csr_array:
    """Stiffness without some faces, with a small multiple of the identity where none is left."""
    keep = np.repeat(~left_out, 3)
    weight = np.where(keep, 0.5 * corner_cotan(length)[:, PREVIOUS].ravel(), 0.0)
    i, j, n = state.tail, state.head, L.shape[0]
    half = coo_array((weight, (i, j)), shape=(n, n))
    adjacency = csr_array(half + half.T)
    degree = np.asarray(adjacency.sum(axis=1)).ravel()
    return csr_array(diags_array(degree + REGULARIZATION) - adjacency)
