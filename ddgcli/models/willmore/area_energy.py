"""Area and enclosed volume as energies that flows lower, with their exact gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import cone_volume, row_cross, row_dot
from ddgcli.models.willmore.vertex_energies import FaceSides, area_gradient


@dataclass(frozen=True, eq=False)
class AreaEnergy:
    """Area of the surface.

    Parameters
    ----------
    topology : Topology
    """

    topology: Topology

    def value(self, points: NDArray) -> float:
        """Area."""
        return float(FaceSides.at(points, self.topology.faces).area.sum())

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]:
        """Area and its exact gradient (n, 3)."""
        faces = FaceSides.at(points, self.topology.faces)
        gradient = sum_by_index(self.topology.faces, area_gradient(faces), self.topology.n_vertices)
        return float(faces.area.sum()), gradient


@dataclass(frozen=True, eq=False)
class VolumeEnergy:
    """Enclosed volume of a closed surface, times a factor.

    Parameters
    ----------
    topology : Topology
    factor : float
        -1 to enlarge the volume of an outward oriented surface.
    """

    topology: Topology
    factor: float

    def value(self, points: NDArray) -> float:
        """Volume times the factor."""
        return self.factor * signed_volume(points, self.topology.faces)

    def value_and_gradient(self, points: NDArray) -> tuple[float, NDArray[np.float64]]:
        """Volume times the factor and its exact gradient (n, 3)."""
        return self.value(points), self.factor * volume_gradient(TriangleMesh(points, self.topology))


def signed_volume(points: NDArray, faces: NDArray) -> float:
    """Volume between closed oriented faces, measured from the mean of the points.

    Parameters
    ----------
    points : (n, 3) ndarray of float64
    faces : (m, 3) ndarray of int64

    Returns
    -------
    float
        In length^3, positive for outward orientation.
    """
    corner = (points - points.mean(axis=0))[faces]
    return float(cone_volume(corner[:, 0].T, corner[:, 1].T, corner[:, 2].T).sum())


def volume_gradient(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Derivative of the enclosed volume by the vertices: a third of their area vectors.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    (n, 3) ndarray of float64
        In length^2; of no meaning at boundary vertices.
    """
    faces = FaceSides.at(mesh.points, mesh.faces)
    third = row_cross(faces.opposite[:, 0], faces.opposite[:, 1]) / 6.0
    return sum_by_index(mesh.faces, np.repeat(third[:, None], 3, axis=1), mesh.n_vertices)


def mean_curvature(mesh: TriangleMesh, normal: NDArray) -> NDArray[np.float64]:
    """Mean curvature H as half the quotient of the area's and the volume's derivative along normals.

    Parameters
    ----------
    mesh : TriangleMesh
    normal : (n, 3) ndarray of float64
        Unit normals.

    Returns
    -------
    (n,) ndarray of float64
        In 1/length, half the sum of the principal curvatures, positive where convex with outward normals.
    """
    by_area = AreaEnergy(mesh.topology).value_and_gradient(mesh.points)[1]
    across, swept = (row_dot(g, normal) for g in (by_area, volume_gradient(mesh)))
    return 0.5 * across / swept
