"""`ddgcli dec`: matrices as scipy reads them, numbering, Matrix Market, refusals."""

import tracemalloc

import numpy as np
import pytest
from scipy.io import mmread
from scipy.sparse import csr_array, load_npz

from benchmarks.hardcases import meshes
from ddgcli.cli.commands.dec import write_archive
from ddgcli.io.mesh_file import write_mesh
from ddgcli.io.output_file import write_atomically
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.operators.dec import complex_of
from ddgcli.operators.dec_matrices import dec_matrices
from tests.conftest import ROOT

BALL = ROOT / "sample_meshes" / "ball.vtu"


def matrix(file, name):
    csc_arrays = (file[f"{name}_data"], file[f"{name}_indices"], file[f"{name}_indptr"])
    return csr_array(csc_arrays, shape=tuple(file[f"{name}_shape"]))


@pytest.fixture
def sphere(tmp_path):
    path = tmp_path / "sphere.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.random_sphere(150)))
    return path


def test_matrices_of_a_surface_and_their_numbering(summary, sphere, tmp_path):
    out = tmp_path / "operators.npz"
    result = summary("dec", sphere, "-o", out)
    with np.load(out) as file:
        d0, d1 = matrix(file, "d0"), matrix(file, "d1")
        edges, faces, points = file["edges"], file["faces"], file["points"]
        height = points[:, 2]
        assert np.allclose(d0 @ height, height[edges[:, 1]] - height[edges[:, 0]])
        tail, head = faces, faces[:, [1, 2, 0]]
        values = np.random.default_rng(0).standard_normal(len(edges))
        number = {(a, b): i for i, (a, b) in enumerate(edges.tolist())}
        around = [
            sum(values[number[a, b]] if (a, b) in number else -values[number[b, a]] for a, b in zip(t, h))
            for t, h in zip(tail.tolist(), head.tolist())
        ]
        assert np.allclose(d1 @ values, around)
        assert matrix(file, "laplacian0").nnz == result["results"]["nonzeros"]["laplacian0"]
    assert summary("laplacian", sphere, "--operator", "cotan", "--matrix", tmp_path / "L.npz")
    with np.load(out) as file:
        difference = abs(matrix(file, "laplacian0") - load_npz(tmp_path / "L.npz")).max()
    assert difference < 1e-12


def test_matrix_market_files_equal_the_archive_on_tetrahedra(summary, tmp_path):
    out, folder = tmp_path / "operators.npz", tmp_path / "matrices"
    result = summary("dec", BALL, "--star", "galerkin", "-o", out, "--mtx", folder)
    assert result["accuracy"]["derivative_residual"] == 0
    assert len(result["outputs"]) == 1 + len(result["results"]["nonzeros"])
    with np.load(out) as file:
        assert file["tetrahedra"].shape[1] == 4
        for name in result["results"]["nonzeros"]:
            written, read = matrix(file, name), csr_array(mmread(folder / f"{name}.mtx"))
            assert abs(written - read).max() <= 1e-14 * abs(written).max()


def test_each_star_gives_other_numbers(summary, sphere, tmp_path):
    stars = {}
    for star in ("circumcentric", "barycentric", "galerkin"):
        summary("dec", sphere, "--star", star, "-o", tmp_path / "a.npz")
        with np.load(tmp_path / "a.npz") as file:
            stars[star] = matrix(file, "star1")
    assert abs(stars["circumcentric"] - stars["barycentric"]).max() > 1e-3
    assert stars["galerkin"].nnz > stars["barycentric"].nnz


def test_right_angles_are_refused_and_the_remedy_works(run, tmp_path):
    path = tmp_path / "grid.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.grid(4, 4)))
    refused = run("dec", path, "--star", "circumcentric")
    assert refused.exit_code == 2 and "use --star galerkin" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
    assert run("dec", path, "--star", "barycentric").exit_code == run("dec", path).exit_code == 0


def test_a_vertex_of_high_valence_is_refused_before_the_memory_is_taken(run, tmp_path):
    points, faces = meshes.fan(2e4)
    path = tmp_path / "fan.npz"
    np.savez(path, points=points, faces=faces)
    result = run("dec", str(path))
    assert result.exit_code == 2
    assert "GiB" in result.stderr
    assert "vertex 0" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_the_archive_is_written_without_a_copy_in_memory(tmp_path):
    mesh = shapes.icosphere(4)
    matrices = dec_matrices(complex_of(mesh))
    tracemalloc.start()
    write_atomically(str(tmp_path / "m.npz"), lambda file: write_archive(file, matrices, mesh.points))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.5 * (tmp_path / "m.npz").stat().st_size


def test_a_star_that_is_off_on_constant_forms_is_reported_and_the_remedy_works(run, summary, tmp_path):
    path, out = tmp_path / "grid.ply", tmp_path / "a.npz"
    write_mesh(str(path), AnnotatedMesh(shapes.grid(8, 8)))
    result = run("dec", path, "-o", out, "--star", "barycentric")
    assert "barycentric star errs by 0.41 (degree 1)" in result.stderr and "--star galerkin" in result.stderr
    cured = summary("dec", path, "-o", out, "--star", "galerkin")
    assert cured["accuracy"]["star1_error"] < 0.02 and not cured["warnings"]
