"""Noise of a surface's vertices: its size, its effect on curvature, and the radius that averages it.

Residuals of fits over two rings show the deviation of the vertices, of whatever kind; shapes of faces,
creases of both signs and coordinates on grids distinguish noise from details. The error of the default
region and the radius come from balls around a sample of vertices (`scales`).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.faces import Faces
from ddgcli.algorithms.curvature.frames import area_normals
from ddgcli.algorithms.curvature.grid_coordinates import on_grid_edges, rounding_deviation
from ddgcli.algorithms.curvature.neighbours import neighbourhoods
from ddgcli.algorithms.curvature.quadric import (
    QUADRATIC_PENALTY,
    cross_validated_penalty,
    polynomial_residuals,
    sampled_regions,
)
from ddgcli.algorithms.curvature.regions import Regions, largest_radius, listed
from ddgcli.algorithms.curvature.scales import (
    MAX_SURFACE_SHARE,
    RADIUS_RATIO,
    Scales,
    fits_at,
    fits_in_balls,
    measure_scales,
    typical_size,
)
from ddgcli.algorithms.curvature.spikes import spikes_among
from ddgcli.algorithms.curvature.staircase import cancellation, is_staircase
from ddgcli.mesh.triangle_mesh import TriangleMesh

Effort = Literal["fits", "warn", "auto"]

SAMPLE_SIZE, BENDING_SAMPLE_SIZE = 400, 100  # vertices sampled for residuals, and for curvature
MAX_UNSAMPLED_VERTICES = 6400  # up to which all vertices may be in the sample
# vertices, by the areas of their stars, among which the sample is chosen on larger meshes
CANDIDATES_PER_SAMPLE = 4
MIN_NEIGHBOURS = 15
# dihedral angle up to which two faces count as one plane (files of single precision)
FLAT_ANGLE_TOLERANCE = 1e-3
# share of flat edges from which large residuals are creases of a part, not noise
MIN_CREASED_FLAT_SHARE = 0.1
# residual of cubic fits over that of quartic ones: noise has 0.98 to 1.08, as measured on spheres, tori and
# voxels; scanned and modelled surfaces with details of four to ten edges have 1.2 to 2.9
MIN_DETAIL_RATIO = 1.15
MAX_ROUGH_DETAIL_RATIO = 1.7  # stairs that were averaged or cut have 1.2 to 1.6, details of ten edges 1.9
# noise in a part of the surface, or spikes: this quantile of the residuals is so many times their median
PARTIAL_QUANTILE, MIN_PARTIAL_RATIO = 0.9, 5
VOXEL_DEVIATION = 12**-0.5  # of heights within a voxel, in edges
ROUNDING_RANGE = 0.6, 1.6  # of the residuals over the deviation of rounded coordinates
MIN_SPIKES, MIN_SPIKE_SHARE = 3, 0.003
# vertices, and members of all balls: the stairs of large bodies need wide ones
VOTING_SAMPLE_SIZE, MAX_VOTING_PAIRS = 50, 2e6
VOXEL_SAMPLE_SIZE, MAX_VOXEL_PAIRS = 25, 1.2e7
SPIKE_SAMPLE_SIZE = 2000  # vertices among which spikes are counted
# creases of both signs within two rings: their sum over that of their sizes. Noise of more than a twentieth
# of an edge has 0.05 to 0.8, and less the larger it is; scans have 0.2 to 0.6, mechanical parts 0.4 to 0.9
MAX_CANCELLATION, MAX_ROUGH_CANCELLATION = 0.8, 0.28
MAX_CANCELLATION_OF_NOISE = 0.055  # times one over the noise in edges
# fall of the change of curvature when the radius doubles: creases have 2, stairs 3 to 10, noise 8
MIN_FALL = 2.5
MIN_MEDIAN_SHARE = 0.1  # median error of grids of voxels over the mean one, which creases of a part exceed
MAX_ROUGH_ERROR = 0.25  # at the best radius: terrain and scans with details of all sizes have more
MAX_ERROR = 0.08  # of curvature, root mean square, by noise, above which the default region is unreliable
MAX_REMAINING_ERROR_SHARE = 0.75  # largest share of that error at the proposed radius
# of the error of averaged normals over that of fits, below which the scheme is proposed
MAX_VOTING_SHARE = 0.8


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of the vertices along the normals.

    Parameters
    ----------
    relative : float or None
        Standard deviation over the mean edge length; None where too few vertices have enough neighbours.
    kind : str
        'voxels' (a staircase), 'rounded' (coordinates), 'grid' (marching cubes of grey values), 'spikes',
        'partial' (in a part of the surface), 'rough' (structure of the size of an edge), 'noise', or '' for a
        surface whose residuals are creases or details.
    scales : Scales, optional
        Mean curvature of some vertices in balls by quadratic fits, where the residuals may be noise.
    voting : Scales, optional
        The same by averaged normals, where noise dominates.
    """

    relative: float | None
    kind: str = ""
    scales: Scales | None = None
    voting: Scales | None = None

    @property
    def dominates_curvature(self) -> bool:
        """Whether the default region is unreliable and the proposed radius is clearly better."""
        best = self.scales_of(self.best_scheme)
        if not self.kind or best is None:
            return False
        return best.default_rms > MAX_ERROR and best.error < MAX_REMAINING_ERROR_SHARE * best.default_error

    @property
    def best_scheme(self) -> str:
        """Scheme with the least error in balls."""
        if self.scales is None or self.voting is None:
            return "quadric"
        votes = self.voting.error < MAX_VOTING_SHARE * self.scales.error
        return "normal-voting" if votes else "quadric"

    def scales_of(self, scheme: str) -> Scales | None:
        """Curvature in balls by a scheme, or by the one that is most like it."""
        return self.voting if scheme == "normal-voting" and self.voting is not None else self.scales

    def radius_of(self, scheme: str) -> float:
        """Radius with the least error of a scheme, in length units."""
        scales = self.scales_of(scheme)
        return 0.0 if scales is None else float(scales.radius[scales.best])


