"""Multifrontal factorisation: a Cholesky factor for any graph."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import block_diag, coo_array, csc_array, csr_array, diags_array, kron

from ddgcli.linalg import backends, dissection
from ddgcli.linalg.assembly_tree import assembly_levels
from ddgcli.linalg.backends import NotPositiveDefinite
from ddgcli.linalg.dissection import nested_dissection
from ddgcli.linalg.factor import Factor
from ddgcli.linalg.multifrontal import CholeskyGroup, cholesky_groups, cholesky_solve, inverse_triangles
from ddgcli.mesh import shapes
from ddgcli.operators.laplacian import lumped_vertex_area, stiffness


def sphere_matrix(subdivisions=4):
    mesh = shapes.icosphere(subdivisions)
    return csc_array(stiffness(mesh) + diags_array(lumped_vertex_area(mesh)))


def levels_of(matrix):
    return assembly_levels(matrix, nested_dissection(matrix))


def cholesky_factor(matrix, groups):
    """(n, n) factor put together from its fronts, rows and columns as the matrix has them."""
    n = matrix.shape[0]
    L = np.zeros((n + 1, n + 1), dtype=matrix.dtype)
    for group in groups:
        for pivot, update, inverse, below in zip(
            group.pivot, group.update, group.inverse, group.below, strict=True
        ):
            real = pivot < n
            L[np.ix_(pivot[real], pivot[real])] = np.linalg.inv(inverse)[np.ix_(real, real)]
            L[np.ix_(update, pivot[real])] = below[:, real]
    return L[:n, :n]


@pytest.mark.parametrize("kind", [float, complex])
def test_factor_times_its_adjoint_is_the_matrix(kind):
    A = sphere_matrix(3).astype(kind)
    if kind is complex:
        phase = np.exp(1j * np.random.default_rng(0).uniform(0, 6, A.shape[0]))
        A = csc_array(diags_array(phase) @ A @ diags_array(phase.conj()))
    L = cholesky_factor(A, cholesky_groups(levels_of(A), A.data))
    assert np.abs(L @ L.conj().T - A.toarray()).max() < 1e-14


def test_every_unknown_is_a_pivot_once_and_updates_come_later():
    A = sphere_matrix(5)
    n = A.shape[0]
    when = np.full(n + 1, -1)
    levels = levels_of(A)
    for k, level in enumerate(levels):
        for group in level.groups:
            pivot = group.pivot[group.pivot < n]
            assert (when[pivot] == -1).all()
            when[pivot] = k
    assert (when[:n] >= 0).all()
    when[n] = len(levels)
    assert all((when[g.update] > k).all() for k, s in enumerate(levels) for g in s.groups)


def test_every_entry_of_the_matrix_has_its_place():
    A = sphere_matrix(4)
    entries = np.concatenate([level.entry for level in levels_of(A)])
    assert len(np.unique(entries)) == len(entries) == (A.nnz + A.shape[0]) // 2


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 400), st.floats(0.3, 3.0))
def test_random_graphs_of_several_components(seed, n, degree):
    rng = np.random.default_rng(seed)
    i, j = rng.integers(0, n, (2, int(degree * n / 2)))
    value = rng.normal(size=len(i))
    off = coo_array((value, (i, j)), shape=(n, n))
    off = csc_array(off + off.T)
    A = csc_array(off + diags_array(np.abs(off).sum(axis=0) + rng.uniform(0.01, 1, n)))
    nested = nested_dissection(A)
    x = rng.normal(size=(n, 3))
    assert nested is not None
    groups = cholesky_groups(assembly_levels(A, nested), A.data)
    assert np.abs(cholesky_solve(groups, A @ x) - x).max() < 1e-9
    assert np.abs(cholesky_solve(groups, A @ x[:, 0]) - x[:, 0]).max() < 1e-9


def test_sparse_right_hand_sides_skip_frontal_matrices_and_change_no_digit(monkeypatch):
    A = sphere_matrix(5)
    groups = cholesky_groups(levels_of(A), A.data)
    visited = []
    subset = CholeskyGroup.subset

    def recorded_subset(group, members):
        visited.append(len(members))
        return subset(group, members)

    monkeypatch.setattr(CholeskyGroup, "subset", recorded_subset)
    b = np.zeros(A.shape[0])
    b[17] = 1.0
    x = cholesky_solve(groups, b)
    assert np.abs(A @ x - b).max() < 1e-14
    assert visited and max(visited) == 1  # one frontal matrix a level, from a leaf to the root
    noise = 1e-30 * np.random.default_rng(0).normal(size=A.shape[0])  # as good as zero, but everywhere
    visited.clear()
    assert np.abs(cholesky_solve(groups, b + noise) - x).max() <= 1e-13 * np.abs(x).max()
    assert not visited


def test_indefinite_matrices_are_detected():
    A = sphere_matrix(4)
    shifted = csc_array(A - 0.01 * diags_array(np.ones(A.shape[0])))
    with pytest.raises(NotPositiveDefinite):
        Factor(shifted, solver="multifrontal", pivot=False)
    factor = Factor(shifted, solver="multifrontal")
    assert factor.solver == "pivoted"
    x = np.random.default_rng(0).normal(size=A.shape[0])
    assert np.abs(factor.solve(shifted @ x) - x).max() < 1e-9


def test_graphs_without_short_separators_are_factorised_by_superlu():
    n = 6000
    rng = np.random.default_rng(0)
    i, j = rng.integers(0, n, (2, 2 * n))
    graph = coo_array((np.ones(2 * n), (i, j)), shape=(n, n))
    A = csc_array(graph + graph.T + diags_array(np.full(n, 50.0)))
    factor = Factor(A, solver="multifrontal")
    assert factor.solver == "superlu"
    again = Factor(2 * A, solver="multifrontal", like=factor)
    assert again.solver == "superlu" and np.array_equal(again.order, factor.order)


def test_large_systems_of_the_base_install_are_multifrontal(monkeypatch):
    monkeypatch.setattr(backends, "cholmod_available", lambda: False)
    monkeypatch.delenv("DDGCLI_SOLVER", raising=False)
    assert Factor(sphere_matrix(6)).solver == "multifrontal"
    assert Factor(sphere_matrix(5)).solver == "superlu"
    bending = csc_array(kron(sphere_matrix(3) @ sphere_matrix(3), np.eye(3) + 0.1))  # few unknowns, long rows
    assert Factor(bending).solver == "multifrontal"


def test_regular_surfaces_are_halved_however_large():
    """Samples of a regular mesh, numbered breadth first, must not all lie on one side."""
    for mesh in (shapes.icosphere(7), shapes.torus(600, 200)):
        nested = nested_dissection(csc_array(stiffness(mesh)))
        assert nested is not None
        top, n = nested.height.max(), mesh.n_vertices
        halves = np.bincount(nested.leaf[nested.height < top] >> (top - 1))
        assert len(halves) == 2 and halves.min() > n / 4
        assert (nested.height == top).sum() < 2 * np.sqrt(n)  # a separator is as long as a closed curve


def laplacian_of(i, j, n):
    graph = coo_array((-np.ones(len(i)), (i, j)), shape=(n, n))
    graph = csc_array(graph + graph.T)
    return csc_array(graph + diags_array(0.1 - graph.sum(axis=0)))


@pytest.mark.parametrize("ends", [100, 1000, 10**5])
@pytest.mark.parametrize("rim", [False, True])
def test_stars_and_fans_are_halved_though_all_their_ends_lie_equally_far(ends, rim):
    """The frontal matrix of a fan of 1000 faces has a million entries: 100 of them took 2.3 GB."""
    i = np.arange(max(ends, 20_000))
    hub = i // ends * ends
    j = np.append(hub, i[1:] - 1) if rim else hub
    i = np.append(i, i[1:]) if rim else i
    A = laplacian_of(i[i != j], j[i != j], i.max() + 1)
    nested = nested_dissection(A)
    assert np.bincount(nested.leaf[nested.height == 0]).max() <= 3 * dissection.LEAF_SIZE
    levels = assembly_levels(A, nested)
    assert sum(level.size for level in levels) < 100 * len(nested.leaf)
    b = np.random.default_rng(0).normal(size=A.shape[0])
    x = cholesky_solve(cholesky_groups(levels, A.data), b)
    assert (np.abs(A @ x - b) < 1e-13 * (np.abs(A) @ np.abs(x) + np.abs(b))).all()


def test_separators_divide_graphs_with_block_edges():
    """A Hessian of bending, coordinates apart: never ready with scipy's bipartite matching."""
    A = sphere_matrix(4)
    nested, _ = dissection._component_dissection(
        csr_array(kron(A @ A, np.ones((3, 3)))), dissection.LEAF_SIZE
    )
    assert np.count_nonzero(nested.height == nested.height.max()) < 4 * 3 * 64


