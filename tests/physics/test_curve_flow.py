"""Flows of curves: exact rates of circles and areas, kept quantities, scale, refused input, commands."""

import json
import re

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import ddgcli as ddg
from ddgcli.errors import MeshError
from ddgcli.io.mesh_file import write_mesh
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.models.curve import polygon
from ddgcli.models.curve.crossings import self_crossings
from ddgcli.models.curve.setup import CurveFlowOptions, build, schedule, without_repeated_points
from ddgcli.simulation.account import Account
from ddgcli.simulation.model import Schedule
from ddgcli.simulation.time_loop import evolve
from tests.cli.test_shell_resume import interrupted_after


def closed_curve(points):
    k = np.arange(len(points))
    return CurveSet.from_arrays(points, np.stack([k, np.roll(k, -1)], axis=1))


def ellipse(n=48, a=2.0, b=1.0, uneven=0.0, scale=1.0):
    t = 2 * np.pi * np.arange(n) / n
    t = t + uneven * np.sin(t)
    return closed_curve(scale * np.stack([a * np.cos(t), b * np.sin(t), 0 * t], axis=1))


def helix(n=40):
    t = np.linspace(0, 4 * np.pi, n)
    points = np.stack([np.cos(t), np.sin(t), 0.2 * t], axis=1)
    return CurveSet.from_arrays(points, np.stack([np.arange(n - 1), np.arange(1, n)], axis=1))


def flow_series(curves, dt, steps, **options):
    """Scalars of the first and last frame, and the last points."""
    _, model = build(curves, CurveFlowOptions(stop_at_rest=False, **options))
    first, *_, last = evolve({"curve": model}, Schedule(dt, steps, steps), Account())
    ends = [s.observations["curve"] for s in (first, last)]
    return ends[0].scalar, ends[1].scalar, ends[1].points


@pytest.mark.parametrize(
    "closed, needs", [(True, "a closed curve needs 3"), (False, "an open curve needs 2")]
)
def test_points_in_one_place_are_one_different_point(closed, needs):
    at = np.arange(4)
    curve = CurveSet(np.ones((4, 3)), np.stack([at, np.roll(at, -1)], axis=1)[: 4 if closed else 3])
    with pytest.raises(MeshError, match=f"has 1 different point; {needs}"):
        without_repeated_points(curve)


@pytest.mark.parametrize("kind", ["length", "area", "elastic"])
def test_gradients_equal_finite_differences(kind):
    curves = ellipse(11, uneven=0.4)
    x = curves.points + 0.05 * np.sin(7 * np.arange(33.0)).reshape(-1, 3) * [1, 1, kind != "area"]
    mesh = polygon.polygons(CurveSet(x, curves.lines))

    def value(y):
        shape = polygon.geometry(mesh, y)
        if kind == "area":
            return polygon.enclosed_area(mesh, y).sum()
        return shape.length.sum() if kind == "length" else polygon.elastic_energy(mesh, shape).sum()

    shape = polygon.geometry(mesh, x)
    gradient = {
        "length": lambda: polygon.length_gradient(mesh, shape),
        "area": lambda: polygon.area_gradient(mesh, x),
        "elastic": lambda: polygon.elastic_gradient(mesh, shape),
    }[kind]()
    direction = np.cos(3 * np.arange(33.0)).reshape(-1, 3)
    h = 1e-6
    slope = (value(x + h * direction) - value(x - h * direction)) / (2 * h)
    assert (gradient * direction).sum() == pytest.approx(slope, rel=1e-7)


def test_a_circle_shrinks_at_the_exact_rate_with_first_order_in_the_step():
    circle, errors = ellipse(64, 1.0, 1.0), []
    for steps in (5, 10):
        first, last, _ = flow_series(circle, 0.2 / steps, steps)
        exact = first["length"] * np.sqrt(1 - 0.4)
        errors.append(abs(last["length"] / exact - 1))
    assert errors[1] < 0.02
    assert 1.8 < errors[0] / errors[1] < 2.2


def test_the_area_of_any_simple_plane_curve_falls_by_two_pi_a_unit_of_time():
    errors = []
    for n, steps in ((24, 4), (48, 16)):
        first, last, _ = flow_series(ellipse(n), 0.2 / steps, steps)
        assert last["length_increases"] == 0 and last["turning_number"] == 1
        errors.append(abs((first["area"] - last["area"]) / (0.4 * np.pi) - 1))
    assert errors[1] < 0.02 and errors[0] / errors[1] > 3


