"""The peers on the catalogue's meshes and files: right, refused, crashed, hung, or wrong without a word.

`python -m benchmarks.hardcases.peers [--only FAMILY] [--missing]` stores verdicts in peer_results.json and
rewrites the page.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.hardcases import peer_task
from benchmarks.hardcases.catalogue import Case
from benchmarks.hardcases.checks import Evidence, check_geodesic
from benchmarks.hardcases.judge import Outcome
from benchmarks.hardcases.meshes import truths_of
from benchmarks.hardcases.page import write_page
from benchmarks.hardcases.peer_task import READERS, TASKS
from benchmarks.hardcases.run import chosen_cases, prepare, read_arrays, run_process
from benchmarks.hardcases.stored import PEER_RESULTS, store, stored_results
from ddgcli.errors import DdgError
from ddgcli.io.mesh_file import read_mesh
from ddgcli.mesh.triangle_mesh import TriangleMesh

CURVATURE_TOLERANCE = 1e-6  # of the sum of absolute angle defects
PEER_SECONDS = 20  # of processor time: the least that calls a task hung
EXACT_TOLERANCE = 1e-6  # of the largest distance: the peers' own intervals are no shorter
FIRST_ORDER_TASKS = ("potpourri3d heat", "pymeshlab distance")
FIRST_ORDER_TOLERANCE = 0.1  # of the largest distance: a method of first order is right within this


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
    if "eigenvalues" in arrays:
        return _spectrum_fault(arrays["eigenvalues"], points, faces, expected)
    return ""


def _distance_fault(task: str, arrays: dict, points: NDArray, faces: NDArray, expected: dict) -> str:
    """Methods of first order may miss a tenth of the largest distance; exact ones may not leave bounds."""
    if task not in FIRST_ORDER_TASKS:
        evidence = Evidence({}, {"geodesic_distance": arrays["distance"]}, points, faces, expected)
        return next((fault for fault, _ in check_geodesic(evidence, EXACT_TOLERANCE)), "")
    known = expected.get("known_distance")
    straight = np.linalg.norm(points - points[0], axis=1)
    lower = np.where(np.isin(np.arange(len(points)), faces), straight, 0.0)
    if expected["components"] == 1:
        short = float((lower - arrays["distance"]).max())
        if short > FIRST_ORDER_TOLERANCE * straight.max():
            return f"distance {short / straight.max():.1e} of the size below the straight line"
    if known and abs(arrays["distance"][known[0]] - known[1]) > FIRST_ORDER_TOLERANCE * known[1]:
        return f"distance {arrays['distance'][known[0]]:.4g} instead of {known[1]:.4g}"
    return ""


def _curvature_fault(defect: NDArray, faces: NDArray, expected: dict) -> str:
    """Gauss-Bonnet on closed manifold surfaces."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    counts = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)[1]
    if (counts != 2).any():
        return ""
    total, truth = float(defect[np.unique(faces)].sum()), 2 * math.pi * expected["euler_characteristic"]
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
    if zeros < min(expected["components"], len(values)):  # a long chain has small eigenvalues of its own
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
    elif fault := (
        reader_fault(outcome.arrays, expected)
        if task in READERS
        else fault_of(task, outcome.arrays, points, faces, expected)
    ):
        kind, note = "silently wrong", fault
    else:
        kind, note = "right", ""
    return {"kind": kind, "note": note, "seconds": round(outcome.seconds, 1)}


def reader_fault(arrays: dict[str, NDArray], expected: dict) -> str:
    """What is wrong with a mesh that a peer read without an exception; empty where nothing is."""
    points, faces = arrays["points"], arrays["faces"]
    if expected.get("load") == "error":
        return f"reads {len(points)} vertices and {len(faces)} faces of a file that is broken"
    if len(faces) and (faces.min() < 0 or faces.max() >= len(points)):
        return f"a face names vertex {faces.max()} of {len(points)}"
    if expected.get("faces") and not len(faces):
        return f"no face of {expected['faces']}"
    return ""


def arrays_of_file(path: Path) -> tuple[NDArray, NDArray] | None:
    """Points and faces of a surface file as our reader has them; None where there are none to compute on."""
    try:
        mesh = read_mesh(str(path)).mesh
    except DdgError:
        return None
    usable = isinstance(mesh, TriangleMesh) and mesh.n_faces and np.isfinite(mesh.points).all()
    return (mesh.points, mesh.faces) if usable else None


def run_case(case: Case, tasks: list[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Verdicts on tasks of peers on one mesh; the readers where it is a file."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path, points, faces, expected = prepare(case, folder)
        assert path is not None
        source = path
        if case.build is None:
            arrays = arrays_of_file(path)
            if arrays is not None:
                points, faces = arrays
                path = folder / "input.npz"
                np.savez(path, points=points, faces=faces)
                expected = {"faces": len(faces)} | expected
        if points is not None:
            counted = {k: v for k, v in asdict(truths_of(points, faces)).items() if v is not None}
            expected = counted | expected
        for task in tasks:
            if (case.build is not None) if task in READERS else (points is None):
                continue
            output = folder / "peer.npz"
            output.unlink(missing_ok=True)
            action = partial(peer_task.main, [task, str(source if task in READERS else path), str(output)])
            outcome = run_process([], folder, action, cpu_seconds=PEER_SECONDS)
            outcome.arrays = read_arrays(output) if outcome.exit_code == 0 else {}
            yield task, peer_verdict(task, outcome, points, faces, expected)


def main(words: list[str]) -> int:
    """Run every peer on the generated meshes and the tiny ones; the page shows the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", action="append", default=[], help="family or case; repeatable")
    parser.add_argument("--missing", action="store_true", help="only cells that no run has filled")
    options = parser.parse_args(words)
    peer_task.preload()
    results = stored_results(PEER_RESULTS)
    for case in chosen_cases(options.only, False):
        if "geodesic" not in case.calls:
            continue
        row = results.setdefault(case.name, {})
        tasks = [name for name in (*TASKS, *READERS) if not (options.missing and name in row)]
        readers = case.build is None  # the others are meshes without a file
        if not any(readers or task in TASKS for task in tasks):
            continue
        for task, cell in run_case(case, tasks):
            row[task] = cell
            print(json.dumps({"case": case.name, "task": task} | cell), file=sys.stderr, flush=True)
            store(results, PEER_RESULTS)
    write_page(stored_results())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