def test_long_separators_are_judged_by_the_entries_of_the_rows():
    """A random tree has far less fill than its dissection, a solid with long rows has not."""
    n = 100_000
    child = np.arange(1, n)
    parent = (np.random.default_rng(0).random(n - 1) * child).astype(int)
    assert nested_dissection(laplacian_of(child, parent, n)) is None
    band = diags_array([np.ones(25)] * 3, offsets=[-1, 0, 1], shape=(25, 25))
    nested = nested_dissection(csc_array(kron(band, kron(band, band))))
    separator = np.count_nonzero(nested.height == nested.height.max())
    assert 25**2 / 2 < separator < 3 * 25**2  # near a plane of the cube


def test_leaves_hold_small_components_together():
    triangle = csc_array(np.eye(3) * 2 + np.ones((3, 3)))
    soup = csc_array(block_diag([triangle] * 500))
    nested = nested_dissection(soup)
    assert (nested.height == 0).all()
    assert len(np.unique(nested.leaf)) <= 2 * 1500 // dissection.LEAF_SIZE
    assert (np.ptp(nested.leaf.reshape(-1, 3), axis=1) == 0).all()
    b = np.random.default_rng(0).normal(size=1500)
    x = cholesky_solve(cholesky_groups(assembly_levels(soup, nested), soup.data), b)
    assert np.abs(soup @ x - b).max() < 1e-13


