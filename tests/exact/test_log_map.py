"""Logarithmic map: directions at the source are those of the paths, on every representation of a mesh."""

import numpy as np
import pytest

from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.oriented_cover import oriented_cover
from ddgcli.algorithms.geodesics.paths import segment_vectors
from ddgcli.algorithms.geodesics.shortest_paths import shortest_paths
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.log_map import log_map
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.errors import MeshError
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.geometry.unfolding import vertex_fans
from ddgcli.mesh import shapes
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh


def rough_torus():
    mesh = shapes.torus(24, 12)
    return mesh.moved(mesh.points + 0.05 * np.random.default_rng(0).normal(size=mesh.points.shape))


@pytest.mark.parametrize("weights", [[0.2, 0.3, 0.5], [0.0, 0.3, 0.7], [0.0, 1.0, 0.0]])
def test_departure_angles_equal_the_first_segments_of_shortest_paths(weights):
    """Straight and bent paths, from a face, a side and a vertex."""
    mesh = rough_torus()
    sources = Sources.at([], SurfacePoints(np.array([101]), np.array([weights])))
    exact = exact_distance(mesh, sources, directions=True)
    assert (exact.origin_vertex >= 0).sum() > 30
    targets = np.flatnonzero(exact.distance > 0)
    paths = shortest_paths(mesh, exact, sources, targets.tolist()).paths
    first = paths.start[:-1]
    step = segment_vectors(mesh, paths)[first] @ [1, 1j]
    unfolding, face = Tracer(mesh).unfolding, paths.face[first]
    if max(weights) == 1:
        fans, corner = vertex_fans(mesh), np.argmax(paths.barycentric[first], axis=1)
        along = unfolding.direction[face, corner] @ [1, 1j]
        total = fans.total_angle[fans.fan[3 * 101 + 1]]
        angle = fans.angle_before[3 * face + corner] + np.angle(step / along)
        off = (angle - exact.departure[targets] + 0.5 * total) % total - 0.5 * total
    else:
        own = np.ones(len(face), dtype=np.complex128)
        if 0.0 in weights:  # side 1, opposite corner 0
            twin = mesh.topology.side_twin[101, 1]
            along_side, along_twin = unfolding.direction.reshape(-1, 2)[[3 * 101 + 1, twin]] @ [1, 1j]
            own[face != 101] = -along_side / along_twin
        off = np.angle(step * own * np.exp(-1j * exact.departure[targets]))
    assert np.abs(off).max() < 1e-9


def test_the_log_map_is_intrinsic():
    mesh, sources = rough_torus(), Sources.at([5])
    original = log_map(mesh, exact_distance(mesh, sources, directions=True), sources)
    intrinsic = IntrinsicMesh(mesh.topology, mesh.side_length)
    calls = []
    again = log_map(
        intrinsic,
        exact_distance(intrinsic, sources),
        sources,
        lambda done, total: calls.append((done, total)),
    )  # without directions: measured again
    assert calls and original.miss < 1e-13 and again.miss < 1e-13
    np.testing.assert_allclose(again.log_map, original.log_map, atol=1e-10)
    turned = np.random.default_rng(0).random(mesh.n_faces) < 0.3
    mixed = mesh.from_arrays(mesh.points, np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces))
    with pytest.raises(MeshError, match="opposite orientation"):
        exact_distance(mixed, sources, directions=True)
    cover = oriented_cover(mixed)
    over = log_map(cover.mesh, cover.lift_exact(exact_distance(mixed, sources)), sources)
    flat, other = original.log_map @ [1, 1j], over.log_map @ [1, 1j]
    np.testing.assert_allclose(other, flat * (other[0] / flat[0]), atol=1e-10)
