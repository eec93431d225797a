"""The time of our readers grows with the file, whatever it holds, or the file is refused."""

import time

import numpy as np
import pytest

from ddgcli.errors import InputError
from ddgcli.io.mesh_file import read_mesh
from ddgcli.io.readers import triangulate
from ddgcli.io.readers.triangulate import triangulated

N = 100_000
TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n"
PLY = b"ply\nformat ascii 1.0\n"


def polygon(points) -> bytes:
    numbers = b" ".join(b"%d" % (k + 1) for k in range(len(points)))
    return b"".join(b"v %.9g %.9g 0\n" % tuple(p) for p in points) + b"f " + numbers


def ring(jitter):
    angle = np.linspace(0, 2 * np.pi, N, endpoint=False)
    radius = np.random.default_rng(0).uniform(1 - jitter, 1, N)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)


FILES = {  # name: bytes; each took minutes with a reader whose time grows with the square
    "corners_without_number.obj": TRIANGLE + b"f 1/1 2/1 3/1 /" + b"a" * 10 * N,
    "slashes.obj": TRIANGLE + b"f 1/1 2/1 3/1 " + b"/" * 10 * N,
    "digits.obj": TRIANGLE + b"f 1 2 " + b"3" * 10 * N,
    "empty_lines.obj": b"\n" * 10 * N + b"#",
    "spaces.obj": b" \n" * 10 * N + b"x",
    "continued.obj": TRIANGLE + b"f 1 2 " + b"\\\n" * 10 * N + b"3\n",
    "star.obj": polygon(ring(0.5)),
    "lists.ply": PLY + b"element face 1\nproperty " + b"list " * 10 * N + b"uchar int x\nend_header\n1 0\n",
    "elements.ply": PLY + b"element vertex 0\n" * N + b"end_header\n",
    "count.ply": PLY + b"element vertex " + b"1" * 10 * N + b"\nend_header\n",
    "brackets.wkt": b"(" * 10 * N,
    "elements.vtp": b"<VTKFile>" + b"<a>" * N,
}


@pytest.mark.timeout(120)
@pytest.mark.parametrize("name", FILES)
def test_a_line_a_header_or_a_polygon_of_any_length_takes_seconds(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(FILES[name])
    began = time.process_time()
    try:
        read_mesh(str(path))
    except InputError as error:
        assert len(str(error).replace(str(path), "")) < 300
    assert time.process_time() - began < 20  # below one; a square of the size takes minutes


def test_a_convex_polygon_of_many_corners_is_read(tmp_path):
    (tmp_path / "ring.obj").write_bytes(polygon(ring(0.0)))
    assert read_mesh(str(tmp_path / "ring.obj")).mesh.n_faces == N - 2


@pytest.mark.timeout(120)
def test_a_polygon_that_crosses_itself_everywhere_takes_one_pass(tmp_path):
    """Once the cube of its corners: 200 took 1.4 s, 2,000 did not end."""
    points = np.column_stack([np.random.default_rng(0).random((2000, 2)), np.zeros(2000)])
    began = time.process_time()
    faces, _ = triangulated(points, np.arange(2000), np.array([2000]))
    assert faces.shape == (1998, 3)
    assert time.process_time() - began < 20  # 0.5 s


@pytest.mark.parametrize("limit, value", [("MAX_TESTED_CORNERS", 20_000), ("MAX_CONCAVE_CORNERS", 300)])
def test_concave_polygons_are_refused_where_the_square_of_their_corners_is_too_large(
    monkeypatch, limit, value
):
    height = np.tile([1.0, 0.1], 200)  # a comb: every ear of its back is tested against all teeth
    comb = np.column_stack([np.arange(400), height, 0 * height])[::-1]
    points = np.vstack([[(-1.0, 0, 0), (400, 0, 0)], comb])
    sizes = np.full(4, len(points))
    corners = np.tile(np.arange(len(points)), 4)
    assert len(triangulated(points, corners, sizes)[0]) == 4 * 400
    monkeypatch.setattr(triangulate, limit, value)
    with pytest.raises(InputError, match="write the file with triangles"):
        triangulated(points, corners, sizes)
