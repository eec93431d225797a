"""Straightest lines, geodesics by flips, logarithmic map and vector transport beside potpourri3d.

python -m benchmarks.peers.trace [faces ...]      default 20000 80000 320000

A first logarithmic map or transport includes the set-up on both sides, a further one uses what both can
compute once for a mesh (stencils of fast marching, tables, factors). The tables also contain errors, because
those of the methods differ by a factor of ten: `heat` is the method of potpourri3d's `VectorHeat`, the exact
map is the default.

Two ratios to potpourri3d stay above 1 at 20,000 faces. Of a further transport, the triangular solves with
CHOLMOD's supernodal factor alone take as long as the whole call of potpourri3d. Solves with a simplicial
factor take 0.5 to 0.7 of that, but the factorisation 2.5 times as long at 20,000 faces and 4 times at 80,000.
Straight paths follow from flips one after the other, in Python: the table states their number, and the
seconds of the search for edge paths, which is scipy's.
"""

from __future__ import annotations

import sys
from functools import partial

import numpy as np
import potpourri3d as pp3d

from benchmarks.common.measure import interleaved, machine, peak_mib, print_commands, print_table
from benchmarks.common.mesh_sequences import noisy, sphere, stretched
from ddgcli.algorithms.geodesics.exact.exact_distance import exact_distance
from ddgcli.algorithms.geodesics.exact.tables import window_tables
from ddgcli.algorithms.geodesics.fast_marching import fast_marching_distance, fast_marching_stencils
from ddgcli.algorithms.geodesics.flipout import Straightener
from ddgcli.algorithms.geodesics.flippable_mesh import edge_path
from ddgcli.algorithms.geodesics.heat import HeatSolver
from ddgcli.algorithms.geodesics.sources import Sources
from ddgcli.algorithms.tangent_fields.heat_log_map import heat_log_map, vertex_gradient
from ddgcli.algorithms.tangent_fields.log_map import log_map
from ddgcli.algorithms.tangent_fields.polar_coordinates import fast_marching_log_map
from ddgcli.algorithms.tangent_fields.vector_heat import VectorHeat
from ddgcli.algorithms.tracing.trace import Tracer
from ddgcli.geometry import unfolding
from ddgcli.geometry.face_frames import surface_position, to_face_frame, to_space
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.connection import from_vertex_frames, to_vertex_frames

LINES = 10_000


def drop_unfolding(mesh):
    """Drop the cached layout of a mesh, so that its set-up can be timed."""
    unfolding._UNFOLDING_TYPE.pop(mesh, None)
    unfolding._FANS.pop(mesh, None)


def starts(mesh, k=LINES, seed=0):
    """Random faces, points, and unit directions in the planes of the faces."""
    rng = np.random.default_rng(seed)
    face, barycentric = rng.integers(0, mesh.n_faces, k), rng.dirichlet([1, 1, 1], k)
    direction = to_space(mesh, face, to_face_frame(mesh, face, rng.normal(size=(k, 3))))
    return face, barycentric, direction / np.linalg.norm(direction, axis=1, keepdims=True)


def one_by_one(peer, starts):
    return [peer.trace_geodesic_from_face(f, b, d) for f, b, d in starts]


def bench_traces(faces):
    rows = []
    for name, make in (("sphere", sphere), ("stretched", stretched), ("noisy", noisy)):
        mesh = make(faces)
        face, barycentric, direction = starts(mesh)
        length = np.full(LINES, 1.0)
        tracer, peer = Tracer(mesh), pp3d.GeodesicTracer(mesh.points, mesh.faces)
        pairs = list(zip(face.tolist(), barycentric, direction))

        ours = partial(tracer.trace, face, barycentric, direction, length)
        theirs = partial(one_by_one, peer, pairs)
        t = interleaved({"ours": ours, "paths": partial(ours, record=True), "pp3d": theirs}, repeat=3)
        ends = surface_position(mesh, t["ours"].value.face, t["ours"].value.barycentric)
        gap = np.linalg.norm(ends - np.array([p[-1] for p in t["pp3d"].value]), axis=1)
        a, b, c = t["ours"].median, t["paths"].median, t["pp3d"].median
        rows.append(
            [name, mesh.n_faces, float(t["ours"].value.crossings.mean()), a, b, c, c / a, c / b, ">= 5"]
        )
        rows[-1] += [float(np.median(gap)), float(np.mean(gap < 1e-6)), peak_mib(ours)]
    header = [
        "mesh",
        "faces",
        "crossings",
        "ends s",
        "with paths s",
        "pp3d loop s",
        "ratio",
        "ratio with paths",
    ]
    header += ["target", "median gap", "within 1e-6", "MiB"]
    print_table(f"{LINES} straightest lines of length 1", header, rows)


