"""Bad input of fluids: refused in one line that names what is wrong, how many, and the first."""

import numpy as np
import pytest

from benchmarks.fluids.runs import run_fluid
from ddgcli.errors import SceneError
from ddgcli.mesh import shapes
from ddgcli.mesh.tet_mesh import TET_FACES, TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.fluid.flow_mesh import harmonic_count

SQUARE = "grid = { size = [1, 1], cells = [4, 4] }"
BOX = "box = { size = [1, 1, 1], cells = [2, 2, 2] }"
BALL = "sphere = { subdivisions = 1 }"
START = 'initial = { vorticity = "x" }\n'
INFLOW = '{ kind = "inflow", velocity = [1, 0, 0], where = "x < 1e-6" }'
OUTFLOW = '{ kind = "outflow", velocity = [2, 0, 0], where = "x > 1 - 1e-6" }'
TIME = 'integrator = "energy"\nduration = 0.02\nstep = 0.01'


def refusal(effects, shape='mesh = "given"', mesh=None, objects=""):
    with pytest.raises(SceneError) as refusal:
        run_fluid(effects, TIME, shape, mesh, objects)
    assert "\n" not in str(refusal.value)
    return str(refusal.value)


def with_fin(mesh):
    """A mesh and one more triangle at one of its edges."""
    tail, head, _ = mesh.faces[0]
    tip = mesh.points[[tail, head]].mean(axis=0) * 1.5
    return TriangleMesh.from_arrays(
        np.vstack([mesh.points, tip]), np.vstack([mesh.faces, [tail, head, mesh.n_vertices]])
    )


def test_a_surface_with_three_faces_at_an_edge_is_refused():
    """The remedy, the repair of `ddgcli repair` and of objects, has tests of its own."""
    message = refusal(START, mesh=with_fin(shapes.icosphere(1)))
    assert "1 edge has more than two faces (first: vertices 0-16)" in message and "split_fans" in message


def test_a_moebius_band_is_refused():
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    across = np.array([-0.3, 0.3])
    radius = 1 + across * np.cos(angle / 2)[:, None]
    points = np.stack(
        [
            radius * np.cos(angle)[:, None],
            radius * np.sin(angle)[:, None],
            across * np.sin(angle / 2)[:, None],
        ],
        axis=2,
    ).reshape(-1, 3)
    faces = []
    for k in range(12):
        a, b, c, d = 2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3
        if k == 11:
            c, d = 1, 0
        faces += [[a, c, b], [b, c, d]]
    assert "orient" in refusal(START, mesh=TriangleMesh.from_arrays(points, np.array(faces)))


def test_faces_without_area_are_counted():
    mesh = shapes.grid(4, 4)
    points = np.array(mesh.points)
    points[mesh.faces[5, 2]] = points[mesh.faces[5, :2]].mean(axis=0)
    assert "1 face has no area (first: face" in refusal(START, mesh=mesh.moved(points))


FORCE = "force = { acceleration = [0, 0, 1] }"


def test_inverted_tetrahedra_are_counted_the_first_is_named_and_the_remedy_works():
    box = shapes.box_tetrahedra(2, 2, 2)
    cells = np.array(box.tetrahedra)
    cells[[7, 9]] = cells[[7, 9]][:, [1, 0, 2, 3]]
    message = refusal(FORCE, mesh=TetMesh(box.points, cells))
    assert "2 tetrahedra are inverted (first: 7); exchange two corners of each" in message
    cells = np.array(cells)
    cells[[7, 9]] = cells[[7, 9]][:, [0, 1, 3, 2]]
    run_fluid(FORCE, TIME, mesh=TetMesh(box.points, cells))


def test_flat_tetrahedra_are_counted_the_first_is_named_and_the_remedy_works():
    box = shapes.box_tetrahedra(2, 2, 2)
    face = box.tetrahedra[0, :3]
    points = np.vstack([box.points, box.points[face].mean(axis=0)])  # a fourth vertex within the face
    cells = np.vstack([box.tetrahedra, [*face, len(box.points)]])
    assert "longest edge cubed (first: tetrahedron 48); remove" in refusal(FORCE, mesh=TetMesh(points, cells))
    run_fluid(FORCE, TIME, mesh=TetMesh(points, cells[:-1]))


