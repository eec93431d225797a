"""Fracture: split vertices; mass, momentum and energy through cracks; files and resumption."""

from dataclasses import replace

import numpy as np
import pytest

from ddgcli.errors import SceneError
from ddgcli.geometry.hinges import hinges
from ddgcli.io.scene_file import parse_scene
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh.shapes import grid, icosphere
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell import model
from ddgcli.models.shell.cracks import split_surface
from ddgcli.models.shell.epochs import split_context
from ddgcli.models.shell.observations import strain
from ddgcli.models.shell.scene import KIND
from ddgcli.scenes.scene import resolve
from ddgcli.simulation.account import Account
from tests.cli.test_shell_resume import check_resumed_as_whole
from tests.simulate import scalar, shell_run
from tests.triangle_pairs import meshes_intersect

# a plate of glass that turns so fast that it bursts
BURSTING = """\
format = "ddgcli-scene/1"
[time]
duration = 0.01
step = 5e-4
frame_every = 1e-3
integrator = "{integrator}"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [1, 0.8], cells = [4, 3] }}
density = 3
thickness = "2 mm"
young = 1e7
poisson = 0.2
velocity = [1, 2, 0.5]
angular_velocity = [3, 5, 60]
[effects]
stretching = {{}}
bending = {{}}
fracture = {{ strain = {strain}, angle = 0.05 }}
"""


def interior(mesh):
    """(h, 2) interior edges in the order of the open ones."""
    return np.sort(hinges(mesh.topology)[:, :2], axis=1)


def test_one_open_edge_in_the_interior_splits_no_vertex_and_two_in_a_row_split_one():
    mesh = icosphere(1)
    edges = interior(mesh)
    opened = np.zeros(len(edges), dtype=bool)
    opened[0] = True
    assert len(split_surface(mesh.topology, opened).origin) == mesh.n_vertices
    opened[np.flatnonzero((edges == edges[0, 1]).any(axis=1))[-1]] = True
    split = split_surface(mesh.topology, opened)
    assert list(split.origin[mesh.n_vertices :]) == [edges[0, 1]]
    assert split.n_pieces == 1


def test_edges_across_a_shell_cut_it_in_two_pieces_with_a_copy_of_each_vertex_between():
    mesh = grid(4, 3, 4.0, 3.0)
    edges = interior(mesh)
    opened = (np.asarray(mesh.points)[edges][:, :, 0] == 2.0).all(axis=1)
    split = split_surface(mesh.topology, opened)
    assert split.n_pieces == 2
    middle = np.flatnonzero(np.asarray(mesh.points)[:, 0] == 2.0)
    assert sorted(split.origin[mesh.n_vertices :]) == sorted(middle)
    assert (split.origin[split.faces] == mesh.faces).all()
    assert (split.faces.ravel()[split.corner] == np.arange(len(split.origin))).all()


def test_all_edges_open_leave_single_triangles():
    mesh = icosphere(1)
    split = split_surface(mesh.topology, np.ones(len(interior(mesh)), dtype=bool))
    assert split.n_pieces == mesh.n_faces and len(split.origin) == 3 * mesh.n_faces


def test_fans_that_met_in_a_vertex_from_the_start_stay_together():
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=float)
    faces = np.array([[0, 1, 2], [1, 3, 2], [0, 4, 5]])
    mesh = TriangleMesh(x, Topology(faces, 6))
    split = split_surface(mesh.topology, np.ones(1, dtype=bool))
    assert sorted(split.origin) == [0, 1, 1, 2, 2, 3, 4, 5]
    assert split.n_pieces == 2


def crack_sum(state, epoch):
    """Mass, momentum and angular momentum of a state."""
    momentum = epoch.system.mass[:, None] * state.motion.v
    return np.concatenate(
        [[epoch.system.mass.sum()], momentum.sum(axis=0), np.cross(state.motion.x, momentum).sum(axis=0)]
    )


