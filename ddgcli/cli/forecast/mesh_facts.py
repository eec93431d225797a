"""Facts of a mesh that decide how long a command takes on it, each within milliseconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ddgcli.cli.forecast.use import EdgePaths
    from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
    from ddgcli.mesh.tet_mesh import TetMesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh

__all__ = ["angle_deficit", "ball_vertices", "edge_paths", "harmonic_fields", "is_rough", "signature_pairs"]

SAMPLED_SIDES = 4_000  # of a mesh, for its roughness
SAMPLED_BALLS, SAMPLED_POINTS = 200, 50_000  # of a mesh, for the number of vertices in balls
MIN_ROUGH_TURN, MAX_ONE_SIGN = 0.09, 0.5  # radians; share of turns that have one sign only


def is_rough(mesh: TriangleMesh | IntrinsicMesh) -> bool:
    """Whether faces turn against their neighbours by large angles of both signs, in a sample of sides.

    Mean turns are 0.1 to 0.25 on noise and on scans, of both signs; on smooth surfaces of more than a
    thousand faces they are smaller, or of one sign.
    """
    import numpy as np

    from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
    from ddgcli.mesh.vectors import unit_vectors

    if isinstance(mesh, IntrinsicMesh):
        return False
    faces, twin = mesh.faces, mesh.topology.side_twin[:, 0]
    face = np.flatnonzero(twin >= 0)
    face = face[:: max(1, len(face) // SAMPLED_SIDES)]
    side = twin[face]
    a, b = mesh.points[faces[face]], mesh.points[faces[side // 3]]
    first, second = (unit_vectors(np.stack([x[:, k] - x[:, 0] for x in (a, b)])) for k in (1, 2))
    n, m = unit_vectors(np.cross(first, second))
    turn = np.arccos(np.clip((n * m).sum(axis=1), -1.0, 1.0))
    away = mesh.points[faces[side // 3, (side + 2) % 3]] - a[:, 0]
    sign = -np.sign((n * unit_vectors(away)).sum(axis=1))
    if not len(turn) or not np.isfinite(turn).all():
        return False
    return bool(turn.mean() > MIN_ROUGH_TURN and abs((sign * turn).mean()) < MAX_ONE_SIGN * turn.mean())


def angle_deficit(mesh: TriangleMesh | IntrinsicMesh, degrees: float) -> float:
    """Sum over the faces of 1 - (smallest angle / degrees), where that is positive."""
    import numpy as np

    from ddgcli.geometry.intrinsic import corner_angle

    smallest = np.degrees(corner_angle(mesh.side_length)).min(axis=1, initial=180.0)
    return float(np.maximum(1.0 - smallest / degrees, 0.0).sum())


def ball_vertices(mesh: TriangleMesh, radius: float) -> float:
    """Mean number of vertices within a radius of a vertex, from a sample of both."""
    import numpy as np

    points = mesh.points.T
    every = max(1, mesh.n_vertices // SAMPLED_POINTS)
    sample = np.ascontiguousarray(points[:, ::every])
    centres = points[:, :: max(1, mesh.n_vertices // SAMPLED_BALLS)].T
    with np.errstate(over="ignore"):
        inside = [np.count_nonzero(((sample - p[:, None]) ** 2).sum(axis=0) <= radius**2) for p in centres]
    return 1.0 + every * max(0.0, float(np.mean(inside)) - 1.0 / every)


def edge_paths(mesh: TriangleMesh, options: Mapping[str, Any]) -> tuple[EdgePaths, EdgePaths]:
    """Edge paths from the sources of `geodesic` together, and from the first of them alone."""
    import numpy as np
    from scipy.sparse.csgraph import dijkstra

    from ddgcli.algorithms.geodesics.edge_distance import edge_graph
    from ddgcli.cli.forecast.use import EdgePaths

    sources = _source_vertices(mesh, options)
    graph, mean_length = edge_graph(mesh), float(mesh.side_length.mean()) or 1.0

    def paths_from(vertices: NDArray) -> EdgePaths:
        count, length = (
            dijkstra(graph, indices=vertices, unweighted=unweighted, min_only=True)
            for unweighted in (True, False)
        )
        reached = np.isfinite(count)
        # small faces between large ones count by their length, stretched faces by their number
        edges = np.maximum(count[reached], length[reached] / mean_length)
        return EdgePaths(float(edges.sum()), float(edges.max(initial=0.0)))

    of_all = paths_from(sources)
    return of_all, of_all if len(sources) == 1 else paths_from(sources[:1])


def _source_vertices(mesh: TriangleMesh, options: Mapping[str, Any]) -> NDArray:
    """Vertices at or beside the sources; the first vertex where the options name none of the mesh."""
    import numpy as np

    vertices = np.array(options.get("source") or [], dtype=np.int64)
    faces = np.array([face for face, _ in options.get("source_face") or ()], dtype=np.int64)
    faces = faces[(faces >= 0) & (faces < mesh.n_faces)]
    points = np.array(options.get("source_point") or (), dtype=float).reshape(-1, 3)
    near = [int(np.argmin(((mesh.points - point) ** 2).sum(axis=1))) for point in points]
    boundary = np.flatnonzero(mesh.topology.boundary_vertex & bool(options.get("source_boundary")))
    vertices = np.concatenate([vertices, mesh.faces[faces, 0], near, boundary]).astype(np.int64)
    vertices = np.unique(vertices[(vertices >= 0) & (vertices < mesh.n_vertices)])
    return vertices if len(vertices) else np.zeros(1, dtype=np.int64)


def signature_pairs(mesh: TriangleMesh | IntrinsicMesh | TetMesh, times: Sequence[float]) -> int:
    """Number of eigenpairs of heat kernel signatures at these times."""
    import numpy as np

    from ddgcli.algorithms.laplacian.weyl import pairs_for_times
    from ddgcli.geometry.intrinsic import face_area
    from ddgcli.mesh.tet_mesh import TetMesh

    if isinstance(mesh, TetMesh):
        return pairs_for_times(float(np.abs(mesh.signed_volume).sum()), 3, times, mesh.n_vertices)
    return pairs_for_times(float(face_area(mesh.side_length).sum()), 2, times, mesh.n_vertices)


def harmonic_fields(mesh: TriangleMesh | IntrinsicMesh) -> int:
    """Dimension of the harmonic fields of a manifold surface, by Euler's formula."""
    topology = mesh.topology
    closed = topology.n_components if not topology.boundary_vertex.any() else 0
    return max(0, topology.n_components + closed - topology.euler_characteristic)
