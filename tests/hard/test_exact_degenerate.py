"""Exact distances on degenerate meshes where windows multiply: the derived bound on crossings."""

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.edge_distance import edge_distance
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.errors import DdgError, MeshError
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.degenerate_meshes import degenerate_mesh

SHARED_HANGS = ("1535_0", "1599_2", "1610_0", "2054_2", "2478_1", "2690_2")


def assert_between(mesh, exact, source):
    edges = edge_distance(mesh, source).distance
    scale = float(np.abs(mesh.points).max()) or 1.0
    straight = np.linalg.norm((mesh.points - mesh.points[source]) / scale, axis=1) * scale
    reached = np.isfinite(edges)
    slack = 1e-9 * edges[reached].max() + 8 * np.finfo(float).eps * scale
    assert np.array_equal(np.isfinite(exact.distance), reached)
    assert (exact.distance[reached] <= edges[reached] + slack).all()
    assert (exact.distance[reached] >= straight[reached] - slack).all()
    assert exact.rounds <= 3000 + 20 * mesh.n_faces


@pytest.mark.parametrize("aspect", [1e2, 1e5, 1e8, 1e10, 1e12])
def test_a_doubly_covered_needle_terminates(aspect):
    """Without a bound, windows cross its two faces 1e10 times."""
    mesh = TriangleMesh.from_arrays(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1 / aspect, 0.0]]), np.array([[0, 1, 2], [0, 2, 1]])
    )
    assert np.abs(exact_distance(mesh, 0).distance - [0, 1, 1 / aspect]).max() < 1e-15


@pytest.mark.parametrize("name", SHARED_HANGS)
def test_meshes_that_once_ran_forever_terminate(shared_meshes, name):
    path = shared_meshes.parent / "regressions" / "meshes" / f"hang{name}.npz"
    if not path.is_file():
        pytest.skip(f"{path} is missing")
    with np.load(path) as data:
        mesh = TriangleMesh.from_arrays(data["points"], data["faces"])
    source = int(mesh.faces[0, 0])
    assert_between(mesh, exact_distance(mesh, source), source)


@pytest.mark.parametrize("seed", range(60))
def test_distances_on_degenerate_complexes_lie_between_their_bounds(seed):
    mesh = degenerate_mesh(seed)
    source = int(mesh.faces[0, 0])
    assert_between(mesh, exact_distance(mesh, source), source)


def test_the_bound_on_crossings_changes_no_distance(monkeypatch):
    from ddgcli.algorithms.geodesics.exact import exact_distance as module

    for mesh in (shapes.random_sphere(200, seed=3), shapes.torus(20, 9)):
        free = exact_distance(mesh, 5)
        with monkeypatch.context() as patch:
            patch.setattr(module, "MIN_ROUNDS", 1.0)
            patch.setattr(module, "ROUNDS_PER_FACE", 0.0)
            bounded = exact_distance(mesh, 5)
        np.testing.assert_allclose(bounded.distance, free.distance, rtol=1e-12)


def test_coordinates_whose_differences_overflow_are_refused():
    with pytest.raises(MeshError, match="vertex 1 has a coordinate above"):
        TriangleMesh.from_arrays(
            np.array([[0, 0, 0], [1.7e308, 0, 0], [0, -1e299, 0]]), np.array([[0, 1, 2]])
        )
    assert issubclass(MeshError, DdgError)
