"""Remeshing during flows: edges split, collapse and flip; the surface, its topology and its boundary stay."""

import json
import os

import numpy as np
import pytest

from benchmarks.common.submesh import submesh
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.geometry.normals import sphere_normals
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.io.trajectories.trajectory import Trajectory
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import setup
from ddgcli.models.willmore.descent import folded_faces
from ddgcli.models.willmore.flow import Flow
from ddgcli.models.willmore.flow_options import with_stop
from ddgcli.models.willmore.redistribution import redistribute
from ddgcli.models.willmore.remesh_step import _same_surface
from ddgcli.models.willmore.remeshing import Remesh, remeshed
from ddgcli.models.willmore.setup import FlowOptions
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve
from tests.physics.willmore_runs import energies, prolate


def stretched(level=3):
    mesh = shapes.icosphere(level)
    return mesh.moved(mesh.points * [1.0, 1.0, 5.0])


def slivers():
    """Random points on a sphere: angles of a tenth of a degree."""
    return shapes.random_sphere(400)


def uneven_cap():
    """A cap of `slivers`, whose rim is ragged."""
    ball = slivers()
    faces = ball.faces[(ball.points[ball.faces][..., 2] > -0.3).all(axis=1)]
    return submesh(ball, faces)


def smallest_angle(mesh):
    return np.degrees(corner_angle(mesh.side_length).min())


def even(mesh, movable=None, length=None, adaptive=False):
    start = Remesh(mesh, np.arange(mesh.n_vertices))
    movable = np.ones(mesh.n_vertices, dtype=bool) if movable is None else movable
    return remeshed(start, movable, length or mesh.side_length.mean(), adaptive, sphere_normals)


def run_remeshed(mesh, steps=None, **options):
    """(observations, last surface)."""
    options = with_stop(FlowOptions(**{"remesh": "mean", **options}), mesh.topology, False)
    built, model = setup.build(mesh, options)
    shots = evolve({"s": model}, setup.schedule(built, {"steps": steps} if steps else {}), Account())
    observations = [shot.observations["s"] for shot in shots]
    last = observations[-1]
    return observations, TriangleMesh(last.points, Topology(last.faces, len(last.points)))


@pytest.mark.parametrize("mesh", [slivers(), stretched(), shapes.torus(72, 6, 2.0, 1.0)])
def test_a_remesh_keeps_topology_and_surface_and_makes_good_triangles(mesh):
    done = even(mesh).mesh
    topology = done.topology
    assert topology.is_manifold and topology.is_oriented and topology.is_closed
    assert topology.genus == mesh.topology.genus and topology.n_components == 1
    assert smallest_angle(done) > max(20.0, smallest_angle(mesh)) and folded_faces(done) == 0
    assert enclosed_volume(done) == pytest.approx(enclosed_volume(mesh), rel=0.1)
    lengths = done.side_length / mesh.side_length.mean()
    assert np.mean((lengths > 0.7) & (lengths < 1.45)) > 0.9
    assert _same_surface(mesh, done)


def test_new_vertices_of_a_sphere_are_on_the_sphere():
    """Normals are radial, the patch is a parabola: off by O(h^4)."""
    radius = [np.linalg.norm(even(m, length=0.6 * m.side_length.mean()).mesh.points, axis=1)
              for m in (shapes.icosphere(1), shapes.icosphere(2))]  # fmt: skip
    off = [np.abs(r - 1).max() for r in radius]
    assert off[0] < 0.03 and off[1] < off[0] / 8


def test_vertices_are_mapped_to_the_input():
    mesh = stretched()
    done = even(mesh, length=0.8 * mesh.side_length.mean())
    old = done.origin[done.origin >= 0]
    assert len(done.origin) == done.mesh.n_vertices and (done.origin < 0).any()
    assert len(np.unique(old)) == len(old) and old.max() < mesh.n_vertices
    near = np.linalg.norm(done.mesh.points[done.origin >= 0] - mesh.points[old], axis=1)
    assert np.median(near) < 0.6 * mesh.side_length.mean()


def test_boundaries_and_held_vertices_stay():
    mesh = uneven_cap()
    free = setup.free_vertices(mesh.topology, "clamped")
    movable = np.isin(np.arange(mesh.n_vertices), free)
    done = even(mesh, movable)
    old = done.mesh.topology

    def rim(m):
        edges = m.points[m.topology.edges[m.topology.boundary_edges]]
        return {frozenset(map(tuple, edge)) for edge in edges}

    assert rim(done.mesh) == rim(mesh) and old.euler_characteristic == mesh.topology.euler_characteristic
    place = {int(v): k for k, v in enumerate(done.origin) if v >= 0}
    fixed = np.flatnonzero(~movable)
    assert (done.mesh.points[[place[int(v)] for v in fixed]] == mesh.points[fixed]).all()
    assert (done.origin < 0).any()