def test_area_preserving_flow_keeps_the_area_and_ends_as_a_circle():
    start = ellipse(32, uneven=0.5)
    first, last, _ = flow_series(start, 0.1, 40, flow="area-preserving")
    assert abs(last["area"] / first["area"] - 1) < 1e-12
    assert last["length_increases"] == 0
    regular = 32 * np.tan(np.pi / 32) / np.pi  # isoperimetric ratio of the regular polygon
    assert last["length"] ** 2 / (4 * np.pi * last["area"]) == pytest.approx(regular, rel=1e-4)


def test_area_preserving_flow_keeps_the_area_where_a_loop_shrinks_away_and_points_are_spaced_anew():
    options = CurveFlowOptions(stop_at_rest=False, flow="area-preserving")
    _, model = build(limacon(200), options)
    states = list(evolve({"curve": model}, Schedule(2e-3, 60, 1), Account()))
    turning, area = (
        np.array([state.observations["curve"].scalar[name] for state in states])
        for name in ("turning_number", "area")
    )
    assert turning[-1] < turning[0]
    assert np.abs(area / area[0] - 1).max() < 1e-12


def test_elastic_flow_keeps_the_length_and_ends_at_the_energy_of_the_circle():
    first, last, _ = flow_series(ellipse(32), 0.1, 60, flow="elastic")
    assert abs(last["length"] / first["length"] - 1) < 1e-12
    assert last["elastic_energy"] < first["elastic_energy"] and last["energy_increases"] == 0
    assert last["elastic_energy"] == pytest.approx(4 * np.pi**2 / last["length"], rel=1e-3)


def test_a_circle_grows_freely_at_the_exact_rate_of_the_elastic_flow():
    first, last, _ = flow_series(ellipse(48, 1, 1), 0.01, 20, flow="elastic", length_penalty=0.0)
    assert last["length"] / first["length"] == pytest.approx((1 + 4 * 0.2) ** 0.25, rel=5e-3)


def test_a_circle_of_random_points_grows_at_the_exact_rate_of_the_elastic_flow():
    t = np.sort(np.random.default_rng(4).uniform(0, 2 * np.pi, 60))
    circle = closed_curve(np.stack([np.cos(t), np.sin(t), 0 * t], axis=1))
    first, last, _ = flow_series(circle, 0.02, 25, flow="elastic", length_penalty=0.0)
    assert first["longest_segment"] / first["shortest_segment"] > 30
    assert last["length"] == pytest.approx(2 * np.pi * 3**0.25, rel=0.02)


def test_redistribution_evens_the_spacing_and_leaves_the_circle():
    circle = ellipse(32, 1, 1, uneven=0.5)
    ratios = {}
    for redistribute in (True, False):
        _, last, points = flow_series(circle, 0.01, 20, redistribute=redistribute)
        ratios[redistribute] = last["longest_segment"] / last["shortest_segment"]
        radius = np.linalg.norm(points, axis=1)
        if redistribute:
            assert np.ptp(radius) < 0.02 * radius.mean()
    assert ratios[True] < 1.2 and ratios[False] > 2.5


def test_an_open_space_curve_becomes_the_segment_between_its_fixed_ends():
    curves = helix()
    _, last, points = flow_series(curves, 1.0, 60, redistribute=False)
    assert np.array_equal(points[[0, -1]], curves.points[[0, -1]])
    assert last["length"] == pytest.approx(np.linalg.norm(curves.points[-1] - curves.points[0]), rel=1e-6)
    assert last["length_increases"] == 0


def test_the_drift_of_an_area_that_cancels_is_relative_to_the_circle_of_the_length(tmp_path, summary):
    t = 2 * np.pi * np.arange(60) / 60
    eight = closed_curve(np.stack([np.sin(t), np.sin(t) * np.cos(t), 0 * t], axis=1))
    write_mesh(str(tmp_path / "eight.npz"), AnnotatedMesh(eight))
    words = ("--flow", "area-preserving", "--steps", 3, "--dt", 0.001)
    assert summary("curve-flow", tmp_path / "eight.npz", *words)["accuracy"]["area_drift"] < 1e-13


