"""The Laplacian of tetrahedra: spectra, Poisson and harmonic problems and heat on a box, with rates."""

import numpy as np
import pytest

from ddgcli.algorithms.laplacian.evolution import solve_evolution
from ddgcli.algorithms.laplacian.evolution_times import EvolutionTimes
from ddgcli.algorithms.laplacian.laplace_operator import laplace_operator
from ddgcli.algorithms.laplacian.poisson import harmonic, poisson
from ddgcli.algorithms.laplacian.spectrum import heat_kernel_signature, signature_pairs, spectrum
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.tet_mesh import TetMesh
from tests.conftest import ROOT

SIZE = (1.0, 1.3, 0.8)
BALL = str(ROOT / "sample_meshes" / "ball.vtu")


def box(n):
    return shapes.box_tetrahedra(n, n, n, SIZE)


def box_eigenvalues(k):
    i, j, l = np.meshgrid(*[np.arange(8)] * 3, indexing="ij")
    return np.sort((np.pi**2 * ((i / SIZE[0]) ** 2 + (j / SIZE[1]) ** 2 + (l / SIZE[2]) ** 2)).ravel())[:k]


@pytest.mark.parametrize("mass", ["lumped", "galerkin"])
def test_eigenvalues_of_a_box_converge_with_order_two(mass):
    truth = box_eigenvalues(6)[1:]
    pairs = [spectrum(laplace_operator(box(n), mass=mass), 6) for n in (4, 8)]
    errors = [(p.values[1:] - truth) / truth for p in pairs]
    assert np.log2(np.abs(errors[0]) / np.abs(errors[1])).min() > 1.7
    assert np.abs(errors[1]).max() < 0.05 and pairs[1].complete
    if mass == "galerkin":  # min-max principle
        assert (errors[1] > 0).all()


def test_poisson_on_a_box_converges_with_order_two():
    errors = []
    for n in (4, 8):
        mesh = box(n)
        phases = np.pi * mesh.points / SIZE
        u = np.cos(phases[:, 0]) * np.cos(phases[:, 1])
        f = np.pi**2 * (1 / SIZE[0] ** 2 + 1 / SIZE[1] ** 2) * u
        solution = poisson(laplace_operator(mesh, mass="galerkin"), f)
        assert solution.residual < 1e-11
        mass = laplace_operator(mesh).mass
        errors.append(np.sqrt((mass @ (solution.values - u) ** 2).sum() / (mass @ u**2).sum()))
    assert np.log2(errors[0] / errors[1]) > 1.7 and errors[1] < 0.05


def test_harmonic_interpolation_of_linear_boundary_values_is_linear():
    mesh = read_mesh(BALL).mesh
    linear = mesh.points @ [1.0, -2.0, 0.5] + 3.0
    rim = np.unique(mesh.boundary.faces)
    solution = harmonic(laplace_operator(mesh), {int(v): float(linear[v]) for v in rim})
    assert len(rim) < mesh.n_vertices
    assert np.abs(solution.values - linear).max() < 1e-12


def test_the_heat_kernel_signature_of_a_box_converges_to_the_product_of_three_intervals():
    time, errors = 0.2, []
    index = np.arange(1, 30)[:, None]
    for n in (4, 8):
        operator = laplace_operator(box(n))
        pairs = spectrum(operator, signature_pairs(operator, [time]))
        signature = heat_kernel_signature(operator, pairs, np.array([time]))
        exact = np.ones(len(pairs.vectors))
        for x, length in zip(box(n).points.T, SIZE):
            decay = np.exp(-((np.pi * index / length) ** 2) * time)
            exact *= (1 + 2 * (decay * np.cos(np.pi * index * x / length) ** 2).sum(axis=0)) / length
        assert signature.truncation[0] < 1e-3
        errors.append(np.abs(signature.values[:, 0] / exact - 1).max())
    assert np.log2(errors[0] / errors[1]) > 1.6 and errors[1] < 0.1


def test_heat_on_tetrahedra_keeps_its_integral_and_ends_at_the_mean():
    operator = laplace_operator(box(3))
    result = solve_evolution(operator, "heat", 0, EvolutionTimes(50.0, 20, 20))
    assert result.accuracy["total_drift"] < 1e-12
    assert result.evolution_frames[-1].values == pytest.approx(np.full(64, 1 / np.prod(SIZE)), rel=1e-9)


def test_units_of_the_bump_of_a_wave_are_those_of_the_mesh():
    def bump(scale):
        mesh = shapes.box_tetrahedra(3, 3, 3, (scale, scale, scale))
        return (
            solve_evolution(laplace_operator(mesh), "wave", 21, EvolutionTimes(scale, 2, 2))
            .evolution_frames[0]
            .values
        )

    assert bump(10.0) * 1e3 == pytest.approx(bump(1.0), rel=1e-9)


def test_matrices_do_not_depend_on_orientation_and_sum_to_the_volume():
    mesh = box(2)
    mirrored = TetMesh.from_arrays(mesh.points, mesh.tetrahedra[:, [1, 0, 2, 3]])
    for mass in ("lumped", "galerkin"):
        one, other = laplace_operator(mesh, mass=mass), laplace_operator(mirrored, mass=mass)
        assert abs(one.stiffness - other.stiffness).max() < 1e-14
        assert one.mass.sum() == pytest.approx(np.prod(SIZE), rel=1e-13)
    uniform = laplace_operator(mesh, "uniform").stiffness
    assert (uniform.data == np.rint(uniform.data)).all() and uniform.diagonal().max() == 14


def test_the_command_solves_on_tetrahedra(summary, tmp_path):
    path, out = tmp_path / "box.vtu", tmp_path / "out.vtu"
    mesh = box(4)
    write_mesh(str(path), AnnotatedMesh(mesh, vertex={"f": np.cos(np.pi * mesh.points[:, 0])}))
    result = summary("laplacian", path, "--eigen", 3, "--poisson", "f", "-o", out,
                     "--plot", tmp_path / "box.png")  # fmt: skip
    written = read_mesh(str(out))
    assert written.kind == "tetrahedra" and result["results"]["volume"] == pytest.approx(np.prod(SIZE))
    assert written.vertex["vertex_volume"].sum() == pytest.approx(np.prod(SIZE))
    expected = poisson(laplace_operator(mesh), np.cos(np.pi * mesh.points[:, 0])).values
    assert written.vertex["poisson"] == pytest.approx(expected, abs=1e-12)
    assert result["results"]["eigenvalues"][1] == pytest.approx(box_eigenvalues(2)[1], rel=0.1)
    trajectory = tmp_path / "heat.vtkhdf"
    summary("laplacian", path, "--heat", "f", "--duration", 0.1, "--frames", 2, "-o", trajectory)
    with Trajectory(str(trajectory)) as run_file:
        assert run_file.times == pytest.approx([0.0, 0.05, 0.1])
    assert summary("info", path)["results"]["accepts"]["laplacian"] == "yes"


@pytest.mark.parametrize(
    "words, message",
    [
        (("--smooth", 1), "--smooth: needs a surface"),
        (("--parameterize", "harmonic"), "--parameterize: needs a surface"),
        (("--subdivide", 1), "--subdivide: splits the faces of a surface"),
        (("--operator", "tufted"), "--operator: 'tufted' is an operator of surfaces"),
        (("--mass", "voronoi"), "--mass: 'voronoi' is a mass of surfaces"),
    ],
)
def test_tasks_of_surfaces_are_refused_in_one_line(run, words, message):
    result = run("laplacian", BALL, *words)
    assert result.exit_code == 2 and message in result.stderr and result.stderr.count("\n") == 1
