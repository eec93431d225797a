"""Curvature of voxel surfaces: error at a stated radius beside PyCurv's figures, seconds and memory.

Errors are means of |computed / exact - 1|; the exact radius of a voxel sphere is that of its segmentation.
PyCurv: Salfer et al., PLoS Computational Biology 2020, its best scheme (AVV). Run:
python -m benchmarks.figures.voxels
"""

from __future__ import annotations

import time
from typing import Literal

import numpy as np

from benchmarks.common.known_surfaces import BODIES, cubes, mean_error, nets, voxels
from benchmarks.common.measure import cpu_seconds, peak_mib, print_table
from benchmarks.common.mesh_noise import normal_noise
from benchmarks.common.mesh_sequences import real, voxel_sphere
from ddgcli.algorithms.curvature.surface_curvature import measure_curvature
from ddgcli.mesh.triangle_mesh import TriangleMesh

SCHEMES = ("normal-voting", "quadric")
# file, radius of the sphere, radii of the balls, best published errors of H at any radius
PUBLISHED = (("sphere_r10.vtp", 10, (6, 8), 4.6), ("sphere_r30.vtp", 30, (10, 14, 28), 1.4))
GROWTH_RADII = (22, 46, 89)  # 18, 80 and 300 thousand faces
GROWTH_RUNS = (("normal-voting", 10.0), ("normal-voting", 14.0), ("quadric", 10.0))

SWEPT_BODIES = ("sphere", "large sphere", "ellipsoid", "torus", "egg", "capsule", "rounded box")
SWEPT_EDGES = 1.6 * 2 ** (np.arange(6) / 2)  # radii of the sweep in mean edges


def errors(
    mesh: TriangleMesh, sphere_radius: float, scheme: str, radius: float | Literal["auto"] | None
) -> list:
    """Radius of the balls, errors of H, k1 and k2 in per cent, and CPU seconds."""
    began = time.process_time()
    result = measure_curvature(mesh, scheme, radius)
    seconds = time.process_time() - began
    names = ("mean_curvature", "principal_curvature_max", "principal_curvature_min")
    off = [float(100 * np.abs(np.abs(result.vertex[n]) * sphere_radius - 1).mean()) for n in names]
    # faces inward exchange the two principal curvatures
    return [result.results["radius"] or "two rings", off[0], max(off[1:]), min(off[1:]), seconds]


def accuracy_table() -> None:
    """Print the errors on PyCurv's own voxel spheres."""
    rows: list[list] = []
    for name, sphere_radius, radii, best in PUBLISHED:
        mesh = real(f"voxel/{name}")
        for scheme in SCHEMES:
            rows += [[name, scheme, *errors(mesh, sphere_radius, scheme, radius), best] for radius in radii]
    header = ["surface", "scheme", "radius", "H %", "worse of k1, k2 %", "better %", "CPU s", "PyCurv H %"]
    print_table("PyCurv's voxel spheres", header, rows)


def automatic_table() -> None:
    """Print the errors at the default region and at the radius of `auto`."""
    rows: list[list] = []
    meshes = {f"PyCurv's, r = {r}": (real(f"voxel/{name}"), r) for name, r, _, _ in PUBLISHED}
    meshes |= {f"cubes, r = {r}": (voxel_sphere(r), r) for r in (6, 20)}
    for name, (mesh, sphere_radius) in meshes.items():
        default = errors(mesh, sphere_radius, "quadric", None)
        for scheme in ("normal-voting", "quadric"):
            automatic = errors(mesh, sphere_radius, scheme, "auto")
            rows.append([name, mesh.n_faces, default[1], scheme, *automatic[:2], automatic[4]])
    header = ["sphere", "faces", "H % by default", "scheme", "radius of auto", "H % by auto", "CPU s"]
    print_table("The radius of `--radius auto`", header, rows)


def swept_table() -> None:
    """Print the errors at the radius of `auto` beside the least ones of a sweep of stated radii."""
    rows: list[list] = []
    for kind, make in (("cubes", cubes), ("nets with noise", nets)):
        for body in SWEPT_BODIES:
            surface = voxels(BODIES[body], make)
            mesh = surface.mesh if make is cubes else normal_noise(0.1, surface.mesh)
            edge = float(mesh.side_length.mean())
            for scheme in SCHEMES:
                automatic = measure_curvature(mesh, scheme, "auto", full=False)
                swept = [
                    mean_error(
                        surface, measure_curvature(mesh, scheme, r, full=False).vertex["mean_curvature"]
                    )
                    for r in edge * SWEPT_EDGES
                ]
                error, best = mean_error(surface, automatic.vertex["mean_curvature"]), int(np.argmin(swept))
                stated, radius = automatic.results["expected_error"], automatic.results["radius"]
                row = [f"{kind}: {body}", scheme, radius / edge if radius else "default", 100 * error]
                least = [SWEPT_EDGES[best], 100 * swept[best], error / swept[best]]
                rows.append([*row, 100 * stated if stated else "-", *least])
    header = [
        "surface",
        "scheme",
        "radius of auto in edges",
        "H %",
        "stated %",
        "best radius",
        "H %",
        "ratio",
    ]
    print_table("The radius of auto beside the best of a sweep", header, rows)


def growth_table() -> None:
    """Print seconds and memory of growing voxel spheres in balls of the same radius."""
    rows: list[list] = []
    for scheme, radius in GROWTH_RUNS:
        last: tuple[int, float] | None = None
        for sphere_radius in GROWTH_RADII:
            mesh = voxel_sphere(sphere_radius)
            began = cpu_seconds()  # the forked process that measures the memory counts when it has ended
            memory = peak_mib(lambda m=mesh, s=scheme, r=radius: measure_curvature(m, s, r))  # type: ignore[misc]
            seconds = cpu_seconds() - began
            growth = np.log(seconds / last[1]) / np.log(mesh.n_faces / last[0]) if last else "-"
            last = mesh.n_faces, seconds
            rows.append([scheme, radius, mesh.n_faces, seconds, growth, memory])
    header = ["scheme", "radius", "faces", "CPU s", "exponent", "MiB"]
    print_table("Growth (aim: 300,000 faces within 60 s)", header, rows)


if __name__ == "__main__":
    accuracy_table()
    automatic_table()
    swept_table()
    growth_table()
