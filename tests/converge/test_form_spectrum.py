"""The Hodge Laplacian of 1-forms: kernel, exact part, values of the sphere, output and refusals."""

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh
from scipy.spatial import Delaunay

from benchmarks.hardcases import meshes
from ddgcli import memory
from ddgcli.algorithms.hodge.homology import betti_numbers
from ddgcli.algorithms.laplacian.form_spectrum import form_spectrum
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.algorithms.laplacian.spectrum import spectrum
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.dec import complex_of
from ddgcli.operators.dec_matrices import dec_matrices
from ddgcli.operators.star_errors import star_errors
from ddgcli.operators.stars import hodge_star
from tests.exact.test_homology import ring_tets

TORUS = shapes.torus(14, 10)
BOX = shapes.box_tetrahedra(3, 3, 3, (1.0, 1.3, 0.8))


@pytest.mark.parametrize(
    "mesh, betti",
    [(shapes.icosphere(1), 0), (TORUS, 2), (shapes.cylinder(12, 4), 1), (shapes.grid(5, 5), 0), (BOX, 0)],
)
def test_the_kernel_has_the_dimension_of_the_first_betti_number(mesh, betti):
    result = form_spectrum(mesh, 4)
    assert result.kernel == betti_numbers(mesh).absolute[1] == betti
    assert (result.pairs.values[:betti] == 0).all() and result.pairs.values[betti] > 0.1
    assert result.pairs.complete and result.pairs.residuals.max() < 1e-10


def joined(meshes):
    """Meshes of one class as the components of one mesh."""
    first = np.cumsum([0, *(m.n_vertices for m in meshes)])
    cells = [m.tetrahedra if isinstance(m, TetMesh) else m.faces for m in meshes]
    points = np.concatenate([m.points + 9.0 * k for k, m in enumerate(meshes)])
    return type(meshes[0]).from_arrays(points, np.concatenate([c + n for c, n in zip(cells, first)]))


def graded_ring(inner):
    """Annulus of radii `inner` and 1 with faces of one shape."""
    ring = shapes.cylinder(24, 40)
    x, y, z = ring.points.T
    radius = inner ** ((z - z.min()) / np.ptp(z))
    return TriangleMesh.from_arrays(np.stack([radius * x, radius * y, 0 * z], axis=1), ring.faces)


@pytest.mark.parametrize("inner", [1e-3, 1e-8])
def test_a_ring_with_a_small_hole_has_one_harmonic_form(inner):
    mesh = graded_ring(inner)
    result = form_spectrum(mesh, 9)
    assert result.kernel == betti_numbers(mesh).absolute[1] == 1
    assert result.pairs.values[0] == 0 and result.pairs.values[1] > 1
    functions = spectrum(laplace_operator(mesh, "cotan"), 4).values[1:]
    for value in functions:  # the gradients of eigenfunctions
        assert np.abs(result.pairs.values / value - 1).min() < 1e-8


@pytest.mark.parametrize(
    "large, small",
    [(TORUS, shapes.cylinder(8, 3)), (ring_tets(), ring_tets()), (TORUS, shapes.torus(24, 18))],
)
def test_components_of_other_sizes_keep_their_harmonic_forms(large, small):
    mesh = joined([large, small.moved(1e-6 * small.points)])
    result, alone = form_spectrum(mesh, 9), form_spectrum(large, 9)
    kernel = betti_numbers(mesh).absolute[1]
    assert result.kernel == kernel and (result.pairs.values[:kernel] == 0).all()
    positive = alone.pairs.values[alone.kernel :]
    assert result.pairs.values[kernel:] == pytest.approx(positive[: 9 - kernel], rel=1e-9)
    star = hodge_star(complex_of(mesh), 1)
    gram = result.pairs.vectors.T @ (star @ result.pairs.vectors)
    assert gram == pytest.approx(np.eye(9), abs=1e-8)


def test_fewer_forms_than_the_betti_number_are_all_harmonic():
    mesh = joined([TORUS, TORUS])
    result = form_spectrum(mesh, 3)
    assert result.kernel == 3 and (result.pairs.values == 0).all() and result.pairs.residuals.max() < 1e-12
    assert np.abs(complex_of(mesh).derivatives[1] @ result.pairs.vectors).max() < 1e-12


@pytest.mark.parametrize("mesh", [TORUS, shapes.grid(6, 5), BOX])
def test_the_values_of_functions_are_among_those_of_forms_to_rounding(mesh):
    functions = spectrum(laplace_operator(mesh, "cotan"), 6).values[1:]
    forms = form_spectrum(mesh, 40).pairs.values
    inside = functions[functions < forms[-1]]
    assert len(inside) >= 3
    for value in inside:
        assert np.abs(forms / value - 1).min() < 1e-9


