"""Poisson and harmonic problems on a surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.laplacian.laplace_operator import LaplaceOperator
from ddgcli.errors import ParameterError, counted
from ddgcli.linalg.constrain import Dirichlet, Poisson, components
from ddgcli.mesh.fields import checked_values
from ddgcli.representation import short_repr


@dataclass(frozen=True, eq=False)
class Solution:
    """A function on the vertices and how well it solves its equation.

    Parameters
    ----------
    values : (n,) or (n, c) ndarray of float64
    residual : float
        Largest |L u - b| relative to the largest |b|, over the equations that were solved.
    imbalance : float
        Relative sum of the right-hand side over a component without fixed value (0 where the problem is
        solvable), subtracted before solving.
    solver : str
        Name of the linear solver.
    """

    values: NDArray[np.float64]
    residual: float
    imbalance: float = 0.0
    solver: str = "none"

    __repr__ = short_repr


def poisson(operator: LaplaceOperator, source: NDArray, fixed: Mapping[int, float] | None = None) -> Solution:
    """Solve L u = M f: minus the Laplacian of u is f, in value per area.

    Without fixed values the boundary is natural (Neumann, no flux), f loses its mean on every component (with
    a warning where it has one) and u has mean zero there. With fixed values u takes them.

    Parameters
    ----------
    operator : LaplaceOperator
    source : (n,) or (n, c) ndarray
        f at the vertices, not integrated.
    fixed : mapping of vertex to value, optional

    Returns
    -------
    Solution

    Raises
    ------
    ParameterError
        For a source of another shape, or values that are not finite or whose integral overflows.
    """
    source = checked_source(source, operator.stiffness.shape[0])
    rhs = operator.integrated(source, "source")
    if fixed:
        return _with_fixed(operator, fixed, rhs)
    problem = Poisson(operator.stiffness, operator.mass)
    u = problem.solve(rhs)
    imbalance = problem.imbalance
    return Solution(u, problem.residual(u, rhs), imbalance, problem.factor.solver)


def checked_source(source: NDArray, n: int) -> NDArray[np.float64]:
    """Check the right-hand side of a Poisson problem.

    Parameters
    ----------
    source : (n,) or (n, c) ndarray
    n : int
        Vertices of the mesh.

    Returns
    -------
    (n,) or (n, c) ndarray of float64

    Raises
    ------
    ParameterError
        For another shape or values that are not finite.
    """
    checked = checked_values(source, n, "vertex", parameter="source")
    if checked.ndim == 2 and checked.shape[1] == 0:
        raise ParameterError(f"an array of shape {checked.shape} holds no function", parameter="source")
    return checked


def harmonic(operator: LaplaceOperator, fixed: Mapping[int, float]) -> Solution:
    """Solve L u = 0 at every vertex except those of `fixed`, which keep their values.

    Parameters
    ----------
    operator : LaplaceOperator
    fixed : mapping of vertex to value

    Returns
    -------
    Solution

    Raises
    ------
    ParameterError
        Without fixed values, or for a component that has none.
    """
    if not fixed:
        raise ParameterError("no value is fixed; add `fixed={ID: VALUE}`", parameter="fixed")
    return _with_fixed(operator, fixed, None)


def _with_fixed(operator: LaplaceOperator, fixed: Mapping[int, float], rhs: NDArray | None) -> Solution:
    n = operator.stiffness.shape[0]
    check_fixed_vertices(fixed, n)
    vertices = operator.referenced_vertices
    refuse_floating(components(operator.stiffness)[1], vertices, fixed)
    vertex = np.array(sorted(fixed))
    values = np.array([fixed[v] for v in vertex], dtype=np.float64)
    _refuse_overflow(operator, values)
    local = np.full(n, -1)
    local[vertices] = np.arange(len(vertices))
    inside = local[vertex] >= 0
    problem = Dirichlet(operator.stiffness[vertices][:, vertices], local[vertex[inside]])
    load = None if rhs is None else rhs[vertices]
    boundary_values = (
        values[inside] if rhs is None or rhs.ndim == 1 else np.tile(values[inside, None], rhs.shape[1])
    )
    component_values = problem.solve(boundary_values, load)
    u = np.zeros((n, *component_values.shape[1:]))
    u[vertices] = component_values
    u[vertex[~inside]] = values[~inside] if u.ndim == 1 else values[~inside, None]
    return Solution(u, problem.residual(component_values, load), solver=problem.factor.solver)


def _refuse_overflow(operator: LaplaceOperator, values: NDArray) -> None:
    """Raise an error for fixed values whose products with the weights leave the floating-point range."""
    largest = float(np.abs(values).max())
    limit = np.finfo(np.float64).max / (8.0 * max(1.0, float(abs(operator.stiffness).sum(axis=1).max())))
    if largest > limit:
        raise ParameterError(
            f"values up to {largest:.3g} overflow in the equations; give smaller ones, below {limit:.0e}",
            parameter="fixed",
        )


def check_fixed_vertices(fixed: Mapping[int, float], n: int) -> None:
    """Raise an error for a fixed vertex that does not exist.

    Parameters
    ----------
    fixed : mapping of vertex to value
    n : int
        Vertices of the mesh.

    Raises
    ------
    ParameterError
    """
    outside = [v for v in fixed if not 0 <= v < n]
    if outside:
        raise ParameterError(
            f"vertex {outside[0]} does not exist; vertices are 0 to {n - 1}", parameter="fixed"
        )


def refuse_floating(label: NDArray, vertices: NDArray, fixed: Mapping[int, float]) -> None:
    """Raise an error for a component without a fixed value, as its values would be arbitrary.

    Parameters
    ----------
    label : (n,) ndarray of int64
        Component of each vertex.
    vertices : (k,) ndarray of int64
        Vertices that cells use.
    fixed : mapping of vertex to value

    Raises
    ------
    ParameterError
    """
    missing = np.setdiff1d(label[vertices], label[np.array(list(fixed))])
    if len(missing):
        first = vertices[label[vertices] == missing[0]][0]
        raise ParameterError(
            f"{counted(len(missing), 'component has', 'components have')} no fixed value (one holds vertex "
            f"{first}); "
            f"add `fixed={{{first}: VALUE}}`",
            parameter="fixed",
        )
