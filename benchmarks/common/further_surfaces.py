"""Further surfaces with known curvature, noisy and clean, besides those that limits were fitted on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.known_surfaces import TURN, KnownSurface, binary, cubes, grey, known, nets, voxels
from benchmarks.common.level_sets import Body, projected, within
from benchmarks.common.mesh_noise import (
    decimated,
    isotropic_noise,
    normal_noise,
    rounded,
    smoothed,
    spikes,
    taubin,
    vertex_normals,
)
from benchmarks.common.mesh_sequences import marching_cubes
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh

Change: TypeAlias = Callable[[TriangleMesh], TriangleMesh]
Cases: TypeAlias = Iterator[tuple[str, Callable[[], KnownSurface]]]
Spacing: TypeAlias = tuple[float, float, float]

BALLS = (((-8, 0, 0), 9), ((7, 4, 2), 8), ((2, -9, 3), 6), ((5, 3, -10), 5))


def _metaballs(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    """Smooth minimum of the distances to four balls."""
    distance = [np.sqrt((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2) - r for (a, b, c), r in BALLS]
    return -3 * np.log(sum(np.exp(-d / 3) for d in distance))


def _bumpy(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    r = np.sqrt(x * x + y * y + z * z + 1e-30)
    return r - 14 - 1.2 * np.sin(5 * x / r) * np.cos(4 * y / r + 1) * np.cos(5 * z / r)


def _hills(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    return (
        z - 5 * np.exp(-((x - 6) ** 2 + (y - 3) ** 2) / 90) - 4 * np.exp(-((x + 9) ** 2 + (y + 5) ** 2) / 60)
    )


def _oblate(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    return 12 * (np.sqrt((x / 18) ** 2 + (y / 15) ** 2 + (z / 7) ** 2 + 1e-30) - 1)


def _schwarz(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    return 5 * (np.cos(x / 5.5) + np.cos(y / 5.5) + np.cos(z / 5.5))


def _bent_tube(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    """Tube of radius 5 around an arc of radius 15."""
    return np.hypot(np.hypot(x, y) - 15, z) - 5


BODIES = {
    "sphere of 7": Body(lambda x, y, z: np.sqrt(x * x + y * y + z * z) - 7, (7, 7, 7)),
    "sphere of 15": Body(lambda x, y, z: np.sqrt(x * x + y * y + z * z) - 15, (15, 15, 15)),
    "cylinder": Body(lambda x, y, z: np.hypot(x, y) - 10, (10, 10, 18), within(99, 99, 9)),
    "torus": Body(_bent_tube, (20, 20, 5)),
    "oblate": Body(_oblate, (18, 15, 7)),
    "thin capsule": Body(
        lambda x, y, z: np.sqrt(y * y + z * z + (x - np.clip(x, -16, 16)) ** 2) - 5, (21, 5, 5)
    ),
    "metaballs": Body(_metaballs, (22, 20, 20)),
    "bumpy sphere": Body(_bumpy, (16, 16, 16)),
    "hills": Body(_hills, (22, 22, 9), within(16, 16, 99)),
    "Schwarz": Body(_schwarz, (20, 20, 20), within(13, 13, 13)),
}  # fmt: skip
ROUND = ("sphere of 15", "oblate", "metaballs", "bumpy sphere")  # about the origin, in one piece of rays
FLAT: Spacing = (1.0, 1.0, 3.0)


def noisy_image(share: float, values: NDArray) -> TriangleMesh:
    """Marching cubes of grey values with noise, without the specks that it leaves."""
    noise = share * np.random.default_rng(11).standard_normal(values.shape)
    return _largest_component(
        marching_cubes(np.where(np.abs(values) < 3, 0.5 - values + noise, 0.5 - values))
    )


def blurred(width: float, values: NDArray) -> TriangleMesh:
    """Marching cubes of the segmented image after a Gaussian blur."""
    from scipy.ndimage import gaussian_filter

    return marching_cubes(gaussian_filter((values < 0).astype(float), width))


def blurred_noise(share: float, width: float, values: NDArray) -> TriangleMesh:
    """Marching cubes of grey values with noise after a Gaussian blur: noise over several voxels."""
    from scipy.ndimage import gaussian_filter

    noise = gaussian_filter(np.random.default_rng(12).standard_normal(values.shape), width)
    return _largest_component(marching_cubes(0.5 - values + share * noise / noise.std()))


def _largest_component(mesh: TriangleMesh) -> TriangleMesh:
    component = mesh.topology.vertex_component
    largest = np.bincount(component).argmax()
    faces = mesh.faces[component[mesh.faces[:, 0]] == largest]
    used, index = np.unique(faces, return_inverse=True)
    return TriangleMesh.from_arrays(mesh.points[used], index.reshape(-1, 3))


def _on(name: str, n: int = 3000, *changes: Change, stretch: Spacing = (1.0, 1.0, 1.0)) -> KnownSurface:
    """Irregular mesh of a body: random directions, moved to the surface, then changed."""
    body = BODIES[name]
    mesh = shapes.random_sphere(n, 5)
    rays = mesh.points * np.array(stretch)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    mesh = mesh.moved(_along_rays(body, rays))
    for change in changes:
        mesh = change(mesh)
    return known(body, mesh)


def _along_rays(body: Body, rays: NDArray) -> NDArray:
    """The farthest point of the surface on each ray from the origin."""
    distance = np.linspace(1, 30, 291)
    values = np.stack([body.level(*(r * rays.T)) for r in distance])
    last = len(distance) - 2 - np.argmax((values[:-1] < 0)[::-1], axis=0)
    return projected(body, distance[last][:, None] * rays)


def _tube(n_around: int, n_along: int, *changes: Change) -> KnownSurface:
    """Regular torus of long or square cells."""
    mesh = shapes.torus(n_along, n_around, 15, 5)
    for change in changes:
        mesh = change(mesh)
    return known(BODIES["torus"], mesh)


def _open_cylinder(*changes: Change) -> KnownSurface:
    mesh = shapes.cylinder(60, 30, 10, 30)
    for change in changes:
        mesh = change(mesh)
    return known(BODIES["cylinder"], mesh)


def _height_field(n: int, *changes: Change, jitter: float = 0.3) -> KnownSurface:
    """The hills over a jittered grid."""
    u, v, faces = shapes.wrapped_grid(n, n, wrap_u=False, wrap_v=False)
    rng, step = np.random.default_rng(9), 44 / n
    x, y = (44 * c - 22 + jitter * step * rng.uniform(-1, 1, len(c)) for c in (u, v))
    mesh = TriangleMesh.from_arrays(np.stack([x, y, -_hills(x, y, np.zeros(len(x)))], axis=1), faces)
    for change in changes:
        mesh = change(mesh)
    return known(BODIES["hills"], mesh)


def _scan(share: float, power: float, *changes: Change) -> KnownSurface:
    """Range image of the hills from a scanner at a side: noise along the rays grows with the distance."""

    def noise(mesh: TriangleMesh) -> TriangleMesh:
        ray = mesh.points - np.array([-40.0, 0.0, 25.0])
        depth = np.linalg.norm(ray, axis=1, keepdims=True)
        size = share * (depth / depth.mean()) ** power * mesh.side_length.mean()
        return mesh.moved(
            mesh.points + size * np.random.default_rng(13).standard_normal(depth.shape) * ray / depth
        )

    return _height_field(60, noise, *changes, jitter=0.0)


def _enneper(n: int, *changes: Change) -> KnownSurface:
    """Minimal surface of Enneper, without a level set: k = 4 / (1 + u^2 + v^2)^2."""
    u, v, faces = shapes.wrapped_grid(n, n, wrap_u=False, wrap_v=False)
    rng = np.random.default_rng(14)
    u, v = (2 * (2 * c - 1) * 0.6 + 0.6 / n * rng.uniform(-1, 1, len(c)) for c in (u, v))
    points = np.stack([u - u**3 / 3 + u * v * v, v - v**3 / 3 + v * u * u, u * u - v * v], axis=1)
    mesh = TriangleMesh.from_arrays(points, faces)
    for change in changes:
        mesh = change(mesh)
    k = 4 / (1 + u * u + v * v) ** 2
    return KnownSurface(mesh, np.stack([-k, k], axis=1), np.maximum(np.abs(u), np.abs(v)) < 0.9)


def half_precision(mesh: TriangleMesh) -> TriangleMesh:
    """Coordinates of 16 bits."""
    return mesh.moved(mesh.points.astype(np.float16).astype(float))


def rounded_to_a_thousandth(extent: float, mesh: TriangleMesh) -> TriangleMesh:
    """Scaled so that the body has this size, rounded to three decimals, scaled back."""
    scale = extent / np.ptp(mesh.points, axis=0).max()
    return mesh.moved(np.round(mesh.points * scale, 3) / scale)


def smooth_noise(share: float, length: float, mesh: TriangleMesh) -> TriangleMesh:
    """Displacements along the normals, correlated over so many edges: a sum of random waves."""
    edge, rng = mesh.side_length.mean(), np.random.default_rng(15)
    waves, phase = rng.standard_normal((300, 3)) / (length * edge), rng.uniform(0, 2 * np.pi, 300)
    height = share * edge * np.sqrt(2 / 300) * np.cos(mesh.points @ waves.T + phase).sum(axis=1)
    return mesh.moved(mesh.points + height[:, None] * vertex_normals(mesh))


def cap_noise(share: float, of_surface: float, mesh: TriangleMesh) -> TriangleMesh:
    """Noise along the normals on the share of the surface that lies highest along a slanted axis."""
    height = mesh.points @ np.array([0.5, -0.3, 0.8])
    inside = height > np.quantile(height, 1 - of_surface)
    size = (
        share * mesh.side_length.mean() * inside * np.random.default_rng(16).standard_normal(mesh.n_vertices)
    )
    return mesh.moved(mesh.points + size[:, None] * vertex_normals(mesh))


def outliers(share: float, height: float, mesh: TriangleMesh) -> TriangleMesh:
    """A share of the vertices far off, by normal heights."""
    rng = np.random.default_rng(17)
    off = (rng.random(mesh.n_vertices) < share) * rng.standard_normal(mesh.n_vertices)
    return mesh.moved(mesh.points + (height * mesh.side_length.mean() * off)[:, None] * vertex_normals(mesh))


def reconstruction_bumps(mesh: TriangleMesh) -> TriangleMesh:
    """Bumps of two to four edges as implicit fits of noisy points leave, here and there."""
    rng, edge = np.random.default_rng(18), mesh.side_length.mean()
    centre = mesh.points[rng.choice(mesh.n_vertices, mesh.n_vertices // 25)]
    height = np.zeros(mesh.n_vertices)
    for c in centre:
        width = edge * rng.uniform(1.2, 2.2)
        height += (
            0.2 * edge * rng.standard_normal() * np.exp(-((mesh.points - c) ** 2).sum(axis=1) / width**2)
        )
    return mesh.moved(mesh.points + height[:, None] * vertex_normals(mesh))


def voxel_cases() -> Cases:
    """Segmented and grey volumes."""
    for name in ("sphere of 7", "cylinder", "thin capsule", "metaballs", "bumpy sphere", "hills"):
        yield f"cubes: {name}", partial(voxels, BODIES[name], cubes)
    for name in ("sphere of 15", "cylinder", "metaballs", "Schwarz", "oblate"):
        yield f"marching cubes: {name}", partial(voxels, BODIES[name], binary)
    for name in ("metaballs", "thin capsule", "hills", "Schwarz"):
        yield f"nets: {name}", partial(voxels, BODIES[name], nets)
    for name in ("sphere of 15", "metaballs"):
        yield f"cubes 1:1:3: {name}", partial(voxels, BODIES[name], cubes, FLAT)
        yield f"marching cubes 1:1:3: {name}", partial(voxels, BODIES[name], binary, FLAT)
        yield f"nets 1:1:3: {name}", partial(voxels, BODIES[name], nets, FLAT)
    yield "marching cubes turned: bumpy sphere", partial(voxels, BODIES["bumpy sphere"], binary, turn=TURN)
    for name, share in (("metaballs", 0.1), ("sphere of 15", 0.3), ("torus", 0.2), ("oblate", 0.5)):
        yield (
            f"grey with image noise {share}: {name}",
            partial(voxels, BODIES[name], partial(noisy_image, share)),
        )
    for name, width in (("metaballs", 0.5), ("sphere of 15", 0.7), ("torus", 0.7), ("metaballs", 1.0)):
        yield f"segmented, blurred {width}: {name}", partial(voxels, BODIES[name], partial(blurred, width))
    yield (
        "segmented 1:1:3, blurred 0.7: oblate",
        partial(voxels, BODIES["oblate"], partial(blurred, 0.7), FLAT),
    )
    for name, width in (("metaballs", 0.7), ("sphere of 15", 1.0), ("oblate", 1.5)):
        yield (
            f"grey with noise 0.2 over {width}: {name}",
            partial(voxels, BODIES[name], partial(blurred_noise, 0.2, width)),
        )
    for times in (2, 8, 25):
        yield (
            f"marching cubes, Laplacian {times}: metaballs",
            partial(voxels, BODIES["metaballs"], binary, change=partial(smoothed, times)),
        )
        yield (
            f"cubes, Taubin {times}: bumpy sphere",
            partial(voxels, BODIES["bumpy sphere"], cubes, change=partial(taubin, times)),
        )
        yield (
            f"marching cubes 1:1:3, Taubin {times}: oblate",
            partial(voxels, BODIES["oblate"], binary, FLAT, change=partial(taubin, times)),
        )
    yield "nets, Taubin 10: Schwarz", partial(voxels, BODIES["Schwarz"], nets, change=partial(taubin, 10))
    yield "nets, Taubin 10: cylinder", partial(voxels, BODIES["cylinder"], nets, change=partial(taubin, 10))
    yield (
        "marching cubes, decimated 0.3: metaballs",
        partial(voxels, BODIES["metaballs"], binary, change=partial(decimated, 0.3)),
    )


def noise_cases() -> Cases:
    """Scans, rounded coordinates, outliers and noise of any kind."""
    for name, share in (("metaballs", 0.03), ("oblate", 0.08), ("bumpy sphere", 0.15), ("metaballs", 0.3)):
        yield f"normal noise {share}: {name}", partial(_on, name, 3000, partial(normal_noise, share))
    yield "isotropic noise 0.15: sphere", partial(_on, "sphere of 15", 3000, partial(isotropic_noise, 0.15))
    for share in (0.05, 0.15):
        yield f"long cells, noise {share}: torus", partial(_tube, 60, 40, partial(normal_noise, share))
        yield f"open, noise {share}: cylinder", partial(_open_cylinder, partial(normal_noise, share))
    for share, power in ((0.1, 2), (0.3, 2), (0.1, 6)):
        yield f"range image {share}, depth^{power}", partial(_scan, share, power)
    yield "range image 0.2, averaged once", partial(_scan, 0.2, 2, partial(smoothed, 1))
    yield "range image 0.3, Taubin 5", partial(_scan, 0.3, 2, partial(taubin, 5))
    yield "range image 0.2, decimated 0.3", partial(_scan, 0.2, 2, partial(decimated, 0.3))
    for name in ("metaballs", "sphere of 15"):
        yield f"float16: {name}", partial(_on, name, 6000, half_precision)
    for extent, name in ((1.0, "metaballs"), (0.3, "oblate"), (0.2, "bumpy sphere")):
        yield (
            f"rounded to 1e-3 of extent {extent}: {name}",
            partial(_on, name, 3000, partial(rounded_to_a_thousandth, extent)),
        )
    yield "height field rounded to 1/3", partial(_height_field, 55, partial(rounded, 1 / 3), jitter=0.0)
    for name, height in (("metaballs", 0.3), ("oblate", 1.0), ("bumpy sphere", 2.0)):
        yield f"outliers 1 % of {height}: {name}", partial(_on, name, 3000, partial(outliers, 0.01, height))
    yield (
        "outliers 1 % and noise 0.05: sphere",
        partial(_on, "sphere of 15", 3000, partial(outliers, 0.01, 1.0), partial(normal_noise, 0.05)),
    )
    for share, length in ((0.1, 1.0), (0.2, 1.5), (0.3, 2.0), (0.3, 3.0)):
        yield (
            f"noise {share} over {length} edges: sphere",
            partial(_on, "sphere of 15", 3000, partial(smooth_noise, share, length)),
        )
        yield (
            f"noise {share} over {length} edges: metaballs",
            partial(_on, "metaballs", 4000, partial(smooth_noise, share, length)),
        )
    for share, of_surface in ((0.2, 0.08), (0.1, 0.2), (0.2, 0.4), (0.05, 0.6)):
        yield (
            f"noise {share} on {of_surface} of it: oblate",
            partial(_on, "oblate", 3000, partial(cap_noise, share, of_surface)),
        )
    yield "noise 0.2 on 0.25 of it: Enneper", partial(_enneper, 55, partial(cap_noise, 0.2, 0.25))
    for share in (0.05, 0.2):
        yield f"noise {share}: Enneper", partial(_enneper, 55, partial(normal_noise, share))
    for times in (1, 4, 15):
        yield (
            f"noise 0.3, Taubin {times}: metaballs",
            partial(_on, "metaballs", 3000, partial(normal_noise, 0.3), partial(taubin, times)),
        )
        yield (
            f"noise 0.3, Laplacian {times}: oblate",
            partial(_on, "oblate", 3000, partial(normal_noise, 0.3), partial(smoothed, times)),
        )
    yield (
        "slivers, noise 0.1: oblate",
        partial(_on, "oblate", 3000, partial(normal_noise, 0.1), stretch=(1.0, 1.0, 0.25)),
    )
    yield (
        "slivers, noise 0.05: metaballs",
        partial(_on, "metaballs", 3000, partial(normal_noise, 0.05), stretch=(0.3, 1.0, 1.0)),
    )
    for name in ("sphere of 15", "oblate"):
        yield f"bumps of a reconstruction: {name}", partial(_on, name, 4000, reconstruction_bumps)
    yield (
        "noise 0.2, decimated 0.2: metaballs",
        partial(_on, "metaballs", 8000, partial(normal_noise, 0.2), partial(decimated, 0.2)),
    )
    yield "spikes 0.5 %: metaballs", partial(_on, "metaballs", 3000, partial(spikes, 0.005, 1.0))


def clean_cases() -> Cases:
    """Surfaces without noise: irregular, coarse, long cells, of grey values, decimated."""
    for name in ROUND:
        for n in (300, 1000, 4000):
            yield f"irregular {n}: {name}", partial(_on, name, n)
        yield f"slivers: {name}", partial(_on, name, 3000, stretch=(1.0, 1.0, 0.3))
        yield f"decimated 0.2: {name}", partial(_on, name, 8000, partial(decimated, 0.2))
        yield (
            f"rounded to 1e-3 of extent 30: {name}",
            partial(_on, name, 3000, partial(rounded_to_a_thousandth, 30.0)),
        )
    for name in ("sphere of 15", "metaballs", "torus", "cylinder", "thin capsule", "Schwarz", "bumpy sphere"):
        yield f"grey: {name}", partial(voxels, BODIES[name], grey)
    yield "grey 1:1:3: oblate", partial(voxels, BODIES["oblate"], grey, FLAT)
    yield "grey turned: metaballs", partial(voxels, BODIES["metaballs"], grey, turn=TURN)
    for around, along in ((12, 36), (24, 200), (100, 24), (8, 24)):
        yield f"torus {around} x {along}", partial(_tube, around, along)
    yield "open cylinder", _open_cylinder
    for n in (12, 30, 70):
        yield f"height field {n}", partial(_height_field, n)
        yield f"Enneper {n}", partial(_enneper, n)
