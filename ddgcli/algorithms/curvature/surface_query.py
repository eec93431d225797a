"""All results of one curvature query on a surface: a scheme, regions, vertex vectors, the offset body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.curvature.measures import vector_of
from ddgcli.algorithms.curvature.surface_curvature import (
    CURVATURE_ARRAYS,
    DEFAULT_SCHEME,
    VERTEX_ARRAYS,
    CurvatureResult,
    check_curvature,
    measure_curvature,
)
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.geometry.faces import Faces
from ddgcli.mesh.require import require
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import ratio, row_dot, vector_length

if TYPE_CHECKING:
    from ddgcli.algorithms.curvature.offset_body import OffsetBody
    from ddgcli.algorithms.curvature.region_measures import RegionMeasures

GRADIENT_VECTORS = ("H_p", "volume_gradient", "h_p", "gradient_angle")


@dataclass(frozen=True, eq=False)
class SurfaceMeasurement(CurvatureResult):
    """Result of a curvature query.

    Parameters
    ----------
    offset : OffsetBody, optional
    """

    offset: OffsetBody | None = None


def measure_surface(
    mesh: TriangleMesh,
    scheme: str = DEFAULT_SCHEME,
    radius: float | Literal["auto"] | None = None,
    *,
    image: NDArray | None = None,
    regions: Sequence[tuple[NDArray, str]] = (),
    balls: Sequence[tuple[NDArray, float]] = (),
    vertex_vectors: bool = False,
    offset: float | None = None,
    offset_angle: float = 6.0,
    jobs: int = 1,
    full: bool = True,
    energies: bool | None = None,
) -> SurfaceMeasurement:
    """Measure the curvature of a surface, and the further quantities of a query.

    Parameters
    ----------
    mesh, scheme, radius, image, jobs, full, energies
        Arguments of `measure_curvature`.
    regions : sequence of (array, place)
        Labels on faces or vertices; an empty place is inferred from the length, faces first.
    balls : sequence of (centre, radius)
    vertex_vectors : bool
        Also the arrays of `vertex_vectors`.
    offset : float, optional
        Distance of an offset body.
    offset_angle : float
        Largest step of its arcs, in degrees.

    Returns
    -------
    SurfaceMeasurement
    """
    if offset is not None:  # its volume needs Steiner's polynomial
        full = energies = True
    measured = measure_curvature(mesh, scheme, radius, image=image, jobs=jobs, full=full, energies=energies)
    vertex, results, accuracy = dict(measured.vertex), dict(measured.results), dict(measured.accuracy)
    if regions or balls:
        results["regions"], accuracy["region_residual"] = _regions(mesh, regions, balls)
    if vertex_vectors:
        vertex |= gradient_vectors(mesh)
    body = None
    if offset is not None:
        from ddgcli.algorithms.curvature.offset_body import offset_body

        with renamed_parameters(distance="offset", angle="offset_angle"):
            body = offset_body(mesh, offset, offset_angle)
        volume = float(np.polyval(results["steiner_polynomial"][::-1], offset))
        results["offset"] = {
            "distance": offset, "volume": volume, "mesh_volume": body.volume, "faces": body.mesh.n_faces,
        }  # fmt: skip
        accuracy["offset_volume_error"] = abs(body.volume / volume - 1.0)
    return SurfaceMeasurement(vertex, measured.edge, results, accuracy, measured.converged, body)


def check_query(
    mesh: TriangleMesh,
    scheme: str = DEFAULT_SCHEME,
    radius: float | Literal["auto"] | None = None,
    *,
    image: NDArray | None = None,
    regions: Sequence[tuple[NDArray, str]] = (),
    balls: Sequence[tuple[NDArray, float]] = (),
    offset: float | None = None,
    offset_angle: float = 6.0,
) -> None:
    """Raise the errors of `measure_surface`, before it measures.

    Parameters
    ----------
    mesh, scheme, radius, image, regions, balls, offset, offset_angle
        As in `measure_surface`.
    """
    check_curvature(mesh, scheme, radius, image=image)
    if regions or balls:
        require_regions(mesh)
    with renamed_parameters(array="regions"):
        for array, place in regions:
            region_labels(mesh, array, place)
    if offset is not None:
        from ddgcli.algorithms.curvature.offset_body import check_offset

        with renamed_parameters(distance="offset", angle="offset_angle"):
            check_offset(mesh, offset, offset_angle)


def array_names(*, full: bool = True, vertex_vectors: bool = False) -> list[str]:
    """Names of the vertex arrays of `measure_surface`.

    Parameters
    ----------
    full, vertex_vectors : bool
        As in `measure_surface`.

    Returns
    -------
    list of str
    """
    return [*(VERTEX_ARRAYS if full else CURVATURE_ARRAYS), *(GRADIENT_VECTORS if vertex_vectors else ())]


def require_regions(mesh: TriangleMesh) -> None:
    """Raise an error for a surface whose faces are not oriented.

    Parameters
    ----------
    mesh : TriangleMesh

    Raises
    ------
    MeshError
    """
    require(mesh, "a region", faces=False, sized=False, oriented=True)


def labelled_measures(
    mesh: TriangleMesh, array: NDArray, place: str = ""
) -> tuple[RegionMeasures, NDArray, NDArray, str]:
    """Measures of the regions of equal labels on faces or vertices.

    Parameters
    ----------
    mesh : TriangleMesh
    array : (n,) or (m,) ndarray
        Whole numbers.
    place : {'vertex', 'face', ''}
        By the length of the array where it is empty.

    Returns
    -------
    measures : RegionMeasures
    label, names : ndarray
        Index of the region of each element, and the values that name the regions.
    place : str
    """
    from ddgcli.algorithms.curvature.region_measures import measures_of_labels

    require_regions(mesh)
    label, names, place = region_labels(mesh, array, place)
    return measures_of_labels(mesh, label, place), label, names, place


def region_labels(mesh: TriangleMesh, array: NDArray, place: str = "") -> tuple[NDArray, NDArray, str]:
    """Index of the region of each element, the values that name the regions, and the place of the labels."""
    from ddgcli.algorithms.curvature.region_measures import labels_of

    label, names = labels_of(array)
    place = place or {mesh.n_vertices: "vertex", mesh.n_faces: "face"}.get(len(label), "")
    if len(label) != {"vertex": mesh.n_vertices, "face": mesh.n_faces}.get(place, -1):
        raise ParameterError(
            f"an array of length {len(label)}; regions have one value for each of {mesh.n_faces} "
            "faces or "
            f"{mesh.n_vertices} vertices",
            parameter="array",
        )
    return label, names, place


def _regions(
    mesh: TriangleMesh, regions: Sequence[tuple[NDArray, str]], balls: Sequence[tuple[NDArray, float]]
) -> tuple[list[dict[str, Any]], float | None]:
    """Summary entries, and the largest relative gap between sums over labels and the whole surface."""
    from ddgcli.algorithms.curvature.region_measures import measures_in_ball, measures_of_labels

    require_regions(mesh)
    entries: list[dict[str, Any]] = []
    gaps = []
    whole = measures_of_labels(mesh, np.zeros(mesh.n_faces, dtype=np.int64), "face")
    for array, place in regions:
        with renamed_parameters(array="regions"):
            measures, label, names, place = labelled_measures(mesh, array, place)
        size = np.bincount(label)
        entries += [
            {"region": int(name), "on": place, "elements": int(k), **entry}
            for name, k, entry in zip(names, size, measures.entries(), strict=True)
        ]
        for region_values, total in ((measures.phi_k, whole.phi_k), (measures.phi_h, whole.phi_h)):
            gaps.append(abs(region_values.sum() - total[0]) / (np.abs(region_values).sum() or 1.0))
    for centre, radius in balls:
        entry = measures_in_ball(mesh, np.asarray(centre, dtype=float), radius).entries()[0]
        entries.append({"ball": [*map(float, centre), float(radius)], **entry})
    return entries, float(max(gaps)) if gaps else None


def gradient_vectors(mesh: TriangleMesh) -> dict[str, NDArray]:
    """Vectors of chapter 3 at vertices.

    Returns
    -------
    dict
        `H_p` (n, 3), minus the gradient of the area (inward where convex); `volume_gradient` (n, 3), the
        gradient A_p of the enclosed volume, a third of the area vector of the star; `h_p` (n,) = |H_p| /
        |A_p|, the sum of the principal curvatures without sign (2 / R on a sphere), 0 where A_p vanishes;
        `gradient_angle` (n,) between -H_p and A_p, in radians: 0 where the surface is round, 0 where one
        of them vanishes.
    """
    faces = Faces.of(mesh)
    mean = np.ascontiguousarray(2.0 * vector_of(faces, mesh.topology).T)
    volume = np.ascontiguousarray(faces.stars(faces.doubled / 6).T)
    size, length = vector_length(mean), vector_length(volume)
    cosine = ratio(-row_dot(mean, volume), size * length)
    angle = np.where(size * length > 0, np.arccos(np.clip(cosine, -1.0, 1.0)), 0.0)
    return dict(zip(GRADIENT_VECTORS, (mean, volume, ratio(size, length), angle), strict=True))
