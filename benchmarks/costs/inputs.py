"""Input files of the measurements."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common.process import ROOT


def make_input(folder: Path, kind: str, elements: int) -> tuple[Path, float]:
    """Mesh file with the arrays f (vertices) and wind (cells), and three mean edge lengths."""
    suffix = "vtkhdf" if kind == "trajectory" else "npz"
    path, note = folder / f"{kind}-{elements}.{suffix}", folder / f"{kind}-{elements}.txt"
    if not path.exists():
        code = (
            "import sys; from pathlib import Path; from benchmarks.costs.inputs import write_input; "
            f"Path({str(note)!r}).write_text(str(write_input({str(path)!r}, {kind!r}, {elements})))"
        )
        subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
    return path, float(note.read_text())


def write_input(path: str, kind: str, elements: int) -> float:
    """Write an input, in a process of its own so that the driver stays small."""
    from ddgcli.io.mesh_file import write_mesh
    from ddgcli.mesh import shapes
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.fields import AnnotatedMesh
    from ddgcli.mesh.tet_mesh import TetMesh

    if kind == "trajectory":
        sphere, _ = make_input(Path(path).parent, "sphere", elements)
        words = (
            f"willmore-flow {sphere} --flow mean-curvature --steps 20 --dt 1e-5 --frame-every 1e-5 -o {path}"
        )
        subprocess.run(
            [sys.executable, "-m", "ddgcli", *words.split()], check=True, stdout=subprocess.DEVNULL
        )
        return 0.0
    if kind == "circle":
        angle = np.linspace(0, 2 * np.pi, elements, endpoint=False)
        points = np.stack([np.cos(angle), 0.7 * np.sin(angle), 0 * angle], axis=1)
        write_mesh(path, AnnotatedMesh(CurveSet.from_paths([np.vstack([points, points[:1]])])))
        return 0.0
    if kind == "rings":  # of a hundred points each
        angle = np.linspace(0, 2 * np.pi, 101)
        ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        rings = [ring + [3 * k, 0, 0] for k in range(elements // 100)]
        write_mesh(path, AnnotatedMesh(CurveSet.from_paths(rings)))
        return 0.0
    if kind == "box":
        mesh: Any = shapes.box_tetrahedra(*3 * [max(2, round((elements / 6) ** (1 / 3)))])
    elif kind == "pierced":  # a box with nine holes from side to side
        whole = shapes.box_tetrahedra(*3 * [7 * max(1, round((elements / 2000) ** (1 / 3)))])
        cell = np.floor(7 * whole.points[whole.tetrahedra].mean(axis=1)[:, :2])
        mesh = TetMesh.from_arrays(whole.points, whole.tetrahedra[(cell % 2 == 0).any(axis=1)])
    elif kind == "disk":
        mesh = shapes.grid(n := max(2, round((elements / 2) ** 0.5)), n)
    else:
        mesh = shapes.random_sphere(elements // 2 + 2, 0)
    if kind == "torus":
        n = max(4, round((elements / 4) ** 0.5))
        mesh = shapes.torus(2 * n, n)
        mesh = mesh.moved(mesh.points * [1.0, 1.2, 0.8])
    if kind == "needle":  # which covers few pixels of a picture
        mesh = mesh.moved(mesh.points * [1.0, 0.02, 0.02])
    if kind == "sheared":  # most edges are far from Delaunay
        mesh = mesh.moved(mesh.points * [1.0, 0.2, 5.0])
    if kind == "noisy":
        noise = 0.05 * mesh.side_length.mean() * np.random.default_rng(0).standard_normal(len(mesh.points))
        mesh = mesh.moved(mesh.points * (1 + noise)[:, None])
    if kind == "detailed":  # bumps of four edges, for which the search for noise tries the widest balls
        edge = float(mesh.side_length.mean())
        height = 0.2 * edge * np.sin(2 * np.pi / (4 * edge) * mesh.points).sum(axis=1)
        mesh = mesh.moved(mesh.points * (1 + height)[:, None])
    cells = {"wind": np.tile([1.0, 0.5, 0.2], (elements_of(mesh), 1))}
    write_mesh(path, AnnotatedMesh(mesh, vertex={"f": mesh.points[:, 2].copy()}, face=cells))
    return 3 * float(mesh.side_length.mean()) if kind not in ("box", "pierced") else 0.0


def elements_of(mesh: Any) -> int:
    """Cells of a mesh."""
    return len(mesh.tetrahedra if hasattr(mesh, "tetrahedra") else mesh.faces)
