"""Implicit shell steps by conjugate gradients, where the factors of the Hessian do not fit into memory."""

import json

import numpy as np
import pytest
from scipy.sparse import bsr_array, csc_array, eye_array, kron

from ddgcli.choices import ITERATIVE_SOLVERS
from ddgcli.errors import SolveError
from ddgcli.geometry.hinges import hinges
from ddgcli.linalg import aggregation, backends, displacements
from ddgcli.linalg.displacements import BlockIterative, RigidMotions
from ddgcli.mechanics import pieces
from ddgcli.mechanics.assembly import Assembly
from ddgcli.mechanics.hessian import assembly_of_terms, blocks_of
from ddgcli.mechanics.rounding import Rounding
from ddgcli.mesh import shapes
from ddgcli.models.shell.bending import HingeBending
from ddgcli.models.shell.stretching import StVK, face_basis
from ddgcli.operators.laplacian import stiffness
from tests.simulate import FALLING_CLOTH, HANGING_CLOTH, shell_run

SOLVERS = pytest.mark.parametrize("solver", ITERATIVE_SOLVERS)
BALL = """
[time]
duration = 4e-3
step = 2e-3
integrator = "newmark"
[[object]]
name = "ball"
role = "shell"
sphere = { radius = 0.1, subdivisions = 2 }
density = 1000
thickness = "1 mm"
young = "1 MPa"
poisson = 0.3
[effects]
stretching = {}
bending = { model = "MODEL" }
gravity = {}
pressure = { value = 500, gas = true }
"""
SCENES = {
    "pinned": HANGING_CLOTH.format(cells=12).replace("duration = 0.04", "duration = 0.012"),
    "gas": BALL.replace("MODEL", "hinge"),
    "internal unknowns": BALL.replace("MODEL", "midedge"),
    "contact": FALLING_CLOTH.format(integrator="implicit-euler").replace("duration = 0.1", "duration = 0.02"),
}


@pytest.fixture(autouse=True)
def _pyamg(request):
    if "multigrid" in request.node.name:
        pytest.importorskip("pyamg")


def end_of(text, **overrides):
    snapshots, _, _ = shell_run(text, **overrides)
    return [snapshots[k].observations[next(iter(snapshots[0].observations))].points for k in (0, -1)]


@SOLVERS
@pytest.mark.parametrize("name", SCENES)
def test_conjugate_gradients_give_the_motion_of_the_factorisation(name, solver, monkeypatch):
    start, end = end_of(SCENES[name])
    monkeypatch.setenv("DDGCLI_SOLVER", solver)
    assert np.abs(end_of(SCENES[name])[1] - end).max() <= 1e-7 * np.abs(end - start).max()


def test_levels_in_pieces_take_the_same_iterations(monkeypatch):
    pytest.importorskip("pyamg")
    mesh = shapes.grid(40, 30)
    laplacian = stiffness(mesh) + 1e-3 * eye_array(mesh.n_vertices)
    matrix = bsr_array(kron(laplacian, np.eye(3)), blocksize=(3, 3))
    rhs = np.random.default_rng(0).normal(size=matrix.shape[0])
    motions = RigidMotions(np.tile(np.eye(3), (mesh.n_vertices, 1)), True)
    runs = []
    for limits in ({}, {"MAX_TRANSPOSE": 0, "PIECE_ENTRIES": 5000}):
        for name, value in limits.items():
            monkeypatch.setattr(aggregation, name, value)
        iterative = BlockIterative("multigrid")
        iterative.prepare(matrix, motions)
        runs.append((iterative.solve(rhs), iterative.most_iterations))
    (whole, n_whole), (summed, n_pieces) = runs
    assert n_whole == n_pieces <= 12  # 1200 vertices: plain conjugate gradients take ten times as many
    assert np.abs(whole - summed).max() <= 1e-12 * np.abs(whole).max()


def test_conjugate_gradients_find_the_equilibrium_of_the_factorisation(monkeypatch):
    start, end = end_of(SCENES["pinned"], integrator="static")
    monkeypatch.setenv("DDGCLI_SOLVER", "conjugate-gradients")
    assert (
        np.abs(end_of(SCENES["pinned"], integrator="static")[1] - end).max()
        <= 1e-6 * np.abs(end - start).max()
    )


def test_steps_without_memory_for_factors_name_their_solver(monkeypatch, tmp_path, run):
    scene = tmp_path / "cloth.toml"
    scene.write_text(SCENES["pinned"])

    def result(name):
        return run("shell-sim", scene, "-o", tmp_path / name, "--json")

    assert "step_solver" not in result("a.vtkhdf").stdout
    monkeypatch.setattr(backends, "MIN_CHECKED_UNKNOWNS", 0)
    monkeypatch.setattr(backends, "available_memory", lambda: 1e4)
    monkeypatch.setattr(backends, "preferred_iterative_solver", lambda: "conjugate-gradients")
    limited = result("b.vtkhdf")
    assert "need about" in limited.stderr and "conjugate gradients solve instead" in limited.stderr
    accuracy = json.loads(limited.stdout)["accuracy"]
    assert accuracy["step_solver"] == "conjugate-gradients"
    assert 0 < accuracy["step_solver_iterations"] < 300 and accuracy["step_solver_residual"] < 1e-4


