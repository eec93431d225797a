"""Natural frequencies, buckling loads, and strains, stresses and moments of the faces."""

import numpy as np
import pytest
from scipy.sparse import csc_array

from ddgcli.errors import SolveError
from ddgcli.io.mesh_file import read_mesh
from ddgcli.linalg.modes import lowest_eigenpairs
from ddgcli.mechanics.increment import Increment
from ddgcli.mechanics.modes import buckling_modes, natural_modes
from ddgcli.mechanics.objective import Objective
from ddgcli.mechanics.rigid_motions import unheld_motions
from ddgcli.mesh.shapes import box, grid, icosphere
from ddgcli.models.shell.analysis import warn_of_ramps
from ddgcli.models.shell.face_arrays import face_arrays
from ddgcli.models.shell.plate_check import (
    deflection_factor,
    frequency_factor,
    load_factor,
    plate_twin,
    warn_of_hinges,
)
from ddgcli.models.shell.report import _instability
from tests.converge.test_laplacian_rates import disk
from tests.physics.test_shell_midedge import CLAMP, RIGIDITY, SCENE, border, built, run, square

STRIP = grid(20, 2, 1, 0.1, "alternating")
X = np.asarray(STRIP.points)
ROOT, TIP = np.flatnonzero(X[:, 0] < 1e-9).tolist(), np.flatnonzero(X[:, 0] > 1 - 1e-9).tolist()
HINGED = SCENE.replace('"midedge"', '"hinge"')
AMBIENT = 1e5  # Pa, of a gas
EULER = np.pi**2 * RIGIDITY / 4  # N/m, of the strip clamped at one end


def push(force):
    return f"load = {{ line_force = [{-force}, 0, 0], vertices = {TIP} }}"


@pytest.mark.parametrize("pattern", ["alternating", "irregular"])
def test_frequencies_of_a_simply_supported_plate_are_sums_of_squares(pattern):
    """(m^2 + n^2) pi / 2 sqrt(D / density); second order, the error grows with the frequency."""
    errors = []
    for n in (8, 16):
        mesh = square(n, pattern)
        _, _, system = built(mesh, f"pin = {{ vertices = {border(mesh)} }}", poisson=0.3)
        modes = natural_modes(system, np.asarray(mesh.points), 4)
        truth = np.array([2, 5, 5, 8]) * np.pi / 2 * np.sqrt(RIGIDITY / 0.91)
        errors.append(np.abs(modes.values / truth - 1))
    assert errors[1].max() <= 0.05
    assert errors[1][0] <= 0.013
    assert 3.3 <= errors[0][0] / errors[1][0] <= 4.7


def test_frequencies_of_a_cantilever_are_those_of_the_beam():
    _, _, system = built(STRIP, CLAMP.format(ROOT))
    values = natural_modes(system, X, 2).values
    truth = np.array([1.8751041, 4.6940911]) ** 2 * np.sqrt(RIGIDITY) / (2 * np.pi)
    assert np.abs(values / truth - 1) == pytest.approx(0, abs=0.02)
    assert values[0] == pytest.approx(truth[0], rel=0.005)


@pytest.mark.parametrize("k", [1, 6, 8])
@pytest.mark.parametrize("mesh", [STRIP, icosphere(2)], ids=["strip", "sphere"])
def test_free_body_has_six_modes_of_frequency_zero(mesh, k):
    _, _, system = built(mesh, poisson=0.3)
    modes = natural_modes(system, np.asarray(mesh.points), k)
    assert (modes.values[:6] == 0).all()
    assert (modes.values[6:] > 1e-3).all()
    for shape in modes.shapes[:6]:
        edges = mesh.points[mesh.topology.edges[:, 1]] - mesh.points[mesh.topology.edges[:, 0]]
        moves = shape[mesh.topology.edges[:, 1]] - shape[mesh.topology.edges[:, 0]]
        assert np.abs(np.einsum("ei,ei->e", edges, moves)).max() <= 1e-6 * np.abs(edges).max()


