"""`ddgcli hodge` as a user meets it."""

import numpy as np
import pytest

from ddgcli.algorithms.hodge import decomposition
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests.conftest import ROOT
from tests.exact.test_homology import klein


@pytest.fixture
def torus(tmp_path):
    """A torus, and a random field of each kind beside it."""
    mesh = shapes.torus(12, 8)
    rng = np.random.default_rng(0)
    path = tmp_path / "torus.vtu"
    write_mesh(str(path), AnnotatedMesh(mesh))
    np.save(tmp_path / "vertex.npy", rng.normal(size=(mesh.n_vertices, 3)))
    np.save(tmp_path / "face.npy", rng.normal(size=(mesh.n_faces, 3)))
    np.save(tmp_path / "edge.npy", rng.normal(size=mesh.topology.n_edges))
    return path


@pytest.mark.parametrize("place", ["vertex", "face", "edge"])
def test_parts_come_in_the_form_of_the_input(torus, tmp_path, summary, place):
    out = tmp_path / "parts.npz"
    report = summary("hodge", torus, "--field-file", tmp_path / f"{place}.npy", "--basis", "-o", out)
    assert report["results"]["betti_numbers"] == {"absolute": [1, 2, 1], "relative": [1, 2, 1]}
    assert len(report["results"]["generators"]) == 2
    assert report["accuracy"]["orthogonality"] < 1e-12
    assert report["accuracy"]["harmonic_residual"] < 1e-10
    with np.load(out, allow_pickle=False) as arrays:
        field = np.load(tmp_path / f"{place}.npy")
        for array in ("exact", "coexact", "harmonic", "harmonic_000", "harmonic_001"):
            assert arrays[array].shape == field.shape
        assert len(arrays["potential"]) == 96
        assert len(arrays["copotential"]) == (192 if place == "edge" else 288)
        if place == "edge":
            assert arrays["exact"] + arrays["coexact"] + arrays["harmonic"] == pytest.approx(field)


@pytest.mark.parametrize(
    "call, lost",
    [
        ("hodge {} --basis", "harmonic_000, harmonic_001"),
        ("hodge {} --field-file {}/edge.npy", "exact, coexact, harmonic"),
        ("laplacian {} --form-eigen 3", "eigenform_000"),
    ],
)
@pytest.mark.parametrize("suffix", [".vtu", ".ply", ".obj", ".csv", ".npz", ".vtkhdf"])
def test_arrays_on_edges_that_a_format_does_not_hold_have_a_warning(torus, tmp_path, run, call, lost, suffix):
    result = run(*call.format(torus, tmp_path).split(), "-o", tmp_path / f"out{suffix}")
    assert result.exit_code == 0
    warned = f"{suffix} holds no arrays on edges ({lost}" in result.stderr
    assert warned == (suffix not in (".npz", ".vtkhdf"))


def test_a_field_of_the_input_is_chosen_by_name(tmp_path, summary):
    mesh = shapes.torus(12, 8)
    path = tmp_path / "torus.vtu"
    write_mesh(str(path), AnnotatedMesh(mesh, vertex={"wind": np.cross(mesh.points, [0.0, 0.0, 1.0])}))
    report = summary("hodge", path, "--field", "wind")
    assert report["results"]["field_on"] == "vertex"


@pytest.fixture(params=["faces", "tetrahedra"])
def one_form(request, tmp_path):
    """A surface or a body in an archive with a 1-form `w`; the path, the arrays and the edges."""
    mesh = shapes.torus(12, 8) if request.param == "faces" else shapes.box_tetrahedra(2, 2, 2)
    edges = mesh.topology.edges if request.param == "faces" else mesh.edges
    w = np.random.default_rng(1).normal(size=len(edges))
    cells = {request.param: getattr(mesh, request.param)}
    arrays = {"points": mesh.points, **cells, "w": w}
    return tmp_path / "form.npz", arrays, edges


def test_edge_values_without_edges_are_in_the_default_order(one_form, tmp_path, summary):
    path, arrays, edges = one_form
    norms = []
    for further in ({"edges": edges}, {"edges": edges[::-1], "w": arrays["w"][::-1]}, {}):
        np.savez(path, **(arrays | further))
        norms.append(summary("hodge", path, "--field", "w")["results"]["norms"])
    assert norms[1] == pytest.approx(norms[0]) and norms[2] == pytest.approx(norms[0])


