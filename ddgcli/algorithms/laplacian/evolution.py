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

from ddgcli.algorithms.laplacian.evolution_times import EvolutionTimes
from ddgcli.algorithms.laplacian.laplace_operator import LaplaceOperator
from ddgcli.choices import EVOLUTIONS
from ddgcli.errors import ParameterError, SolveError
from ddgcli.linalg.exponential import MAX_STIFFNESS, HeatSemigroup
from ddgcli.linalg.factor import Factor
from ddgcli.mesh.components import connected_labels
from ddgcli.mesh.fields import checked_values
from ddgcli.progress import ProgressCallback
from ddgcli.representation import short_repr

log = logging.getLogger("ddgcli")
HEAT, WAVE = EVOLUTIONS
# of the mean vertex area of the component (of tetrahedra volume^(2/3)): heat time of each of two steps that
# smooth the start of a wave
BUMP_TIME = 4.0
ROUNDING_RISE = 1e-12  # relative rise of the energy that rounding explains
VALUE_ROUNDING = 16 * np.finfo(np.float64).eps  # of the largest value, in each
# errors in time of heat and waves above which a warning states them
MAX_TIME_ERROR = {HEAT: 0.01, WAVE: 0.05}


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
    time_error : float
        Estimate of the largest error in time, relative to the largest value; of waves relative to their
        largest amplitude, and at an odd step that of the frame before.
    """

    step: int
    time: float
    values: NDArray[np.float64]
    velocity: NDArray[np.float64] | None
    scalar: dict[str, float]
    time_error: float = 0.0

    __repr__ = short_repr


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
    Heat: the exponential of the operator by `HeatSemigroup`, to 1e-7 at the time of each frame; steps only
    place the frames, and the integral on every component is exact. Wave: implicit midpoint rule, variational
    and of second order; it keeps the energy and the integral of a function at rest, which is restored on
    every component from the rounding of long steps; a run of steps twice as long shows its error.
    """
    n = operator.stiffness.shape[0]
    start = checked_start(start, n)
    operator.integrated(start, "start")
    vertices = operator.referenced_vertices  # rows of others are empty: no equation holds there
    L, M = (csc_array(matrix)[:, vertices][vertices] for matrix in (operator.stiffness, operator.mass))
    _check_stiffness(L, M, equation, times, start[vertices])
    solve = _heat_frames if equation == HEAT else _wave_frames
    for evolution_frame in solve(L, M, start[vertices], times):
        yield evolution_frame if len(vertices) == n else _on_all_vertices(evolution_frame, vertices, n)


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


def _check_stiffness(
    L: csc_array, M: csc_array, equation: str, times: EvolutionTimes, start: NDArray
) -> None:
    """Raise SolveError for steps after which rounding decides what is left of the function."""
    rate = float(L.diagonal().sum() / M.diagonal().sum()) if L.shape[0] else 0.0
    order = 1 if equation == HEAT else 2
    longest = times.steps * (MAX_STIFFNESS / rate) ** (1 / order) if rate > 0 else math.inf
    if times.duration > longest:
        most = 0.5 * longest
        if equation == WAVE and (frequency := _frequency(L, M, start)) > 0:
            most = min(most, times.longest_of_waves(frequency))
        without = "" if times.has_default_steps else ", without `time_step`"
        raise SolveError(
            f"`duration={times.duration:g}` is too long for a mesh of this size: rounding decides "
            f"what is left of the function; give {most:.2g} or less{without}"
        )


def _component_means(
    L: csc_array, M: csc_array
) -> tuple[Callable[[NDArray], NDArray[np.float64]], NDArray[np.float64]]:
    """Function that replaces values by their mean on each component; size of the component at each vertex."""
    count, component = _components(L)
    size = np.bincount(component, M @ np.ones(len(component)), count).astype(np.float64, copy=False)

    def means(values: NDArray) -> NDArray[np.float64]:
        return (np.bincount(component, M @ values, count) / size)[component]

    return means, size[component]


def _components(L: csc_array | csr_array) -> tuple[int, NDArray[np.int64]]:
    """Number of components that the weights join, and the component of each vertex."""
    row, column = L.nonzero()
    return connected_labels(row, column, L.shape[0])


def _heat_frames(
    L: csc_array, M: csc_array, start: NDArray, times: EvolutionTimes
) -> Iterator[EvolutionFrame]:
    """Frames of the heat equation: the mean of every component, which stays, and what decays towards it.

    Each component starts with a function of one norm, so that a small one is as accurate as a large one.
    """
    yield _evolution_frame(L, M, 0, 0.0, start, None)
    means, size = _component_means(L, M)
    mean = means(start)
    largest = float(np.abs(start).max(initial=0.0)) or 1.0
    norm = largest * np.sqrt(means(((start - mean) / largest) ** 2) * size)
    rounding = VALUE_ROUNDING * np.abs(mean) * np.sqrt(size)
    unit = np.divide(start - mean, norm, out=np.zeros_like(start), where=norm > rounding)
    dt = times.duration / times.steps
    semigroup = HeatSemigroup(
        L, M, unit, min(times.every, times.steps) * dt, times.duration, lambda v: v - means(v)
    )
    for step in times.frame_steps[1:]:
        decaying, change = semigroup.at(step * dt)
        values = mean + norm * decaying
        evolution_frame = _evolution_frame(L, M, step, step * dt, values, None)
        yield replace(evolution_frame, time_error=_relative_size(norm * change, values))


