"""The solver layer: right answers from every backend, constraints, null spaces, refusals."""

import sys

import numpy as np
import pytest
from scipy.sparse import (
    block_array,
    block_diag,
    coo_array,
    csc_array,
    csr_array,
    diags_array,
    random_array,
)
from scipy.sparse.linalg import splu

from ddgcli.errors import ParameterError, SolveError
from ddgcli.linalg import backends, ordering
from ddgcli.linalg.constrain import Dirichlet, Poisson, floating_components
from ddgcli.linalg.dissection import nested_dissection
from ddgcli.linalg.factor import Factor
from ddgcli.linalg.ordering import fill_reducing_ordering, postorder
from ddgcli.linalg.separators import _vertex_cover, separator_level
from ddgcli.mesh import shapes
from ddgcli.operators.laplacian import lumped_vertex_area, stiffness

SOLVERS = ["multifrontal", "superlu", "pivoted"] + (["cholmod"] if backends.cholmod_available() else [])


def definite(n_subdivisions=3):
    mesh = shapes.icosphere(n_subdivisions)
    return (stiffness(mesh) + diags_array(lumped_vertex_area(mesh))).tocsc()


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("columns", [(), (1,), (3,), (7,)])
def test_solution_of_a_known_right_hand_side(solver, columns):
    A = definite()
    x = np.random.default_rng(0).normal(size=(A.shape[0], *columns))
    x[..., 1:2] = 0.0  # a column, or an entry
    factor = Factor(A, solver=solver)
    assert factor.solver == solver
    solution = factor.solve(A @ x)
    assert solution.shape == x.shape
    assert np.abs(solution - x).max() < 1e-12
    assert factor.backward_error(solution, A @ x) < 1e-14


@pytest.mark.parametrize("solver", SOLVERS)
def test_solutions_do_not_depend_on_the_memory_order_of_right_hand_sides(solver):
    A = definite()
    b = np.random.default_rng(0).normal(size=(A.shape[0], 3))
    factor, columns = Factor(A, solver=solver), np.asfortranarray(b)
    solution = factor.solve(b, refine=False)
    assert np.abs(solution - factor.solve(columns, refine=False)).max() <= 1e-14 * np.abs(solution).max()
    assert factor.backward_error(solution, b) < 1e-14
    assert np.array_equal(b, columns)


@pytest.mark.parametrize("solver", SOLVERS)
def test_refactor_takes_new_values(solver):
    A = definite()
    factor = Factor(A, solver=solver)
    b = np.random.default_rng(0).normal(size=A.shape[0])
    for scale in (2.0, 3.0, 0.5):
        B = (A + scale * diags_array(np.linspace(1, 2, A.shape[0]))).tocsc()
        assert np.abs(B @ factor.refactor(B).solve(b) - b).max() < 1e-12
    other = csc_array(diags_array(np.arange(1.0, A.shape[0] + 1)))
    assert np.allclose(factor.refactor(other).solve(b), b / np.arange(1.0, A.shape[0] + 1), rtol=1e-14)


@pytest.mark.parametrize("solver", [name for name in SOLVERS if name != "pivoted"])
@pytest.mark.parametrize("kind", [float, complex])
def test_analysis_serves_another_matrix_of_the_pattern(solver, kind):
    A = definite().astype(kind)
    first = Factor(A, solver=solver)
    assert np.array_equal(np.sort(first.order), np.arange(A.shape[0]))
    B = (A + diags_array(np.linspace(1, 2, A.shape[0]))).tocsc()
    b = np.random.default_rng(0).normal(size=A.shape[0])
    again = Factor(B, solver=solver, like=first)
    assert np.array_equal(again.order, first.order) or solver == "cholmod"  # which may post-order it
    assert np.abs(B @ again.solve(b) - b).max() < 1e-12
    dirichlet = Dirichlet(B, np.array([7, 30]), like=first, solver=solver)
    x = dirichlet.solve(np.array([1.0, -1.0]), b)
    assert x[7] == 1 and x[30] == -1 and np.abs((B @ x - b)[dirichlet.free]).max() < 1e-12
    assert (
        np.abs(x - Dirichlet(B, np.array([7, 30]), solver=solver).solve(np.array([1.0, -1.0]), b)).max()
        < 1e-13
    )
    assert dirichlet.residual(x, b) < 1e-13 and dirichlet.residual(x + 0.01 * (x != 1), b) > 1e-3


def test_shared_order_keeps_the_fill_low():
    A = definite(5)
    own = Factor(A, solver="superlu")
    reused = Factor(A, solver="superlu", like=own)
    assert reused._backend._lu.L.nnz < 1.1 * own._backend._lu.L.nnz


