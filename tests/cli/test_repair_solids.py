"""Repairs of tetrahedra, and the messages of `info` and `hodge` that name these repairs."""

import re

import numpy as np
import pytest

from ddgcli.algorithms.repair.pipeline import RepairSteps
from ddgcli.algorithms.repair.solid import repair_solid
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.tet_mesh import TetMesh

CUBE = shapes.box_tetrahedra(3, 3, 3)
INNER = int(np.argmax(~np.isin(CUBE.tetrahedra, CUBE.boundary.faces).all(axis=1)))

INNER_VERTEX = int(np.argmax(~np.isin(np.arange(CUBE.n_vertices), CUBE.boundary.faces)))


def body(tmp_path, tetrahedra, points=CUBE.points):
    path = tmp_path / "body.vtu"
    write_mesh(str(path), AnnotatedMesh(TetMesh.from_arrays(points, tetrahedra)))
    return path


def in_pieces():
    """Each cell with vertices of its own."""
    return np.arange(CUBE.tetrahedra.size).reshape(-1, 4), CUBE.points[CUBE.tetrahedra.ravel()]


def remedy_of(message):
    """Flags of the repair that a message names."""
    return re.search(r"ddgcli repair \S+ ((?:--[a-z-]+ ?)+)-o", message).group(1).split()


@pytest.mark.parametrize("call", [["hodge"], ["laplacian"], ["laplacian", "--form-eigen", "2"], ["dec"]])
def test_a_cell_twice_is_refused_and_the_remedy_works(tmp_path, run, summary, call):
    """The Betti numbers were [1, 1, 0, 0], without a warning."""
    path = body(tmp_path, np.concatenate([CUBE.tetrahedra, CUBE.tetrahedra[INNER][None, [1, 0, 3, 2]]]))
    assert "drop-duplicates" in summary("info", path)["results"]["accepts"][call[0]]
    refused = run(call[0], path, *call[1:])
    assert refused.exit_code == 2 and f"of tetrahedra {INNER}, " in refused.stderr
    assert remedy_of(refused.stderr) == ["--drop-duplicates"]
    repaired = tmp_path / "repaired.vtu"
    report = summary("repair", path, *remedy_of(refused.stderr), "-o", repaired)
    assert report["results"]["changes"] == {"drop_duplicates": 1}
    assert call[0] not in report["results"]["refused_by"]
    assert np.array_equal(read_mesh(str(repaired)).mesh.tetrahedra, CUBE.tetrahedra)


def test_a_further_cell_on_an_inner_face_is_refused(tmp_path, run):
    a, b, c = CUBE.triangles[np.argmax(np.bincount(CUBE.cell_triangle.ravel()) == 2)]
    points = np.concatenate([CUBE.points, [[0.4, 0.3, 5.0]]])
    path = body(tmp_path, np.concatenate([CUBE.tetrahedra, [[a, b, c, len(CUBE.points)]]]), points)
    refused = run("hodge", path)
    assert refused.exit_code == 2 and "1 face has more than two tetrahedra" in refused.stderr
    assert "remove all but two at each" in refused.stderr


def folded(tmp_path):
    """A cube one vertex of which lies outside: cells around it overlap, with a volume of 35 for 27."""
    points = 3 * CUBE.points
    points[INNER_VERTEX] += 5.0
    return body(tmp_path, CUBE.tetrahedra, points)


def test_cells_that_overlap_have_a_warning_and_no_repair_makes_them_a_fluid(tmp_path, run, summary):
    """`laplacian` and `dec` took them without a word; after `--orient` no command refused them."""
    path, oriented = folded(tmp_path), tmp_path / "oriented.vtu"
    n_folds = summary("info", path)["results"]["folded_faces"]
    assert n_folds > 0
    for words in (["laplacian"], ["dec"], ["hodge"], ["laplacian", "--form-eigen", "2"]):
        assert f"{n_folds} faces have both tetrahedra on one side" in run(words[0], path, *words[1:]).stderr
    results = summary("repair", path, "--orient", "-o", oriented)["results"]
    assert "so that these overlap; move vertices" in results["refused_by"]["fluid-sim"]
    refused = run("fluid-sim", oriented, "--steps", "1", "-o", tmp_path / "x.vtkhdf")
    assert refused.exit_code == 2 and "both tetrahedra on one side" in refused.stderr


def test_repairs_of_flat_cells_that_lie_in_a_chain_end_with_a_body(tmp_path, run, summary):
    """The missing cells of two mirrored cubes: the remedy was `--split-fans`, then a weld, and so on."""
    box = shapes.box_tetrahedra(1, 1, 1)
    mirrored = box.points * [-1, 1, 1] + [2, 0, 0]
    turned = mirrored[:, [0, 2, 1]] * [1, 1, -1] + [0, 0, 1]
    path = body(
        tmp_path,
        np.concatenate([box.tetrahedra, box.tetrahedra + box.n_vertices]),
        np.concatenate([box.points, turned]),
    )
    warning = run("hodge", path).stderr.splitlines()[0]
    assert "1 flat gap between boundary faces" in warning
    assert remedy_of(warning) == ["--weld", "--drop-degenerate"]
    whole = tmp_path / "whole.vtu"
    changes = summary("repair", path, *remedy_of(warning), "-o", whole)["results"]["changes"]
    assert changes == {"weld": 4, "drop_degenerate": 1}
    assert summary("hodge", whole)["results"]["betti_numbers"]["absolute"] == [1, 0, 0, 0]
    assert not summary("hodge", whole)["warnings"]


