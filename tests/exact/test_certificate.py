"""The certificate of a distance: its short proof gives what distances along edges give."""

import numpy as np
import pytest

from ddgcli.algorithms.geodesics import certificate as module
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.mesh import shapes


def distances():
    mesh = shapes.random_sphere(200)
    exact = exact_distance(mesh, 0).distance
    raised, partial = exact.copy(), exact.copy()
    raised[7] += 1.0
    partial[9] = np.inf
    return mesh, {
        "exact": exact,
        "shifted": exact + 0.1,
        "scaled": 1.5 * exact,
        "lowered": 0.5 * exact,
        "one too far": raised,
        "one unreached": partial,
    }


@pytest.mark.parametrize("name", ["exact", "shifted", "scaled", "lowered", "one too far", "one unreached"])
def test_steps_along_edges_prove_what_edge_distances_show(name, monkeypatch):
    mesh, of = distances()
    short = module.certificate(mesh, Sources.at([0]), of[name])
    monkeypatch.setattr(module, "_below_edge_distance", lambda *_: False)
    assert module.certificate(mesh, Sources.at([0]), of[name]) == short
    assert (short["violations_edge_distance"] > 0) == (name in {"shifted", "scaled", "one too far"})


def test_exact_distances_need_no_distances_along_edges(monkeypatch):
    mesh, of = distances()
    monkeypatch.setattr(module, "edge_distance", None)
    assert module.certificate(mesh, Sources.at([0]), of["exact"])["violations_edge_distance"] == 0
