"""L2-optimal transfer of vertex functions over the common subdivision."""

import numpy as np
import pytest

from ddgcli.algorithms.delaunay.common_subdivision import BaseTriangulation, common_subdivision
from ddgcli.algorithms.delaunay.refine import refine
from ddgcli.algorithms.delaunay.transfer import transfer
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.operators.laplacian import galerkin_mass
from tests.delaunay_cases import planar, stretched


def subdivision(mesh):
    return common_subdivision(flip_to_delaunay(mesh, track=True), BaseTriangulation.itself(mesh))


@pytest.mark.parametrize("to", ["intrinsic", "input"])
def test_linear_functions_of_the_plane_arrive_unchanged(to):
    mesh = planar()
    values = mesh.points[:, :2] @ np.array([2.0, -3.0]) + 1.0
    assert np.abs(transfer(subdivision(mesh), values, to=to) - values).max() < 1e-10


@pytest.mark.parametrize("to", ["intrinsic", "input"])
def test_the_result_is_the_nearest_and_keeps_the_integral(to):
    mesh = stretched(200)
    refined = refine(mesh, 25)
    cut = common_subdivision(refined.triangulation, refined.base)
    to_overlay, result_to_overlay = cut.from_input, cut.from_intrinsic
    if to == "input":
        to_overlay, result_to_overlay = result_to_overlay, to_overlay
    rng = np.random.default_rng(0)
    values = rng.normal(size=to_overlay.shape[1])
    transferred = transfer(cut, values, to=to)
    mass = galerkin_mass(cut.mesh)

    def distance(x):
        difference = result_to_overlay @ x - to_overlay @ values
        return difference @ (mass @ difference)

    least = distance(transferred)
    for _ in range(5):
        assert distance(transferred + 1e-3 * rng.normal(size=len(transferred))) > least
    ones = np.ones(cut.mesh.n_vertices)
    assert ones @ (mass @ (result_to_overlay @ transferred)) == pytest.approx(
        ones @ (mass @ (to_overlay @ values)), abs=1e-10
    )


def test_constants_survive_refinement():
    """Steiner points and flips change the space, but constants stay what they are."""
    mesh = stretched(200)
    refined = refine(mesh, 25)
    cut = common_subdivision(refined.triangulation, refined.base)
    assert np.abs(transfer(cut, np.ones(mesh.n_vertices), to="intrinsic") - 1).max() < 1e-10
