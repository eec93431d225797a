"""Results under different BLAS kernels and without vector instructions: they agree to stated tolerances.

`make kernels` runs fixed commands on the samples in subprocesses, once as the machine is and once in each
environment, and compares numbers of the summaries: not bits. Exit 1 where a number differs by more.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy._core._multiarray_umath import __cpu_dispatch__

ROOT = Path(__file__).parent.parent
SAMPLES = ROOT / "sample_meshes"
SECONDS = 300
# name: variables, and the CPU feature without which the kernel cannot run
ENVIRONMENTS: dict[str, tuple[dict[str, str], str]] = {
    "Haswell": ({"OPENBLAS_CORETYPE": "Haswell"}, "avx2"),
    "Sandybridge": ({"OPENBLAS_CORETYPE": "Sandybridge"}, "avx"),
    "SkylakeX": ({"OPENBLAS_CORETYPE": "SkylakeX"}, "avx512f"),
    # names differ between versions of numpy, which ignores names of other versions
    "numpy baseline": ({"NPY_DISABLE_CPU_FEATURES": " ".join(__cpu_dispatch__)}, ""),
}
# Relative tolerances. Sums and sparse solves on these samples have condition below 1e6: 1e-16 becomes 1e-10;
# least-squares curvatures, and paths of simulations of a few steps, lose two digits more.
SOLVE_RTOL, FIT_RTOL = 1e-9, 1e-7


@dataclass(frozen=True)
class Case:
    """One command and the numbers of its results to compare.

    Parameters
    ----------
    words : tuple of str
        Arguments; names of samples are completed to paths in sample_meshes/.
    fields : dict of str to float
        Dotted path below `results`, or array:NAME of the written mesh, and the tolerance of the largest
        difference relative to the largest number.
    """

    words: tuple[str, ...]
    fields: dict[str, float]


PLATE = ("shell-sim", "saddle.obj", "--material", "cotton", "--dt", "1e-4", "--steps", "3")
CASES = {
    "info": Case(("info", "torus.ply"), {"quality.min_angle_degrees": SOLVE_RTOL}),
    "curvature quadric": Case(
        ("curvature", "ellipsoid.ply"),
        {"area": SOLVE_RTOL, "willmore_energy": FIT_RTOL, "mean_curvature.max": FIT_RTOL},
    ),
    "curvature corrected": Case(
        ("curvature", "torus.ply", "--scheme", "corrected"),
        {"mean_curvature.max": FIT_RTOL, "volume": SOLVE_RTOL},
    ),
    "curvature of a curve": Case(("curvature", "trefoil.obj"),
        {"total_curvature": SOLVE_RTOL, "length": SOLVE_RTOL}),
    "delaunay": Case(("delaunay", "bad_torus.ply"), {"flips": 0.0, "after.min_angle_degrees": SOLVE_RTOL}),
    "delaunay refined": Case(("delaunay", "saddle.obj", "--refine", "25"),
        {"after.min_angle_degrees": FIT_RTOL}),
    "spectrum": Case(("laplacian", "ellipsoid.ply", "--eigen", "8"),
        {"eigenvalues": SOLVE_RTOL, "area": SOLVE_RTOL}),
    "heat kernel": Case(("laplacian", "sphere.ply", "--hks", "0.1"), {"array:hks_000": SOLVE_RTOL}),
    "smoothing": Case(("laplacian", "torus.ply", "--smooth", "1e-3"), {"array:points": SOLVE_RTOL}),
    "hodge": Case(("hodge", "torus.ply", "--basis"), {"betti_numbers.absolute": 0.0}),
    "geodesic exact": Case(("geodesic", "bad_torus.ply", "--source", "0"),
        {"array:geodesic_distance": SOLVE_RTOL}),
    "geodesic heat": Case(
        ("geodesic", "torus.ply", "--source", "0", "--method", "heat"), {"array:geodesic_distance": FIT_RTOL}
    ),
    "shell": Case((*PLATE, "--effect", "stretching", "--effect", "bending", "--effect", "gravity"),
                  {"energies": FIT_RTOL}),
    "fluid": Case(("fluid-sim", "sphere.ply", "--vorticity", "3*z+x*y", "--steps", "3", "--dt", "0.01"),
                  {"kinetic_energy": FIT_RTOL, "enstrophy": FIT_RTOL}),
    "willmore flow": Case(("willmore-flow", "ellipsoid.ply", "--steps", "3"),
        {"energy": FIT_RTOL, "area": FIT_RTOL}),
}  # fmt: skip


@dataclass(frozen=True)
class Row:
    """One comparison: the largest relative difference of a field, and whether it is within its tolerance."""

    environment: str
    case: str
    field: str
    difference: float
    tolerance: float

    @property
    def agrees(self) -> bool:
        return self.difference <= self.tolerance


def cpu_features() -> set[str]:
    """Features that Linux reports; empty where it does not (then every environment is tried)."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return set()
    return next((set(line.split(":")[1].split()) for line in lines if line.startswith("flags")), set())


