"""Conjugate gradients in place of a factorisation: the direct solution, and when they take over."""

import logging

import numpy as np
import pytest
from scipy.sparse import csc_array, csr_matrix, diags_array

from ddgcli.algorithms.geodesics.heat import HeatSolver
from ddgcli.choices import ITERATIVE_SOLVERS
from ddgcli.errors import SolveError
from ddgcli.io.mesh_file import write_mesh
from ddgcli.linalg import backends, eigen
from ddgcli.linalg.constrain import Poisson
from ddgcli.linalg.eigen import smallest_eigenpairs
from ddgcli.linalg.factor import Factor
from ddgcli.linalg.iterative import Iterative, without_single_blocks
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.operators.laplacian import lumped_vertex_area, stiffness

SOLVERS = pytest.mark.parametrize("solver", ITERATIVE_SOLVERS)


@pytest.fixture(autouse=True)
def _pyamg(request):
    if "multigrid" in request.node.name:
        pytest.importorskip("pyamg")


@SOLVERS
def test_a_poisson_solution_equals_the_direct_one_to_its_residual(solver):
    mesh = shapes.random_sphere(1500, 1)
    L, load = stiffness(mesh), mesh.points[:, 2] * lumped_vertex_area(mesh)
    direct, iterative = Poisson(L, solver="superlu"), Poisson(L, solver=solver)
    load = direct.balanced(load)
    x, y = direct.solve(load), iterative.solve(load)
    assert iterative.factor.solver == solver
    assert np.abs(x - y).max() <= 1e-11 * np.abs(x).max()
    assert iterative.residual(y, load) <= 10 * direct.residual(x, load) + 1e-12


@SOLVERS
def test_heat_distances_equal_the_direct_ones_where_heat_falls_by_a_hundred_orders(solver, monkeypatch):
    mesh = shapes.grid(160, 4, 160.0, 4.0)  # 160 decay lengths: exp(-160) of the heat arrives
    direct = HeatSolver(mesh).distance([0]).distance
    monkeypatch.setenv("DDGCLI_SOLVER", solver)
    iterative = HeatSolver(mesh)
    assert iterative.solver == solver
    assert np.abs(iterative.distance([0]).distance - direct).max() <= 1e-9 * direct.max()


@SOLVERS
def test_eigenvalues_equal_the_direct_ones(solver):
    mesh = shapes.random_sphere(450, 2)
    L, M = stiffness(mesh), diags_array(lumped_vertex_area(mesh))
    direct, iterative = (smallest_eigenpairs(L, M, 4, solver=name) for name in ("superlu", solver))
    assert iterative.solver == solver and iterative.complete
    assert np.abs(iterative.values - direct.values).max() <= 1e-10 * direct.values[-1]


@SOLVERS
def test_eigenpairs_take_fewer_iterations_than_solutions_to_rounding(solver, monkeypatch):
    """Lanczos tolerates a residual of 1e-10: solutions to 1e-13 of the load take half of the iterations."""
    iterations = []

    class Counting(Iterative):
        def solve(self, rhs):
            before = self.iterations
            x = super().solve(rhs)
            iterations.append(self.iterations - before)
            return x

    monkeypatch.setattr(backends, "Iterative", Counting)
    mesh = shapes.random_sphere(450, 2)
    L, M = stiffness(mesh), diags_array(lumped_vertex_area(mesh))
    pairs = smallest_eigenpairs(L, M, 4, solver=solver)
    few = sum(iterations)
    monkeypatch.setattr(eigen, "ITERATIVE_RESIDUAL", 0.0)
    iterations.clear()
    to_rounding = smallest_eigenpairs(L, M, 4, solver=solver)
    assert 0 < few < 0.7 * sum(iterations)
    assert np.abs(pairs.values - to_rounding.values).max() <= 1e-12 * pairs.values[-1]
    assert pairs.residuals.max() < 1e-12


def test_coarse_matrices_have_no_blocks_of_single_entries():
    """pyamg stores the levels of a scalar problem in blocks of one entry, which it smooths more slowly."""
    matrix = csr_matrix(stiffness(shapes.icosphere(3)))
    single, double = matrix.tobsr((1, 1)), matrix.tobsr((2, 2))
    assert without_single_blocks(single).format == "csr" and without_single_blocks(double) is double
    assert (without_single_blocks(single) != matrix).nnz == 0 and without_single_blocks(None) is None


@SOLVERS
def test_several_right_hand_sides_are_solved_as_one_by_one(solver):
    L = csc_array(stiffness(shapes.icosphere(2)) + diags_array(np.ones(162)))
    rhs = np.random.default_rng(0).normal(size=(162, 3))
    factor = Factor(L, solver=solver)
    assert np.array_equal(factor.solve(rhs), np.stack([factor.solve(b) for b in rhs.T], axis=1))


