"""Vector fields at vertices as results: the logarithmic map, vectors spread by parallel transport."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddgcli.algorithms.geodesics.exact.exact_distance import ExactDistance
from ddgcli.algorithms.geodesics.fast_marching import FastMarchingDistance
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.log_map import log_map
from ddgcli.errors import ParameterError
from ddgcli.mesh.require import require
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.progress import ProgressCallback


@dataclass(frozen=True, eq=False)
class VertexVectors:
    """Arrays on vertices with what is to be said of them."""

    arrays: dict[str, NDArray] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)
    accuracy: dict[str, Any] = field(default_factory=dict)


def gathered(parts: list[VertexVectors]) -> VertexVectors:
    """All of them in one."""
    whole = VertexVectors()
    for part in parts:
        whole = VertexVectors(
            whole.arrays | part.arrays, whole.results | part.results, whole.accuracy | part.accuracy
        )
    return whole


def log_map_vectors(
    mesh: TriangleMesh,
    arrived: ExactDistance | FastMarchingDistance,
    sources: Sources,
    progress: ProgressCallback | None = None,
) -> VertexVectors:
    """Array `log_map` (n, 2) by the method of the distance, and the axis it is counted from."""
    if isinstance(arrived, ExactDistance):
        mapped = log_map(mesh, arrived, sources, progress)
        accuracy: dict[str, Any] = {"log_map_miss": mapped.miss}
    else:
        from ddgcli.algorithms.tangent_fields.polar_coordinates import fast_marching_log_map

        mapped = fast_marching_log_map(mesh, arrived, sources)
        accuracy = {"log_map_skew": mapped.skew}
    return VertexVectors({"log_map": mapped.log_map}, {"log_map_axis": mapped.axis}, accuracy)


def transport_vectors(mesh: TriangleMesh, sources: Sources, vectors: ArrayLike) -> VertexVectors:
    """Array `transported_vector` (n, 3): parallel to the vector of the nearest source vertex, by vector heat.

    Raises
    ------
    ParameterError
        When there is not one vector a source vertex, or a source lies inside a face.
    MeshError
        When the squares of lengths vanish or overflow.
    """
    from ddgcli.algorithms.tangent_fields.vector_heat import VectorHeat
    from ddgcli.operators.connection import from_vertex_frames, to_vertex_frames

    vectors = np.asarray(vectors, dtype=np.float64)
    if len(sources.points) or len(vectors) != len(sources.vertex):
        raise ParameterError(
            f"{len(vectors)} vectors for {len(sources.vertex)} source vertices; give --spread-vector once "
            "for each --source vertex"
        )
    require(mesh, "--spread-vector")
    in_space = np.zeros((mesh.n_vertices, 3))
    in_space[sources.vertex] = vectors
    start = to_vertex_frames(mesh, in_space)[sources.vertex]
    size = np.linalg.norm(vectors, axis=1)
    bad = np.flatnonzero(np.abs(start) <= 1e-12 * size)
    if len(bad):
        raise ParameterError(
            f"vector {vectors[bad[0]].tolist()} has no part along the surface at vertex "
            f"{sources.vertex[bad[0]]}; give one that is not normal to it"
        )
    spread = VectorHeat(mesh).transport(sources.vertex, start)
    return VertexVectors(
        {"transported_vector": from_vertex_frames(mesh, spread.vector)},
        {},
        {"transport_residual": spread.residual},
    )