def test_mass_and_momenta_pass_through_a_crack_to_rounding(monkeypatch):
    from ddgcli.models.shell import epochs

    errors, stepped = [], epochs.Breaking._stepped

    def watched(self, state, advance, time, dt):
        moved = replace(state, motion=advance(state.motion, time, dt))
        before = crack_sum(moved, self._epoch(moved.opened))
        after = stepped(self, state, lambda *arguments: moved.motion, time, dt)
        if after.opened.sum() > state.opened.sum():
            errors.append(np.abs(crack_sum(after, self._epoch(after.opened)) - before) / np.abs(before).max())
        return after

    monkeypatch.setattr(epochs.Breaking, "_stepped", watched)
    shell_run(BURSTING.format(integrator="newmark", strain=1e-3))
    assert len(errors) >= 1
    assert np.max(errors) < 1e-14


@pytest.mark.parametrize("integrator", ["newmark", "implicit-midpoint"])
def test_momenta_of_a_bursting_plate_are_conserved_and_so_is_energy_with_what_cracks_release(integrator):
    snapshots, _, _ = shell_run(BURSTING.format(integrator=integrator, strain=1e-3))
    assert scalar(snapshots, "pieces")[-1] > 5
    momentum = np.array(scalar(snapshots, "momentum"))
    assert np.abs(momentum - momentum[0]).max() < 1e-9 * np.abs(momentum[0]).max()
    turn = np.array(scalar(snapshots, "angular_momentum"))
    # the trapezoidal rule keeps the angular momentum of a turning body to the second order only
    least = 1e-7 if integrator == "implicit-midpoint" else 1e-3
    assert np.abs(turn - turn[0]).max() < least * np.abs(turn[0]).max()
    released = np.array(scalar(snapshots, "fracture_energy"))
    assert (np.diff(released) >= 0).all() and released[-1] > 0
    energy = np.array(scalar(snapshots, "energy")) + released
    stored = max(np.array(scalar(snapshots, "energy")) - scalar(snapshots, "energy_kinetic"))
    assert np.abs(energy - energy[0]).max() < 0.1 * stored


def test_a_plate_without_strength_ends_as_single_triangles_that_turn_on():
    snapshots, contexts, _ = shell_run(BURSTING.format(integrator="implicit-euler", strain=1e-6))
    mesh = contexts["s"].mesh
    last = snapshots[-1].observations["s"]
    assert scalar(snapshots, "pieces")[-1] == mesh.n_faces
    assert scalar(snapshots, "cracks")[-1] == len(interior(mesh))
    side = last.points[last.faces] - last.points[np.roll(last.faces, -1, axis=1)]
    assert np.abs(np.linalg.norm(side, axis=2) / mesh.side_length - 1).max() < 0.02


def test_a_shell_below_its_limits_moves_as_without_fracture():
    whole = BURSTING.format(integrator="newmark", strain=0.5).replace("angle = 0.05", "angle = 3")
    bare = "\n".join(line for line in whole.splitlines() if not line.startswith("fracture"))
    with_limits, without = shell_run(whole)[0], shell_run(bare)[0]
    assert scalar(with_limits, "cracks")[-1] == 0
    for a, b in zip(with_limits, without):
        assert np.array_equal(a.observations["s"].points, b.observations["s"].points)


def test_pins_hold_every_copy_of_a_vertex():
    text = BURSTING.format(integrator="implicit-euler", strain=1e-3)
    snapshots, contexts, _ = shell_run(text + "pin = { vertices = [7, 8] }\n")
    last = snapshots[-1].observations["s"]
    is_pinned = np.isin(last.vertex["input_vertex"], [7, 8])
    assert is_pinned.sum() > 2
    origin = last.vertex["input_vertex"][is_pinned]
    assert np.array_equal(last.points[is_pinned], np.asarray(contexts["s"].mesh.points)[origin])


# a strip of soft metal that is pulled until it tears: it yields at E t w yield_strain = 100 N
TORN = """
[time]
duration = 0.12
step = 2e-3
frame_every = 6e-3
integrator = "implicit-euler"
[[object]]
name = "s"
role = "shell"
grid = { size = [1, 0.2], cells = [5, 1] }
density = 0.1
thickness = "1 mm"
young = 1e8
poisson = 0
[effects]
stretching = { model = "stvk" }
bending = {}
damping = { mass = 50 }
plasticity = { yield_strain = 5e-3, yield_angle = 0.1 }
fracture = { strain = 0.02 }
pin = { box = [[0, 0, 0], [0, 0.2, 0]] }
[effects.handle]
box = [[1, 0, 0], [1, 0.2, 0]]
times = [0, 0.12]
positions = [[0, 0, 0], [0.06, 0, 0]]
interpolation = "linear"
"""


