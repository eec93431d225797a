"""Membranes: area and volume kept, spontaneous curvature, against axisymmetric solutions."""

import json

import numpy as np
import pytest
from scipy.optimize import brentq

import ddgcli as ddg
from ddgcli.errors import MeshError
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.models.willmore import setup
from ddgcli.models.willmore.constraints import area, areas, volumes_inside
from ddgcli.models.willmore.endings import LOWER_BOUND
from ddgcli.models.willmore.energies import ENERGIES
from ddgcli.models.willmore.helfrich_energy import HelfrichEnergy
from ddgcli.models.willmore.least_energies import least_energies_of_vesicles
from ddgcli.models.willmore.setup import FlowOptions
from ddgcli.models.willmore.state import CONSTRAINED_NEWTON_STOP, DEFAULT_STOP
from ddgcli.models.willmore.step_rules import HELFRICH_ERROR_FRACTION
from tests.physics.axisymmetric_vesicles import vesicle
from tests.physics.willmore_runs import assert_falls, energies, run_flow

CONSTRAINED = FlowOptions(fix_area=True, fix_volume=True, stop=DEFAULT_STOP)


def spheroid(reduced_volume, prolate, level, radius=1.0):
    """A spheroid whose mesh has this reduced volume, and the area of the sphere of this radius."""
    ball = shapes.icosphere(level)

    def off(axis):
        mesh = ball.moved(ball.points * [1.0, 1.0, axis])
        return 6.0 * np.sqrt(np.pi) * enclosed_volume(mesh) / area(mesh) ** 1.5 - reduced_volume

    axis = brentq(off, 1.001, 6.0) if prolate else brentq(off, 0.08, 0.999)
    mesh = ball.moved(ball.points * [1.0, 1.0, axis])
    return mesh.moved(mesh.points * radius * np.sqrt(4.0 * np.pi / area(mesh)))


def test_axisymmetric_solutions_are_those_of_the_literature():
    """The oblate branch has the lower energy below the reduced volume 0.651 (Seifert et al. 1991)."""
    oblate, prolate = ([vesicle(v, branch)[0] for v in (0.645, 0.657)] for branch in (False, True))
    assert oblate[0] < prolate[0] and oblate[1] > prolate[1]


@pytest.mark.parametrize(
    "volume, prolate",
    [
        pytest.param(0.6, False, marks=pytest.mark.slow),
        pytest.param(0.65, False, marks=pytest.mark.slow),
        pytest.param(0.65, True, marks=pytest.mark.slow),
        pytest.param(0.8, True, marks=pytest.mark.slow),
        (0.95, True),
    ],
)
def test_vesicles_have_the_energy_of_the_axisymmetric_solution(volume, prolate):
    snapshots, end, _ = run_flow(spheroid(volume, prolate, 4), CONSTRAINED)
    assert energies(snapshots)[-1] == pytest.approx(vesicle(volume, prolate)[0], rel=2.5e-3)
    assert snapshots[-1].scalar["reduced_volume"] == pytest.approx(volume, rel=1e-10)
    assert_falls(snapshots)


@pytest.mark.slow
@pytest.mark.parametrize("volume, prolate", [(0.8, True), (0.6, False)])
def test_newton_steps_reach_the_axisymmetric_solution_on_a_coarse_mesh(volume, prolate):
    """1,280 faces; vertices move along their normals only."""
    mesh = spheroid(volume, prolate, 3)
    options = FlowOptions(flow="newton", fix_area=True, fix_volume=True, stop=CONSTRAINED_NEWTON_STOP)
    snapshots, _, _ = run_flow(mesh, options, steps=10)
    assert energies(snapshots)[-1] == pytest.approx(vesicle(volume, prolate)[0], rel=0.03)
    assert_falls(snapshots)


