"""Eigenpairs: orthonormal, small residuals, multiplicities and zero modes complete."""

import tracemalloc

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import block_diag, csc_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import eigsh

from ddgcli.algorithms.hodge.harmonic import harmonic_basis
from ddgcli.errors import ParameterError
from ddgcli.linalg import eigen, lanczos
from ddgcli.linalg.backends import cholmod_available
from ddgcli.linalg.eigen import NullSpace, count_below, smallest_eigenpairs
from ddgcli.linalg.eigenspaces import canonical_vectors
from ddgcli.linalg.shift_invert import ShiftInvert
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.dec import complex_of
from ddgcli.operators.dec_matrices import form_laplacian
from ddgcli.operators.laplacian import galerkin_mass, lumped_mass, stiffness


def three_bodies(count, subdivisions=2):
    mesh = shapes.icosphere(subdivisions)
    return (
        csr_array(block_diag([stiffness(mesh)] * count)),
        csr_array(block_diag([lumped_mass(mesh)] * count)),
    )


@pytest.mark.parametrize("mass", [lumped_mass, galerkin_mass])
@pytest.mark.parametrize("k", [1, 2, 12, 300])
def test_eigenpairs_equal_those_of_a_dense_solver(mass, k):
    mesh = shapes.random_sphere(500, seed=4)
    L, M = stiffness(mesh), mass(mesh)
    pairs = smallest_eigenpairs(L, M, k)
    expected = eigh(L.toarray(), M.toarray(), eigvals_only=True)[:k]
    assert np.abs(pairs.values - expected).max() < 1e-11 * max(expected[-1], 1)
    assert np.abs(pairs.vectors.T @ (M @ pairs.vectors) - np.eye(k)).max() < 1e-12
    assert pairs.residuals.max() < 1e-8
    assert pairs.values[0] == 0.0
    assert pairs.complete


def test_multiplicities_wider_than_the_block_are_complete():
    # twelve equal spheres: eigenvalue zero 12 times, the next one 36 times
    L, M = three_bodies(12)
    pairs = smallest_eigenpairs(L, M, 60)
    assert (pairs.values[:12] == 0).all()
    assert np.ptp(pairs.values[12:48]) < 1e-10
    assert pairs.values[48] > 2 * pairs.values[47]
    assert pairs.complete
    assert np.abs(pairs.vectors.T @ (M @ pairs.vectors) - np.eye(60)).max() < 1e-12


def test_a_missing_copy_is_searched_until_it_comes_in_and_not_counted_before(monkeypatch):
    # a block of four vectors finds four of the five pairs of l = 2 at first
    counts = []
    monkeypatch.setattr(eigen, "count_below", lambda *a: counts.append(count_below(*a)) or counts[-1])
    L, star = form_laplacian(complex_of(shapes.icosphere(2)), 1)
    pairs = smallest_eigenpairs(csr_array(L + star), star, 13)
    assert pairs.complete and np.ptp(pairs.values[6:11]) < 1e-9
    assert len(counts) <= 3


def test_pairs_of_a_search_that_ends_early_are_eigenpairs(monkeypatch):
    monkeypatch.setattr(lanczos, "MAX_RESTARTS", 1)
    monkeypatch.setattr(eigen, "_none_missing", lambda *_: False)
    mesh = shapes.random_sphere(500, seed=4)
    pairs = smallest_eigenpairs(stiffness(mesh), lumped_mass(mesh), 6)
    assert not pairs.complete and pairs.residuals.max() < 1e-8


def test_progress_grows_to_the_whole():
    L, M = three_bodies(2, 3)
    shares = []
    smallest_eigenpairs(L, M, 15, progress=lambda done, total: shares.append(done / total))
    assert shares == sorted(shares) and shares[-1] == 1.0


def test_residuals_are_small_and_values_equal_those_of_arpack():
    L, M = three_bodies(1, 3)
    pairs = smallest_eigenpairs(L, M, 25)
    residual = np.linalg.norm(L @ pairs.vectors - M @ pairs.vectors * pairs.values, axis=0)
    assert residual.max() < 1e-9
    # a shift of -1e-8 would cost ARPACK eight digits beside the kernel, and its own start is random
    start = np.random.default_rng(0).standard_normal(L.shape[0])
    expected = eigsh(csc_array(L), 25, csc_array(M), sigma=-1.0, v0=start, return_eigenvectors=False)
    assert np.abs(pairs.values - np.sort(expected)).max() < 1e-11