@pytest.mark.parametrize("flow, power", [("curvature", 2), ("area-preserving", 2), ("elastic", 4)])
@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_flows_are_covariant_under_scaling(flow, power, scale):
    _, one, x = flow_series(ellipse(24), 0.01, 3, flow=flow)
    _, other, y = flow_series(ellipse(24, scale=scale), 0.01 * scale**power, 3, flow=flow)
    assert np.abs(y / scale - x).max() < 1e-9
    assert other["length"] / scale == pytest.approx(one["length"], rel=1e-9)


def write_obj(path, *curves):
    lines, start = [], 1
    for points, closed in curves:
        lines += ["v " + " ".join(repr(float(v)) for v in p) for p in points]
        index = [*range(start, start + len(points)), *([start] if closed else [])]
        lines.append("l " + " ".join(map(str, index)))
        start += len(points)
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_command_stops_with_a_reason_when_every_curve_has_shrunk(tmp_path, summary):
    small, large = ellipse(16, 0.5, 0.5).points, ellipse(16, 1, 1).points + [5, 0, 1]
    path = write_obj(tmp_path / "two.obj", (small, True), (large, True))
    out = summary("curve-flow", path, "--dt", 0.005, "--steps", 200)["results"]
    assert out["stopped_because"] == "every curve has shrunk to a point"
    # the scheme r' = r / (1 + dt / r^2) needs ln(100) dt longer from r0 to r0 / 100, and ends on a step
    late = 0.005 * (np.log(100) + 1)
    assert out["collapse_times"] == pytest.approx([0.125, 0.5], abs=late)
    assert out["turning_number"] == 2 and np.isfinite(out["elastic_energy"]).all()


def test_a_trajectory_of_lines_opens_in_the_reader_of_vtk(tmp_path, summary):
    reader_module = pytest.importorskip("vtkmodules.vtkIOHDF")
    path, out = write_obj(tmp_path / "e.obj", (ellipse(16).points, True)), tmp_path / "e.vtkhdf"
    lengths = summary("curve-flow", path, "--dt", 0.01, "--steps", 4, "-o", out)["results"]["length"]
    reader = reader_module.vtkHDFReader()
    reader.SetFileName(str(out))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == len(lengths)
    reader.SetStep(len(lengths) - 1)
    reader.Update()
    data = reader.GetOutputDataObject(0)
    assert data.GetNumberOfLines() == 16 and data.GetNumberOfPolys() == 0
    points = np.array([data.GetPoint(i) for i in range(16)])
    assert np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).sum() == pytest.approx(lengths[-1])


def test_the_trajectory_reads_back_as_curves(tmp_path, summary):
    from ddgcli.io.trajectories.trajectory import Trajectory

    path, out = write_obj(tmp_path / "e.obj", (ellipse(16).points, True)), tmp_path / "e.vtkhdf"
    summary("curve-flow", path, "--dt", 0.01, "--steps", 3, "-o", out, "-o", tmp_path / "last.vtp")
    with Trajectory(str(out)) as whole:
        assert isinstance(whole.mesh, CurveSet) and len(whole.mesh.lines) == 16
        last = whole.points(whole.n_frames - 1)
    length = np.linalg.norm(last - np.roll(last, 1, axis=0), axis=1).sum()
    assert summary("curvature", tmp_path / "last.vtp")["results"]["length"] == pytest.approx(length, rel=1e-6)


def test_bad_input_is_refused_in_one_line(tmp_path, run):
    circle = ellipse(12, 1, 1).points
    two = write_obj(tmp_path / "two.obj", (circle[:2], True))
    point = write_obj(tmp_path / "point.obj", (np.ones((4, 3)), False))
    opened = write_obj(tmp_path / "open.obj", (circle, False))
    surface = tmp_path / "surface.obj"
    surface.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for path, *words in ((two,), (point,), (opened, "--flow", "area-preserving"), (surface,)):
        result = run("curve-flow", path, *words, "-o", tmp_path / "out.vtp")
        assert result.exit_code == 2 and len(result.stderr.splitlines()) == 1, result.stderr
        assert not (tmp_path / "out.vtp").exists()


def test_repeated_points_are_left_out():
    points = np.repeat(ellipse(12).points, 2, axis=0)
    assert without_repeated_points(closed_curve(points)).n_vertices == 12


