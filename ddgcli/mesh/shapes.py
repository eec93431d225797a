"""Meshes of shapes with known geometry."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from ddgcli.errors import ParameterError
from ddgcli.memory import check_memory
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.mesh.vectors import row_cross, row_dot

BYTES_OF_FACE = 260.0  # of arrays while a mesh is made and its topology is computed


def check_cells(least: int = 1, **cells: int) -> None:
    """Refuse fewer cells than a direction needs: 3 where the last cell ends at the first vertices."""
    for name, count in cells.items():
        if count < least:
            raise ParameterError(f"must be {least} or more, not {count}", parameter=name)


def check_sizes(**sizes: float) -> None:
    """Refuse sizes that are not positive and finite."""
    for name, size in sizes.items():
        if not 0 < size < np.inf:
            raise ParameterError(f"must be positive and finite, not {size:g}", parameter=name)


def icosphere(subdivisions: int = 3, radius: float = 1.0) -> TriangleMesh:
    """Geodesic sphere about the origin: the icosahedron, each face split in four, outward.

    Parameters
    ----------
    subdivisions : int
        Number of splits; there are 20 * 4^subdivisions faces.
    radius : float

    Returns
    -------
    TriangleMesh

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ddg.icosphere(2).n_faces
    320
    """
    if subdivisions < 0:
        raise ParameterError(f"must be 0 or more, not {subdivisions}", parameter="subdivisions")
    check_sizes(radius=radius)
    n_faces = 20 * 4.0 ** min(subdivisions, 100)
    check_memory(n_faces * BYTES_OF_FACE, "spheres of so many subdivisions", "use fewer")
    g = (1 + np.sqrt(5)) / 2
    points = np.array(
        [[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g],
         [0, -1, -g], [0, 1, -g], [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]]
    )  # fmt: skip
    faces = np.array(
        [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2],
         [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5],
         [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]]
    )  # fmt: skip
    mesh = TriangleMesh.from_arrays(_on_sphere(points), faces)
    for _ in range(subdivisions):
        mesh = mesh_on_sphere(midpoint_subdivided(mesh))
    return mesh.moved(radius * mesh.points)


def _on_sphere(points: np.ndarray) -> np.ndarray:
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def mesh_on_sphere(mesh: TriangleMesh) -> TriangleMesh:
    """Project the vertices radially to the unit sphere.

    Parameters
    ----------
    mesh : TriangleMesh

    Returns
    -------
    TriangleMesh
    """
    return mesh.moved_unchecked(_on_sphere(mesh.points))


def midpoint_subdivided(mesh: TriangleMesh, times: int = 1) -> TriangleMesh:
    """Split every face in four at the midpoints of its edges.

    Parameters
    ----------
    mesh : TriangleMesh
    times : int

    Returns
    -------
    TriangleMesh
        4^times m faces; input vertices keep their indices.
    """
    for _ in range(times):
        mesh = _split_in_four(mesh)
    return mesh


def _split_in_four(mesh: TriangleMesh) -> TriangleMesh:
    topology = mesh.topology
    middle = topology.side_edge + mesh.n_vertices
    points = np.concatenate([mesh.points, mesh.points[topology.edges].mean(axis=1)])
    (a, b, c), (ab, bc, ca) = topology.faces.T, middle.T
    faces = np.concatenate(
        [np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
    )
    return TriangleMesh.from_arrays(points, faces)


def random_sphere(n: int = 1000, seed: int = 0, radius: float = 1.0) -> TriangleMesh:
    """Irregular sphere: the convex hull of n uniform random points, outward."""
    from scipy.spatial import ConvexHull

    points = _on_sphere(np.random.default_rng(seed).normal(size=(n, 3)))
    faces = ConvexHull(points).simplices.astype(np.int64)
    p = points[faces]
    inward = row_dot(row_cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), p[:, 0]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return TriangleMesh.from_arrays(radius * points, faces)


def wrapped_grid(
    nu: int, nv: int, wrap_u: bool = False, wrap_v: bool = False, pattern: str = "right"
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameters and triangles of a grid of nu x nv cells, open or closed in each direction.

    Parameters
    ----------
    nu, nv : int
    wrap_u, wrap_v : bool
        The last cell ends at the first vertices.
    pattern : {'right', 'left', 'alternating'}
        Which diagonal splits a cell.

    Returns
    -------
    u, v : (n,) ndarray of float64
        Parameters in [0, 1] (without the end where wrapped).
    faces : (m, 3) ndarray of int64
        Counter-clockwise in the (u, v) plane.
    """
    check_memory(2.0 * nu * nv * BYTES_OF_FACE, "meshes of so many cells", "use fewer")
    if min(nu, nv) < 1:
        raise ParameterError(f"a shape has 1 or more cells along each direction, not {min(nu, nv)}")
    mu, mv = nu + (not wrap_u), nv + (not wrap_v)
    i, j = np.meshgrid(np.arange(nu), np.arange(nv), indexing="ij")
    is_left = {"right": np.zeros_like(i), "left": np.ones_like(i), "alternating": (i + j) % 2}
    if pattern not in is_left:
        raise ParameterError(f"{pattern!r} is not one of {', '.join(is_left)}", parameter="pattern")

    def number(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return ((a % mu) * mv + (b % mv)).ravel()

    p00, p10, p11, p01 = number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)
    other = is_left[pattern].ravel() == 1
    first = np.where(other, [p00, p10, p01], [p00, p10, p11]).T
    second = np.where(other, [p10, p11, p01], [p00, p11, p01]).T
    faces = np.stack([first, second], axis=1).reshape(-1, 3)
    u, v = np.meshgrid(np.arange(mu) / nu, np.arange(mv) / nv, indexing="ij")
    return u.ravel(), v.ravel(), faces