def test_more_components_than_requested_pairs():
    L, M = three_bodies(12)
    pairs = smallest_eigenpairs(L, M, 5)
    assert (pairs.values == 0).all()
    assert np.abs(pairs.vectors.T @ (M @ pairs.vectors) - np.eye(5)).max() < 1e-12


@pytest.mark.parametrize("k, levels", [(200, (1, 2)), (60, (1, 3))], ids=["dense", "lanczos"])
def test_components_of_very_different_sizes_keep_their_digits(k, levels):
    large, small = (shapes.icosphere(level) for level in levels)  # of radius 1e6 and 1e-6
    L = csr_array(block_diag([stiffness(large), stiffness(small)]))
    M = csr_array(block_diag([1e12 * lumped_mass(large), 1e-12 * lumped_mass(small)]))
    pairs = smallest_eigenpairs(L, M, k)
    n, of_small = large.n_vertices, smallest_eigenpairs(stiffness(small), lumped_mass(small), k - 41)
    assert pairs.residuals.max() < 1e-11 and (pairs.values[:2] == 0).all()
    assert pairs.values[1 + n :] == pytest.approx(1e12 * of_small.values[1 : k - n], rel=1e-9)
    assert np.abs(pairs.vectors.T @ (M @ pairs.vectors) - np.eye(k)).max() < 1e-11


def test_a_definite_matrix_has_no_zero():
    mesh = shapes.icosphere(3)
    L, M = stiffness(mesh), lumped_mass(mesh)
    shifted = smallest_eigenpairs(L + 0.5 * M, M, 10)
    plain = smallest_eigenpairs(L, M, 10)
    assert np.allclose(shifted.values, plain.values + 0.5, rtol=1e-10)


def test_vectors_and_values_repeat_bit_for_bit():
    L, M = three_bodies(2, 3)
    first, second = smallest_eigenpairs(L, M, 15), smallest_eigenpairs(L, M, 15)
    assert np.array_equal(first.values, second.values) and np.array_equal(first.vectors, second.vectors)


def test_the_basis_of_equal_eigenvalues_does_not_depend_on_the_basis_that_was_computed():
    rng, M = np.random.default_rng(5), diags_array(np.linspace(1.0, 2.0, 60)).tocsr()
    groups = [[0], [1, 2, 3], [4], [5, 6]]
    values = np.array([0.0, 2.0, 2.0 * (1 + 1e-14), 2.0 * (1 + 2e-14), 3.0, 5.0, 5.0])
    X = np.linalg.qr(rng.normal(size=(60, 7)))[0] / np.sqrt(M.diagonal())[:, None]
    rotated = X.copy()
    for group in groups:
        rotated[:, group] = X[:, group] @ np.linalg.qr(rng.normal(size=(len(group), len(group))))[0]
    basis, other = (canonical_vectors(values, Y, M @ Y) for Y in (X, rotated))
    assert np.abs(X - rotated).max() > 0.01
    assert np.abs(basis - other).max() < 1e-12
    assert np.abs(basis.T @ (M @ basis) - np.eye(7)).max() < 1e-13
    for group in groups:  # of the same space
        coefficients = X[:, group].T @ (M @ basis[:, group])
        assert np.abs(X[:, group] @ coefficients - basis[:, group]).max() < 1e-13


def test_a_dense_solver_and_lanczos_with_any_seed_return_the_same_vectors(monkeypatch):
    # k ends at a gap: 1 + 3 + 5 + 7 of a symmetric sphere
    mesh = shapes.icosphere(3)
    L, M = stiffness(mesh), lumped_mass(mesh)
    lanczos_pairs, other_seed = (smallest_eigenpairs(L, M, 16, seed=seed) for seed in (0, 7))
    monkeypatch.setattr(eigen, "MAX_DENSE_SIZE", 1000)
    dense = smallest_eigenpairs(L, M, 16)
    assert np.abs(other_seed.vectors - lanczos_pairs.vectors).max() < 1e-9
    assert np.abs(dense.vectors - lanczos_pairs.vectors).max() < 1e-9
    assert dense.residuals.max() < 1e-12 and lanczos_pairs.residuals.max() < 1e-12


def test_null_vectors_of_components_stay_constants():
    L, M = three_bodies(3)
    vectors = smallest_eigenpairs(L, M, 5).vectors[:, :3]
    assert ((vectors != 0).sum(axis=0) == 162).all()
    assert (vectors >= 0).all()


