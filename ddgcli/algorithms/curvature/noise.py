"""Noise of a surface's vertices: its size, its effect on curvature, and the radius that averages it.

Residuals of fits over two rings show the deviation of the vertices, of whatever kind (`deviation`); creases
of both signs, coordinates on grids and curvature that settles with the radius distinguish noise from details.
The error of the default region and the radius come from balls around a sample of vertices (`scales`).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.deviation import Deviation, vertex_deviation
from ddgcli.algorithms.curvature.faces import Faces
from ddgcli.algorithms.curvature.grid_coordinates import on_grid_edges
from ddgcli.algorithms.curvature.point_grid import PointGrid
from ddgcli.algorithms.curvature.quadric import QUADRATIC_PENALTY, cross_validated_penalty
from ddgcli.algorithms.curvature.regions import Regions, largest_radius, listed
from ddgcli.algorithms.curvature.scales import (
    MAX_SURFACE_SHARE,
    QUADRATIC_BIAS_GROWTH,
    RADIUS_RATIO,
    VOTING_BIAS_GROWTH,
    Scales,
    fits_at,
    fits_in_balls,
    measure_scales,
    typical_size,
)
from ddgcli.algorithms.curvature.staircase import cancellation
from ddgcli.mesh.triangle_mesh import TriangleMesh

Effort = Literal["fits", "warn", "auto"]
FITTED_SCHEMES = ("quadric", "normal-voting")  # those of which `Scales` are measured

BENDING_SAMPLE_SIZE = 100  # vertices sampled for curvature
# residual of cubic fits over that of quartic ones: stairs that were averaged or cut have 1.2 to 1.7, details
# of six edges 1.8; smoothed segmentations have up to 2.2, and of details with less the default is 15 % off
MAX_ROUGH_DETAIL_RATIO, MAX_UNEVEN_DETAIL_RATIO = 1.75, 2.2
VOTING_SAMPLE_SIZE = 32  # vertices sampled for curvature by averaged normals
# members of all their balls: the stairs of large bodies need wide ones
MAX_VOTING_PAIRS, MAX_VOXEL_PAIRS = 3e6, 3.6e7
# creases of both signs within two rings: their sum over that of their sizes. Noise of more than a twentieth
# of an edge has 0.05 to 0.8, and less the larger it is; scans have 0.2 to 0.6, mechanical parts 0.4 to 0.9
MAX_CANCELLATION, MAX_ROUGH_CANCELLATION = 0.8, 0.28
MAX_CANCELLATION_OF_NOISE = 0.055  # times one over the noise in edges
# fall of the change of curvature when the radius doubles: creases have 2, stairs 3 to 10, noise 8
MIN_FALL = 2.5
# of the error at the default region over that at the best radius: wide steps, whose changes fall late, have
# 20 to 80, busts, noisy in places, 6 to 10
MIN_ROUGH_ERROR_RATIO = 15
MIN_MEDIAN_SHARE = 0.1  # median error of grids of voxels over the mean one, which creases of a part exceed
# at the best radius: terrain and scans with details of all sizes have more, 0.28 to 0.53, and creases that
# cancel to 0.15 to 0.24; where they cancel to less, up to the second limit
MAX_ROUGH_ERROR, MAX_CANCELLED_ERROR = 0.25, 0.5
MAX_CANCELLATION_OF_STEPS = 0.12
# smoothed stairs and noise over several edges: the error at the best radius over the larger curvature, that
# of the default region over it, and the median over the mean of the latter. Scans and modelled surfaces have
# errors of 0.15 to 0.9, smooth ones with a bias in balls ratios of 1.1 to 1.9, and details that two rings
# resolve errors of 0.13 and more
MAX_UNEVEN_ERROR, MIN_UNEVEN_ERROR_RATIO, MIN_UNEVEN_MEDIAN_SHARE = 0.12, 2.3, 0.4
# larger errors, of bodies with rims: the first change of the curvature over the second one. Stairs, also
# smoothed, and surface nets have 3.6 to 13, scans and modelled surfaces with errors below 0.2 have 1.2 to 2.7
MAX_STEEP_ERROR, MIN_STEEP_FALL = 0.18, 3.2
# stairs of cylinders and planes are alike along a line: five rows of two rings, which quartics fit exactly.
# Their residuals are 0.005 to 0.09 of an edge, those of smooth fine meshes of flat quadrangles less
MIN_RULED_FLAT_SHARE, MIN_RULED_RESIDUAL, MIN_RULED_FALL = 0.3, 0.004, 4.0
MAX_ERROR = 0.08  # of curvature, root mean square, by noise, above which the default region is unreliable
MAX_REMAINING_ERROR_SHARE = 0.75  # largest share of that error at the proposed radius
# at the best radius of voxels and rounded coordinates: parts of blocks, pleats and layers have more
MAX_LATTICE_ERROR = 0.5
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
        'partial' (in a part of the surface), 'rough' (structure of the size of an edge), 'uneven' (of several
        edges, as smoothed stairs have), 'noise', or '' for a surface whose residuals are creases or details.
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
        """Whether fits over the default region are unreliable and the proposed radius is clearly better."""
        best = self.scales_of(self.best_scheme)
        if not self.kind or best is None:
            return False
        return self._is_unreliable(best.default_rms, best.default_error, best)

    def default_error(self, mean: NDArray) -> float | None:
        """Mean error of the mean curvature (n,) at the default region, over its mean size; None if reliable.

        It is the difference to the curvature in balls of the best radius.
        """
        best = self.scales_of(self.best_scheme)
        if not self.kind or best is None:
            return None
        difference = np.abs(mean[best.vertices] - best.mean) / best.size
        error = float(np.hypot(difference.mean(), best.error))
        root_mean_square = float(np.sqrt(np.mean(difference**2)))
        return error if self._is_unreliable(root_mean_square, error, best) else None

    def _is_unreliable(self, root_mean_square: float, mean: float, best: Scales) -> bool:
        """Whether errors are large, and those at the best radius clearly less."""
        on_lattice = self.kind in ("voxels", "rounded")
        most = min(MAX_REMAINING_ERROR_SHARE * mean, MAX_LATTICE_ERROR if on_lattice else np.inf)
        return root_mean_square > MAX_ERROR and best.error < most

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

    def expected_error(self, scheme: str, mean: NDArray | None = None) -> float | None:
        """Mean error of the mean curvature in balls of the best radius, over its mean size.

        Measures such as normal cycles have a bias at any radius, as stairs have more area than the body:
        their error is the distance of their mean curvature (n,) to that of the best scheme.
        """
        scales, best = self.scales_of(scheme), self.scales_of(self.best_scheme)
        if scales is None or best is None:
            return None
        if mean is None or scheme in FITTED_SCHEMES:
            return scales.expected_error
        distance = float(np.abs(mean[best.vertices] - best.mean).mean()) / best.size
        return float(np.hypot(distance, best.expected_error))

    def radius_of(self, scheme: str) -> float:
        """Radius with the least error of a scheme, in length units."""
        scales = self.scales_of(scheme)
        return 0.0 if scales is None else scales.best_radius


def estimate_noise(
    mesh: TriangleMesh, faces: Faces, dihedral: NDArray, scheme: str, *, effort: Effort = "warn"
) -> Noise:
    """Estimate the noise of the vertices and its effect on the mean curvature.

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
        may take several times as long as the measurement.

    Returns
    -------
    Noise
    """
    deviation = vertex_deviation(mesh, faces, dihedral)
    if deviation is None:
        return Noise(None)
    kind, deviation, share = _kind(mesh, faces, dihedral, deviation)
    if not kind:
        return Noise(deviation.relative)
    few = np.arange(0, len(deviation.sample), max(1, len(deviation.sample) // BENDING_SAMPLE_SIZE))
    regions, normal = listed(deviation.regions, few), deviation.normal
    scales = _scales(mesh, faces, normal, regions, deviation.sample[few], scheme)
    if scales is None or not _settles(kind, deviation, share, scales, faces, regions):
        return Noise(deviation.relative)
    everywhere = scales.median_share > MIN_UNEVEN_MEDIAN_SHARE
    if kind == "ruled" or (kind == "partial" and deviation.doubtful and everywhere):
        kind = "uneven"  # smoothed stairs have large residuals in places, and errors everywhere
    noise = Noise(deviation.relative, kind, scales)
    if scales.default_rms < MAX_ERROR or effort == "fits":
        return noise
    pairs = MAX_VOXEL_PAIRS if kind == "voxels" and effort == "auto" else MAX_VOTING_PAIRS
    return replace(noise, voting=_voting_scales(mesh, faces, normal, scales, scheme, pairs))


def _kind(
    mesh: TriangleMesh, faces: Faces, dihedral: NDArray, deviation: Deviation
) -> tuple[str, Deviation, float]:
    """Kind of the noise as far as residuals and creases show it, '' where they are those of a surface.

    And the deviation of the regions that have it, and the share of their creases that do not cancel.
    """

    def share_of(of_regions: Deviation) -> float:
        noisy = listed(of_regions.regions, np.flatnonzero(of_regions.noisy))
        return cancellation(mesh, faces, dihedral, noisy)

    if deviation.kind not in ("noise", "partial"):
        return deviation.kind, deviation, 1.0
    if on_grid_edges(faces.points, faces.sorted_coordinates, faces.mean_length):
        return "grid", deviation, 1.0
    share, bent = share_of(deviation), deviation.of_bent
    kind = _kind_by_creases(deviation, share)
    if kind in ("", "uneven", "ruled") and bent is not None:
        bent_share = share_of(bent)
        if _kind_by_creases(bent, bent_share) == "rough":
            return "rough", bent, bent_share
    return kind, deviation, share


def _kind_by_creases(deviation: Deviation, share: float) -> str:
    """Kind by residuals of fits and the share of creases that do not cancel."""
    of_noise = min(MAX_CANCELLATION, MAX_CANCELLATION_OF_NOISE / max(deviation.relative, 1e-300))
    if deviation.kind == "partial":
        return "partial" if share <= of_noise or not deviation.doubtful else ""
    if not deviation.doubtful:
        return "noise" if share <= of_noise else ""
    if share <= MAX_ROUGH_CANCELLATION and deviation.detail_ratio <= MAX_ROUGH_DETAIL_RATIO:
        return "rough"
    if deviation.detail_ratio <= MAX_UNEVEN_DETAIL_RATIO:
        return "uneven"
    is_ruled = deviation.flat_share > MIN_RULED_FLAT_SHARE and deviation.relative > MIN_RULED_RESIDUAL
    return "ruled" if is_ruled else ""


def _settles(
    kind: str, deviation: Deviation, share: float, scales: Scales, faces: Faces, regions: Regions
) -> bool:
    """Whether the curvature settles with the radius, where the kind may also be creases or details."""
    ratio = scales.default_error / scales.error
    everywhere = scales.median_share > MIN_UNEVEN_MEDIAN_SHARE
    clear = scales.bending_error < MAX_UNEVEN_ERROR and ratio > MIN_UNEVEN_ERROR_RATIO
    least_fall = MIN_RULED_FALL if kind == "ruled" else MIN_STEEP_FALL
    steep = everywhere and scales.bending_error < MAX_STEEP_ERROR and scales.fall > least_fall
    if kind == "uneven":
        return clear and everywhere
    if kind == "ruled":
        return steep
    if kind == "rough" and (steep or (clear and everywhere)):
        return True
    if kind == "rough" and ratio > MIN_ROUGH_ERROR_RATIO:
        cancels = share <= MAX_CANCELLATION_OF_STEPS
        return scales.error <= (MAX_CANCELLED_ERROR if cancels else MAX_ROUGH_ERROR)
    if kind == "rough":
        return _falls_as_noise(faces, deviation.normal, regions, scales)
    if kind == "partial":
        settles = clear or steep or not deviation.doubtful
        return settles or _falls_as_noise(faces, deviation.normal, regions, scales)
    return kind != "grid" or scales.median_share >= MIN_MEDIAN_SHARE  # creases of a part


def _falls_as_noise(faces: Faces, normal: NDArray, regions: Regions, scales: Scales) -> bool:
    """Whether quadratic fits settle with the radius, as at creases and on terrain they do not."""
    if len(scales.change) < 3 or scales.error > MAX_ROUGH_ERROR:
        return False
    few = scales.vertices
    first = fits_at(faces.points, normal, few, normal[:, few], regions, QUADRATIC_PENALTY).mean
    return typical_size(first - scales.first_mean) > MIN_FALL * scales.change[2]


def _scales(
    mesh: TriangleMesh, faces: Faces, normal: NDArray, regions: Regions, few: NDArray, scheme: str
) -> Scales | None:
    """Mean curvature of a few vertices, over their regions and in balls."""
    area = float(faces.area.sum())
    vertex_area = area / int(mesh.topology.referenced_vertex.sum())
    region_radius = float(np.sqrt(vertex_area * np.median(regions.count) / np.pi))
    penalty = cross_validated_penalty(faces.points, normal, regions, few)
    default = fits_at(faces.points, normal, few, normal[:, few], regions, penalty).mean
    largest = min(np.sqrt(MAX_SURFACE_SHARE * area / np.pi), 0.99 * largest_radius(mesh, area, scheme))
    grid = PointGrid(faces.points)
    return measure_scales(
        lambda radius: fits_in_balls(faces.points, grid, normal, few, radius),
        few,
        default,
        region_radius,
        float(largest),
        QUADRATIC_BIAS_GROWTH,
    )


def _voting_scales(
    mesh: TriangleMesh, faces: Faces, normal: NDArray, scales: Scales, scheme: str, pairs: float
) -> Scales | None:
    """The same by averaged normals, at fewer vertices, in balls of `pairs` members in all."""
    from scipy.spatial import cKDTree

    from ddgcli.algorithms.curvature.voting import normal_voting_at  # imports scipy.sparse

    area = float(faces.area.sum())
    tree = cKDTree(mesh.points, balanced_tree=False, compact_nodes=False)
    step = max(1, len(scales.vertices) // VOTING_SAMPLE_SIZE)
    some, default = scales.vertices[::step], scales.default[::step]
    first = float(scales.radius[0]) / RADIUS_RATIO
    largest = min(np.sqrt(MAX_SURFACE_SHARE * area / np.pi), 0.99 * largest_radius(mesh, area, scheme))
    return measure_scales(
        lambda radius: normal_voting_at(faces, normal, some, tree, radius, pairs),
        some,
        default,
        first,
        float(largest),
        VOTING_BIAS_GROWTH,
        default_by_fits=False,
    )


KINDS = {
    "voxels": "is a staircase of voxels",
    "rounded": "has rounded coordinates (noise of {:.2g} of an edge)",
    "grid": "comes from marching cubes of a coarse image (deviations of {:.2g} of an edge, slivers)",
    "spikes": "has spikes (noise of {:.2g} of an edge in a part of it)",
    "partial": "has noise of {:.2g} of an edge in a part of it",
    "rough": "has noise of {:.2g} of an edge",
    "uneven": "is uneven by {:.2g} of an edge over several edges, as smoothed voxels are (or has details)",
    "noise": "has noise of {:.2g} of an edge",
}


def warn_of_noise(noise: Noise, scheme: str, mean: NDArray, scale: float) -> float | None:
    """Report the error at the default region, and the radius to use, where that region is unreliable.

    Parameters
    ----------
    noise : Noise
    scheme : str
    mean : (n,) ndarray
        Mean curvature at the default region; its error is the difference to that in balls of the best radius.
    scale : float
        Length unit of the input over that of `noise` and `mean`.

    Returns
    -------
    float or None
        The mean error over the mean size, where noise dominates; None elsewhere.
    """
    error = noise.default_error(mean)
    if error is None:
        return None
    # a scheme that measures in balls stays, unless the stairs or the noise suit the averaged normals better
    best = "normal-voting" if scheme == "normal-voting" else noise.best_scheme
    cure = "use" if best == scheme else f"use `scheme={best}` with"
    logging.getLogger("ddgcli").warning(
        "the surface %s: at the default region the error of the mean curvature is about %.0f %%; "
        "%s `radius=%.3g` (or `radius=auto`), where it is about %.0f %%",
        KINDS[noise.kind].format(noise.relative),
        100 * error,
        cure,
        noise.radius_of(best) * scale,
        100 * (noise.expected_error(best) or 0.0),
    )
    return error
