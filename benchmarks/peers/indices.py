"""Indices of 4 bytes beside indices of 8 bytes: gathers of numpy, and sparse matrices of scipy.

    python -m benchmarks.peers.indices [SUBDIVISIONS]

It decides what `ddgcli.linalg.indices` does: arrays of numpy keep 8 bytes, sparse matrices have 4.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from benchmarks.common import measure
from ddgcli.mesh import shapes

SUBDIVISIONS = 8  # 1.3 million faces
REPEAT = 5


def calls(faces: NDArray, n: int, values: NDArray, per_face: NDArray) -> dict[str, Callable[[], Any]]:
    """The operations, on faces (m, 3) of one index type."""
    corner = np.ascontiguousarray(faces.T)
    tail, head, entries = corner.ravel(), corner[[1, 2, 0]].ravel(), np.tile(per_face, 3)
    matrix = coo_array((entries, (tail, head)), shape=(n, n)).tocsr()
    return {
        "take": lambda: [values.take(c) for c in corner],
        "values[index]": lambda: [values[c] for c in corner],
        "bincount": lambda: [np.bincount(c, per_face, n) for c in corner],
        "minimum, maximum": lambda: (np.minimum(tail, head), np.maximum(tail, head)),
        "coo_array to csr_array": lambda: coo_array((entries, (tail, head)), shape=(n, n)).tocsr(),
        "csr_array @ vector": lambda: matrix @ values,
    }


def bench(subdivisions: int) -> None:
    """Print CPU seconds of each operation with both types, for ordered and for random vertex indices."""
    mesh = shapes.icosphere(subdivisions)
    generator, n = np.random.default_rng(0), mesh.n_vertices
    numbers = generator.permutation(n)
    values, per_face = generator.random(n), generator.random(mesh.n_faces)
    for title, faces in (("ordered", mesh.faces), ("random", numbers[mesh.faces])):
        both = [calls(faces.astype(kind), n, values, per_face) for kind in (np.int64, np.int32)]
        rows = []
        for name in both[0]:
            timing = measure.interleaved({"8": both[0][name], "4": both[1][name]}, REPEAT)
            rows.append(
                [name, timing["8"].median, timing["4"].median, timing["4"].median / timing["8"].median]
            )
        header = ["operation", "8 bytes [s]", "4 bytes [s]", "4 / 8"]
        measure.print_table(f"{mesh.n_faces} faces, {title} vertex indices", header, rows)


# whole commands, timed as a user starts them
COMMANDS = ("laplacian sphere.ply --mass galerkin",)


if __name__ == "__main__":
    bench(int(sys.argv[1]) if len(sys.argv) > 1 else SUBDIVISIONS)
    measure.print_commands(*COMMANDS)
