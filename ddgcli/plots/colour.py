"""Colours: range of an array, colour maps, and the colour bar."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.plots.page import PAGE_WIDTH, no_backend_variable

ROUNDING_SHARE = 1e-10  # values below this share of the largest are rounding
MIN_RANGE_SHARE = 0.05  # of the size of the values: a narrower range would magnify noise
MAX_BAR_LENGTH = 4.5  # inches: arrow heads are in proportion to it
BAR_PLACE = (0.865, 0.14, 0.022, 0.7)  # left, bottom, width, height
# quantities with a sign: their colours diverge about zero
SIGNED_ARRAYS = (
    "angle_defect", "gaussian_curvature", "geodesic_curvature", "mean_curvature", "principal_curvature_min",
    "principal_curvature_max", "dihedral_angle", "torsion", "vorticity", "potential", "copotential",
    "stream_function", "signed_distance", "turning_angle",
)  # fmt: skip
# numbers of other elements, of curves or of an input: no quantities
MAP_ARRAYS = ("input_vertex", "input_face", "input_cell", "path_id", "vertex", "face")
# quantities relative to 1, of which values below `ROUNDING_SHARE` are rounding
RELATIVE_ARRAYS = ("strain", "strain_tensor", "principal_strain")


def first_quantity(names: Iterable[str]) -> str | None:
    """The array that a picture shows by default.

    Parameters
    ----------
    names : iterable of str

    Returns
    -------
    str or None
        The vorticity of a flow, else the first array that is not a map; None if there is none.
    """
    quantities = sorted((n for n in names if n not in MAP_ARRAYS), key=lambda name: name != "vorticity")
    return next(iter(quantities), None)


def value_scale(name: str) -> float:
    """Scale of an array for `robust_limits`, so that values of rounding have the colours of a constant.

    Parameters
    ----------
    name : str

    Returns
    -------
    float
        0 for quantities without a scale of their own.
    """
    return ROUNDING_SHARE / MIN_RANGE_SHARE if name in RELATIVE_ARRAYS else 0.0


def is_signed(name: str, dimension: int = 1) -> bool | None:
    """Whether an array is a quantity with a sign.

    Parameters
    ----------
    name : str
    dimension : int
        Number of dimensions of the array: 1 for scalars, 2 for vectors.

    Returns
    -------
    bool or None
        True for quantities with a sign; False for vectors, which are drawn by their lengths; None if the
        values decide.
    """
    if dimension > 1:
        return False
    return True if name in SIGNED_ARRAYS or name.startswith("eigenvector_") else None


def robust_limits(
    values: NDArray, signed: bool | None = None, size: float = 0.0
) -> tuple[float, float, bool]:
    """Colour range of an array: its 2 % and 98 % quantiles, symmetric about zero for a signed one.

    The range of signed values includes the largest half per cent if the others are nearly zero. It is at
    least a twentieth of the largest value (or of `size`), so that a constant with rounding errors looks
    constant.

    Parameters
    ----------
    values : (k,) ndarray
        Values that are not finite are ignored.
    signed : bool, optional
        None: signed if both sides of zero have a twentieth of the range or of the extremes.
    size : float
        Scale of values that cancel, of a mean curvature the principal curvatures; or `value_scale`.

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
        reach = max(-low, high, MIN_RANGE_SHARE * size / 2, _rare_reach(np.abs(finite))) or 1.0
        return -reach, reach, True
    if low == high == 0:
        return 0.0, 1.0, False
    narrowest = MIN_RANGE_SHARE * max(abs(low), abs(high), size) or 2.0
    widen = max(0.0, narrowest - (high - low)) / 2
    return low - widen, high + widen, False


def _rare_reach(sizes: NDArray) -> float:
    """Size of the values of few vertices (creases of a part) if the others are nearly zero, else 0."""
    common, rare, largest = (float(q) for q in np.quantile(sizes, [0.98, 0.995, 1.0]))
    if rare > common / MIN_RANGE_SHARE:
        return rare
    return largest if rare <= ROUNDING_SHARE * largest else 0.0


def extremes(label: str, values: NDArray) -> str:
    """Caption with the least and the largest value of an array; the colour bar may be shorter.

    Parameters
    ----------
    label : str
    values : ndarray of float
        Values that are not finite are ignored.

    Returns
    -------
    str
        Empty without a label or a finite value.
    """
    finite = values[np.isfinite(values)]
    if not label or len(finite) == 0:
        return ""
    return f"{label} from {finite.min():.6g} to {finite.max():.6g}"