def test_a_red_blood_cell_is_a_biconcave_disc():
    """Thinner in the middle than at the rim, as thick as the axisymmetric profile."""
    snapshots, end, _ = run_flow(spheroid(0.6, False, 3), CONSTRAINED)
    truth, profile = vesicle(0.6, False)
    assert energies(snapshots)[-1] == pytest.approx(truth, rel=0.02)
    r, z = np.hypot(*end.points[:, :2].T), np.abs(end.points[:, 2])
    middle, thickest = z[r < 0.2].mean(), z.max()
    heights = np.abs(profile[:, 1] - profile[:, 1].mean())
    assert middle < 0.6 * thickest
    assert thickest == pytest.approx(heights[profile[:, 0] > 0.4].max(), rel=0.05)
    assert middle == pytest.approx(np.interp(0.12, profile[:20, 0], heights[:20]), abs=0.05)


@pytest.mark.parametrize("name", ["gauss-map", "cotan"])
@pytest.mark.parametrize("is_open", [False, True])
def test_helfrich_gradient_matches_differences(name, is_open):
    mesh = shapes.grid(5, 4) if is_open else shapes.icosphere(1)
    mesh = mesh.moved(mesh.points + 0.05 * np.random.default_rng(0).normal(size=mesh.points.shape))
    energy = HelfrichEnergy(mesh.topology, ENERGIES[name].of(mesh), 0.7)
    d, h = np.random.default_rng(1).normal(size=mesh.points.shape), 1e-5
    steps = [energy.value(mesh.points + k * h * d) for k in (-2, -1, 1, 2)]
    slope = (steps[0] - 8 * steps[1] + 8 * steps[2] - steps[3]) / (12 * h)
    value, gradient = energy.value_and_gradient(mesh.points)
    assert value == energy.value(mesh.points)
    assert np.sum(gradient * d) == pytest.approx(slope, rel=1e-6)


def test_the_helfrich_energy_of_a_sphere():
    """(1/R - H0)^2 4 pi R^2, converging at second order."""
    error = []
    for level in (2, 3):
        ball = shapes.icosphere(level, 2.0)
        energy = HelfrichEnergy(ball.topology, ENERGIES["gauss-map"].of(ball), -0.4)
        error.append(energy.value(ball.points) / (4 * np.pi * (1 + 0.8) ** 2) - 1)
    assert abs(error[1]) < 5e-3 and error[0] / error[1] == pytest.approx(4, rel=0.1)


@pytest.mark.parametrize("level, within", [(3, 0.02), pytest.param(4, 5e-3, marks=pytest.mark.slow)])
def test_spontaneous_curvature_against_the_axisymmetric_solution(level, within):
    """H0 is in the unit of the input, and positive as on a sphere, whichever way the faces turn."""
    radius, curvature = 10.0, 0.6
    mesh = spheroid(0.8, True, level, radius)
    inward = type(mesh).from_arrays(mesh.points, mesh.faces[:, ::-1])
    options = FlowOptions(
        fix_area=True, fix_volume=True, spontaneous_curvature=curvature / radius, stop=DEFAULT_STOP
    )
    snapshots, _, _ = run_flow(inward, options)
    assert energies(snapshots)[-1] == pytest.approx(vesicle(0.8, True, curvature)[0], rel=within)
    assert energies(snapshots)[-1] < 0.5 * vesicle(0.8, True)[0]
    assert_falls(snapshots)


def test_subdivision_brings_a_coarse_vesicle_to_its_energy(run, tmp_path):
    """A vesicle of 1,280 faces is 1.1 % below; split in four it keeps area and volume."""
    path = tmp_path / "cell.ply"
    write_mesh(str(path), AnnotatedMesh(spheroid(0.8, True, 2)))
    words = ("willmore-flow", path, "--fix-area", "--fix-volume", "--json")
    coarse, fine = (json.loads(run(*words, *more).stdout)["results"] for more in ((), ("--subdivide", "1")))
    truth = vesicle(0.8, True)[0]
    assert fine["reduced_volume"] == pytest.approx(coarse["reduced_volume"], rel=1e-9)
    off = [abs(results["energy"][-1] / truth - 1) for results in (coarse, fine)]
    assert off[1] < 0.01 and off[1] < 0.4 * off[0]


