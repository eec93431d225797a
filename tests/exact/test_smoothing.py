"""Implicit smoothing: exact laws, the maximum principle, thin parts, and gates on what went wrong."""

import re

import numpy as np
import pytest
from scipy.sparse import csr_array

import ddgcli as ddg
from ddgcli.algorithms.laplacian import smooth as smooth_module
from ddgcli.algorithms.laplacian.implicit_step import MIN_MASS
from ddgcli.algorithms.laplacian.smooth import (
    BOX_TOLERANCE,
    MAX_WEIGHT,
    bounded_stiffness,
    latest_end,
    smooth,
)
from ddgcli.algorithms.laplacian.solve_tasks import solve_laplacian_tasks
from ddgcli.algorithms.laplacian.tasks import LaplacianTasks
from ddgcli.choices import SMOOTHING_FLOWS
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh


def dumbbell(handle):
    """Two unit balls on a handle of the given radius: mean curvature flow pinches it off."""
    z, u = np.linspace(-1, 1, 81), np.linspace(0, 2 * np.pi, 25)[:-1]
    height = 3.0 * z
    ball = np.sqrt(np.maximum(1 - (np.abs(height) - 2) ** 2, 0))
    radius = np.where(np.abs(height) < 2, np.maximum(ball, handle), ball)[1:-1]
    ring = np.stack([np.cos(u), np.sin(u)], axis=1)
    points = np.concatenate(
        [np.column_stack([r * ring, np.full(24, h)]) for r, h in zip(radius, height[1:-1])]
    )
    points = np.concatenate([points, [[0, 0, -3], [0, 0, 3]]])
    k, i = np.meshgrid(np.arange(len(radius) - 1), np.arange(24), indexing="ij")
    a, b = 24 * k + i, 24 * k + (i + 1) % 24
    side = np.stack([[a, b, a + 24], [b, b + 24, a + 24]]).transpose(2, 3, 0, 1).reshape(-1, 3)
    i, last, n = np.arange(24), 24 * (len(radius) - 1), 24 * len(radius)
    caps = [
        np.stack([np.full(24, n), (i + 1) % 24, i], axis=1),
        np.stack([np.full(24, n + 1), last + i, last + (i + 1) % 24], axis=1),
    ]
    return TriangleMesh.from_arrays(points, np.concatenate([side, *caps]))


def folded_back(mesh, seed=0):
    """Noise of half an edge: caps, needles and folds."""
    rng = np.random.default_rng(seed)
    return mesh.moved(mesh.points + 0.5 * mesh.side_length.mean() * rng.standard_normal(mesh.points.shape))


@pytest.mark.parametrize("flow", SMOOTHING_FLOWS)
def test_a_sphere_shrinks_by_its_law_at_first_order_in_the_step(flow):
    mesh = shapes.icosphere(3)
    errors = []
    for steps in (4, 8, 16):
        radius = np.linalg.norm(smooth(mesh, 0.1, steps=steps, flow=flow).mesh.points, axis=1).mean()
        errors.append(abs(radius - np.sqrt(1 - 0.4)))
    assert (np.log2(np.array(errors[:-1]) / errors[1:]) > 0.85).all()


@pytest.mark.parametrize("mesh", [shapes.random_sphere(200), shapes.catenoid(24, 12)], ids=["closed", "open"])
def test_a_step_of_the_flow_in_time_is_that_of_smoothing_with_cotangents(mesh):
    stretched = mesh.moved(mesh.points * [1.0, 1.0, 1.5])
    smoothed = smooth(stretched, 0.02, steps=2, operator="cotan").mesh.points
    flowed = ddg.willmore_flow(stretched, "mean-curvature", duration=0.02, step=0.01).finish().mesh.points
    assert np.abs(smoothed - stretched.points).max() > 1e-3
    assert np.abs(smoothed - flowed).max() < 1e-12