def test_a_face_with_three_tetrahedra_is_named_and_the_remedy_works():
    box = shapes.box_tetrahedra(1, 1, 1)
    points = np.vstack([box.points, [0.3, 0.4, 0.5]])
    faces, count = np.unique(
        np.sort(box.tetrahedra[:, TET_FACES].reshape(-1, 3), axis=1), axis=0, return_counts=True
    )
    face = faces[np.argmax(count == 2)]
    third = np.array([*face, 8])
    if np.linalg.det(points[third[1:]] - points[third[0]]) < 0:
        third = third[[1, 0, 2, 3]]
    mesh = TetMesh(points, np.vstack([box.tetrahedra, third]))
    place = "-".join(map(str, face))
    message = refusal(FORCE, mesh=mesh)
    assert f"1 face has more than two tetrahedra (first: vertices {place} of tetrahedra " in message
    assert "remove all but two" in message
    run_fluid(FORCE, TIME, mesh=TetMesh(points, box.tetrahedra))


@pytest.mark.parametrize("shape", [SQUARE, BOX], ids=["surface", "volume"])
def test_flux_that_does_not_balance_is_refused_with_the_excess(shape):
    effects = f"viscosity = {{ nu = 1 }}\nboundary = [{INFLOW}, {OUTFLOW}]"
    unit = "m^2/s" if shape == SQUARE else "m^3/s"
    assert f"1 {unit} more" in refusal(effects, shape)


@pytest.mark.parametrize("shape", [SQUARE, BOX], ids=["surface", "volume"])
def test_inflow_without_outflow_is_refused(shape):
    refusal_text = refusal(f"viscosity = {{ nu = 1 }}\nboundary = [{INFLOW}]", shape)
    assert "outflow" in refusal_text


@pytest.mark.parametrize("shape", [SQUARE, BOX], ids=["surface", "volume"])
def test_an_inflow_that_leaves_is_refused(shape):
    """In volumes fluid came in through the natural outflow."""
    leaving, natural = INFLOW.replace("[1", "[-1"), '{ kind = "outflow", where = "x > 1 - 1e-6" }'
    assert "reverse it" in refusal(f"viscosity = {{ nu = 1 }}\nboundary = [{leaving}, {natural}]", shape)


@pytest.mark.parametrize("shape", [SQUARE, BOX], ids=["surface", "volume"])
@pytest.mark.parametrize(
    "wall, is_still", [("[1, 0, 0]", False), ("[0, 1, 0]", True), ('["x > 2", 0, 0]', True)]
)
def test_a_moving_wall_that_moves_nothing_warns(shape, wall, is_still, caplog):
    section = f'{{ kind = "wall", velocity = {wall}, where = "y > 1 - 1e-6" }}'
    out = run_fluid(f"viscosity = {{ nu = 1 }}\nboundary = [{section}]", TIME, shape)
    assert (out.series("kinetic_energy")[-1] == 0) == is_still
    assert ("no part of the wall moves along itself" in caplog.text) == is_still


@pytest.mark.parametrize("shape", [SQUARE, BOX], ids=["surface", "volume"])
def test_a_wall_that_a_section_before_it_hides_warns_with_its_remedy(shape, caplog):
    """The warning was that no wall moves along itself."""
    everywhere = '{ kind = "no-slip" }'
    lid = '{ kind = "wall", velocity = [1, 0, 0], where = "y > 1 - 1e-6" }'
    for sections, is_hidden in ((f"{everywhere}, {lid}", True), (f"{lid}, {everywhere}", False)):
        caplog.clear()
        out = run_fluid(f"viscosity = {{ nu = 1 }}\nboundary = [{sections}]", TIME, shape)
        assert (
            "section 2 of boundary (wall where 'y > 1 - 1e-6' holds) has no side left" in caplog.text
        ) == (is_hidden)
        assert "moves along itself" not in caplog.text
        assert (out.series("kinetic_energy")[-1] == 0) == is_hidden


