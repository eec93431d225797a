"""Numbers at axes and colour bars, with powers of ten as plain text."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import FuncFormatter, ScalarFormatter

ORDINARY_POWERS = (-3, 4)  # ends, exclusive: numbers between need no power of ten
LEAST_EXPONENT = -323  # of a power of ten in double precision
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def power_of_ten(exponent: int) -> str:
    """Text of a power of ten.

    Parameters
    ----------
    exponent : int

    Returns
    -------
    str

    Examples
    --------
    >>> power_of_ten(-12)
    '10⁻¹²'
    """
    return "10" + str(exponent).translate(_SUPERSCRIPTS)


def common_power(low: float, high: float) -> int:
    """Exponent of the power of ten beside the numbers of an axis, which are then from 1 to 10 at its ends.

    Parameters
    ----------
    low, high : float
        Ends of the axis.

    Returns
    -------
    int
        0 for numbers of an ordinary size.

    Examples
    --------
    >>> common_power(-2e-300, 1e-301), common_power(0, 250)
    (-300, 0)
    """
    size = max(abs(low), abs(high))
    exponent = max(int(np.floor(np.log10(size))), LEAST_EXPONENT) if size else 0
    return 0 if ORDINARY_POWERS[0] < exponent < ORDINARY_POWERS[1] else exponent


class CommonPowerFormatter(ScalarFormatter):
    """Numbers of an axis that is divided by a power of ten, which is beside it; without a common summand.

    An offset such as 0.9999 + 1e-5 x is hard to read. Matplotlib's own power of ten is too late: axes hold
    no interval below 1e-287.

    Parameters
    ----------
    exponent : int
        As returned by `common_power`.
    """

    def __init__(self, exponent: int) -> None:
        super().__init__(useOffset=False, useMathText=False)
        self.set_scientific(False)
        self.exponent = exponent

    def get_offset(self) -> str:
        """Factor of the numbers; empty where it is 1."""
        return f"×{power_of_ten(self.exponent)}" if self.exponent else ""


def decade_formatter() -> FuncFormatter:
    """Formatter of the decades of a logarithmic axis.

    Returns
    -------
    matplotlib.ticker.FuncFormatter
    """
    return FuncFormatter(lambda value, _: power_of_ten(round(np.log10(value))))
