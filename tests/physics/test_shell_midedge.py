"""Mid-edge bending: plates, clamps, symmetry, reactions, curved rest shapes, on several meshes."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.common.rectangle_meshes import irregular_rectangle
from benchmarks.common.shell_problems import PROBLEMS, displacements
from ddgcli.errors import SceneError
from ddgcli.io.scene_file import parse_scene
from ddgcli.mesh.shapes import grid
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell import model
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

SCENE = """
[time]
integrator = "{integrator}"
duration = {duration}
step = {step}
[[object]]
name = "s"
role = "shell"
mesh = "m"
density = 1
thickness = 0.01
young = 1.2e7
poisson = {poisson}
angular_velocity = {spin}
[effects]
stretching = {{}}
bending = {{ model = "midedge"{rest} }}
{effects}
"""
RIGIDITY = 1.2e7 * 0.01**3 / 12  # at Poisson's ratio 0
CLAMP = "pin = {{ vertices = {}, clamp = true }}"
FLAT = ', rest = "flat"'


def built(
    mesh,
    effects="",
    poisson=0.0,
    rest="",
    integrator="static",
    duration=1,
    step=1,
    spin=(0, 0, 0),
    text=SCENE,
):
    """(scene, context, system) of a shell with a given mesh."""
    text = text.format(
        effects=effects, poisson=poisson, rest=rest, integrator=integrator, duration=duration, step=step,
        spin=list(spin),
    )  # fmt: skip
    scene = resolve(parse_scene(text), KIND, {})
    source = SimpleNamespace(mesh=mesh, vertex={}, face={}, sha256="", notes=[])
    context, _ = model.contexts(scene, lambda path: source)["s"]
    return scene, context, model.make_system(scene, context, Account())


def run(mesh, effects="", **options):
    scene, context, _ = built(mesh, effects, **options)
    account = Account()
    return list(evolve(model.build(scene, {"s": context}, account), scene.schedule(), account))


def square(n, pattern):
    return irregular_rectangle(1, 1, n, n) if pattern == "irregular" else grid(n, n, 1, 1, pattern)


def border(mesh):
    q = np.asarray(mesh.points)[:, :2]
    return np.flatnonzero(((q < 1e-9) | (q > 1 - 1e-9)).any(axis=1)).tolist()


def centre_drop(n, pattern, clamp, poisson=0.3):
    """Deflection of the middle of a square plate under a uniform load, in units of q a^4 / D."""
    mesh, load = square(n, pattern), 1e-4
    pin = f"pin = {{ vertices = {border(mesh)}, clamp = {str(clamp).lower()} }}"
    snapshots = run(mesh, f"{pin}\nload = {{ traction = [0, 0, {load}] }}", poisson=poisson)
    z = snapshots[-1].observations["s"].points[:, 2]
    near = np.argsort(np.sum((np.asarray(mesh.points)[:, :2] - 0.5) ** 2, axis=1))[:6]
    q = np.asarray(mesh.points)[near, :2] - 0.5
    # the middle of a parabola through the nearest vertices, for meshes without a vertex there
    columns = np.column_stack([np.ones(len(q)), q[:, 0] ** 2 + q[:, 1] ** 2, q])
    top = np.linalg.lstsq(columns, z[near], rcond=None)[0][0]
    return top * RIGIDITY / (1 - poisson**2) / load


@pytest.mark.parametrize("pattern", ["right", "alternating", "irregular"])
@pytest.mark.parametrize(("clamp", "truth"), [(True, 0.00126532), (False, 0.00406235)])
def test_deflection_of_a_square_plate_converges_on_any_mesh(pattern, clamp, truth):
    """Timoshenko's coefficients for clamped and simply supported edges; second order."""
    errors = [abs(centre_drop(n, pattern, clamp) / truth - 1) for n in (8, 16)]
    assert errors[1] <= (0.1 if clamp else 0.02)
    assert 3.3 <= errors[0] / errors[1] <= 4.7


