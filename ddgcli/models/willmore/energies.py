"""The table of bending energies: name -> what it is and how it is made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import Topology
from ddgcli.models.willmore.gauss_map_energy import GaussMapEnergy
from ddgcli.models.willmore.hinge_energy import HingeEnergy
from ddgcli.models.willmore.vertex_energies import VertexEnergy


class Energy(Protocol):
    """A scale-invariant function of the vertex positions with its exact gradient."""

    def value(self, points: NDArray) -> float: ...

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]: ...


class Builder(Protocol):
    """Makes an energy; free_slope: the surface may turn about its boundary."""

    def __call__(self, topology: Topology, free_slope: bool = False) -> Energy: ...


@dataclass(frozen=True)
class Kind:
    """One row of the table.

    Parameters
    ----------
    build : Builder
    convention : str
        What the number stands for; the summary's `energy_convention`.
    """

    build: Builder
    convention: str


def _vertex(sullivan: bool) -> Builder:
    def build(topology: Topology, free_slope: bool = False) -> Energy:
        return VertexEnergy(topology, sullivan, topology.referenced_vertex & ~topology.boundary_vertex)

    return build


def _hinge(topology: Topology, free_slope: bool = False) -> Energy:
    closed = topology.is_closed
    return HingeEnergy(topology, 4.0 * np.pi * topology.euler_characteristic / 3.0 if closed else 0.0)


DEFAULT = "gauss-map"
_SMOOTH = "int H^2 dA with H = (k1 + k2)/2 (a round sphere has 4 pi)"
ENERGIES = {
    "gauss-map": Kind(
        GaussMapEnergy,
        f"{_SMOOTH}; int K + sum over faces of (D - G)/2 and the sides' S-shape, D Dirichlet energy and G "
        "area of the vertex normals (where the slope at the boundary is free: of (D + G)/2, without int K)",
    ),
    "sullivan": Kind(
        _vertex(True), f"{_SMOOTH}; sum over inner vertices of |dArea|^2 / (4 |dVolume|^2) * star area / 3"
    ),
    "cotan": Kind(
        _vertex(False), f"{_SMOOTH}; sum over inner vertices of |L x|^2 / (4 M), M mixed Voronoi cells"
    ),
    "hinge": Kind(
        _hinge,
        f"{_SMOOTH} on equilateral triangles only; sum over inner edges of |e|^2 theta^2 / (4 (A1 + A2)), "
        "plus 4 pi chi / 3 on a closed surface",
    ),
}
