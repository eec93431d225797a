"""Heavy cantilever against the elastica, with the plate equivalence of its mesh."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from benchmarks.common.scenes import CANTILEVER, RIGIDITY
from tests.simulate import shell_run


def elastica_drop(gamma):
    """Tip drop over length of a heavy cantilever: theta'' = gamma (1 - s) cos(theta)."""
    s = np.linspace(0, 1, 200)
    slope = solve_bvp(
        lambda s, y: np.stack([y[1], gamma * (1 - s) * np.cos(y[0])]),
        lambda a, b: np.array([a[0], b[1]]), s, np.zeros((2, 200)), tol=1e-8,
    )  # fmt: skip
    fine = np.linspace(0, 1, 4001)
    return -np.trapezoid(np.sin(slope.sol(fine)[0]), fine)


def chain_drop(gamma, n):
    """Tip drop of a chain of n links with hinges of rotational stiffness B n at its joints but the first: the
    discrete elastica of a strip whose first column of cells is held."""
    from scipy.optimize import fsolve

    k = np.arange(1, n)

    def torque(angle):
        # links 1..n-1 hang from joints 1..n-1; half a cell's weight sits on each end of a link
        weight = np.full(n, 1 / n)
        weight[-1] = 0.5 / n
        beyond = np.cumsum(weight[::-1])[::-1]  # weight at node i+1 and beyond
        bend = np.diff(np.concatenate([[0.0], angle]))
        moment = np.cumsum((beyond[1:] * np.cos(angle) / n)[::-1])[::-1]
        return n * bend + gamma * moment

    angle = fsolve(torque, np.zeros(n - 1), xtol=1e-10)
    assert len(k) == len(angle)
    return -np.sin(angle).sum() / n


def drop(gamma, nx=40, ny=2, width=0.05, pattern="right", model="hinge"):
    text = CANTILEVER.format(
        density=gamma * RIGIDITY / 9.81,
        shape=f'grid = {{ size = [1, {width}], cells = [{nx}, {ny}], pattern = "{pattern}" }}',
        model=model,
        clamp=1.01 / nx,
    )
    run, contexts, _ = shell_run(text)
    rest = contexts["s"].mesh.points
    tip = rest[:, 0] > 1 - 1e-9
    return -float(run[-1].observations["s"].points[tip, 2].mean())


def stiffness(**mesh):
    """Stiffness of the strip over that of the plate, from a small load: its plate equivalence."""
    n = mesh.get("nx", 40)
    small = 0.01
    return chain_drop(small, n) / drop(small, **mesh)


def test_elastica_and_chain_agree():
    assert elastica_drop(10.0) == pytest.approx(0.700200, abs=2e-5)
    assert elastica_drop(2.0) == pytest.approx(0.238507, abs=2e-5)
    errors = [chain_drop(2.0, n) - 0.238507 for n in (20, 40, 80)]
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.1)  # the held column is a first-order error


@pytest.mark.parametrize("pattern", ["right", "alternating", "cross"])
def test_large_deflection_follows_the_elastica_of_the_equivalent_plate(pattern):
    b = stiffness(pattern=pattern)
    for gamma in (2.0, 10.0):
        # 1 %: a curved strip resists relaxing across its width (and right triangles twist it)
        assert drop(gamma, pattern=pattern) == pytest.approx(chain_drop(gamma / b, 40), rel=1e-2)


def test_narrow_strip_of_right_triangles_has_the_relaxed_stiffness():
    """Homogenisation: B = 4.8 K for one diagonal, K = D / 5."""
    assert stiffness(nx=80, ny=4, width=0.05) == pytest.approx(4.8 / 5, rel=0.02)


def test_default_grid_is_near_the_elastica():
    """The default pattern and the stiffness from the material: within 5 % at a large deflection."""
    values = [drop(10.0, nx=n, ny=n // 5, width=0.2, pattern="alternating") for n in (20, 40)]
    assert 2 * values[1] - values[0] == pytest.approx(0.700200, rel=0.05)


def test_static_finds_the_same_shape_for_quadratic_bending_at_small_load():
    assert drop(0.1, model="quadratic") == pytest.approx(drop(0.1), rel=1e-2)
