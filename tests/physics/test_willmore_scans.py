"""Uneven triangles, as of scans: quasi-Newton steps to the sphere, noise of the vertices, conformal ends."""

import numpy as np
import pytest

from benchmarks.common.mesh_classes import ellipsoids
from benchmarks.common.submesh import submesh
from ddgcli.geometry.normals import sphere_normals
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.models.willmore import vertex_noise
from ddgcli.models.willmore.endings import NOT_CONFORMAL_REST
from ddgcli.models.willmore.energies import ENERGIES
from ddgcli.models.willmore.secant_pairs import MAX_PAIRS, SecantPairs
from ddgcli.models.willmore.setup import FlowOptions
from ddgcli.models.willmore.state import CONFORMAL_STOP, DEFAULT_STOP
from ddgcli.models.willmore.vertex_noise import noise_energy
from tests.physics.willmore_runs import assert_falls, ellipsoid, energies, run_flow

CONFORMAL = FlowOptions(flow="conformal", stop=CONFORMAL_STOP)


def dumbbell(level=3):
    ball = shapes.icosphere(level)
    x, y, z = ball.points.T
    neck = 0.35 + 0.65 * z**2
    return ball.moved(np.stack([x * neck, y * neck, 1.8 * z], axis=1))


def horned(level=3):
    """A ball whose faces are large towards its south pole, with a horn of six radii there."""
    ball = shapes.icosphere(level)
    z = ball.points[:, 2]
    height = (z + 0.8) / (1.0 + 0.8 * z)  # a conformal map of the sphere
    shrunk = np.sqrt(np.maximum(1.0 - height**2, 0.0) / np.maximum(1.0 - z**2, 1e-12))
    points = np.stack([*(ball.points[:, :2].T * shrunk), height], axis=1)
    return ball.moved(points * (1.0 + 6.0 * np.exp(-20.0 * (1.0 + height)))[:, None])


def with_noise(mesh, share):
    height = share * mesh.side_length.mean() * np.random.default_rng(0).normal(size=mesh.n_vertices)
    return mesh.moved(mesh.points + sphere_normals(mesh) * height[:, None])


def test_secant_pairs_minimise_a_quadratic_function_in_as_many_steps_as_it_has_stiffnesses():
    """With exact line search it is the method of conjugate gradients."""
    rng = np.random.default_rng(0)
    rotation = np.linalg.qr(rng.normal(size=(12, 12)))[0]
    matrix = rotation @ np.diag(np.repeat([1.0, 10.0, 200.0], 4)) @ rotation.T
    x, pairs = rng.normal(size=(4, 3)), SecantPairs()
    for _ in range(3):
        g = (matrix @ x.ravel()).reshape(4, 3)
        d = pairs.motion(g, lambda covector: 3.0 * covector)
        bent = (matrix @ d.ravel()).reshape(4, 3)
        step = -np.sum(g * d) / np.sum(d * bent)
        x, pairs = x + step * d, pairs.with_pair(step * d, step * bent)
    assert np.abs(x).max() < 1e-10


def test_secant_pairs_keep_the_newest_and_leave_concave_steps_out():
    rng = np.random.default_rng(0)
    motions = rng.normal(size=(MAX_PAIRS + 2, 3, 3))
    pairs = SecantPairs()
    for motion in motions:
        pairs = pairs.with_pair(motion, -motion).with_pair(motion, 2.0 * motion)
    assert np.array_equal(pairs.motions, motions[2:])
    again = SecantPairs.of_arrays(pairs.arrays(5), 3)
    assert np.array_equal(again.motions, pairs.motions) and np.array_equal(again.changes, pairs.changes)
    assert SecantPairs.of_arrays(SecantPairs().arrays(5), 3).motions == ()


@pytest.mark.parametrize("mesh, steps", [(dumbbell(), 12), (horned(), 16)], ids=["dumbbell", "horned"])
def test_long_shapes_of_uneven_triangles_become_spheres_in_few_steps(mesh, steps):
    """The horned ball takes 10 steps; with momentum alone it took 28."""
    snapshots, _, _ = run_flow(mesh, FlowOptions(stop=DEFAULT_STOP), steps=steps)
    assert energies(snapshots)[0] > 1.3 * 4 * np.pi
    assert energies(snapshots)[-1] == pytest.approx(4 * np.pi, rel=1e-3)
    assert_falls(snapshots)


