"""Residuals decide whether a run converged; zero and constant data have none."""

import numpy as np
import pytest

from ddgcli.algorithms.hodge.hodge_analysis import hodge_analysis
from ddgcli.algorithms.laplacian.solve_tasks import solve_laplacian_tasks
from ddgcli.algorithms.laplacian.tasks import LaplacianTasks
from ddgcli.linalg.constrain import Dirichlet, Poisson
from ddgcli.linalg.residual_gate import within_residuals
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh


def test_residuals_warn_above_one_bound_and_fail_above_another(caplog):
    def judge(**accuracy):
        return within_residuals(accuracy, tuple(accuracy), "repair the mesh")

    assert judge(a=1e-7, b=None, c=[0.0, 1e-9]) and not caplog.records
    assert judge(small_residual=1e-5) and "small_residual is 1e-05, above 1e-06: repair" in caplog.text
    assert "not converged" not in caplog.text
    assert not judge(big_residual=1.4e-3) and "big_residual is 0.0014, above 0.001, so that" in caplog.text
    assert "not converged: repair the mesh" in caplog.text
    assert not judge(a=float("nan"))


@pytest.mark.parametrize(
    "solver, tasks",
    [
        (Poisson, {"poisson": "height"}),
        (Dirichlet, {"poisson": "height", "fixed": {0: 1.0}}),
        (Dirichlet, {"harmonic": True, "fixed": {0: 0.0, 5: 1.0}}),
    ],
)
def test_a_wrong_solution_is_not_converged(solver, tasks, monkeypatch):
    mesh = shapes.icosphere(2)
    if "poisson" in tasks:
        tasks = tasks | {"poisson": mesh.points[:, 2]}
    assert solve_laplacian_tasks(mesh, LaplacianTasks(**tasks)).converged
    right, noise = solver.solve, np.random.default_rng(0).standard_normal(mesh.n_vertices)
    monkeypatch.setattr(solver, "solve", lambda *a, **k: right(*a, **k) + noise)
    assert not solve_laplacian_tasks(mesh, LaplacianTasks(**tasks)).converged


@pytest.mark.parametrize("value", [0.0, 1.0, 1e100, 1e-200])
def test_constant_sources_and_values_are_solved_exactly(value):
    mesh = shapes.random_sphere(500)
    poisson = solve_laplacian_tasks(mesh, LaplacianTasks(poisson=np.full(mesh.n_vertices, value)))
    assert poisson.converged and np.abs(poisson.vertex["poisson"]).max() <= 1e-12 * value
    harmonic = solve_laplacian_tasks(mesh, LaplacianTasks(harmonic=True, fixed={3: value, 9: value}))
    assert harmonic.converged and np.allclose(harmonic.vertex["harmonic"], value, rtol=1e-12, atol=0)
    assert harmonic.accuracy["maximum_principle_violation"] < 1e-12


@pytest.mark.parametrize("cells", ["faces", "tetrahedra"])
def test_values_of_unused_vertices_count_nowhere(cells):
    """Their zeros lay outside the fixed values: exit 1 with a violation of the maximum principle of 2."""
    body = {"faces": shapes.icosphere(1), "tetrahedra": shapes.box_tetrahedra(2, 2, 2)}[cells]
    corners = getattr(body, cells)
    points = np.concatenate([[[9.0, 9, 9]], body.points, [[5.0, 5, 5]]])
    mesh = type(body).from_arrays(points, corners + 1)
    fixed = {5: 2.0, 9: 3.0}
    for of_unused in ({}, {0: -7.0}):
        result = solve_laplacian_tasks(mesh, LaplacianTasks(harmonic=True, fixed=fixed | of_unused))
        assert result.converged and result.accuracy["maximum_principle_violation"] < 1e-12
        assert (result.results["harmonic"]["min"], result.results["harmonic"]["max"]) == (2.0, 3.0)
    result = solve_laplacian_tasks(mesh, LaplacianTasks(poisson=np.zeros(len(points)), fixed=fixed))
    assert result.results["poisson"]["min"] == 2.0


def test_one_element_and_everything_fixed():
    triangle = TriangleMesh.from_arrays(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]), [[0, 1, 2]])
    fixed = {0: 1.0, 1: 2.0, 2: 3.0}
    for tasks in (
        LaplacianTasks(harmonic=True, fixed=fixed),
        LaplacianTasks(poisson=np.zeros(3), fixed=fixed),
        LaplacianTasks(smooth=1.0),
        LaplacianTasks(smooth=1.0, smooth_flow="conformalized"),
        LaplacianTasks(eigen=3, hks=(0.1,)),
        LaplacianTasks(parameterize="harmonic"),
        LaplacianTasks(parameterize="conformal"),
    ):
        report = solve_laplacian_tasks(triangle, tasks)
        assert report.converged and all(np.isfinite(a).all() for a in report.vertex.values())
    assert np.array_equal(
        solve_laplacian_tasks(triangle, LaplacianTasks(harmonic=True, fixed=fixed)).vertex["harmonic"],
        [1, 2, 3],
    )


@pytest.mark.parametrize("size", [0.0, 1e-200, 1.0])
def test_hodge_of_fields_of_any_size(size):
    mesh = shapes.torus(12, 6, 2.0, 1.0)
    field = np.cross([0.0, 0.0, size], mesh.points[mesh.faces].mean(axis=1))
    report = hodge_analysis(mesh, (field, "face"), "tangential", False)
    assert report.converged
    assert len(report.accuracy) > 1 and all(0 <= value < 1e-9 for value in report.accuracy.values()), (
        report.accuracy
    )


def test_a_hodge_part_that_is_wrong_is_not_converged(monkeypatch):
    from ddgcli.algorithms.hodge import decomposition

    mesh = shapes.torus(12, 6, 2.0, 1.0)
    field = np.cross([0.0, 0.0, 1.0], mesh.points[mesh.faces].mean(axis=1))
    right = decomposition.ClosedProjection.potential
    monkeypatch.setattr(
        decomposition.ClosedProjection,
        "potential",
        lambda self, load: right(self, load) + np.arange(mesh.n_vertices) / mesh.n_vertices,
    )
    assert not hodge_analysis(mesh, (field, "face"), "tangential", False).converged