@pytest.mark.parametrize(
    "shape, flows",
    [("grid = { size = [2, 1], cells = [12, 6] }", "harmonic = {}"),
     ("box = { size = [2, 1, 1], cells = [6, 3, 3] }", "")],
    ids=["surface", "volume"],
)  # fmt: skip
def test_an_inflow_through_an_obstacle_warns_and_the_remedy_works(shape, flows, caplog):
    height = 0.5 if "box" in shape else 0
    ball = f"sphere = {{ center = [0.6, 0.5, {height}], radius = 0.3 }}\n"
    ball = f'[[object]]\nname = "ball"\nrole = "obstacle"\n{ball}'
    outflow = '{ kind = "outflow", where = "x > 2 - 1e-6" }'
    for inflow, crosses in (
        (INFLOW, False),
        (INFLOW.replace("x < 1e-6", "x < 1"), True),
        ('{ kind = "no-slip", obstacle = "ball" }, ' + INFLOW.replace("x < 1e-6", "x < 1"), False),
    ):
        caplog.clear()
        effects = f"viscosity = {{ nu = 1 }}\nboundary = [{inflow}, {outflow}]\n{flows}"
        run_fluid(effects, TIME, shape, objects=ball)
        assert ("boundary of obstacle 'ball'" in caplog.text) == crosses


CHANNEL = "grid = { size = [2, 1], cells = [24, 12] }"
DUCT = "box = { size = [2, 1, 1], cells = [6, 3, 3] }"
NATURAL = '{ kind = "outflow", where = "x > 2 - 1e-6" }'


def ball_in_the_middle(radius):
    return (
        f'[[object]]\nname = "b"\nrole = "obstacle"\nsphere = {{ center = [1, 0.5, 0], radius = {radius} }}\n'
    )


def test_an_obstacle_that_touches_the_walls_is_refused_with_a_remedy_that_works():
    """No repair of a mesh could help: the grid has no file, and is sound without the obstacle."""
    effects = f"viscosity = {{ nu = 1 }}\nharmonic = {{}}\nboundary = [{INFLOW}, {NATURAL}]"
    message = refusal(effects, CHANNEL, objects=ball_in_the_middle(0.5))
    assert "at 2 vertices (first: (1, 0, 0)) an obstacle touches the boundary" in message
    assert "change the size or the place" in message and "repair" not in message
    run_fluid(effects, TIME, CHANNEL, objects=ball_in_the_middle(0.4))


@pytest.mark.parametrize("shape", [CHANNEL, DUCT], ids=["surface", "volume"])
def test_flux_into_a_component_that_obstacles_cut_off_is_refused(shape, caplog):
    """A volume ran: the outflow of one component balanced the inflow of the other."""
    plate = (
        '[[object]]\nname = "p"\nrole = "obstacle"\nbox = { corner = [0.6, -1, -1], size = [0.8, 3, 3] }\n'
    )
    message = refusal(f"viscosity = {{ nu = 1 }}\nboundary = [{INFLOW}, {NATURAL}]", shape, objects=plate)
    unit = "m^2/s" if shape == CHANNEL else "m^3/s"
    assert f"1 {unit} more flow in than out" in message
    assert "the obstacles divide" in message and "into 2 components" in message and "balance" not in message
    caplog.clear()
    run_fluid("viscosity = { nu = 1 }", TIME, shape, objects=plate)
    assert "into 2 components, between which nothing flows" in caplog.text