def grid(
    nx: int = 10, ny: int = 10, width: float = 1.0, height: float = 1.0, pattern: str = "right"
) -> TriangleMesh:
    """Flat rectangle [0, width] x [0, height] in the plane z = 0, normal +z.

    Parameters
    ----------
    nx, ny : int
        Cells along x and y, two triangles each.
    width, height : float
        In length units.
    pattern : {'right', 'left', 'alternating'}
        Which diagonal splits a cell.

    Returns
    -------
    TriangleMesh

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ddg.grid(4, 3).n_faces
    24
    """
    check_cells(nx=nx, ny=ny)
    check_sizes(width=width, height=height)
    u, v, faces = wrapped_grid(nx, ny, pattern=pattern)
    return TriangleMesh.from_arrays(np.stack([width * u, height * v, 0 * u], axis=1), faces)


def torus(
    nu: int = 48, nv: int = 24, major: float = 1.0, minor: float = 0.4, pattern: str = "right"
) -> TriangleMesh:
    """Torus of revolution about z, outward.

    Parameters
    ----------
    nu, nv : int
        Cells along the major and the minor circle, 3 or more, two triangles each.
    major, minor : float
        Radii of the two circles, in length units.
    pattern : {'right', 'left', 'alternating'}
        Which diagonal splits a cell.

    Returns
    -------
    TriangleMesh

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ddg.torus(16, 8).topology.genus
    1
    """
    check_cells(3, nu=nu, nv=nv)
    check_sizes(major=major, minor=minor)
    u, v, faces = wrapped_grid(nu, nv, wrap_u=True, wrap_v=True, pattern=pattern)
    u, v = 2 * np.pi * u, 2 * np.pi * v
    radius = major + minor * np.cos(v)
    return TriangleMesh.from_arrays(
        np.stack([radius * np.cos(u), radius * np.sin(u), minor * np.sin(v)], axis=1), faces
    )