def test_shapes_of_equal_frequencies_do_not_depend_on_the_start_of_the_iteration():
    """Rigid motions, and pairs of equal frequencies of a symmetric plate."""
    plate = grid(12, 12, 1, 1, "alternating")
    _, _, system = built(plate, poisson=0.3)
    objective = Objective(system)
    stiffness = csc_array(objective.hessian(Increment(0.0, plate.points), plate.points, "exact"))
    mass = objective.gather(np.repeat(system.mass[:, None], 3, axis=1))
    (values, shapes), (_, others) = (lowest_eigenpairs(stiffness, mass, 11, seed) for seed in (0, 1))
    assert (values[:6] == 0).all() and (np.abs(np.diff(values[6:])) < 1e-9 * values[7:]).any()
    assert np.abs(others - shapes).max() <= 1e-6 * np.abs(shapes).max()


def test_lanczos_and_dense_eigenpairs_agree():
    mesh = square(14, "irregular")
    _, _, system = built(mesh, poisson=0.3)
    x = np.asarray(mesh.points)
    modes = natural_modes(system, x, 12)
    from ddgcli.linalg import modes as solver

    dense, solver.MAX_DENSE_SIZE = solver.MAX_DENSE_SIZE, 10**6
    try:
        truth = natural_modes(system, x, 12)
    finally:
        solver.MAX_DENSE_SIZE = dense
    assert len(x) * 3 > dense
    assert modes.values == pytest.approx(truth.values, rel=1e-6, abs=1e-9)


def test_more_than_half_of_all_modes_begin_with_the_first_ones():
    k, ball = 300, icosphere(2)
    _, _, system = built(ball, poisson=0.3)
    first, many = (natural_modes(system, np.asarray(ball.points), number).values for number in (12, k))
    assert len(many) == k
    assert many[:12] == pytest.approx(first, rel=1e-6)


def test_a_ball_of_gas_breathes_with_the_stiffness_of_the_shell_and_of_the_gas():
    errors = []
    for level in (1, 2):
        ball = icosphere(level)
        x = np.asarray(ball.points)
        _, _, system = built(ball, f"pressure = {{ gas = true, ambient = {AMBIENT} }}", poisson=0.3)
        modes = natural_modes(system, x, x.size)
        breath = np.abs(np.einsum("knd,nd->k", modes.shapes, x)).argmax()
        # radius 1: hoop strain of both directions, and p V constant
        stiffness = 2 * 1.2e7 * 0.01 / 0.7 + 3 * AMBIENT
        errors.append(1 - modes.values[breath] * 2 * np.pi / np.sqrt(stiffness))
        assert (modes.values[:6] == 0).all()
    assert abs(errors[1]) <= 0.01
    assert 3.3 <= errors[0] / errors[1] <= 4.7


def test_a_gas_moves_each_frequency_up_and_not_above_the_next_one(monkeypatch):
    """Cauchy's interlacing: the Hessian of a gas has rank one. By Lanczos and by a dense solver."""
    from ddgcli.linalg import modes as solver

    cube = box(5, 5, 5)
    x = np.asarray(cube.points)
    gas = f"pressure = {{ gas = true, ambient = {AMBIENT} }}"
    empty, full = (built(cube, effects, poisson=0.3)[2] for effects in ("", gas))
    without, filled = natural_modes(empty, x, 31).values, natural_modes(full, x, 30).values
    slack = 1e-6 * without[-1]
    assert (filled >= without[:30] - slack).all() and (filled <= without[1:] + slack).all()
    assert (filled > without[:30] + 1e-3).any()
    assert x.size > solver.MAX_DENSE_SIZE
    monkeypatch.setattr(solver, "MAX_DENSE_SIZE", 10**6)
    assert filled == pytest.approx(natural_modes(full, x, 30).values, rel=1e-6, abs=1e-9)


def test_buckling_load_of_a_clamped_strip_is_eulers():
    _, _, system = built(STRIP, CLAMP.format(ROOT) + "\n" + push(2.0))
    modes = buckling_modes(system, X, 3)
    assert 2 * modes.values / (EULER * np.array([1, 9, 25])) == pytest.approx(1, abs=0.03)
    assert 2 * modes.values[0] == pytest.approx(EULER, rel=0.002)
    sine = 1 - np.cos(0.5 * np.pi * X[:, 0])
    assert np.abs(np.abs(modes.shapes[0][:, 2]) - sine).max() <= 0.01


