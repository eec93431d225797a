"""Peers that answer the same question, as candidates beside ours; missing packages are left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.candidates import Candidate

NO_SETUP: Callable[[], Any] = lambda: None  # noqa: E731


def _peer(name: str, setup: Callable[[], Any], solve: Callable[[Any], Any], **parameters: Any) -> Candidate:
    return Candidate(name, parameters, setup, solve, {})


def curvature(mesh: TriangleMesh) -> list[Candidate]:
    """libigl's quadric fit over two rings; pymeshlab's quadric fit and its discrete (cotangent) curvature."""
    return [*_available(_libigl_fit, mesh), *_available(_meshlab_curvature, mesh)]


def _libigl_fit(mesh: TriangleMesh) -> list[Candidate]:
    import igl

    def fit(_: Any) -> np.ndarray:
        directions_and_values = igl.principal_curvature(mesh.points, mesh.faces, 2)
        return 0.5 * (directions_and_values[2] + directions_and_values[3])

    return [_peer("libigl", NO_SETUP, fit, radius="2 rings")]


def _mesh_set(mesh: TriangleMesh) -> Any:
    import pymeshlab

    holder = pymeshlab.MeshSet()
    holder.add_mesh(pymeshlab.Mesh(mesh.points, mesh.faces))
    return holder


def _meshlab_curvature(mesh: TriangleMesh) -> list[Candidate]:
    import pymeshlab  # noqa: F401

    def fit(holder: Any) -> np.ndarray:
        holder.compute_curvature_principal_directions_per_vertex(
            method="Quadric Fitting", curvcolormethod="Mean Curvature", autoclean=False
        )
        return holder.current_mesh().vertex_scalar_array()

    def discrete(holder: Any) -> np.ndarray:
        holder.compute_scalar_by_discrete_curvature_per_vertex(curvaturetype="Mean Curvature")
        return holder.current_mesh().vertex_scalar_array()

    return [
        _peer("pymeshlab quadric", lambda: _mesh_set(mesh), fit),
        _peer("pymeshlab discrete", lambda: _mesh_set(mesh), discrete),
    ]


def _meshlab_distance(mesh: TriangleMesh) -> list[Candidate]:
    import pymeshlab

    far = pymeshlab.PureValue(float(mesh.side_length.sum()))

    def distance(holder: Any) -> np.ndarray:
        holder.compute_scalar_by_geodesic_distance_from_given_point_per_vertex(
            startpoint=mesh.points[0], maxdistance=far
        )
        return holder.current_mesh().vertex_scalar_array()

    return [_peer("pymeshlab", lambda: _mesh_set(mesh), distance)]


def geodesic(mesh: TriangleMesh) -> list[Candidate]:
    """pygeodesic (exact), potpourri3d (heat, fast marching), pymeshlab (along edges and across faces)."""
    return [*_available(_exact_and_heat, mesh), *_available(_meshlab_distance, mesh)]


def _exact_and_heat(mesh: TriangleMesh) -> list[Candidate]:
    import potpourri3d as pp3d
    import pygeodesic.geodesic as exact

    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    points = np.ascontiguousarray(mesh.points)
    rows = [
        _peer(
            "potpourri3d heat",
            lambda: pp3d.MeshHeatMethodDistanceSolver(points, faces, use_robust=True),
            lambda solver: solver.compute_distance(0),
        ),
        _peer(
            "potpourri3d fast marching",
            lambda: pp3d.MeshFastMarchingDistanceSolver(points, faces),
            lambda solver: solver.compute_distance([[(0, [])]]),
        ),
    ]
    if mesh.n_faces <= 25_000:
        rows.append(
            _peer(
                "pygeodesic",
                lambda: exact.PyGeodesicAlgorithmExact(points, faces),
                lambda solver: solver.geodesicDistances(np.array([0]), None)[0],
            )
        )
    return rows


def laplacian(mesh: TriangleMesh, k: int = 8) -> list[Candidate]:
    """robust_laplacian and libigl, their matrices through scipy's shift-invert."""
    import igl
    import robust_laplacian
    from scipy.sparse.linalg import eigsh

    def eigenvalues(pair: Any) -> np.ndarray:
        stiffness, mass = pair
        return np.sort(eigsh(stiffness, k, mass, sigma=-1e-2, return_eigenvectors=False))

    return [
        _peer(
            "robust_laplacian + eigsh",
            lambda: robust_laplacian.mesh_laplacian(mesh.points, mesh.faces),
            eigenvalues,
        ),
        _peer(
            "libigl + eigsh",
            lambda: (-igl.cotmatrix(mesh.points, mesh.faces), igl.massmatrix(mesh.points, mesh.faces, 1)),
            eigenvalues,
        ),
    ]


def delaunay(mesh: TriangleMesh) -> list[Candidate]:
    """robust_laplacian's matrix, solved by our solver."""
    import robust_laplacian

    from ddgcli.linalg.constrain import Poisson
    from ddgcli.tradeoff.problems.delaunay import load_function

    def solve(pair: Any) -> np.ndarray:
        stiffness, mass = pair
        area = mass @ np.ones(mesh.n_vertices)
        load = mass @ load_function(mesh, mesh.points)
        values = Poisson(stiffness, area).solve(load - area * (load.sum() / area.sum()))
        return values - values.mean()

    return [
        _peer("robust_laplacian", lambda: robust_laplacian.mesh_laplacian(mesh.points, mesh.faces), solve)
    ]


PEERS: dict[str, Callable[[TriangleMesh], list[Candidate]]] = {
    "curvature": curvature,
    "geodesic": geodesic,
    "laplacian": laplacian,
    "delaunay": delaunay,
}


def peers_of(command: str, mesh: TriangleMesh) -> list[Candidate]:
    """Peers of a command; none where their packages are missing."""
    return _available(PEERS[command], mesh)


def _available(peers: Callable[[TriangleMesh], list[Candidate]], mesh: TriangleMesh) -> list[Candidate]:
    try:
        return peers(mesh)
    except ImportError:
        return []
