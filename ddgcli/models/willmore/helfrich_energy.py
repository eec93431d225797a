"""The Helfrich energy of membranes: bending against a curvature that they prefer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import ParameterError
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.energies import Energy, EnergyBuilder
from ddgcli.models.willmore.flow_options import FlowOptions
from ddgcli.models.willmore.hinges import BentHinges, Hinges
from ddgcli.models.willmore.vertex_energies import FaceSides, area_gradient

MAX_CURVATURE_OF_EDGES = 2.0  # largest spontaneous curvature times the mean edge: spheres of half an edge


@dataclass(frozen=True, eq=False)
class HelfrichEnergy:
    """int (H - H0)^2 dA as W - 2 H0 M + H0^2 A, M = sum over inner edges of |e| theta / 2.

    Parameters
    ----------
    topology : Topology
    bending : Energy
        W of the same topology.
    curvature : float
        H0, for the faces' orientation: positive on an outward oriented sphere.

    Notes
    -----
    W. Helfrich, "Elastic properties of lipid bilayers", 1973; his c0 is 2 H0. M is Steiner's total mean
    curvature int H of the polyhedron, exact for its parallel surfaces.
    """

    topology: Topology
    bending: Energy
    curvature: float

    @cached_property
    def _hinges(self) -> Hinges:
        return Hinges.of(self.topology)

    def _addition(self, points: NDArray) -> tuple[float, FaceSides, BentHinges]:
        """-2 H0 M + H0^2 A, and what its gradient needs: faces, hinges."""
        faces = FaceSides.at(points, self.topology.faces)
        hinges = self._hinges.bent(points)
        total = 0.5 * float((hinges.shape.length * hinges.shape.angle).sum())
        return self.curvature * (self.curvature * float(faces.area.sum()) - 2.0 * total), faces, hinges

    def value(self, points: NDArray) -> float:
        """Energy; not finite on a surface with a face without area."""
        return self.bending.value(points) + self._addition(points)[0]

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]:
        """Energy and its exact gradient (n, 3)."""
        value, gradient = self.bending.value_and_gradient(points)
        addition, faces, hinges = self._addition(points)
        corners = self.topology.faces
        by_area = self.curvature**2 * area_gradient(faces)
        gradient = gradient + sum_by_index(corners, by_area, self.topology.n_vertices)
        shape = hinges.shape
        gradient += hinges.gradient(-self.curvature * shape.length, -self.curvature * shape.angle)
        return value + addition, gradient


def unit_curvature(unit: TriangleMesh, options: FlowOptions, scale: float) -> float:
    """Spontaneous curvature at unit size, for the orientation of the faces.

    Parameters
    ----------
    unit : TriangleMesh
        The surface at unit size.
    options : FlowOptions
    scale : float
        Length of a unit.

    Returns
    -------
    float

    Raises
    ------
    ParameterError
        When nothing is kept: the energy is then that of no membrane, and shrinks to spheres of radius 1 / H0.
        When those spheres are far smaller than the edges: the constant H0^2 A then hides the bending.
    """
    if not options.spontaneous_curvature:
        return 0.0
    if options.flow == "mean-curvature":
        raise ParameterError(
            "has no effect on the area; use `flow=quadratic`", parameter="spontaneous_curvature"
        )
    if not (options.fix_area or options.fix_volume):
        raise ParameterError("needs `fix_area`, `fix_volume` or both", parameter="spontaneous_curvature")
    edge = float(unit.side_length.mean()) * scale
    largest = float(f"{MAX_CURVATURE_OF_EDGES / edge:.2g}")  # the number that is printed is taken
    if abs(options.spontaneous_curvature) > largest:
        raise ParameterError(
            f"must be from {-largest:g} to {largest:g} here: spheres of greater ones are smaller than half "
            "of the mean edge",
            parameter="spontaneous_curvature",
        )
    inward = unit.topology.is_closed and enclosed_volume(unit) < 0.0
    return options.spontaneous_curvature * scale * (-1.0 if inward else 1.0)


def with_curvature(kind: EnergyBuilder, curvature: float) -> EnergyBuilder:
    """The Helfrich energy of an energy; itself without spontaneous curvature.

    Parameters
    ----------
    kind : callable
    curvature : float
        At unit size.

    Returns
    -------
    callable
    """
    if not curvature:
        return kind
    return lambda topology: HelfrichEnergy(topology, kind(topology), curvature)
