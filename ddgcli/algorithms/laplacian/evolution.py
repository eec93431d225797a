"""Heat and wave equation on a surface or on tetrahedra as trajectories of a function on its vertices."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array

from ddgcli.algorithms.laplacian.laplace_operator import LaplaceOperator
from ddgcli.choices import EVOLUTIONS
from ddgcli.errors import ParameterError, SolveError, counted
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.fields import checked_values
from ddgcli.progress import ProgressCallback
from ddgcli.representation import short_repr

log = logging.getLogger("ddgcli")
HEAT, WAVE = EVOLUTIONS
GAMMA = 2.0 - math.sqrt(2.0)  # of the two stages of TR-BDF2: both have the same matrix
MAX_STEPS = 1_000_000
# of the mean vertex area of the component (of tetrahedra volume^(2/3)): heat time of each of two steps that
# smooth the start of a wave
BUMP_TIME = 4.0
MAX_STIFFNESS = 1e13  # of a step: above it M + dt L is singular to rounding
ROUNDING_RISE = 1e-12  # relative rise of the energy that rounding explains
SOLVE_ROUNDING = 16 * np.finfo(np.float64).eps  # of the terms of a row, in the residual of a step
DEFAULT_STEPS, DEFAULT_FRAMES = 100, 50


@dataclass(frozen=True, eq=False)
class EvolutionFrame:
    """A function at one time.

    Parameters
    ----------
    step : int
    time : float
        Heat: length^2. Wave: length, at unit speed.
    values : (n,) ndarray
    velocity : (n,) ndarray, or None for heat
    scalar : dict of str to float
        `total` (integral), `min`, `max`, `energy` (half the integral of the squared gradient; of waves with
        half the integral of the squared velocity).
    """

    step: int
    time: float
    values: NDArray[np.float64]
    velocity: NDArray[np.float64] | None
    scalar: dict[str, float]

    __repr__ = short_repr


@dataclass(frozen=True)
class EvolutionTimes:
    """Time of an evolution.

    Parameters
    ----------
    duration : float
    steps : int
    every : int
        Steps between frames.
    """

    duration: float
    steps: int
    every: int

    @classmethod
    def of(cls, duration: float | None, time_step: float | None, n_frames: int | None) -> EvolutionTimes:
        """Times from options: steps divide the duration evenly; 100 of them unless `time_step` is set.

        Raises
        ------
        ParameterError
            Without a duration, with a step longer than it, or with too many steps.
        """
        if duration is None:
            raise ParameterError("give the time to evolve with `duration=TIME`", parameter="duration")
        for name, number in (("duration", duration), ("time_step", time_step)):
            if number is not None and not (0 < number < math.inf):
                raise ParameterError(f"must be a positive number, not {number:g}", parameter=name)
        if n_frames is not None and n_frames < 1:
            raise ParameterError(f"must be 1 or more, not {n_frames}", parameter="n_frames")
        if time_step is not None and time_step > duration * (1 + 1e-9):
            raise ParameterError(
                f"{time_step:g} is longer than the duration of {duration:g}; give {duration:g} or less",
                parameter="time_step",
            )
        ratio = DEFAULT_STEPS if time_step is None else duration / time_step  # infinite where it overflows
        count = max(1, math.ceil(min(ratio, 2.0 * MAX_STEPS) - 1e-9))
        if count > MAX_STEPS:
            raise ParameterError(
                f"{ratio:,.10g} steps are more than {MAX_STEPS:,}; take longer ones", parameter="time_step"
            )
        times = cls(duration, count, max(1, math.ceil(count / (n_frames or min(count, DEFAULT_FRAMES)))))
        times.warn_of_other(time_step, n_frames)
        return times

    def warn_of_other(self, time_step: float | None, n_frames: int | None) -> None:
        """Report a step and a number of frames that are others than the options name."""
        dt, count = self.duration / self.steps, math.ceil(self.steps / self.every)
        if time_step is not None and abs(dt - time_step) > 1e-6 * time_step:
            log.warning(
                f"`time_step={time_step:g}` does not divide the duration of {self.duration:g}: "
                f"steps take {dt:g}"
            )
        if n_frames is not None and count != n_frames:
            every = "each step" if self.every == 1 else f"every {self.every} steps"
            log.warning(
                f"`n_frames={n_frames}` does not divide {counted(self.steps, 'step', 'steps')}: "
                f"frames come {every}, {count} of them"
            )


def evolve_function(
    operator: LaplaceOperator, equation: str, start: NDArray, times: EvolutionTimes
) -> Iterator[EvolutionFrame]:
    """Solve the heat or the wave equation from a function at rest; yield frames as they are computed.

    Parameters
    ----------
    operator : LaplaceOperator
        M u' = -L u (heat), M u'' = -L u (wave, unit speed); the boundary is natural (no flux, free).
    equation : {'heat', 'wave'}
    start : (n,) ndarray
    times : EvolutionTimes

    Yields
    ------
    EvolutionFrame
        The first at time 0, the last at the duration; 0 at vertices of no cell.

    Notes
    -----
    Heat: TR-BDF2, of second order and L-stable; it keeps the integral. Wave: implicit midpoint rule,
    variational and of second order; it keeps the energy and the integral of a function at rest. Each needs
    one factorisation. After each step the integral on every component is restored from the rounding of long
    steps.
    """
    n = operator.stiffness.shape[0]
    start = checked_start(start, n)
    operator.integrated(start, "start")
    vertices = operator.referenced_vertices  # rows of others are empty: no equation holds there
    L, M = (csc_array(matrix)[:, vertices][vertices] for matrix in (operator.stiffness, operator.mass))
    u = start[vertices]
    dt = times.duration / times.steps
    _check_stiffness(L, M, equation, times)
    advance = _heat_step(L, M, dt) if equation == HEAT else _wave_step(L, M, dt)
    velocity = None if equation == HEAT else np.zeros_like(u)
    for step in range(times.steps + 1):
        if step % times.every == 0 or step == times.steps:
            evolution_frame = _evolution_frame(L, M, step, step * dt, u, velocity)
            yield evolution_frame if len(vertices) == n else _on_all_vertices(evolution_frame, vertices, n)
        if step < times.steps:
            u, velocity = advance(u, velocity)


def checked_start(start: NDArray, n: int) -> NDArray[np.float64]:
    """Check the function from which an evolution starts.

    Parameters
    ----------
    start : (n,) or (n, 1) ndarray
    n : int
        Vertices of the mesh.

    Returns
    -------
    (n,) ndarray of float64

    Raises
    ------
    ParameterError
        For another shape or values that are not finite.
    """
    return checked_values(start, n, "vertex", parameter="start", widths=(1,)).reshape(n)


def _check_stiffness(L: csc_array, M: csc_array, equation: str, times: EvolutionTimes) -> None:
    """Raise SolveError for steps after which rounding decides what is left of the function."""
    rate = float(L.diagonal().sum() / M.diagonal().sum()) if L.shape[0] else 0.0
    order = 1 if equation == HEAT else 2
    longest = times.steps * (MAX_STIFFNESS / rate) ** (1 / order) if rate > 0 else math.inf
    if times.duration > longest:
        raise SolveError(
            f"`duration={times.duration:g}` is too long for a mesh of this size: rounding decides "
            f"what is left of the function; give {0.5 * longest:.1g} or less"
        )


def _integral_correction(L: csc_array, M: csc_array) -> Callable[[NDArray, NDArray], NDArray[np.float64]]:
    """Function of (before, after) that shifts `after` to the integral of `before` on every component."""
    count, component = _components(L)
    size = np.bincount(component, M @ np.ones(len(component)), count)

    def correct(before: NDArray, after: NDArray) -> NDArray[np.float64]:
        return after + (np.bincount(component, M @ (before - after), count) / size)[component]

    return correct


def _components(L: csc_array | csr_array) -> tuple[int, NDArray[np.int64]]:
    """Number of components that the weights join, and the component of each vertex."""
    row, column = L.nonzero()
    return connected_labels(row, column, L.shape[0])


def _heat_step(L: csc_array, M: csc_array, dt: float):
    factor = Factor(csc_array(M + 0.5 * GAMMA * dt * L))
    first, last = 1.0 / (GAMMA * (2.0 - GAMMA)), (1.0 - GAMMA) ** 2 / (GAMMA * (2.0 - GAMMA))
    with_integral_of = _integral_correction(L, M)

    def step(u: NDArray, velocity: NDArray | None) -> tuple[NDArray, None]:
        middle = factor.solve(M @ u - 0.5 * GAMMA * dt * (L @ u))
        return with_integral_of(u, factor.solve(M @ (first * middle - last * u))), None

    return step


def _wave_step(L: csc_array, M: csc_array, dt: float):
    factor = Factor(csc_array(M + 0.25 * dt**2 * L))
    with_integral_of = _integral_correction(L, M)

    def step(u: NDArray, velocity: NDArray) -> tuple[NDArray, NDArray]:
        # the mean velocity w of the step: (M + dt^2 L / 4) w = M v - dt L u / 2
        mean = with_integral_of(velocity, factor.solve(M @ velocity - 0.5 * dt * (L @ u)))
        return u + dt * mean, 2.0 * mean - velocity

    return step


def _evolution_frame(
    L: csc_array, M: csc_array, step: int, time: float, u: NDArray, velocity: NDArray | None
) -> EvolutionFrame:
    energy = _dirichlet_energy(L, u)
    if velocity is not None:
        energy += 0.5 * float(velocity @ (M @ velocity))
    total = float((M @ u).sum())
    scalar = {"total": total, "min": float(u.min()), "max": float(u.max()), "energy": energy}
    return EvolutionFrame(step, time, u, velocity, scalar)


def _dirichlet_energy(L: csc_array, u: NDArray) -> float:
    """Half of u' L u by differences over edges: 0 for a constant, and without its cancellation."""
    entries = L.tocoo()
    row, column = entries.coords
    return -0.25 * float(entries.data @ (u[row] - u[column]) ** 2)


