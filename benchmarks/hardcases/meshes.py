"""Meshes of the hard-case catalogue, each a pair (points, faces), pushed by one parameter.

The truths of a mesh (`Truths`) are counted here from the arrays alone, without the package under test.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh

Arrays = tuple[NDArray[np.float64], NDArray[np.int64]]


@dataclass(frozen=True)
class Truths:
    """What is known of a mesh beforehand; None where it is not.

    Parameters
    ----------
    area : float
        Sum of the face areas, in extended precision.
    components : int
        Connected components that vertices of faces form.
    euler_characteristic : int
        V - E + F over the vertices that a face uses.
    betti_numbers : tuple of int, optional
        Absolute Betti numbers of the surface.
    known_distance : tuple of int and float, optional
        A vertex and its geodesic distance from vertex 0, a closed form.
    """

    area: float
    components: int
    euler_characteristic: int
    betti_numbers: tuple[int, ...] | None = None
    known_distance: tuple[int, float] | None = None


def truths_of(
    points: NDArray,
    faces: NDArray,
    betti_numbers: tuple[int, ...] | None = None,
    known_distance: tuple[int, float] | None = None,
) -> Truths:
    """Truths of a mesh by direct counting, and the closed forms of the generator."""
    corners = points.astype(np.longdouble)[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = float(np.sqrt((normal**2).sum(1)).sum() / 2)
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges = np.unique(sides, axis=0)
    vertices = np.unique(faces)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(len(points),) * 2)
    labels = connected_components(graph, directed=False)[1]
    components = len(np.unique(labels[vertices]))
    return Truths(area, components, len(vertices) - len(edges) + len(faces), betti_numbers, known_distance)


def arrays_of(mesh: TriangleMesh) -> Arrays:
    """Points and faces of a mesh of the package."""
    return np.array(mesh.points), np.array(mesh.faces)


def sphere(level: int = 2) -> Arrays:
    """Geodesic unit sphere."""
    return arrays_of(shapes.icosphere(level))


def strip(height: float, cells: int = 20) -> Arrays:
    """Flat strip of length 1 with one row of triangles: needles of aspect 1 / (cells height)."""
    x = np.linspace(0.0, 1.0, cells + 1)
    points = np.concatenate([np.stack([x, 0 * x, 0 * x], 1), np.stack([x, 0 * x + height, 0 * x], 1)])
    low = np.arange(cells)
    high = low + cells + 1
    faces = np.concatenate([np.stack([low, low + 1, high + 1], 1), np.stack([low, high + 1, high], 1)])
    return points, faces


def needles(aspect: float) -> Arrays:
    """Flat strip of 40 triangles whose long sides are `aspect` times the short ones."""
    return strip(1.0 / (20 * aspect))


def cylinder(needles_around: float) -> Arrays:
    """Open cylinder of radius and height 1 with one row of needles around it."""
    n = int(needles_around) // 2
    angle = 2 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    low = np.arange(n)
    after = (low + 1) % n
    faces = np.concatenate([np.stack([low, after, after + n], 1), np.stack([low, after + n, low + n], 1)])
    return np.concatenate([ring, ring + [0.0, 0.0, 1.0]]), faces


def voxel_gyroid(cells: float) -> Arrays:
    """Boundary of the voxels of a ball of gyroid, `cells` voxels across: stairs and pinched edges."""
    n = int(cells)
    x, y, z = 2.0 * np.stack(np.meshgrid(*[np.linspace(-1, 1, n)] * 3, indexing="ij"))
    wave = [np.sin(2 * np.pi * a / 2) * np.cos(2 * np.pi * b / 2) for a, b in ((x, y), (y, z), (z, x))]
    solid = np.pad((wave[0] + wave[1] + wave[2] > 0) & (x**2 + y**2 + z**2 < 4), 1)
    return voxel_surface(solid)


def voxel_surface(solid: NDArray[np.bool_]) -> Arrays:
    """Boundary of the unit voxels of an (i, j, k) mask with an empty border, normals outwards."""
    quads = []
    for axis in range(3):
        step = np.roll(np.eye(3, dtype=np.int64), -axis, axis=0)  # rows: the axis, then the two across
        edge = np.diff(solid.astype(np.int8), axis=axis)
        for sign in (1, -1):
            place = np.argwhere(edge == sign) + step[0]
            around = [0 * step[1], step[1], step[1] + step[2], step[2]][:: -1 if sign == 1 else 1]
            quads.append(np.stack([place + offset for offset in around], axis=1))
    corners = np.concatenate(quads)
    places, ids = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    ids = ids.reshape(-1, 4)
    return places.astype(float), np.concatenate([ids[:, [0, 1, 2]], ids[:, [0, 2, 3]]])


def caps(aspect: float) -> Arrays:
    """Unit sphere with every face split at a point that lies 1/aspect above the middle of its first side."""
    points, faces = sphere(1)
    a, b, c = (points[faces[:, k]] for k in range(3))
    middle = (a + b) / 2 + (c - (a + b) / 2) / aspect
    new = len(points) + np.arange(len(faces))
    split = [np.stack([faces[:, k], faces[:, (k + 1) % 3], new], 1) for k in range(3)]
    return np.concatenate([points, middle]), np.concatenate(split)


def fan(valence: float) -> Arrays:
    """Flat disk: one vertex of this valence in a regular polygon."""
    n = int(valence)
    angle = 2 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    at = 1 + np.arange(n)
    return np.concatenate([np.zeros((1, 3)), ring]), np.stack([0 * at, at, 1 + at % n], 1)


def scaled_sphere(exponent: float) -> Arrays:
    """Unit sphere times 10^exponent."""
    points, faces = sphere(2)
    return points * 10.0**exponent, faces


def far_sphere(offset: float) -> Arrays:
    """Unit sphere moved `offset` diameters away from the origin."""
    points, faces = sphere(2)
    return points + 2 * offset * np.array([1.0, 0.7, -0.3]), faces


def hinge(angle: float) -> Arrays:
    """Square folded along its diagonal; `angle` pi is folded upon itself, 0 flat."""
    s = np.sqrt(0.5)
    flap = s * np.array([-np.cos(angle), 0.0, np.sin(angle)])
    points = np.array([[0.0, -s, 0.0], [0.0, s, 0.0], [s, 0.0, 0.0], flap])
    return points, np.array([[0, 2, 1], [0, 1, 3]])


def noisy_sphere(share: float) -> Arrays:
    """Unit sphere, every vertex moved in space by a normal deviate of `share` mean edges."""
    points, faces = sphere(3)
    edge = np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1).mean()
    return points + share * edge * np.random.default_rng(0).normal(size=points.shape), faces


def repeated(arrays: Arrays, count: int, spacing: float = 3.0) -> Arrays:
    """The part `count` times on a line, nowhere joined."""
    points, faces = arrays
    shift = spacing * np.arange(count)[:, None, None] * np.array([1.0, 0.0, 0.0])
    return (points + shift).reshape(-1, 3), (faces + len(points) * np.arange(count)[:, None, None]).reshape(
        -1, 3
    )


def tetrahedra(count: float) -> Arrays:
    """Surfaces of regular tetrahedra, nowhere joined."""
    points = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return repeated((points, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])), int(count))


def triangles(count: float) -> Arrays:
    """Equilateral triangles, nowhere joined."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0]])
    return repeated((points, np.array([[0, 1, 2]])), int(count))


