"""Exact geodesic distances beside VTP, the fastest published exact method: ratios on four surfaces.

python -m benchmarks.peers.vtp [faces ...]      default 20000 80000 320000

VTP: Qin, Han, Yu, Yu, Zhang 2016, triangle-oriented wavefront propagation; its authors' program is built with
g++ from `../shared/peers/vtp` into a temporary folder. Its seconds are those that it prints (CPU seconds of
propagation, without construction of the mesh); ours are `exact_distance` on a mesh whose topology exists.
On the terrain VTP's distances are too long (last two columns, relative to the largest distance): the paths
bend at a vertex of the boundary near the source, and `geodesic --path-to` writes paths of the shorter length.
Ratios are ours over VTP's, smaller is better. Aim: 1.0 at 80,000 faces, 0.4 at 320,000 and above.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.common import measure, mesh_sequences
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh.fields import AnnotatedMesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

SOURCE_FOLDER = mesh_sequences.SHARED_MESHES.parent / "peers" / "vtp"
REAL_MESHES = ("koala.obj", "st_helens_terrain.ply")
SOURCE_VERTEX = 0


def build(folder: Path) -> Path:
    """Compile VTP's program in a folder."""
    program = folder / "vtp"
    copy = shutil.copytree(SOURCE_FOLDER, folder / "source")
    words = ["g++", "-O3", "-include", "shim.h", "-fpermissive", "-w", "-o", str(program), "main.cpp"]
    subprocess.run(words, cwd=copy, check=True)
    return program


def run_vtp(program: Path, mesh: TriangleMesh, folder: Path) -> tuple[float, np.ndarray]:
    """CPU seconds of VTP's propagation, and its distances."""
    path, output = folder / "mesh.obj", folder / "distance.txt"
    write_mesh(str(path), AnnotatedMesh(mesh))
    words = [str(program), "-m", str(path), "-s", str(SOURCE_VERTEX), "-o", str(output)]
    printed = subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout
    seconds = re.search(r"propagation step took (\S+) seconds", printed)
    if seconds is None:
        raise SystemExit(f"VTP printed no time:\n{printed}")
    return float(seconds[1]), np.loadtxt(output)


def seconds_of(mesh: TriangleMesh) -> tuple[float, np.ndarray]:
    """CPU seconds of our propagation, and the distances; nothing but edges is there before."""
    fresh = TriangleMesh.from_arrays(mesh.points, mesh.faces)
    _ = fresh.topology.edges, fresh.topology.side_edge
    began = measure.cpu_seconds()
    distance = exact_distance(fresh, SOURCE_VERTEX).distance
    return measure.cpu_seconds() - began, distance


def bench(program: Path, folder: Path, meshes: dict[str, TriangleMesh]) -> None:
    """Print the seconds of both, in turn, the least of the repetitions."""
    rows: list[list] = []
    for name, mesh in meshes.items():
        ours, theirs = [], []
        for _ in range(3 if mesh.n_faces < 100_000 else 1):
            ours.append(seconds_of(mesh))
            theirs.append(run_vtp(program, mesh, folder))
        a, b = min(s for s, _ in ours), min(s for s, _ in theirs)
        longer = (theirs[0][1] - ours[0][1]) / theirs[0][1].max()
        aim = 0.4 if mesh.n_faces > 300_000 else 1.0 if mesh.n_faces > 70_000 else "-"
        rows.append([name, mesh.n_faces, a, b, a / b, aim, float(longer.min()), float(longer.max())])
    header = ["mesh", "faces", "ours s", "VTP s", "ours / VTP", "aim", "VTP - ours: least", "largest"]
    measure.print_table("Exact distances from one vertex", header, rows)


def main() -> None:
    """Build VTP in a temporary folder and print the table."""
    if shutil.which("g++") is None or not SOURCE_FOLDER.is_dir():
        raise SystemExit(f"this bench needs g++ and the source of VTP in {SOURCE_FOLDER}")
    sizes = [int(word) for word in sys.argv[1:]] or [20_000, 80_000, 320_000]
    meshes = {}
    for faces in sizes:
        meshes[f"sphere {faces // 1000}k"] = mesh_sequences.sphere(faces)
        meshes[f"stretched {faces // 1000}k"] = mesh_sequences.stretched(faces)
    meshes |= {name: mesh_sequences.real(name) for name in REAL_MESHES}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bench(build(folder), folder, meshes)


# whole commands, timed as a user starts them
COMMANDS = ("geodesic ellipsoid.ply --source 0 --method exact",)


if __name__ == "__main__":
    main()
    measure.print_commands(*COMMANDS)