def _on_all_vertices(evolution_frame: EvolutionFrame, vertices: NDArray, n: int) -> EvolutionFrame:
    """A function on some vertices as one on all n; 0 elsewhere."""

    def spread(values: NDArray) -> NDArray[np.float64]:
        whole = np.zeros(n)
        whole[vertices] = values
        return whole

    velocity = None if evolution_frame.velocity is None else spread(evolution_frame.velocity)
    return replace(evolution_frame, values=spread(evolution_frame.values), velocity=velocity)


@dataclass(frozen=True, eq=False)
class EvolutionResult:
    """Frames of an evolution, with its results and accuracy.

    Parameters
    ----------
    evolution_frames : list of EvolutionFrame
    results, accuracy : dict
        For the summary.
    """

    evolution_frames: list[EvolutionFrame]
    results: dict[str, Any]
    accuracy: dict[str, Any]

    __repr__ = short_repr

    @property
    def arrays(self) -> dict[str, NDArray]:
        """Vertex arrays of the last frame by their names in files."""
        return frame_arrays(self.evolution_frames[-1])


def array_names(equation: str) -> tuple[str, ...]:
    """Names of the vertex arrays of a frame.

    Parameters
    ----------
    equation : {'heat', 'wave'}

    Returns
    -------
    tuple of str
    """
    return (HEAT,) if equation == HEAT else (WAVE, "wave_velocity")