def bench_vertex_traces(faces):
    """One line from every vertex, into the middle of one of its corners; the peer traces one by one."""
    mesh = sphere(faces)
    n = mesh.n_vertices
    side = np.empty(n, dtype=np.int64)
    side[mesh.faces.ravel()] = np.arange(3 * mesh.n_faces)
    face, barycentric = side // 3, np.eye(3)[side % 3]
    direction = mesh.points[mesh.faces[face]].mean(axis=1) - mesh.points
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    tracer, peer = Tracer(mesh), pp3d.GeodesicTracer(mesh.points, mesh.faces)
    calls = {
        "ours": lambda: tracer.trace(face, barycentric, direction, np.ones(n)),
        "pp3d": lambda: [peer.trace_geodesic_from_vertex(v, d) for v, d in enumerate(direction)],
    }
    t = interleaved(calls, repeat=1)
    times = t["ours"].median, t["pp3d"].median
    header = ["lines", "ours s", "pp3d loop s", "ours / pp3d"]
    print_table(
        "one straightest line of length 1 from every vertex", header, [[n, *times, times[0] / times[1]]]
    )


def bench_set_up(faces):
    mesh = sphere(faces)

    def ours():
        drop_unfolding(mesh)
        return Tracer(mesh).fans

    t = interleaved({"ours": ours, "pp3d": lambda: pp3d.GeodesicTracer(mesh.points, mesh.faces)}, repeat=3)
    ratio = t["pp3d"].median / t["ours"].median
    row = [mesh.n_faces, t["ours"].median, t["pp3d"].median, ratio]
    print_table("set-up of the tracer", ["faces", "ours s", "pp3d s", "ratio"], [row])


def sphere_log(mesh, source):
    """Truth on the unit sphere, as complex numbers in some frame, and the angle from the source."""
    p = mesh.points[source]
    e1 = np.cross(p, [0.3, 0.5, 0.8])
    e1 /= np.linalg.norm(e1)
    planar = mesh.points @ e1 + 1j * (mesh.points @ np.cross(p, e1))
    angle = np.arccos(np.clip(mesh.points @ p, -1, 1))
    return planar * angle / np.maximum(np.abs(planar), 1e-300), angle


def rms_error(coordinates, truth, near):
    z = coordinates[:, 0] + 1j * coordinates[:, 1]
    z = z * np.exp(1j * np.angle(np.vdot(z[near], truth[near])))
    return float(np.sqrt(np.mean(np.abs(z - truth)[near] ** 2)))


def bench_log_maps(faces):
    """First and further logarithmic maps of both, with their errors."""
    mesh = sphere(faces)
    truth, angle = sphere_log(mesh, 0)
    near = angle < 2.5
    sources, tables, stencils = Sources.at([0]), window_tables(mesh), fast_marching_stencils(mesh)
    solver = pp3d.MeshVectorHeatSolver(mesh.points, mesh.faces)

    def fresh():
        return TriangleMesh.from_arrays(mesh.points, mesh.faces)

    def exact(mesh, **shared):
        return log_map(mesh, exact_distance(mesh, sources, directions=True, **shared), sources).log_map

    def marched(mesh, **shared):
        return fast_marching_log_map(mesh, fast_marching_distance(mesh, sources, **shared), sources).log_map

    def by_heat(mesh, scalar=None, **shared):
        distance = (HeatSolver(mesh) if scalar is None else scalar).distance(sources).distance
        return heat_log_map(mesh, distance, sources, **shared).log_map

    factors = {"scalar": HeatSolver(mesh), "transport": VectorHeat(mesh), "slope": vertex_gradient(mesh)}

    def peer(strategy):
        return pp3d.MeshVectorHeatSolver(mesh.points, mesh.faces).compute_log_map(0, strategy=strategy)

    first = {"exact": lambda: exact(fresh()), "fast marching": lambda: marched(fresh())}
    first["heat"] = lambda: by_heat(fresh())
    further = {
        "exact": lambda: exact(mesh, tables=tables),
        "fast marching": lambda: marched(mesh, stencils=stencils),
        "heat": lambda: by_heat(mesh, **factors),
    }
    for strategy in ("VectorHeat", "AffineLocal"):
        if strategy == "VectorHeat" or faces < 50_000:  # the set-up of AffineLocal takes a minute
            first[f"pp3d {strategy}"] = partial(peer, strategy)
            further[f"pp3d {strategy}"] = partial(solver.compute_log_map, 0, strategy=strategy)
    t, again = interleaved(first, repeat=1), interleaved(further, repeat=3)
    rows = [
        [name, mesh.n_faces, t[name].median, again[name].median, rms_error(t[name].value, truth, near)]
        for name in first
    ]
    print_table(
        "logarithmic map on the sphere",
        ["method", "faces", "first, with set-up s", "each further s", "rms error"],
        rows,
    )


