"""Factor and solve one Poisson-like system beside cvxopt called directly and scipy's default.

    python -m benchmarks.peers.solver [--full] [mesh ...]

Targets: with the extra `fast` within 1.1 of its binding called directly; without it never slower than splu's
default, and at most 15 s at 1.3M faces on a quiet machine (regular, irregular, sheared).
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from benchmarks.common import measure, mesh_sequences
from ddgcli.linalg.backends import cholmod_available
from ddgcli.linalg.factor import Factor
from ddgcli.mesh import shapes
from ddgcli.operators.laplacian import lumped_vertex_area, stiffness

# small systems take milliseconds, of which the least is steady only over many runs
REPEAT = {"20k": 20, "80k": 8, "320k": 3, "1.3M": 1}
REGULAR_GRIDS = {"20k": 5, "80k": 6, "320k": 7, "1.3M": 8}


def system(name: str, size: str) -> csc_array:
    faces = mesh_sequences.FACES[size]
    if name == "regular":
        mesh = shapes.icosphere(REGULAR_GRIDS[size])
    elif name == "irregular":
        mesh = mesh_sequences.sphere(faces)
    elif name == "stretched":
        mesh = mesh_sequences.stretched(faces)
    else:
        mesh = mesh_sequences.sheared_torus(faces)
    area = lumped_vertex_area(mesh)
    return csc_array(stiffness(mesh) + 1e-6 * diags_array(area / area.mean()))


def cvxopt_directly(A: csc_array, b: np.ndarray) -> np.ndarray:
    """As cvxopt's manual does it: lower triangle, symbolic, numeric, solve."""
    from cvxopt import cholmod, matrix, spmatrix

    column = np.repeat(np.arange(A.shape[0]), np.diff(A.indptr))
    lower = A.indices >= column
    S = spmatrix(
        matrix(A.data[lower]), matrix(A.indices[lower].astype(np.int64)), matrix(column[lower]), A.shape
    )
    F = cholmod.symbolic(S)
    cholmod.numeric(S, F)
    x = matrix(b)
    cholmod.solve(F, x)
    return np.array(x).ravel()


def bench(names: list[str], sizes: list[str]) -> None:
    rows = []
    for size in sizes:
        for name in names:
            A = system(name, size)
            b = np.random.default_rng(0).normal(size=A.shape[0])
            b -= b.mean()
            calls = {"base": lambda A=A, b=b: Factor(A, solver="multifrontal").solve(b)}
            if size != "1.3M":
                calls["splu"] = lambda A=A, b=b: splu(A).solve(b)
            if cholmod_available():
                calls["fast"] = lambda A=A, b=b: Factor(A, solver="cholmod").solve(b)
                calls["cvxopt"] = lambda A=A, b=b: cvxopt_directly(A, b)
            t = measure.interleaved(calls, repeat=REPEAT[size])
            s = {k: v.lowest for k, v in t.items()}
            factor = Factor(A, solver="multifrontal")
            again = measure.timed(lambda f=factor, A=A: f.refactor(A), repeat=1).lowest
            nan = float("nan")
            rows.append(
                [f"{name} {size}", s["base"], s.get("splu", nan), s.get("splu", nan) / s["base"], 1.0,
                 again, s.get("fast", nan), s.get("cvxopt", nan), s.get("fast", nan) / s.get("cvxopt", nan),
                 1.1, float(factor.backward_error(factor.solve(b), b))]
            )  # fmt: skip
            measure.print_table(
                "Factor and solve: least of the runs (seconds)",
                ["mesh", "ours base", "splu default", "splu / ours", "target >=", "ours refactor",
                 "ours fast", "cvxopt directly", "fast / cvxopt", "target <=", "backward error"],
                rows[-1:],
            )  # fmt: skip


# whole commands, timed as a user starts them
COMMANDS = ("laplacian frame.off --eigen 50",)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--full"]
    print(measure.machine())
    bench(
        words or ["regular", "irregular", "stretched", "sheared"],
        ["20k", "80k", "320k"] + ["1.3M"] * ("--full" in sys.argv),
    )
    measure.print_commands(*COMMANDS)
