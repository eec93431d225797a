"""Equations in time on meshes: heat and waves."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ddgcli.algorithms.laplacian.evolution import EvolutionResult, solve_evolution
from ddgcli.algorithms.laplacian.evolution_times import EvolutionTimes
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["heat_equation", "wave_equation"]


@accepts_arrays("surface", "tetrahedra")
def heat_equation(
    mesh: TriangleMesh | TetMesh,
    start: ArrayLike,
    duration: float,
    *,
    time_step: float | None = None,
    n_frames: int | None = None,
    operator: str | None = None,
    mass: str = "lumped",
) -> EvolutionResult:
    """Solution of the heat equation u' = Laplacian of u from a function on the vertices.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
        No heat flows through its boundary.
    start : (n,) array_like of float, or int
        Values at time 0, or a vertex with a function of integral 1.
    duration : float
        In length^2.
    time_step : float, optional
        Frames come at multiples of it; heat has no error of steps. Default a hundredth of the duration.
    n_frames : int, optional
        Number of frames after the first.
    operator, mass : str
        See `laplace_operator`.

    Returns
    -------
    EvolutionResult
        `evolution_frames` (each with `time`, `values` (n,), `scalar` and `time_error`), `results`,
        `accuracy` (with the largest `time_error` of a frame as `heat_time_error`).

    Raises
    ------
    MeshError, ParameterError

    Examples
    --------
    >>> import ddgcli as ddg
    >>> sphere = ddg.icosphere(3)
    >>> heat = ddg.heat_equation(sphere, sphere.points[:, 2], 0.5)
    >>> round(float(heat.evolution_frames[-1].values.max()), 2)  # exp(-2 * 0.5)
    0.37
    """
    return _solved(mesh, "heat", start, (duration, time_step, n_frames), operator, mass)


@accepts_arrays("surface", "tetrahedra")
def wave_equation(
    mesh: TriangleMesh | TetMesh,
    start: ArrayLike,
    duration: float,
    *,
    time_step: float | None = None,
    n_frames: int | None = None,
    operator: str | None = None,
    mass: str = "lumped",
) -> EvolutionResult:
    """Solution of the wave equation u'' = Laplacian of u from a function at rest, at unit speed.

    Parameters
    ----------
    mesh : TriangleMesh, TetMesh or (points, cells) pair
        Its boundary is free.
    start : (n,) array_like of float, or int
        Values at time 0, or a vertex with a bump of integral 1.
    duration : float
        In lengths.
    time_step : float, optional
        Default a hundredth of the duration; less for waves that are short for it, down to a 4,000th.
    n_frames : int, optional
        Number of frames after the first.
    operator, mass : str
        See `laplace_operator`.

    Returns
    -------
    EvolutionResult
        As `heat_equation` (`wave_time_error`); frames have `velocity` (n,) too.

    Raises
    ------
    MeshError, ParameterError

    Examples
    --------
    >>> import ddgcli as ddg
    >>> sphere = ddg.icosphere(2)
    >>> wave = ddg.wave_equation(sphere, sphere.points[:, 2], 1.0)
    >>> wave.accuracy["energy_drift"] < 1e-10
    True
    """
    return _solved(mesh, "wave", start, (duration, time_step, n_frames), operator, mass)


def _solved(
    mesh: Any, equation: str, start: ArrayLike, times: tuple[Any, Any, Any], operator: str | None, mass: str
) -> EvolutionResult:
    array = np.asarray(start)
    is_vertex = array.ndim == 0 and array.dtype.kind in "iu"
    values = int(array) if is_vertex else np.asarray(array, dtype=np.float64)
    return solve_evolution(
        laplace_operator(mesh, operator, mass), equation, values, EvolutionTimes.of(*times)
    )
