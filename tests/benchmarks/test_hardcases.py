"""The hard-case catalogue: a planted wrong answer turns its cell, and the short run has no wrong cell."""

import copy
import json
import os
import sys

import numpy as np
import pytest

from benchmarks.hardcases import meshes
from benchmarks.hardcases.catalogue import CALLS, MESH_COMMANDS, Case, catalogue, default_calls, real_case
from benchmarks.hardcases.judge import (
    DEGRADED_VERDICT,
    REFUSED_VERDICT,
    RIGHT_VERDICT,
    WRONG_VERDICT,
    Outcome,
    judge,
)
from benchmarks.hardcases.page import breaking_point, page
from benchmarks.hardcases.peers import peer_verdict
from benchmarks.hardcases.run import chosen_cases, quick_results, run_cell, run_process
from ddgcli.cli.main import COMMANDS

POINTS, FACES = meshes.one_triangle()
DISTANCE = np.array([0.0, 1.0, 1.0])
SUMMARY = {"input": {"components": 1, "euler_characteristic": 1}, "results": {"max_distance": 1.0},
           "accuracy": {}, "warnings": []}  # fmt: skip
TRUTHS = {"components": 1, "euler_characteristic": 1, "area": 0.5, "known_distance": (1, 1.0)}


def geodesic_outcome(distance=DISTANCE, exit_code=0, stderr="", **changes) -> Outcome:
    summary = copy.deepcopy(SUMMARY) | changes
    return Outcome(exit_code, json.dumps(summary), stderr, arrays={"geodesic_distance": np.array(distance)})


def kind_of(outcome: Outcome, command: str = "geodesic") -> str:
    return judge(command, outcome, POINTS, FACES, TRUTHS).kind


def test_a_right_answer_is_right():
    assert kind_of(geodesic_outcome()) == RIGHT_VERDICT


@pytest.mark.parametrize(
    "planted",
    [
        geodesic_outcome([0.0, 1.1, 1.0]),
        geodesic_outcome([0.0, 0.9, 1.0]),
        geodesic_outcome([0.0, np.nan, 1.0]),
        geodesic_outcome([0.1, 1.0, 1.0]),
        geodesic_outcome(results={"x": float("nan")}),
        geodesic_outcome(input={"components": 2, "euler_characteristic": 1}),
        geodesic_outcome(exit_code=1),
        geodesic_outcome(exit_code=3, stderr="Error: x"),
        Outcome(0, "", ""),
        Outcome(2, "", "Error: one\nand another"),
        Outcome(2, "", "Error: " + "x" * 5000),
        Outcome(2, "{}", "Error: x"),
        Outcome(1, "", "Traceback (most recent call last):\nValueError: x"),
        Outcome(2, "", "Error: internal error: KeyError"),
        Outcome(-9, "", "", over="time"),
        Outcome(0, json.dumps(SUMMARY), "", over="memory"),
    ],
)
def test_a_planted_fault_turns_the_cell(planted):
    assert kind_of(planted) == WRONG_VERDICT


def test_a_warning_that_names_the_violated_truth_degrades_the_cell():
    named = geodesic_outcome([0.0, 0.9, 1.0], warnings=["distance of 1 vertex is below its bound"])
    unrelated = geodesic_outcome([0.0, 0.9, 1.0], warnings=["the file has a comment"])
    assert kind_of(named) == DEGRADED_VERDICT
    assert kind_of(unrelated) == WRONG_VERDICT


def test_one_line_refuses_the_cell_and_exit_one_degrades_it():
    assert kind_of(Outcome(2, "", "Error: input.npz: no face has area")) == REFUSED_VERDICT
    assert kind_of(geodesic_outcome(exit_code=1, stderr="Error: not converged")) == DEGRADED_VERDICT