def test_a_pulled_strip_bears_its_yield_force_until_it_tears_and_then_none():
    snapshots, _, _ = shell_run(TORN)
    pull = np.array(scalar(snapshots, "reaction_force_handle"))[:, 0]
    cracks = np.array(scalar(snapshots, "cracks"))
    strains = np.linspace(0, 0.06, len(pull))
    plateau = pull[(strains > 0.008) & (strains < 0.017)]
    assert np.abs(plateau - 100).max() < 2
    assert cracks[strains < 0.017].max() == 0 < cracks[-1]
    assert scalar(snapshots, "pieces")[-1] > 1 and abs(pull[-1]) < 1
    work = np.array(scalar(snapshots, "plastic_work"))
    assert (np.diff(work) >= 0).all()
    # what the handle gave is stored, lost to damping, or plastic work
    assert 0.9 * scalar(snapshots, "external_work")[-1] < work[-1] + scalar(snapshots, "energy")[-1]


def test_plastic_memory_goes_with_its_elements_through_a_crack():
    scene = resolve(parse_scene(TORN.replace("stvk", "edges")), KIND, {})
    context, _ = model.contexts(scene, None)["s"]
    edges = interior(context.mesh)
    points = np.asarray(context.mesh.points)
    opened = (np.abs(points[edges][:, :, 0] - 0.5) < 1e-9).all(axis=1)
    split = split_surface(context.mesh.topology, opened)
    broken = split_context(context, split.faces, split.origin)
    before, after = (model.make_system(scene, c, Account()).memories for c in (context, broken))
    assert len(before) == 2
    for flow, later in zip(before, after):
        memory = flow.initial() | {"work": np.array([7.0])}
        ends = np.sort(flow.potential.stencil[:, :2], axis=1)
        memory["rest"], memory["accumulated"] = 100.0 * ends[:, 0] + ends[:, 1], ends.sum(axis=1)
        carried = later.carried(flow, memory, split.origin)
        now = np.sort(split.origin[later.potential.stencil[:, :2]], axis=1)
        assert np.array_equal(carried["rest"], 100.0 * now[:, 0] + now[:, 1])
        assert np.array_equal(carried["accumulated"], now.sum(axis=1))
        assert carried["work"] == 7.0


def test_a_handle_turns_every_copy_of_its_vertices_about_their_mean():
    text = BURSTING.format(integrator="implicit-euler", strain=1e-3) + (
        "[[effects.handle]]\nvertices = [6, 7, 11]\ntimes = [0, 0.01]\n"
        "positions = [[0, 0, 0], [0.02, 0, 0]]\n"
        "rotations = [{ axis = [0, 0, 1], degrees = 0 }, { axis = [0, 0, 1], degrees = 40 }]\n"
    )
    snapshots, contexts, _ = shell_run(text)
    last = snapshots[-1].observations["s"]
    origin = last.vertex["input_vertex"]
    is_pinned = np.isin(origin, [6, 7, 11])
    assert is_pinned.sum() > 4
    start = np.asarray(contexts["s"].mesh.points)
    middle, angle = start[[6, 7, 11]].mean(axis=0), np.radians(40)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    expected = middle + [0.02, 0, 0] + (start[origin[is_pinned]] - middle) @ turn.T
    assert np.allclose(last.points[is_pinned], expected, atol=1e-12)


