"""Steps and seconds of `willmore-flow` to rest on scans, beside Surface Evolver, and smoothing of noise.

Scans are those of a folder of real meshes (its place in the variable MESHES); each runs by default options.
Surface Evolver (the command `evolver`, conjugate gradients with its own `sq_mean_curvature` and
`star_perp_sq_mean_curvature`) starts at the same ellipsoids; both stop at their own energy 1 % above 4 pi.
Noise: heights of a tenth of an edge on the vertices of a scan, taken away by the smoothing of each tool. The
length of ours in time is the best of four on that mesh; every other tool has one setting. A tool that is not
installed has a row that reports it. `benchmarks.peers.willmore` prints the tables.
"""

from __future__ import annotations

import importlib.util
import math
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.measure import cpu_seconds, print_table
from benchmarks.common.mesh_sequences import SHARED_MESHES
from ddgcli.geometry.extrinsic import enclosed_volume
from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.geometry.normals import sphere_normals
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.models.willmore import setup
from ddgcli.models.willmore.descent import mean_curvature_step
from ddgcli.models.willmore.flow_options import FlowOptions, with_stop
from ddgcli.simulation.account import Account
from ddgcli.simulation.time_loop import evolve

MESHES = Path(os.environ.get("MESHES", SHARED_MESHES))
SCANS = ("goathead", "spot", "blub_triangulated", "self_intersectA", "wingnut")
NEAR, ABOVE = 1e-3, 1e-2  # of 4 pi: ends of the scans, and of the runs beside Surface Evolver
EVOLVER_ROUNDS = 60  # of ten steps


def to_rest(mesh: TriangleMesh, enough: float = 0.0, **options: str) -> tuple[NDArray, list[float], str]:
    """Energies over 4 pi less 1 and seconds of each frame of a flow to rest, and why it stopped."""
    flow, model = setup.build(mesh, with_stop(FlowOptions(**options), mesh.topology, False))
    began, energy, seconds, stopped = cpu_seconds(), [], [], ""
    for snapshot in evolve({"s": model}, setup.schedule(flow, {}), Account()):
        energy.append(snapshot.observations["s"].scalar["energy"] / (4 * math.pi) - 1)
        seconds.append(cpu_seconds() - began)
        stopped = snapshot.stopped or stopped
        if energy[-1] < enough:
            break
    return np.array(energy), seconds, stopped


def scans(names: list[str]) -> list[list]:
    table_rows = []
    for name in names:
        path = MESHES / f"{name}.obj"
        if not path.is_file():
            table_rows.append([name, f"{path} is missing", *["-"] * 7])
            continue
        mesh = read_mesh(str(path)).surface
        energy, seconds, stopped = to_rest(mesh)
        near = np.flatnonzero(energy < NEAR)
        steps, until = (int(near[0]), seconds[near[0]]) if len(near) else ("-", "-")
        angle = float(np.degrees(corner_angle(mesh.side_length).min()))
        row = [name, mesh.n_faces, angle, steps, until, len(energy) - 1, seconds[-1], energy[-1], stopped]
        table_rows.append(row)
    return table_rows


def evolver_file(mesh: TriangleMesh, quantity: str) -> str:
    """The surface as a datafile of Surface Evolver, without surface tension."""
    t = mesh.topology
    lines = [f"quantity bending energy method {quantity} global", "vertices"]
    lines += [f"{i} {x!r} {y!r} {z!r}" for i, (x, y, z) in enumerate(mesh.points.tolist(), 1)]
    lines += ["edges", *(f"{i} {a} {b}" for i, (a, b) in enumerate((t.edges + 1).tolist(), 1)), "faces"]
    sides = ((t.side_edge + 1) * t.side_sign)[:, [2, 0, 1]].astype(int).tolist()
    lines += [f"{i} {a} {b} {c} tension 0" for i, (a, b, c) in enumerate(sides, 1)]
    return "\n".join([*lines, "read", ""])


def evolver(mesh: TriangleMesh, quantity: str) -> list:
    """Steps, seconds by its own clock, and its energy over 4 pi less 1 where it ends."""
    loop = f'for (ii:=0; ii<{EVOLVER_ROUNDS}; ii++) {{ g 10; printf "E %.10g %g\\n", total_energy, clock; '
    loop += f"if (total_energy < {4 * math.pi * (1 + ABOVE)}) then break; }}"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "start.fe"
        path.write_text(evolver_file(mesh, quantity), encoding="ascii")
        words = f"U\n{loop}\nq\nq\n"
        process = subprocess.run(["evolver", path], input=words, capture_output=True, text=True, cwd=folder)
    rounds = [line.split()[1:] for line in process.stdout.splitlines() if line.startswith("E ")]
    return [10 * len(rounds), float(rounds[-1][1]), float(rounds[-1][0]) / (4 * math.pi) - 1]


