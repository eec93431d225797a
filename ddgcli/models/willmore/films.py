"""Films: surfaces that lower their area, or raise their volume, until their mean curvature is constant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MeshError, ParameterError
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.geometry.normals import sphere_normals
from ddgcli.mesh.require import require
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import unit_vectors
from ddgcli.models.willmore.area_energy import AreaEnergy, VolumeEnergy, mean_curvature, volume_gradient
from ddgcli.models.willmore.constraints import Constraints, areas, cap_faces, volumes_inside
from ddgcli.models.willmore.descent import EnergyGradient
from ddgcli.models.willmore.endings import PINCH, THIN_STAR, equal_curvature
from ddgcli.models.willmore.energies import EnergyBuilder
from ddgcli.models.willmore.flow_options import FlowOptions
from ddgcli.simulation.model import Ending

# share of the area that a vertex star has on average, below which a film has pinched off there
PINCHED_STAR_FRACTION = 1e-5
MIN_VOLUME = 1e-9  # of a surface at unit size, below which it counts as enclosing none
FILM_CONVENTIONS = {False: "area", True: "minus the enclosed volume"}  # by whether the area is kept


def curvature_variation(at: EnergyGradient, constraints: Constraints) -> float:
    """Largest |2 H| at the free vertices, or deviation of 2 H from what the constraints leave open.

    That is any constant where area or volume is conserved and, in place, the normals' coordinates: curvature
    that varies with these slides vertices within the surface.

    Parameters
    ----------
    at : EnergyGradient
    constraints : Constraints

    Returns
    -------
    float
        Times the radius, without unit; inf where the curvature is not finite.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        normal = sphere_normals(at.mesh)
        off = 2.0 * mean_curvature(at.mesh, normal)[at.free]
    if not np.isfinite(off).all():
        return np.inf
    basis = [np.ones((len(off), 1))] if constraints.active else []
    basis += [unit_vectors(volume_gradient(at.mesh)[at.free])] if constraints.in_place else []
    if basis:
        weight, columns = np.sqrt(at.mass), np.concatenate(basis, axis=1)
        off = off - columns @ np.linalg.lstsq(weight[:, None] * columns, weight * off, rcond=None)[0]
    radius = np.sqrt(at.mass.sum() / (4.0 * np.pi))
    return float(np.max(np.abs(off), initial=0.0) * radius)


def film_ending(at: EnergyGradient, variation: float | None, constraints: Constraints) -> Ending | None:
    """Why a film ends here: 2 H varies little (`curvature_variation`), or the film pinches off.

    Parameters
    ----------
    at : EnergyGradient
    variation : float or None
        Below which 2 H counts as constant.
    constraints : Constraints

    Returns
    -------
    Ending or None
    """
    if variation is not None and curvature_variation(at, constraints) <= variation:
        return equal_curvature(variation)
    if at.mass.min() < PINCHED_STAR_FRACTION * at.mass.mean():
        return THIN_STAR if constraints.in_place else PINCH
    return None


def film_constraints(
    unit: TriangleMesh, options: FlowOptions, film: bool, component: NDArray | None = None
) -> Constraints:
    """Area and volume to keep, of the surface at unit size.

    Parameters
    ----------
    unit : TriangleMesh
        The surface at unit size.
    options : FlowOptions
    film : bool
        Whether the flow goes to rest (`is_film`).
    component : (n,) ndarray of int, optional
        Of the vertices of components that each keep their own area and volume; -1 elsewhere.

    Returns
    -------
    Constraints

    Raises
    ------
    MeshError, ParameterError
        When there is no volume, or nothing is left to flow.
    """
    topology = unit.topology
    if film and options.boundary == "free" and not topology.is_closed:
        raise ParameterError(
            "`flow=mean-curvature` needs a boundary that stays, or no area is left; use `boundary=fixed`",
            parameter="boundary",
        )
    caps = cap_faces(topology) if film and options.fix_volume and not topology.is_closed else None
    if film and options.fix_area and options.fix_volume:
        raise ParameterError(
            "`flow=mean-curvature` lowers the area or, if that is kept, raises the volume: keep one of "
            "them, or use `flow=quadratic`"
        )
    if (options.fix_volume and caps is None) or (film and options.fix_area):
        require(
            unit,
            "`fix_volume`" if options.fix_volume else "`flow=mean-curvature` with `fix_area`",
            closed=True,
        )
    constraints = Constraints(
        areas(unit, component) if options.fix_area else None,
        volumes_inside(unit, caps, component) if options.fix_volume else None,
        caps,
        in_place=film and topology.is_closed,
        component=component,
    )
    inside = (
        constraints.volume
        if constraints.volume is not None
        else (enclosed_volume(unit) if film and options.fix_area else 1.0)
    )
    size = 1.0 if component is None else areas(unit, component) ** 1.5  # small components are not flat ones
    if np.min(np.abs(inside) / size) < MIN_VOLUME:
        raise MeshError(
            "the surface encloses no volume that could be kept or raised; leave "
            f"{'`fix_volume`' if options.fix_volume else '`fix_area`'} out"
        )
    return constraints


def film_energy(unit: TriangleMesh, options: FlowOptions) -> EnergyBuilder:
    """Energy that a film lowers: its area or, where that is conserved, minus its volume.

    Parameters
    ----------
    unit : TriangleMesh
        The surface at unit size.
    options : FlowOptions

    Returns
    -------
    callable
        Function of a topology to the energy.

    Raises
    ------
    ParameterError
        When the options name another energy.
    """
    if options.energy is not None:
        raise ParameterError(
            "has no effect on films, which lower their area; leave `energy` out", parameter="energy"
        )
    if not options.fix_area:
        return AreaEnergy
    factor = -1.0 if enclosed_volume(unit) > 0 else 1.0
    return lambda topology: VolumeEnergy(topology, factor)
