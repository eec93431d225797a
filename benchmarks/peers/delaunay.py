"""Intrinsic Delaunay triangulations beside libigl and robust_laplacian; overlay and refinement by size.

OMP_NUM_THREADS=1 python -m benchmarks.peers.delaunay [--sizes 20k 80k 320k] [--repeat 5] [--only flips]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

import igl
import numpy as np
import robust_laplacian

from benchmarks.common import measure, mesh_sequences
from ddgcli.algorithms.delaunay.common_subdivision import BaseTriangulation, common_subdivision
from ddgcli.algorithms.delaunay.point_location import PointMap
from ddgcli.algorithms.delaunay.refine import refine
from ddgcli.algorithms.delaunay.triangulation import IntrinsicDelaunay, flip_to_delaunay
from ddgcli.errors import MeshError
from ddgcli.geometry.intrinsic import corner_angle
from ddgcli.geometry.surface_points import SurfacePoints
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh.topology import Topology
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import lumped_mass, stiffness

REAL_MESHES = (
    "spot.obj",
    "boot.obj",
    "nefertiti-lowres.obj",
    "counter.unitsmm.STL",
    "koala.obj",
    "koala_loop1.ply",
)
MESH_CLASSES = {
    "stretched": mesh_sequences.stretched,
    "sheared torus": mesh_sequences.sheared_torus,
    "irregular": mesh_sequences.sphere,
}
# ours over libigl must not exceed this; robust_laplacian over ours must reach FEATURE_SHARE from 80k faces
TARGETS = {"stretched": 1.6, "sheared torus": 3.0, "irregular": 1.0, "real": 1.0}
FEATURE_SHARE = 2.5


def flips_row(name: str, mesh_class: str, mesh: TriangleMesh, repeat: int) -> list:
    """Flips and assembly from arrays to matrices, ours and the peers' in turn."""

    def ours():
        fresh = TriangleMesh.from_arrays(
            mesh.points, mesh.faces
        )  # without the cached topology of an earlier call
        flipped = flip_to_delaunay(fresh)
        return stiffness(flipped.mesh), lumped_mass(flipped.mesh), flipped

    seconds = measure.interleaved(
        {
            "ours": ours,
            "igl": lambda: igl.intrinsic_delaunay_cotmatrix(mesh.points, mesh.faces),
            "robust": lambda: robust_laplacian.mesh_laplacian(mesh.points, mesh.faces, mollify_factor=0.0),
        },
        repeat,
    )
    matrix, _, flipped = seconds["ours"].value
    theirs = seconds["igl"].value
    theirs = -(theirs[0] if isinstance(theirs, tuple) else theirs)
    difference = abs(matrix - theirs).max() / abs(theirs).max()
    own = seconds["ours"].median
    behind, ahead = own / seconds["igl"].median, seconds["robust"].median / own
    counts = [flipped.flips, flipped.rounds]
    led = mesh_class in ("real", "stretched") and mesh.n_faces >= 80_000
    goals = f"<= {TARGETS[mesh_class]:g}" + (f", >= {FEATURE_SHARE:g}" if led else "")
    return [name, mesh.n_faces, *counts, own, behind, ahead, goals, difference]


def growth(rows: list[list], column: int = -1, *, cost: Callable = lambda n: n * math.log(n)) -> None:
    """Add to each row the growth of the seconds in a column since the first row, beside that of a cost.

    Of the n in the second column; n log n by default.
    """
    seconds = [row[column] for row in rows]
    for row, cost_seconds in zip(rows, seconds):
        row.append(round(cost_seconds / seconds[0] / (cost(row[1]) / cost(rows[0][1])), 2))


def overlay_row(flipped: IntrinsicDelaunay, base: BaseTriangulation, repeat: int) -> list:
    """The common subdivision, computed after the flips without the caches of an earlier one.

    Beside it a plain gather of as many numbers as it has faces, in random order: linear work, so that what
    its cost grows by is the machine's. And the seconds without those that the system hands out memory in.
    """

    def fresh_flips() -> tuple[IntrinsicDelaunay, BaseTriangulation]:
        topology = base.mesh.topology
        mesh = TriangleMesh(base.mesh.points, Topology(topology.faces, topology.n_vertices, topology.gluing))
        source = mesh if base.mesh is base.input else base.input
        again = BaseTriangulation(source, mesh, base.input_face, base.interpolation)
        return flip_to_delaunay(mesh, track=True), again

    timing = measure.timed(common_subdivision, repeat, prepare=fresh_flips)
    cut, values = timing.value, np.random.default_rng(0).random(timing.value.mesh.n_faces)
    order = np.random.default_rng(1).permutation(len(values))
    gather = measure.timed(lambda: values.take(order), repeat).median
    counts = [flipped.mesh.n_faces, cut.mesh.n_faces, int((cut.vertex_kind == 2).sum())]
    own = timing.median - timing.kernel
    return [*counts, 1e9 * timing.median / counts[1], timing.median, own, gather]


