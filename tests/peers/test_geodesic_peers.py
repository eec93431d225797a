"""Distances against peers on the same meshes."""

import numpy as np
import pytest

from benchmarks.common.submesh import submesh
from ddgcli.algorithms.geodesics.edge_sets import edge_set
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.fast_marching import fast_marching_distance
from ddgcli.algorithms.geodesics.heat import HeatSolver
from ddgcli.algorithms.geodesics.shortest_paths import shortest_paths
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.signed_distance import signed_distance
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.operators.laplacian import stiffness

SMALL = ["spot.obj", "goathead.obj", "hemisphere.off", "lego.ply", "wingnut.obj", "spot_control_mesh.obj"]
LARGE_MESHES = [
    "blub_triangulated.obj", "boot.obj", "demosthenes-low-res.obj", "fairing-cross.off", "hand_lowres.obj",
    "koala.obj", "menger_sponge3.off", "nefertiti-lowres.obj", "penguin_control_mesh.obj", "pizza.obj",
    "plane_holes.obj", "self_intersectA.obj", "plate_holes.STL", "1002_tray_bottom.STL", "box.STL",
    "cloth_ball92.ply", "counter.unitsmm.STL", "featuretype.STL",
    "P1.msh", "beam-tet.vtk", "cubes_v41.msh", "mat40x40.msh", "tet_sphere.mesh",
]  # fmt: skip
LEFT_OUT = {
    "cycloidal.ply": "not manifold",
    "panda_link6.obj": "not manifold",
    "koala_loop1.ply": "more than 100,000 faces",
    "st_helens_terrain.ply": "more than 100,000 faces",
}


def surface(path):
    """The surface of a file; of tetrahedra their boundary, without the vertices inside."""
    mesh = read_mesh(str(path)).mesh
    if not isinstance(mesh, TetMesh):
        return mesh
    return submesh(mesh.boundary, mesh.boundary.faces)


def test_every_shared_mesh_is_compared_or_excluded(shared_meshes):
    files = {path.name for path in shared_meshes.iterdir() if path.is_file()}
    assert files - {"INDEX.md", "mesh_stats.py"} == {*SMALL, *LARGE_MESHES, *LEFT_OUT}


@pytest.mark.slow
@pytest.mark.parametrize("name, reason", LEFT_OUT.items())
def test_excluded_meshes_have_a_reason(shared_meshes, name, reason):
    mesh = surface(shared_meshes / name)
    assert reason == ("more than 100,000 faces" if mesh.topology.is_manifold else "not manifold")
    assert not mesh.topology.is_manifold or mesh.n_faces > 100_000


def peer_distance(mesh, source):
    pygeodesic = pytest.importorskip("pygeodesic.geodesic")
    solver = pygeodesic.PyGeodesicAlgorithmExact(mesh.points, mesh.faces)
    return solver.geodesicDistances(np.array([source]))[0]


def compared(mesh, source):
    ours = exact_distance(mesh, source)
    theirs = peer_distance(mesh, source)
    reached = np.isfinite(ours.distance)
    assert np.array_equal(reached, np.isfinite(theirs))
    difference = np.where(reached, ours.distance - np.where(reached, theirs, 0.0), 0.0)
    return ours, difference / ours.distance[reached].max()


