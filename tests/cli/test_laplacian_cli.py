"""`ddgcli laplacian` end to end."""

import numpy as np
import pytest
import scipy.io
import scipy.sparse

from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator, negative_weights
from ddgcli.choices import LAPLACE_OPERATORS
from ddgcli.cli.commands.laplacian import MATRIX_FORMATS
from ddgcli.cli.subdivided_input import subdivided_input
from ddgcli.io import matrix_file
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh


@pytest.fixture
def mesh_file(tmp_path):
    def write(mesh, **vertex):
        path = tmp_path / "mesh.npz"
        write_mesh(str(path), AnnotatedMesh(mesh, vertex=vertex))
        return path

    return write


def test_the_command_accepts_every_matrix_format_of_the_writer():
    assert MATRIX_FORMATS == matrix_file.MATRIX_FORMATS


def test_progress_draws_a_progress_bar(mesh_file, run, monkeypatch):
    monkeypatch.setattr("ddgcli.cli.progress.REDRAW_INTERVAL", 0.0)  # every word of progress is drawn
    path = mesh_file(shapes.icosphere(3))
    done = run("laplacian", path, "--eigen", 10, "--smooth", 0.01, "--progress")
    shares = [int(text.split("%")[0]) for text in done.stderr.split("]")[1:]]
    assert done.exit_code == 0 and "laplacian [" in done.stderr
    assert shares == sorted(shares) and shares[0] == 33 and shares[-1] > 80
    assert "[" not in run("laplacian", path, "--eigen", 10).stderr


@pytest.mark.parametrize("operator", LAPLACE_OPERATORS)
@pytest.mark.parametrize("suffix", ["npz", "mtx"])
def test_written_matrices_equal_those_of_the_library(mesh_file, summary, tmp_path, operator, suffix):
    path = mesh_file(shapes.random_sphere(300))
    files = [tmp_path / f"L.{suffix}", tmp_path / f"M.{suffix}"]
    out = summary("laplacian", path, "--operator", operator, "--matrix", files[0], "--mass-matrix", files[1])
    read = scipy.sparse.load_npz if suffix == "npz" else scipy.io.mmread
    L, M = (scipy.sparse.csr_array(read(file)) for file in files)
    expected = laplace_operator(shapes.random_sphere(300), operator)
    assert abs(L - expected.stiffness).max() == 0 and abs(M - expected.mass).max() == 0
    assert out["results"]["operator"] == operator
    assert out["accuracy"]["negative_weights"] == negative_weights(expected.stiffness)
    assert out["outputs"] == [str(file) for file in files]


def test_eigenvectors_are_orthonormal_arrays(mesh_file, summary, tmp_path):
    path, result, mass = mesh_file(shapes.icosphere(3)), tmp_path / "r.npz", tmp_path / "M.npz"
    out = summary("laplacian", path, "--eigen", 9, "-o", result, "--mass-matrix", mass)
    assert np.allclose(out["results"]["eigenvalues"], [0, 2, 2, 2, 6, 6, 6, 6, 6], rtol=0.02)
    arrays = np.load(result)
    X = np.stack([arrays[f"eigenvector_{i:03d}"] for i in range(9)], axis=1)
    assert np.abs(X.T @ (scipy.sparse.load_npz(mass) @ X) - np.eye(9)).max() < 1e-12
    assert max(out["accuracy"]["eigen_residuals"]) < 1e-8
    assert out["accuracy"]["eigen_complete"] is True


def test_poisson_of_an_array_of_the_mesh_and_of_a_file(mesh_file, summary, tmp_path):
    mesh = shapes.icosphere(3)
    z = mesh.points[:, 2]
    path, result = mesh_file(mesh, source=2 * z), tmp_path / "r.npz"
    out = summary("laplacian", path, "--poisson", "source", "-o", result)
    assert np.abs(np.load(result)["poisson"] - z).max() < 0.02
    assert out["accuracy"]["poisson_residual"] < 1e-12
    assert not out["warnings"]
    np.save(tmp_path / "f.npy", 2 * z + 1)
    out = summary("laplacian", path, "--poisson", tmp_path / "f.npy", "-o", result)
    assert any("mean" in warning and "subtracted" in warning for warning in out["warnings"])
    assert np.abs(np.load(result)["poisson"] - z).max() < 0.02
    out = summary("laplacian", path, "--poisson", "source", "--fix", "0=5", "-o", result)
    assert np.load(result)["poisson"][0] == 5


@pytest.mark.parametrize("fix", [[], ["--fix", "0=5"]])
def test_poisson_solves_for_each_column(mesh_file, summary, tmp_path, fix):
    mesh = shapes.icosphere(2)
    path, result, one = mesh_file(mesh, f=mesh.points[:, :2]), tmp_path / "r.npz", tmp_path / "one.npz"
    both = summary("laplacian", path, "--poisson", "f", *fix, "-o", result)["results"]["poisson"]
    columns = []
    for k in range(2):
        np.save(tmp_path / "f.npy", mesh.points[:, k])
        out = summary("laplacian", path, "--poisson", tmp_path / "f.npy", *fix, "-o", one)
        columns.append(out["results"]["poisson"])
        assert np.abs(np.load(result)["poisson"][:, k] - np.load(one)["poisson"]).max() < 1e-13
    assert both["max"] == pytest.approx(max(column["max"] for column in columns))
    assert both["dirichlet_energy"] == pytest.approx(sum(c["dirichlet_energy"] for c in columns))