def soup(faces: float) -> Arrays:
    """Random triangles that share no vertex, in the unit cube."""
    n = int(faces)
    points = np.random.default_rng(1).uniform(size=(3 * n, 3))
    return points, np.arange(3 * n).reshape(-1, 3)


def voxel_soup(vertices: float) -> Arrays:
    """Random faces between a few random vertices: almost every edge carries many faces."""
    n, rng = int(vertices), np.random.default_rng(2)
    faces = np.stack([rng.choice(n, 3, replace=False) for _ in range(3 * n)])
    return rng.uniform(size=(n, 3)), faces


def handles(genus: float) -> Arrays:
    """Surface of a slab of square tiles with `genus` square holes in a row: closed, of this genus."""
    tiles = [(i, j) for i in range(2 * int(genus) + 1) for j in range(3) if not (i % 2 and j == 1)]
    present = set(tiles)
    quads = []
    for i, j in tiles:
        quads += [[(i, j, 1), (i + 1, j, 1), (i + 1, j + 1, 1), (i, j + 1, 1)]]
        quads += [[(i, j, 0), (i, j + 1, 0), (i + 1, j + 1, 0), (i + 1, j, 0)]]
        walls = {
            (1, 0): [(i + 1, j), (i + 1, j + 1)],
            (-1, 0): [(i, j + 1), (i, j)],
            (0, 1): [(i + 1, j + 1), (i, j + 1)],
            (0, -1): [(i, j), (i + 1, j)],
        }
        for (di, dj), (a, b) in walls.items():
            if (i + di, j + dj) not in present:
                quads.append([(*a, 0), (*b, 0), (*b, 1), (*a, 1)])
    places = sorted({corner for quad in quads for corner in quad})
    number = {place: k for k, place in enumerate(places)}
    ids = np.array([[number[corner] for corner in quad] for quad in quads])
    return np.array(places, dtype=float), np.concatenate([ids[:, [0, 1, 2]], ids[:, [0, 2, 3]]])


def pinched(pieces: float) -> Arrays:
    """Squares in a chain that touch at single vertices: pinched boundary vertices."""
    n = int(pieces)
    start = 3 * np.arange(n)
    x = np.arange(n, dtype=float)
    block = np.stack([[x, 0 * x, 0 * x], [x + 0.5, 0 * x - 0.5, 0 * x], [x + 0.5, 0 * x + 0.5, 0 * x]])
    points = np.concatenate([block.transpose(2, 0, 1).reshape(-1, 3), [[n, 0, 0]]])
    faces = [np.stack([start, start + 1, start + 3], 1), np.stack([start, start + 3, start + 2], 1)]
    return points, np.concatenate(faces)


def one_triangle() -> Arrays:
    """Right triangle of sides 1, 1, sqrt 2."""
    return np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])


def turned_triangle() -> Arrays:
    """The right triangle from its vertex of 45 degrees, at sqrt 2 from the other (potpourri3d issue 5)."""
    points, faces = one_triangle()
    return points[[1, 0, 2]], faces[:, ::-1].copy()


def kite() -> Arrays:
    """Two triangles on which heat methods of others are off by half (potpourri3d issue 30)."""
    return np.array([[2.0, 0, 0], [1, -3, 0], [0, 0, 0], [1, 3, 0]]), np.array([[2, 1, 0], [2, 0, 3]])


def square(cells: int = 20, pattern: str = "right") -> Arrays:
    """Unit square of right triangles."""
    return arrays_of(shapes.grid(cells, cells, pattern=pattern))