def test_one_of_several_vesicles_keeps_its_own_area_and_volume_where_the_region_names_its_vertices():
    ball = ddg.icosphere(2)
    flat = ball.moved(ball.points * [1, 1, 0.5])
    points = np.concatenate([flat.points, np.asarray(ball.points) + [3.0, 0.0, 0.0]])
    both = ddg.TriangleMesh.from_arrays(points, np.concatenate([ball.faces, ball.faces + ball.n_vertices]))
    first = np.arange(ball.n_vertices)
    end = ddg.willmore_flow(both, fix_area=True, fix_volume=True, region=first).finish()
    assert np.array_equal(end.mesh.points[ball.n_vertices :], points[ball.n_vertices :])
    faces = np.asarray(end.mesh.faces)
    moved = ddg.TriangleMesh.from_arrays(end.mesh.points[first], faces[faces.max(axis=1) < ball.n_vertices])
    assert area(moved) == pytest.approx(area(flat), rel=1e-12)
    assert enclosed_volume(moved) == pytest.approx(enclosed_volume(flat), rel=1e-12)
    assert end.results["energy"][-1] < end.results["energy"][0]


def two_vesicles(small, level=2):
    """An oblate ellipsoid, and a prolate one of another size whose faces come first."""
    ball = ddg.icosphere(level)
    n, shapes = ball.n_vertices, (ball.points * [1, 1, 0.5], small * np.array(ball.points) * [1, 1, 2])
    faces = np.concatenate([ball.faces + n, ball.faces])
    return ddg.TriangleMesh.from_arrays(np.concatenate([shapes[0], shapes[1] + [3.0, 0.0, 0.0]]), faces)


def own_areas_and_volumes(mesh):
    component = mesh.topology.vertex_component
    return areas(mesh, component), volumes_inside(mesh, None, component)


@pytest.mark.parametrize("small", [0.3, 1e-3])
@pytest.mark.parametrize("option", ["fix_area", "fix_volume"])
def test_each_vesicle_becomes_the_ball_of_its_own_area_or_volume(small, option):
    start = two_vesicles(small)
    end = ddg.willmore_flow(start, **{option: True}).finish()
    assert end.results["energy"][-1] == pytest.approx(8 * np.pi, rel=1e-4)
    quantity = option.removeprefix("fix_")
    assert end.accuracy["constraint_residuals"][quantity] < 1e-11
    before, after = own_areas_and_volumes(start), own_areas_and_volumes(end.mesh)
    assert after[quantity == "volume"] == pytest.approx(before[quantity == "volume"], rel=1e-11)
    # of a ball of triangles, which cut off a share
    reduced = 6 * np.sqrt(np.pi) * np.abs(after[1]) / after[0] ** 1.5
    assert reduced == pytest.approx(1, abs=4 / (start.n_faces / 2))


def test_two_vesicles_come_to_rest_as_each_does_alone():
    both, options = two_vesicles(0.3, 3), {"fix_area": True, "fix_volume": True}
    end = ddg.willmore_flow(both, **options).finish()
    before, after = own_areas_and_volumes(both), own_areas_and_volumes(end.mesh)
    assert np.allclose(after, before, rtol=1e-11, atol=0)
    n, total = both.n_vertices // 2, 0.0
    for first in (0, n):
        faces = both.faces[(both.faces[:, 0] >= first) & (both.faces[:, 0] < first + n)] - first
        alone = ddg.TriangleMesh.from_arrays(both.points[first : first + n], faces)
        total += ddg.willmore_flow(alone, **options).finish().results["energy"][-1]
    assert end.results["energy"][-1] == pytest.approx(total, rel=1e-3)


@pytest.mark.parametrize(
    ("options", "remedy"),
    [
        ({"flow": "mean-curvature", "fix_volume": True}, "`region`"),
        ({"fix_area": True, "remesh": "mean"}, "`remesh`"),
    ],
)
def test_flows_that_would_keep_a_sum_are_refused_with_a_remedy(options, remedy):
    with pytest.raises(MeshError, match=remedy):
        ddg.willmore_flow(two_vesicles(0.3), **options)