def frame_arrays(evolution_frame: EvolutionFrame) -> dict[str, NDArray]:
    """Vertex arrays of a frame, by name.

    Parameters
    ----------
    evolution_frame : EvolutionFrame

    Returns
    -------
    dict of str to (n,) ndarray
        `heat`, or `wave` and `wave_velocity`.
    """
    if evolution_frame.velocity is None:
        return {HEAT: evolution_frame.values}
    return {WAVE: evolution_frame.values, "wave_velocity": evolution_frame.velocity}


def solve_evolution(
    operator: LaplaceOperator,
    equation: str,
    start: NDArray | int,
    times: EvolutionTimes,
    progress: ProgressCallback | None = None,
) -> EvolutionResult:
    """Frames of `evolve_function`, and the quantities that they keep.

    Parameters
    ----------
    operator : LaplaceOperator
    equation : {'heat', 'wave'}
    start : (n,) ndarray or int
        Values at the vertices, or a vertex that holds a function of integral 1 (of waves spread over some
        edges).
    times : EvolutionTimes
    progress : callable, optional
        Called with the number of finished steps and of all steps.

    Returns
    -------
    EvolutionResult

    Raises
    ------
    ParameterError
        For an unknown equation or a bad start.
    """
    if equation not in EVOLUTIONS:
        raise ParameterError(f"{equation!r} is not one of {', '.join(EVOLUTIONS)}", parameter="equation")
    if isinstance(start, int):
        start = _unit_at(operator, start, equation)
    evolution_frames = []
    for evolution_frame in evolve_function(operator, equation, start, times):
        evolution_frames.append(evolution_frame)
        if progress is not None:
            progress(evolution_frame.step, times.steps)
    series = {
        name: [evolution_frame.scalar[name] for evolution_frame in evolution_frames]
        for name in evolution_frames[0].scalar
    }
    amount = float((operator.mass @ np.abs(evolution_frames[0].values)).sum()) or 1.0
    accuracy: dict[str, Any] = {
        "total_drift": max(abs(total - series["total"][0]) for total in series["total"]) / amount
    }
    energy = series["energy"]
    if equation == HEAT:
        noise = times.every * np.sqrt(_energy_of_rounding(operator, evolution_frames[0].values, times))
        rise = [b > (np.sqrt(a) + noise) ** 2 * (1 + ROUNDING_RISE) for a, b in zip(energy, energy[1:])]
        accuracy["energy_increases"] = int(sum(rise))
    else:
        accuracy["energy_drift"] = max(abs(e - energy[0]) for e in energy) / (energy[0] or 1.0)
    results = {"equation": equation, "steps": times.steps, "dt": times.duration / times.steps}
    return EvolutionResult(
        evolution_frames, results | {"times": [f.time for f in evolution_frames], **series}, accuracy
    )


