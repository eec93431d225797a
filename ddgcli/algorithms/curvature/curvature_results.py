"""Arrays, integrals and residuals of a measured surface, in the length unit of the input."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature import measures as exact
from ddgcli.algorithms.curvature import totals
from ddgcli.algorithms.curvature.balance import star_balance
from ddgcli.algorithms.curvature.frames import PrincipalCurvatures
from ddgcli.algorithms.curvature.unit_surface import UnitSurface
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import ratio, row_dot

_log = logging.getLogger("ddgcli")


def curvature_arrays(surface: UnitSurface, principal: PrincipalCurvatures) -> dict[str, NDArray]:
    """Gaussian and mean curvature of the vertices.

    Parameters
    ----------
    surface : UnitSurface
    principal : PrincipalCurvatures
        At unit size.

    Returns
    -------
    dict of str to (n,) ndarray
    """
    s = surface.scale
    return {"gaussian_curvature": principal.gaussian / (s * s), "mean_curvature": principal.mean / s}


def vertex_arrays(surface: UnitSurface, principal: PrincipalCurvatures) -> dict[str, NDArray]:
    """All arrays on vertices, by the names of `VERTEX_ARRAYS`.

    Parameters
    ----------
    surface : UnitSurface
    principal : PrincipalCurvatures
        At unit size.

    Returns
    -------
    dict of str to ndarray
    """
    mesh, s = surface.mesh, surface.scale
    curvature = curvature_arrays(surface, principal)
    return {
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


def edge_arrays(surface: UnitSurface) -> dict[str, NDArray]:
    """Ends, dihedral angles (radians) and integrated mean curvature of the edges.

    Parameters
    ----------
    surface : UnitSurface

    Returns
    -------
    dict of str to ndarray
    """
    topology = surface.mesh.topology
    return {
        "edges": topology.edges,
        "dihedral_angle": surface.dihedral,
        "edge_mean_curvature": 0.5 * surface.scale * surface.edge_length * surface.dihedral,
    }


def cheap_integrals(surface: UnitSurface, principal: PrincipalCurvatures) -> dict[str, Any]:
    """Integrals that cost little beside the curvature.

    Parameters
    ----------
    surface : UnitSurface
    principal : PrincipalCurvatures
        At unit size.

    Returns
    -------
    dict of str to float or None
        In the length unit of the input.
    """
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


def further_integrals(surface: UnitSurface, integrals: dict[str, Any]) -> dict[str, Any]:
    """Energies and volumes besides those of `cheap_integrals`.

    Parameters
    ----------
    surface : UnitSurface
    integrals : dict
        As returned by `cheap_integrals`.

    Returns
    -------
    dict
        In the length unit of the input.
    """
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


def statistics(
    vertex: dict[str, NDArray], edge: dict[str, NDArray], mesh: TriangleMesh
) -> dict[str, dict[str, float]]:
    """Least, greatest and mean value of each array; of vectors, of their length.

    Vertices that no face uses are left out; pointwise curvatures leave out the boundary too, and the
    geodesic curvature everything else.

    Parameters
    ----------
    vertex, edge : dict of str to ndarray
        Arrays by name.
    mesh : TriangleMesh

    Returns
    -------
    dict of str to dict
        `min`, `max` and `mean` by name.
    """
    referenced = mesh.topology.referenced_vertex
    inside = referenced & ~mesh.topology.boundary_vertex
    everywhere = {"angle_defect", "vertex_area", "combinatorial_curvature"}
    ranges = {}
    for name, values in vertex.items():
        if name == "boundary" or name.startswith("principal_direction"):
            continue
        if values.ndim == 2:
            values = np.sqrt(row_dot(values, values))
        where = referenced if name in everywhere else inside
        if name == "geodesic_curvature":
            where = mesh.topology.boundary_vertex
        if where.any():
            ranges[name] = _range(values[where])
    between_two = mesh.topology.edge_face_count == 2
    for name, values in edge.items():
        if name != "edges" and between_two.any():
            ranges[name] = _range(values[between_two])
    return ranges


def _range(values: NDArray) -> dict[str, float]:
    return {"min": float(values.min()), "max": float(values.max()), "mean": float(values.mean())}


def identity_residuals(surface: UnitSurface) -> dict[str, float | None]:
    """Residuals of identities that hold on the polyhedron up to rounding.

    Parameters
    ----------
    surface : UnitSurface

    Returns
    -------
    dict of str to float or None
        Relative; the balance of forces is None where the surface is one-sided or not manifold.
    """
    mesh, faces, defect = surface.mesh, surface.faces, surface.defect
    topology = mesh.topology
    expected = exact.gauss_bonnet_total(mesh)
    size = max(float(np.abs(defect).sum()), 2 * np.pi)  # all defects of a cylinder are rounding
    residuals: dict[str, float | None] = {
        "gauss_bonnet_residual": abs(float(defect.sum()) - expected) / size,
        "vertex_area_residual": abs(float(surface.area.sum() / faces.area.sum()) - 1.0),
    }
    balance = surface.balance
    if balance is None:
        return residuals | {"force_balance_residual": None}
    inside = topology.referenced_vertex & ~topology.boundary_vertex
    of_stars = star_balance(surface.vector, surface.link_conormal, surface.link_length, inside)
    return residuals | {
        "force_balance_residual": max(of_stars, balance["force"]),
        "torque_balance_residual": balance["torque"],
        "area_balance_residual": balance["area"],
    }