@pytest.mark.parametrize(
    ("curvature", "density"),
    [((1, 0), 0.5), ((1, 1), 1.3), ((1, -1), 0.7)],  # half of (1 - nu) |B|^2 + nu (tr B)^2, nu = 0.3
)
def test_bending_energy_is_that_of_the_plate_with_poissons_ratio(curvature, density):
    """Shallow paraboloids; relative error of first order, from the free edges, which relax."""
    errors = []
    for n in (10, 20):
        mesh = square(n, "irregular")
        _, _, system = built(mesh, poisson=0.3)
        x = np.array(mesh.points)
        size = 1e-4
        x[:, 2] = 0.5 * size * (curvature[0] * x[:, 0] ** 2 + curvature[1] * x[:, 1] ** 2)
        bending = next(p for p in system.potentials if p.name == "bending")
        errors.append(abs(bending.energy(x) / (RIGIDITY / 0.91 * size**2 * density) - 1))
    assert errors[1] < 0.08
    assert errors[1] < 0.65 * errors[0]


@pytest.mark.parametrize("pattern", ["alternating", "irregular"])
def test_cantilever_under_end_shear_follows_the_table_of_sze(pattern):
    """0.2 % of the length at every load, on 160 triangles."""
    _, moves = displacements(PROBLEMS["cantilever, shear"], 80, pattern, steps=20)
    truth = np.array(PROBLEMS["cantilever, shear"].reference).T
    assert np.abs(moves - truth).max() <= 0.02


def test_derivatives_with_clamps_and_symmetry_planes_agree_with_finite_differences():
    """Over the free coordinates: those that a clamp holds are no variables of the energy."""
    mesh = grid(3, 3, 1, 1, "alternating")
    q = np.asarray(mesh.points)
    first, second = np.flatnonzero(q[:, 0] < 1e-9).tolist(), np.flatnonzero(q[:, 1] < 1e-9).tolist()
    effects = f"""
[[effects.pin]]
vertices = {first}
clamp = true
[[effects.pin]]
vertices = {second}
axes = "y"
clamp = true
"""
    _, _, system = built(mesh, effects, poisson=0.3)
    p = next(p for p in system.potentials if p.name == "bending")
    assert len(p.clamps.side) == 6
    rng = np.random.default_rng(0)
    x = q + np.where(system.free, 0.1 * rng.normal(size=q.shape), 0.0)
    free = np.flatnonzero(system.free.ravel())
    steps = np.eye(q.size)[free].reshape(-1, *q.shape) * 1e-5
    gradient = p.gradient(x).ravel()[free]
    estimate = np.array([(p.energy(x + s) - p.energy(x - s)) / 2e-5 for s in steps])
    assert np.abs(gradient - estimate).max() <= 1e-6 * np.abs(gradient).max()
    rows = len(q) + p.internal
    whole = np.zeros((3 * rows, 3 * rows))
    for vertices, block in zip(p.stencil, p.blocks(x, "exact")):
        dofs = (3 * vertices[:, None] + np.arange(3)).ravel()
        np.add.at(whole, np.ix_(dofs, dofs), block)
    inner = np.arange(3 * len(q), 3 * rows, 3)
    mixed = whole[np.ix_(free, inner)]
    hessian = whole[np.ix_(free, free)] - mixed @ np.linalg.solve(whole[np.ix_(inner, inner)], mixed.T)
    estimate = np.array([((p.gradient(x + s) - p.gradient(x - s)) / 2e-5).ravel()[free] for s in steps])
    assert np.abs(hessian - estimate).max() <= 1e-6 * np.abs(hessian).max()


def test_quarter_plate_with_symmetry_planes_is_the_whole_plate():
    whole = grid(8, 8, 1, 1, "alternating")
    load = "load = { traction = [0, 0, 40] }"
    points = run(whole, CLAMP.format(border(whole)) + "\n" + load)[-1].observations["s"].points
    quarter = grid(4, 4, 0.5, 0.5, "alternating")
    q = np.asarray(quarter.points)
    pins = [((q[:, :2] < 1e-9).any(axis=1), "xyz"), (q[:, 0] > 0.5 - 1e-9, "x"), (q[:, 1] > 0.5 - 1e-9, "y")]
    effects = load + "".join(
        f'\n[[effects.pin]]\nvertices = {np.flatnonzero(mask).tolist()}\naxes = "{axes}"\nclamp = true'
        for mask, axes in pins
    )
    quarter_points = run(quarter, effects)[-1].observations["s"].points
    assert points[:, 2].max() > 0.015  # beyond the linear range: more than the thickness
    assert quarter_points[:, 2].max() == pytest.approx(points[:, 2].max(), rel=1e-9)