def test_no_vesicle_ends_below_the_least_energy_of_its_reduced_volume(run, tmp_path):
    assert least_energies_of_vesicles(spheroid(0.8, True, 4))[0] == pytest.approx(
        vesicle(0.8, True)[0], rel=2e-3
    )
    ball, path = shapes.icosphere(2), tmp_path / "bumpy.ply"
    x, y, z = np.array(ball.points).T
    bumps = 1.0 + 0.2 * np.sin(4 * x + 1) * np.cos(3 * y) * (z + 0.3)
    write_mesh(str(path), AnnotatedMesh(ball.moved(ball.points * bumps[:, None])))
    words = ("--fix-area", "--fix-volume", "--json")
    crumpled = run("willmore-flow", path, *words, "--flow", "newton")
    assert crumpled.exit_code == 1 and "use --flow quadratic" in crumpled.stderr
    least = least_energies_of_vesicles(ball.moved(ball.points * bumps[:, None])).sum()
    assert 0.975 * least < json.loads(crumpled.stdout)["results"]["energy"][-1] < least


@pytest.mark.parametrize("axes", [(1.3, 1.2, 0.8), (1.1, 1.1, 0.9)])
def test_newton_steps_of_a_nearly_round_vesicle_end_where_descent_does(axes):
    """From the rest of the smooth surface a saddle of the mesh leads down to 4 pi, a crumpled polyhedron."""
    ball = shapes.icosphere(2)
    surface = ball.moved(ball.points * np.array(axes))
    ends = []
    for kind, stop in (("newton", CONSTRAINED_NEWTON_STOP), ("quadratic", DEFAULT_STOP)):
        observations, _, _ = run_flow(
            surface, FlowOptions(flow=kind, fix_area=True, fix_volume=True, stop=stop)
        )
        ends.append(energies(observations)[-1])
    assert ends[0] == pytest.approx(ends[1], rel=5e-3)
    assert ends[0] > least_energies_of_vesicles(surface).sum()


@pytest.mark.parametrize("fix_volume", [False, True])
def test_flows_end_where_the_square_of_the_curvature_would_become_negative(fix_volume):
    ball, curvature = shapes.icosphere(2), 5.0
    options = FlowOptions(
        fix_area=True, fix_volume=fix_volume, spontaneous_curvature=curvature, stop=DEFAULT_STOP
    )
    observations, _, snapshots = run_flow(ball.moved(ball.points * [1.0, 1.0, 0.4]), options)
    allowed = HELFRICH_ERROR_FRACTION * curvature**2 * observations[0].scalar["area"]
    assert_falls(observations)
    assert energies(observations)[-1] >= -allowed
    assert snapshots[-1].ending == LOWER_BOUND


@pytest.mark.parametrize(
    "words, message",
    [
        (("--spontaneous-curvature", "1"), "--fix-area"),
        (("--spontaneous-curvature", "1", "--fix-area", "--flow", "mean-curvature"), "--flow quadratic"),
        (("--spontaneous-curvature", "nan", "--fix-area"), "finite"),
    ],
)
def test_spontaneous_curvature_without_a_membrane_is_refused(run, tmp_path, words, message):
    path = tmp_path / "ball.ply"
    write_mesh(str(path), AnnotatedMesh(shapes.icosphere(1)))
    result = run("willmore-flow", path, *words, "--json")
    assert result.exit_code == 2 and result.stdout == ""
    assert message in result.stderr and len(result.stderr.strip().splitlines()) == 1


def test_the_command_says_what_it_lowers(summary, tmp_path):
    path = tmp_path / "cell.ply"
    write_mesh(str(path), AnnotatedMesh(spheroid(0.9, True, 2)))
    words = ("--fix-area", "--spontaneous-curvature", "0.5", "--steps", 2)
    results = summary("willmore-flow", path, *words)["results"]
    assert "H0 = 0.5" in results["energy_convention"] and results["reduced_volume"] > 0.85
    plain = setup.build(spheroid(0.9, True, 2), CONSTRAINED)[0]
    assert "H0" not in plain.convention
