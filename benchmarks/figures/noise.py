"""Error of the mean curvature of noisy surfaces, by the default neighbourhood and by the radius of `auto`.

Relative errors, root mean square, about 2,500 vertices moved by normal noise of a share of an edge. Run:
python -m benchmarks.figures.noise
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.common.measure import print_table
from ddgcli.algorithms.curvature.surface_curvature import measure_curvature
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.truths import Truth, ellipsoid, sphere, torus

AXES = (1.5, 1.0, 0.6)
SURFACES: dict[str, tuple[Callable[[], TriangleMesh], Truth]] = {
    "icosphere": (lambda: shapes.icosphere(4), sphere(1.0)),
    "irregular sphere": (lambda: shapes.random_sphere(2500), sphere(1.0)),
    "irregular ellipsoid": (lambda: stretched_sphere(), ellipsoid(*AXES)),
    "torus": (lambda: shapes.torus(80, 32), torus(1.0, 0.4)),
}
NOISE_SHARES = (0.01, 0.05, 0.10)


def stretched_sphere() -> TriangleMesh:
    """Irregular ellipsoid."""
    mesh = shapes.random_sphere(2500)
    return mesh.moved(mesh.points * AXES)


def error(mesh: TriangleMesh, truth: np.ndarray, radius: float | str | None) -> float:
    """Relative error of the mean curvature, root mean square."""
    mean = measure_curvature(mesh, radius=radius).vertex["mean_curvature"]
    return float(np.sqrt(np.mean((mean - truth) ** 2) / np.mean(truth**2)))


def main() -> None:
    """Print the table."""
    rows: list[list] = []
    for name, (make, truth) in SURFACES.items():
        mesh = make()
        exact = truth.mean_curvature(mesh.points)  # type: ignore[misc]
        row: list = [name]
        for share in NOISE_SHARES:
            noise = np.random.default_rng(0).standard_normal(mesh.points.shape)
            moved = mesh.moved(mesh.points + share * mesh.side_length.mean() * noise)
            row += [error(moved, exact, None), error(moved, exact, "auto")]
        rows.append(row)
    header = ["surface", *(f"noise {share:.0%}: {n}" for share in NOISE_SHARES for n in ("default", "auto"))]
    print_table("Error of H", header, rows)


if __name__ == "__main__":
    main()