def test_curvature_shortens_edges_on_request():
    mesh = stretched(3)
    flat, curved = (even(mesh, adaptive=adaptive).mesh for adaptive in (False, True))
    ratio = []
    for m in (flat, curved):
        z, length = np.abs(m.points[m.faces].mean(axis=1)[:, 2]), m.side_length.mean(axis=1)
        ratio.append(length[z > 4.6].mean() / length[z < 2.0].mean())
    assert ratio[1] < 0.75 * ratio[0]


@pytest.mark.parametrize("mesh", [shapes.torus(24, 12), shapes.box(8, 5, 4)], ids=["torus", "box"])
def test_rounding_does_not_decide_which_of_equal_edges_are_remeshed(mesh):
    """Once a turned surface, or another processor, had other faces."""
    plain = even(mesh, length=0.9 * mesh.side_length.mean()).mesh
    rng = np.random.default_rng(0)
    for _ in range(3):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        turned = even(mesh.moved(mesh.points @ turn), length=0.9 * mesh.side_length.mean()).mesh
        assert np.array_equal(turned.faces, plain.faces)
        assert np.allclose(turned.points, plain.points @ turn, atol=1e-9)


def test_where_no_slide_improves_a_triangle_nothing_changes():
    """Angles of 39 degrees, edges near the target, and every vertex the mean of its neighbours already."""
    mesh = shapes.grid(8, 8, 8.0, 10.0)  # no coordinate is rounded
    assert 35 < smallest_angle(mesh) < 40
    assert redistribute(mesh, sphere_normals(mesh), ~mesh.topology.boundary_vertex) is None
    assert even(mesh, length=1.24) is None


def test_a_folded_or_displaced_surface_is_no_remesh():
    mesh = shapes.icosphere(3)
    assert _same_surface(mesh, mesh)
    assert not _same_surface(mesh, mesh.moved(1.02 * mesh.points))
    points = np.array(mesh.points)
    points[0] *= -0.2
    assert not _same_surface(mesh, mesh.moved(points))
    assert not _same_surface(shapes.torus(24, 12), shapes.icosphere(3))


@pytest.mark.parametrize("mesh", [slivers(), stretched(2)], ids=["slivers", "stretched"])
def test_bad_triangles_are_remeshed_and_the_flow_rests_at_4_pi(mesh):
    observations, end = run_remeshed(mesh)
    last = observations[-1].scalar
    assert energies(observations)[-1] == pytest.approx(4 * np.pi, rel=1e-4)
    assert smallest_angle(end) > 25 and end.topology.euler_characteristic == 2
    assert last["remeshes"] > 0 and last["energy_increases"] == 0 and folded_faces(end) == 0
    assert last["steps"] < 100


def test_what_a_remesh_changes_is_no_descent():
    """The energy's fall is that of the steps, which never rise, and the change by remeshing beside it."""
    observations, _ = run_remeshed(stretched(2))
    change = np.array([o.scalar["remesh_energy_change"] for o in observations])
    steps = np.diff(energies(observations)) - np.diff(change)
    assert (steps <= 1e-12).all() and np.abs(change).max() > 0
    count = np.array([o.scalar["remeshes"] for o in observations])
    # near rest a remeshing may change the energy by less than rounding
    assert count[-1] > 0 and (np.diff(count)[np.diff(change) != 0] == 1).all()


def test_area_and_volume_are_kept_across_a_remesh():
    observations, _ = run_remeshed(prolate(2), steps=8, fix_area=True, fix_volume=True)
    assert observations[-1].scalar["remeshes"] > 0
    for name in ("area", "volume"):
        assert max(abs(o.scalar[f"{name}_residual"]) for o in observations) < 1e-11


@pytest.mark.parametrize("scale", [1e-8, 1e8])
def test_remeshing_does_not_depend_on_the_unit(scale):
    mesh = stretched(2)
    plain, scaled = (run_remeshed(m, steps=6)[0] for m in (mesh, mesh.moved(scale * mesh.points)))
    assert [len(o.points) for o in plain] == [len(o.points) for o in scaled]
    assert energies(scaled) == pytest.approx(energies(plain), rel=1e-6)


@pytest.mark.slow
def test_two_joined_tori_come_to_rest_at_lawsons_surface():
    """The neck grows: its triangles are remeshed on the way. Lawson's surface of genus 2 has 21.89."""
    mesh = shapes.subdivided(two_tori()) if hasattr(shapes, "subdivided") else two_tori()
    observations, end = run_remeshed(mesh, energy="cotan", remesh=2.0 * mesh.side_length.mean())
    assert energies(observations)[-1] == pytest.approx(21.89, rel=0.01)
    assert end.topology.genus == 2 and smallest_angle(end) > 25
    assert observations[-1].scalar["energy_increases"] == 0 and observations[-1].scalar["remeshes"] > 1


def two_tori():
    path = os.path.join(os.path.dirname(__file__), "../../../shared/regressions/two_tori.obj")
    if not os.path.exists(path):
        pytest.skip("the shared regression meshes are missing")
    return read_mesh(path).mesh


