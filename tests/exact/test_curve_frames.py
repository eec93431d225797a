"""Frenet and Bishop frames, osculating circles and resampling of polylines."""

import numpy as np
import pytest

import ddgcli as ddg
from ddgcli.algorithms.curvature.curve_frames import curve_frames, resampled
from ddgcli.algorithms.curvature.polyline import measure_curves
from ddgcli.errors import MeshError, ParameterError
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh

RADIUS, PITCH = 1.3, 0.4
CURVATURE = RADIUS / (RADIUS**2 + PITCH**2)
TORSION = PITCH / (RADIUS**2 + PITCH**2)


def closed_curve(points):
    index = np.arange(len(points))
    return CurveSet(np.asarray(points, dtype=float), np.stack([index, np.roll(index, -1)], axis=1))


def open_curve(points):
    return CurveSet.from_paths([np.asarray(points, dtype=float)])


def helix(n):
    t = np.linspace(0, 9, n)
    return open_curve(np.stack([RADIUS * np.cos(t), RADIUS * np.sin(t), PITCH * t], axis=1)), t


def knot(n=240):
    t = 2 * np.pi * np.arange(n) / n
    x, y = np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t)
    return closed_curve(np.stack([x, y, -np.sin(3 * t)], axis=1))


def test_the_frames_of_a_helix_converge_with_order_two():
    errors = []
    for n in (60, 120, 240):
        curve, t = helix(n)
        arrays, results = curve_frames(curve)
        speed = np.hypot(RADIUS, PITCH)
        normal = -np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
        binormal = np.stack([PITCH * np.sin(t), -PITCH * np.cos(t), RADIUS + 0 * t], axis=1) / speed
        inner = slice(1, -1)
        # the Bishop frame turns against the Frenet frame by the torsion
        angle = np.unwrap(np.arctan2(
            (arrays["frenet_normal"] * arrays["bishop_2"]).sum(axis=1),
            (arrays["frenet_normal"] * arrays["bishop_1"]).sum(axis=1),
        )[inner])  # fmt: skip
        rate = np.diff(angle) / np.diff(arrays["arc_length"][inner])
        errors.append([
            np.abs(arrays["frenet_normal"] - normal)[inner].max(),
            np.abs(arrays["frenet_binormal"] - binormal)[inner].max(),
            np.abs(rate - TORSION).max(),
            np.abs(1 / arrays["osculating_radius"][inner] - CURVATURE).max(),
        ])  # fmt: skip
        assert results["bishop_holonomy"] == [None]
    errors = np.array(errors)
    assert (errors[0] < [0.2, 0.2, 0.02, 0.02]).all()
    small = errors[-1] < 1e-12  # exact by symmetry
    assert ((np.log2(errors[:-1] / errors[1:]) > 1.8) | small).all()


def test_frames_are_orthonormal_and_right_handed():
    arrays, _ = curve_frames(knot())
    for one, two in (("frenet_normal", "frenet_binormal"), ("bishop_1", "bishop_2")):
        frenet_frame = np.stack([arrays["frenet_tangent"], arrays[one], arrays[two]], axis=1)
        assert np.abs(frenet_frame @ frenet_frame.transpose(0, 2, 1) - np.eye(3)).max() < 1e-12
        assert np.abs(np.linalg.det(frenet_frame) - 1).max() < 1e-12


def test_the_holonomy_of_a_bishop_frame_is_minus_the_total_torsion_exactly():
    for n in (7, 60, 240):
        curve = knot(n)
        _, results = curve_frames(curve)
        gap = results["bishop_holonomy"][0] + measure_curves(curve).results["total_torsion"]
        assert abs(np.remainder(gap + np.pi, 2 * np.pi) - np.pi) < 1e-12


def test_the_frame_of_a_plane_curve_keeps_the_normal_of_the_plane():
    t = 2 * np.pi * np.arange(50) / 50
    normal = np.array([1.0, 2.0, 2.0]) / 3
    one = np.array([2.0, 1.0, -2.0]) / 3
    two = np.cross(normal, one)
    r = 1 + 0.3 * np.cos(3 * t)
    arrays, results = curve_frames(
        closed_curve((r * np.cos(t))[:, None] * one + (r * np.sin(t))[:, None] * two)
    )
    assert abs(results["bishop_holonomy"][0]) < 1e-12
    normal_component = arrays["bishop_1"] @ normal
    assert np.abs(normal_component - normal_component[0]).max() < 1e-12
    assert np.abs(np.abs(arrays["frenet_binormal"] @ normal) - 1).max() < 1e-12


