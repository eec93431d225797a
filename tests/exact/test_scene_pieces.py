"""Units, expressions, shapes and the line index of scenes."""

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ddgcli.io.scene_file import parse_scene
from ddgcli.scenes.expressions import evaluate, parse
from ddgcli.scenes.materials import MATERIALS, filled
from ddgcli.scenes.shapes import CylinderSide, Grid, cylinder_mesh, grid_mesh, periodic_grid, rotation_matrix
from ddgcli.scenes.units import parse_quantity


@pytest.mark.parametrize("text, unit, value", [
    ("0.4 mm", "m", 4e-4), ("70 GPa", "Pa", 7e10), ("1 kg/m^2", "kg/m^2", 1.0), ("300 g/m2", "kg/m^2", 0.3),
    ("9.81 m/s^2", "m/s^2", 9.81), ("-5", "m", -5.0), ("2e3 N/m", "N/m", 2e3), ("180 deg", "rad", math.pi),
    ("1 MPa", "N/m^2", 1e6), ("3 min", "s", 180.0), ("5 kHz", "1/s", 5e3), ("1 N mm", "N m", 1e-3),
    ("12 in", "m", 0.3048), ("1.5 1/s", "1/s", 1.5), (2, "m", 2.0), ("50", "", 50.0), ("10 µm", "m", 1e-5),
    ("1.5 cm", "m", 0.015), ("2 dm", "m", 0.2), ("5 nm", "m", 5e-9), ("7 um", "m", 7e-6),
])  # fmt: skip
def test_quantities_are_converted_exactly(text, unit, value):
    assert parse_quantity(text, unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize("text, unit, message", [
    ("1 s", "m", "does not fit"), ("1 mmm", "m", "unknown unit"), ("one", "m", "number"),
    (True, "m", "true/false"), ([1], "m", "array"), ("1 m", "", "none"), (float("inf"), "m", "finite"),
    ("1e999 m", "m", "finite"), ("", "m", "number"),
    ("1 m^x", "m", "unit"), ("1 km^400", "m", "floating-point range"), (10**400, "m", "finite"),
    ("1 m^" + "9" * 5000, "m", "unit"),
])  # fmt: skip
def test_wrong_quantities_are_refused(text, unit, message):
    with pytest.raises(ValueError, match=message):
        parse_quantity(text, unit)


X = {"x": np.array([0.5, -1.0]), "y": np.array([2.0, 3.0]), "z": np.array([-1.0, 0.25])}


@pytest.mark.parametrize("text, value", [
    ("5*z", 5 * X["z"]), ("x^2 + y**2", X["x"] ** 2 + X["y"] ** 2),
    ("-sin(pi*x)/2", -np.sin(np.pi * X["x"]) / 2),
    ("where(z < 0, 1, 2)", np.array([1.0, 2.0])), ("3", np.array([3.0, 3.0])), ("max(x, y) % 2", X["y"] % 2),
    ("exp(-(x^2+y^2)/0.1)", np.exp(-(X["x"] ** 2 + X["y"] ** 2) / 0.1)),
    ("atan2(y, x)", np.arctan2(X["y"], X["x"])),
])  # fmt: skip
def test_expressions_have_their_value(text, value):
    assert np.allclose(evaluate(text, X), value, rtol=1e-15, atol=0)


@pytest.mark.parametrize("text", [
    "__import__('os').system('true')", "x.__class__", "[1]", "lambda: 1", "open('f')", "x if y else z",
    "x; y",
    "", "sin", "sin(x, y)", "sin(x=1)", "f'{x}'", "x and y", "1 < x < 2", "9**9**9**9", "10**400", "1/0",
    "log(-1)", "-" * 3000 + "x", "x" * 3000, "a", "True", "'x'", "1j", "x @ y", "~x",
    "x := 1", "x # and nothing more", "x**0.5", "0/0", "1e400", "nan", "inf", "-" * 1900 + "x",
    "(" * 400 + "x" + ")" * 400, "sin(*[x])", "x.real", "().__class__", "x[0]", "print(x)",
    "x if 1 else 2", "9**9**9", "x//2",
])  # fmt: skip
def test_expressions_that_are_refused(text):
    with pytest.raises(ValueError):
        evaluate(text, X)


@pytest.mark.parametrize(
    ("text", "remedy"),
    [("10 mm/s", "0.01"), ("-9.81 m/s^2", "9.81"), ("x > 9.9 mm", "0.0099"), ("3 1/s", "3"), ("2 x", None),
     ("3 foo", None), ("2 t", None), ("100*x cm/s", "0.01*100*x"), ("1+y mm / s", "0.001*(1+y)"),
     ("(1+y) cm", "0.01*(1+y)"), ("9.81*x m/s^2", "9.81*x"), ("5*x foo", None), ("(1-y cm", None),
     ("2*x y", None), ("2*x t", None), ("2*x 3", None)],
)  # fmt: skip
def test_a_unit_in_an_expression_is_refused_with_the_number_to_write(text, remedy):
    with pytest.raises(ValueError) as refusal:
        evaluate(text, X)
    match = re.search(r"write (\S+) for '(.*)'", str(refusal.value))
    assert (match and match[1]) == remedy
    if match:
        evaluate(text.replace(match[2], match[1]), X)


@pytest.mark.parametrize(
    "text", ["9" * 1000, "x + " + "9" * 1500, "x." + "a" * 1000, "log(x - x)" + " + x" * 300]
)
def test_refusals_do_not_repeat_long_expressions(text):
    with pytest.raises(ValueError) as refusal:
        evaluate(text, X)
    assert len(str(refusal.value)) < 300


def test_refusals_of_unknown_names_suggest_the_nearest():
    with pytest.raises(ValueError, match="did you mean 'sqrt'"):
        parse("sqr(x)")


@settings(max_examples=60, deadline=None)
@given(st.text(alphabet="xyz0123456789+-*/()., sincoexp^<>", max_size=30))
def test_no_text_does_anything_but_a_number_or_a_value_error(text):
    try:
        value = evaluate(text, X)
    except ValueError:
        return
    assert value.shape == (2,) and np.isfinite(value).all()


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=60))
def test_no_text_breaks_the_scene_reader(text):
    from ddgcli.errors import SceneError

    try:
        parse_scene(text)
    except SceneError as error:
        assert "line" in str(error)