def _energy_of_rounding(operator: LaplaceOperator, start: NDArray, times: EvolutionTimes) -> float:
    """Bound of the energy that rounding adds to a uniform function in one step of the heat equation.

    A solve with A = M + c L leaves a residual r of some units of |A| |u|, so that u errs by e = A^-1 r, and
    e' L e <= r' A^-1 r / c <= r' M^-1 r / c.
    """
    scale = 0.5 * GAMMA * times.duration / times.steps
    size = operator.mass @ np.ones(len(start))
    terms = (abs(operator.mass) + scale * abs(operator.stiffness)) @ np.full(len(start), np.abs(start).max())
    inverse = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    error = SOLVE_ROUNDING * terms * np.sqrt(inverse / scale)  # terms^2 may overflow
    return 0.5 * float(error @ error)


def check_start_vertex(start: int, n: int, has_size: NDArray) -> None:
    """Raise an error for a vertex that does not exist, or whose cells have no size.

    Parameters
    ----------
    start : int
    n : int
        Vertices of the mesh.
    has_size : (n,) ndarray of bool
        Vertices with a cell that has a size.

    Raises
    ------
    ParameterError
    """
    if not 0 <= start < n:
        raise ParameterError(f"vertex {start} is outside 0..{n - 1}", parameter="start")
    if not has_size[start]:
        raise ParameterError(f"vertex {start} has no cell with a size; choose another", parameter="start")


def _unit_at(operator: LaplaceOperator, vertex: int, equation: str) -> NDArray[np.float64]:
    """Function of integral 1 at one vertex."""
    n = operator.stiffness.shape[0]
    vertex_size = operator.mass @ np.ones(n)
    check_start_vertex(vertex, n, vertex_size > 0)
    area = float(vertex_size[vertex])
    start = np.zeros(n)
    start[vertex] = 1.0 / area
    if equation == HEAT:
        return start
    # waves as short as an edge travel too slowly: the bump spreads over some edges first
    _, component = _components(operator.stiffness)
    vertices = np.flatnonzero((component == component[vertex]) & (operator.mass.diagonal() > 0))
    L, M = (csc_array(matrix)[:, vertices][vertices] for matrix in (operator.stiffness, operator.mass))
    time = BUMP_TIME * float((M @ np.ones(len(vertices))).mean()) ** (2.0 / operator.dimension)
    factor = Factor(csc_array(M + time * L))
    start[vertices] = factor.solve(M @ factor.solve(M @ start[vertices]))
    return start
