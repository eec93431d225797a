"""How fast is curvature beside libigl and pymeshlab, and how close to the truth?

    python -m benchmarks.peers.curvature [--quick]

Each call starts from arrays (ddgcli builds its topology too), as the peers do. `ratio` is ours /
peer, `target` what it must not exceed. Errors are root mean squares relative to that of the truth.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import igl
import numpy as np

from benchmarks.common import measure, mesh_sequences
from ddgcli.algorithms.curvature import measures as exact
from ddgcli.algorithms.curvature import star
from ddgcli.algorithms.curvature.frames import area_normals, unit_normals
from ddgcli.algorithms.curvature.quadric import quadric
from ddgcli.algorithms.curvature.surface_curvature import measure_curvature as measure_all
from ddgcli.geometry.extrinsic import dihedral_angle
from ddgcli.geometry.faces import Faces
from ddgcli.mesh import shapes
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from tests import curvature_truths as truths


def fresh(mesh: TriangleMesh) -> TriangleMesh:
    """The same arrays with nothing computed yet."""
    return TriangleMesh(mesh.points, Topology(mesh.faces, mesh.n_vertices))


def our_calls(mesh: TriangleMesh) -> dict[str, Callable]:
    def angle_defect():
        return exact.angle_defect(fresh(mesh))

    def cotan_mean():
        faces = Faces.of(fresh(mesh))
        closed = fresh(mesh).topology
        return exact.vector_of(faces, closed), exact.area_of(faces)

    def cotan():
        m = fresh(mesh)
        f = Faces.of(m)
        vector, defect = exact.vector_of(f, m.topology), exact.defect_of(f, m.topology)
        return star.cotan(f, m.topology, unit_normals(f), exact.area_of(f), defect, vector)

    def normal_cycle():
        m = fresh(mesh)
        f = Faces.of(m)
        angle, defect = dihedral_angle(m, f.normal.T), exact.defect_of(f, m.topology)
        return star.normal_cycle(f, m.topology.edges, unit_normals(f), exact.area_of(f), defect, angle)

    def corrected():
        f = Faces.of(fresh(mesh))
        return star.corrected(f, unit_normals(f))

    def fits():
        m = fresh(mesh)
        f = Faces.of(m)
        return quadric(m, f, area_normals(f))

    return {
        "angle defect": angle_defect, "cotan H": cotan_mean, "cotan": cotan,
        "normal-cycle": normal_cycle, "corrected": corrected, "quadric": fits,
    }  # fmt: skip


def peer_calls(mesh: TriangleMesh) -> dict[str, Callable]:
    p, f = mesh.points, mesh.faces

    def cotan_mean():
        return igl.cotmatrix(p, f) @ p, igl.massmatrix(p, f, igl.MASSMATRIX_TYPE_VORONOI)

    def principal():
        return igl.principal_curvature(p, f, radius=2)

    return {
        "angle defect": lambda: igl.gaussian_curvature(p, f), "cotan H": cotan_mean, "principal": principal,
    }  # fmt: skip


# name of ours, of the peer's call, and the ratio not to exceed
PAIRS = [
    ("angle defect", "angle defect", 1.0), ("cotan H", "cotan H", 1.0), ("cotan", "principal", 0.25),
    ("normal-cycle", "principal", 0.25), ("corrected", "principal", 0.25), ("quadric", "principal", 1.0),
]  # fmt: skip


def speed(sizes: list[str]) -> None:
    rows = []
    for size in sizes:
        mesh = mesh_sequences.sphere(mesh_sequences.FACES[size])
        ours, peers = our_calls(mesh), peer_calls(mesh)
        calls = {f"ours {n}": c for n, c in ours.items()} | {f"igl {n}": c for n, c in peers.items()}
        timings = measure.interleaved(calls, repeat=5 if size == "20k" else 3)
        for name, peer, target in PAIRS:
            a, b = timings[f"ours {name}"].lowest, timings[f"igl {peer}"].lowest
            memory = measure.peak_mib(ours[name]), measure.peak_mib(peers[peer])
            verdict = "met" if a / b <= target else "MISSED"
            rows.append([size, name, f"igl {peer}", a, b, a / b, target, verdict, *memory])
    header = ["faces", "ours", "peer", "ours s", "peer s", "ratio", "target", "", "ours MiB", "peer MiB"]
    measure.print_table("Curvature: time (least of the runs) and growth of peak memory", header, rows)


def relative(values: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((values - truth) ** 2) / np.mean(truth**2)))


AXES = (1.5, 1.0, 0.6)
SURFACES = {
    "irregular sphere 20k": (lambda: shapes.random_sphere(10_000), truths.ellipsoid_truth),
    "regular ellipsoid 20k": (
        lambda: (lambda m: m.moved(m.points * np.array(AXES)))(shapes.icosphere(5)),
        lambda p: truths.ellipsoid_truth(p, AXES),
    ),
    "irregular ellipsoid 20k": (
        lambda: truths.irregular_ellipsoid(10_000, AXES),
        lambda p: truths.ellipsoid_truth(p, AXES),
    ),
    "regular torus 20k": (lambda: shapes.torus(160, 64), truths.torus_truth),
    "irregular torus 20k": (lambda: truths.irregular_torus(160, 64), truths.torus_truth),
    "torus 40 x 500": (lambda: truths.irregular_torus(40, 500, jitter=0.0), truths.torus_truth),
    "torus 500 x 40": (lambda: truths.irregular_torus(500, 40, jitter=0.0), truths.torus_truth),
    "sheared torus 20k": (lambda: mesh_sequences.sheared_torus(20_000), truths.torus_truth),
    "noisy ellipsoid 20k (1 % of an edge)": (
        lambda: noisy(truths.irregular_ellipsoid(10_000, AXES), 0.01),
        lambda p: truths.ellipsoid_truth(truths.irregular_ellipsoid(10_000, AXES).points, AXES),
    ),
}


def noisy(mesh: TriangleMesh, level: float) -> TriangleMesh:
    noise = np.random.default_rng(0).normal(size=mesh.points.shape)
    return mesh.moved(mesh.points + level * mesh.side_length.mean() * noise)


def accuracy() -> None:
    rows = []
    for name, (build, truth_at) in SURFACES.items():
        mesh = build()
        truth = truth_at(mesh.points)
        apart = truth.k_max - truth.k_min > 0.1 * np.abs(truth.k_max).max()
        d_max, d_min, k_max, k_min, *_ = igl.principal_curvature(mesh.points, mesh.faces, radius=2)
        swap = (k_max < k_min)[:, None]
        answers = {
            "igl radius 2": (np.minimum(k_min, k_max), np.maximum(k_min, k_max), np.where(swap, d_min, d_max))
        }
        for scheme in ("quadric", "corrected", "normal-cycle", "cotan"):
            v = measure_all(mesh, scheme).vertex
            names = ("principal_curvature_min", "principal_curvature_max", "principal_direction_max")
            answers[scheme] = tuple(v[n] for n in names)
        for scheme, (low, high, direction) in answers.items():
            cosine = np.abs(np.einsum("ij,ij->i", direction, truth.d_max))[apart]
            angle = np.degrees(np.median(np.arccos(np.clip(cosine, 0, 1)))) if apart.any() else "-"
            mean, gauss = relative((low + high) / 2, truth.mean), relative(low * high, truth.gauss)
            rows.append([name, scheme, gauss, mean, angle])
    header = ["surface", "scheme", "error of k1 k2", "error of H", "direction, degrees (median)"]
    measure.print_table("Curvature: errors at the vertices", header, rows)


def pymeshlab_speed() -> None:
    try:
        import pymeshlab
    except ImportError:
        return
    mesh = mesh_sequences.sphere(mesh_sequences.FACES["80k"])
    ours = our_calls(mesh)["quadric"]

    def theirs():
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(mesh.points, mesh.faces))
        meshes.compute_curvature_principal_directions_per_vertex(method="Quadric Fitting")

    timings = measure.interleaved({"ours": ours, "peer": theirs}, repeat=3)
    a, b = timings["ours"].lowest, timings["peer"].lowest
    measure.print_table(
        "Beside pymeshlab's quadric fitting, 80k faces", ["ours s", "peer s", "ratio"], [[a, b, a / b]]
    )


def balls() -> None:
    """Measures in balls; trimesh's are the angle defect and the mean curvature of whole or clipped edges."""
    from trimesh import Trimesh, curvature

    rows = []
    for n, edges in ((5_000, 4.0), (10_000, 3.0)):
        mesh = shapes.random_sphere(n)
        radius = edges * mesh.side_length.mean()

        def theirs(mesh: TriangleMesh = mesh, radius: float = radius):
            peer = Trimesh(mesh.points, mesh.faces, process=False)
            curvature.discrete_gaussian_curvature_measure(peer, peer.vertices, radius)
            return curvature.discrete_mean_curvature_measure(peer, peer.vertices, radius)

        calls = {
            scheme: lambda scheme=scheme, mesh=mesh, radius=radius: measure_all(fresh(mesh), scheme, radius)
            for scheme in ("corrected", "normal-cycle")
        }
        timings = measure.interleaved({"trimesh": theirs} | calls, repeat=3)
        peer = timings["trimesh"].lowest
        for scheme in calls:
            least = timings[scheme].lowest
            verdict = "met" if least <= peer else "MISSED"
            rows.append([mesh.n_faces, edges, scheme, least, peer, least / peer, 1.0, verdict])
    header = ["faces", "radius / edge", "scheme", "ours s", "trimesh s", "ratio", "target", ""]
    measure.print_table("Curvature in balls, whole measurement: time (least of the runs)", header, rows)


# whole commands, timed as a user starts them
COMMANDS = (
    "curvature ellipsoid.ply",
    "curvature frame.off --scheme corrected",
)


if __name__ == "__main__":
    print(measure.machine())
    quick = "--quick" in sys.argv
    speed(["20k"] if quick else ["20k", "80k", "320k"])
    balls()
    accuracy()
    if not quick:
        pymeshlab_speed()
    measure.print_commands(*COMMANDS)
