"""The pieces of an implicit step: summed blocks, truncated conjugate gradients, factorisations."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csc_array

from ddgcli.io.scene_file import parse_scene
from ddgcli.linalg.backends import NotPositiveDefinite
from ddgcli.linalg.conjugate import (
    truncated_conjugate_gradients,
    trust_region_conjugate_gradients,
)
from ddgcli.linalg.factor import Factor
from ddgcli.mechanics.assembly import Assembly
from ddgcli.mechanics.directions import Directions
from ddgcli.mechanics.hessian import assembly_of
from ddgcli.mechanics.increment import Increment, shorter_fraction
from ddgcli.mechanics.integrators import INTEGRATORS
from ddgcli.mechanics.objective import Objective
from ddgcli.mechanics.pair_blocks import PairBlocks, have_distinct_vertices, whole_blocks
from ddgcli.mechanics.secant import Secants
from ddgcli.mechanics.system import Motion
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell import model
from ddgcli.models.shell.bending import HingeBending, QuadraticBending
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from tests.simulate import FALLING_CLOTH, scalar, shell_run


def spd(n, seed=0, least=1.0):
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(n, n)))[0]
    return (q * np.linspace(least, 10.0, n)) @ q.T


@pytest.mark.parametrize("has_fixed", [False, True])
def test_assembly_sums_symmetric_blocks(has_fixed):
    rng = np.random.default_rng(1)
    n, stencils = 7, [rng.permuted(np.tile(np.arange(7), (5, 1)), axis=1)[:, :s] for s in (3, 4, 1)]
    free = rng.random((n, 3)) > 0.4 if has_fixed else np.ones((n, 3), dtype=bool)
    blocks = [rng.normal(size=(5, 3 * s.shape[1], 3 * s.shape[1])) for s in stencils]
    blocks = [b + b.transpose(0, 2, 1) for b in blocks]
    weight = rng.random(n)
    expected = np.diag(np.repeat(weight, 3))
    for stencil, block in zip(stencils, blocks):
        for vertices, local in zip(stencil, block):
            dofs = (3 * vertices[:, None] + np.arange(3)).ravel()
            expected[np.ix_(dofs, dofs)] += local
    unknowns = free.ravel()
    assembly = Assembly(free, stencils)
    for _ in range(2):  # the second call reuses the arrays of the first
        matrix = assembly.matrix(blocks, weight)
        assert np.allclose(matrix.toarray(), expected[np.ix_(unknowns, unknowns)], atol=1e-13)
        assert matrix.has_sorted_indices


def test_assembly_by_pairs_equals_that_of_whole_blocks():
    """Elements that translation does not change: pairs contain everything, in any order of vertices."""
    rng = np.random.default_rng(1)
    n, stencils = 7, [rng.permuted(np.tile(np.arange(7), (5, 1)), axis=1)[:, :s] for s in (3, 4, 2)]
    free = rng.random((n, 3)) > 0.4
    by_pairs = [rng.normal(size=(3, 3, s.shape[1] * (s.shape[1] - 1) // 2, 5)) for s in stencils]
    whole = [whole_blocks(stencil, blocks) for stencil, blocks in zip(stencils, by_pairs)]
    expected = Assembly(free, stencils).matrix(whole, np.ones(n)).toarray()
    for flags in ([True, True, True], [False, True, True], [True, False, False]):
        blocks = [pairs if flag else full for flag, pairs, full in zip(flags, by_pairs, whole)]
        matrix = Assembly(free, stencils, flags).matrix(blocks, np.ones(n)).toarray()
        assert np.allclose(matrix, expected, atol=1e-13)


def test_blocks_of_pairs_have_rows_of_the_lesser_vertex():
    stencil = np.array([[2, 0, 5], [1, 4, 3], [6, 7, 8]])
    pairs, blocks = PairBlocks(stencil), np.random.default_rng(2).normal(size=(3, 3, 3, 3))
    pairs.values[:] = blocks
    for rows in (slice(0, 2), slice(2, 3)):
        pairs.transpose_descending(rows)
    for p, (a, b) in enumerate(((0, 1), (0, 2), (1, 2))):
        for k, vertices in enumerate(stencil):
            block = blocks[:, :, p, k]
            expected = block if vertices[a] < vertices[b] else block.T
            assert np.array_equal(pairs.values[:, :, p, k], expected)


def test_hinge_whose_two_apexes_are_one_vertex_is_assembled():
    """Two triangles back to back: their hinges have a vertex twice, and so no pairs of distinct vertices."""
    x = np.array([[0, 0, 0], [1, 0, 0], [0.2, 0.9, 0], [0.3, 1.1, 0.4]])
    stencil = np.array([[0, 1, 2, 2], [0, 1, 2, 3]])
    hinges = HingeBending(stencil, np.ones(2), np.array([2.0, 0.1]))
    assert not have_distinct_vertices(stencil) and have_distinct_vertices(stencil[1:])
    matrix = Assembly(np.ones((4, 3), dtype=bool), [stencil]).matrix([hinges.blocks(x, "exact")], np.zeros(4))
    system = SimpleNamespace(potentials=[hinges], free=np.ones((4, 3), dtype=bool))
    increment = Increment(0.0, x)
    assert assembly_of(system, increment).by_pairs == [False]
    spin = np.cross([0.3, -1.0, 0.4], x).ravel()
    force = hinges.gradient(x)
    assert np.allclose(matrix @ spin, np.cross([0.3, -1.0, 0.4], force).ravel(), atol=1e-12)


def test_secants_find_a_minimum_faster_than_the_factorisation_alone():
    """On a quadratic function, from a matrix near its own; each move descends."""
    A, near, b = spd(40), spd(40) + 0.8 * spd(40, 1), np.random.default_rng(2).normal(size=40)
    inverse, truth = np.linalg.inv(near), np.linalg.solve(A, b)
    secants, y, alone = Secants(), np.zeros(40), np.zeros(40)
    for _ in range(12):
        g = A @ y - b
        secants.add(y, g)
        move = secants.solve(-g, inverse.__matmul__)
        assert -g @ move > 0
        y, alone = y + move, alone - inverse @ (A @ alone - b)
    assert np.abs(y - truth).max() < 0.1 * np.abs(alone - truth).max()
    secants.restart()
    assert np.array_equal(secants.solve(b, inverse.__matmul__), inverse @ b)


def test_conjugate_gradients_stop_at_the_tolerance():
    A, near, b = spd(40), spd(40) + 0.3 * spd(40, 1), np.random.default_rng(2).normal(size=40)
    inverse = np.linalg.inv(near)
    truth = np.linalg.solve(A, b)
    for share in (1e-2, 1e-5, 1e-10):
        move = truncated_conjugate_gradients(A.__matmul__, inverse.__matmul__, b, share.__mul__, 60)
        assert move.convex and move.error <= share * np.abs(inverse @ b).max()
        assert np.abs(move.x - truth).max() <= 20 * share * np.abs(truth).max()


def test_conjugate_gradients_keep_a_balance_that_matrix_and_preconditioner_share():
    """Translations: whatever is left of the residual has no part along them, so total momentum is exact."""
    n = 30
    ones, rng = np.ones(n) / np.sqrt(n), np.random.default_rng(3)
    project = np.eye(n) - np.outer(ones, ones)
    A = project @ spd(n, 4) @ project + 2.0 * np.outer(ones, ones)
    near = project @ (spd(n, 4) + 0.2 * spd(n, 5)) @ project + 2.0 * np.outer(ones, ones)
    b = rng.normal(size=n)
    inverse = np.linalg.inv(near)
    move = truncated_conjugate_gradients(A.__matmul__, inverse.__matmul__, b, lambda f: 0.1 * f, 20)
    residual = b - A @ move.x
    assert np.abs(residual).max() > 1e-4
    assert abs(residual @ ones) <= 1e-13 * np.abs(b).max()


def test_negative_curvature_ends_with_a_descent_direction_or_goes_through():
    A = spd(20)
    value, vector = np.linalg.eigh(A)
    A = A - (value[0] + 0.05) * np.outer(vector[:, 0], vector[:, 0])
    b = vector[:, 1:].sum(axis=1) + 1e-3 * vector[:, 0]
    inverse = np.linalg.inv(spd(20) + 0.5 * spd(20, 1))
    move = truncated_conjugate_gradients(A.__matmul__, inverse.__matmul__, b, lambda f: 1e-10 * f, 60)
    assert not move.convex and b @ move.x > 0
    saddle = truncated_conjugate_gradients(
        A.__matmul__, inverse.__matmul__, b, lambda f: 1e-10 * f, 60, continue_past=lambda f: True
    )
    assert saddle.convex and np.abs(A @ saddle.x - b).max() <= 1e-8
    assert truncated_conjugate_gradients(A.__matmul__, lambda r: -r, b, lambda f: 0.0, 5) is None


@pytest.mark.parametrize("radius", [1e-3, 1e3])
def test_conjugate_gradients_minimise_the_model_in_the_trust_region(radius):
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(9, 9))
    hessian, gradient = matrix @ matrix.T + np.eye(9), rng.normal(size=(3, 3))
    newton = trust_region_conjugate_gradients(
        gradient, lambda v: (hessian @ v.ravel()).reshape(3, 3), lambda r: r, radius, 200
    )
    exact = -np.linalg.solve(hessian, gradient.ravel()).reshape(3, 3)
    d = newton.x
    model = np.sum(gradient * d) + 0.5 * d.ravel() @ hessian @ d.ravel()
    assert newton.fall == pytest.approx(-model, rel=1e-9)
    if radius < 1:
        assert newton.at_boundary and np.linalg.norm(d) == pytest.approx(radius)
        assert np.allclose(d / radius, -gradient / np.linalg.norm(gradient), atol=0.02)
    else:
        assert not newton.at_boundary and np.linalg.norm(d - exact) < 0.3 * np.linalg.norm(exact)


def test_factor_without_pivoting_reports_an_indefinite_matrix():
    indefinite = csc_array(np.diag([1.0, -1.0, 2.0]))
    with pytest.raises(NotPositiveDefinite):
        Factor(indefinite, pivot=False)
    factor = Factor(csc_array(np.eye(3)), pivot=False)
    with pytest.raises(NotPositiveDefinite):
        factor.refactor(csc_array(np.diag([1.0, -1.0, 2.0])))
    assert np.allclose(Factor(indefinite).solve(np.ones(3)), [1, -1, 0.5])


CLOTH = """
[time]
duration = 0.3
step = 0.01
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [1, 1], cells = [12, 12] }}
density = 0.2
thickness = "1 mm"
young = 1e5
poisson = 0.3
[effects]
stretching = {{}}
bending = {{}}
gravity = {{}}
pin = {{ vertices = [0, 12] }}
"""
LINEAR_CLOTH = CLOTH.replace("stretching = {{}}\n", "").replace(
    "bending = {{}}", 'bending = {{ model = "quadratic" }}'
)


@pytest.mark.parametrize("integrator", ["newmark", "implicit-midpoint", "implicit-euler"])
def test_a_step_of_the_hanging_cloth_costs_few_iterations_and_one_factorisation(integrator, monkeypatch):
    """Undamped waves faster than the step cost nine iterations a step with a guess that overshoots them."""
    count = [0]
    factorise = Directions._factorise

    def counted(*arguments):
        count[0] += 1
        factorise(*arguments)

    monkeypatch.setattr(Directions, "_factorise", counted)
    hessians, hessian = [], Objective.hessian
    monkeypatch.setattr(
        Objective, "hessian", lambda *values, **options: hessians.append(1) or hessian(*values, **options)
    )
    run, _, _ = shell_run(CLOTH.format(integrator=integrator))
    iterations = np.diff(scalar(run, "newton_iterations"))
    assert iterations.mean() <= 5
    assert count[0] <= 1.5 * 30
    assert len(hessians) <= 0.7 * iterations.sum()  # the others come from changes of the gradient


def test_steps_without_contact_begin_with_the_projected_hessian(monkeypatch):
    """It always factorises, and costs half of the exact one, which later moves need seldom."""
    modes, matrix = [], Objective.hessian

    def recorded(self, increment, y, mode, shift=0.0, **options):
        modes.append(mode)
        return matrix(self, increment, y, mode, shift, **options)

    monkeypatch.setattr(Objective, "hessian", recorded)
    run, _, _ = shell_run(CLOTH.format(integrator="newmark"))
    moves = scalar(run, "newton_iterations")[-1]
    assert modes[0] == "projected" and modes.count("projected") >= 30
    assert modes.count("exact") <= 0.3 * moves


def test_steps_of_a_linear_shell_evaluate_no_energy(monkeypatch):
    """One solve with the constant matrix is the step from any guess."""
    values, value = [], Objective.at
    monkeypatch.setattr(Objective, "at", lambda *arguments: values.append(1) or value(*arguments))
    run, _, _ = shell_run(LINEAR_CLOTH.format(integrator="newmark"))
    assert not values and np.ptp(scalar(run, "energy_gravity")) > 0


@pytest.mark.parametrize("pinned", [True, False])
def test_a_step_with_a_constant_matrix_is_the_minimiser_and_costs_one_gradient(pinned, monkeypatch):
    """M a = -K x - gravity at the end of a step, from a state that no scheme reached; held vertices rest."""
    text = LINEAR_CLOTH.format(integrator="newmark")
    text = text if pinned else text.replace("pin = { vertices = [0, 12] }", "")
    scene = resolve(parse_scene(text), KIND, {})
    context, _ = model.contexts(scene, None)["s"]
    system, rng = model.make_system(scene, context, Account()), np.random.default_rng(2)
    x = np.array(context.mesh.points) + 1e-3 * rng.normal(size=(context.mesh.n_vertices, 3))
    v, a = system.only_free(rng.normal(size=(2, *x.shape))[0]), system.only_free(rng.normal(size=x.shape))
    calls, gradient = [], QuadraticBending.gradient
    monkeypatch.setattr(QuadraticBending, "gradient", lambda *args: calls.append(1) or gradient(*args))
    dt = 0.01
    after = INTEGRATORS["newmark"].step(system, Motion(x, v, a), dt, scene.time)
    assert len(calls) == 1 and after.newton == 1
    force = -system.full_gradient(after.x)
    scale = (np.abs(system.potentials[0].matrix).max() + 4 / dt**2 * system.mass.max()) * np.abs(x).max()
    assert np.abs((force - system.mass[:, None] * after.a)[system.free]).max() <= 2e-15 * scale
    assert np.abs(after.x - (x + dt * v + dt**2 / 4 * (a + after.a))).max() <= 1e-15
    assert np.abs(after.v - (v + dt / 2 * (a + after.a))).max() <= 1e-15 * np.abs(after.v).max()
    assert np.array_equal(after.x[~system.free], x[~system.free]) and system.all_free is not pinned


@pytest.mark.parametrize("through", [False, True])
def test_a_move_always_descends(through):
    rng = np.random.default_rng(5)
    n_moves = 0
    for _ in range(2000):
        n = rng.integers(2, 8)
        Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
        near = (Q * 10 ** rng.uniform(-1, 1, n)) @ Q.T
        other = rng.normal(size=(n, n))
        A = near * 10 ** rng.uniform(-0.3, 0.3) + (other + other.T) * 10 ** rng.uniform(-2, 1)
        inverse, b = np.linalg.inv(near), rng.normal(size=n)
        move = truncated_conjugate_gradients(
            A.__matmul__, inverse.__matmul__, b, lambda f: 1e-2 * f, 15, continue_past=lambda f: through
        )
        if move is not None:
            assert b @ move.x > 0
            n_moves += 1
    assert n_moves > 1000


@pytest.mark.parametrize("integrator", ["newmark", "implicit-euler"])
def test_a_falling_strip_of_needles_keeps_the_balance_of_momentum(integrator):
    """Stiffness 1e12 times the inertia: a solve leaves a hundredth of the balance, and moves short by the
    strip's size are not short by its fall (the momentum was off by 4e-5)."""
    strip = """
[time]
duration = 0.04
step = 0.01
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
mesh = "needles"
material = "cotton"
[effects]
stretching = {{}}
bending = {{}}
gravity = {{}}
"""
    along = np.arange(72)
    points = np.stack([0.5 * along, 1e-6 * (along % 2), np.zeros(72)], axis=1)
    faces = [[k, k + 1, k + 2] if k % 2 == 0 else [k + 1, k, k + 2] for k in range(70)]
    mesh = TriangleMesh.from_arrays(points, np.array(faces))
    read = SimpleNamespace(mesh=mesh, vertex={}, face={}, sha256="", notes=())
    run, contexts, _ = shell_run(strip.format(integrator=integrator), lambda name: read)
    fallen = -9.81 * 0.04 * contexts["s"].mass.sum()
    momentum = np.array(scalar(run, "momentum"))[-1]
    assert np.abs(momentum - [0, 0, fallen]).max() <= 1e-7 * abs(fallen)


