"""Structures with known answers: the heavy elastica, the catenary, lateral buckling of a strip on edge."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

from benchmarks.common.rectangle_meshes import irregular_rectangle
from ddgcli.mechanics.modes import buckling_modes
from ddgcli.mesh.shapes import grid
from tests.physics.test_shell_midedge import CLAMP, RIGIDITY, built, run
from tests.simulate import shell_run

# gravito-bending number: drop and reach of the tip over the length, by the boundary value problem
# theta'' = gamma (1 - s) cos(theta)
ELASTICA = {
    1: (0.12347, 0.99125),
    3: (0.33965, 0.93151),
    10: (0.70020, 0.65635),
    30: (0.87309, 0.34277),
    100: (0.93752, 0.15923),
}


def ends(points):
    """Vertices at the two ends of a strip of length 1 along x."""
    return np.flatnonzero(points[:, 0] < 1e-9).tolist(), np.flatnonzero(points[:, 0] > 1 - 1e-9).tolist()


def elastica_errors(cells, gamma, pattern):
    """Errors of the tip's drop and reach, in lengths of the strip."""
    rows = cells // 10
    strip = (
        irregular_rectangle(1, 0.1, cells, rows)
        if pattern == "irregular"
        else grid(cells, rows, 1, 0.1, pattern)
    )
    root, tip = ends(np.asarray(strip.points))
    gravity = f"gravity = {{ acceleration = [0, 0, {-gamma * RIGIDITY}] }}"
    last = run(strip, CLAMP.format(root) + "\n" + gravity)[-1].observations["s"].points[tip].mean(axis=0)
    drop, reach = ELASTICA[gamma]
    return np.abs([-last[2] - drop, last[0] - reach])


@pytest.mark.parametrize("pattern", ["alternating", "irregular"])
@pytest.mark.parametrize("gamma", ELASTICA)
def test_midedge_strip_is_the_heavy_elastica(gamma, pattern):
    """From stiff to limp, each in one equilibrium."""
    assert elastica_errors(20, gamma, pattern).max() <= 0.008


def test_elastica_is_approached_at_second_order():
    coarse, fine = (elastica_errors(cells, 10, "alternating").max() for cells in (20, 40))
    assert 3 <= coarse / fine <= 5
    assert fine <= 1e-3


CHAIN = """
[time]
integrator = "static"
[[object]]
name = "s"
role = "shell"
mesh = "m"
density = 1
thickness = "1 mm"
young = "1 GPa"
poisson = 0.0
[effects]
stretching = {{}}
bending = {{ stiffness = 1e-7, rest = "flat" }}
gravity = {{ acceleration = [0, 0, -10] }}
[[effects.pin]]
name = "left"
vertices = {left}
[[effects.pin]]
name = "right"
vertices = {right}
"""


def hanging_strip(cells, chord):
    """(error of the sag, error of the pull) of a strip of length 1 that starts as an arc of a circle."""
    flat = grid(cells, 2, 1, 0.1, "alternating")
    s, y, _ = np.asarray(flat.points).T
    half_angle = brentq(lambda angle: np.sin(angle) / angle - chord, 1e-3, np.pi)
    radius = 0.5 / (cells * np.sin(half_angle / cells))  # of the polygon whose sides sum to 1
    angle = (2 * s - 1) * half_angle
    arc = flat.moved(np.column_stack([radius * np.sin(angle), y, -radius * np.cos(angle)]))
    left, right = ends(np.asarray(flat.points))
    source = SimpleNamespace(mesh=arc, vertex={}, face={}, sha256="", notes=[])
    snapshots, _, _ = shell_run(CHAIN.format(left=left, right=right), lambda path: source)
    observation = snapshots[-1].observations["s"]
    span = arc.points[right, 0].mean() - arc.points[left, 0].mean()
    a = brentq(lambda a: 2 * a * np.sinh(span / (2 * a)) - 1, 0.02, 100)
    sag = observation.points[left, 2].mean() - observation.points[:, 2].min()
    pull = np.asarray(observation.scalar["reaction_force_right"])
    weight = 10 * 0.1  # N
    assert pull[2] == pytest.approx(weight / 2, rel=1e-6)
    return abs(sag / (a * (np.cosh(span / (2 * a)) - 1)) - 1), abs(pull[0] / (weight * a) - 1)


@pytest.mark.parametrize("chord", [0.5, 0.9])
def test_limp_strip_hangs_as_a_catenary_with_its_reactions(chord):
    """The sag at second order, the horizontal pull a w; half of the weight at each end."""
    coarse, fine = hanging_strip(10, chord), hanging_strip(20, chord)
    assert max(fine) <= 0.004
    assert 3 <= coarse[0] / fine[0] <= 5.5
    assert fine[1] <= 0.6 * coarse[1]


def lateral_load(height, poisson, load):
    """Critical load over Prandtl's of a strip on edge, `load` its name: "tip" or "weight"."""
    strip = grid(40, 4, 1, height, "alternating")
    points = np.asarray(strip.points)
    root, tip = ends(points)
    bending, torsion = RIGIDITY * height, 2 * RIGIDITY * height / (1 + poisson)  # E I and G J
    factor = {"tip": 4.013, "weight": 12.85}[load]
    critical = factor * np.sqrt(bending * torsion)
    effect = {
        "tip": f"load = {{ force = [0, {-critical}, 0], vertices = {tip} }}",
        "weight": f"gravity = {{ acceleration = [0, {-critical / height}, 0] }}",  # density 1 kg/m^2
    }[load]
    _, _, system = built(strip, CLAMP.format(root) + "\n" + effect, poisson=poisson)
    return buckling_modes(system, points, 1).values[0]


@pytest.mark.parametrize("poisson", [0.0, 0.3])
@pytest.mark.parametrize("load", ["tip", "weight"])
def test_strip_on_edge_buckles_sideways_at_the_load_of_prandtl(load, poisson):
    """The formulas are those of a narrow strip: a wider one is stiffer."""
    wide, narrow = (lateral_load(height, poisson, load) for height in (0.1, 0.05))
    assert 1 < narrow <= 1.025
    assert wide - 1 >= 1.5 * (narrow - 1)
