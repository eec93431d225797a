"""Curvature of a surface by one scheme: arrays, integrals, residuals of exact identities."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature import totals
from ddgcli.algorithms.curvature.coarse_faces import warn_of_coarse_faces
from ddgcli.algorithms.curvature.curvature_results import (
    cheap_integrals,
    curvature_arrays,
    edge_arrays,
    further_integrals,
    identity_residuals,
    statistics,
    vertex_arrays,
)
from ddgcli.algorithms.curvature.deviation import vertex_deviation
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures, area_normals, unit_normals
from ddgcli.algorithms.curvature.noise import (
    FITTED_SCHEMES,
    Noise,
    warn_of_better_scheme,
    warn_of_details,
    warn_of_noise,
)
from ddgcli.algorithms.curvature.noise_estimate import Effort, estimate_noise
from ddgcli.algorithms.curvature.one_sided import of_copies, unsigned_normals
from ddgcli.algorithms.curvature.quadric import quadric
from ddgcli.algorithms.curvature.regions import check_radius, check_reach, warn_of_short_radius
from ddgcli.algorithms.curvature.spikes import warn_of_spikes
from ddgcli.algorithms.curvature.star import corrected, cotan, normal_cycle
from ddgcli.algorithms.curvature.unit_surface import (
    TWO_SIDED_SCHEMES,
    UnitSurface,
    one_sided_error,
    prepare_surface,
)
from ddgcli.choices import CURVATURE_SCHEMES
from ddgcli.errors import ParameterError
from ddgcli.geometry.intrinsic import face_area
from ddgcli.linalg.residual_gate import within_residuals
from ddgcli.mesh.fields import checked_values
from ddgcli.mesh.remedies import remedy
from ddgcli.mesh.require import require, surely_has_area
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.workers import start_early

DEFAULT_SCHEME = "quadric"
LEAST_RADIUS = 1e-100  # of balls, in longest edges: cubes of smaller ones leave the floating-point range
CURVATURE_ARRAYS = ("gaussian_curvature", "mean_curvature")
VERTEX_ARRAYS = (
    "angle_defect", "vertex_area", "boundary", "gaussian_curvature", "geodesic_curvature", "mean_curvature",
    "mean_curvature_normal", "principal_curvature_min", "principal_curvature_max", "principal_direction_min",
    "principal_direction_max", "combinatorial_curvature",
)  # fmt: skip
DEFAULT_REGIONS = {  # measured around each vertex
    "quadric": "two rings",
    "corrected": "star",
    "normal-cycle": "star",
    "normal-voting": "two rings",
    "cotan": "star",
}
SCHEME_PROMISES = {
    "quadric": "converges pointwise on any sampling of a smooth surface, irregular and anisotropic ones too; "
    "noise and creases show as they are unless the radius is large",
    "corrected": "exact on meshes inscribed in spheres; at the star some per cent off elsewhere on "
    "irregular meshes, converging in balls whose radius shrinks more slowly than the edges",
    "normal-cycle": "its integrals converge; at the star its pointwise values do not on irregular meshes, "
    "in balls whose radius shrinks more slowly than the edges they do",
    "normal-voting": "the least error on voxels and noise, in balls of three edges or more; without a radius "
    "and within a radius of the boundary it is rough",
    "cotan": "its integrals are exact for the polyhedron; pointwise values converge on regular meshes only "
    "and stay about a third off on irregular ones",
}


@dataclass(frozen=True, eq=False)
class CurvatureResult:
    """Arrays on vertices and edges by name, the results and the accuracy of the summary.

    `converged` is False where an identity is violated by more than `residual_gate.LARGEST_RESIDUAL`.
    """

    vertex: dict[str, NDArray]
    edge: dict[str, NDArray]
    results: dict[str, Any]
    accuracy: dict[str, Any]
    converged: bool = True


def measure_curvature(
    mesh: TriangleMesh,
    scheme: str = DEFAULT_SCHEME,
    radius: float | Literal["auto"] | None = None,
    *,
    image: NDArray | None = None,
    jobs: int = 1,
    full: bool = True,
    energies: bool | None = None,
) -> CurvatureResult:
    """Measure the curvature of a surface by one scheme.

    Parameters
    ----------
    mesh : TriangleMesh
        Any surface with area. Warnings report what defects of the mesh do to the numbers.
    scheme : {'quadric', 'corrected', 'normal-cycle', 'normal-voting', 'cotan'}
    radius : float, optional
        Radius of the balls, in length units; default: the vertex star (two rings for 'quadric'). 'auto'
        takes the radius of `estimate_noise` where the run without a radius warns of noise, and the default
        elsewhere.
    image : (n, 2) or (n, 3) ndarray, optional
        A map whose non-conformality is to be measured.
    jobs : int
        Processes of the fits of 'quadric' and of balls; the result does not depend on it.
    full : bool
        False: only the pointwise mean and Gaussian curvature, the chief integrals and all residuals, without
        directions, arrays on edges and further statistics.
    energies : bool, optional
        Willmore energies, intrinsic volumes and Steiner's polynomial, vector area and the other results that
        are sums over the surface; as `full` by default.

    Returns
    -------
    CurvatureResult

    Raises
    ------
    MeshError
        No face, no area, coordinates whose squares leave double precision, or a one-sided surface with a
        scheme that needs orientation.
    ParameterError
        Unknown scheme; a radius for 'cotan'.
    """
    check_curvature(mesh, scheme, radius, image=image)
    start_early(jobs, [*JOB_MODULES[scheme], *(["scipy.spatial"] if radius is not None else [])])
    surface = prepare_surface(mesh, scheme)
    measured = _measured(mesh, surface, scheme, radius, jobs, full)
    principal = measured.principal
    if surface.copy is not None:
        principal = of_copies(principal, surface.copy, mesh.topology.referenced_vertex)
    vertex = vertex_arrays(surface, principal) if full else curvature_arrays(surface, principal)
    edge = edge_arrays(surface) if full else {}
    results: dict[str, Any] = {"scheme": scheme, "promise": SCHEME_PROMISES[scheme]}
    results |= measured.region(scheme, surface.scale)
    results |= cheap_integrals(surface, principal)
    if full if energies is None else energies:
        results |= further_integrals(surface, results)
    if image is not None:
        results |= totals.nonconformality(surface.faces, image)
    results |= statistics(vertex, edge, mesh)
    accuracy = identity_residuals(surface)
    advice = remedy("folds")
    advice = f"faces without area or folded onto others leave curvatures undetermined; {advice}"
    converged = within_residuals(accuracy, tuple(accuracy), advice)
    return CurvatureResult(vertex, edge, results, accuracy, converged)


_PACKAGE = "ddgcli.algorithms.curvature"
# that the processes of several jobs import
JOB_MODULES = {
    "quadric": (f"{_PACKAGE}.quadric",),
    "normal-voting": (f"{_PACKAGE}.vertex_balls",),
    "corrected": (f"{_PACKAGE}.ball",),
    "normal-cycle": (f"{_PACKAGE}.ball",),
    "cotan": (),
}


@dataclass(frozen=True, eq=False)
class _Measured:
    """Principal curvatures at unit size, and what they were measured in.

    `radius` is one for all vertices or (n,), at unit size, None of the default region.
    """

    principal: PrincipalCurvatures
    noise: Noise
    radius: float | NDArray | None = None
    expected_error: float | None = None

    def region(self, scheme: str, scale: float) -> dict[str, Any]:
        """Entries of the summary, at a length unit."""
        radius: float | None = None
        results: dict[str, Any] = {}
        if isinstance(self.radius, np.ndarray):  # of components that differ in size
            radii, vertices = np.unique(self.radius * scale, return_counts=True)
            results["radii"] = [
                {"radius": r, "vertices": n} for r, n in zip(radii.tolist(), vertices.tolist())
            ]
            radius = self.noise.radius_of(scheme) * scale
        elif self.radius is not None:
            radius = self.radius * scale
        region = DEFAULT_REGIONS[scheme] if radius is None else "ball"
        noise = {"noise_estimate": self.noise.relative, "expected_error": self.expected_error}
        return {"region": region, "radius": radius} | results | noise


def _measured(
    mesh: TriangleMesh,
    surface: UnitSurface,
    scheme: str,
    radius: float | Literal["auto"] | None,
    jobs: int,
    directions: bool,
) -> _Measured:
    """Curvature in balls of a radius, or of the best one, or over the default region; warnings of noise."""
    two_sided = surface.cover or surface  # where a sign has a meaning
    noise = _noise(two_sided, scheme, radius, one_sided=surface.cover is not None)

    def pointwise(in_ball: float | NDArray | None, noisy: bool) -> PrincipalCurvatures:
        return _pointwise(two_sided, scheme, in_ball, noisy, jobs, directions)

    if isinstance(radius, (int, float)):
        in_ball = radius / surface.scale
        principal = pointwise(in_ball, noise.dominates_curvature)
        warn_of_short_radius(mesh, radius, scheme, principal.in_rings)
        return _Measured(principal, noise, None if principal.in_rings else in_ball)
    if radius == "auto" and scheme != DEFAULT_SCHEME and noise.dominates_curvature:
        return _in_best_balls(mesh, surface, scheme, noise, pointwise)  # as the warning of 'quadric' proposes
    principal = pointwise(None, False)
    if radius == "auto":
        # the values of all vertices decide, as where no radius is stated: their fits may have another penalty
        # than those of the sample
        if noise.default_error(principal.mean) is None:
            return _Measured(principal, noise)
        return _in_best_balls(mesh, surface, scheme, noise, pointwise)
    expected_error = warn_of_noise(noise, scheme, principal.mean, surface.scale)
    if expected_error is None:
        warn_of_spikes(surface.mesh, surface.faces, surface.dihedral)
        if scheme == "quadric":
            warn_of_coarse_faces(surface.mesh, surface.faces, surface.dihedral)
    return _Measured(principal, noise, None, expected_error)


def _in_best_balls(
    mesh: TriangleMesh,
    surface: UnitSurface,
    scheme: str,
    noise: Noise,
    pointwise: Callable[[float | NDArray, bool], PrincipalCurvatures],
) -> _Measured:
    """Curvature in balls of the radii with the least error; warns of better schemes, and of details."""
    _check_radius(mesh, noise.radius_of(scheme) * surface.scale, scheme)
    in_ball = noise.radii_of(scheme, (surface.cover or surface).mesh.n_vertices)
    principal = pointwise(in_ball, True)
    warn_of_details(noise, scheme, surface.scale)
    expected_error = noise.expected_error(scheme, principal.mean)
    if expected_error is not None:
        warn_of_better_scheme(noise, scheme, expected_error)
    return _Measured(principal, noise, in_ball, expected_error)


@dataclass(frozen=True)
class ProposedBalls:
    """Scheme and balls of the least error, where noise dominates the curvature at the default region.

    Attributes
    ----------
    scheme, other_scheme : str
        The best one, and another to compare with.
    radius, other_radius : float or 'auto'
        Theirs, in length units; 'auto' where the components of the mesh need several.
    expected_error : float
        Mean error of the mean curvature over its mean size.
    kind : str
        As for `Noise`.
    """

    scheme: str
    radius: float | Literal["auto"]
    other_scheme: str
    other_radius: float | Literal["auto"]
    expected_error: float
    kind: str


def proposed_balls(mesh: TriangleMesh) -> ProposedBalls | None:
    """Scheme and radius that the warning of noise proposes; None where noise does not dominate.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    ProposedBalls or None
    """
    surface = prepare_surface(mesh, DEFAULT_SCHEME)
    noise = _noise(surface.cover or surface, DEFAULT_SCHEME, None, one_sided=surface.cover is not None)
    if not noise.dominates_curvature:
        return None

    def radius(scheme: str) -> float | Literal["auto"]:
        return "auto" if len(noise.groups) > 1 else noise.radius_of(scheme) * surface.scale

    best = noise.best_scheme
    other = next(scheme for scheme in FITTED_SCHEMES if scheme != best)
    error = noise.expected_error(best) or 0.0
    return ProposedBalls(best, radius(best), other, radius(other), error, noise.kind)


def check_curvature(
    mesh: TriangleMesh,
    scheme: str = DEFAULT_SCHEME,
    radius: float | str | None = None,
    *,
    image: NDArray | None = None,
) -> None:
    """Raise the errors of `measure_curvature`, before it measures.

    A radius of 'auto' may still be too large.

    Parameters
    ----------
    mesh : TriangleMesh
    scheme : str
    radius : float, 'auto' or None
    image : ndarray, optional
        As in `measure_curvature`.
    """
    _check_parameters(scheme, radius)
    require(mesh, "curvature")
    if scheme in TWO_SIDED_SCHEMES and not (mesh.topology.is_oriented or mesh.topology.is_orientable):
        raise one_sided_error(mesh, scheme)
    if not surely_has_area(mesh):
        prepare_surface(mesh, scheme)  # refuses a surface without area
    if image is not None:
        checked_values(image, mesh.n_vertices, "vertex", parameter="image", widths=(2, 3))
    if isinstance(radius, (int, float)):
        _check_radius(mesh, radius, scheme)
        check_reach(mesh, float(radius))


def _check_radius(mesh: TriangleMesh, radius: float, scheme: str) -> None:
    unit = float(mesh.side_length.max())  # no square over- or underflows
    if radius < LEAST_RADIUS * unit:
        raise ParameterError(
            f"balls of radius {radius:g} beside edges of {unit:.3g} leave the floating-point range; use "
            f"{LEAST_RADIUS * unit:.3g} or more",
            parameter="radius",
        )
    area = float(face_area(mesh.side_length / unit).sum())
    check_radius(mesh, area, radius / unit, unit, scheme)


def _check_parameters(scheme: str, radius: float | str | None) -> None:
    """ParameterError for an unknown scheme, or a radius that is not a length or not for the scheme."""
    if scheme not in CURVATURE_SCHEMES:
        raise ParameterError(f"{scheme!r} is not one of {', '.join(CURVATURE_SCHEMES)}", parameter="scheme")
    if radius is not None and scheme == "cotan":
        raise ParameterError(
            "`scheme=cotan` measures at the vertex star and takes no radius; use `scheme=normal-cycle`, "
            "`scheme=corrected` or `scheme=quadric`",
            parameter="radius",
        )
    if isinstance(radius, (int, float)) and not (math.isfinite(radius) and radius > 0):
        raise ParameterError(f"must be a positive length, not {radius}", parameter="radius")


def _noise(surface: UnitSurface, scheme: str, radius: float | str | None, *, one_sided: bool) -> Noise:
    """The noise as far as it matters: at a stated radius only the fits of 'quadric' depend on its effect.

    Balls of a double cover hold both of its sheets, which lie at one place: no effect of noise is measured.
    """
    mesh, faces, dihedral = surface.mesh, surface.faces, surface.dihedral
    stated = isinstance(radius, (int, float))
    if one_sided or (stated and scheme != "quadric"):
        deviation = vertex_deviation(mesh, faces, dihedral, surface.steps)
        return Noise(None if deviation is None else deviation.relative)
    wide = radius == "auto" and scheme == "normal-voting"
    effort: Effort = "fits" if stated else "auto" if wide else "warn"
    return estimate_noise(mesh, faces, dihedral, scheme, effort=effort, steps=surface.steps)


def _pointwise(
    surface: UnitSurface,
    scheme: str,
    radius: float | NDArray | None,
    noisy: bool,
    jobs: int,
    directions: bool,
) -> PrincipalCurvatures:
    """Principal curvatures by the scheme, at unit size."""
    mesh, faces, area, defect = surface.mesh, surface.faces, surface.area, surface.defect
    normals = area_normals if scheme == "quadric" else unit_normals
    normal = normals(faces) if surface.orientable else unsigned_normals(mesh, faces)
    if scheme == "cotan":
        principal = cotan(faces, mesh.topology, normal, area, defect, surface.vector, directions=directions)
    elif scheme == "normal-cycle" and isinstance(radius, float):
        from ddgcli.algorithms.curvature.ball import normal_cycle_in_balls  # imports scipy.sparse

        principal = normal_cycle_in_balls(mesh, normal, defect, surface.dihedral, radius, jobs=jobs)
    elif scheme == "normal-cycle":
        principal = normal_cycle(faces, mesh.topology.edges, normal, area, defect, surface.dihedral)
    elif scheme == "corrected" and isinstance(radius, float):
        from ddgcli.algorithms.curvature.ball import corrected_in_balls  # imports scipy.sparse

        principal = corrected_in_balls(mesh, faces, normal, radius, jobs=jobs)
    elif scheme == "corrected":
        principal = corrected(faces, normal)
    elif scheme == "normal-voting":
        from ddgcli.algorithms.curvature.voting import normal_voting  # imports scipy.sparse

        principal = normal_voting(mesh, faces, normal, radius, jobs=jobs)
    else:
        principal = quadric(mesh, faces, normal, radius, noisy=noisy, jobs=jobs)
    undefined = (area <= 0) | ~mesh.topology.referenced_vertex
    gaussian = np.where(undefined | mesh.topology.boundary_vertex, 0.0, principal.gaussian)
    low, high = (np.where(undefined, 0.0, k) for k in (principal.low, principal.high))
    return replace(principal, low=low, high=high, gaussian=gaussian)
