"""The peers on the catalogue's generated meshes: right, refused, crashed, hung, or wrong without a word.

`python -m benchmarks.hardcases.peers [--only FAMILY] [--missing]` stores verdicts in peer_results.json and
writes the page anew.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.hardcases.catalogue import Case
from benchmarks.hardcases.judge import Evidence, Outcome, check_geodesic
from benchmarks.hardcases.meshes import truths_of
from benchmarks.hardcases.page import write_page
from benchmarks.hardcases.peer_task import TASKS
from benchmarks.hardcases.run import chosen_cases, prepare, read_arrays, run_process
from benchmarks.hardcases.stored import PEER_RESULTS, store, stored_results

CURVATURE_TOLERANCE = 1e-6  # of the sum of absolute angle defects
HEAT_TOLERANCE = 0.1  # of the largest distance: a method of first order is right within this


def fault_of(task: str, arrays: dict[str, NDArray], points: NDArray, faces: NDArray, expected: dict) -> str:
    """What is wrong with the answer of a peer; empty where nothing is."""
    for name, array in arrays.items():
        reachable = expected["components"] == 1 or name != "distance"
        if np.isnan(array).any() or (reachable and not np.isfinite(array).all()):
            return f"{name} is not finite"
    if "distance" in arrays:
        return _distance_fault(task, arrays, points, faces, expected)
    if "angle_defect" in arrays:
        return _curvature_fault(arrays["angle_defect"], faces, expected)
    return _spectrum_fault(arrays["eigenvalues"], points, faces, expected)


def _distance_fault(task: str, arrays: dict, points: NDArray, faces: NDArray, expected: dict) -> str:
    """Heat methods may be off by a tenth of the largest distance; exact ones may not leave the bounds."""
    if "heat" not in task:
        evidence = Evidence({}, {"geodesic_distance": arrays["distance"]}, points, faces, expected)
        return next((fault for fault, _ in check_geodesic(evidence)), "")
    known = expected.get("known_distance")
    straight = np.linalg.norm(points - points[0], axis=1)
    lower = np.where(np.isin(np.arange(len(points)), faces), straight, 0.0)
    if expected["components"] == 1:
        short = float((lower - arrays["distance"]).max())
        if short > HEAT_TOLERANCE * straight.max():
            return f"distance {short / straight.max():.1e} of the size below the straight line"
    if known and abs(arrays["distance"][known[0]] - known[1]) > HEAT_TOLERANCE * known[1]:
        return f"distance {arrays['distance'][known[0]]:.4g} instead of {known[1]:.4g}"
    return ""


def _curvature_fault(defect: NDArray, faces: NDArray, expected: dict) -> str:
    """Gauss-Bonnet on closed manifold surfaces."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    counts = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)[1]
    if (counts != 2).any():
        return ""
    total, truth = float(defect.sum()), 2 * math.pi * expected["euler_characteristic"]
    if abs(total - truth) > CURVATURE_TOLERANCE * max(1.0, float(np.abs(defect).sum())):
        return f"total curvature {total:.6g} instead of {truth:.6g}"
    return ""


def _spectrum_fault(values: NDArray, points: NDArray, faces: NDArray, expected: dict) -> str:
    """One zero a component, none negative."""
    edge = np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1).mean()
    scale = max(float(np.abs(values).max()), 1.0 / edge**2)
    zeros = int((np.abs(values) < 1e-6 * scale).sum())
    if values.min() < -1e-6 * scale:
        return f"eigenvalue {values.min():.1e}"
    if zeros != min(expected["components"], len(values)):
        return f"{zeros} zero eigenvalues, {expected['components']} components"
    return ""


def peer_verdict(
    task: str, outcome: Outcome, points: NDArray, faces: NDArray, expected: dict
) -> dict[str, Any]:
    """Kind and note of one peer's cell."""
    last = (outcome.stderr.strip().splitlines() or [""])[-1][:200]
    if outcome.over == "time":
        kind, note = "hung", f"over {outcome.seconds:.0f} s"
    elif outcome.over == "memory":
        kind, note = "over memory", f"{outcome.peak_mib:.0f} MiB"
    elif outcome.exit_code < 0:
        kind, note = "crashed", f"signal {-outcome.exit_code}"
    elif outcome.exit_code:
        kind, note = "refused", last
    elif fault := fault_of(task, outcome.arrays, points, faces, expected):
        kind, note = "silently wrong", fault
    else:
        kind, note = "right", ""
    return {"kind": kind, "note": note, "seconds": round(outcome.seconds, 1)}


def run_peer(case: Case, task: str) -> dict[str, Any]:
    """Verdict on one task of one peer on one mesh."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path, points, faces, expected = prepare(case, folder)
        output = folder / "peer.npz"
        words = [sys.executable, "-m", "benchmarks.hardcases.peer_task", task, str(path), str(output)]
        outcome = run_process(words, folder)
        outcome.arrays = read_arrays(output) if outcome.exit_code == 0 else {}
    expected = {"components": truths_of(points, faces).components} | expected
    return peer_verdict(task, outcome, points, faces, expected)


def main(words: list[str]) -> int:
    """Run every peer on the generated meshes and the tiny ones; the page shows the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", action="append", default=[], help="family or case; repeatable")
    parser.add_argument("--missing", action="store_true", help="only cells that no run has filled")
    options = parser.parse_args(words)
    results = stored_results(PEER_RESULTS)
    for case in chosen_cases(options.only, False):
        if case.build is None or "geodesic" not in case.calls:
            continue
        row = results.setdefault(case.name, {})
        for task in TASKS:
            if options.missing and task in row:
                continue
            row[task] = run_peer(case, task)
            print(json.dumps({"case": case.name, "task": task} | row[task]), file=sys.stderr, flush=True)
        store(results, PEER_RESULTS)
    write_page(stored_results())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