def test_values_of_the_sphere_converge_with_order_two():
    truth = np.repeat([2.0, 6.0], [6, 10])
    errors = [np.abs(form_spectrum(shapes.icosphere(n), 16).pairs.values - truth).max() for n in (1, 2)]
    assert np.log2(errors[0] / errors[1]) > 1.6 and errors[1] < 0.4


def test_the_command_writes_forms_and_their_vectors(summary, run, tmp_path):
    path, out = tmp_path / "torus.ply", tmp_path / "forms.npz"
    write_mesh(str(path), AnnotatedMesh(TORUS))
    result = summary("laplacian", path, "--form-eigen", 3, "-o", out)
    assert result["results"]["harmonic_forms"] == 2
    assert result["accuracy"]["form_eigen_complete"]
    assert max(result["accuracy"]["form_eigen_residuals"]) < 1e-10
    with np.load(out) as file:
        form, tail, head = file["eigenform_000"], *file["edges"].T
        # a harmonic form is closed: its sum round each face vanishes
        value = {(a, b): x for a, b, x in zip(tail.tolist(), head.tolist(), form)}
        value |= {(b, a): -x for (a, b), x in value.items()}
        for a, b, c in file["faces"].tolist():
            assert abs(value[a, b] + value[b, c] + value[c, a]) < 1e-10
        assert file["eigenform_vectors_000"].shape == (TORUS.n_faces, 3)
    assert "exceed the 420 edges" in run("laplacian", path, "--form-eigen", 421).stderr


def test_forms_of_a_one_sided_surface_are_refused_in_one_line(run, tmp_path):
    mobius = shapes.grid(6, 2)
    turned = mobius.faces.copy()
    turned[0] = turned[0][::-1]
    path = tmp_path / "turned.npz"
    np.savez(path, points=mobius.points, faces=turned)
    result = run("laplacian", path, "--form-eigen", 2, "--operator", "cotan")
    assert result.exit_code == 2 and result.stderr.count("\n") == 1
    assert "the spectrum of forms needs consistently oriented faces" in result.stderr


def test_a_factor_that_does_not_fit_is_refused_where_the_matrix_alone_would_fit(run, tmp_path, monkeypatch):
    """The hub of a fan couples all edges around it; a factor takes several copies."""
    points, faces = meshes.fan(600)
    path = tmp_path / "fan.npz"
    np.savez(path, points=points, faces=faces)
    monkeypatch.setattr(memory, "MAX_BYTES", 60 * 2**20)
    assert run("dec", path).exit_code == 0
    result = run("laplacian", path, "--form-eigen", 2)
    assert result.exit_code == 2 and result.stderr.count("\n") == 1
    assert "factors of 1-forms need about" in result.stderr and "remesh around vertex 0" in result.stderr
    monkeypatch.setattr(memory, "MAX_BYTES", 2**30)
    assert run("laplacian", path, "--form-eigen", 2).exit_code == 0


def scattered_cube(dimension, cells):
    """Delaunay triangles of a square or tetrahedra of a cube, the inner vertices shifted at random."""
    axis = np.linspace(0.0, 1.0, cells + 1)
    points = np.stack(np.meshgrid(*[axis] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    inside = ((points > 0.0) & (points < 1.0)).all(axis=1)
    shift = np.random.default_rng(0).uniform(-0.25, 0.25, points.shape)
    points[inside] += shift[inside] / cells
    simplices = Delaunay(points).simplices
    measure = np.linalg.det(points[simplices[:, 1:]] - points[simplices[:, :1]])
    simplices = simplices[np.abs(measure) > 1e-3 / cells**dimension]
    if dimension == 3:
        return TetMesh.from_arrays(points, simplices)
    measure = np.linalg.det(points[simplices[:, 1:]] - points[simplices[:, :1]])
    simplices[measure < 0] = simplices[measure < 0][:, ::-1]
    return TriangleMesh.from_arrays(np.pad(points, [(0, 0), (0, 1)]), simplices)


@pytest.mark.parametrize("dimension, cells", [(2, 24), (3, 5)])
def test_the_error_of_a_star_predicts_that_of_the_spectrum_of_the_highest_degree(dimension, cells):
    """The first value of the square is 2 pi^2, of the cube 3 pi^2."""
    mesh = scattered_cube(dimension, cells)
    complex_, error, stated = complex_of(mesh), {}, {}
    for star in ("barycentric", "galerkin"):
        matrices = dec_matrices(complex_, star).matrices
        L, M = (matrices[f"{name}{dimension}"].tocsc() for name in ("laplacian", "star"))
        (first,) = eigsh(L, k=1, M=M, sigma=-1.0, return_eigenvectors=False)
        error[star] = abs(first / (dimension * np.pi**2) - 1.0)
        stated[star] = star_errors(complex_, mesh.points, star)[dimension - 1]
    assert stated["galerkin"] < 0.005 and error["galerkin"] < 0.025
    assert 0.4 * stated["barycentric"] < error["barycentric"] < stated["barycentric"]
