"""A second energy, whose rise shows that a flow crumples where the energy that it lowers does not see it."""

from __future__ import annotations

from dataclasses import dataclass

from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import step_rules as rules
from ddgcli.models.willmore.constraints import Constraints
from ddgcli.models.willmore.energies import DEFAULT_ENERGY, ENERGIES, SECOND_ENERGIES, EnergyBuilder
from ddgcli.models.willmore.helfrich_energy import with_curvature
from ddgcli.models.willmore.least_energies import is_spheres


@dataclass(frozen=True)
class SecondEnergy:
    """It shows bending that the first does not see: the flow ends where it rises.

    Parameters
    ----------
    builder : callable
        Topology -> Energy.
    crumpling_ratio : float, optional
        Ratio to the first energy, below which its rise ends no flow before rest.
    """

    builder: EnergyBuilder
    crumpling_ratio: float | None = None

    def shows_crumpling(self, second: float, first: float) -> bool:
        """Whether values of both are so far apart that a rise of the second ends a flow."""
        return self.crumpling_ratio is None or second > self.crumpling_ratio * first


def second_energy(
    name: str, mesh: TriangleMesh, constraints: Constraints, curvature: float
) -> SecondEnergy | None:
    """Second energy to look at where `gauss-map` or `cotan` may fall by crumpling.

    Parameters
    ----------
    name : str
        Name of the energy that the flow lowers.
    mesh : TriangleMesh
    constraints : Constraints
    curvature : float
        Spontaneous curvature, one over the unit of the mesh.

    Returns
    -------
    SecondEnergy or None

    Notes
    -----
    Where nothing is kept on closed parts of genus 0, `gauss-map` cannot: there it is never below 4 pi, and at
    4 pi only on round spheres; the end of `cotan` is compared with 4 pi.
    """
    round_only = is_spheres(mesh.topology) and not constraints.active
    if name not in SECOND_ENERGIES or round_only or not mesh.topology.is_closed:
        return None
    if name != DEFAULT_ENERGY and curvature:  # the ratio of two Helfrich energies means nothing near zero
        return None
    builder = with_curvature(ENERGIES[SECOND_ENERGIES[name]].builder(mesh), curvature)
    return SecondEnergy(builder, None if name == DEFAULT_ENERGY else rules.CRUMPLING_RATIO)
