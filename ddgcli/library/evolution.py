"""Equations in time: heat and waves on meshes, flows of curves."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ddgcli.algorithms.laplacian.evolution import EvolutionResult, EvolutionTimes, solve_evolution
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.errors import ParameterError
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.library.simulations import Simulation, trajectory_frames
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.curve import setup
from ddgcli.simulation.account import Account

__all__ = ["curve_flow", "heat_equation", "wave_equation"]


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
        Default a hundredth of the duration.
    n_frames : int, optional
        Number of frames behind the first.
    operator, mass : str
        See `laplace_operator`.

    Returns
    -------
    EvolutionResult
        `evolution_frames` (each with `time`, `values` (n,) and `scalar`), `results`, `accuracy`.

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
        Default a hundredth of the duration.
    n_frames : int, optional
        Number of frames behind the first.
    operator, mass : str
        See `laplace_operator`.

    Returns
    -------
    EvolutionResult
        As `heat_equation`; frames have `velocity` (n,) too.

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


@accepts_arrays("curve")
def curve_flow(
    mesh: CurveSet,
    flow: str = "curvature",
    *,
    steps: int | None = None,
    duration: float | None = None,
    step: float | None = None,
    frame_every: float | None = None,
    tolerance: float | None = None,
    redistribute: bool = True,
    length_penalty: float | None = None,
) -> Simulation:
    """Flow of polylines down their length or bending energy, frame by frame.

    Parameters
    ----------
    mesh : CurveSet or (points, lines) pair
        Plane or space curves; the ends of open ones stay fixed.
    flow : {'curvature', 'area-preserving', 'elastic'}
    steps : int, optional
        Steps to take; without it and `duration` the flow ends at rest.
    duration, step, frame_every : float, optional
        In length^2, with 'elastic' in length^4.
    tolerance : float, optional
        Largest error of a step, relative to the size of the curves; needs `duration`.
    redistribute : bool
        Move points along the curve towards equal distances.
    length_penalty : float, optional
        'elastic': weight of the length in the energy, in the place of a constant length.

    Returns
    -------
    Simulation
        Iterator of frames: `time`, `points` (n, 3), `vertex` (`curvature`), `scalar` (`length`, `area`,
        `elastic_energy`, `self_crossings`).

    Raises
    ------
    MeshError, ParameterError

    Examples
    --------
    >>> import ddgcli as ddg
    >>> square = ddg.CurveSet.from_arrays([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> *_, last = ddg.curve_flow(square, duration=0.05, step=0.001)
    >>> bool(last.scalar["length"] < 4)
    True
    """
    options = {"flow": flow, "redistribute": redistribute, "length_penalty": length_penalty}
    if steps is not None and steps < 1:
        raise ParameterError(f"must be 1 or more, not {steps}", parameter="steps")
    bounded = steps is not None or duration is not None
    curves = setup.without_repeated_points(mesh)
    curve, model = setup.build(
        curves,
        setup.CurveFlowOptions(
            flow=flow, redistribute=redistribute, length_penalty=length_penalty, stop_at_rest=not bounded
        ),
    )
    times = {"steps": steps, "duration": duration, "step": step, "frame_every": frame_every,
             "tolerance": tolerance}  # fmt: skip
    schedule = setup.schedule(curve, {name: value for name, value in times.items() if value is not None})
    return Simulation(
        curves, options, schedule.n_frames, trajectory_frames({"curve": model}, schedule, Account())
    )
