"""Distances beside the peers' on the same meshes."""

import numpy as np
import pytest

from ddgcli.algorithms.curves.shortest_paths import shortest_paths
from ddgcli.algorithms.distance.exact import exact_distance
from ddgcli.algorithms.distance.fast_marching import marched_distance
from ddgcli.algorithms.distance.heat import HeatSolver
from ddgcli.algorithms.distance.sources import Sources
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh import shapes

SMALL = ["spot.obj", "goathead.obj", "hemisphere.off", "lego.ply", "wingnut.obj", "spot_control_mesh.obj"]
LARGE = [
    "blub_triangulated.obj", "boot.obj", "demosthenes-low-res.obj", "fairing-cross.off", "hand_lowres.obj",
    "koala.obj", "menger_sponge3.off", "nefertiti-lowres.obj", "penguin_control_mesh.obj", "pizza.obj",
    "plane_holes.obj", "self_intersectA.obj", "plate_holes.STL", "1002_tray_bottom.STL", "box.STL",
    "cloth_ball92.ply", "counter.unitsmm.STL", "featuretype.STL",
]  # fmt: skip


def peer_distance(mesh, source):
    pygeodesic = pytest.importorskip("pygeodesic.geodesic")
    solver = pygeodesic.PyGeodesicAlgorithmExact(mesh.points, mesh.faces)
    return solver.geodesicDistances(np.array([source]))[0]


def compared(mesh, source):
    ours = exact_distance(mesh, source)
    theirs = peer_distance(mesh, source)
    reached = np.isfinite(ours.distance) & np.isfinite(theirs)
    assert reached.sum() >= 0.9 * np.isfinite(ours.distance).sum()
    difference = np.where(reached, ours.distance - np.where(reached, theirs, 0.0), 0.0)
    return ours, difference / ours.distance[reached].max()


@pytest.mark.parametrize("name", SMALL)
def test_exact_is_pygeodesics(shared_meshes, name):
    mesh = read_mesh(str(shared_meshes / name)).mesh
    for source in (0, mesh.n_vertices // 2):
        _, difference = compared(mesh, source)
        assert np.abs(difference).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", LARGE)
def test_exact_is_pygeodesics_or_shorter(shared_meshes, name):
    """Never longer; where the peer is longer by more than rounding, a real path proves it wrong."""
    mesh = read_mesh(str(shared_meshes / name)).mesh
    ours, difference = compared(mesh, 0)
    assert difference.max() < 1e-12
    if difference.min() < -1e-12:
        proved_by_paths(mesh, ours, difference)
    else:
        assert np.abs(difference).max() < 1e-9


def proved_by_paths(mesh, ours, difference):
    """Paths on the surface to the vertices that differ most: measured, they are as short as ours says."""
    target = [int(v) for v in np.argsort(difference)[:5]]
    curves = shortest_paths(mesh, ours, Sources.at([0]), target)
    scale = ours.distance[np.isfinite(ours.distance)].max()
    for v, entry in zip(target, curves.entries, strict=True):
        gain = -difference[v] * scale
        assert entry["length"] - ours.distance[v] < 0.01 * gain


def test_menger_sponge_the_peer_is_longer_than_a_path(shared_meshes):
    mesh = read_mesh(str(shared_meshes / "menger_sponge3.off")).mesh
    ours, difference = compared(mesh, 0)
    assert difference.max() < 1e-12
    assert difference.min() < -1e-10
    proved_by_paths(mesh, ours, difference)


def test_heat_with_the_same_operator_is_potpourris():
    """The same systems up to the additive constant, which we fit to the one-ring."""
    potpourri3d = pytest.importorskip("potpourri3d")
    mesh = shapes.random_sphere(2000)
    mesh = mesh.moved(mesh.points * [1.0, 1.2, 0.8])
    theirs = potpourri3d.MeshHeatMethodDistanceSolver(mesh.points, mesh.faces, use_robust=False)
    ours = HeatSolver(mesh).distance(0).distance
    difference = ours - theirs.compute_distance(0)
    difference -= difference[1:].mean()
    assert np.abs(difference[1:]).max() < 1e-4 * ours.max()


def test_fast_marching_is_nearer_than_potpourris():
    potpourri3d = pytest.importorskip("potpourri3d")
    mesh = shapes.random_sphere(3000)
    truth = exact_distance(mesh, 0).distance
    theirs = potpourri3d.MeshFastMarchingDistanceSolver(mesh.points, mesh.faces)
    their_error = np.abs(np.asarray(theirs.compute_distance([[(0, [])]])) - truth).mean()
    assert np.abs(marched_distance(mesh, 0).distance - truth).mean() < 0.3 * their_error