def test_compression_lowers_the_frequency_to_zero_at_the_buckling_load():
    """f^2 falls nearly in a straight line: Galerkin with the first shape leaves 1 - 1.01 P / Euler's load."""
    _, _, free = built(STRIP, CLAMP.format(ROOT))
    first = natural_modes(free, X, 1).values[0]
    effects = CLAMP.format(ROOT) + "\n" + push(0.5 * EULER)
    x = run(STRIP, effects)[-1].observations["s"].points
    _, _, system = built(STRIP, effects)
    assert (natural_modes(system, x, 1).values[0] / first) ** 2 == pytest.approx(0.5, abs=0.02)
    _, _, system = built(STRIP, CLAMP.format(ROOT) + "\n" + push(1.1 * EULER))
    assert natural_modes(system, X * [1 - 1.1 * EULER / 1.2e5, 1, 1], 1).values[0] < 0


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        (CLAMP.format(ROOT), "nothing buckles"),
        (push(1.0), "nothing holds the shell"),
        ("pin = { box = [[0, 0, 0], [1, 1, 0]] }\n" + push(1.0), "nothing buckles"),
    ],
)
def test_shells_that_cannot_buckle_are_errors(effects, message):
    _, _, system = built(STRIP, effects)
    with pytest.raises(SolveError, match=message):
        buckling_modes(system, X, 2)


HINGE = f"[[effects.pin]]\nvertices = {ROOT}\n"
CORNER = f"[[effects.pin]]\nvertices = [{ROOT[0]}]\n"
MEMBRANE = "\n".join(line for line in SCENE.splitlines() if not line.startswith("bending"))