@pytest.mark.parametrize(
    "words", [["--poisson"], ["--heat", "--duration", "1"], ["--wave", "--duration", "1"]]
)
def test_values_whose_integral_overflows_are_refused_where_they_are_named(mesh_file, run, tmp_path, words):
    """Each value is finite, but an error named a right-hand side that is not."""
    mesh = shapes.icosphere(1, radius=1e3)
    option, *rest = words
    np.save(tmp_path / "f.npy", np.full(mesh.n_vertices, 1e308))
    result = run("laplacian", mesh_file(mesh), option, tmp_path / "f.npy", *rest)
    assert result.exit_code == 2 and result.stderr.count("\n") == 1
    assert f"{option}: values of up to 1e+308 are too large" in result.stderr
    assert "rescale the array" in result.stderr


def test_arrays_follow_the_subdivision(tmp_path, summary):
    mesh, finer = shapes.icosphere(2), shapes.midpoint_subdivided(shapes.icosphere(2), 2)
    arrays = {"f": mesh.points[:, 2] + 0.5, "label": np.arange(mesh.n_vertices)}
    centre = mesh.points[mesh.faces].mean(axis=1)
    path, fine, result = (tmp_path / name for name in ("mesh.npz", "fine.npz", "r.npz"))
    write_mesh(str(path), AnnotatedMesh(mesh, vertex=arrays, face={"centre": centre}))
    write_mesh(str(fine), AnnotatedMesh(finer, vertex={"f": finer.points[:, 2] + 0.5}))
    out = summary("laplacian", path, "--poisson", "f", "--subdivide", 2, "-o", result)
    assert not [text for text in out["warnings"] if "drops" in text]
    solution = np.load(result)["poisson"]
    summary("laplacian", fine, "--poisson", "f", "-o", result)
    np.testing.assert_allclose(solution, np.load(result)["poisson"], atol=1e-12)
    follows = subdivided_input(read_mesh(str(path)), 2).face["centre"]
    piece = finer.points[finer.faces].mean(axis=1) - follows
    normal = np.cross(*(mesh.points[mesh.faces[:, j]] - mesh.points[mesh.faces[:, 0]] for j in (1, 2)))
    assert np.abs((piece * np.tile(normal, (16, 1))).sum(axis=1)).max() < 1e-15  # in the plane of its face
    assert np.linalg.norm(piece, axis=1).max() < mesh.side_length.max() / 2


@pytest.mark.parametrize("words", [["--fix", "0=1", "--fix", "8=3"], ["--fix", "0=1", "8=3"]])
def test_harmonic_takes_its_values(mesh_file, summary, tmp_path, words):
    path, result = mesh_file(shapes.grid(8, 8)), tmp_path / "r.npz"
    out = summary("laplacian", path, "--harmonic", *words, "-o", result)
    u = np.load(result)["harmonic"]
    assert u[0] == 1 and u[8] == 3 and u.min() >= 1 and u.max() <= 3
    assert out["accuracy"]["harmonic_residual"] < 1e-12
    assert out["accuracy"]["maximum_principle_violation"] == 0


def test_maps_of_the_plane_keep_their_promises(mesh_file, summary, tmp_path):
    half = shapes.catenoid(32, 16)
    flat = shapes.grid(12, 9, 2.0, 1.0)
    path, result = mesh_file(flat), tmp_path / "r.npz"
    out = summary("laplacian", path, "--parameterize", "harmonic", "-o", result)
    uv = np.load(result)["uv"]
    assert np.allclose(np.linalg.norm(uv[flat.topology.boundary_vertex], axis=1), 1)
    assert out["results"]["flipped_triangles"] == 0
    out = summary("laplacian", path, "--parameterize", "conformal", "-o", result)
    assert out["results"]["conformal_distortion"]["max"] < 1 + 1e-6
    path = mesh_file(half)
    out = summary("laplacian", path, "--parameterize", "conformal", "-o", result)
    assert any("2 boundary loops" in warning for warning in out["warnings"])


def test_smoothing_moves_the_mesh(mesh_file, summary, tmp_path):
    path, result = mesh_file(shapes.icosphere(3)), tmp_path / "r.npz"
    out = summary("laplacian", path, "--smooth", 0.05, "--smooth-steps", 20, "-o", result)
    radius = np.linalg.norm(np.load(result)["points"], axis=1)
    assert np.allclose(radius, np.sqrt(1 - 4 * 0.05), rtol=0.01)
    assert out["results"]["smooth_area"]["after"] < out["results"]["smooth_area"]["before"]
    out = summary("laplacian", path, "--smooth", 10, "-o", result, code=1)
    assert np.isfinite(np.load(result)["points"]).all()
    assert out["results"]["converged"] is False