def test_a_figure_eight_flows_without_error():
    t = 2 * np.pi * np.arange(40) / 40
    eight = closed_curve(np.stack([np.sin(t), 0.6 * np.sin(2 * t), 0 * t], axis=1))
    _, last, points = flow_series(eight, 0.005, 40)
    assert np.isfinite(points).all() and last["length_increases"] == 0


def oval(n, time):
    """Angenent's oval cos x = exp(time) cosh y, time < 0: a solution of curvature flow that shrinks "
    "to a point."""
    width = np.arccosh(np.exp(-time))
    s = 2 * np.pi * np.arange(n) / n
    # |x| <= arccos(exp(time)); points spread by the angle of an ellipse of the oval's axes
    x = np.arccos(np.exp(time)) * np.cos(s)
    y = np.arccosh(np.maximum(np.exp(-time) * np.cos(x), 1.0)) * np.sign(np.sin(s))
    assert np.abs(y).max() <= width * (1 + 1e-12)
    return closed_curve(np.stack([x, y, 0 * x], axis=1))


def test_the_oval_of_angenent_stays_one_and_the_error_falls_with_the_points():
    errors = []
    for n in (32, 64):
        curve = oval(n, -1.5)
        flow, model = build(without_repeated_points(curve), CurveFlowOptions(stop_at_rest=False))
        state, steps, duration = model.start, 2 * n, 0.75
        for k in range(steps):
            state = flow.advance(state, k * duration / steps, duration / steps)
        x, y, _ = (flow.centre + flow.scale * state.points).T
        level = np.cos(x) - np.exp(-0.75) * np.cosh(y)
        slope = np.hypot(np.sin(x), np.exp(-0.75) * np.sinh(y))
        errors.append(np.abs(level / slope).max())
    assert errors[0] < 0.04 and errors[1] < 0.6 * errors[0]


@pytest.mark.parametrize("weight", [2.0, 6.0])
def test_the_penalised_elastic_flow_ends_as_the_circle_of_radius_one_over_root_w(weight):
    flow, model = build(without_repeated_points(ellipse(30, 0.7, 0.5)), CurveFlowOptions(
        flow="elastic", length_penalty=weight
    ))  # fmt: skip
    state = model.start
    for k in range(200):
        state = flow.advance(state, 0.01 * k, 0.01)
        if flow.ending(state):
            break
    radius = np.linalg.norm(state.points - state.points.mean(axis=0), axis=1) * flow.scale
    assert np.ptp(radius) < 1e-3 * radius.mean()
    assert radius.mean() == pytest.approx(1 / np.sqrt(weight), rel=5e-3)


def test_one_huge_step_straightens_an_open_curve_with_and_without_redistribution():
    for redistribute in (True, False):
        flow, model = build(helix(), CurveFlowOptions(redistribute=redistribute, stop_at_rest=False))
        state = model.start
        for k in range(3):
            state = flow.advance(state, 1e3 * k, 1e3)
        chord = np.linalg.norm(state.points[-1] - state.points[0])
        assert flow.objective(state.points)[0] == pytest.approx(chord, rel=1e-6)
        assert state.increases[0] == 0


@pytest.mark.parametrize("flow", ["curvature", "area-preserving", "elastic"])
def test_a_resumed_flow_gives_the_frames_of_the_whole_run(flow):
    schedule, options = Schedule(0.005, 8, 2), CurveFlowOptions(flow=flow, stop_at_rest=False)
    snapshots = list(evolve({"curve": build(ellipse(24), options)[1]}, schedule, Account()))
    again = {"curve": build(ellipse(24), options)[1]}
    resumed = list(evolve(again, schedule, Account(), resume=(2, snapshots[2].checkpoint)))
    for name, values in snapshots[-1].checkpoint.items():
        assert np.array_equal(resumed[-1].checkpoint[name], values, equal_nan=True), name
    assert np.array_equal(
        resumed[-1].observations["curve"].points, snapshots[-1].observations["curve"].points
    )


def test_the_tolerance_of_steps_bounds_the_error_of_the_radius(tmp_path, summary):
    path, errors = write_obj(tmp_path / "circle.obj", (ellipse(24, 1.0, 1.0).points, True)), []
    for tolerance in (1e-2, 1e-3):
        words = ("--duration", 0.3, "--frame-every", 0.3, "--tolerance", tolerance)
        report = summary("curve-flow", path, *words)
        area = np.array(report["results"]["area"])
        errors.append(abs(area[-1] / area[0] - (1 - 2 * 0.3)))  # a regular polygon has r^2 = 1 - 2 t exactly
    assert 0 < errors[1] < 0.5 * errors[0] and errors[0] < 0.1


