"""Fracture: split vertices; mass, momentum and energy through cracks; files and resumption."""

from dataclasses import replace

import numpy as np
import pytest

from ddgcli.errors import SceneError
from ddgcli.geometry.hinges import hinges
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh.shapes import grid, icosphere
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.shell.cracks import split_surface
from ddgcli.models.shell.observations import strain
from tests.cli.test_shell_resume import resumed_as_whole
from tests.simulate import scalar, shell_run

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
    assert split.pieces == 1


def test_edges_across_a_shell_cut_it_in_two_pieces_with_a_copy_of_each_vertex_between():
    mesh = grid(4, 3, 4.0, 3.0)
    edges = interior(mesh)
    opened = (np.asarray(mesh.points)[edges][:, :, 0] == 2.0).all(axis=1)
    split = split_surface(mesh.topology, opened)
    assert split.pieces == 2
    middle = np.flatnonzero(np.asarray(mesh.points)[:, 0] == 2.0)
    assert sorted(split.origin[mesh.n_vertices :]) == sorted(middle)
    assert (split.origin[split.faces] == mesh.faces).all()
    assert (split.faces.ravel()[split.corner] == np.arange(len(split.origin))).all()


def test_all_edges_open_leave_single_triangles():
    mesh = icosphere(1)
    split = split_surface(mesh.topology, np.ones(len(interior(mesh)), dtype=bool))
    assert split.pieces == mesh.n_faces and len(split.origin) == 3 * mesh.n_faces


def test_fans_that_met_in_a_vertex_from_the_start_stay_together():
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=float)
    faces = np.array([[0, 1, 2], [1, 3, 2], [0, 4, 5]])
    mesh = TriangleMesh(x, Topology(faces, 6))
    split = split_surface(mesh.topology, np.ones(1, dtype=bool))
    assert sorted(split.origin) == [0, 1, 1, 2, 2, 3, 4, 5]
    assert split.pieces == 2


def crack_sum(state, epoch):
    """Mass, momentum and angular momentum of a state."""
    momentum = epoch.system.mass[:, None] * state.motion.v
    return np.concatenate(
        [[epoch.system.mass.sum()], momentum.sum(axis=0), np.cross(state.motion.x, momentum).sum(axis=0)]
    )


def test_mass_and_momenta_pass_through_a_crack_to_rounding(monkeypatch):
    from ddgcli.models.shell import epochs

    seen, stepped = [], epochs.Breaking._stepped

    def watched(self, state, advance, time, dt):
        moved = replace(state, motion=advance(state.motion, time, dt))
        before = crack_sum(moved, self._epoch(moved.opened))
        after = stepped(self, state, lambda *arguments: moved.motion, time, dt)
        if after.opened.sum() > state.opened.sum():
            seen.append(np.abs(crack_sum(after, self._epoch(after.opened)) - before) / np.abs(before).max())
        return after

    monkeypatch.setattr(epochs.Breaking, "_stepped", watched)
    shell_run(BURSTING.format(integrator="newmark", strain=1e-3))
    assert len(seen) >= 1
    assert np.max(seen) < 1e-14


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
    held = np.isin(last.vertex["input_vertex"], [7, 8])
    assert held.sum() > 2
    origin = last.vertex["input_vertex"][held]
    assert np.array_equal(last.points[held], np.asarray(contexts["s"].mesh.points)[origin])


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


@pytest.mark.parametrize("integrator", ["bdf2", pytest.param("newmark", marks=pytest.mark.slow)])
def test_resumed_run_of_a_breaking_shell_has_the_same_bits(run, tmp_path, monkeypatch, integrator):
    """Interrupted behind a crack: the checkpoint has the vertices of its own epoch."""
    path = tmp_path / "s.toml"
    path.write_text(BURSTING.format(integrator=integrator, strain=1e-3))
    resumed_as_whole(run, tmp_path, monkeypatch, path, 5)


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
    ("[effects]", "[effects]\nplasticity = { yield_strain = 0.1 }", "plasticity"),
    ("[effects]", "[effects]\nhandle = { vertices = [0], times = [0, 1] }", "handle"),
    ("[effects]", "[effects]\ncontact = { self_contact = true }", "self_contact"),
    ("[effects]", "[effects]\nload = { moment = 1, vertices = [0, 1] }", "traction"),
])  # fmt: skip
def test_fracture_refuses_what_a_split_vertex_would_change(old, new, message):
    text = BURSTING.format(integrator="newmark", strain=0.1)
    assert old in text
    with pytest.raises(SceneError, match=message):
        shell_run(text.replace(old, new))


def test_systems_of_a_split_shell_have_its_mass():
    from ddgcli.models.shell.epochs import split_context

    _, contexts, _ = shell_run(BURSTING.format(integrator="newmark", strain=0.5))
    context = contexts["s"]
    split = split_surface(context.mesh.topology, np.ones(len(interior(context.mesh)), dtype=bool))
    pieces = split_context(context, split.faces, split.origin)
    assert np.isclose(pieces.mass.sum(), context.mass.sum(), rtol=1e-15)
    assert strain(pieces, np.asarray(pieces.mesh.points)).max() == 0
