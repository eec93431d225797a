"""Curvature of a surface by one scheme: arrays, integrals, residuals of exact identities."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature import measures as exact
from ddgcli.algorithms.curvature import totals
from ddgcli.algorithms.curvature.deviation import vertex_deviation
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures, area_normals, unit_normals
from ddgcli.algorithms.curvature.noise import (
    Effort,
    Noise,
    estimate_noise,
    warn_of_better_scheme,
    warn_of_noise,
)
from ddgcli.algorithms.curvature.one_sided import of_copies, unsigned_normals
from ddgcli.algorithms.curvature.quadric import quadric
from ddgcli.algorithms.curvature.regions import check_radius, check_reach
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
from ddgcli.mesh.cures import cure
from ddgcli.mesh.require import require, surely_has_area
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import ratio

_log = logging.getLogger("ddgcli")

DEFAULT_SCHEME = "quadric"
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
) -> CurvatureResult:
    """Measure the curvature of a surface by one scheme.

    Parameters
    ----------
    mesh : TriangleMesh
        Any surface with area. Warnings report what defects of the mesh do to the numbers.
    scheme : {'quadric', 'corrected', 'normal-cycle', 'normal-voting', 'cotan'}
    radius : float, optional
        Of the ball to measure in, in length units; default the vertex star (two rings for 'quadric'). 'auto'
        takes the radius of `estimate_noise` where noise dominates at the default, and the default elsewhere.
    image : (n, 2) or (n, 3) ndarray, optional
        A map whose non-conformality is to be measured.
    jobs : int
        Threads of the fits of 'quadric'; the result does not depend on it.
    full : bool
        False: only the pointwise mean and Gaussian curvature, the chief integrals and all residuals, without
        directions, energies, arrays on edges and further statistics.

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
    surface = prepare_surface(mesh, scheme)
    measured = surface.cover or surface  # with two sides, where a sign has a meaning
    noise = _noise(measured, scheme, radius, one_sided=surface.cover is not None)
    at_default, automatic = radius is None, radius == "auto"
    noisy, principal, expected_error = noise.dominates_curvature, None, None
    if radius == "auto":
        if noise.kind and not noisy:  # by the sample; the fits of all vertices may have another penalty
            principal = _pointwise(measured, scheme, None, False, jobs, full)
            noisy = noise.default_error(principal.mean) is not None
        radius = noise.radius_of(scheme) * surface.scale if noisy else None
        _check_radius(mesh, radius, scheme)
    in_ball: float | NDArray | None = None if radius is None else radius / surface.scale
    if automatic and noisy:
        in_ball = noise.radii_of(scheme, measured.mesh.n_vertices)
    if principal is None or in_ball is not None:
        principal = _pointwise(measured, scheme, in_ball, noisy, jobs, full)
    if automatic and noisy:
        expected_error = noise.expected_error(scheme, principal.mean)
        if expected_error is not None:
            warn_of_better_scheme(noise, scheme, expected_error)
    if at_default:
        expected_error = warn_of_noise(noise, scheme, principal.mean, surface.scale)
        if expected_error is None:
            warn_of_spikes(surface.mesh, surface.faces, surface.dihedral)
    if surface.copy is not None:
        principal = of_copies(principal, surface.copy, mesh.topology.referenced_vertex)
    vertex = _vertex_arrays(surface, principal) if full else _curvature_arrays(surface, principal)
    edge = _edge_arrays(surface) if full else {}
    results: dict[str, Any] = {"scheme": scheme, "promise": SCHEME_PROMISES[scheme]}
    results |= {"region": DEFAULT_REGIONS[scheme] if radius is None else "ball", "radius": radius}
    if isinstance(in_ball, np.ndarray):  # of components that differ in size
        radii, vertices = np.unique(in_ball * surface.scale, return_counts=True)
        results["radii"] = [{"radius": r, "vertices": n} for r, n in zip(radii.tolist(), vertices.tolist())]
    results |= {"noise_estimate": noise.relative, "expected_error": expected_error}
    results |= _integrals(surface, principal)
    if full:
        results |= _further_integrals(surface, results)
    if image is not None:
        results |= totals.nonconformality(surface.faces, image)
    results |= _statistics(vertex, edge, mesh)
    accuracy = _accuracy(surface)
    remedy = cure("folds")
    advice = f"faces without area or folded onto others leave curvatures undetermined; {remedy}"
    converged = within_residuals(accuracy, tuple(accuracy), advice)
    return CurvatureResult(vertex, edge, results, accuracy, converged)


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
        _check_image(mesh, image)
    if isinstance(radius, (int, float)):
        _check_radius(mesh, radius, scheme)
        check_reach(mesh, float(radius))


def _check_radius(mesh: TriangleMesh, radius: float | None, scheme: str) -> None:
    if radius is not None:
        unit = float(mesh.side_length.max())  # no square over- or underflows
        area = float(face_area(mesh.side_length / unit).sum())
        check_radius(mesh, area, radius / unit, unit, scheme)


