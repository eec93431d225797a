"""Connected components: the same as scipy's, numbered by the lowest node, on random and extreme graphs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ddgcli.mesh.components import connected_labels


def assert_as_scipy(tail: np.ndarray, head: np.ndarray, n: int) -> None:
    count, label = connected_labels(tail, head, n)
    graph = coo_array((np.ones(len(tail)), (tail, head)), shape=(n, n))
    expected_count, expected = connected_components(graph, directed=False)
    assert count == expected_count
    # both numberings map to each other, and the first node of each component is in order
    assert len(np.unique(np.stack([label, expected]), axis=1).T) == count
    assert (np.diff(np.unique(label, return_index=True)[1]) > 0).all()


@given(st.integers(1, 40), st.data())
@settings(max_examples=60, deadline=None)
def test_components_of_random_graphs(n, data):
    node = st.integers(0, n - 1)
    edges = np.array(data.draw(st.lists(st.tuples(node, node), max_size=60)), dtype=np.int64).reshape(-1, 2)
    assert_as_scipy(edges[:, 0], edges[:, 1], n)


@pytest.mark.parametrize("order", ["ascending", "descending", "random"])
def test_components_of_long_paths_and_stars(order):
    n = 20_000
    number = {"ascending": np.arange(n), "descending": np.arange(n)[::-1]}.get(
        order, np.random.default_rng(0).permutation(n)
    )
    assert_as_scipy(number[:-1], number[1:], n)
    assert_as_scipy(np.full(n - 1, number[-1]), number[:-1], n)
    assert_as_scipy(number[: n // 2], number[n // 2 :], n)


def test_no_edges_and_no_nodes():
    assert connected_labels([], [], 3)[0] == 3
    count, label = connected_labels([], [], 0)
    assert count == 0 and len(label) == 0