@pytest.mark.parametrize("command", ["hodge", "laplacian"])
def test_a_body_in_pieces_has_a_warning_and_a_weld_joins_it(tmp_path, run, summary, command):
    path = body(tmp_path, *in_pieces())
    warned = run(command, path)
    assert warned.exit_code == 0 and "the body is in pieces" in warned.stderr
    welded = tmp_path / "welded.vtu"
    report = summary("repair", path, *remedy_of(warned.stderr), "-o", welded)
    mesh = read_mesh(str(welded))
    assert report["results"]["changes"]["weld"] == CUBE.tetrahedra.size - CUBE.n_vertices
    assert np.array_equal(mesh.mesh.points[mesh.mesh.tetrahedra], CUBE.points[CUBE.tetrahedra])
    assert "pieces" not in run(command, welded).stderr


def test_cells_that_a_weld_inverts_are_oriented():
    """Their volumes were those before the weld."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.3, 0.3, -1e-3], [0.3, 0.3, 1e-3]])
    mesh = TetMesh.from_arrays(points, [[0, 1, 2, 4]])
    repaired = repair_solid(mesh, RepairSteps(weld=0.01, orient=True))
    assert repaired.changes == {"weld": 1, "orient": 1} and repaired.mesh.signed_volume[0] > 0


def test_a_weld_that_leaves_no_cell_is_refused(tmp_path, run):
    refused = run("repair", body(tmp_path, CUBE.tetrahedra), "--weld", "9", "-o", tmp_path / "x.vtu")
    assert refused.exit_code == 2 and "smaller distance" in refused.stderr
    assert not (tmp_path / "x.vtu").exists()


@pytest.mark.parametrize("command", ["nonsense", "geodesic", "willmore-flow"])
def test_repairs_for_a_command_that_takes_no_tetrahedra_are_refused(tmp_path, run, command):
    result = run("repair", body(tmp_path, CUBE.tetrahedra), "--for", command, "-o", tmp_path / "x.vtu")
    assert result.exit_code == 2 and "takes no tetrahedra; commands that do: info, " in result.stderr


def test_repairs_for_hodge_make_any_of_these_acceptable(tmp_path, summary):
    cells, points = in_pieces()
    flat = [[0, 1, 2, 2]]
    path = body(tmp_path, np.concatenate([cells[:, [1, 0, 2, 3]], cells[:1], flat]), points)
    report = summary("repair", path, "--for", "hodge", "-o", tmp_path / "x.vtu")["results"]
    assert report["changes"]["drop_degenerate"] == report["changes"]["drop_duplicates"] == 1
    assert "hodge" not in report["refused_by"]
    numbers = summary("hodge", tmp_path / "x.vtu")["results"]["betti_numbers"]
    assert numbers["absolute"] == [1, 0, 0, 0]


def test_a_flat_cell_is_refused_by_its_own_remedy(tmp_path, run):
    """It was called a body that touches itself; the remedy left it there."""
    refused = run("hodge", body(tmp_path, np.concatenate([CUBE.tetrahedra, [[0, 1, 2, 2]]])))
    assert refused.exit_code == 2 and remedy_of(refused.stderr) == ["--drop-degenerate"]


def test_cells_without_a_boundary(tmp_path, run, summary):
    """Commands that take them were reported to refuse them, for another reason."""
    path = body(tmp_path, np.array([[0, 1, 4, 16], [1, 0, 4, 16]]))
    accepts = summary("info", path)["results"]["accepts"]
    assert accepts["laplacian"] == "yes" and run("laplacian", path).exit_code == 0
    assert "have no boundary" in accepts["hodge"] and "have no boundary" in run("hodge", path).stderr


def test_components_of_a_body_count_its_inner_vertices_and_cavities(tmp_path, summary):
    keep = np.ones(len(CUBE.tetrahedra), dtype=bool)
    keep[INNER] = False
    points = np.concatenate([CUBE.points, CUBE.points + 9.0, [[99.0, 0.0, 0.0]]])
    path = body(tmp_path, np.concatenate([CUBE.tetrahedra[keep], CUBE.tetrahedra + CUBE.n_vertices]), points)
    summary("info", path, "-o", tmp_path / "marks.vtu")
    expected = np.append(np.repeat([0, 1], CUBE.n_vertices), -1)
    assert np.array_equal(read_mesh(str(tmp_path / "marks.vtu")).vertex["component"], expected)
