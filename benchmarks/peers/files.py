"""Reading and writing beside trimesh, meshio and libigl; the whole command beside trimesh's load and export.

Run: `python -m benchmarks.peers.files`. Target: the whole `curvature` command on 100k faces, binary PLY
in and out, under 2 times what trimesh takes to load and export the same file (processes of their own).
Of STL, ours and meshio merge equal corners to vertices; trimesh (without its processing) and libigl do not.
The last row is beside the readers that merge: meshio, and trimesh with its processing.
"""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import measure, mesh_sequences
from ddgcli.io.mesh_file import read_mesh, write_mesh
from ddgcli.mesh.fields import AnnotatedMesh

FACES = 100_000
SCHEMES = ("quadric", "corrected", "normal-cycle", "cotan")


def peers(path: str, out: str) -> tuple[dict[str, Callable[[], Any]], dict[str, Callable[[], Any]]]:
    """Calls of other libraries that read the path, and that write what they read, by name."""
    import igl
    import meshio
    import trimesh

    suffix, theirs = Path(path).suffix, meshio.read(path)
    read, write = {"meshio": lambda: meshio.read(path)}, {"meshio": lambda: theirs.write(out)}
    if suffix not in (".vtu", ".vtk"):
        loaded = trimesh.load(path, process=False)
        read["trimesh"], write["trimesh"] = (
            lambda: trimesh.load(path, process=False),
            lambda: loaded.export(out),
        )
        points, faces = igl.read_triangle_mesh(path)
        read["libigl"] = lambda: igl.read_triangle_mesh(path)
        write["libigl"] = lambda: igl.write_triangle_mesh(out, points, faces)
    return read, write


def formats(folder: Path) -> list[list]:
    """One row a format and direction: ours beside the fastest of the peers."""
    mesh = mesh_sequences.sphere(FACES)
    rows = []
    for suffix in (".ply", ".obj", ".off", ".stl", ".vtu", ".vtk"):
        path, out = str(folder / f"in{suffix}"), str(folder / f"out{suffix}")
        write_mesh(path, AnnotatedMesh(mesh))
        ours = (lambda p=path: read_mesh(p)), (lambda o=out: write_mesh(o, AnnotatedMesh(mesh)))
        for direction, call, others in zip(("read", "write"), ours, peers(path, out), strict=True):
            with contextlib.redirect_stdout(io.StringIO()):
                timing = measure.interleaved({"ours": call, **others}, repeat=3)
            own = timing.pop("ours").median
            name = min(timing, key=lambda other: timing[other].median)
            rows.append([suffix, direction, own, name, timing[name].median, own / timing[name].median])
    return [*rows, merging_row(str(folder / "in.stl"))]


def merging_row(path: str) -> list:
    """Ours beside the fastest peer that joins the corners of an STL file to vertices, as ours does."""
    import meshio
    import trimesh

    calls = {
        "ours": lambda: read_mesh(path),
        "meshio": lambda: meshio.read(path),
        "trimesh": lambda: trimesh.load(path, process=True),
    }
    timing = measure.interleaved(calls, repeat=3)
    own = timing.pop("ours").median
    name = min(timing, key=lambda other: timing[other].median)
    return [".stl", "read, corners merged", own, name, timing[name].median, own / timing[name].median]


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
            ["format", "what", "ours [s]", "fastest peer", "peer [s]", "ratio"],
            formats(Path(name)),
        )
    measure.print_commands(*COMMANDS)
