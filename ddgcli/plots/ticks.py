"""Numbers at axes and colour bars, with powers of ten as plain text."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import FuncFormatter, ScalarFormatter

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


class CommonPowerFormatter(ScalarFormatter):
    """Numbers of an axis, with the power of ten that they share beside it; without a common summand.

    An offset such as 0.9999 + 1e-5 x is hard to read.
    """

    def __init__(self) -> None:
        super().__init__(useOffset=False, useMathText=False)
        self.set_powerlimits((-3, 4))

    def get_offset(self) -> str:
        """Factor of the numbers; empty where it is 1."""
        _, _, exponent = super().get_offset().replace("\N{MINUS SIGN}", "-").partition("1e")
        return f"×{power_of_ten(int(exponent))}" if exponent else ""


def decade_formatter() -> FuncFormatter:
    """Formatter of the decades of a logarithmic axis.

    Returns
    -------
    matplotlib.ticker.FuncFormatter
    """
    return FuncFormatter(lambda value, _: power_of_ten(round(np.log10(value))))