@pytest.mark.parametrize("flow", SMOOTHING_FLOWS)
@pytest.mark.parametrize("time", [1e-2, 1e4])
def test_no_point_leaves_the_box(flow, time):
    for mesh in (folded_back(shapes.icosphere(2)), folded_back(shapes.catenoid(24, 12)), dumbbell(0.1)):
        smoothed = smooth(mesh, time, steps=5, flow=flow)
        assert smoothed.box_growth <= 1e-13 and smoothed.in_box
        # rounding of MAX_WEIGHT against masses that are all MIN_MASS, with ten neighbours
        assert smoothed.residual < 10 * 1.1e-16 * MAX_WEIGHT / MIN_MASS


def test_thin_parts_leave_the_digits_of_the_rest():
    # before: weights around the handle of 1e13 and masses of 1e-40, residuals of 1e-3, points outside
    mesh = dumbbell(0.1)
    pinched = smooth(mesh, 0.1)
    assert pinched.collapsed > 100 and pinched.collapse_time > 0
    assert pinched.residual < 1e-9 and pinched.time == 0.1
    # the balls hardly notice the handle: the equator of each shrinks like a sphere of its own
    ball = np.abs(np.abs(mesh.points[:, 2]) - 2) < 0.05
    before, after = (np.hypot(*m.points[ball, :2].T).mean() for m in (mesh, pinched.mesh))
    assert abs(after - np.sqrt(before**2 - 0.4)) < 0.05
    assert smooth(mesh, 0.1, flow="conformalized").collapsed == 0


def test_weights_are_bounded_and_not_negative():
    mesh = folded_back(shapes.icosphere(2))
    flat = mesh.points.copy()
    flat[mesh.faces[0, 0]] = flat[mesh.faces[0, 1:]].mean(axis=0) + 1e-12
    L = bounded_stiffness(smooth_module.laplace_operator(mesh.moved(flat)))
    off = L - csr_array(np.diag(L.diagonal()))
    assert off.max() <= 0 and off.min() >= -MAX_WEIGHT
    assert np.abs(L @ np.ones(L.shape[0])).max() <= 1e-13 * L.diagonal().max()


def test_the_bounds_leave_ordinary_meshes_alone():
    laplace = smooth_module.laplace_operator(shapes.random_sphere(500))
    assert abs(bounded_stiffness(laplace) - laplace.stiffness).max() < 1e-13


def test_a_mesh_of_nothing_but_boundary_stays():
    triangle = TriangleMesh.from_arrays(np.eye(3), [[0, 1, 2]])
    for flow in SMOOTHING_FLOWS:
        smoothed = smooth(triangle, 1.0, flow=flow)
        assert np.array_equal(smoothed.mesh.points, triangle.points)
        assert smoothed.time == 1.0 and smoothed.residual == 0.0


@pytest.mark.parametrize("flow", SMOOTHING_FLOWS)
@pytest.mark.parametrize("time, steps", [(0.1, 10), (0.2, 10), (0.24, 10), (0.15, 1), (0.22, 1)])
def test_the_error_of_long_steps_is_that_of_the_law_of_spheres(flow, time, steps):
    """Of a sphere at time 0.24 a radius of 0.4 was left in place of 0.2, with no word about it."""
    smoothed = smooth(shapes.icosphere(3), time, steps=steps, flow=flow)
    error = 1 - 4 * np.pi * (1 - 4 * time) / smoothed.area[-1]
    assert np.isclose(smoothed.time_error, error, rtol=0.1, atol=0.01)


def test_steps_that_outlive_the_flow_are_not_converged(caplog):
    """A unit sphere vanishes at time 0.25."""
    report = solve_laplacian_tasks(shapes.icosphere(3), LaplacianTasks(smooth=0.26))
    assert not report.converged and report.accuracy["smooth_time_error"] == 1
    assert "the flow ends before time 0.26" in caplog.text and "use a shorter time" in caplog.text
    caplog.clear()
    report = solve_laplacian_tasks(shapes.icosphere(3), LaplacianTasks(smooth=0.2))
    assert report.converged and "use more than `smooth_steps=10`" in caplog.text
    caplog.clear()
    solve_laplacian_tasks(shapes.icosphere(3), LaplacianTasks(smooth=0.2, smooth_steps=60))
    assert not caplog.text


