"""Polygons become triangles of the same area and orientation, over the same vertices, with a note."""

import numpy as np
import pytest

from ddgcli.errors import InputError
from ddgcli.geometry.extrinsic import face_area_vector
from ddgcli.io.mesh_file import read_mesh
from ddgcli.io.readers.obj import read_obj
from ddgcli.io.readers.off import read_off
from ddgcli.io.readers.triangulate import triangulated


def shoelace(p):
    q = np.roll(p, -1, axis=0)
    return 0.5 * float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())


def star(n, seed=0):
    """A star-shaped polygon with n corners, mostly concave."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, n))
    return (rng.uniform(0.2, 1, n) * np.stack([np.cos(angle), np.sin(angle)])).T


def comb(teeth):
    """A comb: no fan from any corner covers it."""
    top = [(x + dx, y) for x in range(teeth) for dx, y in ((0.0, 1.0), (0.5, 0.1))]
    return np.array([(-1.0, 0.0), (teeth + 0.0, 0.0), *top[::-1]])


POLYGONS = {
    "star5": star(5),
    "star12": star(12, 1),
    "star60": star(60, 2),
    "comb3": comb(3),
    "comb12": comb(12),
}


@pytest.mark.parametrize("name", POLYGONS)
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("shift", [0.0, 1e3])
def test_triangulation_preserves_area_and_orientation(name, turned, shift):
    polygon = POLYGONS[name]
    n = len(polygon)
    loop = np.arange(n)[::-1] if turned else np.arange(n)
    tilt = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    points = np.column_stack([polygon, np.zeros(n)]) @ tilt.T + shift
    faces, owner = triangulated(points, loop, np.array([n]))
    assert faces.shape == (n - 2, 3) and (owner == 0).all()
    normal = tilt[:, 2] * (np.linalg.det(tilt)) * (-1 if turned else 1)
    p = points[faces]
    signed = 0.5 * np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]) @ normal
    rounding = 1e-12 * (1 + shift)
    assert signed.min() > -rounding
    assert signed.sum() == pytest.approx(abs(shoelace(polygon)), rel=rounding)


def test_no_flat_triangle_is_cut_where_a_corner_lies_on_a_diagonal():
    notched = np.array([(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 1, 0), (0, 2, 0.0)])
    for first in range(5):
        faces, _ = triangulated(notched, np.roll(np.arange(5), first), np.array([5]))
        p = notched[faces]
        doubled = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])[:, 2]
        assert doubled.sum() == pytest.approx(6) and doubled.min() > 0.9


def test_a_polygon_that_crosses_itself_still_gets_its_triangles():
    angle = 4 * np.pi / 7 * np.arange(7)  # a star of seven points, drawn in one stroke
    pentagram = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(7)])
    crossed = pentagram[[0, 2, 1, 3, 4, 5, 6]]
    for points in (pentagram, crossed):
        faces, owner = triangulated(points, np.arange(7), np.array([7]))
        assert faces.shape == (5, 3) and set(faces.ravel()) == set(range(7)) and (owner == 0).all()


def test_concave_quads_are_cut_at_the_reflex_corner():
    dart = np.array([[0, 0, 0], [2, -1, 0], [0.5, 0, 0], [2, 1, 0.0]])
    for shift in range(4):
        loop = np.roll(np.arange(4), shift)
        faces, _ = triangulated(dart, loop, np.array([4]))
        p = dart[faces]
        assert (np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])[:, 2] > 0).all()


def test_order_and_arrays_of_polygons(tmp_path):
    path = tmp_path / "a.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 3\nproperty list uchar int vertex_indices\nproperty int number\nend_header\n"
        "0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n3 0 1 2 7\n4 0 1 2 3 8\n3 1 4 2 9\n"
    )
    annotated = read_mesh(str(path))
    np.testing.assert_array_equal(annotated.face["number"], [7, 8, 8, 9])
    np.testing.assert_array_equal(annotated.input_face, [0, 1, 1, 2])
    assert "1 polygon of" in annotated.notes[0] and "face 1" in annotated.notes[0]


HEADS = {
    "off": "OFF\n6 3 0\n",
    "ply": "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 3\nproperty list uchar int vertex_indices\nend_header\n",
}


@pytest.mark.parametrize("suffix", HEADS)
def test_lists_of_different_lengths_are_read_and_wrong_ones_refused(tmp_path, suffix):
    path, points = tmp_path / f"a.{suffix}", "0 0 0\n1 0 0\n2 0 0\n2 1 0\n1 1 0\n0 1 0\n"
    path.write_text(HEADS[suffix] + points + "3 0 1 5\n4 1 2 3 4\n3 5 1 4\n")
    annotated = read_mesh(str(path))
    np.testing.assert_array_equal(annotated.input_face, [0, 1, 1, 2])
    np.testing.assert_array_equal(annotated.mesh.faces[[0, 3]], [[0, 1, 5], [5, 1, 4]])
    assert set(annotated.mesh.faces[1:3].ravel()) == {1, 2, 3, 4}
    for wrong in ("3 0 1 0.5\n", "3 0 1 -1\n", "3 0 1 6\n", "3 0 1 1e300\n", "-3 0 1 5\n", "9 0 1 5\n"):
        path.write_text(HEADS[suffix] + points + wrong + "4 1 2 3 4\n3 5 1 4\n")
        with pytest.raises(InputError):
            read_mesh(str(path))


def test_gmsh_quads_and_second_order_cells(tmp_path):
    import meshio

    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0, 0], [1, 0.5, 0], [0.5, 0.5, 0.0]])
    path = tmp_path / "a.vtu"
    meshio.Mesh(points, [("quad", [[0, 1, 2, 3]]), ("triangle6", [[0, 1, 2, 4, 5, 6]])]).write(path)
    annotated = read_mesh(str(path))
    assert face_area_vector(annotated.mesh)[:, 2].sum() == pytest.approx(1.5)
    assert any("corners" in note for note in annotated.notes)


def test_bricks_are_refused_with_a_remedy(tmp_path):
    import meshio

    points = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=float)
    for suffix in (".vtu", ".vtk"):
        path = tmp_path / f"a{suffix}"
        meshio.Mesh(points, [("hexahedron", [list(range(8))])]).write(path)
        with pytest.raises(InputError, match="hexahedron.*convert"):
            read_mesh(str(path))


@pytest.mark.parametrize("text, closed, n", [
    ("0 0\n1 0\n1 1\n", False, 3), ("0,0,1\n1,0,1\n0,1,1\n0,0,1\n", True, 3),
    ("x;y\n0;0\n1;0\n# end\n1;1\n", False, 3),
])  # fmt: skip
def test_csv_curves_are_closed_where_the_last_row_repeats_the_first(tmp_path, text, closed, n):
    path = tmp_path / "a.csv"
    path.write_text(text)
    ((curve, is_closed),) = read_mesh(str(path)).mesh.paths
    assert (len(curve), is_closed) == (n, closed)


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "the file is empty"),
        ("\n \n", "no rows"),
        ("1,2\n3\n", "line 2"),
        ("1,2\nx,3\n", "'x'"),
        ("1,2,3,4\n", "line 1: 4 columns; .* decimal points"),
        ("1,2\n3,4,5\n", "line 2: 3 columns where the first row has 2"),
        ("1,2\n", "one row"),
    ],
)
def test_bad_csv_names_the_line(tmp_path, text, message):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_mesh(str(path))


def test_obj_polylines_keep_their_order_and_closure(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nl 1 2 3 1\nv 5 5 5\nv 6 6 6\nl -2 -1\n")
    curves = read_mesh(str(path)).mesh
    assert [(path.tolist(), closed) for path, closed in curves.paths] == [
        ([3, 4], False),
        ([0, 1, 2], True),
    ]


@pytest.mark.parametrize("line, message", [
    ("f 1 2 9", "line 4: vertex 9 of a face is outside 1..3"), ("f 1 2 0", "line 4: vertex 0"),
    ("f 1 2 -4", "line 4"), ("f 1 2 x", "line 4: 'x'"), ("v 1 2", "line 4: a vertex needs three"),
])  # fmt: skip
def test_obj_errors_name_the_line(tmp_path, line, message):
    path = tmp_path / "a.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{line}\n")
    with pytest.raises(InputError, match=message):
        read_mesh(str(path))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_obj_lines_in_any_order_with_comments_spaces_and_texture_numbers_are_read(end):
    lines = [
        "# head", "v 0 0 0 # origin", "  v 1 0 0", "vt 0 0", "v\t0 1 0", "", "vt 1 0.5", "vn 0 0 1",
        "f 1/1 2/2/1 3//1", "v 1 1 0", "vt 0.25 0.75", "f -3/-1 4 -2/ # three", "g part", "f 1.0 2 4",
    ]  # fmt: skip
    raw = read_obj(end.join(lines).encode())
    assert raw.points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    assert raw.corners.reshape(-1, 3).tolist() == [[0, 1, 2], [1, 3, 2], [0, 1, 3]]
    nan = [np.nan, np.nan]
    uv = [[0, 0], [1, 0.5], nan, [0.25, 0.75], nan, nan, nan, nan, nan]
    assert raw.corner_uv is not None and np.array_equal(raw.corner_uv, uv, equal_nan=True)


def test_off_faces_with_and_without_colours_and_comments_are_read():
    points = b"0 0 0\n1 0 0 # x\n\n0 1 0\n1 1 0\n"
    text = b"OFF # cube\n\n4 3 0\n" + points + b"3 0 1 2\n4 0 1 3 2 0.5 0.5 1\n3 1 3 2 255 0 0\n"
    raw = read_off(text)
    assert raw.sizes.tolist() == [3, 4, 3] and raw.corners.tolist() == [0, 1, 2, 0, 1, 3, 2, 1, 3, 2]
    with pytest.raises(InputError, match="line 11: face 2 names vertex 7"):
        read_off(text.replace(b"3 1 3 2", b"3 1 7 2"))
    with pytest.raises(InputError, match="line 10: 'y' in a face"):
        read_off(text.replace(b"4 0 1", b"4 y 1"))
