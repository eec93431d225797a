"""Noise of a surface's vertices: its size, its effect on curvature, and the radius that averages it.

Heights over tangent planes are z = surface + noise of standard deviation s. A quadratic fit in a disk of
radius R with one vertex per area A has a mean curvature whose standard deviation is
4 sqrt(3 A / pi) s / R^3 (from the variance of r^2 over the disk, R^4 / 12). Its bias is k (k R)^2 / 4 on a
sphere of curvature k and less on surfaces that bend in one direction; half of it is used throughout.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.faces import Faces
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures, area_normals
from ddgcli.algorithms.curvature.neighbours import neighbourhoods
from ddgcli.algorithms.curvature.quadric import (
    fit_forms,
    polynomial_residuals,
    principal_of_forms,
    sampled_regions,
)
from ddgcli.algorithms.curvature.regions import Regions, largest_radius, listed
from ddgcli.algorithms.curvature.staircase import is_staircase
from ddgcli.mesh.ragged import list_starts
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import unit_vectors as unit_rows

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

SAMPLE_SIZE, BENDING_SAMPLE_SIZE = 400, 100  # vertices sampled for residuals, and for curvature
MAX_UNSAMPLED_VERTICES = 6400  # up to which all vertices may be in the sample
CANDIDATES_PER_SAMPLE = (
    4  # vertices, by the areas of their stars, among which the sample is chosen on larger meshes
)
MIN_NEIGHBOURS = 15
QUADRATIC_PENALTY = 1e4  # penalty of the terms of degree three and four that leaves a quadratic fit
FLAT_ANGLE_TOLERANCE = (
    1e-3  # dihedral angle up to which two faces count as one plane (files of single precision)
)
MIN_CREASED_FLAT_SHARE = (
    0.1  # share of flat edges from which large residuals are creases of a part, not noise
)
# residual of cubic fits over that of quartic ones: noise has 0.98 to 1.08, as measured on spheres, tori and
# voxels; scanned and modelled surfaces with details of four to ten edges have 1.2 to 2.9
MIN_DETAIL_RATIO = 1.15
# noise in a part of the surface, or spikes: this quantile of the residuals is so many times their median
PARTIAL_QUANTILE, MIN_PARTIAL_RATIO = 0.9, 5
VOXEL_DEVIATION = 12**-0.5  # of heights within a voxel, in edges
MAX_ERROR = 0.1  # predicted error of curvature by noise above which the default region is unreliable
MAX_REMAINING_ERROR_SHARE = 0.85  # largest share of that error at the proposed radius
DEVIATION_FACTOR = 2  # on the theoretical deviation, for irregular samplings and fits of higher degree
BIAS_FACTOR = 0.125  # of a quadratic fit, in units of (k R)^2
MIN_MEAN_SHARE = 0.25  # of the larger principal curvature: what counts as size of the mean curvature
MAX_RELATIVE_RADIUS = 0.8  # largest radius, in radii of curvature


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of the vertices along the normals.

    Parameters
    ----------
    relative : float or None
        Standard deviation over the mean edge length; None where too few vertices have enough neighbours.
    stepped : bool
        Whether the surface is a staircase of voxels.
    creased : bool
        Whether it consists of planes with creases between, whose residuals are not noise.
    detailed : bool
        Whether fits of higher degree have smaller residuals: these are details of the surface, not noise.
    error, error_at_radius : float
        Predicted relative error of curvature: by noise at the default region, of any kind in balls of
        `radius`.
    radius : float
        Radius with the least predicted error, in length units.
    partial : bool
        Whether `relative` is that of a part of the surface, or of spikes.
    sample : (k,) ndarray of int
        Some vertices.
    mean : (k,) ndarray
        Their mean curvature in balls of `radius`, in 1/length.
    bend : float
        Median of their larger principal curvature there, in 1/length.
    """

    relative: float | None
    stepped: bool = False
    creased: bool = False
    error: float = 0.0
    error_at_radius: float = 0.0
    radius: float = 0.0
    detailed: bool = False
    partial: bool = False
    sample: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    mean: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    bend: float = 1.0

    @property
    def dominates_curvature(self) -> bool:
        """Whether the default region is unreliable and the proposed radius is clearly better."""
        gains = self.error > MAX_ERROR and self.error_at_radius < MAX_REMAINING_ERROR_SHARE * self.error
        return gains and not self.creased and not self.detailed