def _check_parameters(scheme: str, radius: float | str | None) -> None:
    """ParameterError for an unknown scheme, or a radius that is no length or not for the scheme."""
    if scheme not in CURVATURE_SCHEMES:
        raise ParameterError(f"{scheme!r} is not one of {', '.join(CURVATURE_SCHEMES)}", parameter="scheme")
    if radius is not None and scheme == "cotan":
        raise ParameterError(
            "`scheme=cotan` measures at the vertex star and takes no radius; use `scheme=normal-cycle`, "
            "`scheme=corrected` or `scheme=quadric`",
            parameter="radius",
        )
    if isinstance(radius, (int, float)) and not (math.isfinite(radius) and radius > 0):
        raise ParameterError(f"the radius must be a positive length, not {radius}")


def _noise(surface: UnitSurface, scheme: str, radius: float | str | None, *, one_sided: bool) -> Noise:
    """The noise as far as it matters: at a stated radius only the fits of 'quadric' depend on its effect.

    Balls of a double cover hold both of its sheets, which lie at one place: no effect of noise is measured.
    """
    mesh, faces, dihedral = surface.mesh, surface.faces, surface.dihedral
    stated = isinstance(radius, (int, float))
    if one_sided or (stated and scheme != "quadric"):
        deviation = vertex_deviation(mesh, faces, dihedral)
        return Noise(None if deviation is None else deviation.relative)
    wide = radius == "auto" and scheme == "normal-voting"
    effort: Effort = "fits" if stated else "auto" if wide else "warn"
    return estimate_noise(mesh, faces, dihedral, scheme, effort=effort)


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

        principal = normal_cycle_in_balls(mesh, normal, defect, surface.dihedral, radius)
    elif scheme == "normal-cycle":
        principal = normal_cycle(faces, mesh.topology.edges, normal, area, defect, surface.dihedral)
    elif scheme == "corrected" and isinstance(radius, float):
        from ddgcli.algorithms.curvature.ball import corrected_in_balls  # imports scipy.sparse

        principal = corrected_in_balls(mesh, faces, normal, radius)
    elif scheme == "corrected":
        principal = corrected(faces, normal)
    elif scheme == "normal-voting":
        from ddgcli.algorithms.curvature.voting import normal_voting  # imports scipy.sparse

        principal = normal_voting(mesh, faces, normal, radius)
    else:
        principal = quadric(mesh, faces, normal, radius, noisy=noisy, jobs=jobs)
    undefined = (area <= 0) | ~mesh.topology.referenced_vertex
    gaussian = np.where(undefined | mesh.topology.boundary_vertex, 0.0, principal.gaussian)
    low, high = (np.where(undefined, 0.0, k) for k in (principal.low, principal.high))
    return replace(principal, low=low, high=high, gaussian=gaussian)


def _curvature_arrays(surface: UnitSurface, principal: PrincipalCurvatures) -> dict[str, NDArray]:
    s = surface.scale
    return {"gaussian_curvature": principal.gaussian / (s * s), "mean_curvature": principal.mean / s}


def _vertex_arrays(surface: UnitSurface, principal: PrincipalCurvatures) -> dict[str, NDArray]:
    mesh, s = surface.mesh, surface.scale
    curvature = _curvature_arrays(surface, principal)
    return {  # by the names of VERTEX_ARRAYS
        "angle_defect": surface.defect,
        "vertex_area": surface.area * s * s,
        "boundary": mesh.topology.boundary_vertex.astype(np.uint8),
        "gaussian_curvature": curvature["gaussian_curvature"],
        "geodesic_curvature": exact.geodesic_curvature(mesh, surface.defect) / s,
        "mean_curvature": curvature["mean_curvature"],
        "mean_curvature_normal": np.ascontiguousarray((ratio(surface.vector, surface.area) / s).T),
        "principal_curvature_min": principal.low / s,
        "principal_curvature_max": principal.high / s,
        "principal_direction_min": np.ascontiguousarray(principal.low_direction.T),
        "principal_direction_max": np.ascontiguousarray(principal.high_direction.T),
        "combinatorial_curvature": exact.combinatorial_curvature(mesh),
    }


def _edge_arrays(surface: UnitSurface) -> dict[str, NDArray]:
    topology = surface.mesh.topology
    return {
        "edges": topology.edges,
        "dihedral_angle": surface.dihedral,
        "edge_mean_curvature": 0.5 * surface.scale * surface.edge_length * surface.dihedral,
    }


def _integrals(surface: UnitSurface, principal: PrincipalCurvatures) -> dict[str, Any]:
    """Integrals that cost little beside the curvature."""
    topology, s = surface.mesh.topology, surface.scale
    mean = float((0.5 * surface.edge_length * surface.dihedral).sum()) * s if surface.orientable else None
    boundary = topology.boundary_vertex
    return {
        "area": float(surface.faces.area.sum()) * s * s,
        "volume": None if surface.volume is None else surface.volume * s * s * s,  # or inf
        "total_gaussian_curvature": float(surface.defect[~boundary].sum()),
        "total_geodesic_curvature": float(surface.defect[boundary].sum()),
        "total_mean_curvature": mean,
        "willmore_energy": float((principal.mean**2 * surface.area).sum()),
    }


