"""Reading and writing beside trimesh and meshio, and the whole command beside trimesh's load and export.

Run: `python -m benchmarks.peers.files`. Target: the whole `curvature` command on 100k faces, binary PLY
in and out, under 2 times what trimesh takes to load and export the same file (processes of their own).
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.common import measure, mesh_sequences
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh.fields import AnnotatedMesh

FACES = 100_000
SCHEMES = ("quadric", "corrected", "normal-cycle", "cotan")


def formats(folder: Path) -> list[list]:
    """One row a format: our read and write beside the peer's."""
    import meshio
    import trimesh

    mesh = mesh_sequences.sphere(FACES)
    rows = []
    for suffix in (".ply", ".obj", ".off", ".stl", ".vtu", ".vtk"):
        path, out = str(folder / f"in{suffix}"), str(folder / f"out{suffix}")
        write_mesh(path, AnnotatedMesh(mesh))
        meshio_only = suffix in (".vtu", ".vtk")
        if meshio_only:
            peer_mesh = meshio.read(path)
            peer_read, peer_write = (lambda p=path: meshio.read(p)), (lambda o=out, m=peer_mesh: m.write(o))
        else:
            peer_mesh = trimesh.load(path, process=False)
            peer_read = lambda p=path: trimesh.load(p, process=False)  # noqa: E731
            peer_write = lambda o=out, m=peer_mesh: m.export(o)  # noqa: E731
        timing = measure.interleaved(
            {
                "read": lambda p=path: read_mesh(p),
                "peer_read": peer_read,
                "write": lambda o=out: write_mesh(o, AnnotatedMesh(mesh)),
                "peer_write": peer_write,
            },
            repeat=3,
        )
        name = "meshio" if meshio_only else "trimesh"
        for direction in ("read", "write"):
            ours, theirs = timing[direction].median, timing[f"peer_{direction}"].median
            rows.append([suffix, direction, ours, name, theirs, ours / theirs])
    return rows


def processes(folder: Path) -> list[list]:
    """Whole processes: ours with all its arrays, trimesh's bare load and export."""
    mesh = mesh_sequences.sphere(FACES)
    path, out = folder / "whole.ply", folder / "whole-out.ply"
    write_mesh(str(path), AnnotatedMesh(mesh.moved(mesh.points.astype(np.float32).astype(np.float64))))
    commands = [["info"], *(["curvature", "--scheme", scheme] for scheme in SCHEMES)]
    where = [str(path), "-q", "-o", str(out)]
    ours = {" ".join(words): [sys.executable, "-m", "ddgcli", *words, *where] for words in commands}
    script = f"import trimesh; trimesh.load({str(path)!r}).export({str(out)!r})"
    calls = {**ours, "trimesh": [sys.executable, "-c", script]}
    timing = measure.interleaved(
        {n: (lambda c=c: subprocess.run(c, check=True, stdout=subprocess.DEVNULL)) for n, c in calls.items()},
        repeat=5,
    )
    peer = timing["trimesh"].median
    return [[name, timing[name].median, peer, timing[name].median / peer, "< 2"] for name in ours]


# whole commands, timed as a user starts them
COMMANDS = (
    "info catenoid.off",
    "curvature catenoid.off -o out.vtu",
)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        measure.print_table(
            f"Whole command, {FACES} faces, PLY in and out ({measure.machine()})",
            ["command", "seconds", "trimesh load + export", "ratio", "target"],
            processes(Path(name)),
        )
        measure.print_table(
            f"Reading and writing in one process, {FACES} faces",
            ["format", "what", "ours [s]", "peer", "peer [s]", "ratio"],
            formats(Path(name)),
        )
    measure.print_commands(*COMMANDS)