def beside_evolver() -> list[list]:
    table_rows = []
    for level in (3, 4):
        ball = shapes.icosphere(level)
        mesh = ball.moved(ball.points * [1.0, 1.0, 2.0])
        for flow in ("quadratic", "newton", "conformal"):
            energy, seconds, _ = to_rest(mesh, ABOVE, flow=flow)
            table_rows.append([mesh.n_faces, f"ddgcli {flow}", len(energy) - 1, seconds[-1], energy[-1]])
        for quantity in ("sq_mean_curvature", "star_perp_sq_mean_curvature"):
            measured = evolver(mesh, quantity) if shutil.which("evolver") else ["not installed", "-", "-"]
            table_rows.append([mesh.n_faces, f"Surface Evolver {quantity}", *measured])
    return table_rows


def willmore_smoothing(mesh: TriangleMesh) -> NDArray:
    """Two steps in time, of a two-hundredth of an edge to the fourth power each."""
    dt = 0.005 * float(mesh.side_length.mean()) ** 4
    flow, model = setup.build(mesh, FlowOptions(timed=True))
    times = {"step": dt, "duration": 2 * dt, "frame_every": 2 * dt}
    return list(evolve({"s": model}, setup.schedule(flow, times), Account()))[-1].observations["s"].points


def by_meshlab(mesh: TriangleMesh, name: str, **words: float) -> NDArray:
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(mesh.points, mesh.faces.astype(np.int32)))
    meshes.apply_filter(name, **words)
    return np.asarray(meshes.current_mesh().vertex_matrix())


def by_igl(mesh: TriangleMesh, time: float) -> NDArray:
    import igl
    from scipy.sparse.linalg import spsolve

    v, f = np.array(mesh.points), np.array(mesh.faces)
    mass = igl.massmatrix(v, f, igl.MASSMATRIX_TYPE_BARYCENTRIC)
    return np.asarray(spsolve((mass - time * igl.cotmatrix(v, f)).tocsc(), mass @ v))


def smoothers(mesh: TriangleMesh) -> dict[str, Callable[[], NDArray]]:
    time = 0.15 * float(mesh.side_length.mean()) ** 2
    everything = np.arange(mesh.n_vertices)
    filters = "apply_coord_laplacian_smoothing", "apply_coord_taubin_smoothing"
    return {
        "noisy": lambda: np.array(mesh.points),
        "ddgcli willmore-flow, in time": lambda: willmore_smoothing(mesh),
        "ddgcli mean-curvature": lambda: np.array(mean_curvature_step(mesh, everything, time).points),
        "pymeshlab laplacian, 3": lambda: by_meshlab(mesh, filters[0], stepsmoothnum=3),
        "pymeshlab taubin, 10": lambda: by_meshlab(mesh, filters[1], stepsmoothnum=10),
        "pymeshlab hc-laplacian": lambda: by_meshlab(mesh, "apply_coord_hc_laplacian_smoothing"),
        "libigl cotmatrix, implicit": lambda: by_igl(mesh, time),
    }


MODULES = {"pymeshlab": "pymeshlab", "libigl": "igl"}  # first word of a smoother -> module


def distance(points: NDArray, clean: TriangleMesh) -> float:
    """Root mean square distance of points to a surface, by libigl; nan where it is not installed."""
    if importlib.util.find_spec("igl") is None:
        return math.nan
    import igl

    squared = igl.point_mesh_squared_distance(
        np.array(points), np.array(clean.points), np.array(clean.faces)
    )[0]
    return float(np.sqrt(squared.mean()))


def smoothing(name: str) -> list[list]:
    clean = read_mesh(str(MESHES / f"{name}.obj")).surface
    edge = float(clean.side_length.mean())
    height = 0.1 * edge * np.random.default_rng(0).normal(size=clean.n_vertices)
    noisy = clean.moved(clean.points + sphere_normals(clean) * height[:, None])
    volume, table_rows = enclosed_volume(clean), []
    for tool, smooth in smoothers(noisy).items():
        module = MODULES.get(tool.split()[0])
        if module is not None and importlib.util.find_spec(module) is None:
            table_rows.append([tool, "not installed", "-", "-", "-"])
            continue
        began = cpu_seconds()
        mesh = clean.moved(smooth())
        seconds = cpu_seconds() - began
        table_rows.append([
            tool, seconds, enclosed_volume(mesh) / volume - 1, distance(mesh.points, clean) / edge,
            float(np.degrees(corner_angle(mesh.side_length).min())),
        ])  # fmt: skip
    return table_rows


def print_scans(names: list[str]) -> None:
    print_table(
        "Scans to rest by default options (energy / 4 pi - 1; `near`: below 0.001)",
        ["scan", "faces", "smallest angle", "steps, near", "s, near", "steps", "s", "end", "stopped because"],
        scans(names or list(SCANS)),
    )


def print_peers() -> None:
    print_table(
        "Ellipsoid (1, 1, 2) to 1.01 x 4 pi, each by its own energy",
        ["faces", "tool", "steps", "s", "energy / 4 pi - 1"],
        beside_evolver(),
    )
    if (MESHES / "spot.obj").is_file():
        print_table(
            "Noise of a tenth of an edge on the scan `spot`: distance to the clean surface, in edges",
            ["tool", "s", "volume change", "distance", "smallest angle"],
            smoothing("spot"),
        )
