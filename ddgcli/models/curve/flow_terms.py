"""What the steps of a curve flow take: its options and its start; and the state of a flow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.models.curve.polygon import Polygons


@dataclass(frozen=True, eq=False)
class CurveState:
    """State of a flow, in units of the scaled curve.

    Parameters
    ----------
    points : (n, 3) ndarray
    active : (c,) ndarray of bool
        Curves that have not shrunk to a point.
    collapse_time : (c,) ndarray
        Time at which a curve shrank to a point; nan before.
    speed : float
        Largest normal speed of the last step, dimensionless.
    increases : (2,) ndarray
        Steps that raised the length, and steps that raised the objective of the flow.
    area_loss : (2, c) ndarray
        Area that curves have lost, and the exact loss of curvature flow, 2 pi times the turning number a unit
        of time: of the steps that keep it.
    """

    points: NDArray[np.float64]
    active: NDArray[np.bool_]
    collapse_time: NDArray[np.float64]
    speed: float
    increases: NDArray[np.float64]
    area_loss: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CurveFlowTerms:
    """Options of a flow of polylines, and what is known of its start.

    Parameters
    ----------
    mesh : Polygons
    kind : {'curvature', 'area-preserving', 'elastic'}
    redistribute : bool
    length_penalty : float, optional
        Elastic flow: weight of the length in the energy; None keeps the length instead.
    stop_at_rest : bool
    first_length, first_area : (c,) ndarray
    first_radius : (c,) ndarray
        Of the circle of the same length; where simple closed plane curves vanish or keep their area, of the
        same area: they vanish when it does, however long they are.
    simple : (c,) ndarray of bool
        Closed plane curves that do not cross themselves at the start.
    centre : (3,) ndarray
    scale : float
        Input points are `centre + scale * points`; a power of two.
    """

    mesh: Polygons
    kind: str
    redistribute: bool
    length_penalty: float | None
    stop_at_rest: bool
    first_length: NDArray[np.float64]
    first_area: NDArray[np.float64]
    first_radius: NDArray[np.float64]
    simple: NDArray[np.bool_]
    centre: NDArray[np.float64]
    scale: float

    @property
    def time_power(self) -> int:
        """Power of the length that a time is."""
        return 4 if self.kind == "elastic" else 2

    @property
    def time_unit(self) -> float:
        """Time of the input's units for one unit of the scaled curve."""
        return self.scale**self.time_power
