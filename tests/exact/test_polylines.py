"""Curves of chapter 1: turning is topology for any closed polygon, length and curvature converge."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ddgcli.algorithms.curvature.polyline import measure_curve, measure_curves
from ddgcli.errors import MeshError
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh.curve import CurveSet


def closed_curve(points):
    points = np.column_stack([points, np.zeros((len(points), 3 - np.shape(points)[1]))])
    n = np.arange(len(points))
    return CurveSet(points, np.stack([n, np.roll(n, -1)], axis=1))


def open_curve(points):
    points = np.column_stack([points, np.zeros((len(points), 3 - np.shape(points)[1]))])
    return CurveSet.from_paths([points])


def circle(n, radius=1.0, turns=1, start=0.0):
    t = start + turns * 2 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(t), np.sin(t)], axis=1)


def figure_eight(n=41):
    t = 2 * np.pi * np.arange(n) / n
    return np.stack([np.sin(t), np.sin(2 * t)], axis=1)


def trefoil(n=200):
    t = 2 * np.pi * np.arange(n) / n
    return np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1)


@given(st.integers(0, 2**32 - 1), st.integers(0, 30))
@settings(max_examples=150, deadline=None)
def test_paths_are_the_chains_of_segments_open_ones_first(seed, n):
    rng = np.random.default_rng(seed)
    tail, head = (rng.permutation(n) for _ in range(2))
    if rng.random() < 0.5:
        tail = np.arange(n)
        head = np.roll(tail, -1)
    lines = np.stack([tail, head], axis=1)[rng.permutation(n)][: rng.integers(n + 1)]
    curves = CurveSet(np.zeros((n, 3)), lines)
    segments = []
    for path, closed in curves.paths:
        ends = np.append(path, path[0]) if closed else path
        segments += zip(ends[:-1].tolist(), ends[1:].tolist())
        assert not closed or path[0] == path.min()
    assert sorted(segments) == sorted(map(tuple, lines.tolist()))
    members = [point for path, _ in curves.paths for point in path.tolist()]
    assert sorted(members) == np.unique(lines).tolist()
    order = [(closed, path[0]) for path, closed in curves.paths]
    assert order == sorted(order)


def test_paths_are_computed_once():
    curves = closed_curve(circle(7))
    assert curves.paths is curves.paths


@pytest.mark.parametrize(
    ("points", "number"),
    [(circle(7), 1), (circle(7)[::-1], -1), (circle(11, turns=2), 2), (figure_eight(), 0), (circle(3), 1)],
)
def test_turning_numbers_of_the_notes(points, number):
    measured = measure_curves(closed_curve(points))
    assert measured.results["turning_number"] == number
    assert measured.results["total_signed_curvature"] == pytest.approx(2 * np.pi * number, abs=1e-12)
    assert measured.accuracy["turning_number_residual"] < 1e-14
    assert measured.results["total_curvature"] >= 2 * np.pi - 1e-12


@given(st.lists(st.tuples(*[st.integers(-50, 50)] * 2), min_size=3, max_size=12))
@settings(max_examples=60, deadline=None)
def test_any_closed_polygon_turns_by_a_whole_number(corners):
    points = np.array(corners, dtype=float)
    if np.ptp(points, axis=0).max() == 0:
        with pytest.raises(MeshError):
            measure_curves(closed_curve(points))
        return
    measured = measure_curves(closed_curve(points))
    assert measured.accuracy["turning_number_residual"] < 1e-13
    for values in measured.vertex.values():
        assert np.isfinite(values).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_fenchel_holds_for_every_closed_polygon_in_space(seed):
    points = np.random.default_rng(seed).normal(size=(8, 3))
    assert measure_curves(closed_curve(points)).results["total_curvature"] >= 2 * np.pi - 1e-12


def test_a_knot_has_more_than_twice_the_total_curvature_of_a_circle():
    knot = measure_curves(closed_curve(trefoil())).results
    assert knot["total_curvature"] > 4 * np.pi and not knot["unknotted_by_fary_milnor"]
    t = 2 * np.pi * np.arange(50) / 50
    wobble = np.stack([np.cos(t), np.sin(t), 0.1 * np.sin(2 * t)], axis=1)
    assert measure_curves(closed_curve(wobble)).results["unknotted_by_fary_milnor"]


def test_values_on_a_circle_and_the_gauss_map():
    v = measure_curves(closed_curve(circle(60, radius=2.0))).vertex
    assert v["turning_angle"] == pytest.approx(np.full(60, 2 * np.pi / 60))
    assert v["curvature"] == pytest.approx(np.full(60, 0.5), rel=1e-3)
    assert np.ptp(v["gauss_angle"]) == pytest.approx(2 * np.pi * 59 / 60)
    assert np.linalg.norm(v["gauss_map"], axis=1) == pytest.approx(np.ones(60))
    inward = -np.einsum("ij,ij->i", v["gauss_map"][:, :2], circle(60))
    assert inward.min() > 0.99, "a quarter turn left of a counterclockwise circle is inward"


def test_the_ends_of_an_open_curve_do_not_turn():
    measured = measure_curves(open_curve([[0, 0], [1, 0], [1, 1], [2, 1]]))
    assert measured.vertex["turning_angle"] == pytest.approx([0, np.pi / 2, -np.pi / 2, 0])
    assert measured.vertex["vertex_length"] == pytest.approx([0.5, 1, 1, 0.5])
    assert measured.results["length"] == 3 and measured.results["turning_number"] is None


@pytest.mark.parametrize("spacing", ["geometric", "parametric"])
def test_length_and_total_curvature_converge_in_both_mesh_sizes(spacing):
    # an ellipse: its parameter runs unevenly along its length
    def ellipse(n):
        t = 2 * np.pi * np.arange(n) / n
        if spacing == "geometric":
            fine = 2 * np.pi * np.arange(200 * n + 1) / (200 * n)
            step = np.hypot(3 * np.diff(np.cos(fine)), np.diff(np.sin(fine)))
            along = np.concatenate([[0], np.cumsum(step)])
            t = np.interp(along[-1] * np.arange(n) / n, along, fine)
        return np.stack([3 * np.cos(t), np.sin(t)], axis=1), t

    length = 13.364893220555258  # 4 a E(1 - b^2/a^2) for a = 3, b = 1
    error, curve = {}, {}
    for n in (40, 80, 160):
        points, t = ellipse(n)
        measured = measure_curves(closed_curve(points))
        error[n] = abs(measured.results["length"] - length)
        truth = 3 / (9 * np.sin(t) ** 2 + np.cos(t) ** 2) ** 1.5
        curve[n] = np.sqrt(np.mean((measured.vertex["curvature"] - truth) ** 2))
        assert measured.results["total_signed_curvature"] == pytest.approx(2 * np.pi, abs=1e-13)
        # over an arc the sum of turning angles tends to the turning of the tangent
        arc = measure_curves(open_curve(points[: n // 4 + 1])).results
        assert arc["longest_segment"] <= measured.results["longest_segment"]
    for kind in (error, curve):
        assert np.log2(kind[40] / kind[80]) > 1.8 and np.log2(kind[80] / kind[160]) > 1.8


def test_the_torsion_and_curvature_of_a_helix_converge():
    for hand in (1, -1):
        torsion_errors = []
        for n in (50, 200):
            t = np.linspace(0, 6, n)
            v = measure_curves(open_curve(np.stack([np.cos(t), np.sin(t), hand * 0.5 * t], axis=1))).vertex
            middle = slice(n // 4, -n // 4)
            torsion_errors.append(np.abs(v["torsion"][middle] - hand * 0.4).max())
            assert v["curvature"][middle] == pytest.approx(np.full(len(t[middle]), 0.8), rel=2e-2)
        assert torsion_errors[1] < torsion_errors[0] / 10


def test_a_plane_curve_with_an_inflection_has_no_torsion_in_space():
    t = np.linspace(-1, 1, 41)
    points = np.stack([t, t**3, np.full_like(t, 2.0)], axis=1)  # the plane z = 2
    arrays, _ = measure_curve(points, False, None)  # as a space curve
    assert np.abs(arrays["torsion"]).max() < 1e-7


def test_repeated_points_change_nothing():
    points = circle(9)
    doubled = np.repeat(points, [1, 3, 1, 1, 2, 1, 1, 1, 2], axis=0)
    plain, extra = measure_curves(closed_curve(points)), measure_curves(closed_curve(doubled))
    for name in ("length", "total_curvature", "turning_number"):
        assert extra.results[name] == pytest.approx(plain.results[name])
    arrays, _ = measure_curve(np.column_stack([doubled, np.zeros(len(doubled))]), True, np.eye(3)[2])
    assert np.sum(arrays["vertex_length"] > 0) == 9


def test_several_curves_are_measured_separately():
    one, two = circle(6), 3 * circle(8)[::-1] + 10
    points = np.column_stack([np.concatenate([one, two]), np.zeros(14)])
    lines = [[i, (i + 1) % 6] for i in range(6)] + [[6 + i, 6 + (i + 1) % 8] for i in range(8)]
    r = measure_curves(CurveSet(points, np.array(lines))).results
    assert [c["turning_number"] for c in r["curves"]] == [1, -1] and r["turning_number"] == 0
    assert r["length"] == pytest.approx(sum(c["length"] for c in r["curves"]))


@pytest.mark.parametrize("scale", [1e-8, 1e8])
def test_curves_of_every_size_and_place(scale):
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    base = measure_curves(closed_curve(figure_eight()))
    moved = measure_curves(closed_curve(scale * (figure_eight() @ turn.T + 3)))
    assert moved.vertex["curvature"] * scale == pytest.approx(base.vertex["curvature"], rel=1e-6, abs=1e-9)
    assert moved.results["length"] == pytest.approx(scale * base.results["length"])
    assert moved.results["turning_number"] == 0


def test_a_circle_of_full_precision_is_closed_and_a_short_gap_is_not(tmp_path):
    angle = np.linspace(0, 2 * np.pi, 101)  # sin(2 pi) is -2.4e-16, not 0
    for gap, closed in ((0.0, True), (1e-9, False)):
        table = np.stack([np.cos(angle), np.sin(angle) + gap * (angle > 6.2)], axis=1)
        np.savetxt(tmp_path / "circle.csv", table, delimiter=",")
        source = read_mesh(str(tmp_path / "circle.csv"))
        assert (source.mesh.n_vertices == 100) is closed
        assert bool(source.notes) is closed


def test_a_curve_without_a_turning_number_causes_no_warning(caplog):
    """There is none in space: it came with every curve such as the sample trefoil.obj."""
    assert measure_curves(closed_curve(circle(20))).accuracy["turning_number_residual"] < 1e-12
    tilted = np.column_stack([circle(20)[:, :2], np.sin(np.arange(20))])
    for curve in (open_curve(circle(20)), closed_curve(tilted)):
        measured = measure_curves(curve)
        assert measured.accuracy["turning_number_residual"] is measured.results["turning_number"] is None
    assert not caplog.records


SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("height", [0.0, 1.0, -3.7])
def test_a_square_in_any_axis_plane_turns_once_seen_from_the_positive_side(axis, height):
    points = np.roll(SQUARE + [0, 0, height], axis + 1, axis=1)  # cyclic: left stays left
    measures = measure_curves(closed_curve(points))
    assert measures.results["planar"] and measures.results["turning_number"] == 1
    assert measures.accuracy["turning_number_residual"] < 1e-12
    assert np.allclose(measures.vertex["gauss_angle"], np.pi / 2 * np.arange(1, 5))
    assert measure_curves(closed_curve(points[::-1])).results["turning_number"] == -1


def test_a_figure_eight_in_a_tilted_plane_and_a_bent_square():
    t = 2 * np.pi * np.arange(60) / 60
    tilt = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    circle = np.stack([np.cos(2 * t), np.sin(2 * t), 0 * t], axis=1)
    eight = np.stack([np.sin(t), np.sin(2 * t), 0 * t], axis=1)
    for points, number in ((circle[:30], 1), (circle, 2), (eight, 0)):
        wound = points * (1 + 0.1 * np.cos(t[: len(points)]))[:, None]
        results = measure_curves(closed_curve(1e3 * (wound @ tilt.T) + 7)).results
        assert results["planar"] and abs(results["turning_number"]) == number
    bent = SQUARE + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 1e-3], [0, 0, 0]])
    results = measure_curves(closed_curve(bent)).results
    assert not results["planar"] and results["turning_number"] is None


def test_curves_in_different_planes_each_have_a_turning_number():
    squares = np.concatenate([SQUARE, SQUARE[:, [2, 0, 1]] + 5])
    ring = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    results = measure_curves(CurveSet(squares, np.concatenate([ring, ring + 4]))).results
    assert [one["turning_number"] for one in results["curves"]] == [1, 1]
    assert results["turning_number"] is results["total_signed_curvature"] is None
    space = np.concatenate([SQUARE, SQUARE + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 1], [0, 0, 0]])])
    results = measure_curves(CurveSet(space, np.concatenate([ring, ring + 4]))).results
    assert [one["turning_number"] for one in results["curves"]] == [1, None]
    assert results["turning_number"] is None and not results["planar"]


def test_sums_over_curves_in_parallel_planes_do_not_depend_on_the_axes():
    """The axes that two planes are seen from differ where rounding tilts them at a normal of (1, 0, -1)."""
    ring, turn = np.array([[0, 1], [1, 2], [2, 3], [3, 0]]), np.eye(3)[[1, 2, 0]]
    lines = np.concatenate([ring, ring[:, ::-1] + 4])
    for angle in np.radians([0.0, 44.9999, 44.99995, 45.0, 45.00005, 45.0001, 100.0, 225.0]):
        about_y = np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])
        first = SQUARE @ about_y.T
        tilted = SQUARE * 3 + [0, 0, 2] + 3e-5 * SQUARE[:, :1] * [0, 0, 1]
        for axes in (np.eye(3), turn, turn @ turn):
            points = np.concatenate([first, tilted @ about_y.T]) @ axes
            results = measure_curves(CurveSet(points, lines)).results
            assert results["turning_number"] == 0 and abs(results["total_signed_curvature"]) < 1e-9


def test_an_open_curve_in_space_is_neither_knotted_nor_unknotted():
    t = np.linspace(0, 3, 20)
    points = np.stack([np.cos(t), np.sin(t), t], axis=1)
    lines = np.stack([np.arange(19), np.arange(1, 20)], axis=1)
    assert measure_curves(CurveSet(points, lines)).results["unknotted_by_fary_milnor"] is None