def test_a_picture_of_a_flow_is_written(tmp_path, summary):
    path = tmp_path / "ellipse.obj"
    write_obj(path, (ellipse(24).points, True))
    report = summary("curve-flow", path, "--steps", 6, "--plot", tmp_path / "flow.png", "--size", "400x300")
    assert (tmp_path / "flow.png").stat().st_size > 3000
    assert report["outputs"] == [str(tmp_path / "flow.png")]


def figure_of_eight(n=64):
    t = 2 * np.pi * (np.arange(n) + 0.5) / n
    return closed_curve(np.stack([np.sin(2 * t), 2 * np.cos(t), 0 * t], axis=1))


def limacon(n=90):
    """A loop inside a loop: turning number 2, one crossing."""
    t = 2 * np.pi * np.arange(n) / n
    r = 0.4 + np.cos(t)
    return closed_curve(np.stack([r * np.cos(t), r * np.sin(t), 0 * t], axis=1))


@pytest.mark.parametrize(
    "curves, expected",
    [(ellipse(), 0), (figure_of_eight(), 1), (figure_of_eight(63), 1), (limacon(), 1), (limacon(91), 1)],
)
def test_self_crossings_are_counted_in_any_plane(curves, expected):
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    for points in (curves.points, curves.points @ turn.T + 3.0):
        mesh = polygon.polygons(CurveSet(points, curves.lines))
        assert self_crossings(mesh, points).tolist() == [expected]


def test_self_crossings_equal_those_of_all_pairs():
    points = np.random.default_rng(0).normal(size=(60, 2))
    curves = closed_curve(np.column_stack([points, np.zeros(60)]))
    count = 0
    for i in range(60):
        for j in range(i + 2, 60 - (i == 0)):
            a, b, p, q = points[i], points[(i + 1) % 60], points[j], points[(j + 1) % 60]
            solution = np.linalg.solve(np.stack([b - a, p - q], axis=1), p - a)
            count += bool(((solution > 0) & (solution < 1)).all())
    assert self_crossings(polygon.polygons(curves), curves.points).tolist() == [count] and count > 100


def test_a_loop_that_vanishes_changes_crossings_and_turning_number(tmp_path, summary):
    path = write_obj(tmp_path / "limacon.obj", (limacon().points, True))
    result = summary("curve-flow", path, "--dt", 1e-3, "--duration", 0.24, "--frame-every", 0.02)
    crossings = result["results"]["self_crossings"]
    assert (crossings[0], crossings[-1]) == (1, 0) and len(crossings) == len(result["results"]["times"])
    assert result["accuracy"]["self_crossing_changes"] == 1 == result["accuracy"]["turning_number_changes"]
    assert any("changes at 1 frame: 1 at the start, 0 at the end" in text for text in result["warnings"])
    # the points of the loop do not hold the curve: from then on the area falls as that of a simple curve
    area = result["results"]["area"]
    assert (area[5] - area[-1]) / 0.14 == pytest.approx(2 * np.pi, rel=0.01)


@pytest.mark.parametrize("flow", ["curvature", "elastic"])
def test_a_command_that_is_interrupted_is_resumed_with_the_same_bits(tmp_path, run, monkeypatch, flow):
    """In this process; `tests/cli/test_kills.py` and `test_random_signals.py` end processes by signals."""
    path = write_obj(tmp_path / "e.obj", (ellipse(60).points, True))
    words = ("curve-flow", path, "--flow", flow, "--dt", "1e-5", "--steps", "30", "--frame-every", "5e-5")
    whole, broken = tmp_path / "whole.vtkhdf", tmp_path / "broken.vtkhdf"
    assert run(*words, "-o", whole, "-q").exit_code == 0
    partial = tmp_path / "broken.vtkhdf.part"
    with interrupted_after(monkeypatch, 3):
        assert run(*words, "-o", broken, "-q").exit_code == 130
    assert not broken.exists()
    with Trajectory(str(partial)) as trajectory:
        assert trajectory.n_frames == 3
    assert run(*words, "--resume", partial, "-q").exit_code == 0
    assert broken.exists() and not partial.exists()
    with Trajectory(str(whole)) as one, Trajectory(str(broken)) as other:
        assert one.n_frames == other.n_frames == 7 and np.array_equal(one.times, other.times)
        for k in range(7):
            assert np.array_equal(one.points(k), other.points(k))
            assert np.array_equal(one.vertex(k)["curvature"], other.vertex(k)["curvature"])
        for name, values in one.scalars.items():
            assert np.array_equal(values, other.scalars[name], equal_nan=True), name


