"""Random degenerate triangle complexes from a seed, of the kinds that broken exporters write."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddgcli.mesh.triangle_mesh import TriangleMesh


def degenerate_mesh(seed: int) -> TriangleMesh:
    """A small complex of one kind, with up to three kinds of damage, at a random scale and place."""
    rng = np.random.default_rng(seed)
    points, faces = KINDS[rng.integers(len(KINDS))](rng)
    for damage in rng.permutation(len(DAMAGES))[: rng.integers(0, 4)]:
        points, faces = DAMAGES[damage](rng, points, faces)
    if rng.random() < 0.3:  # far from the origin
        points = points + 10.0 ** rng.integers(0, 9) * rng.normal(size=3)
    if rng.random() < 0.5:
        points = points * 10.0 ** float(rng.choice([-150, -100, -9, 9, 100, 150]))
    return TriangleMesh.from_arrays(points, faces)


Complex = tuple[NDArray, NDArray]


def _soup(rng: np.random.Generator) -> Complex:
    """Faces between random vertices of few: duplicate faces, fans, edges of many faces."""
    n = int(rng.integers(3, 12))
    faces = rng.integers(0, n, (int(rng.integers(1, 30)), 3))
    if rng.random() < 0.7:
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    faces = faces if len(faces) else np.array([[0, 1, 2]])
    points = rng.normal(size=(n, 3))
    return (points * [1, 1, 0] if rng.random() < 0.3 else points), faces


def _lattice_soup(rng: np.random.Generator) -> Complex:
    """A soup of lattice points: collinear, coincident and zero-area triples."""
    points, faces = _soup(rng)
    return np.round(points), faces


def _grid(rng: np.random.Generator) -> Complex:
    """A grid stretched to needles or caps of aspect 1e2 ... 1e12."""
    from ddgcli.mesh import shapes

    mesh = shapes.grid(int(rng.integers(1, 5)), int(rng.integers(1, 5)))
    shear = np.eye(3)
    shear[0, 1] = rng.integers(0, 3)
    return (mesh.points @ shear) * [1.0, 10.0 ** -rng.integers(0, 13), 1.0], mesh.faces


def _closed(rng: np.random.Generator) -> Complex:
    """A closed surface flattened, or pulled to a needle."""
    from ddgcli.mesh import shapes

    mesh = [shapes.icosphere(1), shapes.torus(4, 3), shapes.icosphere(0)][rng.integers(3)]
    stretch = 10.0 ** -np.where(rng.random(3) < 0.5, rng.integers(0, 13, 3), 0).astype(float)
    return mesh.points * stretch, mesh.faces


def _double_triangle(rng: np.random.Generator) -> Complex:
    """Two faces on three vertices: a doubly covered needle or cap."""
    thin = 10.0 ** -rng.integers(0, 13)
    apex = [[0.0, thin, 0], [0.5, thin, 0], [2.0, thin, 0]][rng.integers(3)]
    return np.array([[0, 0, 0], [1, 0, 0], apex]), np.array([[0, 1, 2], [0, 2, 1]])


def _many_parts(rng: np.random.Generator) -> Complex:
    """Separate tetrahedra of sizes between 1e-8 and 1e8."""
    k = int(rng.integers(2, 12))
    base = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
    size = 10.0 ** rng.integers(-8, 9, k)
    points = rng.normal(size=(k, 4, 3)) * size[:, None, None] + rng.normal(size=(k, 1, 3))
    return points.reshape(-1, 3), (base + 4 * np.arange(k)[:, None, None]).reshape(-1, 3)


def _fan(rng: np.random.Generator) -> Complex:
    """A fan of high valence, closed or open, flat or as a needle cone."""
    k = int(rng.integers(3, 60))
    angle = 2 * np.pi * np.arange(k) / k
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(k)], axis=1)
    tip = np.array([[0, 0, 10.0 ** rng.integers(-12, 7)]])
    faces = np.stack([np.zeros(k, dtype=int), 1 + np.arange(k), 1 + (np.arange(k) + 1) % k], axis=1)
    return np.concatenate([tip, rim]), faces[: k - rng.integers(0, 2)]


def _duplicate_faces(rng: np.random.Generator, points: NDArray, faces: NDArray) -> Complex:
    repeated = faces[rng.integers(0, len(faces), 2)]
    return points, np.concatenate([faces, repeated, repeated[:1, ::-1]])


def _coincident_points(rng: np.random.Generator, points: NDArray, faces: NDArray) -> Complex:
    points = points.copy()
    a, b = rng.integers(0, len(points), 2)
    points[a] = points[b]
    return points, faces


def _t_junction(rng: np.random.Generator, points: NDArray, faces: NDArray) -> Complex:
    """A cap without area along an edge, with the edge's middle as its corner."""
    a, b, _ = faces[rng.integers(len(faces))]
    middle = 0.5 * (points[a] + points[b])
    return np.concatenate([points, [middle]]), np.concatenate([faces, [[b, a, len(points)]]])


def _pinch(rng: np.random.Generator, points: NDArray, faces: NDArray) -> Complex:
    """Two vertices become one: pinched vertices, edges of many faces."""
    a, b = rng.integers(0, len(points), 2)
    return points, np.where(faces == b, a, faces)


def _near_points(rng: np.random.Generator, points: NDArray, faces: NDArray) -> Complex:
    """One vertex almost at another's place."""
    points = points.copy()
    a, b = rng.integers(0, len(points), 2)
    points[a] = points[b] + 10.0 ** -rng.integers(3, 16) * rng.normal(size=3)
    return points, faces


def _spare_points(rng: np.random.Generator, points: NDArray, faces: NDArray) -> Complex:
    return np.concatenate([points, rng.normal(size=(2, 3))]), faces


def _turned_faces(rng: np.random.Generator, points: NDArray, faces: NDArray) -> Complex:
    faces = faces.copy()
    faces[0] = faces[0, ::-1]
    return points, faces


KINDS = (_soup, _lattice_soup, _grid, _closed, _double_triangle, _many_parts, _fan)
DAMAGES = (
    _duplicate_faces, _coincident_points, _t_junction, _pinch, _near_points, _spare_points, _turned_faces,
)  # fmt: skip
