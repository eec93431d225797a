"""Indices of edges by their ends; distinct integers."""

import numpy as np
import pytest

from ddgcli.mesh import shapes
from ddgcli.mesh.edge_lookup import edge_indices
from ddgcli.mesh.ragged import contains, unique_keys


@pytest.mark.parametrize("shuffled", [False, True])
def test_pairs_of_either_order_name_their_edge_and_others_none(shuffled):
    mesh, random = shapes.icosphere(2), np.random.default_rng(0)
    edges = mesh.topology.edges
    if shuffled:
        edges = random.permuted(random.permutation(edges), axis=1)
    number = {frozenset(pair): k for k, pair in enumerate(edges.tolist())}
    pairs = random.integers(0, mesh.n_vertices + 5, (4, 500, 2))
    expected = [[number.get(frozenset(pair), -1) for pair in row] for row in pairs.tolist()]
    assert np.array_equal(edge_indices(edges, pairs), expected)
    assert np.array_equal(edge_indices(edges, edges[:, ::-1]), np.arange(len(edges)))


def test_without_edges_or_pairs_there_is_none():
    none = np.zeros((0, 2), dtype=np.int64)
    assert edge_indices(none, np.array([[0, 1]])).tolist() == [-1]
    assert edge_indices(np.array([[0, 1]]), none).shape == (0,)


def test_distinct_integers_ascend_and_a_list_knows_what_it_contains():
    key = np.random.default_rng(1).integers(-50, 50, (30, 4))
    assert np.array_equal(unique_keys(key), np.unique(key)) and unique_keys(key[:0]).size == 0
    ascending = unique_keys(key[:9])
    assert np.array_equal(contains(ascending, key), np.isin(key, ascending))
    assert not contains(ascending[:0], key).any()
