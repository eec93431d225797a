"""Surfaces with known curvature from segmented volumes, scanners and exporters, and clean ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from benchmarks.common.level_sets import Body, principal_curvatures, projected, samples, surface_nets
from benchmarks.common.mesh_sequences import marching_cubes, voxel_boundary
from benchmarks.common.submesh import submesh
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh

MAX_DISTANCE = 4.0  # of a vertex from the surface, in voxels: farther ones lie on a box that cuts the body
TURN = np.linalg.qr(np.array([[0.6, 0.3, -0.5], [0.2, 0.9, 0.4], [0.7, -0.2, 0.6]]))[0]
TURN = TURN * np.sign(np.linalg.det(TURN))


@dataclass(frozen=True, eq=False)
class KnownSurface:
    """A mesh and the principal curvatures (n, 2) of the surface that it samples where they count (n,)."""

    mesh: TriangleMesh
    curvature: NDArray
    counted: NDArray


def _ellipsoid(a: float, b: float, c: float) -> Body:
    size = (a * b * c) ** (1 / 3)
    return Body(
        lambda x, y, z: size * (np.sqrt((x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2 + 1e-30) - 1), (a, b, c)
    )


def _wave(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    return z - 3 * np.sin(x / 8) * np.cos(y / 9)


def _saddle(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    return z - (x * x - y * y) / 60


def _capsule(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    return np.sqrt(x * x + y * y + (z - np.clip(z, -12, 12)) ** 2) - 8


def _rounded_box(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    beyond = [np.maximum(np.abs(c) - half, 0) for c, half in zip((x, y, z), (9, 7, 5))]
    return np.sqrt(sum(c * c for c in beyond)) - 6


def _within(*reach: float) -> Callable[[NDArray, NDArray, NDArray], NDArray]:
    """Whether points lie so far inside a box."""
    return lambda *p: np.all([np.abs(c) < r for c, r in zip(p, reach)], axis=0)


BODIES = {
    "sphere": Body(lambda x, y, z: np.sqrt(x * x + y * y + z * z) - 12, (12, 12, 12)),
    "large sphere": Body(lambda x, y, z: np.sqrt(x * x + y * y + z * z) - 20, (20, 20, 20)),
    "cylinder": Body(lambda x, y, z: np.hypot(x, y) - 8, (8, 8, 20), _within(99, 99, 11)),
    "torus": Body(lambda x, y, z: np.hypot(np.hypot(x, y) - 16, z) - 7, (23, 23, 7)),
    "ellipsoid": _ellipsoid(20, 13, 9),
    "egg": Body(
        lambda x, y, z: np.sqrt((x / 1.4) ** 2 + (y * y + z * z) * (1 + 0.02 * x)) - 11, (16, 15, 15)
    ),
    "gyroid": Body(
        lambda x, y, z: (
            np.sin(x / 5) * np.cos(y / 5) + np.sin(y / 5) * np.cos(z / 5) + np.sin(z / 5) * np.cos(x / 5)
        ),
        (20, 20, 20),
        _within(13, 13, 13),
    ),
    "catenoid": Body(lambda x, y, z: np.hypot(x, y) - 9 * np.cosh(z / 9), (15, 15, 9), _within(99, 99, 5)),
    "saddle": Body(_saddle, (22, 22, 12), _within(15, 15, 99)),
    "capsule": Body(_capsule, (8, 8, 20)),
    "rounded box": Body(_rounded_box, (15, 13, 11)),
    "wave": Body(_wave, (30, 30, 7), _within(23, 23, 99)),
}  # fmt: skip


def known(body: Body, mesh: TriangleMesh) -> KnownSurface:
    """The mesh with the curvature of the body at the nearest points, near the boundary left out."""
    at = projected(body, mesh.points)
    counted = np.linalg.norm(at - mesh.points, axis=1) < MAX_DISTANCE
    if body.counted is not None:
        counted &= body.counted(*at.T)
    return KnownSurface(mesh, principal_curvatures(body, at), counted)


def voxels(
    name: str,
    surface_of: Callable[[NDArray], TriangleMesh],
    spacing: tuple[float, float, float] = (1.0, 1.0, 1.0),
    turn: NDArray | None = None,
    change: Callable[[TriangleMesh], TriangleMesh] = lambda mesh: mesh,
) -> KnownSurface:
    """Surface of a segmented volume of one of BODIES, by `surface_of` from its values on a grid."""
    body = BODIES[name]
    values, place = samples(body, spacing, turn)
    mesh = surface_of(values)
    return known(body, change(mesh.moved(place(mesh.points))))


def cubes(values: NDArray) -> TriangleMesh:
    """Boundary of the voxels inside."""
    return voxel_boundary(values < 0)


def binary(values: NDArray) -> TriangleMesh:
    """Marching cubes of the segmented image."""
    return marching_cubes(values < 0)


def nets(values: NDArray) -> TriangleMesh:
    """Surface nets of the segmented image."""
    return surface_nets(values < 0)


def grey(values: NDArray) -> TriangleMesh:
    """Marching cubes of the function itself: with slivers, on the surface up to interpolation."""
    return marching_cubes(0.5 - values)


def grey_of_bits(bits: int, values: NDArray) -> TriangleMesh:
    """Marching cubes of the share of each voxel inside, in whole steps of grey."""
    steps = 2**bits - 1
    return marching_cubes(np.rint(np.clip(0.5 - values, 0, 1) * steps) / steps)


def smoothed(times: int, mesh: TriangleMesh) -> TriangleMesh:
    """Means of neighbours, as programs smooth segmentations."""
    return _relaxed(mesh, (0.5,) * times)


def taubin(times: int, mesh: TriangleMesh) -> TriangleMesh:
    """Means of neighbours and steps back, which keep the volume, as programs smooth segmentations."""
    return _relaxed(mesh, (0.5, -0.53) * times)


def _relaxed(mesh: TriangleMesh, steps: tuple[float, ...]) -> TriangleMesh:
    """Steps towards the means of neighbours, as shares of the way."""
    edges, n = mesh.topology.edges, mesh.n_vertices
    near = csr_array((np.ones(2 * len(edges)), (edges.T.ravel(), edges.T[::-1].ravel())), shape=(n, n))
    mean = diags_array(1 / np.maximum(near.sum(axis=1), 1)) @ near
    points = mesh.points
    for share in steps:
        points = points + share * (mean @ points - points)
    return mesh.moved(points)


def decimated(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Collapse of edges by quadrics to a share of the faces (pymeshlab)."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(mesh.points, mesh.faces))
    meshes.meshing_decimation_quadric_edge_collapse(
        targetfacenum=int(share * mesh.n_faces), preservenormal=True, planarquadric=True
    )
    small = meshes.current_mesh()
    return TriangleMesh.from_arrays(small.vertex_matrix(), small.face_matrix())


def mean_error(surface: KnownSurface, mean: NDArray) -> float:
    """Mean error of the mean curvature (n,), over its mean size."""
    truth, counted = surface.curvature.mean(axis=1), surface.counted
    return float(np.abs(mean - truth)[counted].mean() / np.abs(truth[counted]).mean())


def _edge(mesh: TriangleMesh) -> float:
    return float(mesh.side_length.mean())


def vertex_normals(mesh: TriangleMesh) -> NDArray:
    """(n, 3) unit normals, averaged by areas."""
    corner = mesh.points[mesh.faces]
    doubled = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    total = np.zeros_like(mesh.points)
    np.add.at(total, mesh.faces.ravel(), np.repeat(doubled, 3, axis=0))
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)


def normal_noise(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Independent normal displacements along the normals."""
    heights = np.random.default_rng(1).standard_normal((mesh.n_vertices, 1))
    return mesh.moved(mesh.points + share * _edge(mesh) * heights * vertex_normals(mesh))