@pytest.mark.parametrize("solver", SOLVERS)
def test_complex_hermitian_systems_are_solved(solver):
    A = definite(2)
    n = A.shape[0]
    phase = np.exp(1j * np.random.default_rng(1).uniform(0, 6, n))
    H = csc_array(diags_array(phase) @ A @ diags_array(phase.conj()))
    x = phase * np.arange(n)
    assert np.abs(Factor(H, solver=solver).solve(H @ x) - x).max() < 1e-10 * n


@pytest.mark.parametrize("solver", [None, *SOLVERS])
def test_saddle_point_systems_are_solved(solver):
    A = definite(2)
    n = A.shape[0]
    constraint = random_array((5, n), density=0.2, rng=np.random.default_rng(2), format="csr")
    kkt = block_array([[A, constraint.T], [constraint, None]], format="csc")
    b = np.random.default_rng(3).normal(size=n + 5)
    factor = Factor(kkt, solver=solver)
    assert np.abs(kkt @ factor.solve(b) - b).max() < 1e-11
    assert np.abs(kkt @ Factor(kkt, definite=False).solve(b) - b).max() < 1e-11


@pytest.mark.parametrize("solver", SOLVERS)
def test_indefinite_systems_with_positive_diagonal_are_solved(solver):
    A = csc_array(np.array([[1.0, 3.0, 0.0], [3.0, 1.0, 1e-9], [0.0, 1e-9, 1e-9]]))
    x = np.array([1.0, -2.0, 3.0])
    assert np.abs(Factor(A, solver=solver).solve(A @ x) - x).max() < 1e-12


@pytest.mark.parametrize("solver", SOLVERS)
def test_pivots_that_are_too_small_lead_to_pivoting(solver):
    rng = np.random.default_rng(0)
    B = rng.normal(size=(40, 40))
    A = csc_array(B + B.T - np.diag(2 * np.diag(B)) + 1e-18 * np.eye(40))
    x = rng.normal(size=40)
    factor = Factor(A, solver=solver)
    assert np.abs(factor.solve(A @ x) - x).max() < 1e-10
    assert factor.solver == "pivoted"


@pytest.mark.parametrize("solver", SOLVERS)
def test_singular_is_refused(solver):
    L = stiffness(shapes.icosphere(2))
    with pytest.raises(SolveError, match="singular"):
        Factor(L, solver=solver).solve(np.ones(L.shape[0]))


@pytest.mark.skipif("cholmod" not in SOLVERS, reason="needs the extra `fast`")
@pytest.mark.parametrize("kind", [np.float64, np.complex128])
@pytest.mark.parametrize("most", [0, 10_000])
def test_cholmod_by_columns_and_by_blocks(kind, most, monkeypatch):
    """Both give the solution, one analysis serves both kinds of values, and negative pivots are refused."""
    monkeypatch.setattr("ddgcli.linalg.cholmod.MAX_COLUMNWISE_UNKNOWNS", most)
    A = definite(3).astype(kind)
    if kind is np.complex128:
        turn = diags_array(np.exp(1j * np.arange(A.shape[0])))
        A = csc_array(turn @ A @ turn.conj())
    x = np.random.default_rng(0).normal(size=(A.shape[0], 6)).astype(kind)
    factor = Factor(A, solver="cholmod", pivot=False)
    assert np.abs(factor.solve(A @ x) - x).max() < 1e-12
    assert np.abs(Factor(A, solver="cholmod", like=factor).solve(A @ x[:, 0]) - x[:, 0]).max() < 1e-12
    assert sorted(factor.order) == list(range(factor.n))
    low = diags_array(np.where(np.arange(factor.n) == 5, -0.99, 0.0) * A.diagonal())
    with pytest.raises(SolveError, match="not positive definite"):
        factor.refactor(csc_array(A + low))
    assert np.abs(factor.refactor(2 * A).solve(A @ x) - x / 2).max() < 1e-12


def test_wrong_systems_are_refused():
    A = definite(1)
    with pytest.raises(SolveError, match="not square"):
        Factor(csr_array((3, 4)))
    bad = A.copy()
    bad.data[3] = np.nan
    with pytest.raises(SolveError, match="not finite"):
        Factor(bad)
    with pytest.raises(SolveError, match="not finite"):
        Factor(A).solve(np.full(A.shape[0], np.inf))
    with pytest.raises(SolveError, match="shape"):
        Factor(A).solve(np.ones(A.shape[0] + 1))
    with pytest.raises(ParameterError, match="superlu"):
        Factor(A, solver="magic")