@pytest.mark.parametrize("g, s", [(200, 7), (3, 7), (60, 24), (2, 40), (1, 1)])
@pytest.mark.parametrize("kind", [float, complex])
def test_stacks_of_triangles_are_inverted(g, s, kind):
    rng = np.random.default_rng(0)
    lower = np.tril(rng.normal(size=(g, s, s)) * 0.1 + (1j if kind is complex else 0) * 0.1)
    lower += np.eye(s)
    inverse = inverse_triangles(lower)
    assert np.abs(inverse @ lower - np.eye(s)).max() < 1e-12
    assert (np.triu(inverse, 1) == 0).all()


def test_coordinates_of_a_vertex_stay_together():
    mesh = shapes.icosphere(4)
    A = csc_array(kron(stiffness(mesh) + diags_array(lumped_vertex_area(mesh)), np.ones((3, 3)) + np.eye(3)))
    nested = nested_dissection(A)
    assert (np.ptp(nested.leaf.reshape(-1, 3), axis=1) == 0).all()
    assert (np.ptp(nested.height.reshape(-1, 3), axis=1) == 0).all()
    assert A.shape[0] / (nested.leaf.max() + 1) <= dissection.LEAF_SIZE  # unknowns, not vertices
    order = np.random.default_rng(0).permutation(A.shape[0])
    mixed = csc_array(A[order][:, order])
    mixed.sort_indices()
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    again = nested_dissection(mixed).leaf[place].reshape(-1, 3)
    assert (np.ptp(again, axis=1) == 0).all()
    b = np.random.default_rng(1).normal(size=A.shape[0])
    assert np.abs(mixed @ Factor(mixed, solver="multifrontal").solve(b) - b).max() < 1e-12
