"""Catalogue of surfaces with known curvature: voxels, noise, rounded coordinates, and clean ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from benchmarks.common.known_surfaces import (
    BODIES,
    TURN,
    KnownSurface,
    binary,
    cubes,
    grey,
    grey_of_bits,
    known,
    nets,
    voxels,
)
from benchmarks.common.level_sets import projected
from benchmarks.common.mesh_noise import (
    correlated_noise,
    decimated,
    far_in_single_precision,
    half_noise,
    holes,
    isotropic_noise,
    layers,
    line_noise,
    normal_noise,
    rounded,
    smoothed,
    spikes,
    taubin,
)
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh


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
        yield f"cubes: {name}", partial(voxels, BODIES[name], cubes)
    for name in ("large sphere", "torus", "ellipsoid", "gyroid", "catenoid", "wave"):
        yield f"marching cubes: {name}", partial(voxels, BODIES[name], binary)
    for name in ("sphere", "torus", "egg", "saddle"):
        yield f"surface nets: {name}", partial(voxels, BODIES[name], nets)
    flat = (1.0, 1.0, 2.5)
    yield "cubes 1:1:2.5: large sphere", partial(voxels, BODIES["large sphere"], cubes, flat)
    yield "marching cubes 1:1:2.5: ellipsoid", partial(voxels, BODIES["ellipsoid"], binary, flat)
    yield "surface nets 1:1:2.5: torus", partial(voxels, BODIES["torus"], nets, flat)
    yield (
        "marching cubes 1:1:5: large sphere",
        partial(voxels, BODIES["large sphere"], binary, (1.0, 1.0, 5.0)),
    )
    yield "cubes turned: ellipsoid", partial(voxels, BODIES["ellipsoid"], cubes, turn=TURN)
    yield "surface nets turned: ellipsoid", partial(voxels, BODIES["ellipsoid"], nets, turn=TURN)
    for times in (1, 3, 10, 30):
        yield (
            f"cubes smoothed {times}: ellipsoid",
            partial(voxels, BODIES["ellipsoid"], cubes, change=partial(smoothed, times)),
        )
    for times in (1, 5):
        yield (
            f"marching cubes smoothed {times}: torus",
            partial(voxels, BODIES["torus"], binary, change=partial(smoothed, times)),
        )
    yield (
        "marching cubes smoothed 30: large sphere",
        partial(voxels, BODIES["large sphere"], binary, change=partial(smoothed, 30)),
    )
    yield (
        "marching cubes by Taubin: large sphere",
        partial(voxels, BODIES["large sphere"], binary, change=partial(taubin, 10)),
    )
    yield (
        "cubes merged to half: large sphere",
        partial(voxels, BODIES["large sphere"], cubes, change=partial(decimated, 0.5)),
    )
    yield (
        "cubes merged to a fifth: large sphere",
        partial(voxels, BODIES["large sphere"], cubes, change=partial(decimated, 0.2)),
    )
    yield (
        "marching cubes merged to half: torus",
        partial(voxels, BODIES["torus"], binary, change=partial(decimated, 0.5)),
    )
    yield "grey of 2 bits: ellipsoid", partial(voxels, BODIES["ellipsoid"], partial(grey_of_bits, 2))
    yield "grey of 4 bits: ellipsoid", partial(voxels, BODIES["ellipsoid"], partial(grey_of_bits, 4))


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
        partial(voxels, BODIES["torus"], grey, change=partial(spikes, 0.01, 0.5)),
    )
    yield (
        "noise 0.1 of grey cubes: torus",
        partial(voxels, BODIES["torus"], grey, change=partial(normal_noise, 0.1)),
    )


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
        yield f"grey cubes: {name}", partial(voxels, BODIES[name], grey)
    yield "grey cubes 1:1:2.5: ellipsoid", partial(voxels, BODIES["ellipsoid"], grey, (1.0, 1.0, 2.5))
    yield "grey of 8 bits: ellipsoid", partial(voxels, BODIES["ellipsoid"], partial(grey_of_bits, 8))
    for name in ("sphere", "ellipsoid", "egg", "torus", "wave", "saddle"):
        yield f"clean: {name}", partial(_changed, name)
    yield "clean, slivers: torus", partial(_changed, "torus", base=_torus(slivers=True))
    yield "clean, long cells: wave", partial(_changed, "wave", base=_graph("wave", 0.4, 0.5, 8.0))
    yield "clean, decimated: sphere", partial(_changed, "sphere", partial(decimated, 0.3))
    yield "clean, decimated: ellipsoid", partial(_changed, "ellipsoid", partial(decimated, 0.1))
    yield "clean, coarse: ellipsoid", partial(_changed, "ellipsoid", base=_irregular("ellipsoid", 120))
    yield "rounded to 1/256: ellipsoid", partial(_changed, "ellipsoid", partial(rounded, 1 / 256))
