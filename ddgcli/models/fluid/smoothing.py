"""Just enough smoothing: takes from a flow what raised its enstrophy, where it is as fine as the mesh."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array

from ddgcli.linalg.factor import Factor
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import NEXT, PREVIOUS
from ddgcli.models.fluid.surface_space import SurfaceSpace
from ddgcli.operators.dec import d0

# (width, order) of the filters, tried in turn: one of order p and width w leaves a wave number k its part
# 1 - (w k^2 h^2)^p where that is small, so the first touches only what is as fine as the mesh
FILTERS = ((1.0, 3), (1.0, 1), (16.0, 1), (256.0, 1))


class Smoothing:
    """Filters 1 - (1 - F)^p, with F = (M + w h^2 L)^-1 M an implicit step of diffusion over w cells.

    h^2 is the area of the cells nearby. They keep the total vorticity of every component, and lower the
    enstrophy of whatever they change. A filter is assembled when a flow first needs it.
    """

    def __init__(self, space: SurfaceSpace) -> None:
        self.space = space
        self._factors: dict[float, Factor] = {}

    def _factor(self, width: float) -> Factor:
        if width not in self._factors:
            mass = np.where(self.space.mass > 0, self.space.mass, 1.0)
            self._factors[width] = Factor(csc_array(diags_array(mass) + width * self._diffusion))
        return self._factors[width]

    @cached_property
    def _diffusion(self) -> csc_array:
        """Stiffness weighted by the area of a vertex's cell."""
        space = self.space
        cell = space.mass[space.faces].mean(axis=1)
        opposite = -(space.side[:, NEXT] * np.conj(space.side[:, PREVIOUS])).real  # at corner j+2
        weight = 0.25 * (cell / space.area)[:, None] * opposite
        derivative = d0(space.mesh.topology)
        on_edge = sum_by_index(space.side_edge, weight, space.mesh.topology.n_edges)
        return csc_array(derivative.T @ diags_array(on_edge) @ derivative)

    def rough(self, vorticity: NDArray, width: float, order: int) -> NDArray[np.float64]:
        """What the whole filter takes off: of zero sum on every component."""
        space, rest = self.space, vorticity
        with space.timer():
            factor = self._factor(width)
            for _ in range(order):
                rest = rest - space.mass * factor.solve(rest, refine=False)
        label = space.mesh.topology.vertex_component
        in_component = label >= 0
        excess = space.component_vorticity(rest)
        area = sum_by_index(label[in_component], space.mass[in_component], len(excess))
        share = np.divide(excess, area, out=np.zeros_like(excess), where=area > 0)
        return rest - np.where(in_component, space.mass * share[np.maximum(label, 0)], 0.0)

    def change(self, vorticity: NDArray) -> NDArray[np.float64]:
        """What the finest filter adds to a flow."""
        return -self.rough(vorticity, *FILTERS[0])

    def without_rise(self, vorticity: NDArray, most: float) -> NDArray[np.float64]:
        """The same array where its enstrophy is at most `most`; else filtered just enough."""
        space = self.space
        for width, order in FILTERS:
            excess = space.enstrophy(vorticity) - most
            if not excess > 0.0:
                break
            change = -self.rough(vorticity, width, order)
            slope = float(vorticity @ (space.inverse_mass * change))
            share = first_root(excess, slope, space.enstrophy(change))
            vorticity = vorticity + share * change
        return vorticity


def share_at_constant_energy(
    enstrophy: tuple[float, float, float], energy: tuple[float, float, float], most: float
) -> tuple[float, float]:
    """Least share of a filter that lowers the enstrophy enough, and the factor that then restores the energy.

    The factor scales the energy back to its value at t = 0; the enstrophy, scaled with it, is `most` at t, or
    least where it nowhere falls to `most`.

    Parameters
    ----------
    enstrophy, energy : tuple of 3 floats
        Coefficients of 1, t, t^2.
    most : float
        Enstrophy to reach.

    Returns
    -------
    share, factor : float
        The share is in [0, 1].
    """
    t = np.linspace(0.0, 1.0, 65)

    def scaled(t: NDArray) -> NDArray[np.float64]:
        return np.polyval(enstrophy[::-1], t) * energy[0] / np.polyval(energy[::-1], t)

    if not (energy[0] > 0.0 and (np.polyval(energy[::-1], t) > 0.0).all()):
        return 0.0, 1.0
    below = np.flatnonzero(scaled(t) <= most)
    last = int(below[0]) if len(below) else int(np.argmin(scaled(t)))
    share = t[last]
    if len(below) and last > 0:  # bisection within the interval, down to rounding
        low, high = t[last - 1], t[last]
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if scaled(np.array(middle)) <= most else (middle, high)
        share = high
    return float(share), float(np.sqrt(energy[0] / np.polyval(energy[::-1], share)))


def first_root(constant: float, slope: float, curvature: float) -> float:
    """Least t in [0, 1] at which constant + slope t + curvature t^2 is not positive.

    Parameters
    ----------
    constant, slope, curvature : float

    Returns
    -------
    float
        1 if there is none.
    """
    if constant <= 0.0:
        return 0.0
    inside = slope * slope - 4.0 * curvature * constant
    if inside < 0.0 or slope >= 0.0:
        return 1.0
    return min(1.0, 2.0 * constant / (-slope + inside**0.5))
