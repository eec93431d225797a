"""Flips, overlay and refinement of every shared mesh and every hard file: right, or refused with a remedy.

The large ones are slow tests; what docs/delaunay.md states of them is counted by
`python -m benchmarks.peers.delaunay --only shared`.
"""

import logging

import numpy as np
import pytest

from ddgcli.algorithms.delaunay.common_subdivision import STEINER_POINT, BaseTriangulation, common_subdivision
from ddgcli.algorithms.delaunay.intrinsic_delaunay import intrinsic_delaunay
from ddgcli.algorithms.delaunay.refine import refine
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay, non_delaunay_edges
from ddgcli.errors import DdgError, MeshError
from ddgcli.geometry.intrinsic import corner_angle, face_area
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh.requirements import unmet_need
from tests.delaunay_cases import fan

SMALL = 2_500  # vertices: refined
QUICK = 10_000  # vertices: flipped and overlaid in `make test`
REMEDIES = ("tufted", "`repair=", "needs a surface", "correct", "check the coordinates")


def surfaces(folder):
    for path in sorted(folder.iterdir()):
        if path.is_file() and path.suffix not in (".py", ".md"):
            try:
                source = read_mesh(str(path))
            except DdgError:
                continue
            if source.kind == "surface":
                yield path.name, source.mesh


def check(name, mesh):
    try:
        flipped = flip_to_delaunay(mesh, track=True)
    except MeshError as error:
        assert len(mesh.topology.nonmanifold_edges) or not mesh.topology.is_oriented, (name, error)
        return False
    assert not non_delaunay_edges(flipped.mesh).any(), name
    cut = common_subdivision(flipped, BaseTriangulation.itself(mesh))
    assert cut.mesh.topology.euler_characteristic == mesh.topology.euler_characteristic, name
    assert face_area(cut.mesh.side_length).sum() == pytest.approx(
        face_area(mesh.side_length).sum(), rel=1e-12
    ), name
    assert cut.length_residual < 1e-9, name
    return True


def test_flips_and_overlays_end_on_every_shared_mesh(shared_meshes):
    done = [check(name, mesh) for name, mesh in surfaces(shared_meshes) if mesh.n_vertices <= QUICK]
    assert sum(done) >= 12


@pytest.mark.slow
def test_flips_and_overlay_of_the_large_ones(shared_meshes):
    done = [check(name, mesh) for name, mesh in surfaces(shared_meshes) if mesh.n_vertices > QUICK]
    assert sum(done) >= 8


def refined_and_right(name, mesh, degrees=25):
    refined = refine(mesh, degrees)
    bound = np.radians(degrees) * (1 - 1e-6)
    small = (corner_angle(refined.triangulation.mesh.side_length) < bound).any(axis=1)
    assert refined.converged and small.sum() == refined.excepted_faces, name
    cut = common_subdivision(refined.triangulation, refined.base)
    if len(refined.triangulation.mollification.faces) == 0:
        assert cut.length_residual < 1e-9, name
    assert (cut.vertex_kind == STEINER_POINT).sum() == len(refined.steiner), name
    assert cut.mesh.topology.euler_characteristic == mesh.topology.euler_characteristic, name
    return refined


def can_be_glued(mesh):
    return not len(mesh.topology.nonmanifold_edges) and mesh.topology.is_oriented


@pytest.mark.parametrize("degrees", [pytest.param(25, marks=pytest.mark.slow), 30])
def test_refinement_ends_on_every_shared_mesh(shared_meshes, degrees):
    small = [(n, m) for n, m in surfaces(shared_meshes) if m.n_vertices <= SMALL and can_be_glued(m)]
    assert len(small) >= 3
    for name, mesh in small:
        refined_and_right(name, mesh, degrees)


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [25, 30])
def test_refinement_of_the_large_ones(shared_meshes, degrees):
    large = [(n, m) for n, m in surfaces(shared_meshes) if m.n_vertices > SMALL and can_be_glued(m)]
    assert len(large) >= 18
    for name, mesh in large:
        refined_and_right(name, mesh, degrees)


def test_hard_files_are_right_or_refused_with_a_remedy(shared_meshes, monkeypatch):
    monkeypatch.setattr(logging.getLogger("ddgcli"), "disabled", True)
    accepted, refused = [], []
    for name, mesh in surfaces(shared_meshes / "hard"):
        two_sided = mesh.topology.is_orientable  # a common subdivision needs two sides
        try:
            report = intrinsic_delaunay(mesh, subdivide=two_sided)
        except MeshError as error:
            assert not info_accepts(mesh), (name, error)
            assert any(word in str(error) for word in REMEDIES), (name, error)
            refused.append(name)
            continue
        accepted.append(name)
        assert info_accepts(mesh) and report.converged, name
        assert report.results["after"]["non_delaunay_edges"] == 0, name
        assert not two_sided or report.accuracy["overlay_length_residual"] < 1e-7, name
        assert report.accuracy["angle_defect_residual"] < 1e-8, name
    assert len(accepted) >= 35 and len(refused) >= 9


def test_hard_files_are_refined_or_end_at_their_budget(shared_meshes, monkeypatch):
    monkeypatch.setattr(logging.getLogger("ddgcli"), "disabled", True)
    count = 0
    for name, mesh in surfaces(shared_meshes / "hard"):
        longest = mesh.side_length.max(initial=0.0)
        if not info_accepts(mesh) or not 1e-140 < longest < 1e140 or not mesh.topology.is_orientable:
            continue
        refined = refine(mesh, 25, max_points=1500)
        steiner = refined.steiner.barycentric
        assert np.isfinite(steiner).all() and (steiner >= 0).all(), name
        assert refined.converged or len(refined.steiner) == 1500, name
        count += 1
    assert count >= 33


def info_accepts(mesh):
    return unmet_need(mesh, "delaunay") is None


@pytest.mark.parametrize("valence", [1500, pytest.param(5000, marks=pytest.mark.slow)])
def test_a_fan_of_high_valence_has_an_overlay(valence):
    mesh = fan(valence)
    flipped = flip_to_delaunay(mesh, track=True)
    cut = common_subdivision(flipped, BaseTriangulation.itself(mesh))
    assert cut.length_residual < 1e-9 and flipped.crossings.max() > valence / 10
    assert face_area(cut.mesh.side_length).sum() == pytest.approx(
        face_area(mesh.side_length).sum(), rel=1e-12
    )
    refined_and_right("fan", mesh)
