"""Estimate of the noise of a surface's vertices, and of the radius that averages it out.

Residuals of fits over two rings measure the deviation of the vertices (`deviation`); creases of both signs,
coordinates on grids, and curvature that converges with the radius distinguish noise from details
(`noise_kind`). The error of the default region and the best radius are estimated in balls around a sample of
vertices (`scales`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.deviation import MIN_SAMPLE, Deviation, vertex_deviation
from ddgcli.algorithms.curvature.fit_penalty import cross_validated_penalty
from ddgcli.algorithms.curvature.hidden_bias import hidden_bias
from ddgcli.algorithms.curvature.neighbours import neighbourhoods
from ddgcli.algorithms.curvature.noise import Noise, SizeGroup
from ddgcli.algorithms.curvature.noise_kind import (
    MIN_UNEVEN_MEDIAN_SHARE,
    may_err_evenly,
    noise_kind,
    settles,
)
from ddgcli.algorithms.curvature.point_grid import PointGrid
from ddgcli.algorithms.curvature.regions import Regions, largest_radius, listed, size_groups
from ddgcli.algorithms.curvature.sampled_fits import fits_at, fits_in_balls
from ddgcli.algorithms.curvature.scale_errors import RADIUS_RATIO
from ddgcli.algorithms.curvature.scales import (
    MAX_SCALES,
    MAX_SURFACE_SHARE,
    QUADRATIC_BIAS_GROWTH,
    VOTING_BIAS_GROWTH,
    Scales,
    apart_from,
    measure_scales,
    scale_radii,
)
from ddgcli.algorithms.curvature.voxel_lattice import repeats_with_voxels
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.triangle_mesh import TriangleMesh

Effort = Literal["fits", "warn", "auto"]

INDEPENDENT_KINDS = ("noise", "rounded")  # kinds of noise in which neighbours deviate independently

BENDING_SAMPLE_SIZE = 100  # vertices sampled for curvature
CONFIRMING_SAMPLE_SIZE = 400  # vertices that confirm the result if scans are near the thresholds
VOTING_SAMPLE_SIZE = 32  # vertices sampled for curvature by averaged normals
# largest total number of vertices in their balls, in general and on voxels, whose stairs need wide balls
MAX_VOTING_PAIRS, MAX_VOXEL_PAIRS = 3e6, 3.6e7


def estimate_noise(
    mesh: TriangleMesh,
    faces: Faces,
    dihedral: NDArray,
    scheme: str,
    *,
    effort: Effort = "warn",
    steps: NDArray | None = None,
) -> Noise:
    """Estimate the noise of the vertices and its effect on the mean curvature.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Faces of the mesh.
    dihedral : (e,) ndarray
        Dihedral angles of the edges in radians, positive where convex.
    scheme : str
        Name of the curvature scheme, which limits the radius.
    effort : {'fits', 'warn', 'auto'}
        'fits' leaves out averaged normals, which cost more; 'auto' uses wide balls of them on voxels, which
        may take several times as long as the measurement.
    steps : (3, n) ndarray of float64, optional
        Steps to which the coordinates were rounded (`precision_steps`).

    Returns
    -------
    Noise
    """
    deviation = vertex_deviation(mesh, faces, dihedral, steps)
    if deviation is None:
        return Noise(None)
    kind, deviation = noise_kind(mesh, faces, dihedral, deviation)
    balls = _Balls(mesh, faces, deviation.normal, scheme, deviation.relative * faces.mean_length)
    scales = _settled_scales(balls, kind, deviation) if kind else None
    if scales is None and repeats_with_voxels(faces):
        kind, scales = "lattice", _settled_scales(balls, "lattice", deviation)
    if scales is None:
        return Noise(deviation.relative)
    everywhere = scales.median_share > MIN_UNEVEN_MEDIAN_SHARE
    if kind in ("ruled", "even") or (kind == "partial" and deviation.doubtful and everywhere):
        kind = "uneven"  # smoothed stairs have large residuals only in places, but errors everywhere
    noise = Noise(deviation.relative, kind, scales)
    if scales.default_rms < noise.max_error or effort == "fits":
        return noise
    pairs = MAX_VOXEL_PAIRS if kind == "voxels" and effort == "auto" else MAX_VOTING_PAIRS
    noise = replace(noise, voting=balls.voting_scales(scales, pairs, balls.extent()))
    if not noise.dominates_curvature:
        return noise
    groups = [balls.of_group(vertices, n, kind, pairs) for vertices, n in size_groups(mesh)]
    return replace(noise, groups=tuple(group for group in groups if group is not None))


def radii_of_search(mesh: TriangleMesh, faces: Faces, deviation: Deviation, scheme: str) -> list[float]:
    """Radii of the balls that a search for noise may fit, from the smallest to the widest.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Faces of the mesh.
    deviation : Deviation
    scheme : str

    Returns
    -------
    list of float
    """
    balls = _Balls(mesh, faces, deviation.normal, scheme, deviation.relative * faces.mean_length)
    extent = balls.extent()
    radii = scale_radii(extent.first_radius(deviation.regions), balls.largest_radius(extent), MAX_SCALES)
    return list(radii)


def _settled_scales(balls: _Balls, kind: str, deviation: Deviation) -> Scales | None:
    """Curvature in balls around some sampled vertices; None if it contradicts the kind of noise."""

    def scales_of(n_vertices: int, max_radii: int = MAX_SCALES) -> Scales | None:
        few = np.arange(0, len(deviation.sample), max(1, len(deviation.sample) // n_vertices))
        regions = listed(deviation.regions, few)
        return balls.scales(regions, deviation.sample[few], balls.extent(), kind, max_radii)

    if kind == "even":
        scales = scales_of(BENDING_SAMPLE_SIZE, 2)
        if scales is None or not may_err_evenly(scales):
            return None  # two radii suffice to recognise most details
    scales = scales_of(BENDING_SAMPLE_SIZE)
    if scales is None or not settles(kind, deviation, scales):
        return None
    if kind == "uneven":  # scans pass with one sample in ten, so a larger sample must confirm it
        scales = scales_of(CONFIRMING_SAMPLE_SIZE)
    return None if scales is None or not settles(kind, deviation, scales) else scales


@dataclass(frozen=True)
class _Extent:
    """Area per vertex and per component, and share of the vertices, for some or all components."""

    vertex_area: float
    area: float
    share: float

    def first_radius(self, regions: Regions) -> float:
        """Radius of a disk with the area of the median region."""
        return float(np.sqrt(self.vertex_area * np.median(regions.count) / np.pi))


@dataclass(frozen=True, eq=False)
class _Balls:
    """Fits in balls around some vertices of a surface, with the radii that a scheme can measure in.

    `normal` (3, n) are area-weighted vertex normals; `deviation` is that of the vertices, in length units.
    """

    mesh: TriangleMesh
    faces: Faces
    normal: NDArray[np.float64]
    scheme: str
    deviation: float

    def extent(self, vertices: NDArray | None = None, n_components: int = 1) -> _Extent:
        """Extent of the components with these vertices; by default of all."""
        if vertices is None:
            area = float(self.faces.area.sum())
            return _Extent(area / int(self.mesh.topology.referenced_vertex.sum()), area, 1.0)
        inside = np.zeros(self.mesh.n_vertices, dtype=bool)
        inside[vertices] = True
        area = float(self.faces.area[inside[self.faces.corner[0]]].sum())
        return _Extent(area / len(vertices), area / n_components, len(vertices) / self.mesh.n_vertices)

    def largest_radius(self, extent: _Extent) -> float:
        """Largest radius at which balls contain only a part of a component, and the scheme takes minutes."""
        # balls contain more vertices where these are dense
        total = extent.vertex_area * self.mesh.n_vertices / extent.share
        most = 0.99 * largest_radius(self.mesh, total, self.scheme)
        return float(min(np.sqrt(MAX_SURFACE_SHARE * extent.area / np.pi), most))

    def scales(
        self, regions: Regions, few: NDArray, extent: _Extent, kind: str, max_radii: int = MAX_SCALES
    ) -> Scales | None:
        """Mean curvature of a few vertices by quadratic fits, over their regions and in balls."""
        points, normal, grid = self.faces.points, self.normal, PointGrid(self.faces.points)
        penalty = cross_validated_penalty(points, normal, regions, few)
        default = fits_at(points, normal, few, normal[:, few], regions, penalty).mean
        return measure_scales(
            lambda radius: fits_in_balls(self.faces, grid, normal, few, radius),
            few,
            default,
            extent.first_radius(regions),
            self.largest_radius(extent),
            QUADRATIC_BIAS_GROWTH,
            hidden_bias=partial(hidden_bias, independent=kind != "voxels"),
            noise=self.deviation * extent.vertex_area**0.5 if kind in INDEPENDENT_KINDS else np.inf,
            max_radii=max_radii,
        )

    def voting_scales(self, scales: Scales, pairs: float, extent: _Extent) -> Scales | None:
        """Mean curvature of fewer vertices by averaged normals; their balls have at most `pairs` vertices."""
        from scipy.spatial import cKDTree

        from ddgcli.algorithms.curvature.voting import normal_voting_at  # imports scipy.sparse

        tree = cKDTree(self.mesh.points, balanced_tree=False, compact_nodes=False)
        step = max(1, len(scales.vertices) // VOTING_SAMPLE_SIZE)
        some, default = scales.vertices[::step], scales.default[::step]
        voting = measure_scales(
            lambda radius: normal_voting_at(self.faces, self.normal, some, tree, radius, pairs),
            some,
            default,
            float(scales.radius[0]) / RADIUS_RATIO,
            self.largest_radius(extent),
            VOTING_BIAS_GROWTH,
            reference=scales.first_mean[::step],
            other=scales.mean[::step],
        )
        return None if voting is None else apart_from(voting, scales, step)

    def of_group(self, vertices: NDArray, n_components: int, kind: str, pairs: float) -> SizeGroup | None:
        """Curvature in balls around some vertices of components of similar size."""
        inner = vertices[~self.mesh.topology.boundary_vertex[vertices]]
        few = inner[:: max(1, len(inner) // BENDING_SAMPLE_SIZE)]
        if len(few) < MIN_SAMPLE:
            return None
        extent = self.extent(vertices, n_components)
        regions = neighbourhoods(self.mesh, self.faces, self.normal, few)
        scales = self.scales(regions, few, extent, kind)
        return (
            None if scales is None else SizeGroup(vertices, scales, self.voting_scales(scales, pairs, extent))
        )
