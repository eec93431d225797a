"""Films: mean curvature flow to rest with boundaries, volume or area kept."""

import json

import numpy as np
import pytest
from scipy.optimize import brentq

import ddgcli as ddg
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.geometry.normals import sphere_normals
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.vectors import unit_vectors
from ddgcli.models.willmore import endings
from ddgcli.models.willmore.area_energy import AreaEnergy, VolumeEnergy, mean_curvature, volume_gradient
from ddgcli.models.willmore.constraints import area, cap_faces, volume_inside
from ddgcli.models.willmore.descent import folded_faces
from ddgcli.models.willmore.flow_options import FlowOptions
from ddgcli.models.willmore.report import failure_reason
from ddgcli.models.willmore.state import FILM_STOP
from tests.physics.willmore_runs import assert_falls, ellipsoid, energies, run_flow


def film(**options):
    return FlowOptions(flow="mean-curvature", stop=FILM_STOP, **options)


def curvature(mesh):
    """(k,) H at the inner vertices."""
    return mean_curvature(mesh, sphere_normals(mesh))[~mesh.topology.boundary_vertex]


def rings(half_height, n=32):
    return shapes.cylinder(n, n // 2, 1.0, 2.0 * half_height)


def barrel(n=32):
    """A cylinder between two rings, inflated in the middle."""
    mesh = rings(1.0, n)
    z = mesh.points[:, 2] - mesh.points[:, 2].mean()
    swell = 1.0 + 0.25 * (1.0 - z**2)
    return mesh.moved(mesh.points * np.stack([swell, swell, np.ones_like(z)], axis=1))


@pytest.mark.parametrize("energy", [AreaEnergy, lambda t: VolumeEnergy(t, -1.0)], ids=["area", "volume"])
def test_gradients_match_differences(energy):
    mesh = ellipsoid(1)
    energy, h = energy(mesh.topology), 1e-5
    motion = np.random.default_rng(0).normal(size=mesh.points.shape)
    ahead, behind = (energy.value(mesh.points + sign * h * motion) for sign in (1, -1))
    value, gradient = energy.value_and_gradient(mesh.points)
    assert value == energy.value(mesh.points)
    assert (ahead - behind) / (2 * h) == pytest.approx((gradient * motion).sum(), rel=1e-8)


def test_a_bubble_has_the_same_mean_curvature_at_every_vertex():
    mesh = ellipsoid(3)
    snapshots, end, _ = run_flow(mesh, film(fix_volume=True))
    H = curvature(end)
    assert np.ptp(curvature(mesh)) > 0.5 and np.ptp(H) < 1e-6 * H.mean()
    assert enclosed_volume(end) == pytest.approx(enclosed_volume(mesh), rel=1e-11)
    radius = (3 * enclosed_volume(mesh) / (4 * np.pi)) ** (1 / 3)
    assert H.mean() == pytest.approx(1 / radius, rel=5e-3)
    assert energies(snapshots)[-1] == pytest.approx(4 * np.pi * radius**2, rel=0.01) and len(snapshots) < 60
    assert_falls(snapshots)


def test_an_uneven_bubble_comes_to_rest_in_place():
    """Else it slid for hundreds of steps; what is left of H's variation are the normals' coordinates."""
    ball = shapes.random_sphere(300, seed=1)
    mesh = ball.moved(ball.points * [1.0, 1.0, 1.5])
    first_frames, end, _ = run_flow(mesh, film(fix_volume=True))
    normal, H = unit_vectors(volume_gradient(end)), curvature(end)
    basis = np.concatenate([np.ones((len(H), 1)), normal], axis=1)
    assert np.ptp(H) < 0.02 * H.mean()
    assert np.ptp(H - basis @ np.linalg.lstsq(basis, H, rcond=None)[0]) < 5e-6 * H.mean()
    assert len(first_frames) < 80
    assert_falls(first_frames)


def test_with_the_area_kept_the_volume_grows_to_that_of_the_sphere():
    mesh = ellipsoid(2)
    inward = type(mesh).from_arrays(10.0 * mesh.points, mesh.faces[:, ::-1])
    snapshots, end, _ = run_flow(inward, film(fix_area=True))
    assert area(end) == pytest.approx(100.0 * area(mesh), rel=1e-11)
    H = curvature(end)
    assert np.ptp(H) < 4e-6 * abs(H.mean())  # rounding of the area kept
    sphere = (100.0 * area(mesh) / (4 * np.pi)) ** 1.5 * 4 * np.pi / 3
    assert -energies(snapshots)[-1] == pytest.approx(sphere, rel=0.02)
    assert enclosed_volume(end) < 1.05 * enclosed_volume(inward) < 0
    assert_falls(snapshots)


@pytest.mark.parametrize("half_height", [0.4, 0.6, 0.65])
def test_plateaus_catenoid_between_two_rings(half_height):
    """Rings of radius 1 apart by up to 2 x 0.6627: r = c cosh(z / c) with the larger c."""
    c = brentq(lambda c: c * np.cosh(half_height / c) - 1.0, 0.5524, 1.0)
    truth = 2 * np.pi * c * (half_height + 0.5 * c * np.sinh(2 * half_height / c))
    snapshots, end, shots = run_flow(rings(half_height, 32 if half_height < 0.65 else 64), film())
    assert shots[-1].stopped.startswith("curvature equal") and np.abs(curvature(end)).max() < 1e-6
    assert energies(snapshots)[-1] == pytest.approx(truth, rel=5e-3)
    waist = np.hypot(*end.points[:, :2].T).min()
    assert waist == pytest.approx(c, rel=0.01 if half_height < 0.65 else 0.05)
    assert_falls(snapshots)


@pytest.mark.parametrize("half_height", [0.69, 0.9])
def test_beyond_the_last_stable_distance_the_film_pinches_off(half_height):
    snapshots, end, shots = run_flow(rings(half_height), film())
    assert shots[-1].ending == endings.PINCH and len(snapshots) < 60
    assert all(np.isfinite(o.points).all() for o in snapshots)
    assert energies(snapshots)[-1] == pytest.approx(2 * np.pi, rel=0.05)  # two discs and a thread
    assert_falls(snapshots)


def test_an_unduloid_between_rings_has_constant_mean_curvature():
    """Along surfaces of revolution of constant H, r cos(slope) - H r^2 is constant."""
    spread = []
    for n in (24, 48):
        mesh = barrel(n)
        snapshots, end, _ = run_flow(mesh, film(fix_volume=True))
        H = curvature(end)
        assert np.ptp(H) < 1e-6 * H.mean()
        caps = cap_faces(mesh.topology)
        assert volume_inside(end, caps) == pytest.approx(volume_inside(mesh, caps), rel=1e-11)
        assert snapshots[-1].scalar["volume"] == pytest.approx(volume_inside(mesh, caps), rel=1e-9)
        inner = ~end.topology.boundary_vertex
        r = np.hypot(*end.points[:, :2].T)
        radial = np.einsum("ij,ij->i", sphere_normals(end)[:, :2], end.points[:, :2]) / r
        integral = (r * radial - H.mean() * r**2)[inner]
        assert 0.1 < integral.mean() < 0.5 and r.max() > 1.05
        spread.append(np.ptp(integral))
        assert_falls(snapshots)
    assert spread[1] < 1e-3 and spread[0] / spread[1] > 2.5


def test_capped_volumes_do_not_depend_on_the_inside():
    mesh = barrel()
    exact = np.pi * 2.0 * (1 + 2 * 0.25 * 2 / 3 + 0.25**2 * 8 / 15)
    assert volume_inside(mesh, cap_faces(mesh.topology)) == pytest.approx(exact, rel=0.02)
    assert len(cap_faces(ellipsoid(1).topology)) == 0


def test_volume_preserving_flow_in_time_decays_at_its_rate():
    """On the unit sphere the mode l decays at l (l + 1) - 2; l = 2: 4."""
    ball = shapes.icosphere(3)
    mode = 1.5 * ball.points[:, 2] ** 2 - 0.5
    bumpy = ball.moved(ball.points * (1 + 1e-2 * mode)[:, None])
    options = FlowOptions(flow="mean-curvature", fix_volume=True, timed=True)
    snapshots, end, _ = run_flow(bumpy, options, duration=0.1, step=2e-3)
    amplitude = [
        ((np.linalg.norm(m.points, axis=1) - 1) * mode).sum() / (mode**2).sum() for m in (bumpy, end)
    ]
    assert -np.log(amplitude[1] / amplitude[0]) / 0.1 == pytest.approx(4.0, rel=0.03)
    assert_falls(snapshots)


@pytest.mark.parametrize(
    "mesh, words, message",
    [
        (ellipsoid(1), ("--fix-area", "--fix-volume"), "--flow quadratic"),
        (ellipsoid(1), ("--fix-volume", "--energy", "cotan"), "--energy: has no effect on films"),
        (rings(0.5, 8), ("--fix-area",), "closed"),
        (shapes.grid(4, 4), ("--fix-volume",), "no volume"),
    ],
)
def test_films_that_are_none_are_refused(run, tmp_path, mesh, words, message):
    path = tmp_path / "film.ply"
    write_mesh(str(path), AnnotatedMesh(mesh))
    result = run("willmore-flow", path, "--flow", "mean-curvature", *words, "--json")
    assert result.exit_code == 2 and result.stdout == ""
    assert message in result.stderr and len(result.stderr.strip().splitlines()) == 1


def test_films_as_a_command(run, tmp_path):
    path = tmp_path / "film.ply"
    for half_height, code in ((0.5, 0), (0.8, 1)):
        write_mesh(str(path), AnnotatedMesh(rings(half_height, 24)))
        result = run("willmore-flow", path, "--flow", "mean-curvature", "--json")
        results = json.loads(result.stdout)["results"]
        assert result.exit_code == code and results["energy_convention"] == "area"
        assert results["energy"][-1] == pytest.approx(results["area"], rel=1e-12)
        assert ("pinches off" in results["stopped_because"]) == (code == 1)
    assert "bring the parts of the boundary closer" in result.stderr


def uneven_ball(mesh):
    """A bumpy ovoid on the faces of a sphere's mesh."""
    x = mesh.points * [1.0, 1.15, 1.3]
    return mesh.moved(x * (1 + 0.1 * np.sin(3 * x[:, :1])))


@pytest.mark.parametrize(
    "mesh, options",
    [
        (shapes.random_sphere(200), {"fix_volume": True}),
        (shapes.icosphere(2), {"fix_area": True}),
        (shapes.icosphere(2), {"fix_volume": True}),
    ],
    ids=["random points", "largest volume", "subdivided"],
)
def test_mean_curvature_is_equal_at_all_vertices_of_uneven_closed_meshes(mesh, options):
    """|dArea| / (2 |dVolume|) at each vertex, and the area's gradient is parallel to the volume's."""
    mesh = uneven_ball(mesh)
    observations, end, shots = run_flow(mesh, film(**options))
    assert shots[-1].stopped.startswith("curvature equal at all vertices")
    g, v = AreaEnergy(end.topology).value_and_gradient(end.points)[1], volume_gradient(end)
    h = 0.5 * np.linalg.norm(g, axis=1) / np.linalg.norm(v, axis=1)
    assert np.ptp(h) < 1e-6 * h.mean()
    assert np.linalg.norm(g - 2 * h.mean() * v, axis=1).max() < 2e-6 * np.linalg.norm(g, axis=1).max()
    last = observations[-1].scalar
    assert last["mean_curvature_spread"] < 1e-6 and last["energy_increases"] == 0
    assert (np.diff(energies(observations)) <= 1e-12).all()
    name = "area" if "fix_area" in options else "volume"
    assert abs(observations[-1].scalar[f"{name}_residual"]) < 1e-12


def test_a_film_whose_area_ends_by_rounding_has_equal_curvature_too():
    """Once it ended, of this ellipsoid, with curvatures 4e-4 apart."""
    ball = shapes.icosphere(3)
    egg = ball.moved(ball.points * [1.0, 1.2, 1.7])
    observations, _, _ = run_flow(egg, film(fix_volume=True))
    assert observations[-1].scalar["mean_curvature_spread"] < 1e-6
    assert (np.diff(energies(observations)) <= 1e-12).all()


def test_a_mesh_without_an_even_film_says_so_and_stays_as_it_was(monkeypatch):
    from ddgcli.models.willmore import flow

    monkeypatch.setattr(flow, "polished_film", lambda *a: None)
    observations, end, shots = run_flow(uneven_ball(shapes.icosphere(2)), film(fix_volume=True))
    assert shots[-1].ending == endings.UNEVEN_FILM
    assert observations[-1].scalar["mean_curvature_spread"] > 1e-6


@pytest.mark.parametrize("genus", [0, 1])
def test_a_closed_film_that_pinches_names_no_boundary(genus):
    """A closed surface has none to bring closer together; and a torus has no film to come to."""
    mesh = ellipsoid(1)
    if genus:
        mesh = shapes.torus(12, 8, 1.0, 0.6)
        _, mesh, shots = run_flow(mesh, film(fix_volume=True))
        assert shots[-1].ending == endings.THIN_STAR
    message = failure_reason(endings.THIN_STAR, mesh, mesh, film())
    assert ("remesh=mean" in message, "flow=quadratic" in message) == (not genus, bool(genus))
    assert "boundary" not in message


@pytest.mark.parametrize("ending", [endings.small_fall(FILM_STOP.fall, True), endings.NO_STEP])
def test_a_film_whose_faces_are_folded_over_is_not_at_rest(ending):
    ball = shapes.icosphere(2)
    folded = ball.moved(
        ball.points + np.where(np.arange(ball.n_vertices)[:, None] == 7, [0.0, 0.0, 0.7], 0.0)
    )
    assert folded_faces(folded) and not folded_faces(ball)
    options = film(fix_volume=True)
    assert failure_reason(ending, ball, ball, options) == ""
    assert "faces are folded over" in failure_reason(ending, ball, folded, options)
    assert "`remesh=mean`" in failure_reason(ending, ball, folded, options)
    assert failure_reason(ending, ball, folded, FlowOptions()) == ""
    # after the most steps without `steps`, but not after those that the user chose
    assert "faces are folded over" in failure_reason(None, ball, folded, options)
    assert failure_reason(None, ball, folded, options, bounded=True) == ""
    assert failure_reason(None, ball, ball, options) == ""


def test_a_film_that_ends_as_a_tangle_has_not_converged():
    """Once the shipped ellipsoid became one at rest; how such a flow ends depends on rounding."""
    ball = shapes.random_sphere(200, 3)
    flow = ddg.willmore_flow(ball.moved(ball.points * [5, 3, 0.7]), "mean-curvature", fix_volume=True)
    end = flow.finish()
    assert not (end.converged and folded_faces(end.mesh))