# a ball of rubber flies through a plate of glass, which is tied to a bar
STRUCK = """
[time]
duration = 8e-3
step = 5e-4
frame_every = 5e-4
integrator = "newmark"
[[object]]
name = "s"
role = "shell"
grid = {{ size = [1, 0.8], cells = [4, 3] }}
density = 3
thickness = "2 mm"
young = 1e7
poisson = 0.2
[[object]]
name = "other"
role = "shell"
{other}
density = 20
thickness = "2 mm"
young = 1e6
poisson = 0.2
[effects]
stretching = {{}}
bending = {{}}
fracture = {{ object = "s", strain = 2e-3, angle = 0.03 }}
{effect}
"""
BALL = "sphere = { radius = 0.1, subdivisions = 1 }\nposition = [0.45, 0.35, 0.104]\nvelocity = [0, 0, -10]"
BAR = "grid = { size = [0.2, 0.8], cells = [1, 3] }\nposition = [1, 0, 0]\nvelocity = [60, 0, 0]"
TIES = (
    '[[effects.attach]]\nobject = "s"\nto = "other"\nbox = [[1, 0, 0], [1, 0.8, 0]]\n'
    '[[effects.attach]]\nobject = "other"\nto = "s"\nvertices = [0]\nto_vertices = [3]'
)


SOFT = 'plasticity = { object = "s", yield_strain = 1e-3, yield_angle = 0.01 }\n'


@pytest.mark.parametrize("other, effect", [
    (BALL, 'contact = { pairs = [["s", "other"]], gap = "3 mm" }'), (BAR, TIES), (BAR, SOFT + TIES),
], ids=["contact", "attach", "attach and plasticity"])  # fmt: skip
def test_a_shell_that_touches_or_is_tied_to_another_breaks_and_momenta_and_energy_pass_through(other, effect):
    if other == BALL:
        pytest.importorskip("ipctk")
    snapshots, contexts, _ = shell_run(STRUCK.format(other=other, effect=effect))
    assert scalar(snapshots, "pieces")[0] == 2 < scalar(snapshots, "pieces")[-1]
    for name, least in (("momentum", 1e-8), ("angular_momentum", 1e-3)):
        values = np.array(scalar(snapshots, name))
        assert np.abs(values - values[0]).max() < least * np.abs(values).max()
    released = np.array(scalar(snapshots, "fracture_energy"))
    energy, kinetic = np.array(scalar(snapshots, "energy")), np.array(scalar(snapshots, "energy_kinetic"))
    work = np.array(scalar(snapshots, "plastic_work")) if SOFT in effect else np.zeros(len(energy))
    scale = max(energy - kinetic) + work[-1]
    assert (released > 1e-9 * scale).any() == (other == BALL)  # the plate that is pulled stays flat
    balance = energy + released + work - energy[0]
    assert np.abs(balance).max() < (0.5 if other == BALL else 0.1) * scale and (np.diff(work) >= 0).all()
    last = snapshots[-1].observations
    assert np.array_equal(last["other"].faces, contexts["other"].mesh.faces)
    if other == BALL:
        for snapshot in snapshots:
            plate, ball = snapshot.observations["s"], snapshot.observations["other"]
            assert not meshes_intersect(plate.points, plate.faces, ball.points, ball.faces)


def test_a_balloon_that_tears_loses_its_gas():
    text = (
        STRUCK[: STRUCK.index('[[object]]\nname = "other"')]
        + """
[effects]
stretching = {{}}
bending = {{}}
fracture = {{ strain = 0.05 }}
pressure = {{ gas = true, value = 4e5 }}
"""
    )
    text = text.replace(
        "grid = {{ size = [1, 0.8], cells = [4, 3] }}", "sphere = {{ radius = 0.1, subdivisions = 1 }}"
    )
    snapshots, _, _ = shell_run(text.format())
    pressure, pieces = np.array(scalar(snapshots, "pressure_s")), np.array(scalar(snapshots, "pieces"))
    assert pressure[0] == 4e5 and pressure[-1] == 0 and scalar(snapshots, "energy_pressure")[-1] == 0
    assert pieces[-1] > 1
    momentum = np.array(scalar(snapshots, "momentum"))
    assert np.abs(momentum).max() < 1e-9 * 3 * 0.13 * 100


