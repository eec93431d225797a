"""Interface between simulators and the time loop: models, observations, the schedule, failed steps."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Generic, TypeVar

from numpy.typing import NDArray

from ddgcli.errors import ParameterError, SolveError

log = logging.getLogger("ddgcli")

State = TypeVar("State")
Arrays = dict[str, NDArray]


MAX_STEP_COUNT = 1e9  # steps of a run
MAX_HALVINGS = 12  # halvings of one step: down to dt / 4096
STEP_GROWTH = 1.1  # see `Model.growth`


class Cause(StrEnum):
    """Causes of failed steps that the loop handles specially; other causes are strings."""

    NOT_FINITE = "not finite"
    STABILITY_LIMIT = "stability limit"  # `value` is the step times the largest rate, 1 or more


class StepRejected(Exception):
    """Failed step, which the time loop shortens, or which ends the run.

    Parameters
    ----------
    cause : Cause or str
        "newton", "inverted", ...
    place : str
        "vertex 12", "edge 3", or "".
    value : float
    solved : bool
        Whether the equations of the step were solved and only the result was rejected; then the fallback of
        the scheme (`Model.rescue`) is tried.
    halvings : int
        Largest number of halvings of the step for this cause.
    """

    def __init__(
        self,
        cause: Cause | str,
        place: str = "",
        value: float = math.nan,
        solved: bool = False,
        halvings: int = MAX_HALVINGS,
    ) -> None:
        place_text = f" at {place}" if place else ""
        super().__init__(cause + place_text + ("" if math.isnan(value) else f" ({value:.3g})"))
        self.cause, self.place, self.value, self.solved = cause, place, value, solved
        self.halvings = halvings


@dataclass(frozen=True)
class Ending:
    """Why a model ends its run before the last step.

    Parameters
    ----------
    kind : str
        Machine-readable kind; each model has its own kinds.
    text : str
        Text for users.
    """

    kind: str
    text: str


@dataclass(frozen=True)
class Event:
    """Event of a run, such as a failed step; one line of the event log."""

    step: int
    time: float
    kind: str
    place: str = ""
    value: float = math.nan
    detail: str = ""


NO_REJECTIONS = ("start", "stability", "stop")  # kinds of events: a step that is divided did not fail


def rejections(kinds: Iterable[str]) -> int:
    """Number of rejected steps.

    Parameters
    ----------
    kinds : iterable of str
        Kinds of the events.

    Returns
    -------
    int
    """
    return sum(kind not in NO_REJECTIONS for kind in kinds)


class RunFailed(SolveError):
    """Error of a step that failed even after it was shortened; `events` are those since the last snapshot."""

    def __init__(self, message: str, events: tuple[Event, ...]) -> None:
        super().__init__(message)
        self.events = events


@dataclass(frozen=True, eq=False)
class Observation:
    """Observed quantities of a state.

    Parameters
    ----------
    points : (n, 3) ndarray, or None where the surface does not move
    vertex : dict of str to ndarray of leading length n
    scalar : dict of str to float or (k,) ndarray
        Sums over the models of a run (energies, momenta, counts).
    place : int
        Index of the object in the scene, if a model has several objects.
    faces : (m, 3) ndarray of int, optional
        Faces, if they change during the run; their number m is constant. All objects of a run then have them.
    face : dict of str to ndarray of leading length m
    n_faces : int
        m, if any object of the run has arrays on faces.
    """

    points: NDArray | None
    vertex: Arrays = field(default_factory=dict)
    scalar: dict[str, Any] = field(default_factory=dict)
    place: int = 0
    faces: NDArray | None = None
    face: Arrays = field(default_factory=dict)
    n_faces: int = 0


@dataclass(frozen=True, eq=False)
class Model(Generic[State]):
    """One independent system, as functions of its state.

    Parameters
    ----------
    start : State
        Initial state.
    advance : callable (state, time, dt) -> state
        One step; a pure function of its arguments (caches may only save work). Raises StepRejected.
    observe : callable state -> Observation, or dict of str to Observation
        The dict has an observation of each object of the system.
    pack, unpack : callables
        Convert a state to named arrays of fixed shape (the checkpoint), and back without rounding.
    largest_step : float
        Stability limit of the scheme, or inf; longer steps are divided, with a warning.
    distance : callable (state, state) -> float, optional
        Error measure of adaptive steps, relative to the model's own scale.
    order : int
        Order of the scheme, for adaptive steps.
    stop : callable state -> Ending or None, optional
        Reason to end the run at a state, or None.
    clock : callable state -> float, optional
        Time of a state, for schemes that choose their own steps; by default the step times dt.
    rescue : callable like `advance`, optional
        Fallback scheme for a step that `advance` has solved and rejected, tried before the step is shortened.
    time_unit : str
        Unit of time in messages.
    advice : callable () -> str, optional
        Advice after a failed step, for models in which a shorter step does not help.
    growth : float
        Factor on the largest part of a step that is tried, after each success that follows a failure.
    usual_step : float
        Default step, or inf. If a longer step fails, the message recommends this one, because the longest
        solvable step may be too long to resolve the motion.
    iterations : callable state -> float, optional
        Number of Newton iterations up to a state, for models in which those of a step grow with the motion.
    least_tolerance : callable state -> float, optional
        Smallest tolerance that adaptive steps from a state can meet: rounding of their error measure.
    """

    start: State
    advance: Callable[[State, float, float], State]
    observe: Callable[[State], Observation | dict[str, Observation]]
    pack: Callable[[State], Arrays]
    unpack: Callable[[Arrays], State]
    largest_step: float = math.inf
    distance: Callable[[State, State], float] | None = None
    order: int = 1
    stop: Callable[[State], Ending | None] | None = None
    clock: Callable[[State], float] | None = None
    rescue: Callable[[State, float, float], State] | None = None
    time_unit: str = "s"
    advice: Callable[[], str] | None = None
    growth: float = STEP_GROWTH
    usual_step: float = math.inf
    iterations: Callable[[State], float] | None = None
    least_tolerance: Callable[[State], float] | None = None


@dataclass(frozen=True)
class Schedule:
    """Times of steps and frames.

    Parameters
    ----------
    dt : float
        Seconds.
    steps : int
        Number of steps of length dt to the end of the run.
    every : int
        Steps from frame to frame.
    tolerance : float, optional
        Adaptive steps: largest distance between one step and two half steps.
    on_failure : {'shrink', 'stop'}
    first_dt : float, optional
        First guess of adaptive steps.
    """

    dt: float
    steps: int
    every: int = 1
    tolerance: float | None = None
    on_failure: str = "shrink"
    first_dt: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.dt) and self.dt > 0):
            raise ParameterError(f"must be a positive number, not {self.dt}", parameter="dt")
        for name, least in (("steps", 0), ("every", 1)):
            if (count := getattr(self, name)) < least:
                raise ParameterError(f"must be {least} or more, not {count}", parameter=name)

    @property
    def n_frames(self) -> int:
        """Number of frames, the first at the start and the last at the end."""
        return 1 + math.ceil(self.steps / self.every)

    def step_of_frame(self, frame_number: int) -> int:
        return min(frame_number * self.every, self.steps)


def parts_of_step(dt: float, limit: float, *, adaptive: bool = False) -> float:
    """Number of parts into which a step above the stability limit is divided.

    Fixed steps are halved repeatedly, adaptive ones are divided into equal parts.

    Parameters
    ----------
    dt, limit : float
    adaptive : bool

    Returns
    -------
    float
    """
    if not dt > limit > 0.0:
        return 1.0
    return float(math.ceil(dt / limit)) if adaptive else 2.0 ** math.ceil(math.log2(dt / limit))


def flow_schedule(options: Mapping[str, Any], own_step: float, *, max_steps: int, n_frames: int) -> Schedule:
    """Schedule of a flow from its options `steps`, `duration`, `step`, `frame_every` and `tolerance`.

    Parameters
    ----------
    options : mapping
        Values in seconds, and counts; None or absent if not set.
    own_step : float
        Default step of the flow; it is limited to between duration / max_steps and duration / n_frames.
    max_steps, n_frames : int
        Number of steps without `steps` and `duration`; number of frames without `frame_every`.

    Returns
    -------
    Schedule

    Raises
    ------
    ParameterError
        For a time that is not positive, a tolerance without a duration, a step longer than the duration, or
        more than MAX_STEP_COUNT steps.
    """
    check_times(options)
    steps, duration, dt = options.get("steps"), options.get("duration"), options.get("step")
    every, tolerance = options.get("frame_every"), options.get("tolerance")
    if dt is None:
        dt = own_step if duration is None else max(duration / max_steps, min(duration / n_frames, own_step))
    if tolerance is not None and duration is not None:
        frame_count = max(1, math.ceil(duration / every - 1e-9)) if every else n_frames
        schedule = Schedule(
            duration / frame_count, frame_count, 1, tolerance, first_dt=min(dt, duration / frame_count)
        )
        warn_of_other_frames(every, schedule, duration)
        return schedule
    count = max(1, math.ceil(duration / dt - 1e-9)) if duration is not None else steps or max_steps
    dt = duration / count if duration is not None else dt
    schedule = Schedule(dt, count, max(1, round(every / dt) if every else math.ceil(count / n_frames)))
    warn_of_other_frames(every, schedule, dt * count)
    return schedule


def warn_of_other_frames(every: float | None, schedule: Schedule, end: float, unit: str = "") -> None:
    """Warn if frames are at other times than the option `frame_every` sets.

    Parameters
    ----------
    every : float, optional
        That option.
    schedule : Schedule
    end : float
        Time of the end of the run.
    unit : str
        Unit of times with a space before it, such as " s".
    """
    between = schedule.every * schedule.dt
    expected = min(every or between, end)
    if abs(min(between, end) - expected) <= 1e-6 * expected:
        return
    if schedule.tolerance is None:
        why = f"is not a whole number of steps of {schedule.dt:g}{unit}"
    else:
        why = f"does not divide the duration of {end:g}{unit}"
    log.warning(f"frame_every {expected:g}{unit} {why}: frames come every {between:g}{unit}")


def check_times(options: Mapping[str, Any]) -> None:
    """Check that the times of a flow are positive and consistent with the duration.

    Parameters
    ----------
    options : mapping
        As in `flow_schedule`.

    Raises
    ------
    ParameterError
    """
    for name in ("duration", "step", "frame_every", "tolerance"):
        if (value := options.get(name)) is not None and not 0 < value < math.inf:
            raise ParameterError(f"must be a positive number, not {value:g}", parameter=name)
    if (options.get("steps") or 0) > MAX_STEP_COUNT:
        raise ParameterError(f"must be {MAX_STEP_COUNT:g} or less", parameter="steps")
    duration, step = options.get("duration"), options.get("step")
    if options.get("tolerance") is not None and duration is None:
        raise ParameterError(
            "needs `duration`, the time over which it chooses the steps", parameter="tolerance"
        )
    if duration is None:
        return
    if step is not None and step > duration * (1 + 1e-9):
        raise ParameterError(
            f"{step:g} is longer than the duration of {duration:g}; give {duration:g} or less",
            parameter="step",
        )
    name = "step" if options.get("tolerance") is None else "frame_every"
    each = options.get(name)
    if each is not None and not duration / each <= MAX_STEP_COUNT:
        raise ParameterError(
            f"{each:g} is too short for a duration of {duration:g}; give {duration / MAX_STEP_COUNT:.3g} "
            "or more",
            parameter=name,
        )