def cylinder(nu: int = 32, nz: int = 16, radius: float = 1.0, height: float = 2.0) -> TriangleMesh:
    """Open cylinder about z, outward, from z = 0 to `height`.

    Parameters
    ----------
    nu, nz : int
        Cells around (3 or more) and along the axis, two triangles each.
    radius, height : float
        In length units.

    Returns
    -------
    TriangleMesh

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ddg.cylinder(12, 4).topology.boundary_loops
    2
    """
    check_cells(3, nu=nu)
    check_cells(nz=nz)
    check_sizes(radius=radius, height=height)
    u, v, faces = wrapped_grid(nu, nz, wrap_u=True)
    points = np.stack([radius * np.cos(2 * np.pi * u), radius * np.sin(2 * np.pi * u), height * v], axis=1)
    return TriangleMesh.from_arrays(points, faces)


def catenoid(nu: int = 48, nz: int = 32, waist: float = 1.0, half_height: float = 1.0) -> TriangleMesh:
    """Catenoid r = waist cosh(z / waist), |z| <= half_height: a minimal surface with two boundary loops."""
    u, v, faces = wrapped_grid(nu, nz, wrap_u=True)
    z = half_height * (2 * v - 1)
    r = waist * np.cosh(z / waist)
    return TriangleMesh.from_arrays(
        np.stack([r * np.cos(2 * np.pi * u), r * np.sin(2 * np.pi * u), z], axis=1), faces
    )


def box_tetrahedra(
    nx: int = 4, ny: int = 4, nz: int = 4, size: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> TetMesh:
    """Solid box [0, size], each cell of a grid cut into six tetrahedra around its diagonal (Kuhn).

    Parameters
    ----------
    nx, ny, nz : int
        Cells along each axis.
    size : tuple of 3 floats

    Returns
    -------
    TetMesh
        All cells of positive volume.
    """
    counts = np.array([nx, ny, nz])
    axes = np.meshgrid(*(np.arange(c + 1) for c in counts), indexing="ij")
    lattice = np.stack(axes, axis=-1).reshape(-1, 3)
    stride = np.array([(ny + 1) * (nz + 1), nz + 1, 1])
    first = np.flatnonzero((lattice < counts).all(axis=1))
    cells = []
    for order in permutations(range(3)):
        corners = np.cumsum([0, *stride[list(order)]])
        even = (order[1] - order[0]) % 3 == 1
        cells.append(first[:, None] + (corners if even else corners[[0, 2, 1, 3]]))
    tetrahedra = np.stack(cells, axis=1).reshape(-1, 4)
    return TetMesh.from_arrays(lattice / counts * np.array(size), tetrahedra)


def box(
    nx: int = 4, ny: int = 4, nz: int = 4, size: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> TriangleMesh:
    """Closed box with one corner at the origin, outward.

    Parameters
    ----------
    nx, ny, nz : int
        Cells along x, y and z, two triangles each.
    size : (3,) tuple of float
        Length along x, y and z.

    Returns
    -------
    TriangleMesh

    Examples
    --------
    >>> import ddgcli as ddg
    >>> ddg.box(1, 1, 1).n_faces
    12
    """
    check_cells(nx=nx, ny=ny, nz=nz)
    for length in size:
        check_sizes(size=length)
    counts = np.array([nx, ny, nz])
    points, faces, start = [], [], 0
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        u, v, cells = wrapped_grid(counts[a], counts[b])
        for side in (0, 1):
            lattice = np.zeros((len(u), 3), dtype=np.int64)
            lattice[:, a] = np.rint(u * counts[a])
            lattice[:, b] = np.rint(v * counts[b])
            lattice[:, axis] = side * counts[axis]
            points.append(lattice)
            faces.append((cells if side else cells[:, ::-1]) + start)
            start += len(u)
    unique, inverse = np.unique(np.concatenate(points), axis=0, return_inverse=True)
    return TriangleMesh.from_arrays(
        unique / counts * np.array(size), inverse.reshape(-1)[np.concatenate(faces)]
    )