@pytest.mark.parametrize("n", [4, 40])  # dense and sparse solvers
@pytest.mark.parametrize(
    ("text", "force", "message"),
    [
        (SCENE, 1.0, "leave a rotation free"),  # load factors of 1e-14: rounding of the stiffness
        (SCENE, -1.0, "leave a rotation free"),
        (MEMBRANE, 1.0, "without resistance"),
    ],
)
def test_no_load_factor_is_made_of_the_rounding_of_a_singular_stiffness(n, text, force, message):
    mesh = grid(n, n // 2, 1, 0.1, "alternating")
    root, tip = (np.flatnonzero(mesh.points[:, 0] == x).tolist() for x in (0, 1))
    pins = f"pin = {{ vertices = {root}, clamp = {str(text is MEMBRANE).lower()} }}"
    load = f"load = {{ line_force = [{-force}, 0, 0], vertices = {tip} }}"
    _, _, system = built(mesh, f"{pins}\n{load}", text=text)
    with pytest.raises(SolveError, match=message):
        buckling_modes(system, np.asarray(mesh.points), 2)


def test_a_ramp_of_the_load_is_no_part_of_its_factors(caplog):
    """A ramp from 0 hides its load from linear theory, which takes the shell at the start."""
    ramp = push(1.0).replace(" }", ", times = [0, 1], factors = [0.5, 1] }")
    _, _, system = built(STRIP, CLAMP.format(ROOT) + "\n" + ramp)
    warn_of_ramps({"s": system})
    assert "ramped loads count with their factors at 0 s (0.5)" in caplog.text
    caplog.clear()
    warn_of_ramps({"s": built(STRIP, CLAMP.format(ROOT) + "\n" + push(1.0))[2]})
    assert not caplog.text


@pytest.mark.parametrize(
    ("effects", "motion"),
    [
        ("", "nothing holds the shell"),
        (CORNER, "leave 3 of 6 rigid motions free"),
        (CORNER + 'axes = "xy"', "leave 4 of 6 rigid motions free"),
        (HINGE, "leave a rotation free, about the axis (0, 1, 0) through (0, 0.05, 0)"),
        (HINGE + 'axes = "xz"\nclamp = true', "leave a translation free, along (0, 1, 0)"),
        (HINGE + "clamp = true", ""),
        (HINGE + CORNER.replace(f"{ROOT[0]}", f"{TIP[0]}"), ""),
    ],
)
def test_rigid_motions_that_supports_leave_free_are_named(effects, motion):
    _, _, system = built(STRIP, effects)
    unheld = unheld_motions(system).replace("(0, -1, 0)", "(0, 1, 0)")
    assert unheld == motion or (motion and unheld.endswith(motion))


def test_what_turns_without_bending_is_reported_as_a_rotation(caplog):
    """A strip hinged at one end and pushed towards it: straight is an equilibrium that a rotation leaves."""
    _, _, system = built(STRIP, push(1.0) + "\n" + HINGE)
    assert _instability({"s": X * [1 - 1.0 / 1.2e5, 1, 1]}, {"s": system}) == 1
    assert "leave a rotation free" in caplog.text and "buckle" not in caplog.text


def test_faces_of_a_stretched_strip_have_the_stress_of_the_load():
    """12 N/m on a thickness of 1 cm; Green's strain of StVK: force = E t lambda (lambda^2 - 1) / 2."""
    effects = f"""
[[effects.pin]]
vertices = {ROOT}
axes = "xz"
[[effects.pin]]
vertices = [{ROOT[0]}]
axes = "y"
[[effects.load]]
line_force = [600, 0, 0]
vertices = {TIP}
"""
    x = run(STRIP, effects, poisson=0.3)[-1].observations["s"].points
    _, context, system = built(STRIP, effects, poisson=0.3)
    arrays = face_arrays(context, system.potentials, x)
    stretch = np.roots([0.5 * 1.2e5, 0, -0.5 * 1.2e5, -600]).real.max()
    strain = 0.5 * (stretch**2 - 1)
    assert arrays["principal_strain"] == pytest.approx(np.tile([strain, -0.3 * strain], (80, 1)), rel=1e-6)
    width = np.sqrt(1 - 0.6 * strain)
    assert arrays["principal_stress"][:, 0] == pytest.approx(600 / 0.01 / width, rel=1e-6)
    assert np.abs(arrays["principal_stress"][:, 1]).max() <= 1e-6 * 600 / 0.01
    assert arrays["stress"].reshape(-1, 3, 3)[:, 0, 0] == pytest.approx(600 / 0.01 / width, rel=1e-6)


def test_faces_of_a_strip_under_an_end_moment_have_that_moment_everywhere():
    effects = f"{CLAMP.format(ROOT)}\nload = {{ moment = 2.0, vertices = {TIP} }}"
    x = run(STRIP, effects)[-1].observations["s"].points
    _, context, system = built(STRIP, effects)
    arrays = face_arrays(context, system.potentials, x)
    assert x[TIP, 2].mean() < -0.5  # positive moments bend towards convex
    assert np.median(arrays["principal_moment"][:, 0]) == pytest.approx(2.0, rel=0.01)
    assert np.abs(arrays["principal_moment"] - [2, 0]).max() <= 0.1
    normal = np.cross(
        x[STRIP.faces[:, 1]] - x[STRIP.faces[:, 0]], x[STRIP.faces[:, 2]] - x[STRIP.faces[:, 0]]
    )
    moment = arrays["bending_moment"].reshape(-1, 3, 3)
    assert np.abs(np.einsum("mij,mj->mi", moment, normal)).max() <= 1e-12


PLATE = """
[time]
integrator = "{integrator}"
[[object]]
name = "plate"
role = "shell"
grid = {{ size = [1, 1], cells = [6, 6] }}
density = 1
thickness = 0.01
young = 1.2e7
poisson = 0.3
[effects]
stretching = {{}}
bending = {{ model = "midedge" }}
pin = {{ box = [[0, 0, 0], [0, 1, 0]], clamp = true }}
load = {{ line_force = [-0.5, 0, 0.01], box = [[1, 0, 0], [1, 1, 0]] }}
"""


@pytest.mark.parametrize("integrator", ["static", "newmark"])
def test_command_writes_modes_and_face_arrays(tmp_path, summary, integrator):
    scene, out = tmp_path / "plate.toml", tmp_path / "plate.vtu"
    scene.write_text(PLATE.format(integrator=integrator))
    results = summary("shell-sim", scene, "--modes", 3, "--buckling", 2, "-o", out)["results"]
    assert len(results["frequencies"]) == 3 and len(results["load_factors"]) == 2
    assert results["frequencies"][0] == pytest.approx(3.47 / (2 * np.pi) * np.sqrt(RIGIDITY / 0.91), rel=0.25)
    assert results["load_factors"][0] * 0.5 == pytest.approx(EULER / 0.91, rel=0.1)
    assert results["steps"] == (1 if integrator == "static" else 0)
    assert results["seconds_by_part"]["unaccounted"] > -1e-3
    saved = read_mesh(str(out))
    assert {"mode_000", "mode_002", "buckling_001"} <= set(saved.vertex)
    assert np.linalg.norm(saved.vertex["mode_000"], axis=1).max() == pytest.approx(1)
    names = {"stress", "strain_tensor", "bending_moment", "principal_stress", "principal_moment"}
    assert names <= set(saved.face)


def test_modes_of_a_held_shell_are_refused_without_a_file(tmp_path, run):
    scene, out = tmp_path / "plate.toml", tmp_path / "plate.vtkhdf"
    scene.write_text(PLATE.format(integrator="newmark").replace("[0, 1, 0]]", "[1, 1, 0]]"))
    result = run("shell-sim", scene, "--modes", 2, "-o", out)
    assert result.exit_code == 2 and "every vertex is held" in result.stderr
    assert list(tmp_path.iterdir()) == [scene]


@pytest.mark.parametrize("dry", [[], ["--dry-run"]])
@pytest.mark.parametrize("integrator", ["newmark", "static"])
@pytest.mark.parametrize("pin, message", [
    ("vertices = [0]", "plate: the supports leave 3 of 6 rigid motions free"),
    ("vertices = [0, 6]", "plate: the supports leave a rotation free, about the axis"),
    ("vertices = [0, 6, 42]", ""),  # the remedy
])  # fmt: skip
def test_buckling_of_a_shell_that_can_turn_is_refused_before_it_runs(
    tmp_path, run, pin, message, integrator, dry
):
    scene = tmp_path / "plate.toml"
    text = PLATE.format(integrator=integrator).replace("-0.5, 0, 0.01", "-1e-3, 0, 0")
    scene.write_text(text.replace("box = [[0, 0, 0], [0, 1, 0]], clamp = true", pin))
    result = run("shell-sim", scene, "--buckling", 1, *dry)
    assert result.exit_code == (2 if message else 0), result.stderr
    assert message in result.stderr and ("pin more vertices" in result.stderr) == bool(message)


def test_a_shell_without_load_or_freedom_leaves_the_modes_of_the_others(tmp_path, summary):
    """The second plate is held as a whole, and no load acts on it."""
    scene, text = tmp_path / "plates.toml", PLATE.format(integrator="newmark")
    plate = text[text.index("[[object]]") : text.index("[effects]")]
    alone, counts = text.replace("[6, 6]", "[2, 2]"), ("--modes", 2, "--buckling", 2)
    scene.write_text(alone)
    results = summary("shell-sim", scene, *counts)["results"]
    other = plate.replace('"plate"', '"other"').replace("poisson", "position = [0, 0, 1]\npoisson")
    both = text.replace(plate, plate + other).replace("[6, 6]", "[2, 2]")
    both = both.replace("pin = {", 'pin = [{ object = "plate",').replace(
        "clamp = true }", 'clamp = true }, { object = "other", box = [[0, 0, 0], [1, 1, 1]] }]'
    )
    scene.write_text(both.replace("load = {", 'load = { object = "plate",'))
    out = summary("shell-sim", scene, *counts)
    for name in ("frequencies", "load_factors"):
        assert out["results"][name] == pytest.approx(results[name], rel=1e-9)
    assert any("other: no load acts" in warning for warning in out["warnings"])


def test_fewer_modes_than_the_call_names_are_a_warning(tmp_path, summary):
    scene = tmp_path / "plate.toml"
    scene.write_text(PLATE.format(integrator="newmark").replace("[6, 6]", "[2, 2]"))
    out = summary("shell-sim", scene, "--modes", 40)
    assert len(out["results"]["frequencies"]) == 18
    assert any("18 modes in place of 40" in warning for warning in out["warnings"])


def test_a_plate_whose_every_direction_is_clamped_stretches_in_its_plane(tmp_path, summary):
    """No rotation of an edge is free; a matrix without rows was an error of the scene."""
    scene = tmp_path / "plate.toml"
    text = PLATE.format(integrator="static").replace("[6, 6]", "[2, 2]")
    level = '{ box = [[0, 0, 0], [1, 1, 0]], axes = "z", clamp = true }'
    flat = f"pin = [{{ box = [[0, 0, 0], [0, 1, 0]] }}, {level}]"
    scene.write_text(text[: text.index("pin = ")] + flat + "\n" + text[text.index("load = ") :])
    energies = summary("shell-sim", scene, "--modes", 2)["results"]["energies"]
    assert energies["bending"]["end"] == 0 < energies["stretching"]["end"]


def hinged(mesh, effects, poisson=0.0):
    """Plates in place of the hinges of a shell."""
    _, context, system = built(mesh, effects, poisson=poisson, text=HINGED)
    return plate_twin(system, {"s": context})


@pytest.mark.parametrize("poisson", [0.0, 0.3])
def test_hinges_that_do_not_bend_as_the_plate_are_reported(caplog, poisson):
    mesh = square(8, "alternating")
    pins = f"pin = {{ vertices = {border(mesh)} }}"
    twin, points = hinged(mesh, pins, poisson), np.asarray(mesh.points)
    modes = natural_modes(twin.hinges, points, 4)
    _, _, plate = built(mesh, pins, poisson=poisson)
    factor = frequency_factor(twin, points, modes.shapes, modes.values)
    assert factor == pytest.approx((modes.values / natural_modes(plate, points, 4).values).max(), rel=0.03)
    warn_of_hinges(factor, "some frequencies")
    assert "times too high" in caplog.text
    assert 'bending = { model = "midedge" }' in caplog.text
    # a strip that bends in one direction is what hinges are made for
    twin = hinged(STRIP, CLAMP.format(ROOT))
    modes = natural_modes(twin.hinges, X, 4)
    assert frequency_factor(twin, X, modes.shapes, modes.values) == pytest.approx(1, abs=0.05)
    twin = hinged(STRIP, CLAMP.format(ROOT) + "\n" + push(EULER))
    modes = buckling_modes(twin.hinges, X, 2)
    assert modes.values[0] == pytest.approx(1, abs=0.06)
    assert load_factor(twin, modes.shapes) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("poisson, too_small", [(0.0, 12 / 5), (0.3, 24 / 7)])
def test_the_twist_of_a_square_by_a_force_at_its_corner_is_reported_as_too_small(poisson, too_small):
    """w = F x y / (2 (1 - nu) D)."""
    n = 4
    mesh = grid(n, n, 1, 1, "alternating")
    effects = (
        f"load = {{ vertices = [{mesh.n_vertices - 1}], force = [0, 0, 1e-3] }}\n"
        "[[effects.pin]]\nvertices = [0]\n"
        f'[[effects.pin]]\nvertices = [{n}]\naxes = "xz"\n'
        f'[[effects.pin]]\nvertices = [{n * (n + 1)}]\naxes = "z"'
    )
    x = run(mesh, effects, poisson=poisson, text=HINGED)[-1].observations["s"].points
    assert 1e-3 * (1 + poisson) / (2 * RIGIDITY) / x[-1, 2] == pytest.approx(too_small, rel=1e-3)
    assert deflection_factor(hinged(mesh, effects, poisson), x) == pytest.approx(too_small, rel=1e-3)


def test_a_round_plate_with_a_free_rim_by_hinges_is_reported_as_too_soft(caplog):
    """Supported at the rim: (5 + nu) q a^4 / (64 (1 + nu) D) in the middle; hinges give 1.4 times that."""
    mesh = disk(8)
    rim = np.flatnonzero(mesh.topology.boundary_vertex).tolist()
    effects = f"load = {{ traction = [0, 0, -1e-5] }}\npin = {{ vertices = {rim} }}"
    truth = 5.3 / 1.3 * 1e-5 / 64 / (RIGIDITY / 0.91)
    drops = {}
    for text in (SCENE, HINGED):
        x = run(mesh, effects, poisson=0.3, text=text)[-1].observations["s"].points
        drops[text] = -x[:, 2].min()
    assert drops[SCENE] == pytest.approx(truth, rel=0.02)
    twin = hinged(mesh, effects, 0.3)
    factor = deflection_factor(twin, x)
    assert factor == pytest.approx(drops[SCENE] / drops[HINGED], rel=0.03)
    assert factor < 0.8
    warn_of_hinges(factor, "deflections", "small", "large")
    assert "1.40 times too large" in caplog.text
    modes = natural_modes(twin.hinges, np.asarray(mesh.points), 1)
    assert frequency_factor(twin, np.asarray(mesh.points), modes.shapes, modes.values) < 0.9