@dataclass(frozen=True, eq=False)
class Deviation:
    """Residuals of cubic fits over two rings, at a sample of vertices.

    Parameters
    ----------
    relative : float
        Their size over the mean edge length: the median, which ignores creases, or a high quantile where that
        is far above the median and not due to details.
    kind : str
        'voxels', 'rounded', 'spikes', 'partial' or 'noise', as in `Noise`.
    detail_ratio : float
        Median residual of cubic fits over that of quartic ones.
    doubtful : bool
        Whether residuals or flat faces are like those of details and creases.
    sample : (k,) ndarray of int
    regions : Regions
        Two rings around the sample.
    normal : (3, n) ndarray
        Of all vertices, averaged by areas.
    """

    relative: float
    kind: str
    detail_ratio: float
    doubtful: bool
    sample: NDArray[np.int64]
    regions: Regions
    normal: NDArray[np.float64]


def vertex_deviation(mesh: TriangleMesh, faces: Faces, dihedral: NDArray) -> Deviation | None:
    """Measure the deviation of the vertices from smooth surfaces; None where too few have enough neighbours.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Of the mesh.
    dihedral : (e,) ndarray
        Dihedral angles of the edges in radians, positive where convex.
    """
    normal = area_normals(faces)
    vertices = _candidates(mesh, faces)
    regions = neighbourhoods(mesh, faces, normal, MIN_NEIGHBOURS, vertices)
    if vertices is None:
        vertices = np.arange(mesh.n_vertices)
    sample_rows = sampled_regions(faces.points, faces.points[:, vertices], regions, SAMPLE_SIZE)
    sample_rows = sample_rows[~mesh.topology.boundary_vertex[vertices[sample_rows]]]
    if len(sample_rows) < MIN_NEIGHBOURS:
        return None
    sample, some = vertices[sample_rows], listed(regions, sample_rows)
    edge = float(faces.length.mean())
    residuals = polynomial_residuals(faces.points, normal, some, sample, (3, 4))
    deviation, detail_ratio, partial = _deviation(*residuals)
    kind = "partial" if partial else "noise"
    if is_staircase(mesh, faces, dihedral):
        # fits over two rings lie on a step; heights within a voxel are uniform
        kind, deviation = "voxels", max(deviation, VOXEL_DEVIATION * edge)
    elif _is_rounded(faces.points, normal[:, sample], deviation, edge):
        kind = "rounded"
    elif _has_spikes(faces.points, normal, regions, vertices, edge):
        kind, deviation = "spikes", float(np.sqrt(np.nanmean(residuals[0] ** 2)))
    flat_share = float((np.abs(dihedral) < FLAT_ANGLE_TOLERANCE).mean())
    doubtful = detail_ratio > MIN_DETAIL_RATIO or flat_share > MIN_CREASED_FLAT_SHARE
    return Deviation(deviation / edge, kind, detail_ratio, doubtful, sample, some, normal)