def test_environment_forces_the_base_solver(monkeypatch):
    monkeypatch.setenv("DDGCLI_SOLVER", "superlu")
    monkeypatch.setattr(backends, "MIN_CHOLMOD_UNKNOWNS", 0)
    assert Factor(definite(1)).solver == "superlu"


def test_scale_of_the_matrix_does_not_matter():
    A, b = definite(2), np.random.default_rng(0).normal(size=definite(2).shape[0])
    x = Factor(A).solve(b)
    for s in (1e-150, 1e-8, 1e8, 1e150):
        assert np.allclose(Factor(A * s).solve(b) * s, x, rtol=1e-12)


def test_dirichlet_reproduces_a_linear_function():
    mesh = shapes.grid(9, 7, pattern="alternating")
    linear = mesh.points @ np.array([[1.0, 2.0], [3.0, -1.0], [0.0, 0.0]])
    problem = Dirichlet(stiffness(mesh), mesh.topology.boundary_vertex)
    solution = problem.solve(linear[problem.fixed])
    assert np.abs(solution - linear).max() < 1e-13
    assert problem.residual(solution) < 1e-13


def two_spheres_and_a_point():
    sphere = stiffness(shapes.icosphere(2))
    return csc_array(block_diag([sphere, csr_array((1, 1)), sphere]))


def test_poisson_takes_the_mean_off_every_component(caplog):
    L = two_spheres_and_a_point()
    n = L.shape[0] // 2
    weight = np.concatenate([np.linspace(1, 2, n), [0.0], np.linspace(3, 1, n)])
    x = np.random.default_rng(0).normal(size=2 * n + 1)
    problem = Poisson(L, weight)
    assert problem.count == 3
    solution = problem.solve(L @ x)
    assert np.abs(L @ solution - L @ x).max() < 1e-12
    for rows in (slice(0, n), slice(n + 1, None)):
        assert abs((weight * solution)[rows].sum()) < 1e-12
    assert solution[n] == 0
    assert not caplog.records
    source = x + 1.0
    solution = problem.solve(source)
    for rows in (slice(0, n), slice(n + 1, None)):
        share = source[rows].sum() / weight[rows].sum()
        assert np.abs((L @ solution)[rows] - (source - share * weight)[rows]).max() < 1e-12
    problem.solve(np.ones(2 * n + 1))
    assert problem.imbalance == 1.0
    assert "does not sum to zero" in caplog.text


def test_poisson_solves_columns_and_refactors():
    L = two_spheres_and_a_point()
    x = np.random.default_rng(0).normal(size=(L.shape[0], 4))
    problem = Poisson(L)
    assert np.abs(L @ problem.solve(L @ x) - L @ x).max() < 1e-12
    assert np.abs(3 * L @ problem.refactor(3 * L).solve(L @ x) - L @ x).max() < 1e-12


def test_components_with_a_mass_do_not_float():
    sphere = stiffness(shapes.icosphere(1))
    n = sphere.shape[0]
    anchored = sphere + diags_array(np.full(n, 1e-3))
    label = floating_components(block_diag([anchored, sphere]))
    assert (label[:n] == -1).all() and (label[n:] == 0).all()


def test_empty_systems_have_solutions():
    for solver in ("auto", "multifrontal", "superlu", "pivoted", "conjugate-gradients", "multigrid"):
        assert Factor(csc_array((0, 0)), solver=solver).solve(np.zeros(0)).shape == (0,)
    L = stiffness(shapes.icosphere(0))
    everything = Dirichlet(L, np.arange(12))
    assert np.array_equal(everything.solve(np.arange(12.0)), np.arange(12.0))


def regular_grid_matrix(nu, nv):
    mesh = shapes.torus(nu, nv)
    return (stiffness(mesh) + diags_array(lumped_vertex_area(mesh))).tocsc()


def fill(matrix, order):
    permuted = matrix[order][:, order].tocsc()
    options = {"SymmetricMode": True}
    return splu(permuted, permc_spec="NATURAL", diag_pivot_thresh=0.0, relax=1, options=options).nnz


def test_dissection_is_a_permutation_with_little_fill():
    A = regular_grid_matrix(100, 80)
    order = nested_dissection(A).order
    assert np.array_equal(np.sort(order), np.arange(A.shape[0]))
    n = A.shape[0]
    # nested dissection of a plane grid fills 31/8 n log2(n) entries of each triangle, 9 n log2(n) is generous
    assert fill(A, order) < 9 * n * np.log2(n)
    assert fill(A, order) < 0.5 * fill(A, np.arange(n))


