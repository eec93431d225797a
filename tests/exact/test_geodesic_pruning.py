"""Pruned windows cover what they covered before."""

import numpy as np

from ddgcli.algorithms.geodesics.exact import dominance, wavefront
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.mesh import shapes


def covered(lines, where):
    """Sides, and the total length of each that its windows cover."""
    order = np.lexsort((lines[0], where[0]))
    b0, b1, side = lines[0, order], lines[1, order], where[0, order]
    side, number = np.unique(side, return_inverse=True)
    before = np.maximum.accumulate(b1 + number)  # sides are shorter than 1
    begin = np.maximum(b0, np.concatenate([[0.0], before[:-1]]) - number)
    return side, np.bincount(number, np.maximum(b1 - begin, 0.0), len(side))


def test_pruning_leaves_no_gap_between_windows(monkeypatch):
    """A gap grows behind the side, and no window reaches a vertex in it."""
    mesh = shapes.random_sphere(2000)
    mesh = mesh.moved(mesh.points * [10.0, 1.0, 0.1])
    lost = []

    def dominate(lines, where, *constants):
        before = covered(lines, where)
        pruned = dominance.dominate(lines, where, *constants)
        after = np.zeros(len(before[0]))
        side, length = covered(*pruned)
        after[np.searchsorted(before[0], side)] = length
        lost.append((before[1] - after).max())
        return pruned

    monkeypatch.setattr(wavefront, "dominate", dominate)
    exact_distance(mesh, [0], dominance_every=3)
    assert len(lost) > 50 and max(lost) < 1e-10


def test_windows_are_pruned_in_the_order_of_their_begins_on_large_meshes_too():
    """Sides of high numbers left 1e-10 of a side for the begin: 81 of 198,300 distances were too long."""
    side = 3_000_000
    lines = np.array([[0.3 + 1e-11, 0.8, 0.5, -0.1], [0.3, 0.31, 0.305, -1.0]]).T  # the first is the nearer
    where = np.array([[side, side], [0, 0]])
    shape = np.broadcast_to(np.ones(5), (side + 1, 5))
    pruned, of_side = dominance.dominate(lines.copy(), where, shape, np.zeros(1))
    assert np.isclose(covered(pruned, of_side * 0)[1], 0.5, rtol=0, atol=1e-15)
    assert pruned[0].min() == 0.3