def test_osculating_circles_of_points_on_a_circle_are_that_circle():
    t = np.sort(np.random.default_rng(0).uniform(0, 2 * np.pi, 30))
    points = np.stack([2 + 3 * np.cos(t), 3 * np.sin(t), 1 + 0 * t], axis=1)
    arrays, _ = curve_frames(closed_curve(points))
    assert np.abs(arrays["osculating_radius"] - 3).max() < 1e-9
    assert np.abs(arrays["osculating_centre"] - [2, 0, 1]).max() < 1e-9


def test_a_straight_curve_has_a_bishop_frame_but_no_frenet_normal():
    arrays, _ = curve_frames(open_curve([[0, 0, 0], [1, 1, 0], [3, 3, 0], [4, 4, 0]]))
    assert np.isinf(arrays["osculating_radius"]).all() and not arrays["frenet_normal"].any()
    assert np.abs(arrays["bishop_1"] - arrays["bishop_1"][0]).max() < 1e-14
    assert np.abs(arrays["bishop_1"] @ [1, 1, 0]).max() < 1e-14
    assert arrays["arc_length"] == pytest.approx(np.sqrt(2) * np.array([0, 1, 3, 4]))


def test_resampling_keeps_ends_and_spaces_points_evenly_by_arc_length():
    curve, _ = helix(400)
    even = resampled(curve, 57)
    assert np.array_equal(even.points[[0, -1]], curve.points[[0, -1]])
    arc = np.diff(even.point_arrays["arc_length"])
    assert np.ptp(arc) < 1e-13
    chord = np.linalg.norm(np.diff(even.points, axis=0), axis=1)
    assert (chord <= arc + 1e-13).all() and (chord > 0.98 * arc).all()
    ring = resampled(knot(), 80)
    assert np.array_equal(ring.points[0], knot().points[0]) and len(ring.lines) == 80
    assert ring.paths[0][1], "closed"
    polygon = resampled(closed_curve([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]), 16)
    assert np.abs(np.linalg.norm(np.diff(polygon.points, axis=0), axis=1) - 0.5).max() < 1e-14


def test_frames_that_do_not_exist_are_refused_with_their_points():
    with pytest.raises(MeshError, match="points 1 and 2 coincide"):
        curve_frames(open_curve([[0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 1, 0]]))
    with pytest.raises(MeshError, match="turns back at point 1"):
        curve_frames(open_curve([[0, 0, 0], [1, 0, 0], [0.5, 0, 0]]))
    with pytest.raises(ParameterError, match="not 2"):
        resampled(knot(), 2)
    with pytest.raises(MeshError, match="has no length"):
        resampled(open_curve([[1, 1, 1], [1, 1, 1]]), 5)


def test_the_command_writes_frames_of_the_resampled_curve(tmp_path, summary, run):
    curve, _ = helix(300)
    write_mesh(str(tmp_path / "helix.vtp"), AnnotatedMesh(curve))
    report = summary(
        "curvature", tmp_path / "helix.vtp", "--frames", "--resample", 120, "-o", tmp_path / "f.npz"
    )
    arrays = np.load(tmp_path / "f.npz")
    assert len(arrays["points"]) == 120 and report["results"]["bishop_holonomy"] == [None]
    assert np.abs(arrays["torsion"][5:-5] - TORSION).max() < 0.02
    assert np.abs(1 / arrays["osculating_radius"][1:-1] - CURVATURE).max() < 0.04
    library = ddg.curvature(curve, with_frames=True, resample=120)
    assert np.array_equal(library.vertex["bishop_1"], arrays["bishop_1"])
    write_mesh(str(tmp_path / "sphere.ply"), AnnotatedMesh(ddg.icosphere(1)))
    result = run("curvature", tmp_path / "sphere.ply", "--frames")
    assert result.exit_code == 2 and "--frames is for curves" in result.stderr
    with pytest.raises(ParameterError, match="belongs to curves"):
        ddg.curvature(ddg.icosphere(1), with_frames=True)


def test_the_picture_of_frames_shows_normals_and_binormals(run, tmp_path):
    pillow = pytest.importorskip("PIL.Image")
    t = np.linspace(0, 6, 40)
    path, colours = tmp_path / "helix.csv", {}
    np.savetxt(path, np.stack([np.cos(t), np.sin(t), 0.3 * t], axis=1), delimiter=",")
    for option in ((), ("--frames",)):
        picture = str(tmp_path / "helix.png")
        assert run("curvature", path, *option, "--plot", picture, "--size", "300x300", "-q").exit_code == 0
        r, g, b = np.moveaxis(np.asarray(pillow.open(picture).convert("RGB"), dtype=int), 2, 0)
        colours[option] = ((r > g + 60) & (r > b + 60)).sum(), ((b > r + 60) & (b > g + 30)).sum()
    assert all(more > before + 50 for more, before in zip(colours[("--frames",)], colours[()], strict=True))