@pytest.mark.parametrize(
    ("bending", "axes", "free"),
    [("hinge", "x", True), ("hinge", "z", False), ("hinge", "xyz", False), ("midedge", "x", False)],
)
def test_clamp_of_hinges_that_leaves_the_direction_free_is_a_warning(bending, axes, free, caplog):
    """The row of faces on a plane of symmetry may turn: no axis across the normal holds it."""
    mesh = grid(4, 4, 1, 1, "alternating")
    side = np.flatnonzero(np.asarray(mesh.points)[:, 0] > 1 - 1e-9).tolist()
    pin = f'pin = {{ vertices = {side}, axes = "{axes}", clamp = true }}'
    _, _, system = built(mesh, pin, text=SCENE.replace("midedge", bending))
    assert ("leaves the direction of hinges free" in caplog.text) == free
    move = np.zeros_like(np.asarray(mesh.points))
    move[~np.isin(np.arange(mesh.n_vertices), side), 2] = 1e-6  # turns the row about the plane
    assert (system.free | (move == 0)).all() == (free or bending == "midedge")


def test_clamp_carries_force_and_moment_of_the_load():
    mesh = irregular_rectangle(1, 0.2, 10, 4)
    x = np.asarray(mesh.points)
    root, tip = np.flatnonzero(x[:, 0] < 1e-9).tolist(), np.flatnonzero(x[:, 0] > 1 - 1e-9).tolist()
    load = f"load = {{ line_force = [0, 0, 2], vertices = {tip} }}"
    last = run(mesh, f"{CLAMP.format(root)}\n{load}")[-1].observations["s"]
    assert last.points[tip, 2].mean() > 0.1
    share = np.zeros(len(x))
    order = np.array(tip)[np.argsort(x[tip, 1])]
    gaps = np.diff(x[order, 1])
    share[order[:-1]] += gaps
    share[order[1:]] += gaps
    force = share[:, None] * np.array([0, 0, 1.0])  # half the lengths times 2 N/m
    assert last.scalar["reaction_force_pin"] == pytest.approx(-force.sum(axis=0), abs=1e-7)
    moment = np.cross(last.points, force).sum(axis=0)
    assert last.scalar["reaction_moment_pin"] == pytest.approx(-moment, abs=1e-6 * np.abs(moment).max())


def test_free_shell_keeps_momenta_and_energy():
    """A bent strip that spins and swings: rotations of edges have no inertia and take no momentum."""
    snapshots = run(
        irregular_rectangle(1, 0.3, 10, 4), integrator="implicit-midpoint", step=2e-3, duration=0.1,
        spin=(1, 2, 0.5), rest=FLAT,
    )  # fmt: skip
    scalars = [snapshot.observations["s"].scalar for snapshot in snapshots]
    angular = np.array([s["angular_momentum"] for s in scalars])
    assert np.abs(angular - angular[0]).max() <= 1e-7 * np.abs(angular).max()
    energy = np.array([s["energy"] for s in scalars])
    assert np.abs(energy - energy[0]).max() <= 1e-3 * energy[0]


@pytest.mark.parametrize("integrator", ["verlet", "newmark"])
def test_curved_shell_at_rest_stays_and_a_flat_rest_shape_moves_it(integrator):
    mesh = grid(4, 4, 1, 1, "alternating")
    x = np.array(mesh.points)
    curved = mesh.moved(np.column_stack([np.sin(x[:, 0]), x[:, 1], np.cos(x[:, 0])]))
    options = {"integrator": integrator, "step": 1e-4, "duration": 2e-3}
    still = run(curved, **options)[-1].observations["s"].points
    assert np.abs(still - curved.points).max() <= 1e-12
    moving = run(curved, rest=FLAT, **options)[-1].observations["s"].points
    assert np.abs(moving - curved.points).max() > 1e-5


def test_edge_that_moves_along_its_clamped_direction_is_an_error():
    mesh = grid(3, 3, 1, 1, "right")
    with pytest.raises(ValueError, match="is not across the axis that its pin holds"):
        built(mesh, 'pin = { vertices = [0, 4], axes = "x", clamp = true }')


