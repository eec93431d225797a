"""Make the sample runs of docs/willmore-samples.md: inputs by formulas, commands, pictures.

`python docs/willmore_samples.py [NAME ...]`; without names all of them. Inputs go to build/willmore,
pictures to docs/pictures.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "build" / "willmore"
PICTURES = ROOT / "docs" / "pictures"


def bumpy_ball() -> TriangleMesh:
    """A ball with broad bumps."""
    ball = shapes.icosphere(4)
    x, y, z = ball.points.T
    return ball.moved(ball.points * (1 + 0.15 * np.sin(3 * x) * np.cos(4 * y) + 0.2 * z**3)[:, None])


def noisy_scan() -> TriangleMesh:
    """The bumpy ball with noise of 1.5 % of its radius along the rays."""
    ball = bumpy_ball()
    noise = np.random.default_rng(0).normal(size=ball.n_vertices)
    return ball.moved(ball.points * (1 + 0.015 * noise)[:, None])


def holed_scan() -> TriangleMesh:
    """The bumpy ball without a cap."""
    ball = bumpy_ball()
    away = ball.points[ball.faces].mean(axis=1) @ [0.0, -0.8, 0.6]
    faces = ball.faces[away < 0.8 * away.max()]
    vertices, renamed = np.unique(faces, return_inverse=True)
    return TriangleMesh.from_arrays(ball.points[vertices], renamed.reshape(-1, 3))


def flat_spheroid() -> TriangleMesh:
    """A spheroid of reduced volume 0.6."""
    ball = shapes.icosphere(4)
    return ball.moved(ball.points * [1.0, 1.0, 0.2584])


def two_holes(n: int = 4) -> TriangleMesh:
    """The surface of a block of 5 x 3 x 1 cubes without two, each of n x n x n cells; genus 2."""
    cells = np.ones((5 * n, 3 * n, n), dtype=bool)
    cells[n : 2 * n, n : 2 * n] = cells[3 * n : 4 * n, n : 2 * n] = False
    padded = np.pad(cells, 1)
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for sign in (1, -1):
            at = np.argwhere(padded & ~np.roll(padded, -sign, axis=axis))
            corner = at + (sign > 0) * np.eye(3, dtype=int)[axis]
            du, dv = np.eye(3, dtype=int)[[u, v]]
            ring = [corner, corner + du, corner + du + dv, corner + dv]
            quads.append(np.stack(ring if sign > 0 else ring[::-1], axis=1))
    points, index = np.unique(np.concatenate(quads).reshape(-1, 3), axis=0, return_inverse=True)
    quad = index.reshape(-1, 4)
    faces = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    return TriangleMesh.from_arrays(0.1 * points, faces)


# input -> what makes it
INPUTS: dict[str, Callable[[], TriangleMesh]] = {
    "scan.ply": noisy_scan,
    "torus.ply": lambda: shapes.torus(80, 40, 3.0, 1.0),
    "block.ply": two_holes,
    "spheroid.ply": flat_spheroid,
    "holed.ply": holed_scan,
    "tube.ply": lambda: shapes.cylinder(48, 24, 1.0, 1.2),
    "blob.ply": bumpy_ball,
}
# picture -> words after `ddgcli willmore-flow`
RUNS: dict[str, list[str]] = {
    "scan-willmore": ["scan.ply", "--dt", "1e-6", "--duration", "2e-5"],
    "scan-mean-curvature": ["scan.ply", "--flow", "mean-curvature", "--dt", "5e-4", "--duration", "5e-3"],
    "clifford": ["torus.ply"],
    "lawson": ["block.ply", "--energy", "cotan", "--remesh", "mean", "--view", "60,20"],
    "red-cell": ["spheroid.ply", "--fix-area", "--fix-volume"],
    "filled": ["holed.ply", "--fill", "all"],
    "catenoid": ["tube.ply", "--flow", "mean-curvature"],
    "bubble": ["blob.ply", "--flow", "mean-curvature", "--fix-volume"],
}


def command_line(name: str) -> str:
    """The call of a run, as the page shows it."""
    return " ".join(["ddgcli willmore-flow", *RUNS[name], f"-o {name}.vtkhdf --plot {name}.png"])


def make(name: str) -> None:
    """Write the input of a run and make its picture; CalledProcessError if the run fails."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    source, *words = RUNS[name]
    write_mesh(str(FOLDER / source), AnnotatedMesh(INPUTS[source]()))
    call = [
        *(sys.executable, "-m", "ddgcli", "willmore-flow", str(FOLDER / source), *words),
        *("-o", str(FOLDER / f"{name}.vtkhdf"), "--plot", str(PICTURES / f"willmore-{name}.png")),
        *("--size", "900x700"),
    ]
    subprocess.run(call, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=True)


def main() -> None:
    """Make the named runs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[*RUNS, []], help="runs (default: all)")
    for name in parser.parse_args().names or RUNS:
        make(name)


if __name__ == "__main__":
    main()