def estimate_noise(
    mesh: TriangleMesh, faces: Faces, dihedral: NDArray, scheme: str, *, effort: Effort = "warn"
) -> Noise:
    """Estimate the noise of the vertices and what it does to the mean curvature.

    The radius is one that the scheme can measure in.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Of the mesh.
    dihedral : (e,) ndarray
        Dihedral angles of the edges in radians, positive where convex.
    scheme : str
        Name of the scheme of curvature.
    effort : {'fits', 'warn', 'auto'}
        'fits': without averaged normals, which cost more; 'auto': with wide balls of them on voxels, which
        take several times as long as the measurement.
    """
    deviation = vertex_deviation(mesh, faces, dihedral)
    if deviation is None:
        return Noise(None)
    kind = _kind(mesh, faces, dihedral, deviation)
    if not kind:
        return Noise(deviation.relative)
    few = np.arange(0, len(deviation.sample), max(1, len(deviation.sample) // BENDING_SAMPLE_SIZE))
    regions, normal = listed(deviation.regions, few), deviation.normal
    scales = _scales(mesh, faces, normal, regions, deviation.sample[few], scheme)
    if scales is None or (
        (kind == "rough" and not _falls_as_noise(faces, normal, regions, scales))
        or (kind == "grid" and scales.median_share < MIN_MEDIAN_SHARE)  # creases of a part
    ):
        return Noise(deviation.relative)
    noise = Noise(deviation.relative, kind, scales)
    if scales.default_rms < MAX_ERROR or effort == "fits":
        return noise
    size = VOXEL_SAMPLE_SIZE if kind == "voxels" else VOTING_SAMPLE_SIZE
    pairs = MAX_VOXEL_PAIRS if kind == "voxels" and effort == "auto" else MAX_VOTING_PAIRS
    return replace(noise, voting=_voting_scales(mesh, faces, normal, scales, scheme, size, pairs))


def _kind(mesh: TriangleMesh, faces: Faces, dihedral: NDArray, deviation: Deviation) -> str:
    """Kind of the noise as far as residuals and creases show it; '' where they are those of a surface."""
    if deviation.kind not in ("noise", "partial"):
        return deviation.kind
    if on_grid_edges(faces.points, float(faces.length.mean())):
        return "grid"
    if cancellation(mesh, faces, dihedral, deviation.regions) > _largest_cancellation(deviation):
        return ""
    return "rough" if deviation.doubtful else deviation.kind


def _falls_as_noise(faces: Faces, normal: NDArray, regions: Regions, scales: Scales) -> bool:
    """Whether quadratic fits settle with the radius, as at creases and on terrain they do not."""
    if len(scales.change) < 3 or scales.error > MAX_ROUGH_ERROR:
        return False
    few = scales.vertices
    first = fits_at(faces.points, normal, few, normal[:, few], regions, QUADRATIC_PENALTY).mean
    return typical_size(first - scales.first_mean) > MIN_FALL * scales.change[2]


def _largest_cancellation(deviation: Deviation) -> float:
    """Cancellation of creases up to which residuals are noise."""
    if deviation.doubtful:
        return MAX_ROUGH_CANCELLATION if deviation.detail_ratio < MAX_ROUGH_DETAIL_RATIO else -1.0
    if deviation.kind == "partial":
        return np.inf
    return min(MAX_CANCELLATION, MAX_CANCELLATION_OF_NOISE / max(deviation.relative, 1e-300))


def _is_rounded(points: NDArray, normal: NDArray, deviation: float, edge: float) -> bool:
    """Whether coordinates are whole multiples of a step that explains the residuals."""
    expected = rounding_deviation(points, normal, edge)
    least, most = ROUNDING_RANGE
    return least * expected < deviation < most * expected


def _has_spikes(points: NDArray, normal: NDArray, regions: Regions, vertices: NDArray, edge: float) -> bool:
    """Whether some vertices in a thousand lie far off a surface that is smooth around them."""
    some = np.arange(0, len(vertices), max(1, len(vertices) // SPIKE_SAMPLE_SIZE))
    is_spike = spikes_among(points, normal, listed(regions, some), vertices[some], edge)
    return bool(is_spike.sum() >= max(MIN_SPIKES, MIN_SPIKE_SHARE * len(some)))


def _scales(
    mesh: TriangleMesh, faces: Faces, normal: NDArray, regions: Regions, few: NDArray, scheme: str
) -> Scales | None:
    """Mean curvature of a few vertices, over their regions and in balls."""
    from scipy.spatial import cKDTree  # a sixth of a small run's time

    area = float(faces.area.sum())
    vertex_area = area / int(mesh.topology.referenced_vertex.sum())
    region_radius = float(np.sqrt(vertex_area * np.median(regions.count) / np.pi))
    penalty = cross_validated_penalty(faces.points, normal, regions, few)
    default = fits_at(faces.points, normal, few, normal[:, few], regions, penalty).mean
    largest = min(np.sqrt(MAX_SURFACE_SHARE * area / np.pi), 0.99 * largest_radius(mesh, area, scheme))
    tree = cKDTree(mesh.points, balanced_tree=False, compact_nodes=False)
    return measure_scales(
        lambda radius: fits_in_balls(faces.points, normal, few, tree, radius),
        few,
        default,
        region_radius,
        float(largest),
    )


def _voting_scales(
    mesh: TriangleMesh, faces: Faces, normal: NDArray, scales: Scales, scheme: str, size: int, pairs: float
) -> Scales | None:
    """The same by averaged normals, at about `size` vertices, in balls of `pairs` members in all."""
    from scipy.spatial import cKDTree

    from ddgcli.algorithms.curvature.voting import normal_voting_at  # imports scipy.sparse

    area = float(faces.area.sum())
    tree = cKDTree(mesh.points, balanced_tree=False, compact_nodes=False)
    step = max(1, len(scales.vertices) // size)
    some, default = scales.vertices[::step], scales.default[::step]
    first = float(scales.radius[0]) / RADIUS_RATIO
    # each ball of the sample has balls around all its members
    density = mesh.n_vertices / area * np.pi
    affordable = (pairs / len(some)) ** 0.25 / np.sqrt(density)
    largest = min(
        np.sqrt(MAX_SURFACE_SHARE * area / np.pi), 0.99 * largest_radius(mesh, area, scheme), affordable
    )
    return measure_scales(
        lambda radius: normal_voting_at(faces, normal, some, tree, radius),
        some,
        default,
        first,
        float(largest),
    )


def _deviation(cubic: NDArray, quartic: NDArray) -> tuple[float, float, bool]:
    """Deviation of the vertices, ratio of the residuals, and whether a part of the surface has the noise.

    `cubic` and `quartic` are the residuals of fits of degree three and four over the sample.
    """
    both = np.isfinite(cubic) & np.isfinite(quartic)
    if not both.any():
        return float(np.nanmedian(cubic)), 1.0, False
    (middle, tail), (quartic_middle, quartic_tail) = (
        np.quantile(residuals[both], (0.5, PARTIAL_QUANTILE)) for residuals in (cubic, quartic)
    )
    if tail > MIN_PARTIAL_RATIO * middle and tail <= MIN_DETAIL_RATIO * quartic_tail:
        return float(tail), 1.0, True
    ratio = float(middle / quartic_middle) if quartic_middle > 0 else 1.0
    return float(np.nanmedian(cubic)), ratio, False


KINDS = {
    "voxels": "is a staircase of voxels",
    "rounded": "has rounded coordinates (noise of {:.2g} of an edge)",
    "grid": "comes from marching cubes of a coarse image (deviations of {:.2g} of an edge, slivers)",
    "spikes": "has spikes (noise of {:.2g} of an edge in a part of it)",
    "partial": "has noise of {:.2g} of an edge in a part of it",
    "rough": "has noise of {:.2g} of an edge",
    "noise": "has noise of {:.2g} of an edge",
}


def warn_of_noise(noise: Noise, scheme: str, mean: NDArray, scale: float) -> None:
    """Report the error at the default region, and the radius to use.

    Parameters
    ----------
    noise : Noise
        Whose kind is not empty.
    scheme : str
    mean : (n,) ndarray
        Mean curvature at the default region; its error is the mean difference to that in balls of the radius.
    scale : float
        Length unit of the input over that of `noise` and `mean`.
    """
    reference = noise.scales_of(noise.best_scheme)
    if reference is None or noise.relative is None:
        return
    measured = float(np.mean(np.abs(mean[reference.vertices] - reference.mean))) / reference.size
    # a scheme that measures in balls stays, unless the stairs or the noise suit the averaged normals better
    best = "normal-voting" if scheme == "normal-voting" else noise.best_scheme
    proposed = noise.scales_of(best) or reference
    cure = "use" if best == scheme else f"use `scheme={best}` with"
    logging.getLogger("ddgcli").warning(
        "the surface %s: at the default region the error of the mean curvature is about %.0f %%; "
        "%s `radius=%.3g` (or `radius=auto`), where it is about %.0f %%",
        KINDS[noise.kind].format(noise.relative),
        100 * float(np.hypot(measured, reference.error)),
        cure,
        noise.radius_of(best) * scale,
        100 * proposed.error,
    )


def _candidates(mesh: TriangleMesh, faces: Faces) -> NDArray[np.int64] | None:
    """Vertices to choose the sample from, in the order of the areas of their stars; None for all."""
    if mesh.n_vertices <= MAX_UNSAMPLED_VERTICES:
        return None
    vertices = np.flatnonzero(mesh.topology.referenced_vertex)
    order = np.argsort(faces.stars(faces.area[None])[0][vertices], kind="stable")
    return vertices[order[:: max(1, len(vertices) // (CANDIDATES_PER_SAMPLE * SAMPLE_SIZE))]]