@pytest.mark.parametrize(("bending", "tolerance"), [("midedge", 0.02), ("hinge", 1.0)])
def test_end_moment_rolls_a_strip_to_a_full_circle(bending, tolerance):
    """All rows of the table of Sze; hinges on this grid are a plate of their own, of 0.96 the stiffness."""
    _, moves = displacements(PROBLEMS["cantilever, moment"], 100, "alternating", bending, steps=20)
    truth = np.array(PROBLEMS["cantilever, moment"].reference).T
    assert np.abs(moves - truth).max() <= tolerance
    assert np.abs(moves[-1] - truth[-1]).max() <= 0.05 * 12


@pytest.mark.parametrize("bending", ["midedge", "hinge"])
def test_derivatives_of_edge_moments_agree_with_finite_differences(bending):
    """Along moves that keep the direction of the loaded edges: elsewhere a moment has no energy."""
    mesh = grid(4, 2, 2, 1, "alternating")
    q = np.asarray(mesh.points)
    tip = np.flatnonzero(q[:, 0] > 2 - 1e-9)
    text = SCENE.replace("midedge", bending).format(
        effects=f"load = {{ moment = 3, vertices = {tip.tolist()} }}", poisson=0.3, rest="",
        integrator="static", duration=1, step=1, spin=[0, 0, 0],
    )  # fmt: skip
    scene = resolve(parse_scene(text), KIND, {})
    source = SimpleNamespace(mesh=mesh, vertex={}, face={}, sha256="", notes=[])
    context, _ = model.contexts(scene, lambda path: source)["s"]
    system = model.make_system(scene, context, Account())
    p = next(p for p in system.potentials if p.name == "load")
    rng = np.random.default_rng(0)
    moves = []
    for _ in range(12):
        move = rng.normal(size=q.shape)
        move[tip] = move[tip[0]]
        moves.append(move)
    x = q + 0.05 * moves[0]
    for move in moves[1:]:
        step = 1e-6 * move
        slope = (p.energy(x + step) - p.energy(x - step)) / 2
        assert float(np.vdot(p.gradient(x), step)) == pytest.approx(slope, rel=1e-6, abs=1e-12)
        change = (p.gradient(x + step) - p.gradient(x - step)).ravel() / 2
        product = np.zeros((len(q), 3))
        for vertices, block in zip(p.stencil, p.blocks(x, "exact")):
            np.add.at(product, vertices, (block @ step[vertices].ravel()).reshape(-1, 3))
        for other in moves:
            assert float(product.ravel() @ other.ravel()) == pytest.approx(
                float(change @ other.ravel()), rel=1e-5, abs=1e-10
            )


@pytest.mark.parametrize(
    "faces",
    [[[0, 1, 2]], [[0, 1, 2], [1, 0, 3], [0, 1, 4]], [[0, 1, 2], [0, 3, 4]]],
    ids=["one", "book", "bow"],
)
def test_faces_without_a_hinge_have_no_bending(faces, caplog):
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [-0.5, 0, 1]])
    mesh = TriangleMesh.from_arrays(points[: np.max(faces) + 1], faces)
    moved = mesh.points + 0.1 * np.random.default_rng(0).normal(size=mesh.points.shape)
    bending = built(mesh)[2].potentials[-1]
    assert bending.name == "bending" and len(bending.stencil) == len(faces)
    assert bending.energy(moved) == 0 and not bending.gradient(moved).any()
    assert len(run(mesh, integrator="newmark", duration=0.02, step=0.01, spin=(3, 2, 0))) == 3
    assert ("1 edge has no bending in s: more than two faces" in caplog.text) == (len(faces) == 3)


def needle(height):
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, -height, 0], [0.5, 1, 0]])
    return TriangleMesh.from_arrays(points, [[1, 0, 2], [0, 1, 3]])


def test_the_plate_of_a_needle_has_its_area_or_is_refused():
    """Lengths of needles hide their area: that of a segment is theirs to the last bits."""
    mesh = needle(3e-8)
    bending = built(mesh)[2].potentials[-1]
    own = np.diagonal(bending.plate, axis1=1, axis2=2)  # of a turn at one side: D l^2 / A
    truth = RIGIDITY * mesh.side_length**2 / np.array([[1.5e-8], [0.5]])
    assert own == pytest.approx(truth, rel=1e-12)
    with pytest.raises(SceneError, match='face 0 of s has a height of 1e-09 of its longest side.*"hinge"'):
        built(needle(1e-9))
    hinges = SCENE.replace('model = "midedge"', 'model = "hinge"')
    assert hinges != SCENE and built(needle(1e-9), text=hinges)[2].potentials