def estimate_noise(mesh: TriangleMesh, faces: Faces, dihedral: NDArray, scheme: str) -> Noise:
    """Estimate the noise of the vertices from residuals of cubic fits over two rings.

    Takes the median over a sample of vertices, which ignores creases, or a high quantile where that is far
    above the median and not due to details. The radius is one that the scheme can measure in.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : Faces
        Of the mesh.
    dihedral : (e,) ndarray
        Dihedral angles of the edges in radians, positive where convex.
    scheme : str
        Name of the scheme of curvature.
    """
    normal = area_normals(faces)
    vertices = _candidates(mesh, faces)
    regions = neighbourhoods(mesh, faces, normal, MIN_NEIGHBOURS, vertices)
    if vertices is None:
        vertices = np.arange(mesh.n_vertices)
    chosen = sampled_regions(faces.points, faces.points[:, vertices], regions, SAMPLE_SIZE)
    chosen = chosen[~mesh.topology.boundary_vertex[vertices[chosen]]]
    sample, regions = vertices[chosen], listed(regions, chosen)
    if len(sample) < MIN_NEIGHBOURS:
        return Noise(None)
    cubic, quartic = polynomial_residuals(faces.points, normal, regions, sample, (3, 4))
    edge = float(mesh.side_length.mean())
    deviation, detailed, partial = _deviation(cubic, quartic)
    stepped = is_staircase(mesh, faces, dihedral)
    flat = float((np.abs(dihedral) < FLAT_ANGLE_TOLERANCE).mean())
    creased, detailed = flat > MIN_CREASED_FLAT_SHARE and not stepped, detailed and not stepped
    if stepped:  # fits over two rings lie on a step; heights within a voxel are uniform
        deviation = max(deviation, VOXEL_DEVIATION * edge)
    if creased or detailed:
        return Noise(deviation / edge, stepped, creased, detailed=detailed)
    area = float(faces.area.sum())
    vertex_area = area / int(mesh.topology.referenced_vertex.sum())
    few = sample[:: max(1, len(sample) // BENDING_SAMPLE_SIZE)]
    lengths = (deviation, vertex_area, edge)
    radius, bend, mean = _fits_at_best_radius(mesh, normal, few, lengths, area, scheme)
    spread = float(np.sqrt(vertex_area * np.median(regions.count) / np.pi))
    return Noise(
        deviation / edge,
        stepped,
        error=noise_error(deviation, vertex_area, bend, spread),
        error_at_radius=float(
            np.hypot(noise_error(deviation, vertex_area, bend, radius), BIAS_FACTOR * (bend * radius) ** 2)
        ),
        radius=radius,
        partial=partial and not stepped,
        sample=few,
        mean=mean,
        bend=bend,
    )


def _deviation(cubic: NDArray, quartic: NDArray) -> tuple[float, bool, bool]:
    """Deviation of the vertices, whether details cause it, and whether it is that of a part of the surface.

    `cubic` and `quartic` are the residuals of fits of degree three and four over the sample.
    """
    both = np.isfinite(cubic) & np.isfinite(quartic)
    if not both.any():
        return float(np.nanmedian(cubic)), False, False
    (middle, tail), (quartic_middle, quartic_tail) = (
        np.quantile(residuals[both], (0.5, PARTIAL_QUANTILE)) for residuals in (cubic, quartic)
    )
    if tail > MIN_PARTIAL_RATIO * middle and tail <= MIN_DETAIL_RATIO * quartic_tail:
        return float(tail), False, True
    return float(np.nanmedian(cubic)), bool(middle > MIN_DETAIL_RATIO * quartic_middle), False


def warn_of_noise(noise: Noise, scheme: str, mean: NDArray, scale: float) -> None:
    """Report the error at the default region, and the radius to use.

    Parameters
    ----------
    noise : Noise
    scheme : str
    mean : (n,) ndarray
        Mean curvature at the default region; its error is the mean difference to that in balls of the radius.
    scale : float
        Length unit of the input over that of `noise` and `mean`.
    """
    size = max(float(np.mean(np.abs(noise.mean))), MIN_MEAN_SHARE * noise.bend)
    measured = float(np.mean(np.abs(mean[noise.sample] - noise.mean))) / size
    error = float(np.hypot(measured, noise.error_at_radius))
    place = " in a part of it" if noise.partial else ""
    kind = f"has noise of {noise.relative:.2g} of an edge{place}"
    if noise.stepped:
        kind = "is a staircase of voxels"
    cure = "use `scheme=quadric` with" if scheme == "cotan" else "use"
    if noise.stepped and scheme != "normal-voting":
        cure = "use `scheme=normal-voting` with"
    logging.getLogger("ddgcli").warning(
        "the surface %s: at the default region the error of the mean curvature is about %.0f %%; "
        "%s `radius=%.3g` (or `radius=auto`), where it is about %.0f %%",
        kind,
        100 * error,
        cure,
        noise.radius * scale,
        100 * noise.error_at_radius,
    )


def _candidates(mesh: TriangleMesh, faces: Faces) -> NDArray[np.int64] | None:
    """Vertices to choose the sample from, in the order of the areas of their stars; None for all."""
    if mesh.n_vertices <= MAX_UNSAMPLED_VERTICES:
        return None
    used = np.flatnonzero(mesh.topology.referenced_vertex)
    order = np.argsort(faces.stars(faces.area[None])[0][used], kind="stable")
    return used[order[:: max(1, len(used) // (CANDIDATES_PER_SAMPLE * SAMPLE_SIZE))]]


def _fits_at_best_radius(
    mesh: TriangleMesh,
    normal: NDArray,
    few: NDArray,
    lengths: tuple[float, float, float],
    area: float,
    scheme: str,
) -> tuple[float, float, NDArray[np.float64]]:
    """Radius of the least predicted error and the curvature there, each from the other, twice.

    The curvature is the median of the larger principal one; behind them the mean curvature at each vertex.
    """
    from scipy.spatial import cKDTree  # a sixth of a small run's time

    deviation, vertex_area, edge = lengths
    tree = cKDTree(mesh.points, balanced_tree=False, compact_nodes=False)
    bend, most = float(np.sqrt(4 * np.pi / area)), 0.99 * largest_radius(mesh, area, scheme)
    for _ in range(2):
        radius = min(best_radius(deviation, vertex_area, bend, edge), most)
        fits = _fits_in_balls(mesh, normal, few, tree, radius)
        larger = float(np.median(np.maximum(np.abs(fits.low), np.abs(fits.high))))
        bend = max(larger, 0.1 * bend)
    return radius, bend, fits.mean


def noise_error(deviation: float, vertex_area: float, bend: float, radius: float) -> float:
    """Relative standard deviation of the mean curvature of a quadratic fit in a disk."""
    return float(DEVIATION_FACTOR * 4 * np.sqrt(3 * vertex_area / np.pi) * deviation / (radius**3 * bend))


def best_radius(deviation: float, vertex_area: float, bend: float, edge: float) -> float:
    """Radius of the least predicted error, between two edges and 0.8 radii of curvature."""
    noise = noise_error(deviation, vertex_area, bend, 1.0)
    radius = (1.5 * (noise / (BIAS_FACTOR * bend**2)) ** 2) ** 0.1
    return float(max(min(radius, MAX_RELATIVE_RADIUS / bend), 2 * edge))


def _fits_in_balls(
    mesh: TriangleMesh, normal: NDArray, few: NDArray, tree: cKDTree, radius: float
) -> PrincipalCurvatures:
    """Principal curvatures of quadratic fits in the balls around a few vertices."""
    members = [np.sort(ball) for ball in tree.query_ball_point(mesh.points[few], radius)]
    start = list_starts([len(own) for own in members])
    member = np.concatenate(members).astype(np.int64)
    # the mean normal of the ball: single normals of noise and of voxels are far off
    around = np.take(normal, member, axis=1)
    same = np.einsum("ij,ij->j", around, np.repeat(normal[:, few], np.diff(start), axis=1)) > 0
    mean = unit_rows(np.add.reduceat(np.where(same, around, 0.0), start[:-1], axis=1).T).T
    columns = np.concatenate([mesh.points[few].T, mesh.points[member].T], axis=1)
    normals = np.concatenate([mean, around], axis=1)
    regions = Regions(start, len(few) + np.arange(len(member)))
    gradient, hessian = fit_forms(columns, normals, regions, QUADRATIC_PENALTY)
    k = slice(0, len(few))
    return principal_of_forms(gradient[:, k], hessian[:, k], normals[:, k])