def test_a_figure_of_eight_that_has_folded_onto_a_line_is_not_converged(tmp_path, run):
    t = np.linspace(0, 2 * np.pi, 61)
    points = np.column_stack([np.sin(t), np.sin(t) * np.cos(t)])
    points[-1] = points[0]
    path = tmp_path / "eight.csv"
    np.savetxt(path, points, delimiter=",", fmt="%.17g")
    call = ("curve-flow", path, "--dt", 6e-3, "--json", "--duration")
    early, late = run(*call, 0.06), run(*call, 0.2)
    assert early.exit_code == 0 and "folds" not in early.stderr
    assert late.exit_code == 1
    assert any("folds back on itself" in text for text in json.loads(late.stdout)["warnings"])


def test_long_steps_leave_points_at_even_distances(tmp_path, summary):
    t = np.linspace(0, 6 * np.pi, 90)
    helix = write_obj(tmp_path / "helix.obj", (np.column_stack([np.cos(t), np.sin(t), t / 15]), False))
    accuracy = summary("curve-flow", helix, "--flow", "elastic", "--steps", 100)["accuracy"]
    assert accuracy["spacing_ratio"][-1] < 1.5  # 20 by slides alone
    assert accuracy["energy_increases"] == 0


def test_an_arc_between_hinges_rests_as_the_buckled_column(tmp_path, summary):
    # chord / L = 2 E(m) / K(m) - 1, and the energy 16 K (E - (1 - m) K) / L of length L
    angle = np.linspace(0, np.pi / 2, 41)
    arc = write_obj(tmp_path / "arc.obj", (np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1), False))
    results = summary("curve-flow", arc, "--flow", "elastic")["results"]
    assert results["stopped_because"] == "at rest"  # 2000 steps were too few before
    length, chord = results["length"][0], np.sqrt(2)
    m = brentq(lambda m: 2 * ellipe(m) / ellipk(m) - 1 - chord / length, 1e-6, 0.9)
    energy = 16 * ellipk(m) * (ellipe(m) - (1 - m) * ellipk(m)) / length
    assert results["elastic_energy"][-1] == pytest.approx(energy, rel=1e-3)


def test_default_steps_resolve_the_time_in_which_a_thin_ellipse_vanishes():
    # of the length alone they were 40 times longer here, and the ellipse vanished at five times its time
    thin = ellipse(48, 1.0, 0.03)
    for kind, share in (("curvature", 5e-4), ("area-preserving", 4e-3)):
        dt = schedule(build(thin, CurveFlowOptions(flow=kind))[0], {}).dt
        assert dt == pytest.approx(share * 0.03, rel=0.01)  # of the squared radius of the circle of its area


def test_a_wrong_loss_of_area_is_a_warning(tmp_path, summary):
    thin = write_obj(tmp_path / "thin.obj", (ellipse(60, 1.0, 0.2).points, True))
    for dt, steps, wrong in ((2e-2, 2, True), (1e-3, 30, False)):
        result = summary("curve-flow", thin, "--dt", dt, "--steps", steps)
        assert (result["accuracy"]["area_rate_error"] > 0.1) == wrong
        assert any("area does not fall by 2 pi" in text for text in result["warnings"]) == wrong
    # where a loop vanishes the rate changes: the step in which it does is left out
    loop = write_obj(tmp_path / "limacon.obj", (limacon().points, True))
    result = summary("curve-flow", loop, "--dt", 4e-3, "--duration", 0.24)
    assert result["accuracy"]["turning_number_changes"] == 1
    assert result["accuracy"]["area_rate_error"] < 0.1  # with that step: 0.3