def test_count_below_is_the_inertia():
    M = diags_array(np.ones(500)).tocsr()
    L = diags_array(np.arange(500.0)).tocsr()
    assert count_below(L, M, 41.5) == 42


@pytest.mark.parametrize("boundary", [False, True])
def test_counts_of_the_shifted_factor_are_the_inertia(boundary):
    """Two components with a null space, one with a fixed vertex, and values from one to all eigenvalues."""
    mesh = shapes.grid(16, 13, pattern="alternating") if boundary else shapes.random_sphere(250, seed=3)
    L, mass = stiffness(mesh), lumped_mass(mesh).diagonal()
    fixed = csr_array(L + diags_array(np.eye(1, len(mass), 7)[0] * mass))
    three, masses = csr_array(block_diag([L, fixed, L])), np.tile(mass, 3)
    shifted = ShiftInvert(three, csr_array(diags_array(masses)))
    values = eigh(three.toarray(), np.diag(masses), eigvals_only=True)
    for value in (1 + 1e-6) * values[[2, 3, 40, 400, -1]]:
        below = int((values < value).sum())
        assert shifted.count_below(value) == below
        assert count_below(three, diags_array(masses), value) == below


@pytest.mark.parametrize("solver", ["superlu", "multifrontal", "conjugate-gradients"])
@pytest.mark.parametrize("n, k", [(6, 8), (16, 8), (16, 2), (16, 1)])  # dense, Lanczos, no other pair
def test_pairs_beside_a_null_space_are_those_of_a_dense_solver(solver, n, k):
    mesh = shapes.torus(n, 12)
    L, star = form_laplacian(complex_of(mesh), 1)
    forms = harmonic_basis(mesh).forms.T
    kernel = NullSpace(forms, np.full(len(forms), 0.1))
    pairs = smallest_eigenpairs(L, star, k, null_space=kernel, solver=solver)
    expected = eigh(L.toarray(), star.toarray(), eigvals_only=True)[:k]
    assert (pairs.values[:2] == 0).all() and pairs.complete
    assert pairs.values == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert np.abs(pairs.vectors.T @ (star @ pairs.vectors) - np.eye(k)).max() < 1e-9
    assert pairs.residuals.max() < 1e-10


@pytest.mark.parametrize("mass", [lumped_mass, galerkin_mass])
def test_a_shift_among_the_eigenvalues_is_factorised_and_inverted(mass):
    mesh = shapes.random_sphere(800, seed=3)
    L, M = csr_array(stiffness(mesh)), csr_array(mass(mesh))
    shifted = ShiftInvert(L, M)
    assert shifted.factorise_near(40)
    values = eigh(L.toarray(), M.toarray(), eigvals_only=True)
    assert values[5] < shifted.shift < values[39]
    b = np.random.default_rng(0).normal(size=(800, 3))
    matrix = L - shifted.shift * M
    x = shifted.solve(b)
    assert np.abs(matrix @ x - b).max() < 1e-12 * (abs(matrix) @ np.abs(x)).max()


@pytest.mark.parametrize("unit", [2.0**-40, 1.0, 2.0**40])
def test_a_first_shift_above_all_pairs_is_lowered(unit):
    """The eigenvalues of a chain are far below Weyl's law of surfaces, in any unit of L."""
    n, k = 1500, 25
    step = np.ones(n - 1)
    chain = diags_array([-step, -step], offsets=[-1, 1]) + diags_array(np.r_[1.0, 2 * step[1:], 1.0])
    pairs = smallest_eigenpairs(csr_array(unit * chain), eye_array(n), k, solver="multifrontal")
    expected = unit * 4 * np.sin(np.arange(k) * np.pi / (2 * n)) ** 2
    assert pairs.complete
    np.testing.assert_allclose(pairs.values, expected, rtol=1e-9)


def test_the_eigenvalue_of_a_weak_link_keeps_its_digits():
    """Two spheres with a conductance w between them: w (1/A + 1/A) to first order, far below the shift."""
    mesh, w = shapes.random_sphere(700, seed=1), 1e-9
    mass, link = lumped_mass(mesh), np.zeros(1400)
    link[[0, 700]] = 1, -1
    L = csr_array(block_diag([stiffness(mesh)] * 2) + w * np.outer(link, link))
    M = csr_array(block_diag([mass] * 2))
    pairs = smallest_eigenpairs(L, M, 24, solver="multifrontal")
    assert pairs.complete and pairs.solver == "multifrontal" and pairs.values[0] == 0.0
    assert pairs.values[1] == pytest.approx(2 * w / mass.sum(), rel=1e-7)


