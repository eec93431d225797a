"""The spline shells and the meshes of the benchmark of nonlinear shells."""

import numpy as np
import pytest

from benchmarks.common.rectangle_meshes import flat_mesh
from benchmarks.common.shell_problems import PROBLEMS
from benchmarks.common.spline_shells import (
    spline_displacements,
    strain_curvature,
    strain_slopes,
    strains,
)
from ddgcli.geometry.intrinsic import face_area


def derivatives(count=4):
    """Tangents and second derivatives of bent, sheared surfaces."""
    rng = np.random.default_rng(2)
    first = np.array([[1.0, 0.2, 0], [0.1, 1.3, 0.3]])
    return np.concatenate(
        [first + 0.2 * rng.normal(size=(count, 2, 3)), rng.normal(size=(count, 3, 3))], axis=1
    )


def central(function, d, h=1e-5):
    """(n, ..., 15) differences of a function of (n, 5, 3) arrays."""
    moves = h * np.eye(15).reshape(15, 5, 3)
    return np.stack([(function(d + move) - function(d - move)) / (2 * h) for move in moves], axis=-1)


def test_slopes_of_the_strains_are_their_derivatives():
    d = derivatives()
    expected = central(strains, d)
    assert np.abs(strain_slopes(d).reshape(len(d), 6, 15) - expected).max() < 1e-8 * np.abs(expected).max()


def test_geometric_stiffness_is_the_derivative_of_the_slopes():
    d, stress = derivatives(), np.random.default_rng(3).normal(size=(4, 6))

    def pulled(d):
        return np.einsum("ni,nij->nj", stress, strain_slopes(d).reshape(len(d), 6, 15))

    expected = central(pulled, d)
    assert np.abs(strain_curvature(d, stress) - expected).max() < 1e-8 * np.abs(expected).max()


def test_the_spline_cantilever_follows_the_elastica():
    """Deflection and shortening over the length at P L^2 / E I = 2 and 4 (Mattiasson 1981)."""
    problem = PROBLEMS["cantilever, shear"]
    fractions = np.array(problem.fractions)
    moves = spline_displacements("cantilever, shear", (10, 1)) / 10
    for load, deflection, shortening in ((2, 0.49346, 0.16064), (4, 0.66996, 0.32894)):
        row = int(np.argmin(np.abs(fractions - load / 4)))
        assert moves[row, 1] == pytest.approx(deflection, rel=1e-3)
        assert moves[row, 0] == pytest.approx(shortening, rel=1e-3)


def test_a_tapered_mesh_covers_its_rectangle_and_inner_vertices_have_six_neighbours():
    problem = PROBLEMS["open hemisphere"]
    mesh = flat_mesh(problem.size, 600, "tapered", problem.spacing)
    assert face_area(mesh.side_length).sum() == pytest.approx(problem.size[0] * problem.size[1])
    q = np.asarray(mesh.points)[:, :2]
    inner = (q > 1e-9).all(axis=1) & (q < np.array(problem.size) - 1e-9).all(axis=1)
    valence = np.bincount(np.asarray(mesh.topology.edges).ravel(), minlength=mesh.n_vertices)
    assert np.array_equal(valence[inner], np.full(np.count_nonzero(inner), 6))


@pytest.mark.parametrize("pattern", ["alternating", "irregular"])
def test_a_graded_mesh_is_as_dense_as_its_spacing(pattern):
    problem = PROBLEMS["pinched cylinder"]
    mesh = flat_mesh(problem.size, 1800, pattern, problem.spacing)
    area = face_area(mesh.side_length)
    assert area.sum() == pytest.approx(problem.size[0] * problem.size[1])
    assert mesh.n_faces == pytest.approx(1800, rel=0.05)
    height = np.asarray(mesh.points)[np.asarray(mesh.faces), 1].mean(axis=1)
    low, high = area[height < 20].mean(), area[height > 284.8].mean()
    # along both parameters on irregular meshes (random points fill dense parts less), along one on grids
    assert (2.4 if pattern == "irregular" else 1.8) < low / high < (4.0 if pattern == "irregular" else 2.2)