@pytest.mark.parametrize("scale, side", [(1.0, 1), (1e3, -1)])
def test_a_late_collapse_of_a_simple_curve_is_an_error_of_its_rate_of_area(tmp_path, summary, scale, side):
    """It vanishes at area / (2 pi), and the run may end before a second frame."""
    points = ellipse(60, 2.0, 1.0).points[::side] * scale
    area = 60 * np.sin(2 * np.pi / 60) * scale**2  # of the polygon
    path = write_obj(tmp_path / "ellipse.obj", (points, True))
    for dt, steps in ((0.1, None), (10.0, 3), (1e-3, None)):
        words = () if steps is None else ("--steps", steps)
        result = summary("curve-flow", path, "--dt", dt * scale**2, *words)
        (end,) = result["results"]["collapse_times"]
        error = result["accuracy"]["area_rate_error"]
        assert error == pytest.approx(1.0 - area / (2 * np.pi * end), abs=2e-3)
        assert any("area does not fall by 2 pi" in text for text in result["warnings"]) == (dt > 1e-3)


def test_a_loss_of_area_below_its_rounding_is_not_measured(tmp_path, summary):
    path = write_obj(tmp_path / "ellipse.obj", (ellipse(60, 2.0, 1.0).points, True))
    result = summary("curve-flow", path, "--dt", 1e-300, "--steps", 2)
    assert "area_rate_error" not in result["accuracy"] and result["warnings"] == []


def test_curves_of_both_orientations_have_a_rate_of_area(tmp_path, summary):
    points = ellipse(60, 1.0, 0.2).points
    path = write_obj(tmp_path / "two.obj", (points, True), (points[::-1] + [3.0, 0.0, 0.0], True))
    coarse = summary("curve-flow", path, "--dt", 2e-2, "--steps", 2)["accuracy"]["area_rate_error"]
    assert coarse > 0.1  # the areas, and their rates, cancel in sum


@pytest.mark.parametrize("flow, dt", [("area-preserving", 1e10), ("elastic", 1e300)])
def test_a_failure_of_a_huge_step_names_one_that_works(tmp_path, run, flow, dt):
    """A step that can be solved may leap over all changes, and fail the next time."""
    path = write_obj(tmp_path / "ellipse.obj", (ellipse(60, 2.0, 1.0).points, True))
    words = ("curve-flow", path, "--flow", flow, "--steps", 3, "--dt")
    failed = run(*words, dt)
    assert failed.exit_code == 1
    step = re.search(r"make the step (\S+) length", failed.stderr)[1]
    assert run(*words, step).exit_code == 0


def two_ellipses(tilt):
    """One inside the other, which runs the other way round, in planes at an angle (in degrees)."""
    outer, inner = ellipse(), ellipse(30, 0.5, 0.5)
    c, s = np.cos(np.radians(tilt)), np.sin(np.radians(tilt))
    points = np.concatenate([outer.points, inner.points[::-1] @ [[1, 0, 0], [0, c, s], [0, -s, c]]])
    return CurveSet(points, np.concatenate([outer.lines, inner.lines + 48]))


@pytest.mark.parametrize("tilt, has_sum", [(0, True), (180, True), (90, False), (30, False)])
def test_areas_are_summed_in_parallel_planes_alone_whatever_the_axes(tilt, has_sum, caplog):
    """Once the sum was that of the areas or their difference, as the file was turned."""
    curves, rng = two_ellipses(tilt), np.random.default_rng(3)
    area = 48 / 2 * 2 * np.sin(2 * np.pi / 48), 30 / 2 / 4 * np.sin(2 * np.pi / 30)  # of regular polygons
    total = area[0] + (1 if tilt == 180 else -1) * area[1]
    for _ in range(6):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        caplog.clear()
        end = ddg.curve_flow(curves.moved(curves.points @ turn), steps=1, step=1e-9).finish()
        each = [abs(one["area"]) for one in end.results["curves"]]
        assert each == pytest.approx(area, rel=1e-6)
        assert [abs(one["turning_number"]) for one in end.results["curves"]] == [1, 1]
        assert ("planes that are not parallel" in caplog.text) != has_sum
        if has_sum:
            assert abs(end.results["area"][0]) == pytest.approx(total, rel=1e-6)
            assert abs(end.results["turning_number"]) == (2 if tilt == 180 else 0)
        else:
            assert end.results["area"] is end.results["turning_number"] is None