@pytest.mark.parametrize("name", SMALL)
def test_exact_distance_equals_pygeodesic(shared_meshes, name):
    mesh = read_mesh(str(shared_meshes / name)).mesh
    for source in (0, mesh.n_vertices // 2):
        _, difference = compared(mesh, source)
        assert np.abs(difference).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", LARGE_MESHES)
def test_exact_distance_is_at_most_that_of_pygeodesic(shared_meshes, name):
    """Never longer; if the peer is longer by more than rounding, a real path is a counterexample."""
    mesh = surface(shared_meshes / name)
    assert mesh.topology.is_manifold and mesh.n_faces <= 100_000
    ours, difference = compared(mesh, 0)
    assert difference.max() < 1e-12
    if difference.min() < -1e-12:
        proved_by_paths(mesh, ours, difference)
    else:
        assert np.abs(difference).max() < 1e-9


def proved_by_paths(mesh, ours, difference):
    """Paths to the vertices with the largest differences have exactly our length."""
    target = [int(v) for v in np.argsort(difference)[:5]]
    curves = shortest_paths(mesh, ours, Sources.at([0]), target)
    scale = ours.distance[np.isfinite(ours.distance)].max()
    for v, entry in zip(target, curves.entries, strict=True):
        gain = -difference[v] * scale
        assert entry["length"] - ours.distance[v] < 0.01 * gain


def test_on_the_menger_sponge_pygeodesic_is_longer_than_a_path(shared_meshes):
    mesh = read_mesh(str(shared_meshes / "menger_sponge3.off")).mesh
    ours, difference = compared(mesh, 0)
    assert difference.max() < 1e-12
    assert difference.min() < -1e-10
    proved_by_paths(mesh, ours, difference)


def test_heat_with_the_same_operator_equals_potpourri3d():
    """The same two systems, but that the peer adds 1e-6 to the diagonal of the second, at any scale.

    Its solution has mean zero (the load has) before it is shifted to zero at the source.
    """
    potpourri3d = pytest.importorskip("potpourri3d")
    mesh = shapes.random_sphere(2000)
    mesh = mesh.moved(mesh.points * [1.0, 1.2, 0.8])
    theirs = potpourri3d.MeshHeatMethodDistanceSolver(mesh.points, mesh.faces, use_robust=False)
    theirs = theirs.compute_distance(0)
    theirs = theirs - theirs.mean()
    ours = HeatSolver(mesh).distance(0).distance
    matrix = stiffness(mesh)
    apart = matrix[:, [0]].toarray()[:, 0] == 0  # the source's own value is set to zero by us
    load = (matrix @ ours)[apart]
    gap = np.abs((matrix @ theirs + 1e-6 * theirs)[apart] - load).max() / np.abs(load).max()
    assert gap < 1e-11
    assert np.abs((matrix @ theirs)[apart] - load).max() > 1e-6 * np.abs(load).max()  # the shift is seen


def test_fast_marching_is_more_accurate_than_potpourri3d():
    potpourri3d = pytest.importorskip("potpourri3d")
    mesh = shapes.random_sphere(3000)
    truth = exact_distance(mesh, 0).distance
    theirs = potpourri3d.MeshFastMarchingDistanceSolver(mesh.points, mesh.faces)
    their_error = np.abs(np.asarray(theirs.compute_distance([[(0, [])]])) - truth).mean()
    assert np.abs(fast_marching_distance(mesh, 0).distance - truth).mean() < 0.3 * their_error


def _circle(mesh):
    """Edges nearest to z = 0.1 with the upper side on their left, as a closed list of vertices."""
    edges = edge_set(mesh, (mesh.points[mesh.faces].mean(axis=1)[:, 2] > 0.1).astype(int))
    ends = mesh.topology.edges[edges.edge]
    after = dict(np.where(edges.sign[:, None] > 0, ends, ends[:, ::-1]).tolist())
    loop = [next(iter(after))]
    while len(loop) <= len(after):
        loop.append(after[loop[-1]])
    return edges, loop


@pytest.mark.parametrize("share", [1.0, 0.7])
def test_signed_heat_errs_no_more_than_half_above_the_peer(share):
    peer = pytest.importorskip("potpourri3d")
    ratios = []
    for level in (3, 4):
        mesh = shapes.icosphere(level)
        edges, loop = _circle(mesh)
        exact = signed_distance(mesh, edges, "exact").distance
        loop_vertices = loop[: int(len(loop) * share)] if share < 1 else loop
        pairs = np.stack([loop_vertices[:-1], loop_vertices[1:]], axis=1)
        ours = signed_distance(mesh, edge_set(mesh, pairs), "heat").distance
        solver = peer.MeshSignedHeatSolver(mesh.points, mesh.faces)
        theirs = -solver.compute_distance([[(int(v), []) for v in loop_vertices]])  # positive on the left
        errors = [float(np.abs(d - exact).mean()) for d in (ours, theirs)]
        assert max(errors) < 0.1
        ratios.append(errors[0] / errors[1])
    assert max(ratios) < 1.5
