"""Flows of a part of a surface, and energies reported at every frame."""

import json

import numpy as np
import pytest

from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.geometry.normals import sphere_normals
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.models.willmore.constraints import area
from ddgcli.models.willmore.energies import ENERGIES
from tests.physics.willmore_runs import assert_falls, ellipsoid, energies, run_flow, two_components


def dented_ball(level):
    """The unit sphere with a cap that is dented and shifted, and the vertices of the cap."""
    ball = shapes.icosphere(level)
    z = ball.points[:, 2]
    region = z > 0.5
    bump = np.where(region, (z - 0.5) ** 2, 0.0)[:, None]
    return ball, ball.moved(ball.points * (1 - 0.8 * bump) + 0.3 * bump * [1.0, 0.0, 0.0]), region


@pytest.mark.parametrize("level", [2, 3])
def test_a_dented_patch_returns_to_the_sphere(level):
    ball, dented, region = dented_ball(level)
    trajectory_frames, end, _ = run_flow(dented, region=region)
    assert np.abs(np.linalg.norm(dented.points, axis=1) - 1).max() > 0.1
    assert np.array_equal(end.points[~region], ball.points[~region])
    assert np.abs(np.linalg.norm(end.points, axis=1) - 1).max() < 0.1 / 4**level
    # the tangent planes are continuous across the seam
    cosine = np.einsum("ij,ij->i", sphere_normals(end), end.points)
    assert cosine.min() > 1 - 0.1 / 4**level
    assert energies(trajectory_frames)[-1] == pytest.approx(4 * np.pi, rel=1e-4)
    assert_falls(trajectory_frames)


@pytest.fixture
def ball_file(tmp_path):
    _, dented, region = dented_ball(2)
    path = tmp_path / "ball.vtu"
    write_mesh(str(path), AnnotatedMesh(dented, vertex={"cap": region.astype(float)}))
    return path, region, tmp_path


def test_the_forms_of_a_region_agree(run, ball_file):
    path, region, folder = ball_file
    np.save(folder / "mask.npy", region)
    np.savetxt(folder / "numbers.txt", np.flatnonzero(region), fmt="%d")
    results = []
    for name in ("cap", folder / "mask.npy", folder / "numbers.txt"):
        result = run("willmore-flow", path, "--region", name, "--steps", 3, "--json")
        assert result.exit_code == 0, result.stderr
        results.append(json.loads(result.stdout)["results"]["energy"])
    assert results[0] == results[1] == results[2]
    whole = run("willmore-flow", path, "--steps", 3, "--json")
    assert json.loads(whole.stdout)["results"]["energy"] != results[0]


@pytest.mark.parametrize(
    "values, message",
    [
        (np.zeros(162), "no vertex"),
        (np.ones(162), "whole surface"),
        (np.array([5.0, 162.0]), "first wrong: 162"),
        (np.array([0.5, 3.0]), "first wrong: 0.5"),
        (np.ones((162, 2)), "one finite number per row"),
        (np.full(162, np.nan), "one finite number per row"),
    ],
)
def test_wrong_regions_are_refused(run, ball_file, values, message):
    path, _, folder = ball_file
    np.save(folder / "region.npy", values)
    result = run("willmore-flow", path, "--region", folder / "region.npy", "--json")
    assert result.exit_code == 2 and result.stdout == ""
    assert "--region" in result.stderr and message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_every_energy_is_reported_at_every_frame(summary, tmp_path):
    path = tmp_path / "ellipsoid.ply"
    write_mesh(str(path), AnnotatedMesh(ellipsoid(2)))
    results = summary("willmore-flow", path, "--report-energy", "all", "--steps", 4)["results"]
    assert set(results["energies"]) == set(ENERGIES)
    for table in results["energies"].values():
        assert len(table["values"]) == len(results["energy"])
        assert (table["values"][0], table["values"][-1]) == (table["start"], table["end"])
    assert results["energies"]["gauss-map"]["values"] == results["energy"]


def test_reduced_volume_of_a_spheroid_is_right(summary, tmp_path):
    """Of the spheroid of axes 1, 1, 2: V / (4 pi / 3 (A / 4 pi)^(3/2))."""
    path = tmp_path / "ellipsoid.ply"
    write_mesh(str(path), AnnotatedMesh(ellipsoid(4)))
    eccentricity = np.sqrt(3.0) / 2.0
    area = 2 * np.pi * (1 + 2 / eccentricity * np.arcsin(eccentricity))
    truth = 2.0 / (area / (4 * np.pi)) ** 1.5
    results = summary("willmore-flow", path, "--fix-area", "--fix-volume", "--steps", 1)["results"]
    assert results["reduced_volume"] == pytest.approx(truth, rel=2e-3)


def test_each_of_several_components_has_its_own_reduced_volume(summary, tmp_path):
    """Once two spheres had 0.7: their volume over that of the sphere of the area of both."""
    path = tmp_path / "two.ply"
    ball = shapes.icosphere(3)
    write_mesh(str(path), AnnotatedMesh(two_components(ball, ellipsoid(3))))
    results = summary("willmore-flow", path, "--fix-area", "--fix-volume", "--steps", 1)["results"]
    alone = [6 * np.sqrt(np.pi) * enclosed_volume(mesh) / area(mesh) ** 1.5 for mesh in (ball, ellipsoid(3))]
    assert results["reduced_volume"] is None
    assert results["reduced_volumes"] == pytest.approx(alone, rel=1e-9)
    single = tmp_path / "one.ply"
    write_mesh(str(single), AnnotatedMesh(ball))
    results = summary("willmore-flow", single, "--steps", 1)["results"]
    assert results["reduced_volume"] == pytest.approx(alone[0], rel=1e-4)
    assert "reduced_volumes" not in results
