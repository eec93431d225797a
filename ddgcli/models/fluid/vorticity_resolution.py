"""Warning of vorticity at the start that varies from vertex to vertex, more than the mesh resolves."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from ddgcli.models.fluid.surface_space import SurfaceSpace

log = logging.getLogger("ddgcli")
LEAST_LENGTH = 1.0  # edges over which vorticity varies, below which it moves by errors of the mesh
LEAST_ENERGY_SHARE = 0.01  # of the flow, below which its vorticity is left out of account


def warn_of_unresolved_vorticity(
    name: str, space: SurfaceSpace, vorticity: NDArray, kinetic_energy: float
) -> None:
    """Report vorticity at the start that varies over less than an edge.

    Parameters
    ----------
    name : str
        Of the fluid.
    space : SurfaceSpace
    vorticity : (n,) ndarray
        Integrated over the cells.
    kinetic_energy : float
        Of the whole flow.
    """
    rotational = 0.5 * float(space.stream_function_change(vorticity) @ vorticity)
    if not rotational > LEAST_ENERGY_SHARE * kinetic_energy:
        return
    length = vorticity_length(space, vorticity)
    if length < LEAST_LENGTH:
        log.warning(
            "the vorticity of %s at the start varies over %.2g edges, less than the mesh resolves (1: cores "
            "of 1.6 edges, waves of 6): speeds and paths err by 5 to 30 %%; take a finer mesh or wider "
            "vortices",
            name, length,
        )  # fmt: skip


def vorticity_length(space: SurfaceSpace, vorticity: NDArray) -> float:
    """Length over which vorticity varies, in edges.

    The root of the mean square over twice the mean squared difference at edges, both weighted by the areas of
    their faces: `1 / |k|` of a wave, `core / sqrt(2)` of a Gaussian vortex. Sides at the boundary, where a
    wall makes a layer at any resolution, do not count.

    Parameters
    ----------
    space : SurfaceSpace
    vorticity : (n,) ndarray
        Integrated over the cells.

    Returns
    -------
    float
        inf of constant vorticity.
    """
    density = vorticity * space.inverse_mass
    squares, differences = 0.0, 0.0
    for j in range(3):
        tail, head = space.corners[j], space.corners[(j + 1) % 3]
        weight = space.area * (space.inside[tail] & space.inside[head])
        squares += 0.5 * float(weight @ (density[tail] ** 2 + density[head] ** 2))
        differences += float(weight @ (density[tail] - density[head]) ** 2)
    return float(np.sqrt(squares / (2.0 * differences))) if differences else np.inf