@pytest.mark.parametrize("time, steps", [(1e9, 10), (1.0, 10), (1.0, 1000)])
def test_the_time_at_which_a_surface_has_vanished_is_not_that_of_long_steps(time, steps, caplog):
    """Before, the end of the first step was stated: 1e8 of 1e9."""
    sphere = shapes.icosphere(3)
    assert latest_end(sphere) == pytest.approx(0.25)
    assert latest_end(shapes.catenoid(24, 12)) == np.inf
    report = solve_laplacian_tasks(sphere, LaplacianTasks(smooth=time, smooth_steps=steps))
    assert not report.converged and "the flow itself ends by time 0.25)" in caplog.text
    noise, shape = report.results["smooth_sensible_time"].values()
    assert f"({noise:.2g} removes noise, {shape:.2g} changes the shape)" in caplog.text


@pytest.mark.parametrize("flow", SMOOTHING_FLOWS)
@pytest.mark.parametrize("time", [100.0, 1e6, 1e8])
def test_a_surface_that_reaches_its_steady_state_has_no_error_whatever_the_time(flow, time, caplog):
    """Reported between two near rings: 46 % of the area, the end of the flow, a collapse of all vertices."""
    mesh = shapes.cylinder(24, 12, height=1.0)
    steady = smooth(mesh, time, steps=20, flow=flow).area[-1]
    report = solve_laplacian_tasks(mesh, LaplacianTasks(smooth=time, smooth_flow=flow))
    assert report.converged and not caplog.text
    assert report.results["smooth_collapsed_vertices"] == 0
    assert abs(report.results["smooth_area"]["after"] / steady - 1) < 1e-5
    assert report.accuracy["smooth_time_error"] < 1e-6


@pytest.mark.parametrize("steps", [1, 3])
def test_the_error_of_few_long_steps_to_a_steady_state_is_the_distance_to_it(steps):
    mesh = shapes.cylinder(24, 12, height=1.0)
    steady = smooth(mesh, 100.0, steps=20).area[-1]
    smoothed = smooth(mesh, 100.0, steps=steps)
    assert 0.3 < smoothed.time_error / (1 - steady / smoothed.area[-1]) < 3


@pytest.mark.parametrize("flow", SMOOTHING_FLOWS)
def test_a_flat_surface_stays_for_any_time_and_nothing_of_it_collapses(flow):
    mesh = shapes.grid(8, 8, pattern="alternating")
    report = solve_laplacian_tasks(mesh, LaplacianTasks(smooth=1e8, smooth_flow=flow))
    assert report.converged and report.results["smooth_collapsed_vertices"] == 0
    assert np.abs(report.vertex["displacement"]).max() < 1e-12


@pytest.mark.parametrize("height, time", [(1.4, 100.0), (2.0, 3.0), (2.0, 1e6), (4.0, 1.0), (4.0, 1e6)])
def test_a_neck_that_pinches_between_two_rings_is_not_converged(height, time):
    """Rings further apart than 1.33 radii have no steady state: the surface comes near one, and pinches."""
    mesh = shapes.cylinder(32, 16, height=height)
    assert not solve_laplacian_tasks(mesh, LaplacianTasks(smooth=time)).converged


def test_steps_that_remove_noise_have_no_error_in_time():
    mesh = shapes.icosphere(3)
    noise = 0.2 * np.random.default_rng(3).standard_normal((mesh.n_vertices, 1))
    mesh = mesh.moved(mesh.points * (1 + noise * mesh.side_length.mean()))
    for steps in (1, 10):
        assert smooth(mesh, mesh.side_length.mean() ** 2, steps=steps).time_error < 0.01


def test_a_bad_residual_is_not_converged(monkeypatch, caplog):
    mesh = shapes.icosphere(1)
    assert solve_laplacian_tasks(mesh, LaplacianTasks(smooth=0.01)).converged
    right = smooth_module.Dirichlet.solve
    monkeypatch.setattr(smooth_module.Dirichlet, "solve", lambda *a, **k: right(*a, **k) * (1 - 1e-2))
    report = solve_laplacian_tasks(mesh, LaplacianTasks(smooth=0.01))
    assert not report.converged and "smooth_residual" in caplog.text