def test_flux_balances_in_every_component_of_a_volume():
    box = shapes.box_tetrahedra(2, 2, 2)
    two = TetMesh(np.vstack([box.points, box.points + [2, 0, 0]]),
                  np.vstack([box.tetrahedra, box.tetrahedra + len(box.points)]))  # fmt: skip
    last = '{ kind = "outflow", where = "x > 3 - 1e-6" }'
    message = refusal(f"viscosity = {{ nu = 1 }}\nboundary = [{INFLOW}, {last}]", mesh=two)
    assert "1 m^3/s more flow in than out through the component at (0" in message and "balance" in message
    own = '{ kind = "outflow", where = "abs(x - 1) < 1e-6" }'
    run_fluid(f"viscosity = {{ nu = 1 }}\nboundary = [{INFLOW}, {own}]", TIME, mesh=two)


@pytest.mark.parametrize("shape", [SQUARE, BOX], ids=["surface", "volume"])
@pytest.mark.parametrize(
    "effect", ["viscosity = { nu = -1 }", 'buoyancy = { temperature = "x", diffusivity = -1 }']
)
def test_negative_viscosity_and_diffusivity_are_refused(shape, effect):
    assert "greater than or equal to 0" in refusal(effect, shape) or "at least 0" in refusal(effect, shape)


@pytest.mark.parametrize(
    "effect, message",
    [
        ('initial = { vorticity = "x" }', "vorticity is that of surfaces"),
        ('initial = { flow = "rossby-haurwitz" }', "is one of surfaces"),
        ('viscosity = { nu = 1, kind = "bochner" }', "bochner is one of surfaces"),
        ("rotation = { angular_velocity = [0, 0, 1] }", "rotation acts on surfaces"),
        ("harmonic = {}", "harmonic acts on surfaces"),
    ],
)
def test_effects_of_surfaces_are_refused_in_volumes(effect, message):
    assert message in refusal(effect, BOX)


def test_a_flow_of_volumes_is_refused_on_a_surface():
    assert "vortex-ring" in refusal('initial = { flow = "vortex-ring" }', SQUARE)


def test_harmonic_flows_are_counted_component_by_component():
    """Two squares have none (a warning advised the effect), a sphere beside a ring has one."""
    square, ball, ring = shapes.grid(2, 2), shapes.icosphere(1), shapes.cylinder(8, 2)

    def beside(a, b):
        faces = np.concatenate([a.faces, b.faces + a.n_vertices])
        return TriangleMesh.from_arrays(np.concatenate([a.points, b.points + 5.0]), faces)

    meshes = (ring, beside(square, square), beside(ball, ring), beside(ring, ring))
    assert [harmonic_count(mesh) for mesh in meshes] == [1, 0, 1, 2]


UNIFORM, ROUND = "[1, 0, 0]", '["-y", "x", 0]'


@pytest.mark.parametrize(
    "shape, velocity, is_lost",
    [
        (SQUARE, UNIFORM, True),
        (BOX, UNIFORM, True),
        (BALL, UNIFORM, True),
        (SQUARE, '["y - 0.5", 0, 0]', True),
        (SQUARE, '["x*(1-x)*(1-2*y)", "-y*(1-y)*(1-2*x)", 0]', False),
        (BOX, '["x*(1-x)*(1-2*y)", "-y*(1-y)*(1-2*x)", 0]', False),
        (BALL, ROUND, False),
    ],
)
def test_an_initial_velocity_that_is_largely_a_gradient_warns(shape, velocity, is_lost, caplog):
    """A uniform stream in a closed box, or on a sphere, was a fluid at rest, without a word."""
    out = run_fluid(f"initial = {{ velocity = {velocity} }}", TIME, shape)
    assert ("a gradient, which no incompressible flow has" in caplog.text) == is_lost
    assert (out.series("kinetic_energy")[0] < 1e-20) == (velocity == UNIFORM)


def test_t_in_a_part_of_the_boundary_is_refused_with_its_remedy():
    moving = INFLOW.replace("x < 1e-6", "(x < 1e-6)*(t < 1)")
    assert "put t of `where` into `velocity`" in refusal(f"viscosity = {{ nu = 1 }}\nboundary = [{moving}]")
