"""Compare the summaries of a fixed list of calls between this checkout and another one.

python -m benchmarks.compare_versions --base REVISION [--only WORD]

Each call runs in a process of its own, in both checkouts; the comparison of `ddgcli check` decides. Use it
before and after a change that must leave results as they are. Exit code 1 if a result differs.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from ddgcli.algorithms.inspection.compare_summaries import Tolerances, compare

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_meshes"
SCENES = ROOT / "sample_scenes"
SHARED_MESHES = ROOT.parent / "shared" / "meshes"
CLOSED_SURFACES = ["torus.ply", "bad_torus.ply", "ellipsoid.ply"]
# texts, and what names files of the checkout
IGNORED_FIELDS = ["warnings*", "options*", "error", "input.sha256", "results.paths*", "results.effects*"]
IGNORED_FIELDS += ["results.promise", "results.energy_convention"]


def calls() -> list[list[str]]:
    """Command lines, without `ddgcli` and `--json`; those whose mesh is missing are left out."""
    s = {path.name: str(path) for path in SAMPLES.iterdir()}
    m = {
        name: str(SHARED_MESHES / name)
        for name in ("spot.obj", "koala.obj", "beam-tet.vtk", "plane_holes.obj")
    }
    lines: list[list[str]] = []
    lines += [["info", s[n]] for n in ("torus.ply", "ball.vtu", "trefoil.obj", "saddle.obj", "cube.obj")]
    lines += [
        ["curvature", s[n], "--scheme", c]
        for n in CLOSED_SURFACES[:2]
        for c in ("cotan", "normal-cycle", "corrected", "quadric")
    ]
    lines += [["curvature", s[n]] for n in ("saddle.obj", "cube.obj", "ellipse.csv", "trefoil.obj")]
    lines += [["curvature", s["ellipsoid.ply"], "--radius", "0.3", "--scheme", "corrected"]]
    lines += [["delaunay", s[n]] for n in (*CLOSED_SURFACES, "saddle.obj", "frame.off")]
    lines += [["delaunay", s["bad_torus.ply"], "--refine", "25", "--condition"]]
    lines += [
        ["laplacian", s["torus.ply"], "--operator", o, "--eigen", "5"]
        for o in ("cotan", "intrinsic-delaunay", "tufted", "uniform")
    ]
    lines += [["laplacian", s["torus.ply"], "--mass", k, "--eigen", "3"] for k in ("voronoi", "galerkin")]
    lines += [["laplacian", s["saddle.obj"], "--parameterize", k] for k in ("harmonic", "conformal")]
    lines += [["laplacian", s["sphere.ply"], "--harmonic", "--fix", "0=0", "--fix", "5=1"]]
    lines += [
        ["laplacian", s["sphere.ply"], "--smooth", "0.01"],
        ["laplacian", s["sphere.ply"], "--hks", "0.5"],
    ]
    lines += [["hodge", s[n], "--basis"] for n in ("torus.ply", "frame.off", "ball.vtu")]
    lines += [
        ["geodesic", s[n], "--source", "0", "--method", k]
        for n in ("bad_torus.ply", "saddle.obj")
        for k in ("exact", "heat", "fast-marching", "dijkstra")
    ]
    lines += [["geodesic", s["torus.ply"], "--source", "0", "7", "--each-source", "--certify"]]
    lines += [["geodesic", s["torus.ply"], "--source", "0", "--path-to", "100"]]
    lines += [["geodesic", s["torus.ply"], "--source", "0", "--isolines", "5"]]
    lines += [["geodesic", s["torus.ply"], "--trace", "0:0.3,0.3,0.4:1,0,0:3"]]
    lines += [["geodesic", s["torus.ply"], "--source", "0", "--log-map"]]
    lines += [["geodesic", s["bad_torus.ply"], "--source", "0", "--tolerance", "0.05"]]
    lines += [["geodesic", s["torus.ply"], "--source", "0", "--compare", "heat"]]
    lines += simulations(s) + later_calls(s, m)
    return [line for line in lines if all(Path(w).exists() for w in line if w.startswith("/"))]


def simulations(s: dict[str, str]) -> list[list[str]]:
    """Calls of the simulators on the samples `s`."""
    lines: list[list[str]] = []
    lines += [
        [
            "shell-sim",
            s["saddle.obj"],
            "--effect",
            "stretching",
            "--effect",
            "bending",
            "--effect",
            "gravity",
            "--pin",
            "0",
            "--steps",
            "4",
            "--dt",
            "1e-3",
            "--integrator",
            i,
        ]
        for i in ("newmark", "implicit-euler", "verlet", "implicit-midpoint", "symplectic-euler")
    ]
    lines += [["shell-sim", str(SCENES / "leaf.toml"), "--steps", "5"]]
    lines += [["fluid-sim", str(SCENES / "taylor_vortices.toml"), "--steps", "3"]]
    lines += [
        [
            "fluid-sim",
            s["torus.ply"],
            "--effect",
            "initial vorticity='x*z'",
            "--steps",
            "3",
            "--dt",
            "0.01",
            "--integrator",
            i,
        ]
        for i in ("circulation", "conservative")
    ]
    lines += [
        ["willmore-flow", s["ellipsoid.ply"], "--energy", e, "--steps", "3"]
        for e in ("gauss-map", "cotan", "sullivan")
    ]
    lines += [["willmore-flow", s["sphere.ply"], "--flow", "mean-curvature", "--steps", "3", "--dt", "0.001"]]
    return lines


def later_calls(s: dict[str, str], m: dict[str, str]) -> list[list[str]]:
    """`tradeoff`, and the shared meshes `m`."""
    lines: list[list[str]] = []
    lines += [["tradeoff", "curvature", s["torus.ply"], "--truth", "torus:2,1", "--repeat", "1"]]
    lines += [["info", p] for p in m.values()]
    lines += [[c, m["spot.obj"]] for c in ("curvature", "delaunay")]
    lines += [["geodesic", m["spot.obj"], "--source", "0"], ["laplacian", m["spot.obj"], "--eigen", "6"]]
    lines += [["hodge", m["beam-tet.vtk"], "--basis"], ["curvature", m["plane_holes.obj"]]]
    return lines


def summary(checkout: Path, line: list[str], exported: dict[str, str] | None = None) -> dict[str, Any]:
    """Summary of one call with the code of `checkout`, its exit code beside it."""
    environment = os.environ | {"PYTHONPATH": str(checkout)} | (exported or {})
    done = subprocess.run(
        [sys.executable, "-m", "ddgcli", *line, "--json"], cwd=checkout, env=environment, capture_output=True
    )
    body = json.loads(done.stdout) if done.stdout else {"error": done.stderr.decode()[-300:]}
    return body | {"exit_code": done.returncode}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--base", required=True, help="revision to compare with")
    parser.add_argument("--only", default="", help="calls that contain this word")
    options = parser.parse_args()
    differing = compared = 0
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder) / "base"
        subprocess.run(["git", "worktree", "add", "--detach", str(base), options.base], cwd=ROOT, check=True)
        try:
            for line in calls():
                if options.only not in " ".join(line):
                    continue
                moved, _ = compare(
                    summary(base, line), summary(ROOT, line), Tolerances(ignore=IGNORED_FIELDS)
                )
                added = [entry for entry in moved if entry["expected"] == "missing"]  # results that are new
                moved = [entry for entry in moved if entry["expected"] != "missing"]
                compared += 1
                differing += bool(moved)
                note = f" ({len(added)} new results)" if added else ""
                print("differs" if moved else "equal  ", " ".join(line) + note, flush=True)
                for entry in moved[:8]:
                    print("   ", entry)
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", str(base)], cwd=ROOT, check=True)
    print(f"{compared} calls, {differing} differ")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