def test_a_box_that_grows_is_not_converged(monkeypatch, caplog):
    mesh = shapes.icosphere(1)
    moved = smooth(mesh, 1e-9)

    def grown(*args, **options):
        return type(moved)(moved.mesh, moved.area, 0.0, 1e-9, box_growth=10 * BOX_TOLERANCE)

    monkeypatch.setattr(smooth_module, "smooth", grown)
    assert not solve_laplacian_tasks(mesh, LaplacianTasks(smooth=1e-9)).converged
    assert "bounding box grew" in caplog.text


def test_operators_that_break_the_maximum_principle_are_caught():
    # the consistent mass couples vertices, and short steps overshoot
    mesh = shapes.random_sphere(200)
    mesh = mesh.moved(mesh.points * [5, 1, 0.2])
    wrong = solve_laplacian_tasks(mesh, LaplacianTasks(mass="galerkin", smooth=1e-3, smooth_steps=1))
    assert wrong.accuracy["smooth_box_growth"] > 1e-5 and not wrong.converged
    right = solve_laplacian_tasks(mesh, LaplacianTasks(smooth=1e-3, smooth_steps=1))
    assert right.accuracy["smooth_box_growth"] == 0 and right.converged


def test_the_sensible_times_are_those_of_the_mesh():
    mesh = shapes.icosphere(3, radius=2.0)
    times = solve_laplacian_tasks(mesh, LaplacianTasks(smooth=1e-3)).results["smooth_sensible_time"]
    assert np.isclose(times["noise"], mesh.side_length.mean() ** 2)
    assert np.isclose(times["shape"], 16e-3 * np.pi, rtol=0.02)
    noisy = folded_back(shapes.icosphere(3))
    edge = solve_laplacian_tasks(noisy, LaplacianTasks(smooth=1e-3)).results["smooth_sensible_time"]["noise"]
    roughness = [np.std(np.linalg.norm(m.points, axis=1)) for m in (noisy, smooth(noisy, edge).mesh)]
    assert roughness[1] < 0.3 * roughness[0]


def test_a_surface_of_which_much_collapses_ends_with_exit_one(run, tmp_path):
    """Limbs that shrink to lines leave no surface: reported, and not counted as done."""
    path = tmp_path / "dumbbell.npz"
    write_mesh(str(path), AnnotatedMesh(dumbbell(0.1)))
    result = run("laplacian", path, "--smooth", 0.1, "--json")
    assert result.exit_code == 1
    assert "shrank to lines or points" in result.stderr
    assert run("laplacian", path, "--smooth", 0.1, "--smooth-flow", "conformalized").exit_code == 0


def test_the_warning_of_a_collapse_names_only_times_that_are_shorter_and_another_flow(run, tmp_path):
    """On a sharp cone of few faces the squared mean edge is longer than the time of the tip's collapse."""
    around, rings = 24, 6
    angle = 2 * np.pi * np.arange(around) / around
    ring = np.stack([0.05 * np.cos(angle), 0.05 * np.sin(angle), np.ones(around)], axis=1)
    points = np.concatenate([np.zeros((1, 3)), *(ring * (i + 1) / rings for i in range(rings))])
    j, i = np.arange(around), np.arange(rings - 1)[:, None]
    a, b = 1 + i * around + j, 1 + i * around + (j + 1) % around
    quads = np.stack([a, a + around, b + around, a, b + around, b], axis=-1).reshape(-1, 3)
    faces = np.concatenate([np.stack([0 * j, 1 + j, 1 + (j + 1) % around], axis=1), quads])
    path = tmp_path / "cone.npz"
    write_mesh(str(path), AnnotatedMesh(TriangleMesh.from_arrays(points, faces)))
    for flow in ("mean-curvature", "conformalized"):
        result = run("laplacian", path, "--smooth", 0.01, "--smooth-flow", flow, "--json")
        line = next(line for line in result.stderr.splitlines() if "shrank to lines or points" in line)
        collapse = float(line.split("after time ")[1].split(":")[0])
        named = [float(t) for t in re.findall(r"([0-9.e-]+) (?:removes|changes)", line)]
        assert named and max(named) < collapse
        assert ("--smooth-flow" in line) == (flow == "mean-curvature")