def test_every_key_has_the_line_where_it_is_written():
    text = """# a comment = with an equals sign
title = '''
[not.a.table]
fake = 1
'''
[time]
step = 1 # step = 2
nested = { a = 1, b = { c = 2 } }

[[object]]
name = "one"
[[object]]
name = "two"
grid = { size = [
  1,
  2,
], cells = [3, 4] }
[object.inner]
deep.key = 3
[effects]
[[effects.pin]]
a = 1
[[effects.pin]]
b = 2
"""
    lines = parse_scene(text).lines
    assert lines[("title",)] == 2
    assert lines[("time",)] == 6 and lines[("time", "step")] == 7
    assert lines[("time", "nested", "b", "c")] == 8
    assert lines[("object", 0, "name")] == 11 and lines[("object", 1, "name")] == 13
    assert lines[("object", 1, "grid", "cells")] == 17
    assert lines[("object", 1, "inner", "deep", "key")] == 19
    assert lines[("effects", "pin", 0, "a")] == 22 and lines[("effects", "pin", 1)] == 23
    assert ("fake",) not in lines and ("not", "a", "table") not in lines


@pytest.mark.parametrize("pattern", ["right", "left", "alternating", "cross"])
def test_grids_number_their_vertices_along_y_first(pattern):
    mesh = grid_mesh(Grid(size=[3, 2], cells=[6, 5], pattern=pattern))
    i, j = np.meshgrid(np.arange(7), np.arange(6), indexing="ij")
    assert np.allclose(mesh.points[i * 6 + j], np.stack([i / 2, 0.4 * j, 0 * i], axis=2))
    if pattern == "cross":
        i, j = np.meshgrid(np.arange(6), np.arange(5), indexing="ij")
        assert np.allclose(
            mesh.points[42 + i * 5 + j], np.stack([i / 2 + 0.25, 0.4 * j + 0.2, 0 * i], axis=2)
        )


def test_equilateral_grids_are_equilateral(caplog):
    """Whole triangles have angles of 60 degrees, those at the ends of the rows are halves of them."""
    mesh = grid_mesh(Grid(size=[3, 2], cells=[6, 5], pattern="equilateral"))
    height = 5 * 0.5 * np.sqrt(0.75)
    assert f"{height:.6g} m high, not 2 m" in caplog.text
    side = np.sort(mesh.side_length, axis=1)
    half = np.abs(side[:, 0] - 0.25) < 1e-12
    assert half.sum() == 10 and np.allclose(side[half], [0.25, 0.5 * np.sqrt(0.75), 0.5])
    assert np.allclose(side[~half], 0.5)
    assert 0.5 * np.linalg.norm(np.cross(mesh.side_vector[:, 0], mesh.side_vector[:, 1]), axis=1).sum() == (
        pytest.approx(3 * height)
    )
    caplog.clear()
    Grid(size=[3, height], cells=[6, 5], pattern="equilateral")
    grid_mesh(Grid(size=[3, round(height, 3)], cells=[6, 5], pattern="equilateral"))
    assert caplog.text == ""


def test_the_work_of_locating_keys_grows_with_the_length_of_the_scene(monkeypatch):
    """A value over thousands of rows is parsed once, not once a row."""
    import tomllib

    from ddgcli.io import scene_file

    parsed = [0]

    def counted(text, loads=tomllib.loads):
        parsed[0] += len(text)
        return loads(text)

    monkeypatch.setattr(scene_file.tomllib, "loads", counted)
    text = (
        "[effects]\npin = { vertices = [\n" + "0, # [\n" * 2000 + '1] }\nload = """x [\n""""\ngravity = 1\n'
    )
    lines = scene_file.key_lines(text)
    assert lines[("effects", "pin", "vertices")] == 2 and lines[("effects", "load")] == 2004
    assert lines[("effects", "gravity")] == 2006
    assert parsed[0] <= 2 * len(text)