def test_an_indefinite_matrix_is_refused_not_solved_wrongly():
    values = np.r_[np.ones(50), -np.ones(50)]
    rotation = np.linalg.qr(np.random.default_rng(0).normal(size=(100, 100)))[0]
    dense = rotation @ np.diag(values) @ rotation.T + 0.0
    dense += np.diag(np.maximum(0.0, 0.01 - np.diag(dense)))  # a positive diagonal, still indefinite
    solver = Iterative(csc_array(0.5 * (dense + dense.T)), "conjugate-gradients")
    try:
        x = solver.solve(np.ones(100))
    except SolveError:
        return
    assert np.abs(dense @ x - 1).max() < 1e-6


@pytest.mark.parametrize("installed", [True, False])
def test_conjugate_gradients_take_over_where_the_factors_do_not_fit(installed, monkeypatch, caplog):
    matrix = csc_array(stiffness(shapes.grid(144, 144)) + diags_array(np.ones(145**2)))
    monkeypatch.setattr(backends, "preferred_iterative_solver", lambda: ITERATIVE_SOLVERS[not installed])
    fits = backends.factor_bytes(matrix, 0.0)
    monkeypatch.setattr(backends, "available_memory", lambda: 1.01 * fits)
    assert backends.choose_solver(None, matrix, True)[0] not in ITERATIVE_SOLVERS
    monkeypatch.setattr(backends, "available_memory", lambda: 0.99 * fits)
    with caplog.at_level(logging.WARNING):
        assert backends.choose_solver(None, matrix, True)[0] == ITERATIVE_SOLVERS[not installed]
    assert "solve instead" in caplog.text


def test_the_analysis_of_the_estimate_is_that_of_the_factor_and_made_once(monkeypatch):
    matrix = csc_array(stiffness(shapes.grid(144, 144)) + diags_array(np.ones(145**2)))
    fits = backends.factor_bytes(matrix, 0.0)
    analyses = []
    analyse = backends.analyse
    monkeypatch.setattr(backends, "analyse", lambda pattern: analyses.append(1) or analyse(pattern))
    monkeypatch.setattr(backends, "available_memory", lambda: 1.01 * fits)
    monkeypatch.setattr(backends, "cholmod_available", lambda: False)
    first = Factor(matrix)
    second = Factor(2.0 * matrix, like=first)
    assert first.solver == second.solver == "multifrontal" and len(analyses) == 1
    load = matrix @ np.arange(145.0**2)
    assert np.allclose(2.0 * second.solve(load), first.solve(load), rtol=1e-12)


def test_the_estimate_of_a_factor_is_its_storage():
    matrix = csc_array(stiffness(shapes.grid(60, 60)) + diags_array(np.ones(61**2)))
    factor = Factor(matrix, solver="multifrontal")
    stored = sum(group.inverse.nbytes + group.below.nbytes for group in factor._backend._groups)
    estimate = backends.factor_bytes(matrix, 0.0)
    assert stored <= estimate <= 3.0 * stored
    assert backends.factor_bytes(matrix, np.inf) >= estimate


def test_the_option_chooses_the_solver_and_the_accuracy_names_it(summary, tmp_path):
    write_mesh(str(tmp_path / "cap.ply"), AnnotatedMesh(shapes.grid(9, 9)))
    calls = [
        ("laplacian", tmp_path / "cap.ply", "--harmonic", "--fix", "0=1", "--fix", "9=0"),
        ("geodesic", tmp_path / "cap.ply", "--source", 0, "--method", "heat"),
    ]
    for words in calls:
        direct, iterative = (summary(*words, *more) for more in ((), ("--solver", "conjugate-gradients")))
        named = {name: v for name, v in iterative["accuracy"].items() if name.endswith("_solver")}
        assert list(named.values()) == ["conjugate-gradients"]
        assert not [name for name in direct["accuracy"] if name.endswith("_solver")]


def test_a_sufficient_residual_accepts_rows_whose_terms_are_far_below_it():
    """Componentwise errors of such rows are near 1; to rounding, more rounds follow."""
    chain = csc_array(
        diags_array([np.full(199, -1.0), np.full(200, 4.0), np.full(199, -1.0)], offsets=[-1, 0, 1])
    )
    load = np.zeros(200)
    load[0] = 1.0  # the solution falls by 3.7 from each unknown to the next
    solver = Iterative(chain, "conjugate-gradients")
    exact = solver.solve(load)
    assert abs(exact[-1] / Factor(chain, solver="superlu").solve(load)[-1] - 1) < 1e-9
    solver.sufficient_residual, solver.residual = 1e-13, 0.0
    rough = solver.solve(load)
    assert 0 < solver.residual <= 1e-13 and np.linalg.norm(rough - exact) <= 1e-13
    assert abs(rough[-1]) < 0.5 * exact[-1]