def test_an_edge_twice_is_refused_and_the_remedy_works(one_form, run):
    """The value of the edge that was missing was 0."""
    path, arrays, edges = one_form
    np.savez(path, **arrays, edges=edges[[1, *range(1, len(edges))]])
    result = run("hodge", path, "--field", "w")
    assert result.exit_code == 2 and "leave it out" in result.stderr
    np.savez(path, **arrays)
    assert run("hodge", path, "--field", "w").exit_code == 0


@pytest.mark.parametrize("option", ["--field", "--field-file"])
def test_a_single_number_is_no_field(torus, tmp_path, run, option):
    np.save(tmp_path / "one.npy", np.array(3.0))
    result = run("hodge", torus, option, tmp_path / "one.npy")
    assert result.exit_code == 2 and "shape ()" in result.stderr


def test_vectors_that_fit_vertices_and_cells_need_a_place(tmp_path, run, summary):
    band = shapes.cylinder(12, 1, 1.0, 0.5)
    assert band.n_vertices == band.n_faces
    np.save(tmp_path / "v.npy", band.points)
    write_mesh(str(tmp_path / "band.vtu"), AnnotatedMesh(band, {"h": band.points[:, 2]}, {"v": band.points}))
    refused = run("hodge", tmp_path / "band.vtu", "--field", tmp_path / "v.npy")
    assert refused.exit_code == 2 and "store them as an array of the mesh file" in refused.stderr
    assert summary("hodge", tmp_path / "band.vtu", "--field", "v")["results"]["field_on"] == "cell"
    wedge = run("dec", tmp_path / "band.vtu", "--wedge", "h", "h")
    assert wedge.exit_code == 2 and "refine the mesh" in wedge.stderr


@pytest.mark.parametrize(
    "command", ["hodge {}", "fluid-sim {} --vorticity x --steps 1", "laplacian {} --poisson x"]
)
def test_faces_that_close_a_periodic_grid_are_a_warning(command, tmp_path, summary):
    """Drawn flat they span the grid: the mean flow of a periodic channel had no harmonic part, in silence."""
    mesh, path = shapes.torus(12, 8), tmp_path / "grid.vtu"
    for marked in (0, 1):
        wraps = np.zeros(mesh.n_faces, dtype=np.int8)
        wraps[:5] = marked
        arrays = {"x": mesh.points[:, 0] - mesh.points[:, 0].mean()}
        write_mesh(str(path), AnnotatedMesh(mesh, vertex=arrays, face={"wraps": wraps}))
        warnings = summary(*command.format(path).split())["warnings"]
        assert any("5 faces close a periodic grid" in text for text in warnings) == bool(marked)


def test_edges_of_the_input_may_be_turned(tmp_path, summary):
    """Values on reversed edges change sign: the norms stay."""
    mesh = shapes.torus(12, 8)
    values = np.random.default_rng(1).normal(size=mesh.topology.n_edges)
    turned = np.arange(len(values)) % 3 == 0
    edges = np.where(turned[:, None], mesh.topology.edges[:, ::-1], mesh.topology.edges)
    order = np.random.default_rng(2).permutation(len(values))
    norms = []
    for name, e, v in (
        ("plain", mesh.topology.edges, values),
        ("turned", edges[order], np.where(turned, -values, values)[order]),
    ):
        path = tmp_path / f"{name}.npz"
        write_mesh(str(path), AnnotatedMesh(mesh, edge={"edges": e, "form": v}))
        norms.append(summary("hodge", path, "--field", "form")["results"]["norms"])
    assert norms[0] == pytest.approx(norms[1])


@pytest.mark.parametrize(
    "words, message_part",
    [
        (["--field", "nothing"], "--field: no array 'nothing'"),
        (["--field", "a", "--field-file", "b.npy"], "give one"),
        (["--field-file", "missing.npy"], "no such file"),
    ],
)
def test_bad_fields_are_refused_in_a_line(torus, run, words, message_part):
    result = run("hodge", torus, *words)
    assert result.exit_code == 2
    assert message_part in result.stderr and result.stderr.count("\n") == 1
    assert result.stdout == ""