def _wave_frames(
    L: csc_array, M: csc_array, start: NDArray, times: EvolutionTimes
) -> Iterator[EvolutionFrame]:
    """Frames of the wave equation; steps of twice the length show the error, which is of second order.

    A single step is compared with two steps of half its length.
    """
    dt, ratio = times.duration / times.steps, 2.0 if times.steps > 1 else 0.5
    wave, other = _Midpoint(L, M, start, dt), _Midpoint(L, M, start, ratio * dt)
    time_error, frequency = 0.0, _frequency(L, M, start)
    for step in times.frame_steps:
        wave.advance(step)
        if step % ratio == 0:
            other.advance(round(step / ratio))
            # standing waves pass through zero, where their velocity is largest
            swing = wave.velocity / frequency if frequency > 0 else 0.0
            time_error = _relative_size((wave.u - other.u) / (ratio**2 - 1.0), np.hypot(wave.u, swing))
        evolution_frame = _evolution_frame(L, M, step, step * dt, wave.u, wave.velocity)
        yield replace(evolution_frame, time_error=time_error)


def _frequency(L: csc_array | csr_array, M: csc_array | csr_array, values: NDArray) -> float:
    """Fourth root of the mean fourth power of the frequencies of a function, weighted by their energies."""
    largest = float(np.abs(values).max(initial=0.0))
    offset = values / largest - (values / largest).mean() if largest else values
    if np.abs(offset).max(initial=0.0) <= VALUE_ROUNDING:
        return 0.0
    acceleration = (L @ offset) / (M @ np.ones(len(values)))
    peak, energy = float(np.abs(acceleration).max()), _dirichlet_energy(L, offset)
    if not (energy > 0 and 0 < peak < math.inf):
        return 0.0
    return math.sqrt(peak) * float(_dirichlet_energy(L, acceleration / peak) / energy) ** 0.25


class _Midpoint:
    """Implicit midpoint rule for the wave equation, from rest."""

    def __init__(self, L: csc_array, M: csc_array, start: NDArray, dt: float) -> None:
        self.L, self.M, self.dt, self.step = L, M, dt, 0
        self.factor, self.means = Factor(csc_array(M + 0.25 * dt**2 * L)), _component_means(L, M)[0]
        self.u, self.velocity = start, np.zeros_like(start)

    def advance(self, step: int) -> None:
        """Advance to the given step."""
        for _ in range(step - self.step):
            # the mean velocity w of the step: (M + dt^2 L / 4) w = M v - dt L u / 2
            mean = self.factor.solve(self.M @ self.velocity - 0.5 * self.dt * (self.L @ self.u))
            mean = mean + self.means(self.velocity - mean)
            self.u, self.velocity = self.u + self.dt * mean, 2.0 * mean - self.velocity
        self.step = step


def _relative_size(error: NDArray, values: NDArray) -> float:
    return float(np.abs(error).max() / (np.abs(values).max() or 1.0))


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
    """Frames of `evolve_function`, and how well they conserve the invariants.

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
    if equation == WAVE:
        vertices, values = operator.referenced_vertices, checked_start(start, len(operator.mass.diagonal()))
        L, M = (matrix[vertices][:, vertices] for matrix in (operator.stiffness, operator.mass))
        times = times.for_waves_of(_frequency(L, M, values[vertices]))
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
        noise = math.sqrt(_energy_of_rounding(operator, evolution_frames[0].values))
        rise = [b > (np.sqrt(a) + noise) ** 2 * (1 + ROUNDING_RISE) for a, b in zip(energy, energy[1:])]
        accuracy["energy_increases"] = int(sum(rise))
    else:
        accuracy["energy_drift"] = max(abs(e - energy[0]) for e in energy) / (energy[0] or 1.0)
    accuracy[f"{equation}_time_error"] = _worst_time_error(evolution_frames, equation)
    results = {"equation": equation, "steps": times.steps, "dt": times.duration / times.steps}
    return EvolutionResult(
        evolution_frames, results | {"times": [f.time for f in evolution_frames], **series}, accuracy
    )


def _worst_time_error(evolution_frames: list[EvolutionFrame], equation: str) -> float:
    """Largest error in time of a frame; warn of a large one."""
    worst = max(evolution_frames, key=lambda evolution_frame: evolution_frame.time_error)
    if worst.time_error > MAX_TIME_ERROR[equation]:
        remedy = "give fewer frames (`n_frames`)" if equation == HEAT else "give a shorter `time_step`"
        size = "largest value" if equation == HEAT else "amplitude"
        share = f"{100 * worst.time_error:.2g} % of its {size}"
        log.warning(f"the {equation} at time {worst.time:g} errs by about {share}: {remedy}")
    return worst.time_error


def _energy_of_rounding(operator: LaplaceOperator, start: NDArray) -> float:
    """Bound of the energy that rounding of its values adds to a uniform function."""
    error = VALUE_ROUNDING * float(np.abs(start).max(initial=0.0))
    return 0.5 * float(abs(operator.stiffness).sum()) * error**2


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
