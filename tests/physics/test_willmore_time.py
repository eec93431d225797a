"""Flows in time: the sphere stays, modes decay at their rates, steps have their order."""

import logging
import re

import numpy as np
import pytest

import ddgcli as ddg
from benchmarks.common.mesh_classes import SPHERES, ellipsoids
from benchmarks.common.submesh import submesh
from ddgcli import write_mesh
from ddgcli.mesh import shapes
from ddgcli.models.willmore import descent, endings, flow
from ddgcli.models.willmore.flow import Flow
from ddgcli.models.willmore.setup import FlowOptions
from ddgcli.operators.laplacian import lumped_vertex_area
from tests.conftest import ROOT
from tests.physics.willmore_runs import assert_falls, ellipsoid, energies, run_flow, two_components


@pytest.mark.parametrize("family", ["good", "irregular", "stretched", "noisy", "refined"])
def test_sphere_stays_for_a_unit_of_time(family):
    """At every vertex, on every triangulation; the linear implicit step would have shrunk it to a point."""
    mesh = SPHERES[family](1)
    observations, end, _ = run_flow(mesh, duration=1.0, step=0.05)
    assert np.abs(end.points - mesh.points).max() < 1e-8  # required: 1e-4 off the radius
    assert_falls(observations)


@pytest.mark.parametrize("energy, most", [("sullivan", 1e-3), ("cotan", 3e-5)])
def test_sphere_under_the_other_energies(energy, most):
    mesh = shapes.icosphere(4)
    observations, end, _ = run_flow(mesh, FlowOptions(energy=energy, timed=True), duration=1.0, step=0.05)
    weight = lumped_vertex_area(mesh)
    off = np.linalg.norm(end.points, axis=1) - 1
    assert abs((weight * off).sum() / weight.sum()) < 1e-5 and np.sqrt((weight * off**2).sum()) < 4e-4
    slid = end.points - mesh.points
    slid -= (slid * mesh.points).sum(axis=1)[:, None] * mesh.points
    assert np.sqrt((weight[:, None] * slid**2).sum() / weight.sum()) < 2e-4
    assert np.abs(off).max() < most
    if energy == "sullivan":  # the twelve vertices of valence five settle at once, then all stays
        again = run_flow(mesh, FlowOptions(energy=energy, timed=True), duration=0.2, step=0.05)[1]
        settled = np.linalg.norm(again.points, axis=1) - 1
        assert np.abs(off - settled).max() < 1e-5
        assert np.sqrt(np.mean(off**2)) < 1e-4
    assert_falls(observations)


def test_cap_stays_under_a_clamped_rim():
    ball = shapes.random_sphere(400)
    faces = ball.faces[(ball.points[ball.faces][..., 2] > 0).all(axis=1)]
    cap = submesh(ball, faces)
    _, end, _ = run_flow(cap, FlowOptions(energy="gauss-map", timed=True), duration=0.2, step=0.02)
    assert np.abs(end.points - cap.points).max() < 1e-8


@pytest.mark.parametrize(
    "l, rate, within", [(2, 12.0, 0.01), (3, 60.0, 0.01), (4, 180.0, 0.02), (5, 420.0, 0.03)]
)
def test_modes_of_the_sphere_decay_at_their_rates(l, rate, within):
    mesh = shapes.icosphere(4)
    z, weight = mesh.points[:, 2], lumped_vertex_area(mesh)
    mode = np.polynomial.legendre.Legendre.basis(l)(z)
    bumpy = mesh.moved(mesh.points * (1 + 1e-3 * mode)[:, None])

    def amplitude(m):
        r = np.linalg.norm(m.points, axis=1)
        return (weight * mode * (r - r.mean())).sum() / (weight * mode**2).sum()

    duration = 0.5 / rate
    observations, end, _ = run_flow(bumpy, duration=duration, step=duration / 8)
    measured = -np.log(amplitude(end) / amplitude(bumpy)) / duration
    assert measured == pytest.approx(rate, rel=within)
    assert_falls(observations)


@pytest.mark.parametrize("gamma", descent.ROSENBROCK_GAMMAS)
def test_timed_steps_are_second_order(gamma, monkeypatch):
    monkeypatch.setattr(flow, "ROSENBROCK_GAMMAS", (gamma,))
    mesh = ellipsoid(1)
    coarse = 4 if gamma < 1 else 16
    ends = [run_flow(mesh, duration=1e-3, step=1e-3 / (coarse * n))[1].points for n in (1, 2, 4, 16)]
    error = [np.abs(e - ends[-1]).max() for e in ends[:-1]]
    rates = np.log2(np.array(error[:-1]) / error[1:])
    assert (rates > 1.7).all()


def test_semi_implicit_steps_are_first_order():
    mesh = ellipsoid(1)
    options = FlowOptions(timed=True, integrator="semi-implicit")
    ends = [run_flow(mesh, options, duration=1e-3, step=1e-3 / n)[1].points for n in (8, 16, 32)]
    exact = run_flow(mesh, duration=1e-3, step=1e-3 / 64)[1].points
    error = [np.abs(e - exact).max() for e in ends]
    rates = np.log2(np.array(error[:-1]) / error[1:])
    assert (np.abs(rates - 1) < 0.1).all()


