"""Warnings agree with the numbers in them."""

import pytest

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\nf 1 3 4\n"


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["curvature"], "1 vertex belongs to no face of the surface"),
        (["laplacian"], "1 vertex belongs to no face (first: vertex 4)"),
        (["geodesic", "--source", "0"], "1 vertex belongs to no face; the distance there is inf"),
    ],
)
def test_one_vertex_without_a_face_belongs_to_none(summary, tmp_path, command, words):
    path = tmp_path / "square.obj"
    path.write_text(SQUARE)
    warnings = summary(command[0], path, *command[1:])["warnings"]
    assert any(words in warning for warning in warnings)