def test_shorter_fraction_is_the_least_point_of_a_parabola_within_bounds():
    for least in (0.15, 0.3, 0.45):
        slope = -2.0
        assert np.isclose(shorter_fraction(1.0, slope - 0.5 * slope / least, slope), least)
        assert np.isclose(shorter_fraction(0.2, 0.2 * slope * (1 - 0.5 / least), slope), 0.2 * least)
    assert shorter_fraction(1.0, np.inf, -1.0) == shorter_fraction(1.0, np.nan, -1.0) == 0.5
    assert np.isclose(shorter_fraction(0.5, 1e9, -1.0), 0.05)  # a barrier: no less than a tenth


def test_a_cloth_that_strikes_a_ball_needs_under_two_values_a_newton_iteration(monkeypatch):
    """Friction sticks and slips and the barrier is steep, so whole moves climb there again and again."""
    values, value = [], Objective.at

    def counted(self, *arguments):
        values.append(1)
        return value(self, *arguments)

    monkeypatch.setattr(Objective, "at", counted)
    snapshots, _, _ = shell_run(
        FALLING_CLOTH.format(integrator="implicit-euler")
        .replace("[5, 5]", "[10, 10]")
        .replace("rubber", "cotton")
        .replace("position = [0, 0, 0.02]", "position = [-0.5, -0.5, 0.31]")
        .replace("plane = { point = [0, 0, 0], normal = [0, 0, 1] }", "sphere = { radius = 0.3 }")
    )
    assert len(values) < 1.8 * scalar(snapshots, "newton_iterations", "cloth")[-1]
