"""Wavefront results of one geodesic query: matrix, Voronoi regions, signed distance, fan, vertex types."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.algorithms.geodesics.distance import DistanceOptions
from ddgcli.algorithms.geodesics.edge_sets import EdgeSet
from ddgcli.algorithms.geodesics.oriented_cover import two_sided_cover
from ddgcli.algorithms.geodesics.query import WaveQuery
from ddgcli.algorithms.geodesics.sources import Sources, check_sources
from ddgcli.algorithms.geodesics.surface_curves import Curves
from ddgcli.errors import ParameterError, renamed_parameters
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.progress import StageProgress, no_stage_progress

_FAN_NAMES = partial(renamed_parameters, rays="fan", length="fan_length", circles="fan_circles")


@dataclass(frozen=True, eq=False)
class WaveResult:
    """Results of a wave query.

    Parameters
    ----------
    vertex, face : dict of str to ndarray
    results, accuracy : dict
        For the summary.
    matrix : dict of str to ndarray
        `distance (s, t)`, `sources (s,)`, `targets (t,)`; empty if the query has none.
    fan : Curves, optional
    """

    vertex: dict[str, NDArray] = field(default_factory=dict)
    face: dict[str, NDArray] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)
    accuracy: dict[str, Any] = field(default_factory=dict)
    matrix: dict[str, NDArray] = field(default_factory=dict)
    fan: Curves | None = None


def check_waves(
    mesh: TriangleMesh, query: WaveQuery, sources: Sources | None, method: str, signed_curves: EdgeSet | None
) -> None:
    """Raise the errors of `query_waves`, before it computes.

    Parameters
    ----------
    mesh : TriangleMesh
    query : WaveQuery
    sources : Sources or None
    method : str
    signed_curves : EdgeSet or None
        As in `query_waves`.

    Raises
    ------
    ParameterError, MeshError
    """
    if query.target and sources is not None:
        if sources.first_curve != len(sources.vertex) or len(sources.edge):
            raise ParameterError(
                "has distances from source vertices only; name each source by its vertex",
                parameter="target",
            )
        with renamed_parameters(sources="target"):
            check_sources(mesh, query.targets, "target")
    if signed_curves is not None:
        from ddgcli.algorithms.tangent_fields.signed_distance import check_query

        with renamed_parameters(curves="signed_distance"):
            check_query(mesh, signed_curves, "heat" if method == "heat" else "auto")
    if query.fan is not None and sources is not None:
        from ddgcli.algorithms.tangent_fields.fan import check_fan

        cover = two_sided_cover(mesh, "the fan")
        with _FAN_NAMES():
            check_fan(cover.mesh, cover.lift_sources(sources), query.fan, query.fan_length or 0.0)


def query_waves(
    mesh: TriangleMesh,
    query: WaveQuery,
    sources: Sources | None,
    method: str,
    options: DistanceOptions,
    *,
    signed_curves: EdgeSet | None = None,
    region: NDArray[np.int64] | None = None,
    stage_progress: StageProgress = no_stage_progress,
) -> WaveResult:
    """Compute the results of a wave query.

    Parameters
    ----------
    mesh : TriangleMesh
    query : WaveQuery
    sources : Sources, optional
    method, options
        Of the distance matrix; 'heat' also selects the signed heat method.
    signed_curves : EdgeSet, optional
        Curves of `query.signed_distance`.
    region : (m,) ndarray of int64, optional
        Source nearest to each face, where the distance has it.
    stage_progress : callable
        Called with the name of a computation; returns its progress callback or None.

    Returns
    -------
    WaveResult
    """
    result = WaveResult()
    if query.target and sources is not None:
        _matrix(result, mesh, query, sources, method, options, stage_progress)
    if query.voronoi and sources is not None:
        from ddgcli.algorithms.geodesics.voronoi import describe_regions, voronoi_regions

        if region is None:
            region = voronoi_regions(mesh, sources, progress=stage_progress("Voronoi regions"))
        result.face["region"] = region
        result.results["regions"] = describe_regions(mesh, region, len(sources))
    if signed_curves is not None:
        from ddgcli.algorithms.tangent_fields.signed_distance import signed_distance

        stage_progress("signed distance")
        signed = signed_distance(mesh, signed_curves, "heat" if method == "heat" else "auto")
        result.vertex["signed_distance"] = signed.distance
        finite = signed.distance[np.isfinite(signed.distance)]
        result.results["signed_distance"] = {
            "method": signed.method, "separates": signed.closed, "edges": len(signed_curves),
            "min": float(finite.min(initial=0.0)), "max": float(finite.max(initial=0.0)),
        }  # fmt: skip
        result.accuracy["signed_distance_residual"] = signed.residual
    if query.vertex_types:
        from ddgcli.algorithms.geodesics.voronoi import vertex_types

        kind = vertex_types(mesh)
        result.vertex["vertex_type"] = kind
        names = {"spherical": 1, "euclidean": 0, "hyperbolic": -1, "boundary": 2}
        result.results["vertex_types"] = {name: int((kind == value).sum()) for name, value in names.items()}
    if query.fan is None or sources is None:
        return result
    from ddgcli.algorithms.tangent_fields.fan import describe_fan, geodesic_fan

    cover = two_sided_cover(mesh, "the fan")
    with _FAN_NAMES():
        fan = geodesic_fan(
            cover.mesh, cover.lift_sources(sources), query.fan, query.fan_length or 0.0, query.fan_circles,
            progress=stage_progress("fan"),
        )  # fmt: skip
    result.results["fan"] = describe_fan(fan)
    return WaveResult(
        result.vertex, result.face, result.results, result.accuracy, result.matrix, cover.project(fan)
    )


def _matrix(
    result: WaveResult, mesh: TriangleMesh, query: WaveQuery, sources: Sources, method: str,
    options: DistanceOptions, stage_progress: StageProgress,
) -> None:  # fmt: skip
    """Add the distance matrix between source and target vertices."""
    from ddgcli.algorithms.geodesics.distance_matrix import distance_matrix

    targets = np.array(query.targets, dtype=np.int64)
    distance = distance_matrix(
        mesh, sources.vertex, targets, method, options, jobs=query.jobs,
        progress=stage_progress("distance matrix"),
    )  # fmt: skip
    result.matrix.update(distance=distance, sources=sources.vertex, targets=targets)
    finite = distance[np.isfinite(distance)]
    result.results["distance_matrix"] = {
        "rows": distance.shape[0], "columns": distance.shape[1],
        "max": float(finite.max(initial=0.0)), "unreachable": int(np.isinf(distance).sum()),
    }  # fmt: skip
    result.accuracy["matrix_symmetry_residual"] = _asymmetry(distance, sources.vertex, targets)


def _asymmetry(distance: NDArray, sources: NDArray, targets: NDArray) -> float | None:
    """Largest |d(a, b) - d(b, a)| relative to the largest distance; None where no pair occurs both ways."""
    common, row, column = np.intersect1d(sources, targets, return_indices=True)
    if len(common) < 2:
        return None
    block = distance[np.ix_(row, column)]
    finite = np.isfinite(block) & np.isfinite(block.T)
    gap = np.abs(np.where(finite, block, 0.0) - np.where(finite, block.T, 0.0))
    return float(gap.max()) / (float(block[finite].max(initial=0.0)) or 1.0)