def test_impossible_counts_are_an_error():
    L, M = three_bodies(1)
    for k in (0, L.shape[0] + 1):
        with pytest.raises(ParameterError, match="^k: .*eigenpairs of a matrix"):
            smallest_eigenpairs(L, M, k)


@pytest.mark.parametrize("n", [200, 900])
@pytest.mark.parametrize("size", [2.0**-440, 2.0**-400, 2.0**440])
def test_size_changes_no_digit(n, size):
    """Areas whose squares are no numbers; a power of two changes no digit of the input."""
    mesh = shapes.random_sphere(n, seed=2)
    other = mesh.moved(size * mesh.points)
    one, scaled = (smallest_eigenpairs(stiffness(m), lumped_mass(m), 6) for m in (mesh, other))
    np.testing.assert_allclose(scaled.values * size**2, one.values, rtol=1e-11)
    np.testing.assert_allclose(scaled.vectors * size, one.vectors, atol=1e-8)
    assert scaled.residuals.max() < 1e-12 and scaled.complete


def test_few_pairs_of_many_components_take_little_memory():
    """The null vectors of all components took n^2 / 3 numbers: 24 GiB of a soup of 57,000 vertices."""
    k = 5000
    points = np.random.default_rng(0).normal(size=(3 * k, 3))
    mesh = TriangleMesh.from_arrays(points, np.arange(3 * k).reshape(-1, 3))
    L, M = stiffness(mesh), lumped_mass(mesh)
    tracemalloc.start()
    pairs = smallest_eigenpairs(L, M, 3)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (pairs.values == 0).all() and peak < 1e8


def test_eigenvectors_beyond_memory_are_refused_with_the_estimate():
    n = 100_000
    with pytest.raises(ParameterError, match="need about 298 GiB"):
        smallest_eigenpairs(eye_array(n), eye_array(n), n)


@pytest.mark.skipif(not cholmod_available(), reason="needs the extra `fast`")
def test_eigenpairs_with_the_extra_equal_those_with_a_shift(monkeypatch):
    """Few pairs take the solver of the extra, many a shift among the eigenvalues."""
    monkeypatch.delenv("DDGCLI_SOLVER", raising=False)
    mesh = shapes.random_sphere(7300, seed=1)
    L, M = stiffness(mesh), lumped_mass(mesh)
    few, many = smallest_eigenpairs(L, M, 10), smallest_eigenpairs(L, M, 30)
    assert few.solver == "cholmod" and many.solver == "multifrontal"
    assert many.complete and few.complete and max(few.residuals.max(), many.residuals.max()) < 1e-10
    assert few.values == pytest.approx(many.values[:10], rel=1e-10)


@pytest.mark.parametrize("seed", range(12))
def test_copies_are_complete_with_a_count_and_without(seed, monkeypatch):
    """Fewer equal values than a block has vectors are not counted, and none of them is missing."""
    random = np.random.default_rng(seed)
    n, k, gap = 600, int(random.integers(3, 40)), 10.0 ** random.uniform(-14, -3)
    most = 3 if seed % 2 else 9
    sizes = random.integers(1, most + 1, n)
    levels = np.repeat(np.cumprod(1 + 10 ** random.uniform(-2, -0.3, 60)), sizes[:60])
    values = np.concatenate([levels, levels[-1] * np.linspace(1.1, 1e4, n)])[:n]
    values *= 1 + gap * random.random(n)
    counts = []
    monkeypatch.setattr(eigen, "count_below", lambda *a: counts.append(a[2]) or count_below(*a))
    L = csr_array(diags_array(random.permutation(values)))
    pairs = smallest_eigenpairs(L, eye_array(n), k, seed=seed)
    np.testing.assert_allclose(pairs.values, np.sort(values)[:k], rtol=1e-7)
    if most == 3:
        assert pairs.complete and not counts


def test_the_solver_of_few_unknowns_has_a_name():
    M = csr_array(eye_array(4))
    L = csr_array(np.array([[1.0, -1, 0, 0], [-1, 2, -1, 0], [0, -1, 2, -1], [0, 0, -1, 1]]))
    assert smallest_eigenpairs(L, M, 3).solver == "dense"
    assert smallest_eigenpairs(L, M, 1).solver == "none"  # zero, and its constant function
