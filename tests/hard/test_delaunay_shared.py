"""Flips and overlay succeed on every manifold mesh of the shared collection; refinement on the small ones."""

import numpy as np
import pytest

from ddgcli.algorithms.common_subdivision import Base, common_subdivision
from ddgcli.algorithms.delaunay import flip_to_delaunay, non_delaunay_edges
from ddgcli.algorithms.refine import refine
from ddgcli.errors import DdgError, MeshError
from ddgcli.geometry.intrinsic import corner_angle, face_area
from ddgcli.io.mesh_file import read_mesh

SMALL = 2_500  # vertices: refined
QUICK = 10_000  # vertices: flipped and overlaid in `make test`


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
    cut = common_subdivision(flipped, Base.itself(mesh))
    assert cut.mesh.topology.euler_characteristic == mesh.topology.euler_characteristic, name
    assert face_area(cut.mesh.side_length).sum() == pytest.approx(
        face_area(mesh.side_length).sum(), rel=1e-12
    ), name
    assert cut.length_residual < 1e-9, name
    return True


def test_flips_and_overlay(shared_meshes):
    done = [check(name, mesh) for name, mesh in surfaces(shared_meshes) if mesh.n_vertices <= QUICK]
    assert sum(done) >= 12


@pytest.mark.slow
def test_flips_and_overlay_of_the_large_ones(shared_meshes):
    done = [check(name, mesh) for name, mesh in surfaces(shared_meshes) if mesh.n_vertices > QUICK]
    assert sum(done) >= 8


def test_refinement_to_25_degrees(shared_meshes):
    count = 0
    for name, mesh in surfaces(shared_meshes):
        if mesh.n_vertices > SMALL or not mesh.topology.is_manifold or not mesh.topology.is_oriented:
            continue
        refined = refine(mesh, 25)
        small = (corner_angle(refined.flipped.mesh.side_length) < np.radians(25) * (1 - 1e-6)).any(axis=1)
        assert refined.reached and small.sum() == refined.excepted_faces, name
        assert common_subdivision(refined.flipped, refined.base).length_residual < 1e-9, name
        count += 1
    assert count >= 6
