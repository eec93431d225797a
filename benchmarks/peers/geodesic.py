"""Distances beside the peers: exact, heat, fast marching; set-up, solve, peak memory.

`python -m benchmarks.peers.geodesic [--quick] [exact growth heat fast-marching errors]` prints tables.
Ratios are the peer's CPU seconds over ours, larger is better; each pair runs in turn in one process, one
thread each. CPU rather than wall time, so that a busy machine does not blur the ratio.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import potpourri3d
from pygeodesic import geodesic as pygeodesic

from benchmarks.common import measure, mesh_sequences
from ddgcli.algorithms.delaunay.triangulation import flip_to_delaunay
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.fast_marching import fast_marching_distance, fast_marching_stencils
from ddgcli.algorithms.geodesics.heat import HeatSolver
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh

QUICK_RUN = "--quick" in sys.argv
SOURCE = 0


@dataclass(frozen=True)
class Timing:
    """CPU seconds and what the call returned."""

    seconds: float
    value: Any


def fresh(mesh: TriangleMesh) -> TriangleMesh:
    """The same mesh with nothing cached, as the peers get it."""
    return TriangleMesh.from_arrays(mesh.points, mesh.faces)


def error(distance: np.ndarray, truth: np.ndarray) -> float:
    return float(np.abs(distance - truth).mean() / truth.mean())


def meshes() -> dict[str, TriangleMesh]:
    sizes = ("20k", "80k") if QUICK_RUN else ("20k", "80k", "320k")
    table = {}
    for size in sizes:
        n = mesh_sequences.FACES[size]
        table |= {
            f"sphere {size}": mesh_sequences.sphere(n),
            f"stretched {size}": mesh_sequences.stretched(n),
        }
        table[f"noisy {size}"] = mesh_sequences.noisy(n)
    return table


def cpu_timed(call: Callable[[], Any], repeat: int) -> tuple[float, Any]:
    """Least CPU seconds of `repeat` calls and the last value; both sides use one thread."""
    seconds, value = [], None
    for _ in range(repeat):
        began = measure.cpu_seconds()
        value = call()
        seconds.append(measure.cpu_seconds() - began)
    return min(seconds), value


def pair(ours: Callable[[], Any], theirs: Callable[[], Any], repeat: int) -> tuple[Timing, Timing]:
    """Both in turn, `repeat` times; the least of each."""
    rounds = [(cpu_timed(ours, 1), cpu_timed(theirs, 1)) for _ in range(repeat)]
    return (
        Timing(min(a[0] for a, _ in rounds), rounds[-1][0][1]),
        Timing(min(b[0] for _, b in rounds), rounds[-1][1][1]),
    )


def bench_exact() -> None:
    table = {name: mesh_sequences.real(name) for name in ("spot.obj", "goathead.obj", "koala.obj")}
    if not QUICK_RUN:
        table["st_helens_terrain.ply"] = mesh_sequences.real("st_helens_terrain.ply")
    targets = {"spot.obj": 1, "goathead.obj": 1, "sphere 80k": 5, "sphere 320k": 10, "koala.obj": 3,
               "st_helens_terrain.ply": 3}  # fmt: skip
    rows = []
    for name, mesh in (table | meshes()).items():
        results = {}

        def ours(mesh: TriangleMesh = mesh, results: dict = results) -> None:
            results["ours"] = exact_distance(fresh(mesh), SOURCE)

        def theirs(mesh: TriangleMesh = mesh, results: dict = results) -> None:
            solver = pygeodesic.PyGeodesicAlgorithmExact(mesh.points, mesh.faces)
            results["theirs"] = solver.geodesicDistances(np.array([SOURCE]))[0]

        repeat = 7 if mesh.n_faces < 30_000 else 2 if mesh.n_faces < 150_000 else 1
        a, b = pair(ours, theirs, repeat)
        peer = results["theirs"]
        difference = float(np.abs(results["ours"].distance - peer).max() / peer.max())
        rows.append(
            [name, mesh.n_faces, a.seconds, b.seconds, b.seconds / a.seconds, targets.get(name, "-"),
             results["ours"].windows / mesh.n_vertices, difference,
             measure.peak_mib(ours), measure.peak_mib(theirs)]
        )  # fmt: skip
    measure.print_table(
        "exact, construction and first query, against pygeodesic",
        ["mesh", "faces", "ours s", "peer s", "ratio", "target", "windows/vertex", "largest difference",
         "our MiB", "peer MiB"],
        rows,
    )  # fmt: skip


def bench_growth() -> None:
    """What exact distances take as meshes get finer, ours alone; the exponents are those of the last step."""
    sizes = ("20k", "80k", "320k") if QUICK_RUN else ("20k", "80k", "320k", "1.3M")
    names = ("sphere", "stretched", "noisy", "sheared_torus")
    kinds = {name.replace("_", " "): getattr(mesh_sequences, name) for name in names}
    rows = []
    for kind, make in kinds.items():
        last = None
        for size in sizes if kind != "sheared torus" else sizes[:3]:
            row = _growth(f"{kind} {size}", make(mesh_sequences.FACES[size]), last)
            rows.append(row)
            last = row
        make.cache_clear()
    last = None
    for name in ("koala.obj", "koala_loop1.ply"):  # the same surface, about, with four times the faces
        last = _growth(name, mesh_sequences.real(name), last)
        rows.append(last)
    rows.append(_growth("st_helens_terrain.ply", mesh_sequences.real("st_helens_terrain.ply"), None))
    measure.print_table(
        "exact, as meshes get finer (a bundle counts as one window)",
        ["mesh", "faces", "windows/vertex", "seconds", "MiB", "exponent of seconds", "of windows"],
        rows,
    )


def _growth(name: str, mesh: TriangleMesh, last: list[Any] | None) -> list[Any]:
    mesh = fresh(mesh)
    results = {}

    def ours() -> None:
        results["windows"] = exact_distance(fresh(mesh), SOURCE).windows

    seconds, _ = cpu_timed(ours, 3 if mesh.n_faces < 100_000 else 1)
    row = [
        name,
        mesh.n_faces,
        results["windows"] / mesh.n_vertices,
        seconds,
        measure.peak_mib(ours),
        "-",
        "-",
    ]
    if last is not None:
        finer = np.log(mesh.n_faces / last[1])
        row[5], row[6] = np.log(seconds / last[3]) / finer, 1 + np.log(row[2] / last[2]) / finer
    return row


def bench_heat() -> None:
    rows = []
    for name, mesh in meshes().items():
        if mesh.n_faces < 50_000 and not QUICK_RUN:
            continue

        def ours(mesh: TriangleMesh = mesh) -> HeatSolver:
            solver = HeatSolver(flip_to_delaunay(fresh(mesh)).mesh)
            _ = solver.poisson
            return solver

        def theirs(mesh: TriangleMesh = mesh) -> Any:
            return potpourri3d.MeshHeatMethodDistanceSolver(mesh.points, mesh.faces, use_robust=True)

        a, b = pair(ours, theirs, 3)
        truth = fast_marching_distance(mesh, SOURCE).distance
        solve, peer_solve = pair(
            lambda s=a.value: s.distance(SOURCE).distance,
            lambda s=b.value: np.asarray(s.compute_distance(SOURCE)),
            5,
        )
        rows.append(
            [name, mesh.n_faces, a.seconds, b.seconds, b.seconds / a.seconds,
             solve.seconds, peer_solve.seconds,
             peer_solve.seconds / solve.seconds, error(solve.value, truth), error(peer_solve.value, truth),
             a.value._heat.solver, measure.peak_mib(ours), measure.peak_mib(theirs)]
        )  # fmt: skip
    measure.print_table(
        "heat, against potpourri3d's robust solver (targets: set-up 2 with CHOLMOD, 1 without; solve 1)",
        ["mesh", "faces", "our set-up s", "peer set-up s", "ratio", "our solve s", "peer solve s", "ratio",
         "our error", "peer error", "factored by", "our MiB", "peer MiB"],
        rows,
    )  # fmt: skip


def bench_fast_marching() -> None:
    rows = []
    table = {name: mesh_sequences.real(name) for name in ("spot.obj", "koala.obj")} | meshes()
    for name, mesh in table.items():

        def ours(mesh: TriangleMesh = mesh) -> Any:
            return fast_marching_stencils(fresh(mesh))

        def theirs(mesh: TriangleMesh = mesh) -> Any:
            return potpourri3d.MeshFastMarchingDistanceSolver(mesh.points, mesh.faces)

        repeat = 5 if mesh.n_faces < 100_000 else 3
        a, b = pair(ours, theirs, repeat)
        solve, peer_solve = pair(
            lambda m=mesh, s=a.value: fast_marching_distance(m, SOURCE, stencils=s).distance,
            lambda s=b.value: np.asarray(s.compute_distance([[(SOURCE, [])]])),
            repeat,
        )
        truth = exact_distance(mesh, SOURCE).distance if mesh.n_faces <= 100_000 else None
        whole = (b.seconds + peer_solve.seconds) / (a.seconds + solve.seconds)
        rows.append(
            [name, mesh.n_faces, a.seconds, b.seconds, solve.seconds, peer_solve.seconds,
             peer_solve.seconds / solve.seconds, whole,
             error(solve.value, truth) if truth is not None else "-",
             error(peer_solve.value, truth) if truth is not None else "-"]
        )  # fmt: skip
    measure.print_table(
        "fast marching, against potpourri3d (target: ratio 0.5 or more)",
        ["mesh", "faces", "our set-up s", "peer set-up s", "our solve s", "peer solve s", "solve ratio",
         "ratio of the whole", "our error", "peer error"],
        rows,
    )  # fmt: skip


def jittered_torus(faces: int) -> TriangleMesh:
    """Torus R = 1, r = 0.4 from a grid whose points are moved by a quarter of a cell."""
    nu = int(np.sqrt(faces))
    u, v, cells = shapes.wrapped_grid(nu, nu // 2, wrap_u=True, wrap_v=True)
    shift = np.random.default_rng(0).uniform(-0.25, 0.25, (2, len(u)))
    u, v = 2 * np.pi * (u + shift[0] / nu), 2 * np.pi * (v + 2 * shift[1] / nu)
    r = 1 + 0.4 * np.cos(v)
    return TriangleMesh.from_arrays(np.stack([r * np.cos(u), r * np.sin(u), 0.4 * np.sin(v)], axis=1), cells)


def heat(mesh: TriangleMesh, **options: Any) -> np.ndarray:
    return HeatSolver(flip_to_delaunay(mesh).mesh, **options).distance(SOURCE).distance


def bench_errors() -> None:
    """Mean error over mean distance against the exact distance, as meshes get finer."""
    methods = {
        "fast marching (round fronts)": lambda m: fast_marching_distance(m, SOURCE).distance,
        "fast marching, straight fronts": lambda m: fast_marching_distance(m, SOURCE, planar=True).distance,
        "heat, as published (t = h^2)": heat,
        "heat, `--heat-refine 1`": lambda m: heat(m, refine=1),
        "heat, `--heat-refine 1 --heat-time 4`": lambda m: heat(m, refine=1, time_factor=4.0),
        "potpourri3d, heat": lambda m: potpourri3d.MeshHeatMethodDistanceSolver(
            m.points, m.faces, use_robust=True
        ).compute_distance(SOURCE),
        "potpourri3d, fast marching": lambda m: potpourri3d.MeshFastMarchingDistanceSolver(
            m.points, m.faces
        ).compute_distance([[(SOURCE, [])]]),
    }
    sizes = (5_000, 20_000) if QUICK_RUN else (5_000, 20_000, 80_000)
    table = {f"sphere {n}": mesh_sequences.sphere(n) for n in sizes} | {
        f"torus {n}": jittered_torus(n) for n in sizes
    }
    truths = {name: exact_distance(mesh, SOURCE).distance for name, mesh in table.items()}
    rows = [
        [label, *(f"{100 * error(np.asarray(method(m)), truths[name]):.2g} %" for name, m in table.items())]
        for label, method in methods.items()
    ]
    measure.print_table("mean error over mean distance", ["method", *table], rows)


TOPICS = {
    "exact": bench_exact,
    "growth": bench_growth,
    "heat": bench_heat,
    "fast-marching": bench_fast_marching,
    "errors": bench_errors,
}

# whole commands, timed as a user starts them
COMMANDS = (
    "geodesic bad_torus.ply --source 0",
    "geodesic bad_torus.ply --source 0 --method heat",
)


if __name__ == "__main__":
    print(measure.machine())
    topics = [word for word in sys.argv[1:] if not word.startswith("-")] or list(TOPICS)
    for topic in topics:
        TOPICS[topic]()
    measure.print_commands(*COMMANDS)