@pytest.mark.parametrize(
    "command, results, accuracy",
    [
        ("curvature", {"area": 0.6}, {}),
        ("curvature", {}, {"gauss_bonnet_residual": 1e-3}),
        ("delaunay", {"after": {"non_delaunay_edges": 3}}, {}),
        ("delaunay", {}, {"area_residual": 1e-2}),
        ("laplacian", {"eigenvalues": [-1.0, 0.0, 2.0], "area": 0.5}, {}),
        ("laplacian", {"eigenvalues": [0.0, 0.0, 2.0], "area": 0.5}, {}),
        ("dec", {}, {"derivative_residual": 1}),
        ("hodge", {"betti_numbers": {"absolute": [1, 2, 1]}}, {}),
        ("fluid-sim", {"kinetic_energy_start": 0.0, "kinetic_energy": 1e-9}, {}),
        ("willmore-flow", {"energy": [1.0, 1.1]}, {}),
        ("willmore-flow", {"energy": [1.0, -0.1]}, {}),
        ("shell-sim", {}, {}),
    ],
)
def test_each_command_has_a_truth_that_a_planted_result_violates(command, results, accuracy):
    summary = SUMMARY | {"results": results, "accuracy": accuracy}
    assert kind_of(Outcome(0, json.dumps(summary), ""), command) == WRONG_VERDICT


@pytest.mark.parametrize(
    "values, kind", [([-1e-15, 2e-16, 6e-15], RIGHT_VERDICT), ([0.0, 1e-15, 0.3], WRONG_VERDICT)]
)
def test_zero_eigenvalues_of_a_file_are_measured_by_its_faces(values, kind):
    summary = {"input": {"components": 3, "faces": 150}, "results": {"area": 10.0, "eigenvalues": values}}
    outcome = Outcome(0, json.dumps(SUMMARY | summary))
    assert judge("laplacian", outcome, expected={"components": 3}).kind == kind


def test_a_body_at_rest_that_moves_is_wrong():
    summary = SUMMARY | {"results": {"energies": {"total": {"start": 0.0, "end": 0.0}}}}
    for shift, kind in ((0.0, RIGHT_VERDICT), (1e-3, WRONG_VERDICT)):
        outcome = Outcome(0, json.dumps(summary), "", arrays={"points": POINTS + shift})
        assert kind_of(outcome, "shell-sim") == kind


@pytest.mark.parametrize(
    "resumed, kind",
    [([0.0, 1.0, 1.0], RIGHT_VERDICT), ([0.0, 1.0, 1.0 + 2e-16], WRONG_VERDICT), (None, WRONG_VERDICT)],
)
def test_a_resumed_run_that_differs_by_a_bit_or_lacks_a_frame_is_wrong(resumed, kind):
    whole = {"points 0 of whole": DISTANCE}
    arrays = whole if resumed is None else whole | {"points 0 of run": np.array(resumed)}
    outcome = Outcome(0, json.dumps(SUMMARY), "", arrays=arrays)
    assert judge("fluid-sim", outcome, checks=("resumed_as_whole",)).kind == kind


def test_every_command_of_the_program_has_a_call_and_a_column():
    assert set(CALLS) == set(COMMANDS)
    assert {name for case in catalogue() for name in case.calls} == set(COMMANDS)
    names = [case.name for case in catalogue()]
    assert len(names) == len(set(names))


@pytest.mark.parametrize(
    "arrays, betti",
    [
        (meshes.needles(1e3), (1, 0, 0)),
        (meshes.caps(1e3), (1, 0, 1)),
        (meshes.fan(20), (1, 0, 0)),
        (meshes.handles(3), (1, 6, 1)),
        (meshes.tetrahedra(5), (5, 0, 5)),
        (meshes.hinge(1.0), (1, 0, 0)),
    ],
)
def test_generated_families_have_the_topology_that_the_catalogue_states(arrays, betti):
    truths = meshes.truths_of(*arrays)
    assert truths.components == betti[0]
    assert truths.euler_characteristic == betti[0] - betti[1] + betti[2]
    sides = np.concatenate([arrays[1][:, [k, (k + 1) % 3]] for k in range(3)])
    assert len(np.unique(sides, axis=0)) == len(sides)  # oriented


def test_the_breaking_point_is_the_first_parameter_that_is_not_right():
    assert breaking_point([(1e2, RIGHT_VERDICT), (1e4, RIGHT_VERDICT)]) == "✓ to 10000"
    assert (
        breaking_point([(1e2, RIGHT_VERDICT), (1e4, REFUSED_VERDICT), (1e6, RIGHT_VERDICT)])
        == "✓ to 100; – at 10000"
    )
    assert breaking_point([(1e2, WRONG_VERDICT)]) == "**✗** at 100"
    assert breaking_point([(1e2, None)]) == "?"


