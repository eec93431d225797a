"""Intrinsic Delaunay triangulations beside libigl and robust_laplacian; overlay and refinement by size.

OMP_NUM_THREADS=1 python benchmarks/bench_delaunay.py [--sizes 20k 80k 320k] [--repeat 5] [--only flips]
"""

from __future__ import annotations

import argparse
import math

import igl
import ladder
import measure
import robust_laplacian

from ddgcli.algorithms.common_subdivision import Base, common_subdivision
from ddgcli.algorithms.delaunay import flip_to_delaunay
from ddgcli.algorithms.refine import refine
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.operators.laplacian import lumped_mass, stiffness

REAL = ("spot.obj", "boot.obj", "nefertiti-lowres.obj", "counter.unitsmm.STL", "koala.obj", "koala_loop1.ply")
FAMILIES = {"stretched": ladder.stretched, "sheared torus": ladder.sheared_torus, "irregular": ladder.sphere}
# ours over libigl must not exceed this; robust_laplacian over ours must reach LEAD from 80k faces
TARGETS = {"stretched": 1.6, "sheared torus": 3.0, "irregular": 1.0, "real": 1.0}
LEAD = 2.5


def flips_row(name: str, family: str, mesh: TriangleMesh, repeat: int) -> list:
    """Flips and assembly from arrays to matrices, ours and the peers' in turn."""

    def ours():
        fresh = TriangleMesh.from_arrays(mesh.points, mesh.faces)  # no topology kept from an earlier call
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
    led = family in ("real", "stretched") and mesh.n_faces >= 80_000
    goals = f"<= {TARGETS[family]:g}" + (f", >= {LEAD:g}" if led else "")
    return [name, mesh.n_faces, *counts, own, behind, ahead, goals, difference]


def growth(rows: list[list]) -> None:
    """Add to each row the growth of the cost beside n log n, from the row above."""
    for above, row in zip([None, *rows[:-1]], rows):
        if above is None:
            row.append("")
            continue
        n0, n1 = above[1], row[1]
        row.append(round(row[-1] / above[-2] / (n1 * math.log(n1) / (n0 * math.log(n0))), 2))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", nargs="+", default=["20k", "80k", "320k"])
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--only", choices=["flips", "overlay", "refine"])
    options = parser.parse_args()
    sizes = [ladder.FACES[size] for size in options.sizes]
    print(measure.machine())

    if options.only in (None, "flips"):
        rows = [
            flips_row(f"{family} {size}", family, make(ladder.FACES[size]), options.repeat)
            for family, make in FAMILIES.items()
            for size in options.sizes
        ]
        rows += [flips_row(name, "real", ladder.real(name), options.repeat) for name in REAL]
        measure.print_table(
            "Flips and assembly (seconds; ours over libigl; robust_laplacian over ours)",
            ["mesh", "faces", "flips", "batches", "ours", "/ libigl", "robust /", "target", "difference"],
            rows,
        )
    if options.only in (None, "overlay"):
        for family in ("stretched", "sheared torus"):
            rows = []
            for size in sizes:
                mesh = FAMILIES[family](size)
                flipped, base = flip_to_delaunay(mesh, track=True), Base.itself(mesh)
                timing = measure.timed(lambda: common_subdivision(flipped, base), options.repeat)  # noqa: B023
                crossings = int((timing.value.vertex_kind == 2).sum())
                rows.append([mesh.n_faces, timing.value.mesh.n_faces, crossings, timing.median])
            growth(rows)
            header = ["faces", "faces of the overlay", "crossings", "seconds", "growth / n log n"]
            measure.print_table(f"Common subdivision, {family} (no peer binds it)", header, rows)
    if options.only in (None, "refine"):
        rows = []
        for size in sizes:
            mesh = ladder.stretched(size)
            timing = measure.timed(lambda: refine(mesh, 25.0), 1, warm_up=False)  # noqa: B023
            after = timing.value.flipped.mesh
            rows.append([mesh.n_faces, after.n_faces, timing.value.batches, timing.median])
        growth(rows)
        header = ["faces", "faces after", "batches", "seconds", "growth / n log n"]
        measure.print_table("Refinement to 25 degrees, stretched sphere (no peer binds it)", header, rows)


if __name__ == "__main__":
    main()