def test_dissection_does_not_depend_on_the_numbering():
    A = regular_grid_matrix(100, 80)
    p = np.random.default_rng(0).permutation(A.shape[0])
    shuffled = A[p][:, p].tocsc()
    shuffled.sort_indices()
    assert fill(shuffled, nested_dissection(shuffled).order) < 1.3 * fill(A, nested_dissection(A).order)


def test_dissection_gives_up_where_no_cut_is_short():
    n = 6000
    rng = np.random.default_rng(0)
    i, j = rng.integers(0, n, (2, 5 * n))
    random_graph = coo_array((np.ones(5 * n), (i, j)), shape=(n, n))
    matrix = csc_array(random_graph + random_graph.T + diags_array(np.full(n, 100.0)))
    assert nested_dissection(matrix) is None
    assert not fill_reducing_ordering(matrix).final


def test_dissection_of_several_components_fills_no_more_than_one_by_one():
    A = regular_grid_matrix(50, 50)
    speck = diags_array(np.ones(7))
    blocks = csc_array(block_diag([A, speck, A, A]))
    assert fill(blocks, nested_dissection(blocks).order) < 1.2 * 3 * fill(A, nested_dissection(A).order)


def test_separators_separate_and_are_short():
    A = csr_array(regular_grid_matrix(64, 64))
    x, y = np.divmod(np.arange(64 * 64), 64)
    path = 2 * (x // 32) + y // 32  # a torus in quarters
    level = separator_level(path, 2, A)
    assert [(level == k).sum() for k in range(2)] == [2 * 64, 4 * 31]  # circles, then lines
    rest = np.flatnonzero(level == 2)
    tail, head = A[rest][:, rest].tocoo().coords
    assert (path[rest][tail] == path[rest][head]).all()


def test_vertex_cover_is_as_small_as_can_be():
    rng = np.random.default_rng(0)
    for _ in range(50):
        edges = np.unique(rng.integers(0, 6, (rng.integers(1, 12), 2)), axis=0)
        lower, upper = edges[:, 0], edges[:, 1] + 6
        subsets = (np.arange(2**12)[:, None] >> np.arange(12)) & 1 == 1
        least = subsets.sum(axis=1)[(subsets[:, lower] | subsets[:, upper]).all(axis=1)].min()
        cover = _vertex_cover(lower, upper)
        assert (np.isin(lower, cover) | np.isin(upper, cover)).all()
        assert len(cover) == least


def test_postorder_keeps_the_fill_and_makes_subtrees_contiguous():
    A = regular_grid_matrix(30, 30)
    options = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    superlu = splu(A, permc_spec="MMD_AT_PLUS_A", **options)
    order = np.argsort(superlu.perm_c)
    L = splu(A[order][:, order].tocsc(), permc_spec="NATURAL", **options).L
    sorted_order = postorder(A, superlu.perm_c)
    after = superlu.perm_c[sorted_order]
    assert fill(A, sorted_order) == fill(A, order)
    parent = [min(L[:, [j]].nonzero()[0][L[:, [j]].nonzero()[0] > j], default=-1) for j in range(L.shape[0])]
    place = np.argsort(after)
    size = np.ones(len(parent), dtype=int)
    first = place.copy()
    for j, p in enumerate(parent):
        if p >= 0:
            size[p] += size[j]
            first[p] = min(first[p], first[j])
    assert np.array_equal(place - first + 1, size)


def test_order_depends_on_the_pattern_alone():
    A = definite()
    zeroed = A.copy()
    zeroed.data[(A.indices + np.repeat(np.arange(A.shape[0]), np.diff(A.indptr))) % 5 == 0] = (
        0.0  # kept entries
    )
    zeroed.setdiag(100.0)
    assert zeroed.nnz == A.nnz
    assert np.array_equal(Factor(A, solver="superlu").order, Factor(zeroed, solver="superlu").order)


@pytest.mark.parametrize("solver", ["superlu", "multifrontal"])
def test_bits_of_solutions_do_not_depend_on_the_matrices_before(solver):
    mesh = shapes.icosphere(2)
    full = csc_array(stiffness(mesh) + diags_array(lumped_vertex_area(mesh)))
    fewer = csc_array(full * (abs(full) > np.median(abs(full.data))) + diags_array(full.diagonal()))
    fewer.eliminate_zeros()
    rhs = np.linspace(1.0, 2.0, mesh.n_vertices)
    solutions = []
    for before in ([], [full], [fewer], [fewer, full, fewer]):
        factor = Factor(full, solver=solver)
        for matrix in (*before, full):
            factor.refactor(matrix)
        solutions.append(factor.solve(rhs, refine=False))
    assert fewer.nnz < full.nnz
    assert all(np.array_equal(solution, solutions[0]) for solution in solutions[1:])


def test_large_systems_are_dissected_and_refactored(monkeypatch):
    monkeypatch.setattr(ordering, "MIN_DISSECTION_UNKNOWNS", 1000)
    A = regular_grid_matrix(60, 50)
    assert fill_reducing_ordering(A).final
    assert not fill_reducing_ordering(regular_grid_matrix(20, 20)).final
    x = np.random.default_rng(0).normal(size=A.shape[0])
    factor = Factor(A, solver="superlu")
    assert np.abs(factor.solve(A @ x) - x).max() < 1e-12
    assert np.abs(factor.refactor(2 * A).solve(A @ x) - x / 2).max() < 1e-12


def test_dissection_of_soups_strips_and_half_patterns():
    soup = csc_array(block_diag([np.ones((3, 3))] * 4000))
    order = nested_dissection(soup).order
    assert np.array_equal(np.sort(order), np.arange(12_000))
    assert (np.ptp(order.reshape(-1, 3) // 3, axis=1) == 0).all()  # triangles stay together: no fill
    A = regular_grid_matrix(60, 50)
    half = A.copy()
    half.data[(half.indices > np.repeat(np.arange(3000), np.diff(half.indptr))) & (half.indices % 2 == 0)] = 0
    half.eliminate_zeros()
    assert half.nnz < A.nnz
    assert np.array_equal(np.sort(nested_dissection(half).order), np.arange(3000))
    assert fill(A, nested_dissection(half).order) == fill(A, nested_dissection(A).order)
    assert len(nested_dissection(csc_array((0, 0))).order) == 0


@pytest.mark.parametrize("size", [1, 7, 60])
def test_negative_eigenvalues_are_counted_by_inertia(size):
    from ddgcli.linalg.factor import negative_eigenvalues

    rng = np.random.default_rng(size)
    for negative in sorted({0, 1, size // 3, size}):
        q = np.linalg.qr(rng.normal(size=(size, size)))[0]
        values = 10.0 ** rng.uniform(-6, 3, size) * np.where(np.arange(size) < negative, -1, 1)
        matrix = csc_array((q * values) @ q.T)
        assert negative_eigenvalues(csc_array(0.5 * (matrix + matrix.T))) == negative
    assert negative_eigenvalues(csc_array(np.diag([-1e-9, 2.0, -3.0])), 1e-8) == 1
    assert negative_eigenvalues(csc_array((0, 0))) == 0


@pytest.mark.parametrize("solver", [name for name in SOLVERS if name in ("multifrontal", "cholmod")])
@pytest.mark.parametrize("subdivisions", [1, 2])
def test_a_matrix_of_new_pattern_that_is_not_definite_leaves_no_old_analysis(solver, subdivisions):
    """The next definite matrix of that pattern was factorised by the analysis of the first one."""
    factor = Factor(definite(1), solver=solver, pivot=False)
    A = definite(subdivisions)
    A = csc_array(A + 1e-3 * A @ A)  # more entries
    with pytest.raises(SolveError):
        factor.refactor(A - 3 * diags_array(A.diagonal().max() * np.linspace(0, 1, A.shape[0])))
    x = np.random.default_rng(0).normal(size=A.shape[0])
    assert np.abs(factor.refactor(A).solve(A @ x, refine=False) - x).max() < 1e-10


def test_an_extra_whose_import_fails_is_not_used(monkeypatch, tmp_path, caplog):
    package = tmp_path / "cvxopt"
    package.mkdir()
    (package / "__init__.py").write_text("raise ImportError('libopenblas.so: cannot open')", encoding="utf-8")
    for name in [name for name in sys.modules if name.split(".")[0] == "cvxopt"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(str(tmp_path))
    importable = backends.cholmod_available
    importable.cache_clear()
    try:
        assert not importable()
        assert "libopenblas.so: cannot open" in caplog.text and "--force-reinstall" in caplog.text
    finally:
        importable.cache_clear()


def test_the_sum_of_a_right_hand_side_is_compared_with_its_terms(caplog):
    """Terms of size 1 leave sums of rounding; a sum of a tenth of them is none."""
    path = csr_array(np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]]))
    problem = Poisson(path)
    problem.solve(np.array([1e-16, 3e-16, 1e-16]), size=np.ones(3))
    assert not caplog.records and problem.imbalance < 1e-15
    problem.solve(np.array([0.1, 0.1, 0.1]), size=np.ones(3))
    assert problem.imbalance == pytest.approx(0.1) and "0.1 of its size" in caplog.text
