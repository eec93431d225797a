"""Edges of constant length: holonomic constraints of explicit steps, with their multipliers.

RATTLE [H. C. Andersen, "RATTLE: a velocity version of the SHAKE algorithm for molecular dynamics
calculations", 1983] is velocity Verlet with positions that satisfy |x_b - x_a| = l and velocities tangent to
these constraints. It is the variational scheme of the discrete action with constraints at every step, so it
conserves momenta to rounding, and energy without drift, as Verlet does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, diags_array

from ddgcli.errors import SolveError
from ddgcli.linalg.factor import Factor, negative_eigenvalues
from ddgcli.mechanics.terms import Constraint
from ddgcli.mesh.vectors import row_dot
from ddgcli.simulation.model import StepRejected

if TYPE_CHECKING:
    from ddgcli.mechanics.system import Motion, System

# corrections of the positions in a step; each reduces the error by a factor of the angle of rotation
MAX_CORRECTIONS = 60
# eigenvalue of the matrix of the constraints over the largest one, below which a constraint is redundant
REDUNDANCE = 1e-12


@dataclass(frozen=True, eq=False)
class RigidEdges(Constraint):
    """Edges that keep their lengths.

    Parameters
    ----------
    edges : (e, 2) ndarray of int
    length : (e,) ndarray
        In m.
    name : str
        Name of the effect.
    """

    edges: NDArray[np.int64]
    length: NDArray[np.float64]
    name: str = "rigid"

    def span(self, x: NDArray) -> NDArray[np.float64]:
        """(e, 3) edge vectors, divided by the rest lengths."""
        return (x[self.edges[:, 1]] - x[self.edges[:, 0]]) / self.length[:, None]

    def excess(self, x: NDArray) -> NDArray[np.float64]:
        """(e,) relative changes of length, (|span|^2 - 1) / 2."""
        span = self.span(x)
        return 0.5 * (row_dot(span, span) - 1.0)

    def jacobian(self, x: NDArray) -> csr_array:
        """(e, 3 n) derivatives of `excess` by the positions, times the lengths."""
        count, span = len(self.edges), self.span(x)
        columns = 3 * self.edges[:, :, None] + np.arange(3)
        values = np.stack([-span, span], axis=1)
        ends = 6 * np.arange(count + 1)
        return csr_array((values.ravel(), columns.ravel(), ends), shape=(count, x.size))

    def pull(self, x: NDArray, tension: NDArray) -> NDArray[np.float64]:
        """(n, 3) forces of the edges on the vertices for (e,) tensions in N."""
        return -(self.jacobian(x).T @ tension).reshape(x.shape)

    def observed(self, x: NDArray, tension: NDArray) -> dict[str, float]:
        """Scalars of a frame: largest relative change of a length, largest tension or push in N."""
        error = np.abs(np.sqrt(1 + 2 * self.excess(x)) - 1)
        return {"rigid_error": float(error.max()), "rigid_force": float(np.abs(tension).max())}

    def rounding(self, x: NDArray) -> NDArray[np.float64]:
        """(e,) excess due to rounding of the positions."""
        return 8 * np.finfo(float).eps * (1 + np.abs(x).max() / self.length)


class Projection:
    """Solver for the constraints of a system at given positions.

    Raises
    ------
    SolveError
        If some constraints are redundant there.
    """

    def __init__(self, system: System, edges: RigidEdges, x: NDArray) -> None:
        self.edges, self.x = edges, x
        self.weight = (system.free / system.mass[:, None]).ravel()
        self.jacobian = edges.jacobian(x)
        matrix = csc_array(self.jacobian @ diags_array(self.weight) @ self.jacobian.T)
        if not (matrix.diagonal() > 0).all():
            raise SolveError("an edge between held vertices is rigid already; leave it out")
        self.factor = Factor(matrix)

    def impulse(self, multipliers: NDArray) -> NDArray[np.float64]:
        """(n, 3) changes of velocity by multipliers in N s."""
        return -(self.weight * (self.jacobian.T @ multipliers)).reshape(self.x.shape)

    def tangent(self, v: NDArray) -> tuple[NDArray, NDArray]:
        """Velocities that change no length, nearest to v in the kinetic energy; and the multipliers."""
        multipliers = self.factor.solve(self.jacobian @ v.ravel())
        v = v + self.impulse(multipliers)
        again = self.factor.solve(self.jacobian @ v.ravel())
        return v + self.impulse(again), multipliers + again

    def drifted(self, x: NDArray, v: NDArray, dt: float, guess: NDArray) -> tuple[NDArray, NDArray]:
        """Velocities v plus the impulses for which x + dt v keeps the lengths, and the multipliers."""
        edges, multipliers = self.edges, guess
        for _ in range(MAX_CORRECTIONS):
            end = x + dt * (v + self.impulse(multipliers))
            excess = edges.excess(end)
            if (np.abs(excess) <= edges.rounding(end)).all():
                return v + self.impulse(multipliers), multipliers
            if not np.isfinite(excess).all() or np.abs(excess).max() > 0.5:
                break
            multipliers = multipliers + self.factor.solve(excess * edges.length) / dt
        worst = int(np.argmax(np.abs(np.nan_to_num(excess, nan=np.inf))))
        raise StepRejected("rigid edge", f"vertex {edges.edges[worst, 0]}", float(excess[worst]))


def projection(system: System, edges: RigidEdges, x: NDArray) -> Projection:
    """The projection at x; the last one is cached, because a step ends where the next one starts."""
    last = system.cache.get("projection")
    if last is None or last.x is not x:
        try:
            last = system.cache["projection"] = Projection(system, edges, x)
        except SolveError as error:
            raise StepRejected("rigid edges", "", float("nan")) from error
    return last


def redundant(system: System, edges: RigidEdges, x: NDArray) -> int:
    """Number of rigid edges whose lengths follow from the others, to first order.

    Parameters
    ----------
    system : System
    edges : RigidEdges
    x : (n, 3) ndarray of float64
        Positions in m.

    Returns
    -------
    int
    """
    jacobian = edges.jacobian(x)
    weight = diags_array((system.free / system.mass[:, None]).ravel())
    matrix = csc_array(jacobian @ weight @ jacobian.T)
    if not matrix.shape[0]:
        return 0
    least = REDUNDANCE * float(abs(matrix).sum(axis=0).max())
    lacking = csc_array(matrix - 2 * least * diags_array(np.ones(matrix.shape[0])))
    return int(negative_eigenvalues(lacking, 0.5 * least) or 0)


def rattle(system: System, motion: Motion, dt: float) -> tuple[Any, ...]:
    """State after a step of velocity Verlet under rigid edges (RATTLE).

    Parameters
    ----------
    system : System
        A system with one constraint.
    motion : Motion
    dt : float
        In s.

    Returns
    -------
    x, v, a : (n, 3) ndarray of float64
        Positions in m, velocities, accelerations.
    multipliers : (k,) ndarray of float64
        In N.

    References
    ----------
    H. C. Andersen, "RATTLE: a velocity version of the SHAKE algorithm for molecular dynamics calculations",
    1983.
    """
    (edges,) = system.constraints
    guess = 0.5 * dt * motion.multipliers
    half = motion.v + 0.5 * dt * motion.a
    with system.account.within("rigid"):
        half, _ = projection(system, edges, motion.x).drifted(motion.x, half, dt, guess)
    x = motion.x + dt * half
    a = system.acceleration(x, half, dt)
    with system.account.within("rigid"):
        v, multipliers = projection(system, edges, x).tangent(half + 0.5 * dt * a)
    if system.dissipations:
        a = system.acceleration(x, v, dt)
        with system.account.within("rigid"):
            v, multipliers = projection(system, edges, x).tangent(half + 0.5 * dt * a)
    return x, v, a, multipliers / (0.5 * dt)