def test_the_page_shows_a_wrong_cell_and_names_its_fault():
    case = Case("sharp", "needles, aspect", lambda: (POINTS, FACES), parameter=1.0,
                calls=default_calls(("info", "geodesic")))  # fmt: skip
    cell = {"kind": WRONG_VERDICT, "note": "distance NaN", "seconds": 0.1, "peak_mib": 50}
    text = page({"sharp": {"geodesic": cell}}, [case])
    assert "| sharp | ? | **✗** |" in text
    assert "- **✗** sharp, `geodesic`: distance NaN" in text


def test_the_page_shows_which_commands_a_file_is_too_large_for(tmp_path):
    (tmp_path / "a.obj").write_bytes(b"#" * 400_000)
    case = real_case(tmp_path / "a.obj")
    assert set(case.calls) | set(case.too_large) == set(MESH_COMMANDS) and len(case.too_large) > 4
    kinds = {name: {"kind": RIGHT_VERDICT, "note": "", "seconds": 0.1} for name in case.calls}
    text = page({case.name: kinds}, [case, Case("b", "real meshes", calls=default_calls())])
    row = next(line for line in text.splitlines() if line.startswith("| real meshes/a.obj"))
    assert row.count("▫") == len(case.too_large) and row.count("✓") == len(case.calls)


def test_a_broken_file_that_is_read_is_wrong():
    assert judge("info", Outcome(0, json.dumps(SUMMARY)), expected={"load": "error"}).kind == WRONG_VERDICT
    assert judge("info", Outcome(2, "", "Error: cut"), expected={"load": "error"}).kind == REFUSED_VERDICT


def test_peers_that_read_broken_files_are_counted():
    arrays = {"points": POINTS, "faces": FACES}
    outcome = Outcome(0, arrays=arrays)
    for expected, kind in (({"load": "error"}, "silently wrong"), ({"load": "ok"}, "right")):
        assert peer_verdict("meshio reader", outcome, None, None, expected)["kind"] == kind
    outside = Outcome(0, arrays=arrays | {"faces": FACES + 1})
    assert peer_verdict("libigl reader", outside, None, None, {"load": "ok"})["kind"] == "silently wrong"


def test_limits_end_a_process_that_takes_too_much_time(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.hardcases.run.CPU_SECONDS", 1)
    outcome = run_process([sys.executable, "-c", "while True: pass"], tmp_path)
    assert outcome.over == "time"
    assert kind_of(outcome) == WRONG_VERDICT


def test_limits_end_a_process_that_takes_too_much_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.hardcases.run.PEAK_MIB", 100)
    hog = "import time; b = bytearray(300 << 20); b[::4096] = b'x' * len(b[::4096]); time.sleep(60)"
    outcome = run_process([sys.executable, "-c", hog], tmp_path)
    assert outcome.over == "memory"
    assert kind_of(outcome) == WRONG_VERDICT


def test_a_planted_peer_fault_is_counted():
    right = Outcome(0, arrays={"distance": DISTANCE})
    assert peer_verdict("libigl exact", right, POINTS, FACES, TRUTHS)["kind"] == "right"
    wrong = Outcome(0, arrays={"distance": DISTANCE * 0.7})
    assert peer_verdict("libigl exact", wrong, POINTS, FACES, TRUTHS)["kind"] == "silently wrong"
    assert peer_verdict("potpourri3d heat", wrong, POINTS, FACES, TRUTHS)["kind"] == "silently wrong"
    assert peer_verdict("libigl exact", Outcome(-6), POINTS, FACES, TRUTHS)["kind"] == "crashed"


@pytest.mark.slow
def test_no_cell_of_the_short_run_is_wrong():
    results = quick_results()
    assert {case.name for case in chosen_cases([], quick=True)} == set(results)
    assert not [(case, cell) for case, row in results.items() for cell in row.values()
                if cell["kind"] == WRONG_VERDICT]  # fmt: skip


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the planted fault is inherited by a fork")
def test_a_fault_planted_in_the_program_turns_its_cell(monkeypatch):
    from ddgcli.algorithms.inspection import quality

    case = next(case for case in catalogue() if case.name == "one triangle")
    assert run_cell(case, "info", preloaded=True)[0].kind == RIGHT_VERDICT
    area_of = quality.surface_area
    monkeypatch.setattr(quality, "surface_area", lambda mesh: 1.001 * area_of(mesh))
    verdict = run_cell(case, "info", preloaded=True)[0]
    assert verdict.kind == WRONG_VERDICT
    assert "area" in verdict.note
