"""Least bending energies that surfaces of a topology, area and volume can have."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import step_rules as rules
from ddgcli.models.willmore.constraints import area, reduced_volumes

# least int H^2 / (4 pi) of spheres of a reduced volume: oblate up to 0.65, prolate above, to 1e-3
# (U. Seifert, K. Berndl, R. Lipowsky, "Shape transformations of vesicles", 1991)
REDUCED_VOLUMES = np.array([0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 1.0])
LEAST_OF_VESICLES = np.array([1.956, 1.826, 1.643, 1.502, 1.387, 1.286, 1.190, 1.096, 1.0])
POLYHEDRON_DEFICIT = 4.0  # number of faces times the share of a ball that they cut off; equilateral ones 1.9


@dataclass(frozen=True)
class EnergyBounds:
    """What is known of the energies of smooth surfaces within the reach of a flow.

    Parameters
    ----------
    least : float
        Lower bound of the smooth energy, 0 where none is known.
    lowest : float
        Lower bound: an energy below it is discretisation error.
    round_energy : float
        Energy above which a surface is not at rest, since it must become one of round spheres.
    to_torus : bool
        The surface is one torus, free to become that of Clifford, of the energy `least`.
    """

    least: float = 0.0
    lowest: float = -math.inf
    round_energy: float = math.inf
    to_torus: bool = False


def is_spheres(topology: Topology) -> bool:
    """Whether every part of the surface is closed and of genus 0.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    bool
    """
    return topology.is_closed and topology.euler_characteristic == 2 * topology.n_components


def is_torus(topology: Topology) -> bool:
    """Whether the surface is one closed part of genus 1.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    bool
    """
    return topology.is_closed and topology.n_components == 1 and topology.euler_characteristic == 0


def least_energy(mesh: TriangleMesh, keeps_area_and_volume: bool) -> float:
    """Least int H^2 of surfaces in space: 4 pi a sphere, 2 pi^2 any other closed one, more of vesicles.

    Parameters
    ----------
    mesh : TriangleMesh
    keeps_area_and_volume : bool
        The flow does.

    Returns
    -------
    float

    Notes
    -----
    T. J. Willmore, 1965; F. Marques, A. Neves, "Min-max theory and the Willmore conjecture", 2014. A sphere
    that keeps area and volume has at least the energy of the axisymmetric one of its reduced volume.
    """
    topology = mesh.topology
    if keeps_area_and_volume and is_spheres(topology):
        return float(least_energies_of_vesicles(mesh).sum())
    n, component = topology.n_components, topology.vertex_component
    opened = np.bincount(component[topology.boundary_vertex], minlength=n) > 0
    vertices = np.bincount(component[topology.referenced_vertex], minlength=n)
    faces = np.bincount(topology.face_component, minlength=n)
    # a closed part has three sides per face, each shared by two
    least = np.where(2 * vertices - faces == 4, 4.0 * np.pi, 2.0 * np.pi**2)
    return float(least[~opened & (faces > 0)].sum())


def least_energies_of_vesicles(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Least int H^2 of spheres with the area and the volume of each component of a mesh.

    Parameters
    ----------
    mesh : TriangleMesh
        Closed, components of genus 0.

    Returns
    -------
    (c,) ndarray of float64
    """
    smooth = reduced_volumes(mesh) + POLYHEDRON_DEFICIT / np.bincount(mesh.topology.face_component)
    return 4.0 * np.pi * np.interp(smooth, REDUCED_VOLUMES, LEAST_OF_VESICLES)


def lower_bound(
    mesh: TriangleMesh, least: float, start_energy: float, curvature: float, is_newton_vesicle: bool
) -> float:
    """Energy below which a fall is discretisation error; -inf where none is known.

    Parameters
    ----------
    mesh : TriangleMesh
    least : float
        Least energy of smooth surfaces, 0 where unknown.
    start_energy : float
    curvature : float
        Spontaneous curvature, one over the unit of the mesh.
    is_newton_vesicle : bool
        Newton steps lower `gauss-map` at constant area and volume.

    Returns
    -------
    float
    """
    if curvature:
        return -rules.HELFRICH_ERROR_FRACTION * curvature**2 * area(mesh)
    if not least:
        return -math.inf
    vesicle_bound = rules.VESICLE_BOUND_FRACTION * least
    if is_newton_vesicle and is_spheres(mesh.topology) and start_energy > vesicle_bound:
        return vesicle_bound
    return rules.LOWER_BOUND_FRACTION * least