@pytest.fixture
def stretched_file(tmp_path):
    path = tmp_path / "long.ply"
    write_mesh(str(path), AnnotatedMesh(stretched(2)))
    return path


def test_every_frame_has_its_own_mesh_and_a_resumed_run_the_same_bits(
    run, stretched_file, tmp_path, monkeypatch
):
    words, whole, cut_run = (
        ("--remesh", "mean", "--steps", "14"),
        tmp_path / "a.vtkhdf",
        tmp_path / "b.vtkhdf",
    )
    out = run("willmore-flow", stretched_file, *words, "-o", whole, "-o", tmp_path / "end.ply", "--json")
    results = json.loads(out.stdout)["results"]
    assert out.exit_code == 0 and results["remeshes"] >= 2
    advance, calls = Flow.advance, []

    def cut(self, state, time, dt):
        calls.append(time)
        if len(calls) == 9:
            raise KeyboardInterrupt
        return advance(self, state, time, dt)

    monkeypatch.setattr(Flow, "advance", cut)
    assert run("willmore-flow", stretched_file, *words, "-o", cut_run).exit_code == 130
    monkeypatch.setattr(Flow, "advance", advance)
    resumed = run("willmore-flow", stretched_file, *words, "--resume", f"{cut_run}.part")
    assert resumed.exit_code == 0, resumed.output + resumed.stderr
    with Trajectory(str(whole)) as a, Trajectory(str(cut_run)) as b:
        assert a.n_frames == b.n_frames == len(results["energy"]) and len(set(a.n_vertices)) > 1
        for k in range(a.n_frames):
            one, other = a.read_frame(k), b.read_frame(k)
            assert np.array_equal(one.points, other.points) and np.array_equal(one.faces, other.faces)
            assert np.array_equal(one.vertex["input_vertex"], other.vertex["input_vertex"])
            mesh = a.mesh_at(k)
            assert mesh.n_vertices == a.n_vertices[k] and mesh.topology.euler_characteristic == 2
            value = setup.ENERGIES["gauss-map"].of(mesh).value(mesh.points)
            assert value == pytest.approx(results["energy"][k], rel=1e-9)
        last = a.read_frame(a.n_frames - 1)
    end = read_mesh(str(tmp_path / "end.ply"))
    assert np.array_equal(end.mesh.faces, last.faces)
    assert np.array_equal(end.vertex["input_vertex"], last.vertex["input_vertex"])
    assert run("frames", whole, "--at", 0, "-o", tmp_path / "first.ply").exit_code == 0
    assert np.array_equal(read_mesh(str(tmp_path / "first.ply")).mesh.faces, stretched(2).faces)


def test_paraviews_reader_sees_the_mesh_of_each_frame(run, stretched_file, tmp_path):
    reader_module = pytest.importorskip("vtkmodules.vtkIOHDF")
    path = tmp_path / "run.vtkhdf"
    assert run("willmore-flow", stretched_file, "--remesh", "mean", "--steps", 8, "-o", path).exit_code == 0
    reader = reader_module.vtkHDFReader()
    reader.SetFileName(os.fspath(path))
    with Trajectory(str(path)) as trajectory:
        for k in range(trajectory.n_frames):
            reader.SetStep(k)
            reader.Update()
            grid = reader.GetOutputDataObject(0)
            assert grid.GetNumberOfPoints() == trajectory.n_vertices[k]
            assert grid.GetNumberOfCells() == trajectory.n_faces[k]


@pytest.mark.parametrize(
    "words, message, remedy",
    [
        (("--remesh", "mean", "--dt", "1e-3"), "--dt", ("--remesh", "mean")),
        (("--remesh", "mean", "--flow", "newton"), "--flow", ("--remesh", "mean", "--flow", "quadratic")),
        (
            ("--remesh", "mean", "--energy", "hinge"),
            "--energy cotan",
            ("--remesh", "mean", "--energy", "cotan"),
        ),
        (("--remesh", "small"), "number", ("--remesh", "0.5")),
        (("--remesh", "1e-9"), "from", ("--remesh", "0.5")),
        (("--remesh", "nan"), "from", ("--remesh", "0.5")),
        (("--remesh-adaptive",), "--remesh", ("--remesh-adaptive", "--remesh", "mean")),
    ],
)
def test_wrong_calls_are_refused_in_a_line_whose_remedy_runs(run, stretched_file, words, message, remedy):
    result = run("willmore-flow", stretched_file, *words, "--json")
    assert result.exit_code == 2 and result.stdout == "" and message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert run("willmore-flow", stretched_file, *remedy, "--steps", 2, "--json").exit_code == 0


def test_an_energy_of_the_inputs_vertices_has_no_value_after_a_remesh(run, stretched_file):
    out = run(
        "willmore-flow", stretched_file, "--remesh", "mean", "--steps", 2, "--report-energy", "all", "--json"
    )
    values = json.loads(out.stdout)["results"]["energies"]["quadratic"]["values"]
    assert values[0] > 0 and values[-1] is None
