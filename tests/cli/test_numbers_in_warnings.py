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


@pytest.mark.parametrize(
    "text, words, message",
    [
        (
            SQUARE[:32] + "f 1 2 3 4\n",
            (),
            "1 polygon of more than three corners triangulated",
        ),
        ("v 0 0 nan\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", (), "(1 such vertex)"),
        (
            "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 4 3\n",
            ("--path-to", 1),
            "1 face is oriented against the neighbours (first: face 1)",
        ),
    ],
)
def test_one_is_singular(run, tmp_path, text, words, message):
    path = tmp_path / "mesh.obj"
    path.write_text(text)
    assert message in run("geodesic", path, "--source", 0, *words).stderr