def test_a_step_too_stiff_for_the_first_method_is_taken_by_the_second(monkeypatch):
    mesh = ellipsoids((1.0, 1.0, 2.0))["stretched"](0)
    step_sizes, step = [], flow.rosenbrock_step

    def counted(inner, dt, *rest):
        step_sizes.append(dt)
        return step(inner, dt, *rest)

    monkeypatch.setattr(flow, "rosenbrock_step", counted)
    observations, _, shots = run_flow(mesh, duration=0.05, step=0.005)
    assert len(step_sizes) > 10 and len(set(step_sizes)) == 1  # some twice, none shortened
    assert_falls(observations)


@pytest.mark.parametrize(
    "mesh, time_options, reason",
    [
        (
            shapes.torus(40, 5, pattern="alternating"),
            {"step": 0.005, "duration": 0.5},
            endings.LOWER_BOUND,
        ),
        (
            shapes.torus(20, 8, pattern="alternating"),
            {"tolerance": 1e-3, "duration": 0.5},
            endings.CRUMPLING,
        ),
    ],
)
def test_a_timed_flow_stops_there_too(mesh, time_options, reason):
    observations, _, shots = run_flow(mesh, FlowOptions(timed=True), frame_every=0.1, **time_options)
    assert shots[-1].ending == reason and shots[-1].time < 0.5
    assert 0.9 * 2 * np.pi**2 <= energies(observations)[-1] < energies(observations)[0]
    assert_falls(observations)


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_a_scaled_flow_is_the_flow_of_the_scaled_surface(scale):
    mesh = ellipsoid(2)
    plain, end, _ = run_flow(mesh, duration=0.02, step=0.005)
    large = mesh.moved(mesh.points * scale)
    scaled, scaled_end, _ = run_flow(large, duration=0.02 * scale**4, step=0.005 * scale**4)
    assert np.allclose(scaled_end.points / scale, end.points, rtol=0, atol=1e-11)
    assert np.allclose(energies(scaled), energies(plain), rtol=1e-11)


def test_mean_curvature_flow_of_the_sphere():
    error = []
    for step in (4e-3, 2e-3):
        _, end, _ = run_flow(
            shapes.icosphere(4), FlowOptions(flow="mean-curvature", timed=True), duration=0.1, step=step
        )
        error.append(np.linalg.norm(end.points, axis=1).mean() / np.sqrt(1 - 4 * 0.1) - 1)
    assert abs(error[1]) < 0.01 and error[0] / error[1] == pytest.approx(2, rel=0.3)


def thin_torus():
    """Of radii 1 and 0.1, on uneven triangles: even ones would shrink to the circle with their shape."""
    even, random = shapes.torus(60, 12, 1.0, 0.1), np.random.default_rng(1)
    x, y, z = np.array(even.points).T
    shift = random.uniform(-0.25, 0.25, (2, len(x))) * 2 * np.pi / np.array([[60], [12]])
    along, around = np.arctan2(y, x) + shift[0], np.arctan2(z, np.hypot(x, y) - 1.0) + shift[1]
    radius = 1.0 + 0.1 * np.cos(around)
    points = np.stack([radius * np.cos(along), radius * np.sin(along), 0.1 * np.sin(around)], axis=1)
    return even.moved(points)


def test_a_thin_torus_becomes_singular_as_it_shrinks_to_its_circle(tmp_path, summary):
    """The tube has r^2 = r0^2 - 2 t up to r / R; steps past the circle would go on from faces of no shape."""
    path = tmp_path / "thin.ply"
    write_mesh(path, thin_torus())
    for dt in (2e-4, 1e-4):
        out = summary("willmore-flow", path, "--flow", "mean-curvature", "--dt", dt)
        (time,) = re.findall(r"became singular at time (\S+):", out["results"]["stopped_because"])
        assert float(time) == pytest.approx(out["results"]["times"][-1], rel=1e-5)
        assert float(time) == pytest.approx(0.1**2 / 2, abs=5 * dt)
        assert not any("mollified" in w for w in out["warnings"])
        assert any("became singular" in w for w in out["warnings"])


def test_balls_go_on_after_their_neck_has_pinched_off(tmp_path, summary):
    """Faces of the neck that have lost their area are no warnings."""
    ball = shapes.icosphere(3)
    x = np.array(ball.points)
    x *= np.stack([0.25 + 0.75 * x[:, 2] ** 2] * 2 + [np.full(len(x), 2.5)], axis=1)
    path = tmp_path / "dumbbell.ply"
    write_mesh(path, ball.moved(x))
    out = summary("willmore-flow", path, "--flow", "mean-curvature", "--dt", 1e-3)
    assert out["results"]["stopped_because"] == "the surface collapsed"
    assert not any("mollified" in w for w in out["warnings"])


