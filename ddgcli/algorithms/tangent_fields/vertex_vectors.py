"""Vector fields at vertices: the logarithmic map and parallel transport, as results of a query."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.algorithms.geodesics.distance import DistanceResult
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.errors import ParameterError, counted
from ddgcli.mesh.require import require
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.progress import ProgressCallback

if TYPE_CHECKING:
    from ddgcli.algorithms.geodesics.exact.exact_distance import ExactDistance
    from ddgcli.algorithms.geodesics.fast_marching import FastMarchingDistance

log = logging.getLogger("ddgcli")


@dataclass(frozen=True, eq=False)
class VertexVectors:
    """Arrays on vertices, with their entries in the summary."""

    arrays: dict[str, NDArray] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)
    accuracy: dict[str, Any] = field(default_factory=dict)


def merge_vectors(vector_sets: list[VertexVectors]) -> VertexVectors:
    """Merge the arrays, results and accuracies of several results.

    Parameters
    ----------
    vector_sets : list of VertexVectors

    Returns
    -------
    VertexVectors
    """
    whole = VertexVectors()
    for vector_set in vector_sets:
        whole = VertexVectors(
            whole.arrays | vector_set.arrays,
            whole.results | vector_set.results,
            whole.accuracy | vector_set.accuracy,
        )
    return whole


def log_map_vectors(
    mesh: TriangleMesh,
    arrival: ExactDistance | FastMarchingDistance | DistanceResult,
    sources: Sources,
    progress: ProgressCallback | None = None,
) -> VertexVectors:
    """Array `log_map` by the method of the distance, and its x axis.

    Parameters
    ----------
    mesh : TriangleMesh
    arrival : ExactDistance, FastMarchingDistance or DistanceResult
        A `DistanceResult` alone (by the heat method) gives the map by vector heat.
    sources : Sources
        One source.
    progress : callable, optional

    Returns
    -------
    VertexVectors
    """
    from ddgcli.algorithms.geodesics.exact.exact_distance import ExactDistance

    if isinstance(arrival, ExactDistance):
        from ddgcli.algorithms.tangent_fields.log_map import log_map

        mapped = log_map(mesh, arrival, sources, progress)
        accuracy: dict[str, Any] = {"log_map_miss": mapped.miss}
    elif isinstance(arrival, DistanceResult):
        from ddgcli.algorithms.tangent_fields.heat_log_map import heat_log_map
        from ddgcli.algorithms.tangent_fields.polar_coordinates import direction_skew

        mapped = heat_log_map(mesh, arrival.distance, sources)
        if mesh.topology.boundary_vertex[sources.vertex].any():
            log.warning(
                "the source is on the boundary, along which the gradient of heat leans: directions near the "
                "boundary are wrong by a third of a radian; use `method=fast-marching` or `method=exact`"
            )
        unit = np.exp(1j * np.arctan2(mapped.log_map[:, 1], mapped.log_map[:, 0]))
        unit[sources.vertex] = 0.0
        accuracy = {"log_map_skew": direction_skew(mesh, arrival.distance, unit)}
    else:
        from ddgcli.algorithms.tangent_fields.polar_coordinates import fast_marching_log_map

        mapped = fast_marching_log_map(mesh, arrival, sources)
        accuracy = {"log_map_skew": mapped.skew}
    return VertexVectors({"log_map": mapped.log_map}, {"log_map_axis": mapped.axis}, accuracy)


def vectors_at_sources(mesh: TriangleMesh, sources: Sources, vectors: ArrayLike) -> NDArray[np.complex128]:
    """Complex tangent vectors at the source vertices in their frames.

    Parameters
    ----------
    mesh : TriangleMesh
    sources : Sources
        k vertices.
    vectors : (k, 3) array_like
        In space.

    Returns
    -------
    (k,) ndarray of complex128

    Raises
    ------
    ParameterError
        As in `transport_vectors`.
    """
    from ddgcli.operators.connection import to_vertex_frames

    vectors = np.asarray(vectors, dtype=np.float64)
    if len(sources.points) or len(vectors) != len(sources.vertex):
        number = counted(len(vectors), "vector", "vectors")
        starts = counted(len(sources.vertex), "source vertex", "source vertices")
        raise ParameterError(f"{number} for {starts}; give one for each", parameter="vectors")
    if vectors.ndim != 2 or vectors.shape[1] != 3:
        raise ParameterError(
            f"vectors have three components; these have the shape {vectors.shape}", parameter="vectors"
        )
    bad = np.flatnonzero(~np.isfinite(vectors).all(axis=1))
    if len(bad):
        raise ParameterError(f"vector {bad[0]} is not finite; give three finite numbers", parameter="vectors")
    first, row = np.unique(sources.vertex, return_index=True, return_inverse=True)[1:]
    other = np.flatnonzero((vectors != vectors[first[row]]).any(axis=1))
    if len(other):
        pair = " and ".join(str(vectors[i].tolist()) for i in (first[row[other[0]]], other[0]))
        raise ParameterError(
            f"vertex {sources.vertex[other[0]]} has two vectors, {pair}; give one, such as their sum",
            parameter="vectors",
        )
    require(mesh, "the transport of vectors")
    in_space = np.zeros((mesh.n_vertices, 3))
    in_space[sources.vertex] = vectors
    start = to_vertex_frames(mesh, in_space)[sources.vertex]
    size = np.linalg.norm(vectors, axis=1)
    bad = np.flatnonzero(np.abs(start) <= 1e-12 * size)
    if len(bad):
        raise ParameterError(
            f"vector {vectors[bad[0]].tolist()} has no tangential component at vertex "
            f"{sources.vertex[bad[0]]}; give one that is not normal to the surface",
            parameter="vectors",
        )
    return start


def transport_vectors(mesh: TriangleMesh, sources: Sources, vectors: ArrayLike) -> VertexVectors:
    """Array `transported_vector`: vectors parallel to that of the nearest source vertex, by vector heat.

    Parameters
    ----------
    mesh : TriangleMesh
    sources : Sources
        k vertices.
    vectors : (k, 3) array_like
        In space; their tangential components are transported.

    Returns
    -------
    VertexVectors
        `transported_vector` (n, 3).

    Raises
    ------
    ParameterError
        When the number of vectors is not that of the source vertices, a source lies inside a face, or a
        vertex has different vectors.
    MeshError
        When squares of lengths underflow or overflow.

    References
    ----------
    SharpSolimanCrane2019Vector in docs/references.bib.
    """
    from ddgcli.algorithms.tangent_fields.vector_heat import VectorHeat
    from ddgcli.operators.connection import from_vertex_frames

    start = vectors_at_sources(mesh, sources, vectors)
    transport = VectorHeat(mesh).transport(sources.vertex, start)
    return VertexVectors(
        {"transported_vector": from_vertex_frames(mesh, transport.vector)},
        {},
        {"transport_residual": transport.residual},
    )