def overlay_table(title: str, rows: list[list]) -> None:
    """Print rows of overlays with their growth and that of the plain gathers beside them."""
    growth(rows, 4)
    growth(rows, 5)
    growth(rows, 6, cost=lambda n: n)
    header = ["faces", "faces of the overlay", "crossings", "ns a face"]
    header += ["seconds", "without memory", "gather"]
    grown = ["growth / n log n", "without memory: growth / n log n", "gather: growth / n"]
    measure.print_table(title, header + grown, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", nargs="+", default=["20k", "80k", "320k"])
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--only", choices=["flips", "overlay", "refine", "shared"])
    options = parser.parse_args()
    sizes = [mesh_sequences.FACES[size] for size in options.sizes]
    print(measure.machine())

    if options.only in (None, "flips"):
        rows = [
            flips_row(f"{mesh_class} {size}", mesh_class, make(mesh_sequences.FACES[size]), options.repeat)
            for mesh_class, make in MESH_CLASSES.items()
            for size in options.sizes
        ]
        rows += [flips_row(name, "real", mesh_sequences.real(name), options.repeat) for name in REAL_MESHES]
        measure.print_table(
            "Flips and assembly (seconds; ours over libigl; robust_laplacian over ours)",
            ["mesh", "faces", "flips", "batches", "ours", "/ libigl", "robust /", "target", "difference"],
            rows,
        )
    if options.only in (None, "overlay"):
        for mesh_class in ("stretched", "sheared torus"):
            rows = []
            for mesh in map(MESH_CLASSES[mesh_class], sizes):
                rows.append(
                    overlay_row(
                        flip_to_delaunay(mesh, track=True), BaseTriangulation.itself(mesh), options.repeat
                    )
                )
            overlay_table(f"Common subdivision, {mesh_class} (no peer binds it)", rows)
    if options.only in (None, "refine"):
        refinement_tables(sizes, options.repeat)
    if options.only in (None, "shared"):
        shared_table()


def shared_table() -> None:
    """Refinement of every shared mesh that is an oriented surface, and the overlay after it."""
    rows, refused = [], []
    for path in sorted(mesh_sequences.SHARED_MESHES.iterdir()):
        if not path.is_file() or path.suffix in (".py", ".md"):
            continue
        source = read_mesh(str(path))
        if source.kind != "surface":
            continue
        try:
            timing = measure.timed(lambda: refine(source.mesh, 25.0), 1, warm_up=False)  # noqa: B023
        except MeshError as error:
            refused.append(f"{path.stem}: {error}")
            continue
        refined = timing.value
        angle = math.degrees(corner_angle(refined.triangulation.mesh.side_length).min())
        cut = common_subdivision(refined.triangulation, refined.base)
        counts = [source.mesh.n_vertices, len(refined.steiner), refined.batches]
        left = [refined.excepted_faces, refined.unreached_faces]
        overlay = [cut.mesh.n_faces, cut.length_residual]
        rows.append([path.stem, *counts, angle, *left, *overlay, timing.median])
    header = ["mesh", "vertices", "Steiner points", "batches", "smallest angle", "excepted", "unreached"]
    header += ["faces of the overlay", "length residual", "seconds"]
    measure.print_table("Refinement to 25 degrees of the shared meshes", header, rows)
    print("\n".join(refused))


def refinement_tables(sizes: list[int], repeat: int) -> None:
    """Refinement, the overlay after it, and points carried to the refined triangulation and back."""
    refining, cutting, carrying = [], [], []
    for size in sizes:
        mesh = mesh_sequences.stretched(size)
        timing = measure.timed(lambda: refine(mesh, 25.0), 1, warm_up=False)  # noqa: B023
        refined = timing.value
        after = refined.triangulation.mesh
        refining.append([mesh.n_faces, after.n_faces, refined.batches, timing.median])
        cutting.append(overlay_row(refined.triangulation, refined.base, repeat))
        cut = common_subdivision(refined.triangulation, refined.base)
        carry = PointMap(cut)
        corner = np.random.default_rng(0).dirichlet([1, 1, 1], size=2 * mesh.n_faces)
        points = SurfacePoints(np.repeat(np.arange(mesh.n_faces), 2), corner)
        timing = measure.timed(lambda: carry.to_input(carry.to_intrinsic(points)), 1)  # noqa: B023
        carrying.append([mesh.n_faces, len(points), timing.median])
    for rows in (refining, carrying):
        growth(rows)
    header = ["faces", "faces after", "batches", "seconds", "growth / n log n"]
    measure.print_table("Refinement to 25 degrees, stretched sphere (no peer binds it)", header, refining)
    overlay_table("Common subdivision after that refinement", cutting)
    header = ["faces", "points", "seconds", "growth / n log n"]
    measure.print_table("Points carried there and back", header, carrying)


# whole commands, timed as a user starts them
COMMANDS = (
    "delaunay bad_torus.ply",
    "delaunay bad_torus.ply --refine 25",
)


if __name__ == "__main__":
    main()
    measure.print_commands(*COMMANDS)
