"""Flows of surfaces and curves down their bending energy, area or length."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np
from numpy.typing import ArrayLike

from ddgcli.errors import MeshError, ParameterError, renamed_parameters
from ddgcli.library.mesh_arguments import accepts_arrays
from ddgcli.library.simulations import End, Simulation
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.midpoint_subdivision import MidpointSubdivision
from ddgcli.mesh.requirements import unmet_need
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.curve.flow_run import CurveFlowRun, curve_flow_run
from ddgcli.models.curve.setup import CurveFlowOptions
from ddgcli.models.willmore.flow_options import FlowOptions, remesh_length
from ddgcli.models.willmore.flow_run import FlowRun, flow_run
from ddgcli.models.willmore.state import Stop
from ddgcli.simulation.account import Account
from ddgcli.simulation.outcome import Outcome
from ddgcli.simulation.time_loop import evolve

__all__ = ["curve_flow", "willmore_flow"]


@accepts_arrays("surface")
def willmore_flow(
    mesh: TriangleMesh,
    flow: str = "quadratic",
    *,
    energy: str | None = None,
    boundary: str | None = None,
    fix_area: bool = False,
    fix_volume: bool = False,
    spontaneous_curvature: float = 0.0,
    region: ArrayLike | None = None,
    fill: int | str | None = None,
    subdivide: int = 0,
    remesh: float | str | None = None,
    remesh_adaptive: bool = False,
    steps: int | None = None,
    duration: float | None = None,
    step: float | None = None,
    frame_every: float | None = None,
    tolerance: float | None = None,
    integrator: str | None = None,
    stop_gradient: float | None = None,
    stop_energy: float | None = None,
    report_energy: str | None = None,
) -> Simulation:
    """Flow of a surface down its bending energy int H^2 (or its area), frame by frame.

    Without `step` and `duration` the flow minimises: each step is as long as the decrease of the energy
    allows, and the flow stops at a stationary shape. With them, steps follow the flow in time.

    Parameters
    ----------
    mesh : TriangleMesh or (points, faces) pair
        Oriented manifold.
    flow : {'quadratic', 'newton', 'circle-angle', 'conformal', 'mean-curvature'}
    energy : str, optional
        Discrete bending energy: 'gauss-map' (default of closed surfaces), 'cotan' (of open ones), 'hinge',
        'sullivan', 'quadratic', 'circle-angle'.
    boundary : {'clamped', 'fixed', 'free'}, optional
        What stays fixed at the boundary; default 'clamped', of 'mean-curvature' 'fixed'.
    fix_area, fix_volume : bool
        Keep the area, the enclosed volume, of each component its own.
    spontaneous_curvature : float
        H0 of int (H - H0)^2, in 1/length, positive as on a sphere; needs `fix_area` or `fix_volume`.
    region : (n,) array_like of bool or number, or (k,) of vertex indices, optional
        Vertices that move; all others stay.
    fill : int or 'all', optional
        Vertex on the boundary loop to close first; only the patch of new triangles moves.
    subdivide : int
        How often every face is split in four first; `region` and `fill` have the vertices of `mesh`, which
        keep their indices.
    remesh : 'mean' or float, optional
        Length of edges that a flow to rest keeps by splits, collapses and flips.
    remesh_adaptive : bool
        Shorter edges where the surface is curved.
    steps : int, optional
        Steps to take; without it and `duration` the flow ends at rest.
    duration, step, frame_every : float, optional
        In length^4, of 'mean-curvature' in length^2.
    tolerance : float, optional
        Largest error of a step, relative to the size of the surface; needs `duration`.
    integrator : {'rosenbrock', 'semi-implicit'}, optional
        Time scheme.
    stop_gradient, stop_energy : float, optional
        Rest: |gradient| area / energy, and the relative fall of the energy in a step, below these.
    report_energy : 'all', optional
        Every frame has all energies (`scalar["energy_cotan"]`, ...), and the results have `energies`.

    Returns
    -------
    Simulation
        Iterator of frames: `points` (n, 3), `scalar` (`energy`, `area`, `volume`, `steps`, ...), `faces`
        (m, 3) where they change. `finish` runs to the end and returns the last surface with the results.

    Raises
    ------
    MeshError, ParameterError
    SolveError
        While frames are taken: a step failed for good. The frames before it are valid.

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ball = ddg.icosphere(2)
    >>> end = ddg.willmore_flow(ball.moved(ball.points * [1, 1, 1.5])).finish()
    >>> round(end.results["energy"][-1] / (4 * 3.141593), 2), end.converged  # a round sphere: 4 pi
    (1.0, True)
    """
    if message := unmet_need(mesh, "willmore-flow"):
        raise MeshError(message)
    times = _times(steps, duration, step, frame_every, tolerance)
    for name, limit in (("stop_gradient", stop_gradient), ("stop_energy", stop_energy)):
        if limit is not None and not 0 < limit < math.inf:
            raise ParameterError(f"must be a positive number, not {limit:g}", parameter=name)
    options = FlowOptions(
        energy, flow, boundary, fix_area, fix_volume, spontaneous_curvature, report_energy,
        integrator=integrator, remesh=remesh_length(remesh), remesh_adaptive=remesh_adaptive,
        stop=Stop(stop_gradient, stop_energy),
    )  # fmt: skip
    with renamed_parameters(times="subdivide"):
        subdivision = MidpointSubdivision.of(mesh, subdivide) if subdivide else None
    values = None if region is None else np.asarray(region, np.float64)
    run = flow_run(mesh, options, times, region=values, fill=fill, subdivision=subdivision)
    return _simulation("surface", run.mesh, run, changing_vertices=remesh is not None)


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
        'elastic': weight of the length in the energy, instead of a constant length.

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
    times = _times(steps, duration, step, frame_every, tolerance)
    run = curve_flow_run(mesh, CurveFlowOptions(flow, redistribute, length_penalty), times)
    return _simulation("curve", run.curves, run)


def _simulation(
    name: str, mesh: TriangleMesh | CurveSet, run: FlowRun | CurveFlowRun, changing_vertices: bool = False
) -> Simulation:
    """The run of a flow, frame by frame."""

    def end_of(outcome: Outcome) -> End:
        reason = run.failure_reason(outcome)
        return End(*run.summary(outcome), reason)

    snapshots = evolve({name: run.model}, run.schedule, Account())
    return Simulation(mesh, asdict(run.options), run.schedule.n_frames, snapshots, end_of, changing_vertices)


def _times(
    steps: int | None,
    duration: float | None,
    step: float | None,
    frame_every: float | None,
    tolerance: float | None,
) -> dict[str, float]:
    """The time options that are not None, by name."""
    if steps is not None and steps < 1:
        raise ParameterError(f"must be 1 or more, not {steps}", parameter="steps")
    times = {"steps": steps, "duration": duration, "step": step, "frame_every": frame_every,
             "tolerance": tolerance}  # fmt: skip
    return {name: value for name, value in times.items() if value is not None}