def _further_integrals(surface: UnitSurface, integrals: dict[str, Any]) -> dict[str, Any]:
    """Energies and volumes besides `integrals`, those of `_integrals`."""
    from ddgcli.algorithms.delaunay.triangulation import non_delaunay_edges  # for these alone

    mesh, faces, s = surface.mesh, surface.faces, surface.scale
    topology = mesh.topology
    energies = totals.willmore_energies(
        faces,
        topology,
        surface.dihedral,
        surface.edge_length,
        surface.area,
        surface.vector,
        surface.defect,
        surface.area_vector,
    )
    skewed = int(non_delaunay_edges(mesh).sum())
    if skewed:
        _log.info("%d edges are not Delaunay: circle-angle counts each as bending, flat ones too", skewed)
    unknown = [name for name, energy in energies.items() if energy is None]
    if unknown:
        _log.warning(
            "no Willmore energy %s: points coincide, the surface folds back, or it is one-sided and not "
            "manifold",
            " and ".join(unknown),
        )
    mean, area, volume = (integrals[name] for name in ("total_mean_curvature", "area", "volume"))
    volumes = totals.intrinsic_volumes(topology.euler_characteristic, mean, area, volume)
    two_sided_closed = surface.volume is not None
    return {
        "total_combinatorial_curvature": float(exact.combinatorial_curvature(mesh).sum()),
        "willmore_energies": energies,
        "non_delaunay_edges": skewed,
        "vector_area": totals.vector_area(faces) * s * s if surface.orientable else None,
        "intrinsic_volumes": volumes if two_sided_closed else [*volumes[:3], None],
        "steiner_polynomial": totals.steiner_polynomial(volumes) if two_sided_closed else None,
    }


def _statistics(
    vertex: dict[str, NDArray], edge: dict[str, NDArray], mesh: TriangleMesh
) -> dict[str, dict[str, float]]:
    """Least, greatest and mean value of each array; of vectors, of their length.

    Vertices that no face uses are left out; pointwise curvatures leave out the boundary too, and the
    geodesic curvature everything else.
    """
    referenced = mesh.topology.referenced_vertex
    inside = referenced & ~mesh.topology.boundary_vertex
    everywhere = {"angle_defect", "vertex_area", "combinatorial_curvature"}
    statistics = {}
    for name, values in vertex.items():
        if name == "boundary" or name.startswith("principal_direction"):
            continue
        if values.ndim == 2:
            values = np.sqrt(np.einsum("ij,ij->i", values, values))
        where = referenced if name in everywhere else inside
        if name == "geodesic_curvature":
            where = mesh.topology.boundary_vertex
        if where.any():
            statistics[name] = _range(values[where])
    between_two = mesh.topology.edge_face_count == 2
    for name, values in edge.items():
        if name != "edges" and between_two.any():
            statistics[name] = _range(values[between_two])
    return statistics


def _range(values: NDArray) -> dict[str, float]:
    return {"min": float(values.min()), "max": float(values.max()), "mean": float(values.mean())}


def _check_image(mesh: TriangleMesh, image: NDArray) -> None:
    """Raise ParameterError for an array that is no map of the vertices."""
    if image.ndim != 2 or image.shape[1] not in (2, 3) or len(image) != mesh.n_vertices:
        raise ParameterError(
            f"an array of shape {image.shape}; a map gives each vertex 2 or 3 coordinates", parameter="map"
        )
    if not np.isfinite(image).all():
        bad = np.flatnonzero(~np.isfinite(image).all(axis=1))[0]
        raise ParameterError(f"the map is not finite at vertex {bad}; correct the array", parameter="map")


def _accuracy(surface: UnitSurface) -> dict[str, float | None]:
    """Residuals of identities that hold on the polyhedron up to rounding."""
    mesh, faces, defect = surface.mesh, surface.faces, surface.defect
    topology = mesh.topology
    expected = exact.gauss_bonnet_total(mesh)
    size = max(float(np.abs(defect).sum()), 2 * np.pi)  # all defects of a cylinder are rounding
    residuals: dict[str, float | None] = {
        "gauss_bonnet_residual": abs(float(defect.sum()) - expected) / size,
        "vertex_area_residual": abs(float(surface.area.sum() / faces.area.sum()) - 1.0),
    }
    if not surface.orientable or not topology.is_manifold:
        return residuals | {"force_balance_residual": None}
    at_vertex = exact.BALANCE_DIRECTION @ faces.points
    height = sum(np.take(at_vertex, corner) for corner in faces.corner)
    balance = totals.balances(faces, topology, surface.normal, surface.dihedral, height > np.median(height))
    inside = topology.referenced_vertex & ~topology.boundary_vertex
    of_stars = totals.star_balance(surface.vector, surface.link_conormal, surface.link_length, inside)
    return residuals | {
        "force_balance_residual": max(of_stars, balance["force"]),
        "torque_balance_residual": balance["torque"],
        "area_balance_residual": balance["area"],
    }
