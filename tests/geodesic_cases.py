"""Surfaces with known distances, or with saddles and holes."""

import numpy as np
from scipy.spatial import Delaunay

from ddgcli.mesh import shapes
from ddgcli.mesh.intrinsic_mesh import IntrinsicMesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh


def jittered(mesh: TriangleMesh, amount: float, seed: int = 0) -> TriangleMesh:
    """Inner vertices moved in the plane."""
    inside = ~mesh.topology.boundary_vertex[:, None] * np.array([1, 1, 0])
    shift = np.random.default_rng(seed).uniform(-1, 1, (mesh.n_vertices, 3))
    return mesh.moved(mesh.points + amount * inside * shift)


def cone(angle: float, sectors: int, rings: int) -> tuple[IntrinsicMesh, np.ndarray, np.ndarray]:
    """Flat sectors around an apex (vertex 0) of total angle `angle`; radii and angles of the vertices."""
    radius = np.concatenate([[0.0], np.repeat(np.arange(1.0, rings + 1), sectors)])
    phi = np.concatenate([[0.0], np.tile(np.arange(sectors) * angle / sectors, rings)])
    ring = np.arange(rings - 1)[:, None] * sectors + 1
    k = np.arange(sectors)[None, :]
    a, b = (ring + k).ravel(), (ring + (k + 1) % sectors).ravel()
    c, d = a + sectors, b + sectors
    first = np.stack([np.zeros(sectors, int), 1 + k[0], 1 + (k[0] + 1) % sectors], axis=1)
    faces = np.concatenate([first, np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)])
    mesh = IntrinsicMesh(Topology(faces, len(radius)), np.ones((len(faces), 3)))
    i, j = faces, faces[:, [1, 2, 0]]
    turn = np.abs(phi[i] - phi[j])
    turn = np.where((i == 0) | (j == 0), 0.0, np.minimum(turn, angle - turn))
    length = np.sqrt((radius[i] - radius[j]) ** 2 + 4 * radius[i] * radius[j] * np.sin(turn / 2) ** 2)
    return IntrinsicMesh(mesh.topology, length), radius, phi


def pillow(k: int) -> TriangleMesh:
    """The double cover of the unit square: two grids with a common rim."""
    grid = shapes.grid(k, k, pattern="alternating")
    n = grid.n_vertices
    number = np.arange(n)
    inside = ~grid.topology.boundary_vertex
    back = np.where(inside, n + np.cumsum(inside) - 1, number)
    points = np.concatenate([grid.points, grid.points[inside]])
    return TriangleMesh.from_arrays(points, np.concatenate([grid.faces, back[grid.faces][:, ::-1]]))


def on_pillow(mesh: TriangleMesh, k: int, source: int) -> np.ndarray:
    """Distances on the pillow: the plane modulo (x, y) -> +-(x, y) + (2a, 2b); the back is x < 0."""
    plane = mesh.points[:, :2].copy()
    plane[(k + 1) ** 2 :, 0] *= -1
    images = [s * plane + 2 * np.array([a, b]) for s in (1, -1) for a in (-1, 0, 1) for b in (-1, 0, 1)]
    return np.min([np.linalg.norm(image - plane[source], axis=1) for image in images], axis=0)


def noisy_torus() -> TriangleMesh:
    mesh = shapes.torus(40, 24)
    return mesh.moved(mesh.points + 0.02 * np.random.default_rng(3).normal(size=mesh.points.shape))


def with_holes() -> TriangleMesh:
    mesh = noisy_torus()
    return TriangleMesh.from_arrays(
        mesh.points, np.delete(mesh.faces, np.arange(3, mesh.n_faces, 41), axis=0)
    )


def disk(n: int) -> TriangleMesh:
    """Random points in the unit disk and on its rim, and their Delaunay triangulation."""
    rng = np.random.default_rng(0)
    r, t = np.sqrt(rng.uniform(0, 1, n)), rng.uniform(0, 2 * np.pi, n)
    rim = np.exp(2j * np.pi * np.arange(k := int(2 * np.sqrt(np.pi * n))) / k)
    z = np.concatenate([r * np.exp(1j * t), rim])
    points = np.stack([z.real, z.imag, np.zeros(len(z))], axis=1)
    mesh = TriangleMesh.from_arrays(points, Delaunay(points[:, :2]).simplices)
    turned = np.cross(mesh.side_vector[:, 0], mesh.side_vector[:, 1])[:, 2] < 0
    return TriangleMesh.from_arrays(points, np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces))


def beside_a_sphere(mesh: TriangleMesh, scale: float) -> tuple[TriangleMesh, int, int]:
    """A mesh scaled by a power of two behind a unit sphere; its first vertex and its first face."""
    sphere = shapes.icosphere(3)
    points = np.concatenate([sphere.points, scale * mesh.points])
    faces = np.concatenate([sphere.faces, mesh.faces + sphere.n_vertices])
    return TriangleMesh.from_arrays(points, faces), sphere.n_vertices, sphere.n_faces
