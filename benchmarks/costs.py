"""What does each kernel of a command cost? Measures the table that `--dry-run` predicts from.

python -m benchmarks.costs [--only WORD ...]      writes ddgcli/cli/forecast/coefficients.py (half an hour)

Each kernel is one command at two or more sizes, each in a process of its own: CPU seconds and peak memory
after its input is read (as a dry run states them). The costs of kernels that stand before it in a command are
subtracted; what is left is fitted. The probe of the machine's speed runs before and after each command, which
is repeated: the median of the ratios counts, so that the load of other processes cancels.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common.process import ROOT, MeasuredProcess, measured_command
from ddgcli.cli.forecast.coefficients import COEFFICIENTS, PROBE_SECONDS, Cost
from ddgcli.cli.forecast.prediction import fill, probe

TABLE = ROOT / "ddgcli" / "cli" / "forecast" / "coefficients.py"
SIZES, SMALL_SIZES, SHELL_SIZES = (10_000, 80_000), (2_000, 14_000), (10_000, 100_000)
LARGE_SIZES = (10_000, 80_000, 500_000)  # where caches and fill give an exponent above 1.05
PIECE_SIZES = (10_000, 100_000, 600_000)  # of shells, whose elements are summed in pieces beyond 350,000
REPETITIONS = 3
SHELL = "--material felt --set thickness=1e-3 --effect stretching --effect gravity"

STIFF = "--material felt --set thickness=5e-3 --set young=1e9 --effect stretching --effect gravity"


@dataclass(frozen=True)
class Task:
    """A kernel, the command that measures it (`{mesh}`, `{out}`: files), the growth of its seconds."""

    kernel: str
    words: str
    sizes: tuple[int, ...] = SIZES
    mesh: str = "sphere"
    exponent: float = 1.05
    suffix: str = ""  # of the kernel's name: kind of elements other than faces
    short: bool = False  # the command computes its short summary only
    solver: str = "auto"  # of linear systems
    uses: float | str = ""  # of the kernel in this command; a name in `results`; default as predicted


SURFACE = [
    Task("info", "info {mesh}"),
    Task("write vtu", "info {mesh} -o {out}.vtu"),
    Task("write npz", "info {mesh} -o {out}.npz"),
    Task("write ply", "info {mesh} -o {out}.ply"),
    Task("write text", "info {mesh} -o {out}.obj"),
    Task("picture", "info {mesh} --plot {out}.png"),
    Task("repair", "repair {mesh} --for curvature"),
    *(
        Task(f"curvature {scheme}", f"curvature {{mesh}} --scheme {scheme}", short=True)
        for scheme in ("cotan", "normal-cycle", "corrected", "quadric")
    ),
    *(
        Task(
            f"curvature {scheme} radius",
            f"curvature {{mesh}} --scheme {scheme} --radius {{radius}}",
            short=True,
        )
        for scheme in ("normal-cycle", "corrected", "quadric")
    ),
    Task("curvature quadric auto", "curvature {mesh} --radius auto", short=True),
    Task("curvature further results", "curvature {mesh} --scheme corrected"),
    Task("curvature noise", "curvature {mesh} --scheme corrected", mesh="noisy", uses=1.0),
    Task("curvature normal-voting", "curvature {mesh} --scheme normal-voting", short=True),
    Task(
        "curvature normal-voting radius",
        "curvature {mesh} --scheme normal-voting --radius {radius}",
        short=True,
    ),
    Task("curvature offset", "curvature {mesh} --scheme cotan --offset 0.01", (2_000, 20_000)),
    Task("delaunay", "delaunay {mesh}", LARGE_SIZES, exponent=1.15),
    Task("delaunay refine", "delaunay {mesh} --refine 25", (1_000, *SIZES)),
    Task("delaunay overlay", "delaunay {mesh} --overlay {out}.ply"),
    Task("delaunay dual", "delaunay {mesh} --dual {out}.npz"),
    Task("delaunay condition", exponent=1.15, words="delaunay {mesh} --condition"),
    Task("laplacian", "laplacian {mesh}"),
    Task("laplacian matrix", "laplacian {mesh} --matrix {out}.npz"),
    Task("laplacian poisson", "laplacian {mesh} --poisson f", LARGE_SIZES, exponent=1.3),
    Task(
        "laplacian poisson multigrid",
        exponent=1.15,
        words="laplacian {mesh} --poisson f --solver multigrid",
    ),
    Task("laplacian eigen", exponent=1.1, words="laplacian {mesh} --eigen 8"),
    Task("laplacian eigenpair", exponent=1.1, words="laplacian {mesh} --eigen 40"),
    Task("laplacian smooth", exponent=1.15, words="laplacian {mesh} --smooth 1e-4"),
    Task("laplacian discrete-conformal", "laplacian {mesh} --parameterize discrete-conformal", mesh="disk"),
    Task(
        "laplacian conformal", exponent=1.15, words="laplacian {mesh} --parameterize conformal", mesh="disk"
    ),
    Task("laplacian harmonic", "laplacian {mesh} --parameterize harmonic", mesh="disk"),
    Task("laplacian form-eigen", "laplacian {mesh} --form-eigen 4", SMALL_SIZES),
    Task("laplacian evolution", "laplacian {mesh} --heat f --duration 1 --dt 0.01"),
    Task("hodge", "hodge {mesh}"),
    Task("hodge field", "hodge {mesh} --field wind"),
    Task("dec", "dec {mesh} -o {out}.npz"),
    Task("geodesic exact", exponent=1.3, words="geodesic {mesh} --source 0"),
    Task("geodesic heat", "geodesic {mesh} --source 0 --method heat", LARGE_SIZES, exponent=1.3),
    Task(
        "geodesic fast-marching",
        "geodesic {mesh} --source 0 --method fast-marching",
        (5_000, 20_000, 80_000, 320_000),
    ),
    Task("geodesic dijkstra", "geodesic {mesh} --source 0 --method dijkstra"),
    *(
        Task(
            f"geodesic {method} solve",
            f"geodesic {{mesh}} --source 0,9,99,999 --each-source --method {method}",
        )
        for method in ("exact", "heat", "fast-marching", "dijkstra")
    ),
    Task("geodesic log-map", "geodesic {mesh} --source 0 --log-map"),
    Task(
        "geodesic job",
        "geodesic {mesh} --source 0,9,99,999 --target 5,50 --distance-matrix {out}.npz --jobs 2",
        (10_000,),
    ),
    Task("geodesic point", "geodesic {mesh} --source-point 0,0,1"),
    Task("geodesic field", "geodesic {mesh} --field wind"),
    Task("geodesic transport", "geodesic {mesh} --source 0 --path-to 9 --transport"),
    Task("geodesic vector-heat", "geodesic {mesh} --source 0 --spread-vector 0.3,0.5,1"),
    Task("willmore-flow", "willmore-flow {mesh} --steps 1 --dt 1e-9", SMALL_SIZES),
    *(
        Task(
            f"willmore-flow {flow} step",
            f"willmore-flow {{mesh}} --flow {flow} --steps 9 --dt 1e-9",
            (*SMALL_SIZES, 80_000),
            exponent=1.15,
        )
        for flow in ("quadratic", "mean-curvature")
    ),
    *(
        Task(
            f"willmore-flow {kind} step",
            f"willmore-flow {{mesh}} --flow {flow} --steps 4",
            SMALL_SIZES,
            mesh="torus",
            uses="steps",
        )
        for kind, flow in (("descent", "quadratic"), ("newton", "newton"))
    ),
    Task(
        "willmore-flow remeshing",
        "willmore-flow {mesh} --remesh mean --steps 4",
        SMALL_SIZES,
        mesh="torus",
        uses="steps",
    ),
    Task("willmore-flow conformal", "willmore-flow {mesh} --flow conformal", (500, 2_000), mesh="torus"),
    Task(
        "shell-sim",
        f"shell-sim {{mesh}} {SHELL} --effect bending --integrator verlet --dt 1e-8 --steps 1",
        PIECE_SIZES,
        mesh="disk",
    ),
    Task(
        "shell-sim implicit step",
        f"shell-sim {{mesh}} {SHELL} --effect bending --dt 1e-3 --pin 0 --steps 5",
        SHELL_SIZES,
        mesh="disk",
        exponent=1.15,
    ),
    *(
        Task(
            f"shell-sim {kind}iteration",
            f"shell-sim {{mesh}} {STIFF} --effect \"bending model='{model}'\" --pin 0 --pin 9 --pin 99 "
            "--integrator static",
            sizes,
            mesh="disk",
            exponent=1.15,
            uses="newton_iterations",
        )
        for kind, model, sizes in (("", "hinge", SMALL_SIZES), ("midedge ", "midedge", (1_000, 4_000)))
    ),
    *(
        Task(
            f"shell-sim {task}",
            f"shell-sim {{mesh}} {SHELL} --effect bending --pin 0 --pin 9 --pin 99 --{task} 10",
            SMALL_SIZES,
            mesh="torus",
            exponent=1.15,
        )
        for task in ("modes", "buckling")
    ),
    Task(
        "shell-sim iterative implicit step",
        f"shell-sim {{mesh}} {SHELL} --effect bending --dt 1e-3 --pin 0 --steps 5",
        (30_000, 150_000, 600_000),
        mesh="disk",
        exponent=1.15,
        solver="multigrid",
    ),
    Task(
        "shell-sim iterative midedge step",
        f"shell-sim {{mesh}} {SHELL} --effect \"bending model='midedge'\" --dt 1e-3 --pin 0 --steps 5",
        SMALL_SIZES,
        mesh="disk",
        exponent=1.15,
        solver="multigrid",
    ),
    Task(
        "shell-sim midedge step",
        f"shell-sim {{mesh}} {SHELL} --effect \"bending model='midedge'\" --dt 1e-3 --pin 0 --steps 5",
        SMALL_SIZES,
        mesh="disk",
        exponent=1.15,
    ),
    Task(
        "shell-sim explicit step",
        f"shell-sim {{mesh}} {SHELL} --effect bending --integrator verlet --dt 1e-8 --steps 40",
        PIECE_SIZES,
        mesh="disk",
    ),
    Task(
        "shell-sim pairs step",
        f"shell-sim {{mesh}} {SHELL} --effect bending --effect 'contact self_contact=true' --dt 1e-3 --pin 0 "
        "--steps 5",
        SMALL_SIZES,
        mesh="disk",
    ),
    Task("fluid-sim", "fluid-sim {mesh} --vorticity f --dt 1e-7 --steps 1", LARGE_SIZES, exponent=1.2),
    *(
        Task(
            f"fluid-sim {name} step",
            f"fluid-sim {{mesh}} --vorticity f --integrator {name} --dt 1e-7 --steps 9",
            (2_000, *SIZES),
        )
        for name in ("circulation", "conservative", "energy", "covector")
    ),
    *(
        Task(f"tradeoff {words.split()[0]}", f"tradeoff {words} --budget 60", SMALL_SIZES)
        for words in (
            "curvature {mesh}",
            "delaunay {mesh}",
            "laplacian {mesh}",
            "geodesic {mesh} --source 0",
            "willmore-flow {mesh}",
        )
    ),
    Task("view", "view {mesh} -o {out}.html"),
    Task("view frame", "view {mesh} -o {out}.html", mesh="trajectory"),
    Task(
        "picture of a run",
        "willmore-flow {mesh} --flow mean-curvature --steps 1 --dt 1e-9 --plot {out}.png",
        SMALL_SIZES,
    ),
]
TETRAHEDRA = [
    Task("info", "info {mesh}", mesh="box", suffix="tetrahedra"),
    Task("write vtu", "info {mesh} -o {out}.vtu", mesh="box", suffix="tetrahedra"),
    Task("write npz", "info {mesh} -o {out}.npz", mesh="box", suffix="tetrahedra"),
    Task("laplacian", "laplacian {mesh}", mesh="box", suffix="tetrahedra"),
    Task(
        "laplacian poisson",
        exponent=1.15,
        words="laplacian {mesh} --poisson f",
        mesh="box",
        suffix="tetrahedra",
    ),
    Task(
        "laplacian eigen", exponent=1.1, words="laplacian {mesh} --eigen 8", mesh="box", suffix="tetrahedra"
    ),
    Task(
        "laplacian eigenpair",
        exponent=1.1,
        words="laplacian {mesh} --eigen 40",
        mesh="box",
        suffix="tetrahedra",
    ),
    Task(
        "laplacian form-eigen",
        "laplacian {mesh} --form-eigen 4",
        (1_500, 3_000, 10_000),
        exponent=2.0,
        mesh="box",
        suffix="tetrahedra",
    ),
    Task(
        "fluid-sim",
        "fluid-sim {mesh} --flow vortex-ring --integrator energy --dt 1e-7 --steps 1",
        SMALL_SIZES,
        exponent=1.2,
        mesh="box",
        suffix="tetrahedra",
    ),
    *(
        Task(
            f"fluid-sim {name} step",
            f"fluid-sim {{mesh}} --flow vortex-ring --integrator {name} --dt 1e-3 --steps 9",
            SMALL_SIZES,
            mesh="box",
            suffix="tetrahedra",
        )
        for name in ("circulation", "energy", "covector")
    ),
    Task("hodge", "hodge {mesh}", SMALL_SIZES, mesh="box", suffix="tetrahedra"),
    Task("hodge field", "hodge {mesh} --field wind", SMALL_SIZES, mesh="box", suffix="tetrahedra"),
    Task("dec", "dec {mesh} -o {out}.npz", SMALL_SIZES, mesh="box", suffix="tetrahedra"),
    Task("view", "view {mesh} -o {out}.html", mesh="box", suffix="tetrahedra"),
]
CURVES = [
    Task("info", "info {mesh}", mesh="circle", suffix="curve"),
    Task("curvature", "curvature {mesh}", mesh="circle", suffix="curve"),
    Task("picture", "info {mesh} --plot {out}.png", mesh="circle", suffix="curve"),
    Task("curve-flow", "curve-flow {mesh} --steps 1 --dt 1e-9", SMALL_SIZES, mesh="circle", suffix="curve"),
    Task(
        "curve-flow step",
        "curve-flow {mesh} --steps 20 --dt 1e-9",
        SMALL_SIZES,
        mesh="circle",
        suffix="curve",
    ),
]
NOTHING = Cost(0.0, 0.0, 1.0, 0.0, 0.0)  # of a kernel that is measured later
TASKS = [*SURFACE, *TETRAHEDRA, *CURVES]


def make_input(folder: Path, kind: str, elements: int) -> tuple[Path, float]:
    """Mesh file with the arrays f (vertices) and wind (cells), and three mean edge lengths."""
    suffix = "vtkhdf" if kind == "trajectory" else "npz"
    path, note = folder / f"{kind}-{elements}.{suffix}", folder / f"{kind}-{elements}.txt"
    if not path.exists():
        code = (
            "import sys; from pathlib import Path; from benchmarks.costs import write_input; "
            f"Path({str(note)!r}).write_text(str(write_input({str(path)!r}, {kind!r}, {elements})))"
        )
        subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
    return path, float(note.read_text())


def write_input(path: str, kind: str, elements: int) -> float:
    """Write an input, in a process of its own so that the driver stays small."""
    from ddgcli.io.mesh_file import write_mesh
    from ddgcli.mesh import shapes
    from ddgcli.mesh.curve import CurveSet
    from ddgcli.mesh.fields import AnnotatedMesh

    if kind == "trajectory":
        sphere, _ = make_input(Path(path).parent, "sphere", elements)
        words = (
            f"willmore-flow {sphere} --flow mean-curvature --steps 20 --dt 1e-5 --frame-every 1e-5 -o {path}"
        )
        subprocess.run(
            [sys.executable, "-m", "ddgcli", *words.split()], check=True, stdout=subprocess.DEVNULL
        )
        return 0.0
    if kind == "circle":
        angle = np.linspace(0, 2 * np.pi, elements, endpoint=False)
        points = np.stack([np.cos(angle), 0.7 * np.sin(angle), 0 * angle], axis=1)
        write_mesh(path, AnnotatedMesh(CurveSet.from_paths([np.vstack([points, points[:1]])])))
        return 0.0
    if kind == "box":
        mesh: Any = shapes.box_tetrahedra(*3 * [max(2, round((elements / 6) ** (1 / 3)))])
    elif kind == "disk":
        mesh = shapes.grid(n := max(2, round((elements / 2) ** 0.5)), n)
    else:
        mesh = shapes.random_sphere(elements // 2 + 2, 0)
    if kind == "torus":
        n = max(4, round((elements / 4) ** 0.5))
        mesh = shapes.torus(2 * n, n)
        mesh = mesh.moved(mesh.points * [1.0, 1.2, 0.8])
    if kind == "noisy":
        noise = 0.05 * mesh.side_length.mean() * np.random.default_rng(0).standard_normal(len(mesh.points))
        mesh = mesh.moved(mesh.points * (1 + noise)[:, None])
    cells = {"wind": np.tile([1.0, 0.5, 0.2], (elements_of(mesh), 1))}
    write_mesh(path, AnnotatedMesh(mesh, vertex={"f": mesh.points[:, 2].copy()}, face=cells))
    return 3 * float(mesh.side_length.mean()) if kind != "box" else 0.0


def elements_of(mesh: Any) -> int:
    """Cells of a mesh."""
    return len(mesh.tetrahedra if hasattr(mesh, "tetrahedra") else mesh.faces)


def measure(words: list[str], folder: Path, *, short: bool = False) -> MeasuredProcess:
    """Run `ddgcli WORDS --json`, with `short` without --json."""
    run = measured_command(words if short else [*words, "--json"], folder)
    if run.exit_code == 2:
        raise SystemExit(f"failed: {' '.join(words)}\n{run.error}")
    return run


@cache
def read_facts(path: Path, folder: Path) -> dict[str, float]:
    """MiB and CPU seconds of `info` after it has read a file, and the probe at that time."""
    before = probe()
    facts = dry_run(["info", str(path)], folder)
    return facts | {"probe_seconds": 0.5 * (before + probe())}


def dry_run(words: list[str], folder: Path) -> dict[str, Any]:
    """Prediction of a command."""
    summary = measure([*words, "--dry-run"], folder).summary
    return summary.get("prediction") or summary["results"]


def measured_kernel(
    task: Task, folder: Path, table: dict[str, Cost], probe_seconds: float
) -> list[tuple[float, float, float]]:
    """Elements (1e5), and the seconds and MiB of one use of the kernel, for every size of the task.

    `probe_seconds` is the probe at the speed of the table.
    """
    facts: dict[str, Any] = {}
    rows, start, start_mib = [], 0.0, 0.0
    for elements in task.sizes:
        path, radius = make_input(folder, task.mesh, elements)
        words = shlex.split(task.words.format(mesh=path, out=folder / "out", radius=radius))
        run_seconds, run_mib, uses = repeated_run(words, folder, probe_seconds, task)
        read = read_facts(path, folder)
        if not facts:  # the kernels as the command itself counts them, and what its imports cost
            facts = dry_run(words, folder)
            start = facts["read_seconds"] - read["read_seconds"]
            start_mib = facts["read_mib"] - read["read_mib"]
        speed = probe_seconds / read["probe_seconds"]
        seconds = run_seconds - speed * (read["read_seconds"] + start)
        mib = run_mib - read["read_mib"] - start_mib
        kernels = [_as_run(use, uses) if use["kernel"] == task.kernel else use for use in facts["kernels"]]
        rows.append(_rest(task, kernels, read["elements"] / 1e5, seconds, mib, table))
    return rows


def _as_run(use: dict[str, Any], uses: float | None) -> dict[str, Any]:
    """A predicted use of a kernel with the number of uses that the run itself counts."""
    return use if uses is None else {**use, "times": uses, "added": min(use["added"], 1.0) and 1.0}


def repeated_run(
    words: list[str], folder: Path, probe_seconds: float, task: Task
) -> tuple[float, float, float | None]:
    """Seconds at the speed of the table, MiB (medians of repetitions) and uses of the kernel in a command."""
    seconds, mib = [], []
    for _ in range(REPETITIONS):
        before = probe()
        run = measure(words, folder, short=task.short)
        seconds.append(run.seconds * 2.0 * probe_seconds / (before + probe()))
        mib.append(run.mib)
    uses = (
        run.summary["results"][task.uses] if isinstance(task.uses, str) and task.uses else task.uses or None
    )
    return statistics.median(seconds), statistics.median(mib), uses


def _rest(
    task: Task, uses: list[dict[str, Any]], n: float, seconds: float, mib: float, table: dict[str, Cost]
) -> tuple[float, float, float]:
    """n, and what other kernels leave of the seconds and MiB, for one use."""
    own = next(use for use in uses if use["kernel"] == task.kernel)
    shared = 0.0
    for use in uses:
        short = task.short and use["kernel"] == "curvature further results"
        if use is own or short or use["kernel"] == "curvature noise":  # spheres have none
            continue
        cost = table.get(f"{use['kernel']} {task.suffix}".strip(), NOTHING)
        filled = fill(use["kernel"], round(n * 1e5))
        seconds -= use["times"] * (cost.seconds + filled * cost.seconds_per_1e5 * n**cost.exponent)
        shared = max(shared, cost.mib + filled * cost.mib_per_1e5 * n)
    mib = (mib - shared) / own["added"] if own["added"] else mib
    return n, max(seconds, 0.0) / own["times"], max(mib, 0.0)


def fitted(rows: list[tuple[float, float, float]], exponent: float, kernel: str = "") -> Cost:
    """Cost from (elements, seconds, MiB) at growing sizes, by relative least squares."""
    n, seconds, mib = (np.array(column) for column in zip(*rows))
    filled = np.array([fill(kernel, round(1e5 * x)) for x in n])
    return Cost(*_line(filled * n**exponent, seconds, 0.02), exponent, *_line(filled * n, mib, 5.0))


def _line(x: np.ndarray, values: np.ndarray, floor: float) -> tuple[float, float]:
    """Intercept and slope, neither negative."""
    weight = 1 / np.maximum(values, floor)
    return _nonnegative(np.stack([weight, x * weight], axis=1), values * weight)


def _nonnegative(matrix: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    x = np.linalg.lstsq(matrix, values, rcond=None)[0]
    if (x < 0).any():  # the better of the two columns alone
        single = [max(0.0, float(c @ values / (c @ c))) for c in matrix.T]
        errors = [float(np.abs(c * a - values).max()) for c, a in zip(matrix.T, single)]
        k = int(np.argmin(errors))
        x = np.zeros(2)
        x[k] = single[k]
    return float(x[0]), float(x[1])


def write_table(table: dict[str, Cost], probe_seconds: float) -> None:
    """Write the table into its module."""
    source = TABLE.read_text(encoding="utf-8")
    head = source[: source.index("PROBE_SECONDS =")]
    lines = [
        f"    {json.dumps(name)}: Cost({', '.join(f'{x:.4g}' for x in cost)}),\n"
        for name, cost in table.items()
    ]
    text = (
        head + f"PROBE_SECONDS = {probe_seconds:.4g}  # of `prediction.probe` where the table was measured\n"
    )
    TABLE.write_text(
        text + "\nCOEFFICIENTS: dict[str, Cost] = {\n" + "".join(lines) + "}\n", encoding="utf-8"
    )


def _chosen(name: str, word: str) -> bool:
    return name + "=" == word or name.startswith(word)


def main() -> None:
    """Measure the kernels and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only", nargs="*", help="kernels whose names begin with one of these; NAME=: only it"
    )
    parser.add_argument("--missing", action="store_true", help="only kernels that the table lacks")
    parser.add_argument("--folder", help="keep the inputs here")
    arguments = parser.parse_args()
    table = dict(COEFFICIENTS)
    probe_seconds = statistics.median(probe() for _ in range(5))
    keep_others = arguments.only or arguments.missing  # they stay in the seconds of the earlier run
    if keep_others:
        probe_seconds = PROBE_SECONDS
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(arguments.folder or temporary)
        for task in TASKS:
            name = f"{task.kernel} {task.suffix}".strip()
            if arguments.only and not any(_chosen(name, word) for word in arguments.only):
                continue
            if arguments.missing and name in table:
                continue
            os.environ["DDGCLI_SOLVER"] = task.solver
            rows = measured_kernel(task, folder, table, probe_seconds)
            table[name] = fitted(rows, task.exponent, task.kernel)
            print(
                name, table[name], [(round(n * 1e5), round(s, 3), round(m)) for n, s, m in rows], flush=True
            )
            write_table(table, probe_seconds)


if __name__ == "__main__":
    main()
