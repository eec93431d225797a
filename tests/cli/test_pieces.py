"""Surfaces in pieces: triangles that share positions but no vertices, as scans and STL in OBJ have them."""

import numpy as np
import pytest

from ddgcli.geometry.remedies import warn_of_pieces
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh


def in_pieces(mesh):
    return TriangleMesh.from_arrays(
        mesh.points[mesh.faces.ravel()], np.arange(mesh.faces.size).reshape(-1, 3)
    )


def beside(a, b):
    faces = np.concatenate([a.faces, b.faces + a.n_vertices])
    return TriangleMesh.from_arrays(np.concatenate([a.points, b.points]), faces)


@pytest.mark.parametrize("words", [("curvature",), ("laplacian", "--eigen", 2), ("hodge",)])
def test_triangles_of_their_own_have_a_warning_whose_remedy_joins_them(words, run, summary, tmp_path):
    """All curvatures were 0, the Betti numbers those of 80 disks, in silence."""
    path, welded = tmp_path / "soup.obj", tmp_path / "soup-repaired.ply"
    write_mesh(str(path), AnnotatedMesh(in_pieces(shapes.icosphere(1))))
    (warning,) = [w for w in summary(words[0], path, *words[1:])["warnings"] if "pieces" in w]
    assert warning.startswith("80 of 80 components have boundary vertices at equal positions")
    assert "--weld" in warning
    assert run("repair", path, "--weld", "-o", welded).exit_code == 0
    assert not [w for w in summary(words[0], welded, *words[1:])["warnings"] if "pieces" in w]


@pytest.mark.parametrize("kind", ["pages of a book", "a bow tie"])
def test_a_weld_that_undoes_a_split_is_no_remedy(kind, run, tmp_path):
    """--spread-vector advised --split-fans, and on its result the run advised --weld, which undoes it."""
    path, split = tmp_path / "mesh.npz", tmp_path / "split.npz"
    angle = np.arange(3) * 2 * np.pi / 3
    if kind == "a bow tie":
        points = [[0, 0, 0], [1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]]
        faces = [[0, 2, 1], [0, 3, 4]]
    else:
        points = [[0, 0, z] for z in (0, 1)] + [[np.cos(a), np.sin(a), 0] for a in angle]
        faces = [[0, 1, page] for page in (2, 3, 4)]
    write_mesh(
        str(path), AnnotatedMesh(TriangleMesh.from_arrays(np.array(points, dtype=float), np.array(faces)))
    )
    words = ("--source", 2, "--spread-vector", "1,1,0")
    refused = run("geodesic", path, *words)
    assert refused.exit_code == 2 and "--split-fans" in refused.stderr
    assert run("repair", path, "--split-fans", "-o", split).exit_code == 0
    result = run("geodesic", split, *words)
    assert result.exit_code == 0 and "reached" in result.stderr and "weld" not in result.stderr
    assert "weld" not in run("laplacian", split).stderr


GRID = shapes.grid(2, 2)
NEXT = GRID.moved(GRID.points + [1.0, 0.0, 0.0])
APART = GRID.moved(GRID.points + [1.5, 0.0, 0.0])
BOX = shapes.box(1, 1, 1)


@pytest.mark.parametrize(
    "mesh, n_pieces",
    [
        (beside(GRID, NEXT), "2 of 2"),
        (beside(beside(GRID, NEXT), BOX.moved(BOX.points + 9.0)), "2 of 3"),
        (beside(GRID, APART), ""),
        (beside(BOX, BOX.moved(BOX.points + [1.0, 0.0, 0.0])), ""),  # bodies that touch are whole
        (GRID, ""),
    ],
)
def test_components_count_as_pieces_where_their_boundaries_meet(mesh, n_pieces, caplog):
    warn_of_pieces(mesh)
    assert caplog.text.count("components have") == bool(n_pieces) and n_pieces in caplog.text
