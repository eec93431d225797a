"""Curvature measures and tensors of regions that a user names (chapters 2 and 3 of the notes).

The measures of a polyhedron sit on its vertices (Gaussian curvature: angle defects) and edges (mean
curvature: length times dihedral angle). A region is a set of cells: of vertices, with half of each edge,
or of faces, which share the edges between them by halves and the vertices in proportion to their angles;
or a ball, which cuts edges and faces. Measures of disjoint cells add up to those of their union.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.clip import FacePlanes
from ddgcli.algorithms.curvature.measures import angle_defect, vertex_area
from ddgcli.errors import ParameterError
from ddgcli.geometry.extrinsic import dihedral_angle, face_normal
from ddgcli.geometry.faces import Faces
from ddgcli.geometry.intrinsic import corner_angle, face_area
from ddgcli.mesh.scatter import sum_by_index
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import ratio, row_cross, row_dot, unit_vectors, vector_length
from ddgcli.representation import short_repr

log = logging.getLogger("ddgcli")
CLIP_ROUNDING = 1e-12  # of an area cut by a sphere, over its radius squared
MAX_REGIONS = 100_000


@dataclass(frozen=True, eq=False)
class RegionMeasures:
    """Measures of k regions.

    Parameters
    ----------
    area : (k,) ndarray
    phi_k : (k,) ndarray
        Integral of the Gaussian curvature: angle defects, in radians.
    phi_h : (k,) ndarray
        Integral of the sum of the principal curvatures: length times dihedral angle of the edges; positive
        where convex.
    anisotropic : (k, 3, 3) ndarray
        Sum of length times dihedral angle times e e', e the unit vector of an edge: the curvature across
        an edge appears along it.
    normal_cycle : (k, 3, 3) ndarray
        Half the sum of length times ((theta - sin theta) p p' + (theta + sin theta) q q'), p and q the
        unit vectors along the sum and the difference of both normals: the curvature across an edge appears
        across it. Both tensors have the trace `phi_h`.
    """

    area: NDArray[np.float64]
    phi_k: NDArray[np.float64]
    phi_h: NDArray[np.float64]
    anisotropic: NDArray[np.float64]
    normal_cycle: NDArray[np.float64]

    __repr__ = short_repr

    def entries(self) -> list[dict[str, Any]]:
        """Summary entries of the regions."""
        return [
            {
                "area": float(self.area[i]), "phi_k": float(self.phi_k[i]), "phi_h": float(self.phi_h[i]),
                "anisotropic_tensor": self.anisotropic[i].tolist(),
                "normal_cycle_tensor": self.normal_cycle[i].tolist(),
            }
            for i in range(len(self.area))
        ]  # fmt: skip


@dataclass(frozen=True, eq=False)
class _EdgeTensors:
    """Dihedral angle of each edge, and both tensors of an edge of length 1."""

    angle: NDArray[np.float64]
    anisotropic: NDArray[np.float64]
    normal_cycle: NDArray[np.float64]
    length: NDArray[np.float64]

    def weighted(self, region: NDArray, edge: NDArray, length: NDArray, count: int) -> tuple[NDArray, ...]:
        """phi_h and both tensors by region of parts of edges with lengths."""
        turn = length * self.angle[edge]
        integrands = [turn]
        for tensor in (self.anisotropic, self.normal_cycle):
            integrands.append(length[:, None, None] * tensor[edge])
        return tuple(_by_region(region, integrand, count) for integrand in integrands)


def _by_region(region: NDArray, values: NDArray, count: int) -> NDArray[np.float64]:
    flat = values.reshape(len(values), math.prod(values.shape[1:]))
    columns = [sum_by_index(region, np.ascontiguousarray(column), count) for column in flat.T]
    return np.stack(columns, axis=-1).reshape(count, *values.shape[1:])


def _edge_tensors(mesh: TriangleMesh) -> _EdgeTensors:
    topology = mesh.topology
    normal = face_normal(mesh)
    angle = dihedral_angle(mesh)
    ends = mesh.points[topology.edges]
    vector = ends[:, 1] - ends[:, 0]
    unit = unit_vectors(vector)
    side = topology.interior_sides
    edge, other = topology.side_edge.ravel()[side], topology.side_twin.ravel()[side]
    n1, n2 = normal[side // 3], normal[other // 3]
    total, gap = np.zeros((2, topology.n_edges, 3))
    total[edge] = unit_vectors(n1 + n2)
    # across the edge and tangential to the mean of both faces; also where the edge is flat
    gap[edge] = row_cross(total[edge], unit[edge])
    sine = np.sin(angle)
    normal_cycle = 0.5 * (_squares(angle - sine, total) + _squares(angle + sine, gap))
    return _EdgeTensors(angle, _squares(angle, unit), normal_cycle, vector_length(vector))


def _squares(weight: NDArray, vector: NDArray) -> NDArray[np.float64]:
    """(k, 3, 3) weighted products of vectors with themselves."""
    return weight[:, None, None] * vector[:, :, None] * vector[:, None, :]


def measures_of_labels(mesh: TriangleMesh, label: NDArray, place: str) -> RegionMeasures:
    """Measures of the regions of equal labels 0..k-1 on faces or on vertices.

    Parameters
    ----------
    mesh : TriangleMesh
        Consistently oriented, faces outward.
    label : (m,) or (n,) ndarray of int64
    place : {'face', 'vertex'}

    Returns
    -------
    RegionMeasures
        Sums over all regions are the integrals over the surface. Vertices without faces add nothing.
    """
    topology, tensors = mesh.topology, _edge_tensors(mesh)
    count = int(label.max(initial=-1)) + 1
    defect = angle_defect(mesh)
    if place == "vertex":
        edge = np.repeat(np.arange(topology.n_edges), 2)
        half = 0.5 * tensors.length[edge]
        phi_h, anisotropic, cycle = tensors.weighted(label[topology.edges].ravel(), edge, half, count)
        area, phi_k = (sum_by_index(label, values, count) for values in (vertex_area(mesh), defect))
        return RegionMeasures(area, phi_k, phi_h, anisotropic, cycle)
    side = np.flatnonzero(topology.side_twin.ravel() >= 0)
    edge = topology.side_edge.ravel()[side]
    half = 0.5 * tensors.length[edge]
    phi_h, anisotropic, cycle = tensors.weighted(label[side // 3], edge, half, count)
    angle = corner_angle(mesh.side_length).ravel()
    corner = mesh.faces.ravel()
    total = sum_by_index(corner, angle, mesh.n_vertices)
    share = ratio(angle, total[corner]) * defect[corner]
    phi_k = sum_by_index(np.repeat(label, 3), share, count)
    return RegionMeasures(
        sum_by_index(label, face_area(mesh.side_length), count), phi_k, phi_h, anisotropic, cycle
    )


def measures_in_ball(mesh: TriangleMesh, centre: NDArray, radius: float) -> RegionMeasures:
    """Measures of the part of a surface in a ball, which cuts edges and faces exactly.

    Parameters
    ----------
    mesh : TriangleMesh
    centre : (3,) ndarray
    radius : float

    Returns
    -------
    RegionMeasures
        Measures of the ball. Vertices on the sphere count; a ball that misses the surface gives a warning.
    """
    if not np.isfinite(centre).all():
        raise ParameterError("must be finite", parameter="centre")
    if not (np.isfinite(radius) and radius > 0):
        raise ParameterError(f"must be a positive length, not {radius}", parameter="radius")
    topology, tensors = mesh.topology, _edge_tensors(mesh)
    offset = mesh.points - centre
    inside = (vector_length(offset) <= radius) & topology.referenced_vertex
    start = offset[topology.edges[:, 0]]
    unit = unit_vectors(mesh.points[topology.edges[:, 1]] - mesh.points[topology.edges[:, 0]])
    along = row_dot(start, unit)
    squared = row_dot(start, start) - along**2
    half = np.sqrt(np.maximum(radius**2 - squared, 0.0))
    chord = np.clip(half, along, along + tensors.length) - np.clip(-half, along, along + tensors.length)
    zero = np.zeros(len(chord), dtype=np.int64)
    phi_h, anisotropic, cycle = tensors.weighted(zero, np.arange(len(chord)), chord, 1)
    faces = Faces.of(mesh)
    planes = FacePlanes.of(np.stack([faces.points[:, corner] for corner in faces.corner]))
    centres = np.repeat(np.asarray(centre, dtype=float)[:, None], mesh.n_faces, axis=1)
    area, _ = planes.clip(np.arange(mesh.n_faces), centres, radius)
    phi_k = np.array([angle_defect(mesh)[inside].sum()])
    if not (inside.any() or chord.any()) and area.sum() <= CLIP_ROUNDING * radius**2:
        nearest = vector_length(offset[topology.referenced_vertex]).min(initial=np.inf)
        place = ", ".join(f"{x:g}" for x in np.asarray(centre, dtype=float))
        log.warning(
            "the ball of radius %g around (%s) holds no part of the surface; its nearest vertex is %.4g from "
            "the centre: move the ball, or enlarge it", radius, place, nearest,
        )  # fmt: skip
    return RegionMeasures(np.array([area.sum()]), phi_k, phi_h, anisotropic, cycle)


def labels_of(array: NDArray) -> tuple[NDArray[np.int64], NDArray]:
    """Number the different values of an array.

    Parameters
    ----------
    array : (k,) or (k, 1) ndarray
        Whole numbers.

    Returns
    -------
    label : (k,) ndarray of int64
        0, 1, 2, ...
    names : ndarray of int64
        The value of each label, ascending.

    Raises
    ------
    ParameterError
        On values that are not whole numbers, or on too many different ones.
    """
    values = np.asarray(array)
    if values.ndim == 2 and values.shape[1] == 1:
        values = values[:, 0]
    whole = (
        np.isfinite(values).all() and (values == np.round(values)).all() and (np.abs(values) < 2.0**63).all()
    )
    if values.ndim != 1 or not whole:
        raise ParameterError("regions are whole numbers, one a face or a vertex", parameter="array")
    names, label = np.unique(values.astype(np.int64), return_inverse=True)
    if len(names) > MAX_REGIONS:
        raise ParameterError(f"{len(names)} different regions are too many; give labels", parameter="array")
    return label.reshape(-1).astype(np.int64), names