@pytest.mark.parametrize("radius, closes", [(1.5, True), (4.0, False)])
def test_the_hole_of_a_torus_that_closes_is_reported_with_time_and_place(radius, closes, caplog):
    """A thinner torus shrinks to its circle, with a hole to the end."""
    centre = np.array([3.0, -2.0, 1.0])
    torus = shapes.torus(36, 24, radius, 1.0)
    with caplog.at_level(logging.WARNING, "ddgcli"):
        moved = torus.moved(torus.points + centre)
        ddg.willmore_flow(moved, "mean-curvature", step=0.01, duration=0.55).finish()
    assert ("has closed" in caplog.text) == closes
    if closes:
        time, place = re.search(r"has closed by time (\S+) \(near ([^)]*)\)", caplog.text).groups()
        assert np.linalg.norm(np.array(place.split(), dtype=float) - centre) < 0.01
        assert 0.3 < float(time) < 0.5  # 0.37 with short steps


@pytest.mark.parametrize("words", [("willmore-flow", "ellipsoid.ply"), ("curve-flow", "ellipse.csv")])
def test_a_step_of_a_flow_that_does_not_divide_the_run_is_refused(words, run):
    words = (words[0], ROOT / "sample_meshes" / words[1], "--duration", 1e-3, "--dt")
    refused = run(*words, 5)
    assert refused.exit_code == 2
    assert "--dt: 5 is longer than the duration of 0.001; give 0.001 or less" in refused.stderr
    for step in (1e-310, 1e-20):  # an internal error, and a run of 1e17 steps
        refused = run(*words, step)
        assert refused.exit_code == 2
        assert f"--dt: {step:g} is too short for a duration of 0.001; give 1e-12 or more" in refused.stderr
    assert run(*words, 0.001).exit_code == 0


@pytest.mark.parametrize("radius, dt", [(0.3, 1e-3), (0.01, 1e-2), (1e-4, 1e-2)])
def test_a_sphere_goes_on_as_alone_after_a_smaller_one_has_collapsed(radius, dt, tmp_path, summary):
    """The small one shrinks by r^2 = r0^2 - 4 t, and takes no part from its end on."""
    ball = shapes.icosphere(2)
    alone, both = tmp_path / "alone.ply", tmp_path / "both.ply"
    write_mesh(alone, ball)
    write_mesh(both, two_components(ball, ball.moved(radius * np.array(ball.points))))
    ends = []
    for path in (alone, both):
        out_path = tmp_path / "last.npz"
        words = ("--flow", "mean-curvature", "--dt", dt, "--duration", 0.1, "-o", out_path)
        out = summary("willmore-flow", path, *words)
        with np.load(out_path) as last:
            ends.append((out["results"], last["points"]))
        assert not out["warnings"]
    (single, sphere), (pair, spheres) = ends
    assert np.abs(spheres[: len(sphere)] - sphere).max() < 1e-11
    assert np.abs(spheres[len(sphere) :] - [3.0, 0.0, 0.0]).max() < radius
    assert pair["energy"][-1] == pytest.approx(single["energy"][-1], rel=1e-11)
    assert pair["area"] == pytest.approx(single["area"], rel=1e-11)
    end, collapse = pair["collapse_times"]
    assert end is None and collapse == pytest.approx(radius**2 / 4, abs=5 * dt)
    assert pair["times"][-1] == pytest.approx(0.1, rel=1e-12)


def test_a_torus_that_has_become_a_circle_does_not_end_the_flow_of_a_sphere(tmp_path, summary):
    path = tmp_path / "both.ply"
    write_mesh(path, two_components(shapes.icosphere(2), thin_torus()))
    out = summary("willmore-flow", path, "--flow", "mean-curvature", "--dt", 2e-4, "--duration", 0.02)
    end, singular = out["results"]["collapse_times"]
    assert end is None and singular == pytest.approx(0.1**2 / 2, abs=1e-3)
    assert out["results"]["times"][-1] == pytest.approx(0.02, rel=1e-12)
    assert any("1 component became singular" in w for w in out["warnings"])
    assert out["results"]["area"] == pytest.approx(4 * np.pi * (1 - 4 * 0.02), rel=0.03)


def test_steps_by_the_larger_constant_are_counted(monkeypatch):
    """They replace steps that would raise the energy; their error hides the second order of a sequence."""
    constants, after = [], Flow._after

    def recorded(self, at, dt, gamma):
        constants.append(gamma)
        return after(self, at, dt, gamma)

    monkeypatch.setattr(Flow, "_after", recorded)
    for steps, expected in ((4, 1), (2, 0)):
        constants.clear()
        duration = 0.1 if expected else 0.02
        last = run_flow(ellipsoid(3), FlowOptions(timed=True), step=duration / steps, steps=steps)[0][-1]
        assert last.scalar["large_constant_steps"] == expected == sum(gamma > 1.0 for gamma in constants)