@pytest.mark.parametrize("pattern", ["right", "left", "alternating", "cross", "equilateral"])
def test_grids_fill_their_rectangle(pattern):
    height = 5 * 0.5 * np.sqrt(0.75) if pattern == "equilateral" else 2
    mesh = grid_mesh(Grid(size=[3, height], cells=[6, 5], pattern=pattern))
    corners = mesh.points[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normal[:, 2] > 0).all()
    assert 0.5 * normal[:, 2].sum() == pytest.approx(3 * height)
    assert mesh.topology.is_manifold and mesh.topology.euler_characteristic == 1
    assert mesh.topology.referenced_vertex.all()


@pytest.mark.parametrize("pattern", ["right", "left", "alternating", "cross"])
@pytest.mark.parametrize("periodic, euler", [("xy", 0), ("x", 0), ("y", 0)])
def test_periodic_grids_are_flat(pattern, periodic, euler):
    from ddgcli.geometry.intrinsic import corner_angle, face_area

    flat = periodic_grid(Grid(size=[3, 2], cells=[6, 4], pattern=pattern, periodic=periodic))
    assert flat.topology.euler_characteristic == euler
    assert face_area(flat.side_length).sum() == pytest.approx(6.0)
    total = np.bincount(flat.faces.ravel(), weights=corner_angle(flat.side_length).ravel())
    assert np.allclose(total[~flat.topology.boundary_vertex], 2 * np.pi)


def test_cylinder_is_the_side_of_a_prism_with_outward_normals_however_it_lies():
    side = CylinderSide(start=[1, 2, 3], end=[1, 4, 3], radius=0.5, cells=[12, 3])
    mesh = cylinder_mesh(side)
    points = np.asarray(mesh.points)
    assert mesh.topology.boundary_loops == 2
    assert np.linalg.norm(points[:, [0, 2]] - [1, 3], axis=1) == pytest.approx(0.5)
    assert points.reshape(12, 4, 3)[..., 1] == pytest.approx(np.tile([2, 8 / 3, 10 / 3, 4], (12, 1)))
    corner = points[mesh.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 2
    assert (np.einsum("fi,fi->f", normal, corner.mean(axis=1) - [1, 3, 3]) > 0).all()
    assert np.linalg.norm(normal, axis=1).sum() == pytest.approx(2 * 12 * np.sin(np.pi / 12))
    with pytest.raises(ValueError, match="even number around"):
        CylinderSide(start=[0, 0, 0], end=[0, 0, 1], radius=1, cells=[5, 3])


def test_the_integrator_of_the_command_line_leaves_the_parameters_of_the_scene_s_behind():
    from ddgcli.errors import SceneError
    from ddgcli.models.shell.scene import KIND
    from ddgcli.scenes.scene import resolve

    text = """[time]
integrator = "{}"
gamma = 0.6
[[object]]
role = "shell"
material = "felt"
grid = {{ size = [1, 1], cells = [1, 1] }}
"""
    newmark = parse_scene(text.format("newmark"))
    assert resolve(newmark, KIND, {"integrator": "newmark"}).time.gamma == 0.6
    assert not hasattr(resolve(newmark, KIND, {"integrator": "verlet"}).time, "gamma")
    with pytest.raises(SceneError, match="gamma"):
        resolve(parse_scene(text.format("verlet")), KIND, {"integrator": "implicit-euler"})


@pytest.mark.parametrize("time, warning", [
    ("duration = 1\nstep = 0.3", "ends at 0.9 s"),
    ("duration = 1\nstep = 0.1\nframe_every = 0.25", "frames come every 0.2 s"),
    ("duration = 1\nstep = 0.1\nframe_every = 0.01", "frames come every 0.1 s"),
    ("duration = 1\nstep = 0.1\nframe_every = 5", ""),
    ("duration = 0.7\nstep = 0.1\nframe_every = 0.3", ""),
    ("duration = 1\ntolerance = 0.1\nframe_every = 0.3", "frames come every 0.25 s"),
    ("duration = 1\ntolerance = 0.1\nframe_every = 0.25", ""),
])  # fmt: skip
def test_a_clock_that_misses_the_times_gives_a_warning(time, warning, caplog):
    from ddgcli.models.fluid.scene import KIND
    from ddgcli.scenes.scene import resolve

    resolve(parse_scene(f"[time]\n{time}\n[[object]]\nrole = 'fluid'\nsphere = {{}}\n"), KIND)
    assert len(caplog.messages) == bool(warning)
    assert warning in "".join(caplog.messages)


def test_material_names_set_the_missing_constants():
    steel = filled({"material": "steel", "density": None, "thickness": 1e-3, "young": None, "poisson": 0.25})
    assert steel["density"] == pytest.approx(7.85) and steel["young"] == 2.1e11 and steel["poisson"] == 0.25
    assert all(m["poisson"] <= 0.5 and m["young"] > 0 for m in MATERIALS.values())


def test_a_quarter_turn_about_z_maps_x_to_y():
    assert np.allclose(rotation_matrix((0, 0, 2), np.pi / 2) @ [1, 0, 0], [0, 1, 0])