def bench_transport(faces):
    """First and further transports of one vector of both, with their errors."""
    mesh = sphere(faces)
    _, angle = sphere_log(mesh, 0)
    near = angle < 2.5
    peer = pp3d.MeshVectorHeatSolver(mesh.points, mesh.faces)
    vector = np.cross(mesh.points[0], [0.3, 0.5, 0.8])
    start = to_vertex_frames(mesh, np.tile(vector, (mesh.n_vertices, 1)))[[0]]
    x, y, _ = peer.get_tangent_frames()
    heat, at, components = VectorHeat(mesh), np.array([0]), [vector @ x[0], vector @ y[0]]
    calls = {
        "first": lambda: VectorHeat(TriangleMesh.from_arrays(mesh.points, mesh.faces)).transport(at, start),
        "first pp3d": lambda: pp3d.MeshVectorHeatSolver(mesh.points, mesh.faces).transport_tangent_vector(
            0, components
        ),
        "further": lambda: heat.transport(at, start),
        "further pp3d": lambda: peer.transport_tangent_vector(0, components),
    }
    delta = np.zeros(mesh.n_vertices, dtype=np.complex128)
    delta[at] = start
    calls["solve"] = lambda: heat.vector.solve(delta, refine=False)
    t = interleaved(calls, repeat=3)
    carried = truth_of_transport(mesh, vector)
    ours = from_vertex_frames(mesh, t["further"].value.vector)
    two = t["further pp3d"].value
    theirs = two[:, :1] * x + two[:, 1:] * y
    rows = [
        [name, mesh.n_faces, t[f"first{name}"].median, t[f"further{name}"].median,
         degrees(mesh, values, carried, near)]
        for name, values in (("", ours), (" pp3d", theirs))
    ]  # fmt: skip
    rows[0][0], rows[1][0] = "ours", "pp3d"
    ratios = [rows[0][k] / rows[1][k] for k in (2, 3, 4)]
    solve = [
        f"ours, triangular solves alone ({heat.vector.solver})",
        mesh.n_faces,
        "-",
        t["solve"].median,
        "-",
    ]
    print_table(
        "one vector spread by vector heat",
        ["", "faces", "first, with set-up s", "each further s", "mean error degrees"],
        [*rows, ["ours / pp3d", mesh.n_faces, *ratios], solve],
    )


def truth_of_transport(mesh, vector):
    p, q = mesh.points[0], mesh.points
    axis = np.cross(p, q)
    return (
        vector
        + np.cross(axis, vector)
        + np.cross(axis, np.cross(axis, vector)) / (1 + q @ p + 1e-300)[:, None]
    )


def degrees(mesh, a, b, near):
    """Mean angle between tangent vectors, seen along the normal of the sphere."""
    turn = np.arctan2(np.einsum("ij,ij->i", np.cross(b, a), mesh.points), np.einsum("ij,ij->i", a, b))
    return float(np.degrees(np.abs(turn[near])).mean())


def bench_flips(faces):
    mesh = sphere(faces)

    def set_up():
        drop_unfolding(mesh)
        return Straightener(mesh)

    timings = interleaved(
        {"ours": set_up, "pp3d": lambda: pp3d.EdgeFlipGeodesicSolver(mesh.points, mesh.faces)}, repeat=3
    )
    own, peer = timings["ours"].value, timings["pp3d"].value
    pairs = [(0, mesh.n_vertices // 2), (5, mesh.n_vertices // 3), (7, 100)]
    calls = {
        "ours": lambda: [own.curves([[a, b]], [False]).entries[0]["length"] for a, b in pairs],
        "pp3d": lambda: [peer.find_geodesic_path(a, b) for a, b in pairs],
        "edge paths": lambda: [edge_path(own.graph, [a, b], False) for a, b in pairs],
    }
    t = interleaved(calls, repeat=9)
    lengths = [float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum()) for p in t["pp3d"].value]
    worst = max(abs(a / b - 1) for a, b in zip(t["ours"].value, lengths))
    flips = sum(own.curves([[a, b]], [False]).entries[0]["flips"] for a, b in pairs)
    header = ["faces", "set-up ratio", "ours s", "of which edge paths s", "flips", "pp3d s", "ratio"]
    header += ["largest length difference"]
    set_ups = timings["pp3d"].median / timings["ours"].median
    ours, edges, theirs = (t[name].median for name in ("ours", "edge paths", "pp3d"))
    row = [mesh.n_faces, set_ups, ours, edges, flips, theirs, theirs / ours, worst]
    print_table("three paths pulled straight", header, [row])


def main():
    print(machine())
    for faces in [int(x) for x in sys.argv[1:]] or [20_000, 80_000, 320_000]:
        bench_traces(faces)
        bench_vertex_traces(faces)
        bench_set_up(faces)
        bench_log_maps(faces)
        bench_transport(faces)
        bench_flips(faces)


# whole commands, timed as a user starts them
COMMANDS = (
    "geodesic bad_torus.ply --source 0 --log-map",
    "geodesic bad_torus.ply --source 0 --path-to 100",
)


if __name__ == "__main__":
    main()
    print_commands(*COMMANDS)