def colours(diverging: bool) -> Any:
    """Colour map of signed values (blue, white, red) or of others (dark to light, readable in grey).

    Parameters
    ----------
    diverging : bool

    Returns
    -------
    matplotlib.colors.Colormap
    """
    with no_backend_variable():
        from matplotlib import colormaps
        from matplotlib.colors import LinearSegmentedColormap

    # shading would make the ends of RdBu too dark
    ends = (0.08, 0.92) if diverging else (0.04, 1.0)
    base = colormaps["RdBu_r" if diverging else "viridis"]
    return LinearSegmentedColormap.from_list(
        base.name, base([ends[0] + (ends[1] - ends[0]) * i / 32 for i in range(33)])
    )


def baked_colours(values: NDArray, low: float, high: float, signed: bool) -> tuple[NDArray[np.uint8], str]:
    """Colours of values, and the name of their colour map.

    Parameters
    ----------
    values : (k,) ndarray of float
    low, high : float
        Ends of the colour map; values beyond have the colour of the end.
    signed : bool

    Returns
    -------
    colours : (k, 3) ndarray of uint8
        Grey where a value is not finite.
    name : str
    """
    colour_map = colours(signed)
    share = np.clip((np.nan_to_num(values) - low) / ((high - low) or 1.0), 0.0, 1.0)
    table = np.rint(255 * colour_map(share)[:, :3]).astype(np.uint8)
    table[~np.isfinite(values)] = 128
    return table, colour_map.name


def colour_scale(low: float, high: float, signed: bool) -> Any:
    """Colour of each value between two ends.

    Parameters
    ----------
    low, high : float
    signed : bool
        Whether the values are signed, as returned by `colours`.

    Returns
    -------
    matplotlib.cm.ScalarMappable
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(low, high), colours(signed))


def beyond(values: NDArray, low: float, high: float) -> str:
    """Ends of a colour bar that values exceed.

    Parameters
    ----------
    values : ndarray of float
        Values that are not finite are ignored.
    low, high : float
        Ends of the bar.

    Returns
    -------
    {'neither', 'min', 'max', 'both'}
    """
    finite, slack = values[np.isfinite(values)], 1e-9 * (high - low)
    ends = 2 * bool((finite < low - slack).any()) + bool((finite > high + slack).any())
    return ("neither", "max", "min", "both")[ends]


def colour_bar(
    figure: Any,
    mappable: Any,
    label: str,
    ends: str = "neither",
    place: tuple[float, float, float, float] = BAR_PLACE,
    *,
    whole: bool = False,
) -> None:
    """Draw a colour bar at the right of the page, with arrow heads if values lie beyond its ends.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    mappable : matplotlib.cm.ScalarMappable
    label : str
    ends : {'neither', 'min', 'max', 'both'}
        Ends with arrow heads.
    place : (float, float, float, float)
        Left, bottom, width and height, as shares of the page.
    whole : bool
        Whether the values are integers, with ticks at integers only.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    from ddgcli.plots.ticks import CommonPowerFormatter, common_power

    low, high = mappable.get_clim()
    exponent = common_power(low, high)
    unit = 10.0**exponent
    scale = ScalarMappable(Normalize(low / unit, high / unit), mappable.cmap)
    bar = figure.colorbar(
        scale,
        cax=figure.add_axes(_bounded(place, *figure.get_size_inches())),
        extend=ends,
        label=label,
        format=CommonPowerFormatter(exponent),
    )
    if whole and not exponent:
        bar.locator = MaxNLocator(integer=True)
        bar.update_ticks()
    bar.ax.tick_params(labelsize=8)
    bar.ax.yaxis.set_offset_position(
        "left"
    )  # the power of ten starts there and is over the bar and its numbers
    bar.outline.set_linewidth(0.5)


def _bounded(place: tuple[float, float, float, float], width: float, height: float) -> tuple[float, ...]:
    """The place of a bar on a page in inches: not longer than MAX_BAR_LENGTH, with space for its numbers."""
    left, bottom, across, length = place
    shorter = min(length, MAX_BAR_LENGTH / height)
    left = min(left, 1 - (1 - left) * PAGE_WIDTH / width)
    return left, bottom + 0.5 * (length - shorter), max(across, across * PAGE_WIDTH / width), shorter