def test_a_field_that_fits_nowhere_is_refused(torus, tmp_path, run):
    np.save(tmp_path / "odd.npy", np.zeros((7, 3)))
    result = run("hodge", torus, "--field-file", tmp_path / "odd.npy", "-o", tmp_path / "out.npz")
    assert result.exit_code == 2 and "(7, 3)" in result.stderr
    assert not (tmp_path / "out.npz").exists()


def test_the_residual_of_tetrahedra_is_measured(tmp_path, summary, monkeypatch):
    """It was zero by construction: now an error of a thousandth in the curl part shows."""
    ball = ROOT / "sample_meshes" / "ball.vtu"
    cells = len(read_mesh(str(ball)).mesh.tetrahedra)
    np.save(tmp_path / "field.npy", np.random.default_rng(0).normal(size=(cells, 3)))
    report = summary("hodge", ball, "--field-file", tmp_path / "field.npy")["accuracy"]
    assert 0 < report["reconstruction_residual"] < 1e-9 and report["harmonic_residual"] is None
    right = decomposition._tetrahedron_curl
    monkeypatch.setattr(decomposition, "_tetrahedron_curl", lambda *arguments: 1.001 * right(*arguments))
    report = summary("hodge", ball, "--field-file", tmp_path / "field.npy")["accuracy"]
    assert report["reconstruction_residual"] > 1e-4 and report["orthogonality"] < 1e-9


def test_a_klein_bottle_has_the_betti_numbers_of_the_page(tmp_path, summary, run):
    mesh = klein(8)
    path = tmp_path / "klein.npz"
    write_mesh(str(path), AnnotatedMesh(mesh, face={"wind": np.ones((mesh.n_faces, 3))}))
    report = summary("hodge", path, "--field", "wind", "--basis", "-o", tmp_path / "parts.npz")
    assert report["results"]["betti_numbers"] == {"absolute": [1, 1, 0], "relative": [1, 1, 0]}
    assert report["results"]["betti_numbers_modulo_2"] == {"absolute": [1, 2, 1], "relative": [1, 2, 1]}
    assert len(report["results"]["generators"]) == 2
    assert report["accuracy"]["reconstruction_residual"] < 1e-12
    with np.load(tmp_path / "parts.npz") as arrays:
        assert "harmonic_000" in arrays and "harmonic_001" not in arrays
    faces = np.concatenate([shapes.torus(12, 8).faces[:1, ::-1], shapes.torus(12, 8).faces[1:]])
    turned = TriangleMesh.from_arrays(shapes.torus(12, 8).points, faces)
    write_mesh(str(path), AnnotatedMesh(turned))
    result = run("hodge", path)
    assert result.exit_code == 2 and "reverse 1 of them (first: face 0)" in result.stderr


def test_fields_on_tetrahedra_have_the_betti_numbers_of_the_solid(shared_meshes, tmp_path, summary):
    path = shared_meshes / "P1.msh"
    cells = len(read_mesh(str(path)).mesh.tetrahedra)
    np.save(tmp_path / "field.npy", np.random.default_rng(0).normal(size=(cells, 3)))
    report = summary("hodge", path, "--field-file", tmp_path / "field.npy")
    assert report["results"]["betti_numbers"]["absolute"] == [1, 11, 0, 0]
    assert len(report["results"]["generators"]) == 11
    assert report["accuracy"]["orthogonality"] < 1e-8
    assert 0 < report["accuracy"]["reconstruction_residual"] < 1e-6  # with inverted and nearly flat cells


def test_a_free_potential_has_the_mean_zero_and_a_fixed_one_vanishes_on_the_boundary():
    mesh = shapes.grid(6, 5)
    x = mesh.points[:, 0]
    tail, head = mesh.topology.edges.T
    free = decomposition.decompose_form(mesh, x[head] - x[tail]).potential
    assert np.allclose(free, x - x.mean(), rtol=0, atol=1e-12)
    fixed = decomposition.decompose_form(mesh, x[head] - x[tail], "normal").potential
    assert np.all(fixed[mesh.topology.boundary_vertex] == 0)