def test_a_step_whose_solver_does_not_converge_is_reported(monkeypatch, tmp_path, run):
    scene = tmp_path / "cloth.toml"
    scene.write_text(SCENES["pinned"])
    monkeypatch.setenv("DDGCLI_SOLVER", "conjugate-gradients")
    monkeypatch.setattr(displacements, "MAX_ITERATIONS", 0)
    result = run("shell-sim", scene, "-o", tmp_path / "a.vtkhdf")
    assert result.exit_code == 1 and "conjugate-gradients did not converge in 0 iterations" in result.stderr


@SOLVERS
@pytest.mark.parametrize("has_fixed", [False, True])
def test_a_solution_has_the_residual_that_it_states(solver, has_fixed):
    """Springs in a strip: by (3, 3) blocks and by numbers."""
    mesh, rng = shapes.grid(12, 4), np.random.default_rng(1)
    edges, n = mesh.topology.edges, mesh.n_vertices
    free = np.repeat(rng.random(n) > 0.2 * has_fixed, 3).reshape(n, 3)
    direction = rng.normal(size=(len(edges), 3))
    along = direction[:, :, None] * direction[:, None, :]
    blocks = np.concatenate([np.concatenate([along, -along], 2), np.concatenate([-along, along], 2)], 1)
    assembly = Assembly(free, [edges])
    assert assembly.by_vertex
    by_blocks, by_numbers = (
        make([blocks], np.full(n, 0.01)) for make in (assembly.block_matrix, assembly.matrix)
    )
    assert isinstance(by_blocks, bsr_array) and np.array_equal(by_blocks.toarray(), by_numbers.toarray())
    rhs = rng.normal(size=by_numbers.shape[0])
    exact = np.linalg.solve(by_numbers.toarray(), rhs)
    for matrix in (by_blocks, by_numbers):
        iterative = BlockIterative(solver)
        iterative.prepare(matrix, RigidMotions(np.tile(np.eye(3), (len(rhs) // 3, 1)), matrix is by_blocks))
        x = iterative.solve(rhs)
        residual = np.linalg.norm(by_numbers @ x - rhs) / np.linalg.norm(rhs)
        assert residual <= 1.01 * iterative.residual + 1e-14
        assert np.abs(x - exact).max() <= 1e-4 * np.abs(exact).max()


def test_an_indefinite_matrix_is_refused():
    iterative = BlockIterative("conjugate-gradients")
    iterative.prepare(csc_array(np.array([[1.0, 2.0], [2.0, 1.0]])), RigidMotions(np.ones((2, 1)), False))
    with pytest.raises(SolveError, match="not positive definite"):
        iterative.solve(np.array([1.0, -1.0]))


@pytest.mark.parametrize("mesh", [shapes.grid(9, 7), shapes.random_sphere(90, 0)], ids=["grid", "random"])
def test_pieces_of_a_potential_have_the_sums_of_the_whole(mesh, monkeypatch):
    """Vertices of a piece lie together in a grid, and anywhere in a sphere whose vertices are random."""
    x = np.asarray(mesh.points) + 0.01 * np.random.default_rng(0).normal(size=mesh.points.shape)
    faces, stencil = np.asarray(mesh.faces), hinges(mesh.topology)
    terms = [
        StVK(faces, face_basis(mesh), np.ones(len(faces)), 1.0, 2.0),
        HingeBending(stencil, np.ones(len(stencil)), np.zeros(len(stencil))),
    ]
    free = np.arange(3 * len(x)).reshape(-1, 3) >= 12

    def sums():
        potentials = [pieces.in_pieces(p) for p in terms]
        assembly = assembly_of_terms(free, potentials)
        by_pairs = iter(assembly.by_pairs)
        blocks = (block for p in potentials for block in blocks_of(p, by_pairs, x, "exact"))
        hessian = assembly.block_matrix(blocks, np.arange(len(x), dtype=float)).toarray()
        trace = np.array(Rounding.at(potentials, np.ones(len(x)), x).stiffness)
        energy = np.array([p.energy(x) for p in potentials])
        return len(assembly.by_pairs), [hessian, trace, energy, *(p.gradient(x) for p in potentials)]

    n_whole, whole = sums()
    monkeypatch.setattr(pieces, "MIN_PIECE", 20)
    monkeypatch.setattr(pieces, "MAX_PIECES", 100)
    n_pieces, summed = sums()
    assert n_whole == 2 and n_pieces > 12
    for a, b in zip(whole, summed):
        assert np.abs(a - b).max() <= 1e-13 * np.abs(a).max()
