"""Deviation of the vertices of a surface from a smooth surface: its size and its kind.

The deviation is measured by residuals of polynomial fits over two rings. For noise, fits of degree three and
four have equal residuals; for details they do not. Stairs, rounded coordinates and spikes are recognised
first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.fit_penalty import polynomial_residuals, sampled_regions
from ddgcli.algorithms.curvature.frames import area_normals
from ddgcli.algorithms.curvature.grid_coordinates import rounding_deviation
from ddgcli.algorithms.curvature.neighbours import neighbourhoods
from ddgcli.algorithms.curvature.regions import Regions, listed
from ddgcli.algorithms.curvature.spikes import spikes_among
from ddgcli.algorithms.curvature.staircase import is_staircase, sampled_sides
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.ragged import sorted_keys
from ddgcli.mesh.triangle_mesh import TriangleMesh

SAMPLE_SIZE = 400  # vertices sampled for residuals
MAX_UNSAMPLED_VERTICES = 6400  # size of a mesh up to which all vertices are candidates for the sample
# On larger meshes, this many candidates per sampled vertex are chosen evenly in the order of star areas.
CANDIDATES_PER_SAMPLE = 4
MIN_SAMPLE = 15  # sampled vertices below which noise is not estimated
# Dihedral angle in radians below which two faces count as coplanar, in files of single precision.
FLAT_ANGLE_TOLERANCE = 1e-3
# Share of flat edges above which large residuals may be creases of a mechanical part instead of noise.
MIN_CREASED_FLAT_SHARE = 0.1
# On surfaces with many flat regions, a region is bent if its residual is above the first number, in edges.
# The bent regions are examined separately if their share is above the second number.
MIN_BENT_RESIDUAL, MIN_BENT_SHARE = 0.03, 0.1
# Residual of cubic fits over that of quartic ones above which the surface may have details. Noise has 0.98 to
# 1.08, measured on spheres, tori and voxels; scanned and modelled surfaces with details of four to ten edges
# have 1.2 to 2.9.
MIN_DETAIL_RATIO = 1.15
# Only a part of the surface has noise, or there are spikes, if this quantile of the residuals is at least so
# many times their median.
PARTIAL_QUANTILE, MIN_PARTIAL_RATIO = 0.9, 5
# About half of the surface has noise if the share of residuals above the first number times that quantile is
# below the second number; on other surfaces the share is 0.85 to 1.
NOISY_SHARE_OF_TAIL, MAX_NOISY_SHARE = 0.5, 0.6
VOXEL_DEVIATION = 12**-0.5  # standard deviation of uniformly distributed heights within a voxel, in edges
# Range of the residuals over the deviation of rounded coordinates, within which rounding explains them.
ROUNDING_RANGE = 0.6, 1.6
# Least number of spikes in the sample of SPIKE_SAMPLE_SIZE vertices, and least share of them.
MIN_SPIKES, MIN_SPIKE_SHARE = 3, 0.003
SPIKE_SAMPLE_SIZE = 2000


@dataclass(frozen=True, eq=False)
class Deviation:
    """Residuals of cubic fits over two rings, at a sample of vertices.

    Parameters
    ----------
    relative : float
        Size of the residuals over the mean edge length: their median, which ignores creases, or a high
        quantile if that is far above the median and not due to details.
    kind : str
        'voxels', 'rounded', 'spikes', 'partial' or 'noise', as in `Noise`.
    detail_ratio : float
        Median residual of cubic fits over that of quartic ones.
    flat_share : float
        Share of the edges that are flat.
    doubtful : bool
        Whether the residuals or flat faces could be due to details and creases.
    noisy : (k,) ndarray of bool
        Which vertices of the sample have the deviation.
    sample : (k,) ndarray of int
    regions : Regions
        Two rings around the sample.
    normal : (3, n) ndarray
        Area-weighted normals of all vertices.
    of_bent : Deviation, optional
        Deviation of the regions that are not flat, if many faces are: tall steps have flat regions between
        them.
    """

    relative: float
    kind: str
    detail_ratio: float
    flat_share: float
    doubtful: bool
    noisy: NDArray[np.bool_]
    sample: NDArray[np.int64]
    regions: Regions
    normal: NDArray[np.float64]
    of_bent: Deviation | None = None


def vertex_deviation(
    mesh: TriangleMesh, faces: Faces, dihedral: NDArray, steps: NDArray | None = None
) -> Deviation | None:
    """Measure the deviation of the vertices from smooth surfaces.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Faces of the mesh.
    dihedral : (e,) ndarray
        Dihedral angles of the edges in radians, positive where convex.
    steps : (3, n) ndarray of float64, optional
        Steps to which the coordinates were rounded (`precision_steps`).

    Returns
    -------
    Deviation or None
        None if too few vertices have enough neighbours.
    """
    normal = area_normals(faces)
    vertices = _candidates(mesh, faces)
    regions = neighbourhoods(mesh, faces, normal, vertices)
    if vertices is None:
        vertices = np.arange(mesh.n_vertices)
    sample_rows = sampled_regions(faces.points, faces.points[:, vertices], regions, SAMPLE_SIZE)
    sample_rows = sample_rows[~mesh.topology.boundary_vertex[vertices[sample_rows]]]
    if len(sample_rows) < MIN_SAMPLE:
        return None
    sample, some = vertices[sample_rows], listed(regions, sample_rows)
    edge = faces.mean_length
    residuals = polynomial_residuals(faces.points, normal, some, sample, (3, 4))
    deviation, detail_ratio, noisy = _deviation(*residuals)
    kind = "noise" if noisy.all() else "partial"
    if is_staircase(mesh, faces, dihedral):
        # two rings may lie on one step, without residuals; heights within a voxel are uniformly distributed
        kind, deviation = "voxels", max(deviation, VOXEL_DEVIATION * edge)
    elif _is_rounded(faces, normal[:, sample], deviation, edge, None if steps is None else steps[:, sample]):
        kind = "rounded"
    elif _has_spikes(faces.points, normal, regions, vertices, edge):
        kind, deviation = "spikes", float(np.sqrt(np.nanmean(residuals[0] ** 2)))
    flat_share = float((np.abs(dihedral) < FLAT_ANGLE_TOLERANCE).mean())
    doubtful = detail_ratio > MIN_DETAIL_RATIO or flat_share > MIN_CREASED_FLAT_SHARE
    whole = Deviation(deviation / edge, kind, detail_ratio, flat_share, doubtful, noisy, sample, some, normal)
    if flat_share <= MIN_CREASED_FLAT_SHARE:
        return whole
    return replace(whole, of_bent=_of_bent(whole, residuals[0], residuals[1], edge))


def _of_bent(whole: Deviation, cubic: NDArray, quartic: NDArray, edge: float) -> Deviation | None:
    """Deviation of the regions that are not flat; None if they are few."""
    bent = np.isfinite(quartic) & (cubic > MIN_BENT_RESIDUAL * edge)
    if bent.sum() < max(MIN_SAMPLE, MIN_BENT_SHARE * len(bent)):
        return None
    deviation, quartic_deviation = float(np.median(cubic[bent])), float(np.median(quartic[bent]))
    ratio = deviation / quartic_deviation if quartic_deviation > 0 else np.inf
    return replace(whole, relative=deviation / edge, kind="noise", detail_ratio=ratio, noisy=bent)


def _deviation(cubic: NDArray, quartic: NDArray) -> tuple[float, float, NDArray[np.bool_]]:
    """Deviation of the vertices, ratio of cubic and quartic residuals, and (k,) which vertices have noise.

    `cubic` and `quartic` are the residuals of fits of degree three and four. All vertices of the sample have
    noise unless the residuals show that only a part of the surface has.
    """
    both = np.isfinite(cubic) & np.isfinite(quartic)
    whole = np.ones(len(cubic), dtype=bool)
    if not both.any():
        return float(np.nanmedian(cubic)), 1.0, whole
    (middle, tail), (quartic_middle, quartic_tail) = (
        np.quantile(residuals[both], (0.5, PARTIAL_QUANTILE)) for residuals in (cubic, quartic)
    )
    noisy = both & (cubic > NOISY_SHARE_OF_TAIL * tail)
    if tail > MIN_PARTIAL_RATIO * middle and tail <= MIN_DETAIL_RATIO * quartic_tail:
        return float(tail), 1.0, noisy
    ratio = float(middle / quartic_middle) if quartic_middle > 0 else 1.0
    if ratio > MIN_DETAIL_RATIO and noisy.sum() < MAX_NOISY_SHARE * both.sum():
        deviation, quartic_deviation = float(np.median(cubic[noisy])), float(np.median(quartic[noisy]))
        if deviation <= MIN_DETAIL_RATIO * quartic_deviation:
            return deviation, ratio, noisy
    return float(np.nanmedian(cubic)), ratio, whole


def _is_rounded(faces: Faces, normal: NDArray, deviation: float, edge: float, steps: NDArray | None) -> bool:
    """Whether coordinates are whole multiples of steps that explain the residuals."""
    expected = [rounding_deviation(faces.sorted_coordinates, normal, sampled_sides(faces), edge)]
    if steps is not None:
        expected.append(float(np.median(np.sqrt(((steps * normal) ** 2).sum(axis=0) / 12))))
    least, most = ROUNDING_RANGE
    return any(least * one < deviation < most * one for one in expected)


def _has_spikes(points: NDArray, normal: NDArray, regions: Regions, vertices: NDArray, edge: float) -> bool:
    """Whether at least a few vertices in a thousand are far off an otherwise smooth surface."""
    some = np.arange(0, len(vertices), max(1, len(vertices) // SPIKE_SAMPLE_SIZE))
    is_spike = spikes_among(points, normal, listed(regions, some), vertices[some], edge)
    return bool(is_spike.sum() >= max(MIN_SPIKES, MIN_SPIKE_SHARE * len(some)))


def _candidates(mesh: TriangleMesh, faces: Faces) -> NDArray[np.int64] | None:
    """Candidates for the sample, in the order of the areas of their stars; None for all vertices."""
    if mesh.n_vertices <= MAX_UNSAMPLED_VERTICES:
        return None
    vertices = np.flatnonzero(mesh.topology.referenced_vertex)
    area = faces.stars(faces.area[None])[0].take(vertices).astype(np.float32)
    order = sorted_keys(area.view(np.int32), 1 << 31)[1]  # bits of positive floats sort like the floats
    return vertices[order[:: max(1, len(vertices) // (CANDIDATES_PER_SAMPLE * SAMPLE_SIZE))]]