def test_heat_kernel_signature_of_a_sphere_equals_the_series(mesh_file, summary, tmp_path):
    path, result = mesh_file(shapes.icosphere(3)), tmp_path / "r.npz"
    out = summary("laplacian", path, "--hks", 0.5, 100, "-o", result)
    arrays = np.load(result)
    degree = np.arange(20)
    truth = ((2 * degree + 1) * np.exp(-degree * (degree + 1) * 0.5)).sum() / (4 * np.pi)
    assert np.allclose(arrays["hks_000"], truth, rtol=0.02)
    assert np.allclose(arrays["hks_001"], 1 / out["results"]["area"], rtol=1e-12)
    assert max(out["accuracy"]["hks_truncation"]) < 1e-6


REFUSALS = {
    ("--eigen", 99999): "use at most",
    ("--eigen", 0): "--eigen",
    ("--harmonic",): "--fix",
    ("--fix", "0=1"): "--harmonic",
    ("--harmonic", "--fix", "99999=1"): "does not exist",
    ("--harmonic", "--fix", "0=1", "--fix", "0=2"): "two values",
    ("--harmonic", "--fix", "0=nan"): "not finite",
    ("--harmonic", "--fix", "zero"): "ID=VALUE",
    ("--poisson", "nothing"): "--poisson: no array 'nothing'",
    ("--smooth", -1): "--smooth",
    ("--smooth-steps", 3): "--smooth",
    ("--smooth-flow", "conformalized"): "--smooth",
    ("--parameterize", "harmonic"): "closed",
    ("--parameterize", "conformal"): "closed",
    ("--matrix", "L.txt"): "known here",
    ("--operator", "magic"): "intrinsic-delaunay",
}


@pytest.mark.parametrize("words", REFUSALS, ids=lambda words: " ".join(map(str, words)))
def test_refusals_are_one_line(mesh_file, run, words):
    result = run("laplacian", mesh_file(shapes.icosphere(1)), *words)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert REFUSALS[words] in result.stderr
    assert result.stderr.startswith("Error:") and len(result.stderr.strip().splitlines()) == 1


def test_a_component_without_fixed_value_is_refused(shared_meshes, run):
    result = run("laplacian", shared_meshes / "hard" / "gen_nested_shells.stl", "--harmonic", "--fix", "0=1")
    assert result.exit_code == 2 and "no fixed value" in result.stderr


def test_operator_that_a_mesh_cannot_have_names_one_that_it_can(shared_meshes, run, summary):
    path = shared_meshes / "hard" / "gen_book_edge.ply"
    result = run("laplacian", path, "--operator", "intrinsic-delaunay")
    assert result.exit_code == 2 and "--operator tufted" in result.stderr
    out = summary("laplacian", path)
    assert out["results"]["operator"] == "tufted"
    assert any("tufted" in warning for warning in out["warnings"])


def test_isolated_vertices_stay_zero_with_a_warning(shared_meshes, summary, tmp_path):
    path = shared_meshes / "hard" / "gen_unreferenced.ply"
    result = tmp_path / "r.npz"
    out = summary("laplacian", path, "--eigen", 4, "-o", result)
    assert any("belong to no face" in warning for warning in out["warnings"])
    assert np.isfinite(np.load(result)["eigenvector_003"]).all()


def test_mollification_causes_a_warning(shared_meshes, summary):
    out = summary("laplacian", shared_meshes / "hard" / "gen_zero_area.off", "--eigen", 4)
    assert out["results"]["mollified_faces"] > 0
    assert any("mollified" in warning for warning in out["warnings"])


@pytest.mark.parametrize("second, count", [(5, 1), (-5, 0), (0.5, 0)])
def test_lines_that_may_be_numbers_with_decimal_commas_have_a_warning(summary, tmp_path, second, count):
    mesh, path = shapes.icosphere(1), tmp_path / "ball.ply"
    write_mesh(str(path), AnnotatedMesh(mesh))
    (tmp_path / "f.csv").write_text(f"1,{second}\n" * mesh.n_vertices)
    report = summary("laplacian", path, "--poisson", tmp_path / "f.csv")
    assert sum("decimal points" in message for message in report["warnings"]) == count


def test_fixed_values_that_overflow_are_refused_with_the_option(run, tmp_path):
    path = tmp_path / "ball.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1)))
    refused = run("laplacian", path, "--harmonic", "--fix", "0=1e308", "--fix", "1=-1e308")
    assert refused.exit_code == 2 and "--fix" in refused.stderr and "below" in refused.stderr
    least = refused.stderr.split("below ")[1].strip()
    assert run("laplacian", path, "--harmonic", "--fix", f"0={least}", "--fix", f"1=-{least}").exit_code == 0