def test_trajectory_has_a_mesh_for_each_frame_and_the_reader_of_vtk_shows_it(run, tmp_path):
    reader_module = pytest.importorskip("vtkmodules.vtkIOHDF")
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    path, out = tmp_path / "s.toml", tmp_path / "s.vtkhdf"
    path.write_text(BURSTING.format(integrator="implicit-euler", strain=1e-3))
    assert run("shell-sim", path, "-o", out, "-o", tmp_path / "s.vtu").exit_code == 0
    reader = reader_module.vtkHDFReader()
    reader.SetFileName(str(out))
    reader.UpdateInformation()
    with Trajectory(str(out)) as trajectory:
        assert trajectory.n_vertices[0] == 20 < trajectory.n_vertices[-1]
        assert list(trajectory.scalars["pieces"][:1]) == [1]
        for k in range(trajectory.n_frames):
            reader.SetStep(k)
            reader.Update()
            shown = reader.GetOutput()
            points = numpy_support.vtk_to_numpy(shown.GetPoints().GetData())
            faces = numpy_support.vtk_to_numpy(shown.GetPolys().GetConnectivityArray()).reshape(-1, 3)
            assert np.array_equal(points, trajectory.points(k))
            assert np.array_equal(faces, trajectory.faces(k))
            for name, values in trajectory.vertex(k).items():
                read = numpy_support.vtk_to_numpy(shown.GetPointData().GetArray(name))
                assert np.array_equal(read, values)


@pytest.mark.parametrize("integrator, effects", [
    ("bdf2", "plasticity = { yield_strain = 5e-4, yield_angle = 2e-3, hardening = 10 }\n"),
    pytest.param("newmark", "", marks=pytest.mark.slow),
])  # fmt: skip
def test_resumed_run_of_a_breaking_shell_has_the_same_bits(run, tmp_path, monkeypatch, integrator, effects):
    """Interrupted behind a crack: the checkpoint has the vertices and the memory of its own epoch."""
    path = tmp_path / "s.toml"
    path.write_text(BURSTING.format(integrator=integrator, strain=1e-3) + effects)
    check_resumed_as_whole(run, tmp_path, monkeypatch, path, 5)


def test_a_whole_shell_beside_a_broken_one_keeps_its_faces(run, tmp_path):
    text = BURSTING.format(integrator="implicit-euler", strain=1e-3)
    other = text[text.index("[[object]]") : text.index("[effects]")].replace('"s"', '"other"')
    text = text.replace("[effects]", other + "[effects]").replace(
        "fracture = {", 'fracture = { object = "s",'
    )
    path, out = tmp_path / "s.toml", tmp_path / "s.vtkhdf"
    path.write_text(text)
    assert run("shell-sim", path, "-o", out).exit_code == 0
    with Trajectory(str(out)) as trajectory:
        k = trajectory.n_frames - 1
        faces, vertex = trajectory.faces(k), trajectory.vertex(k)["input_vertex"]
        assert trajectory.n_vertices[k] > trajectory.n_vertices[0]
        half = len(faces) // 2
        assert np.array_equal(faces[half:] - faces[half:].min(), trajectory.faces(0)[half:] - 20)
        assert list(vertex[-20:]) == list(range(20))


@pytest.mark.parametrize("old, new, message", [
    ("bending = {}", 'bending = { model = "quadratic" }', "hinge"),
    ('"newmark"', '"verlet"', "implicit-euler"),
    ('"newmark"', '"static"', "implicit-euler"),
    ("step = 5e-4", "tolerance = 1e-3", "step"),
    ("strain = 0.1, angle = 0.05", "", "strain, angle or both"),
    ("fracture = {", "[[effects.fracture]]\nangle = 1\n[[effects.fracture]]\nangle = 2\n#", "two of them"),
    ("[effects]", "[effects]\nload = { moment = 1, vertices = [0, 1] }", "traction"),
])  # fmt: skip
def test_fracture_refuses_what_a_split_vertex_would_change(old, new, message):
    text = BURSTING.format(integrator="newmark", strain=0.1)
    assert old in text
    with pytest.raises(SceneError, match=message):
        shell_run(text.replace(old, new))


def test_systems_of_a_split_shell_have_its_mass():
    _, contexts, _ = shell_run(BURSTING.format(integrator="newmark", strain=0.5))
    context = contexts["s"]
    split = split_surface(context.mesh.topology, np.ones(len(interior(context.mesh)), dtype=bool))
    pieces = split_context(context, split.faces, split.origin)
    assert np.isclose(pieces.mass.sum(), context.mass.sum(), rtol=1e-15)
    assert strain(pieces, np.asarray(pieces.mesh.points)).max() == 0
