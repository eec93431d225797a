"""Pictures and pages of tetrahedra show the values of the cells at the boundary."""

import json
import re

import numpy as np
import pytest

from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh, surface_arrays
from ddgcli.mesh.tet_mesh import TetMesh


@pytest.fixture
def cells(tmp_path):
    """A box of tetrahedra, every third inverted, with vectors and numbers on its cells."""
    box = shapes.box_tetrahedra(3, 2, 2)
    corners = box.tetrahedra.copy()
    corners[::3] = corners[::3, [1, 0, 2, 3]]
    mesh = TetMesh.from_arrays(box.points, corners)
    centre = mesh.points[corners].mean(axis=1)
    face = {"wind": np.cos(centre[:, [1, 2, 0]]), "height": centre[:, 2]}
    path = tmp_path / "cells.vtu"
    write_mesh(str(path), AnnotatedMesh(mesh, face=face))
    return path, mesh, face


def test_a_boundary_face_has_the_value_of_its_cell(cells):
    _, mesh, face = cells
    of_faces = surface_arrays(mesh, face)
    corners = mesh.tetrahedra[mesh.boundary_cell]
    assert all(set(side) <= set(cell) for side, cell in zip(mesh.boundary.faces, corners))
    assert np.array_equal(of_faces["height"], mesh.points[corners].mean(axis=1)[:, 2])


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (("hodge", "--field", "wind"), ("exact", "coexact", "harmonic")),
        (("info",), ("min_angle_degrees", "height", "wind")),
        (("repair", "--weld"), ("input_cell", "height")),
        (("laplacian", "--form-eigen", "2"), ("eigenform_vectors_000", "eigenform_vectors_001")),
    ],
)
def test_a_picture_shows_an_array_on_cells(run, tmp_path, cells, monkeypatch, words, names):
    from ddgcli.plots import array

    drawn = []
    monkeypatch.setattr(
        array, "draw_array", lambda path, mesh, name, values, **_: drawn.append((name, values))
    )
    path, mesh, face = cells
    for name in names:
        files = ("-o", tmp_path / "out.vtu", "--plot", tmp_path / "out.png")
        result = run(words[0], path, *words[1:], *files, "--show", name)
        assert result.exit_code == 0 and "shows another" not in result.stderr
        assert drawn[-1][0] == name and len(drawn[-1][1]) == mesh.boundary.n_faces
        if name in face:
            assert np.array_equal(drawn[-1][1], face[name][mesh.boundary_cell])


@pytest.mark.parametrize("is_solid", [True, False])
def test_a_picture_of_eigenforms_shows_the_first_of_them(run, tmp_path, cells, monkeypatch, is_solid):
    """It showed the sizes of the vertices."""
    from ddgcli.plots import array

    drawn = []
    monkeypatch.setattr(
        array, "draw_array", lambda path, mesh, name, values, **_: drawn.append((name, values))
    )
    path, mesh, _ = cells
    if not is_solid:
        path = tmp_path / "surface.ply"
        write_mesh(str(path), AnnotatedMesh(mesh.boundary))
    out = tmp_path / "out.vtu"
    result = run("laplacian", path, "--form-eigen", "1", "-o", out, "--plot", tmp_path / "out.png")
    assert result.exit_code == 0
    ((name, values),) = drawn
    forms = read_mesh(str(out)).face["eigenform_vectors_000"]
    assert name == "eigenform_vectors_000" and np.ptp(values) > 0
    assert np.allclose(values, forms[mesh.boundary_cell] if is_solid else forms)


def test_a_page_holds_the_arrays_on_cells(run, tmp_path, cells):
    path, _, face = cells
    page = tmp_path / "page.html"
    result = run("view", path, "-o", page, "--json")
    assert sorted(face) == json.loads(result.stdout)["results"]["arrays"]
    assert all(re.search(rf'"{name}"', page.read_text("utf-8")) for name in face)
