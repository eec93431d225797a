"""Write the sample meshes: `make samples`, or `python sample_meshes/make.py [FOLDER]`.

Every coordinate is rounded to nine decimals, so that machines whose sines differ in the last bit write the
same bytes. The truths beside the shapes are in README.md and are held by tests/exact/test_sample_meshes.py.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.curve import CurveSet
from ddgcli.mesh.fields import AnnotatedMesh, AnyMesh
from ddgcli.mesh.tet_mesh import TetMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

FOLDER = Path(__file__).parent


def ellipsoid() -> TriangleMesh:
    """Half axes 3, 2, 1."""
    sphere = shapes.icosphere(4)
    return sphere.moved(sphere.points * np.array([3.0, 2.0, 1.0]))


def saddle() -> TriangleMesh:
    """z = (x^2 - y^2) / 2 over [-1, 1]^2."""
    flat = shapes.grid(40, 40, pattern="alternating")
    x, y, _ = (2 * flat.points - 1).T
    return flat.moved(np.stack([x, y, (x**2 - y**2) / 2], axis=1))


def bad_torus() -> TriangleMesh:
    """The torus R = 1, r = 0.4 with a sheared grid: needles, far from Delaunay."""
    u, v, cells = shapes.wrapped_grid(96, 48, wrap_u=True, wrap_v=True)
    u, v = 2 * np.pi * u, 2 * np.pi * (v + 3 * u)
    r = 1 + 0.4 * np.cos(v)
    return TriangleMesh.from_arrays(np.stack([r * np.cos(u), r * np.sin(u), 0.4 * np.sin(v)], axis=1), cells)


def revolved(radius: np.ndarray, height: np.ndarray, around: int) -> TriangleMesh:
    """A profile turned about z, from a pole on the axis (not in the profile) at the first height outward."""
    angle = 2 * np.pi * np.arange(around) / around
    rings = [np.stack([r * np.cos(angle), r * np.sin(angle), np.full(around, z)], axis=1)
             for r, z in zip(radius[1:], height[1:])]  # fmt: skip
    points = np.concatenate([[[0.0, 0.0, height[0]]], *rings])
    i, j = np.arange(around), (np.arange(around) + 1) % around
    faces = [np.stack([np.zeros(around, dtype=np.int64), 1 + i, 1 + j], axis=1)]
    for ring in range(len(rings) - 1):
        a, b = 1 + ring * around, 1 + (ring + 1) * around
        faces += [np.stack([a + i, b + i, b + j], axis=1), np.stack([a + i, b + j, a + j], axis=1)]
    return TriangleMesh.from_arrays(points, np.concatenate(faces))


def cap() -> TriangleMesh:
    """A paraboloid in metres: rim of radius 0.2, rise 0.03."""
    radius = np.linspace(0.0, 0.2, 11)
    return revolved(radius, 0.03 * (1 - (radius / 0.2) ** 2), 24)


def hat() -> TriangleMesh:
    """A hat in metres: crown of radius 0.09 and height 0.12, brim to radius 0.2; an open disk."""
    s = np.linspace(0, 1, 9)[1:]
    top = np.stack([0.075 * s, 0.12 + 0 * s], axis=1)
    bend = np.stack([0.075 + 0.015 * np.sin(np.pi / 2 * s), 0.105 + 0.015 * np.cos(np.pi / 2 * s)], axis=1)
    wall = np.stack([0.09 + 0 * s, 0.105 - 0.09 * s], axis=1)
    foot = np.stack([0.105 - 0.015 * np.cos(np.pi / 2 * s), 0.015 - 0.015 * np.sin(np.pi / 2 * s)], axis=1)
    brim = np.stack([0.105 + 0.095 * s, 0.01 * s**2], axis=1)
    profile = np.concatenate([[[0, 0.12]], top, bend[1::2], wall, foot[1::2], brim])
    return revolved(profile[:, 0], profile[:, 1], 40)


def cube_frame() -> TriangleMesh:
    """The twelve edges of a cube as rounded bars: a closed body of genus 5."""
    n, bar = 14, 4
    rim = (np.arange(n) < bar) | (np.arange(n) >= n - bar)
    x, y, z = np.meshgrid(rim, rim, rim, indexing="ij")
    mesh = voxel_surface(x.astype(int) + y + z >= 2)
    mesh = mesh.moved(mesh.points / n * 2 - 1)
    for _ in range(40):  # Taubin: shrink, then swell a little more
        for weight in (0.5, -0.52):
            mesh = mesh.moved(mesh.points + weight * (neighbour_mean(mesh) - mesh.points))
    return mesh


def voxel_surface(solid: np.ndarray) -> TriangleMesh:
    """Boundary of voxels, outward; voxels must meet in faces."""
    padded = np.pad(solid, 1)
    corners, quads = [], []
    for axis in range(3):
        other = [(axis + 1) % 3, (axis + 2) % 3]
        step = np.diff(padded.astype(np.int8), axis=axis)
        for sign in (1, -1):
            cell = np.argwhere(step == -sign)  # solid below the plane when sign > 0
            base = cell - 1
            base[:, axis] += 1
            u, v = np.eye(3, dtype=np.int64)[other]
            around = [base, base + u, base + u + v, base + v]
            corners += [np.stack(around if sign > 0 else around[::-1], axis=1)]
    loops = np.concatenate(corners)
    points, index = np.unique(loops.reshape(-1, 3), axis=0, return_inverse=True)
    quads = index.reshape(-1, 4)
    return TriangleMesh.from_arrays(points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def neighbour_mean(mesh: TriangleMesh) -> np.ndarray:
    """Mean of the neighbours of each vertex."""
    edges = np.concatenate([mesh.topology.edges, mesh.topology.edges[:, ::-1]])
    count = np.bincount(edges[:, 0], minlength=mesh.n_vertices)
    total = [np.bincount(edges[:, 0], mesh.points[edges[:, 1], k], mesh.n_vertices) for k in range(3)]
    return np.stack(total, axis=1) / count[:, None]


def ball() -> TetMesh:
    """The unit ball: a cube of 8^3 cells, six tetrahedra each, pushed radially."""
    n = 8
    axis = np.arange(n + 1)
    lattice = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    cube = 2.0 * lattice / n - 1
    length = np.linalg.norm(cube, axis=1)
    points = cube * (np.abs(cube).max(axis=1) / np.where(length > 0, length, 1))[:, None]
    cell = np.stack(np.meshgrid(axis[:-1], axis[:-1], axis[:-1], indexing="ij"), axis=-1).reshape(-1, 3)
    weights = np.array([(n + 1) ** 2, n + 1, 1])
    tetrahedra = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        walk = [cell @ weights]
        for direction in order:
            walk.append(walk[-1] + weights[direction])
        tetrahedra.append(np.stack(walk, axis=1))
    mesh = TetMesh.from_arrays(points, np.concatenate(tetrahedra))
    turned = np.where((mesh.signed_volume < 0)[:, None], mesh.tetrahedra[:, [0, 1, 3, 2]], mesh.tetrahedra)
    return TetMesh.from_arrays(points, turned)


def trefoil() -> CurveSet:
    """The trefoil knot (sin t + 2 sin 2t, cos t - 2 cos 2t, -sin 3t), 400 points, closed."""
    t = 2 * np.pi * np.arange(400) / 400
    points = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1)
    return closed_curve(points)


def closed_curve(points: np.ndarray) -> CurveSet:
    """One closed polyline."""
    index = np.arange(len(points))
    return CurveSet(points, np.stack([index, np.roll(index, -1)], axis=1))


def ellipse_rows() -> str:
    """The ellipse with half axes 2 and 1, 200 points, as x,y rows whose last repeats the first."""
    t = 2 * np.pi * np.arange(201) / 200
    rows = rounded(np.stack([2 * np.cos(t), np.sin(t)], axis=1))
    rows[-1] = rows[0]
    return "x,y\n" + "".join(f"{x!r},{y!r}\n" for x, y in rows.tolist())


SAMPLES = {
    "sphere.ply": lambda: shapes.icosphere(4),
    "ellipsoid.ply": ellipsoid,
    "torus.ply": lambda: shapes.torus(96, 48),
    "bad_torus.ply": bad_torus,
    "catenoid.off": lambda: shapes.catenoid(64, 32),
    "saddle.obj": saddle,
    "cylinder.ply": lambda: shapes.cylinder(64, 32),
    "cube.obj": lambda: shapes.box(1, 1, 1),
    "frame.off": cube_frame,
    "hat.ply": hat,
    "cap.ply": cap,
    "ball.vtu": ball,
    "trefoil.obj": trefoil,
}


def rounded(points: np.ndarray) -> np.ndarray:
    """Nine decimals, and no negative zero."""
    return np.round(points, 9) + 0.0


def with_rounded_points(mesh: AnyMesh) -> AnyMesh:
    points = rounded(mesh.points)
    if isinstance(mesh, TriangleMesh):
        return mesh.moved(points)
    if isinstance(mesh, TetMesh):
        return TetMesh.from_arrays(points, mesh.tetrahedra)
    return CurveSet(points, mesh.lines)


def main(folder: Path) -> None:
    """Write all samples."""
    for name, make in SAMPLES.items():
        metadata = {"sample": name, "made_by": "sample_meshes/make.py"}
        write_mesh(str(folder / name), AnnotatedMesh(with_rounded_points(make()), metadata=metadata))
    (folder / "ellipse.csv").write_text(ellipse_rows(), encoding="ascii", newline="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
