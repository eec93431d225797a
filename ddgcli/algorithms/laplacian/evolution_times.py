"""Duration, steps and frames of an evolution."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace

from ddgcli.errors import ParameterError, counted

log = logging.getLogger("ddgcli")
MAX_STEPS = 1_000_000
DEFAULT_STEPS, DEFAULT_FRAMES = 100, 50
# default steps of a wave: error of the phase at the end in radians, and maximum number of steps; a wave whose
# phase would err by more than a radian with that many keeps DEFAULT_STEPS
PHASE_ERROR, MAX_DEFAULT_STEPS = 0.02, 4000


@dataclass(frozen=True)
class EvolutionTimes:
    """Time of an evolution.

    Parameters
    ----------
    duration : float
    steps : int
    every : int
        Steps between frames.
    has_default_steps : bool
        Whether a wave may take shorter ones.
    """

    duration: float
    steps: int
    every: int
    has_default_steps: bool = False

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
        every = max(1, math.ceil(count / (n_frames or min(count, DEFAULT_FRAMES))))
        times = cls(duration, count, every, has_default_steps=time_step is None)
        times.warn_of_other(time_step, n_frames)
        return times

    def for_waves_of(self, frequency: float) -> EvolutionTimes:
        """Times with the same frames whose default steps keep the phase of waves of a frequency (1/length).

        The implicit midpoint rule of step h shifts the phase by w^3 h^2 T / 12 up to the time T.
        """
        if not self.has_default_steps:
            return self
        shift = min(frequency * self.duration, 1e9) ** 3 / (12 * self.steps**2)
        most = MAX_DEFAULT_STEPS // self.steps
        factor = 1 if shift > most**2 else min(max(1, math.ceil(math.sqrt(shift / PHASE_ERROR))), most)
        return replace(self, steps=self.steps * factor, every=self.every * factor)

    def longest_of_waves(self, frequency: float) -> float:
        """Duration up to which the default steps keep the phase of waves of a frequency (1/length)."""
        return (12 * PHASE_ERROR * MAX_DEFAULT_STEPS**2) ** (1 / 3) / frequency

    @property
    def frame_steps(self) -> list[int]:
        """Steps at whose ends frames are; the first at the start, the last at the end."""
        return [*range(0, self.steps, self.every), self.steps]

    def warn_of_other(self, time_step: float | None, n_frames: int | None) -> None:
        """Warn if the step or the number of frames differs from the option."""
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
