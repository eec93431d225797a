"""How do seconds and memory of whole commands grow up to 10 million faces, and are they predicted?

python -m benchmarks.peers.size [faces ...] [--seconds S] [--mib M] [--only WORD ...]    default 20000 100000

Every row is one process on an irregular sphere (a grid for shells), read from a binary .ply: CPU seconds of
the program and, apart, of the operating system (nearly all the first touch of memory, up to 16 s a GiB on a
virtual machine whose host takes idle pages back), peak resident memory, what `--dry-run` predicts, and the
exponent of growth from the next smaller mesh. A row whose prediction exceeds S (180) CPU seconds, M MiB or
the available memory is not run, and the table reports it.

The vertices of the sphere are numbered at random, unlike those of scans and marching cubes: arrays that
no cache holds are read out of order, and the seconds per face grow. Delaunay of 2.5M faces takes 23.8 s,
and 15.4 s if the same vertices are sorted along a space-filling curve (no flips, the same passes).

Rows accumulate in benchmarks/results/rows/size.json, which is written after each row, so that a later session
continues: rows of other commands and sizes stay. The table shows all of them.
"""

from __future__ import annotations

import argparse
import datetime
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.common.process import ROOT, measured_command

STORE = ROOT / "benchmarks" / "results" / "rows" / "size.json"
SHELL = "--effect stretching --effect bending --effect gravity --material felt --set thickness=1e-3"
ROWS = {
    "info": "info {sphere}",
    "curvature": "curvature {sphere}",
    "intrinsic Delaunay": "delaunay {sphere}",
    "refinement": "delaunay {sphere} --refine 25",
    "Poisson": "laplacian {sphere} --poisson {values}",
    "Poisson, multigrid": "laplacian {sphere} --poisson {values} --solver multigrid",
    "heat distance": "geodesic {sphere} --source 0 --method heat",
    "fast-marching distance": "geodesic {sphere} --source 0 --method fast-marching",
    "exact distance": "geodesic {sphere} --source 0",
    "fluid step": "fluid-sim {sphere} --vorticity 5*z --dt 1e-7 --steps 1",
    "shell step": f"shell-sim {{sheet}} {SHELL} --dt 1e-3 --pin 0 --steps 1",
    "explicit shell step": f"shell-sim {{sheet}} {SHELL} --integrator verlet --dt 1e-9 --steps 1",
}
COMMANDS = ("info torus.ply", "info torus.ply --dry-run")
MAKE = """
import sys
import numpy as np
from ddgcli.io.mesh_file import write_mesh
from ddgcli.mesh import shapes
from ddgcli.mesh.fields import AnnotatedMesh
folder, faces = sys.argv[1], int(sys.argv[2])
sphere = shapes.random_sphere(faces // 2 + 2, 0)
write_mesh(folder + "/sphere.ply", AnnotatedMesh(sphere))
np.save(folder + "/values.npy", sphere.points[:, 2])
n = round((faces / 2) ** 0.5)
write_mesh(folder + "/sheet.ply", AnnotatedMesh(shapes.grid(n, n)))
"""


def make_inputs(folder: Path, faces: int) -> dict[str, Path]:
    """Inputs of one size, made by a process of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = {
        name: folder / f"{name}.{'npy' if name == 'values' else 'ply'}"
        for name in ("sphere", "sheet", "values")
    }
    if not paths["sheet"].exists():
        subprocess.run([sys.executable, "-c", MAKE, str(folder), str(faces)], check=True, cwd=ROOT)
    return paths


def measured_row(
    call: str, paths: dict[str, Path], folder: Path, seconds: float, mib: float
) -> dict[str, Any]:
    """Prediction and, if it is within the limits, measurement of one command."""
    words = [*call.format(**paths).split(), "--json"]
    today = datetime.date.today().isoformat()
    dry = measured_command([*words, "--dry-run"], folder)
    if dry.exit_code:
        return {"note": "refused: " + dry.error.strip().splitlines()[-1][-70:], "date": today}
    facts = dry.summary["results"]
    row = {"predicted s": facts["seconds"], "predicted MiB": facts["peak_mib"], "date": today}
    if facts["seconds"] > seconds or facts["peak_mib"] > min(mib, facts["available_mib"]):
        return row | {"note": "not run"}
    run = measured_command(words, folder)
    note = "" if run.exit_code == 0 else f"exit code {run.exit_code}"
    return row | {"s": run.seconds, "system s": run.system_seconds, "MiB": run.mib, "note": note}


def stored_rows() -> dict[str, dict[str, dict[str, Any]]]:
    """Rows of earlier runs: command, faces as text, row."""
    return json.loads(STORE.read_text(encoding="utf-8")) if STORE.exists() else {}


def store_row(name: str, faces: int, row: dict[str, Any]) -> None:
    """Add a row; one that did not run does not replace a measurement."""
    rows = stored_rows()
    old = rows.setdefault(name, {}).get(str(faces), {})
    if "s" in row or "s" not in old:
        rows[name][str(faces)] = row
    STORE.parent.mkdir(parents=True, exist_ok=True)
    STORE.write_text(json.dumps(rows, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def exponent(row: dict[str, Any], before: dict[str, Any], key: str, ratio: float) -> float | str:
    """Growth of a column from the next smaller mesh."""
    return math.log(row[key] / before[key]) / math.log(ratio) if key in row and key in before else "-"


def print_rows(name: str, stored: dict[str, dict[str, Any]]) -> None:
    """Print the rows of one command by size."""
    last: tuple[int, dict[str, Any]] | None = None  # of the next smaller mesh that was measured
    for faces, row in sorted((int(text), row) for text, row in stored.items()):
        growth: list[float | str] = ["-", "-"]
        if last:
            growth = [exponent(row, last[1], key, faces / last[0]) for key in ("s", "MiB")]
        columns = ("s", "system s", "MiB", "predicted s", "predicted MiB")
        cells = [row.get(key, "-") for key in columns] + growth
        texts = [f"{cell:.3g}" if isinstance(cell, float) else str(cell) for cell in cells]
        print(f"| {name} | {faces:,} | {' | '.join(texts)} | {row['date']} | {row['note']} |", flush=True)
        if "s" in row:
            last = faces, row


def main() -> None:
    """Measure the rows and print the table of all stored ones."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("faces", nargs="*", type=int, default=[20_000, 100_000])
    parser.add_argument("--seconds", type=float, default=180.0)
    parser.add_argument("--mib", type=float, default=math.inf)
    parser.add_argument("--only", nargs="*", default=[""])
    parser.add_argument("--folder", help="keep the inputs here")
    arguments = parser.parse_args()
    from ddgcli.tradeoff.report import machine

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(arguments.folder or temporary)
        for faces in arguments.faces:
            paths = make_inputs(folder / str(faces), faces)
            for name, call in ROWS.items():
                if any(name.startswith(word) for word in arguments.only):
                    row = measured_row(call, paths, folder, arguments.seconds, arguments.mib)
                    store_row(name, faces, row)
                    print(name, faces, row, file=sys.stderr, flush=True)
    rows = stored_rows()
    print(machine())
    header = ["command", "faces", "CPU s", "system s", "peak MiB", "predicted s", "predicted MiB"]
    header += ["growth of s", "growth of MiB", "date", "note"]
    print("\n### Whole commands, reading and start-up included\n\n| " + " | ".join(header) + " |")
    print("|" + " --- |" * len(header))
    for name in ROWS:
        print_rows(name, rows.get(name, {}))


if __name__ == "__main__":
    main()
    from benchmarks.common.measure import print_commands  # late: the driver of the table stays small

    print_commands(*COMMANDS)
