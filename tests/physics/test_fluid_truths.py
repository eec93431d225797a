"""Fluids against known flows: steady harmonics, point vortices, Lamb and Oseen, rings."""

import numpy as np
import pytest

from benchmarks.fluids.runs import run_fluid
from ddgcli.mesh import shapes

DISK = 'grid = { size = [4, 4], cells = [64, 64], pattern = "right" }'


def clock(span):
    return f"duration = {span}\nstep = 0.02\nframe_every = {span}"


def centroid(points, weight):
    return (weight @ points) / weight.sum()


def gauss(x, y, strength, core):
    """Vorticity of a Gaussian vortex of circulation `strength`."""
    r2 = f"((x - {x})^2 + (y - {y})^2)"
    return f"{strength / (np.pi * core**2)}*exp(-{r2}/{core**2})"


@pytest.mark.parametrize(
    "degree, vorticity", [(2, "x*y"), (3, "z*(5*z^2 - 3)"), (4, "(x^2 - y^2)*(7*z^2 - 1)")]
)
def test_vorticity_of_one_degree_on_the_sphere_is_steady(degree, vorticity):
    out = run_fluid(
        f'initial = {{ vorticity = "{vorticity}" }}', "duration = 1\nstep = 0.05\nframe_every = 1",
        mesh=shapes.icosphere(3),
    )  # fmt: skip
    first, last = (
        observation.vertex["vorticity"] for observation in (out.observations[0], out.observations[-1])
    )
    assert np.linalg.norm(last - first) < 0.02 * np.linalg.norm(first)


def test_a_vortex_spreads_as_lamb_and_oseen_have_it():
    """The core grows as r^2 + 4 nu t; the vortex stays where it is, far from the walls."""
    nu, core, span = 0.01, 0.25, 1.0
    effects = f'initial = {{ vorticity = "{gauss(2, 2, 1.0, core)}" }}\nviscosity = {{ nu = {nu} }}'
    out = run_fluid(effects, clock(span), DISK)
    x, y, _ = np.asarray(out.fluid.context.points).T
    wide = core**2 + 4 * nu * span
    exact = np.exp(-((x - 2) ** 2 + (y - 2) ** 2) / wide) / (np.pi * wide)
    assert np.abs(out.observations[-1].vertex["vorticity"] - exact).max() < 0.01 * exact.max()


def lift(place, others, size, copies=8):
    """Velocity along y of a point vortex among (x, y, strength) in a square, by images in its walls."""
    total = 0.0
    for x, y, strength in others:
        for i in range(-copies, copies + 1):
            for j in range(-copies, copies + 1):
                for a, b in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
                    dx, dy = place[0] - a * x - 2 * size * i, place[1] - b * y - 2 * size * j
                    r2 = dx * dx + dy * dy
                    total += a * b * strength * dx / (2 * np.pi * r2) if r2 > 1e-12 else 0.0
    return total


def test_opposite_vortices_travel_at_the_speed_of_point_vortices():
    """Gamma / (2 pi d), but for the images in the walls, which take some 15 % of it."""
    gamma, d, span = 1.0, 0.6, 1.0
    pair = [(2 - d / 2, 1.9, gamma), (2 + d / 2, 1.9, -gamma)]
    vorticity = " + ".join(f"({gauss(x, y, strength, 0.15)})" for x, y, strength in pair)
    out = run_fluid(f'initial = {{ vorticity = "{vorticity}" }}', clock(span), DISK)
    points, mass = np.asarray(out.fluid.context.points), out.fluid.space.mass
    place = [
        centroid(points[:, 1], mass * np.minimum(observation.vertex["vorticity"], 0))
        for observation in (out.observations[0], out.observations[-1])
    ]
    speed = lift((2 + d / 2, 1.9), pair, 4.0)
    assert abs(speed) == pytest.approx(gamma / (2 * np.pi * d), rel=0.25)
    assert abs(place[1] - place[0]) / span == pytest.approx(abs(speed), rel=0.05)


def test_like_vortices_turn_about_each_other_at_the_rate_of_point_vortices():
    """Gamma / (pi d^2)."""
    gamma, d, span = 1.0, 0.7, 1.0
    vorticity = gauss(2 - d / 2, 2, gamma, 0.12) + " + " + gauss(2 + d / 2, 2, gamma, 0.12)
    out = run_fluid(
        f'initial = {{ vorticity = "{vorticity}" }}',
        clock(span),
        DISK,
    )
    x, y, _ = np.asarray(out.fluid.context.points).T - np.array([[2], [2], [0]])
    omega = out.observations[-1].vertex["vorticity"] * out.fluid.space.mass
    angle = 0.5 * np.arctan2(omega @ (2 * x * y), omega @ (x**2 - y**2))
    assert angle / span == pytest.approx(gamma / (np.pi * d**2), rel=0.05)


def test_a_pair_on_the_sphere_travels_at_the_speed_of_point_vortices():
    """Each at Gamma / (4 pi) cot(a / 2), the velocity at an angle a from the other."""
    gamma, a, span, core = 1.0, 0.8, 0.6, 0.15
    centres = [np.array([np.cos(a / 2), s * np.sin(a / 2), 0]) for s in (1, -1)]
    terms = [
        f"{sign}{gamma / (np.pi * core**2)}*exp(-((x - {c[0]})^2 + (y - {c[1]})^2 + z^2)/{core**2})"
        for sign, c in zip(("", " - "), centres)
    ]
    out = run_fluid(
        f'initial = {{ vorticity = "{"".join(terms)}" }}', clock(span),
        mesh=shapes.icosphere(5),
    )  # fmt: skip
    points, mass = out.fluid.context.points, out.fluid.space.mass
    middle = centroid(points, mass * np.maximum(out.observations[-1].vertex["vorticity"] - 1.0, 0))
    turned = np.arcsin(abs(middle[2]) / np.linalg.norm(middle))
    # each moves on a small circle about the axis y, of radius cos(a / 2)
    speed = np.cos(a / 2) * np.arctan(abs(middle[2]) / middle[0]) / span
    assert turned > 0 and speed == pytest.approx(gamma / (4 * np.pi) / np.tan(a / 2), rel=0.06)
