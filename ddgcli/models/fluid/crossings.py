"""Where fluid crosses the boundary of a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.ragged import unique_keys
from ddgcli.models.fluid.surface_space import SurfaceSpace

FLUX_ROUNDING = 1e-12  # flux through a boundary side over the largest, up to which nothing crosses it


def _crossed_sides(
    space: SurfaceSpace, side_flux: NDArray | None = None
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(s,) boundary sides through which a prescribed flux enters, and where fluid leaves.

    Those of a flow with side fluxes (m, 3), by default at any time of the run.
    """
    face, k, ends = space.boundary_sides
    if space.lift is None:
        return np.zeros(len(face), dtype=bool), np.zeros(len(face), dtype=bool)
    if side_flux is None:
        flux = np.stack([space.side_flux(lift, np.zeros(0))[face, k] for lift in space.lifts])
    else:
        flux = side_flux[face, k][None]
    natural = np.zeros((0, 2), dtype=np.int64) if space.open_sides is None else space.open_sides
    is_natural = np.isin(ends @ [space.n, 1], natural @ [space.n, 1])
    least = FLUX_ROUNDING * np.abs(flux).max(initial=0.0)
    return ~is_natural & (flux < -least).any(axis=0), is_natural | (flux > least).any(axis=0)


def entering_vertices(space: SurfaceSpace, side_flux: NDArray | None = None) -> NDArray[np.int64]:
    """Ends of the boundary sides through which a prescribed flux enters.

    Parameters
    ----------
    space : SurfaceSpace
    side_flux : (m, 3) ndarray of float64, optional
        Of a flow; by default at any time of the run.

    Returns
    -------
    ndarray of int64
        Ascending.
    """
    entering, _ = _crossed_sides(space, side_flux)
    return unique_keys(space.boundary_sides[2][entering])


def turning_vertices(space: SurfaceSpace) -> NDArray[np.int64]:
    """Ends of the boundary sides through which a prescribed flux enters at one time and leaves at another.

    Parameters
    ----------
    space : SurfaceSpace

    Returns
    -------
    ndarray of int64
    """
    entering, leaving = _crossed_sides(space)
    return unique_keys(space.boundary_sides[2][entering & leaving])


def crossed_faces(space: SurfaceSpace) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Faces at boundary sides through which a prescribed flux enters, and at those where fluid leaves.

    Parameters
    ----------
    space : SurfaceSpace

    Returns
    -------
    entering, leaving : (m,) ndarray of bool
    """
    marked = np.zeros((2, len(space.faces)), dtype=bool)
    for mark, crossed in zip(marked, _crossed_sides(space)):
        mark[space.boundary_sides[0][crossed]] = True
    return marked[0], marked[1]