@pytest.mark.parametrize("family", ["good", "irregular", "stretched"])
@pytest.mark.parametrize("share", [0.01, 0.05])
def test_the_energy_that_noise_adds_is_predicted(family, share):
    smooth = ellipsoids((1.0, 1.0, 2.0))[family](1)
    assert noise_energy(smooth)[1] < 0.02 * 15.45
    mesh = with_noise(smooth, share)
    relative, added = noise_energy(mesh)
    assert relative == pytest.approx(share, rel=0.3)
    by_cotan = ENERGIES["cotan"].of(mesh).value(mesh.points) - ENERGIES["cotan"].of(smooth).value(
        smooth.points
    )
    if family == "good":
        for name in ("gauss-map", "sullivan", "cotan"):
            kind = ENERGIES[name]
            rise = kind.of(mesh).value(mesh.points) - kind.of(smooth).value(smooth.points)
            assert 0.7 * added < rise < 1.5 * added, name
    assert 0.1 * added < by_cotan < 2.0 * added


def test_the_command_warns_of_noise_and_of_none_on_smooth_surfaces(run, tmp_path):
    path = tmp_path / "mesh.ply"
    for mesh, warned in ((with_noise(shapes.icosphere(3), 0.05), True), (ellipsoid(3), False)):
        write_mesh(str(path), AnnotatedMesh(mesh))
        result = run("willmore-flow", path, "--steps", 1, "--json")
        assert result.exit_code == 0 and ("the vertices have noise of 0.0" in result.stderr) is warned


@pytest.mark.parametrize(
    "words",
    [("--energy", "circle-angle"), ("--spontaneous-curvature", 1, "--fix-area")],
    ids=("zero", "negative"),
)
def test_no_noise_is_reported_where_there_is_none_and_the_energy_is_rounding_or_negative(
    summary, tmp_path, words
):
    """Random points of a sphere: no noise, whatever the triangles, and energies about zero."""
    path = tmp_path / "mesh.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.random_sphere(800, 3)))
    out = summary("willmore-flow", path, *words, "--steps", 1)
    assert abs(out["results"]["energy"][0]) < 0.1 and out["warnings"] == []


def test_a_conformal_flow_that_cannot_go_on_says_so_and_names_the_flow_that_can(run, tmp_path):
    path = tmp_path / "mesh.ply"
    write_mesh(str(path), AnnotatedMesh(dumbbell()))
    result = run("willmore-flow", path, "--flow", "conformal", "--json")
    assert result.exit_code == 1
    assert (
        "curvature is less even than its conformal class allows" in result.stderr
        and "--flow quadratic" in result.stderr
    )
    _, _, shots = run_flow(ellipsoid(3), CONFORMAL)
    assert shots[-1].ending and shots[-1].ending != NOT_CONFORMAL_REST


def test_more_noise_than_energy_is_no_noise(monkeypatch, caplog):
    """Creases of a cage of control points look like noise of half an edge, of more energy than there is."""
    monkeypatch.setattr(vertex_noise, "noise_energy", lambda mesh: (0.46, 2.5e4))
    vertex_noise.warn_of_noise(shapes.icosphere(0), 168.5, "gauss-map")
    assert caplog.text == ""
    vertex_noise.warn_of_noise(shapes.icosphere(0), 1e4, "cotan")  # which has all of the estimate
    assert caplog.text == ""
    vertex_noise.warn_of_noise(shapes.icosphere(0), 1e4, "gauss-map")  # 0.3 of it may be what noise adds
    assert "the vertices have noise of 0.46 of an edge, which makes most of the energy 1e+04" in caplog.text
    vertex_noise.warn_of_noise(shapes.icosphere(0), 5e4, "cotan")
    assert "which makes about 2.5e+04 of the energy 5e+04" in caplog.text


def test_the_crease_at_a_patch_is_no_noise(run, tmp_path):
    """The patch begins as a membrane: a flat disk across the hemisphere."""
    ball, path = shapes.icosphere(3), tmp_path / "half.ply"
    half = submesh(ball, ball.faces[(ball.points[ball.faces][..., 2] > -1e-9).all(axis=1)])
    write_mesh(str(path), AnnotatedMesh(half))
    result = run("willmore-flow", path, "--fill", "all", "--steps", 1)
    assert result.exit_code == 0 and "noise" not in result.stderr