def results_of(case: Case, variables: dict[str, str]) -> dict[str, Any]:
    """`results`, and arrays, of a command run in a subprocess with these variables.

    Raises
    ------
    RuntimeError
        Unless the command exits 0.
    """
    arrays = [field for field in case.fields if field.startswith("array:")]
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/out.npz"
        results = _run((*case.words, "-o", path) if arrays else case.words, variables)
        if arrays:
            with np.load(path, allow_pickle=False) as written:
                results |= {field: written[field.removeprefix("array:")].tolist() for field in arrays}
    return results


def _run(words: tuple[str, ...], variables: dict[str, str]) -> dict[str, Any]:
    arguments = [str(SAMPLES / word) if (SAMPLES / word).is_file() else word for word in words]
    environment = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **os.environ, **variables}
    environment["PYTHONPATH"] = str(ROOT)
    run = subprocess.run(
        [sys.executable, "-m", "ddgcli", *arguments, "--json"],
        capture_output=True, text=True, timeout=SECONDS, env=environment, check=False,
    )  # fmt: skip
    if run.returncode:
        raise RuntimeError(f"{' '.join(words)}: exit {run.returncode}: {run.stderr.strip()[-300:]}")
    return json.loads(run.stdout)["results"]


def numbers(results: Any, field: str) -> list[float]:
    """The numbers below a dotted path, in order."""
    for name in [field] if field.startswith("array:") else field.split("."):
        results = results[name]

    def flat(value: Any) -> list[float]:
        if isinstance(value, dict):
            return [number for key in sorted(value) for number in flat(value[key])]
        if isinstance(value, list):
            return [number for entry in value for number in flat(entry)]
        return [math.nan if value is None else float(value)]

    return flat(results)


def difference(a: list[float], b: list[float]) -> float:
    """Largest difference relative to the largest number; infinite where counts differ or a number is NaN."""
    if len(a) != len(b) or not all(map(math.isfinite, (*a, *b))):
        return math.inf
    scale = max((abs(x) for x in a), default=0.0) or 1.0
    return max((abs(x - y) for x, y in zip(a, b)), default=0.0) / scale


def compare(name: str, case: Case, reference: dict, environment: str, other: dict) -> list[Row]:
    """One row a field of the case."""
    return [
        Row(environment, name, field, difference(numbers(reference, field), numbers(other, field)), tolerance)
        for field, tolerance in case.fields.items()
    ]


def compare_all(names: list[str], planted: float = 0.0) -> tuple[list[Row], list[str]]:
    """Rows of the chosen cases in every environment that the CPU has, and notes on those it has not.

    `planted` changes the first number of every environment by this share, to see the comparison fail.
    """
    rows, notes, features = [], [], cpu_features()
    reference = {name: results_of(CASES[name], {}) for name in names}
    for environment, (variables, feature) in ENVIRONMENTS.items():
        if feature and features and feature not in features:
            notes.append(f"{environment}: skipped, this CPU has no {feature}")
            continue
        for name in names:
            try:
                other = results_of(CASES[name], variables)
            except RuntimeError as error:
                rows.append(Row(environment, name, str(error), math.inf, 0.0))
                continue
            rows_of_case = compare(name, CASES[name], reference[name], environment, other)
            rows += [
                Row(*(r.environment, r.case, r.field), r.difference + planted, r.tolerance)
                for r in rows_of_case
            ]
    return rows, notes


def table(rows: list[Row], notes: list[str]) -> str:
    """The rows as text, wrong ones marked, then the notes."""
    lines = [f"{'environment':<16}{'case':<22}{'result':<28}{'difference':>12}{'tolerance':>12}"]
    lines += [
        f"{r.environment:<16}{r.case:<22}{r.field:<28}{r.difference:>12.2g}{r.tolerance:>12.2g}"
        f"{'' if r.agrees else '  DISAGREES'}"
        for r in rows
    ]
    return "\n".join([*lines, *notes])


def main(words: list[str]) -> int:
    """Compare the named cases, or all; 0 where everything agrees."""
    planted = float(words.pop(0).partition("=")[2]) if words and words[0].startswith("--plant=") else 0.0
    unknown = [word for word in words if word not in CASES]
    if unknown:
        print(f"no case {unknown[0]!r}; there are: {', '.join(CASES)}", file=sys.stderr)
        return 2
    rows, notes = compare_all(words or list(CASES), planted)
    print(table(rows, notes))
    wrong = sum(not row.agrees for row in rows)
    print(f"{len(rows)} comparisons, {wrong} disagree")
    return 1 if wrong or not rows else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
