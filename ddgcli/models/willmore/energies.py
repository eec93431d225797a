"""The table of bending energies: name -> what it is and how it is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore.circle_angle_energy import CircleAngleEnergy
from ddgcli.models.willmore.gauss_map_energy import GaussMapEnergy
from ddgcli.models.willmore.hinge_energy import HingeEnergy
from ddgcli.models.willmore.quadratic_energy import QuadraticEnergy
from ddgcli.models.willmore.vertex_energies import VertexEnergy


class Energy(Protocol):
    """A function of the vertex positions with its exact gradient."""

    def value(self, points: NDArray) -> float: ...

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]: ...


EnergyBuilder = Callable[[Topology], Energy]


@dataclass(frozen=True)
class EnergyDefinition:
    """One row of the table.

    Parameters
    ----------
    builder : callable
        Reference surface -> (Topology -> Energy); all energies but `quadratic` do without the reference.
    convention : str
        What the number approximates; the summary's `energy_convention`.
    keeps_triangles : bool
        Flips and slides of vertices change it little, so that a flow may take them.
    of_surface : bool
        It approximates a function of the surface; else its gradient along the surface is not an error.
    converges : bool
        On fine meshes it is that function however the edges lie.
    """

    builder: Callable[[TriangleMesh], EnergyBuilder]
    convention: str
    keeps_triangles: bool = True
    of_surface: bool = True
    converges: bool = True

    def of(self, mesh: TriangleMesh) -> Energy:
        """The energy on the faces of a surface, which is its own reference."""
        return self.builder(mesh)(mesh.topology)


def _of_topology(build: EnergyBuilder) -> Callable[[TriangleMesh], EnergyBuilder]:
    return lambda reference: build


def _quadratic(reference: TriangleMesh) -> EnergyBuilder:
    energy = QuadraticEnergy(reference)
    return lambda topology: energy


def _vertex(sullivan: bool) -> Callable[[TriangleMesh], EnergyBuilder]:
    return _of_topology(
        lambda topology: VertexEnergy(
            topology, sullivan, topology.referenced_vertex & ~topology.boundary_vertex
        )
    )


# on a surface with boundary `gauss-map` leaves the faces there out, and its int K makes it fall below zero
DEFAULT_ENERGY, DEFAULT_OPEN_ENERGY = "gauss-map", "cotan"
# energy -> one that rises where a fall of the first is crumpling: `cotan` is stiff where faces become
# slender, `gauss-map` where a handle becomes a strip of needles
SECOND_ENERGIES = {"gauss-map": "cotan", "cotan": "gauss-map"}
_SMOOTH_TERM = "int H^2 dA with H = (k1 + k2)/2 (a round sphere has 4 pi)"
ENERGIES = {
    "gauss-map": EnergyDefinition(
        _of_topology(GaussMapEnergy),
        f"{_SMOOTH_TERM}; int K + sum over faces of (D - G)/2, the S-shape and the corners' lean, "
        "D Dirichlet energy and G area of the vertex normals",
    ),
    "sullivan": EnergyDefinition(
        _vertex(True),
        f"{_SMOOTH_TERM}; sum over inner vertices of |dArea|^2 / (4 |dVolume|^2) * star area / 3",
    ),
    "cotan": EnergyDefinition(
        _vertex(False), f"{_SMOOTH_TERM}; sum over inner vertices of |L x|^2 / (4 M), M mixed Voronoi cells"
    ),
    "hinge": EnergyDefinition(
        _of_topology(HingeEnergy),
        f"{_SMOOTH_TERM} (equilateral triangles); sum over inner edges of |e|^2 theta^2 / (4 (A1 + A2)), "
        "plus 4 pi chi / 3 on a closed surface",
        keeps_triangles=False,
        converges=False,
    ),
    "quadratic": EnergyDefinition(
        _quadratic,
        f"{_SMOOTH_TERM} (equilateral triangles, isometric to the input); sum over inner edges of "
        "|sum c x|^2 / (4 (A1 + A2)), cotangents c and areas of the input, plus 4 pi chi / 3 on a closed "
        "surface",
        keeps_triangles=False,
        of_surface=False,
        converges=False,
    ),
    "circle-angle": EnergyDefinition(
        _of_topology(CircleAngleEnergy),
        "int (H^2 - K) dA with H = (k1 + k2)/2 (a round sphere has 0); half the sum over inner "
        "vertices of the angles between circumcircles less 2 pi; larger where edges do not follow curvature "
        "lines",
        converges=False,
    ),
}
