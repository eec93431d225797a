"""Warning of expressions in t that vary faster than the steps of a run follow."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import InfiniteValueError, excerpt
from ddgcli.models.fluid.boundary_motion import SAMPLE_SHARE, depends_on_time
from ddgcli.models.fluid.context import FluidContext
from ddgcli.scenes.expressions import evaluate
from ddgcli.scenes.scene import Scene

log = logging.getLogger("ddgcli")

FIELDS = ("acceleration", "source", "velocity", "flux")  # of effects, with expressions in t
MAX_DEVIATION = 0.1  # share of an expression's range: that of a sine with 2.3 steps to its period
LEAST_RANGE = 0.3  # share of its size, below which the range of an expression counts as that
N_STEPS, N_POINTS = 31, 24  # at which expressions are sampled
MAX_DIVISIONS = 30
STEP_SHARES = np.array([0.0, 0.5, 1.0, 0.137, 0.289, 0.691, 0.877])  # uneven: even ones may meet every wave


def warn_of_unresolved_expressions(scene: Scene, context: FluidContext, step: float, duration: float) -> None:
    """Report expressions in t that most steps do not resolve, with the step that does.

    Parameters
    ----------
    scene : Scene
    context : FluidContext
    step, duration : float
        In s.
    """
    points = context.points[:: max(1, len(context.points) // N_POINTS)]
    for effect, parameters, _ in scene.effects:
        texts = [getattr(parameters, name, None) for name in FIELDS]
        flat = [one for text in texts for one in (text if isinstance(text, list) else [text])]
        for text in dict.fromkeys(one for one in flat if isinstance(one, str) and depends_on_time(one)):
            shorter, count = step, 0
            while count < MAX_DIVISIONS and unresolved_share(text, points, shorter, duration) > MAX_DEVIATION:
                shorter, count = 0.5 * shorter, count + 1
            if count:
                remedy = "" if count == MAX_DIVISIONS else f"; take steps of {shorter:.3g} s"
                log.warning(
                    "%s: '%s' varies faster in time than steps of %.3g s follow, which take it at single "
                    "times%s",
                    effect.name, excerpt(text), step, remedy,
                )  # fmt: skip


def unresolved_share(text: str, points: NDArray, step: float, duration: float) -> float:
    """Deviation of an expression in t from parabolas through the ends and middles of steps.

    Parameters
    ----------
    text : str
    points : (k, 3) ndarray of float64
    step, duration : float
        In s.

    Returns
    -------
    float
        Median of steps, relative to its range in time; 0 where it is not finite.
    """
    n_steps = max(int(duration / step), 1)
    start = np.floor(SAMPLE_SHARE * np.arange(N_STEPS) % 1.0 * n_steps) * step
    time = start[:, None] + step * STEP_SHARES
    shape = (*time.shape, len(points))
    place = {name: np.broadcast_to(values, shape).ravel() for name, values in zip("xyz", points.T)}
    try:
        value = evaluate(text, {**place, "t": np.broadcast_to(time[..., None], shape).ravel()}).reshape(shape)
    except InfiniteValueError:
        return 0.0
    share = STEP_SHARES[3:]
    weights = 2.0 * np.stack(
        [(share - 0.5) * (share - 1.0), -2.0 * share * (share - 1.0), share * (share - 0.5)]
    )
    parabola = np.einsum("sip,ij->sjp", value[:, :3], weights)
    deviation = np.abs(value[:, 3:] - parabola).max(axis=1)
    size = max(
        float(np.ptp(value, axis=(0, 1)).sum()), LEAST_RANGE * float(np.abs(value).max(axis=(0, 1)).sum())
    )
    return float(np.median(deviation.sum(axis=1))) / (size or 1.0)