def half_noise(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Normal displacements along the normals on one half of the surface."""
    heights = np.random.default_rng(8).standard_normal((mesh.n_vertices, 1))
    half = mesh.points[:, :1] > np.median(mesh.points[:, 0])
    return mesh.moved(mesh.points + share * _edge(mesh) * half * heights * vertex_normals(mesh))


def layers(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """The third coordinate alone in whole multiples of a share of an edge, as in layers of a printer."""
    step = share * _edge(mesh)
    third = step * np.rint(mesh.points[:, 2] / step)
    return mesh.moved(np.column_stack([mesh.points[:, :2], third]))


def isotropic_noise(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Independent normal displacements of all coordinates."""
    return mesh.moved(
        mesh.points + share * _edge(mesh) * np.random.default_rng(2).standard_normal(mesh.points.shape)
    )


def correlated_noise(share: float, times: int, mesh: TriangleMesh) -> TriangleMesh:
    """Displacements along the normals, averaged over neighbours so many times and scaled up again."""
    heights = np.random.default_rng(3).standard_normal((mesh.n_vertices, 3))
    heights = smoothed(times, mesh.moved(heights)).points[:, :1]
    return mesh.moved(mesh.points + share * _edge(mesh) * heights / heights.std() * vertex_normals(mesh))


def line_noise(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Each scan line, a band of the width of half an edge in y, at a height of its own."""
    edge = _edge(mesh)
    line = np.rint(mesh.points[:, 1] / (0.5 * edge)).astype(int)
    heights = np.random.default_rng(4).standard_normal(np.ptp(line) + 1)[line - line.min()]
    return mesh.moved(mesh.points + share * edge * heights[:, None] * vertex_normals(mesh))


def rounded(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Coordinates in whole multiples of a share of an edge."""
    step = share * _edge(mesh)
    return mesh.moved(step * np.rint(mesh.points / step))


def far_in_single_precision(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Single precision so far from the origin that its spacing is a share of an edge."""
    offset = 2.0 ** np.rint(np.log2(share * _edge(mesh) * 2**23))
    return mesh.moved((mesh.points + 1.5 * offset).astype(np.float32).astype(np.float64) - 1.5 * offset)


def spikes(share: float, height: float, mesh: TriangleMesh) -> TriangleMesh:
    """A share of the vertices, moved along the normal by a height in edges, outward or inward."""
    rng = np.random.default_rng(5)
    moved = rng.random(mesh.n_vertices) < share
    size = height * _edge(mesh) * rng.choice([-1.0, 1.0], mesh.n_vertices)
    return mesh.moved(mesh.points + (moved * size)[:, None] * vertex_normals(mesh))


def holes(share: float, mesh: TriangleMesh) -> TriangleMesh:
    """Without a share of the faces."""
    return submesh(mesh, mesh.faces[np.random.default_rng(6).random(mesh.n_faces) >= share])


def _irregular(name: str, n: int = 2500) -> TriangleMesh:
    axes = {
        "sphere": (12, 12, 12),
        "large sphere": (20, 20, 20),
        "ellipsoid": (20, 13, 9),
        "egg": (15, 11, 11),
    }
    mesh = shapes.random_sphere(n, 3)
    return mesh.moved(projected(BODIES[name], mesh.points * np.array(axes[name])))


def _torus(slivers: bool = False) -> TriangleMesh:
    return shapes.torus(*((30, 110) if slivers else (90, 40)), 16, 7)


def _graph(name: str, step: float = 0.9, jitter: float = 0.5, aspect: float = 1.0) -> TriangleMesh:
    """Height field over a jittered grid; `aspect` stretches the cells along y."""
    level, reach = BODIES[name].level, BODIES[name].reach
    nx, ny = int(2 * reach[0] / step), int(2 * reach[1] / step / aspect)
    u, v, faces = shapes.wrapped_grid(nx, ny, wrap_u=False, wrap_v=False)
    rng = np.random.default_rng(7)
    x, y = ((2 * c - 1) * r for c, r in zip((u, v), reach))
    x, y = (
        x + jitter * step * rng.uniform(-0.5, 0.5, len(x)),
        y + jitter * step * aspect * rng.uniform(-0.5, 0.5, len(x)),
    )
    return TriangleMesh.from_arrays(np.stack([x, y, -level(x, y, np.zeros(len(x)))], axis=1), faces)


def _base(name: str) -> TriangleMesh:
    if name in ("wave", "saddle"):
        return _graph(name)
    return _torus() if name == "torus" else _irregular(name)


def _changed(
    name: str, *changes: Callable[[TriangleMesh], TriangleMesh], base: TriangleMesh | None = None
) -> KnownSurface:
    mesh = _base(name) if base is None else base
    for change in changes:
        mesh = change(mesh)
    return known(BODIES[name], mesh)


def voxel_cases() -> Iterator[tuple[str, Callable[[], KnownSurface]]]:
    """Surfaces of segmented volumes."""
    for name in ("sphere", "cylinder", "torus", "ellipsoid", "egg"):
        yield f"cubes: {name}", partial(voxels, name, cubes)
    for name in ("large sphere", "torus", "ellipsoid", "gyroid", "catenoid", "wave"):
        yield f"marching cubes: {name}", partial(voxels, name, binary)
    for name in ("sphere", "torus", "egg", "saddle"):
        yield f"surface nets: {name}", partial(voxels, name, nets)
    flat = (1.0, 1.0, 2.5)
    yield "cubes 1:1:2.5: large sphere", partial(voxels, "large sphere", cubes, flat)
    yield "marching cubes 1:1:2.5: ellipsoid", partial(voxels, "ellipsoid", binary, flat)
    yield "surface nets 1:1:2.5: torus", partial(voxels, "torus", nets, flat)
    yield "marching cubes 1:1:5: large sphere", partial(voxels, "large sphere", binary, (1.0, 1.0, 5.0))
    yield "cubes turned: ellipsoid", partial(voxels, "ellipsoid", cubes, turn=TURN)
    yield "surface nets turned: ellipsoid", partial(voxels, "ellipsoid", nets, turn=TURN)
    for times in (1, 3, 10, 30):
        yield (
            f"cubes smoothed {times}: ellipsoid",
            partial(voxels, "ellipsoid", cubes, change=partial(smoothed, times)),
        )
    for times in (1, 5):
        yield (
            f"marching cubes smoothed {times}: torus",
            partial(voxels, "torus", binary, change=partial(smoothed, times)),
        )
    yield (
        "marching cubes smoothed 30: large sphere",
        partial(voxels, "large sphere", binary, change=partial(smoothed, 30)),
    )
    yield (
        "marching cubes by Taubin: large sphere",
        partial(voxels, "large sphere", binary, change=partial(taubin, 10)),
    )
    yield (
        "cubes merged to half: large sphere",
        partial(voxels, "large sphere", cubes, change=partial(decimated, 0.5)),
    )
    yield (
        "cubes merged to a fifth: large sphere",
        partial(voxels, "large sphere", cubes, change=partial(decimated, 0.2)),
    )
    yield (
        "marching cubes merged to half: torus",
        partial(voxels, "torus", binary, change=partial(decimated, 0.5)),
    )
    yield "grey of 2 bits: ellipsoid", partial(voxels, "ellipsoid", partial(grey_of_bits, 2))
    yield "grey of 4 bits: ellipsoid", partial(voxels, "ellipsoid", partial(grey_of_bits, 4))


def noise_cases() -> Iterator[tuple[str, Callable[[], KnownSurface]]]:
    """Surfaces with noise, rounded coordinates and spikes."""
    for share in (0.01, 0.02, 0.05, 0.1, 0.2, 0.4):
        yield (
            f"normal noise {share:g}: ellipsoid",
            partial(_changed, "ellipsoid", partial(normal_noise, share)),
        )
        yield f"isotropic noise {share:g}: torus", partial(_changed, "torus", partial(isotropic_noise, share))
    for share in (0.05, 0.2):
        yield f"normal noise {share:g}: saddle", partial(_changed, "saddle", partial(normal_noise, share))
        yield f"normal noise {share:g}: wave", partial(_changed, "wave", partial(normal_noise, share))
        yield f"isotropic noise {share:g}: egg", partial(_changed, "egg", partial(isotropic_noise, share))
        yield (
            f"isotropic noise {share:g}, holes 2 %: sphere",
            partial(_changed, "sphere", partial(isotropic_noise, share), partial(holes, 0.02)),
        )
        yield (
            f"isotropic noise {share:g}, decimated: sphere",
            partial(_changed, "sphere", partial(isotropic_noise, share), partial(decimated, 0.4)),
        )
        yield (
            f"normal noise {share:g}, slivers: torus",
            partial(_changed, "torus", partial(normal_noise, share), base=_torus(slivers=True)),
        )
        for name in ("torus", "saddle"):
            yield f"noise on a half {share:g}: {name}", partial(_changed, name, partial(half_noise, share))
        yield f"noise over lines {share:g}: wave", partial(_changed, "wave", partial(line_noise, share))
        for times in (1, 3, 12):
            yield (
                f"noise {share:g} averaged {times}: ellipsoid",
                partial(_changed, "ellipsoid", partial(correlated_noise, share, times)),
            )
    for denominator in (2, 4, 8, 16):
        yield (
            f"rounded to 1/{denominator}: ellipsoid",
            partial(_changed, "ellipsoid", partial(rounded, 1 / denominator)),
        )
    for denominator in (2, 4):
        yield (
            f"rounded to 1/{denominator}: torus",
            partial(_changed, "torus", partial(rounded, 1 / denominator)),
        )
        yield (
            f"rounded to 1/{denominator}: wave",
            partial(_changed, "wave", partial(rounded, 1 / denominator)),
        )
    for share in (0.3, 1.0):
        yield f"layers {share:g}: torus", partial(_changed, "torus", partial(layers, share))
    for share in (1.0, 2.0):
        yield f"layers {share:g}: ellipsoid", partial(_changed, "ellipsoid", partial(layers, share))
    yield (
        "layers 1, small edges: ellipsoid",
        lambda: _changed("ellipsoid", partial(layers, 1.0), base=_irregular("ellipsoid", 5000)),
    )
    for share in (0.25, 0.06):
        yield (
            f"single precision {share:g}: egg",
            partial(_changed, "egg", partial(far_in_single_precision, share)),
        )
    for share in (0.001, 0.01, 0.05):
        yield f"spikes {share:.1%}: sphere", partial(_changed, "sphere", partial(spikes, share, 0.5))
        yield (
            f"spikes {share:.1%}, slivers: torus",
            partial(_changed, "torus", partial(spikes, share, 0.5), base=_torus(slivers=True)),
        )
    yield (
        "spikes 1.0% of grey cubes: torus",
        partial(voxels, "torus", grey, change=partial(spikes, 0.01, 0.5)),
    )
    yield "noise 0.1 of grey cubes: torus", partial(voxels, "torus", grey, change=partial(normal_noise, 0.1))


def periodic_surfaces() -> Iterator[tuple[str, TriangleMesh]]:
    """Structured surfaces whose faces have few shapes: waves, an egg box, a gear, a thread, folded sheets."""
    u, v, faces = shapes.wrapped_grid(72, 72, wrap_u=False, wrap_v=False)
    x, y = 72 * u, 72 * v
    heights = {
        "egg box": 1.5 * np.sin(0.2 * np.pi * x) * np.sin(0.2 * np.pi * y),
        "waves": 2 * np.sin(np.pi / 4 * x),
        "folds": 2 * np.abs((x / 4) % 2 - 1),
    }
    for name, height in heights.items():
        yield name, TriangleMesh.from_arrays(np.stack([x, y, height], axis=1), faces)
    u, v, faces = shapes.wrapped_grid(120, 20, wrap_u=True, wrap_v=False)
    angle, radius = 2 * np.pi * u, 10 + np.where(np.rint(120 * u) % 6 < 3, 1.0, -1.0)
    yield (
        "gear",
        TriangleMesh.from_arrays(
            np.stack([radius * np.cos(angle), radius * np.sin(angle), 10 * v], axis=1), faces
        ),
    )
    u, v, faces = shapes.wrapped_grid(60, 120, wrap_u=True, wrap_v=False)
    angle, height = 2 * np.pi * u, 30 * v
    radius = 8 + 1.2 * np.abs((height / 2.5 + u) % 1 - 0.5)
    yield (
        "thread",
        TriangleMesh.from_arrays(
            np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1), faces
        ),
    )


def clean_cases() -> Iterator[tuple[str, Callable[[], KnownSurface]]]:
    """Surfaces without noise whose curvature is known."""
    for name in ("large sphere", "torus", "gyroid", "wave"):
        yield f"grey cubes: {name}", partial(voxels, name, grey)
    yield "grey cubes 1:1:2.5: ellipsoid", partial(voxels, "ellipsoid", grey, (1.0, 1.0, 2.5))
    yield "grey of 8 bits: ellipsoid", partial(voxels, "ellipsoid", partial(grey_of_bits, 8))
    for name in ("sphere", "ellipsoid", "egg", "torus", "wave", "saddle"):
        yield f"clean: {name}", partial(_changed, name)
    yield "clean, slivers: torus", partial(_changed, "torus", base=_torus(slivers=True))
    yield "clean, long cells: wave", partial(_changed, "wave", base=_graph("wave", 0.4, 0.5, 8.0))
    yield "clean, decimated: sphere", partial(_changed, "sphere", partial(decimated, 0.3))
    yield "clean, decimated: ellipsoid", partial(_changed, "ellipsoid", partial(decimated, 0.1))
    yield "clean, coarse: ellipsoid", partial(_changed, "ellipsoid", base=_irregular("ellipsoid", 120))
    yield "rounded to 1/256: ellipsoid", partial(_changed, "ellipsoid", partial(rounded, 1 / 256))
