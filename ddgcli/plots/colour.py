"""What colours mean: the range of an array, the maps, and the bar beside the picture."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

ROUNDING_SHARE = 1e-10  # values below this share of the largest are rounding
NARROWEST = 0.05  # colour range, as a share of the values' size: less would magnify noise


def robust_limits(
    values: NDArray, signed: bool | None = None, size: float = 0.0
) -> tuple[float, float, bool]:
    """Colour range of an array: its 2 % and 98 % quantiles, symmetric about zero for a signed one.

    The range of signed values reaches to those of half a per cent where the others are next to nothing.

    It is never narrower than a twentieth of the largest value (or of `size`), so that a constant looks
    constant whatever its error.

    Parameters
    ----------
    values : (k,) ndarray
        Values that are not finite do not count.
    signed : bool, optional
        None decides: signed where both sides of zero hold a twentieth of the range or of the extremes.
    size : float
        What values are to be seen against where they cancel: of a mean curvature the principal curvatures.

    Returns
    -------
    low, high : float
    signed : bool
    """
    finite = values[np.isfinite(values)].astype(np.float64)
    if len(finite) == 0:
        return 0.0, 1.0, False
    low, high = (float(q) for q in np.quantile(finite, [0.02, 0.98]))
    if signed is None:
        ends = ((low, high), (float(finite.min()), float(finite.max())))
        signed = any(min(-least, most) > 0.05 * max(-least, most) for least, most in ends)
    if signed:
        reach = max(-low, high, NARROWEST * size / 2, _rare_reach(np.abs(finite))) or 1.0
        return -reach, reach, True
    narrowest = NARROWEST * max(abs(low), abs(high), size) or 2.0
    widen = max(0.0, narrowest - (high - low)) / 2
    return low - widen, high + widen, False


def _rare_reach(sizes: NDArray) -> float:
    """The size of values that few vertices have (creases of a part), where the others are next to nothing."""
    common, rare, largest = (float(q) for q in np.quantile(sizes, [0.98, 0.995, 1.0]))
    if rare > common / NARROWEST:
        return rare
    return largest if rare <= ROUNDING_SHARE * largest else 0.0


def extremes(label: str, values: NDArray) -> str:
    """What the caption says of an array: its least and largest value, of which the bar shows most only."""
    finite = values[np.isfinite(values)]
    if not label or len(finite) == 0:
        return ""
    return f"{label} from {finite.min():.6g} to {finite.max():.6g}"


def colours(diverging: bool) -> Any:
    """The colour map of signed values (blue, white, red) or of others (dark to light, readable in grey)."""
    from matplotlib import colormaps
    from matplotlib.colors import LinearSegmentedColormap

    # the ends of RdBu are too dark to carry shading
    ends = (0.08, 0.92) if diverging else (0.04, 1.0)
    base = colormaps["RdBu_r" if diverging else "viridis"]
    return LinearSegmentedColormap.from_list(
        base.name, base([ends[0] + (ends[1] - ends[0]) * i / 32 for i in range(33)])
    )


def colour_bar(figure: Any, mappable: Any, label: str, beyond: str = "neither") -> None:
    """A colour bar at the right of the page; arrow heads where values lie beyond its ends."""
    place = figure.add_axes((0.865, 0.14, 0.022, 0.7))
    bar = figure.colorbar(mappable, cax=place, extend=beyond, label=label)
    bar.ax.tick_params(labelsize=8)
    bar.formatter.set_useOffset(False)  # 0.9999 + 1e-5 x is no number that one reads
    bar.formatter.set_powerlimits((-3, 4))
    bar.formatter.set_useMathText(True)
    bar.outline.set_linewidth(0.5)
