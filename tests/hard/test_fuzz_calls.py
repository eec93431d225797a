"""Random valid calls of the fuzz: every option occurs, calls run or are refused, faults are detected."""

import json
from random import Random

import numpy as np
import pytest

from benchmarks.fuzz import call_checks, call_meshes, call_options
from benchmarks.fuzz.call_dry_runs import disagreement
from benchmarks.fuzz.call_remedies import place_of, remedies
from benchmarks.fuzz.inputs import kinds
from ddgcli.cli.main import COMMANDS
from ddgcli.errors import DdgError

CALLS = range(200)
MESH = {"name": "square", "suffix": ".npz", "cells": "faces",
        "points": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "numbers": [[0, 1, 2]]}  # fmt: skip


def test_every_option_of_every_command_has_random_values():
    assert set(call_options.WEIGHTS) == set(COMMANDS) - {"examples"}  # it takes no input
    unknown = [
        (name, option.name)
        for name in call_options.WEIGHTS
        for option in call_options.options_of(name)
        if not (option.is_flag or call_options.value_generator(option))
    ]
    assert unknown == []


def test_random_calls_name_every_command_and_every_kind_of_mesh():
    calls = [json.loads(call_options.random_call(Random(seed))) for seed in CALLS]
    often = {name for name, weight in call_options.WEIGHTS.items() if weight >= 2}
    assert often <= {call["words"][0] for call in calls} <= set(call_options.WEIGHTS)
    assert {call["mesh"]["cells"] for call in calls} == {"faces", "tetrahedra", "lines"}
    assert len({call["mesh"]["name"].split(",")[0] for call in calls}) > 20
    make = call_options.random_call
    assert make(Random(7)) == make(Random(7)) != make(Random(8))


def test_a_random_call_runs_or_is_refused_in_one_line():
    kind = kinds()["valid call"]
    read, accepted = kind.reader(), 0
    for seed in range(2, 6):
        try:
            read(kind.random_input(Random(seed)))
            accepted += 1
        except DdgError as refusal:
            assert "\n" not in str(refusal)
    assert accepted


@pytest.mark.parametrize("cells, suffix", [("faces", ".obj"), ("tetrahedra", ".vtu"), ("lines", ".csv")])
def test_a_written_mesh_has_the_points_and_cells_of_its_numbers(tmp_path, cells, suffix):
    from ddgcli.io.mesh_file import read_mesh

    mesh = call_meshes.random_mesh(Random(3), cells) | {"suffix": suffix}
    path = tmp_path / f"a{suffix}"
    path.write_bytes(call_meshes.mesh_file(mesh))
    points, numbers = call_meshes.mesh_arrays(mesh)
    source = read_mesh(str(path)).mesh
    assert np.array_equal(source.points, points)
    assert len(getattr(source, cells)) == len(numbers)


def outcome(**values):
    """Outcome of a call of info that wrote an empty summary, but for some values."""
    normal = {"words": ["info", "a.ply", "--json"], "exit_code": 0, "stdout": "{}"}
    return call_checks.CallOutcome(**(normal | values))


def refusal(error, **values):
    """Outcome of a call that ended with an error."""
    return outcome(exit_code=2, stdout="", stderr=f"Error: {error}", **values)


@pytest.mark.parametrize(
    "fault, text",
    [
        (outcome(exit_code=1, stderr="Error: internal error: KeyError: 3"), "internal error"),
        (outcome(exit_code=-9), "exit code -9"),
        (outcome(exit_code=1, stdout=""), "without a summary or an error"),
        (outcome(exit_code=2, stdout="", stderr="Error: a\nand b"), "2 lines"),
        (outcome(exit_code=2, stdout="", stderr="Error: " + "long " * 200), "1000 characters"),
        (outcome(exit_code=2, stdout="", stderr="Error: a", new_files=["a.npz"]), "refused, but wrote"),
        (outcome(new_files=["a.vtu"]), "does not list"),
        (outcome(seconds=100), "took 100 s"),
        (outcome(exit_code=1, stderr="Error: out of memory"), "out of memory"),
        (outcome(stdout=""), "no summary"),
        (outcome(stdout='{"results": {"area": NaN}}'), "NaN in the summary"),
        (outcome(stdout='{"results": {"length": -1.0}}'), "length -1.0"),
    ],
)
def test_a_fault_of_a_call_is_detected(tmp_path, fault, text):
    with pytest.raises(call_checks.CallError, match=text):
        call_checks.check_outcome(fault, MESH, tmp_path)


@pytest.mark.parametrize(
    "dry, run, text",
    [
        (outcome(), refusal("a"), "exit code 0, the run's 2: a"),
        (refusal("a"), outcome(), "the dry run is refused, the run is not: a"),
        (refusal("a"), refusal("b"), "refused by 'a', the run by 'b'"),
        (refusal("a"), refusal("a"), ""),
        (outcome(), outcome(exit_code=1), ""),
        (outcome(), refusal("--cut-to-disk: a", words=["repair", "a.ply"]), ""),
        (refusal("needs 9 GiB of memory"), outcome(), ""),
    ],
)
def test_a_dry_run_that_disagrees_with_the_run_is_a_fault(dry, run, text):
    fault = disagreement(dry, run)
    assert text in fault and bool(text) == bool(fault)


def test_a_planted_gap_between_the_dry_run_and_the_run_is_noticed(tmp_path, monkeypatch):
    from ddgcli.algorithms.laplacian import check_tasks

    call = {"mesh": MESH, "prepare": [], "words": ["laplacian", "{input}", "--eigen", "4"]}
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DdgError, match="4 eigenpairs exceed the 3 vertices"):
        call_checks.run_call(call, tmp_path)
    # the run checks its tasks once more, where it solves them
    monkeypatch.setattr(check_tasks, "check_tasks", lambda mesh, tasks: None)
    with pytest.raises(call_checks.CallError, match="exit code 0, the run's 2: .*4 eigenpairs exceed"):
        call_checks.run_call(call, tmp_path)


@pytest.mark.parametrize("suffix", [".npz", ".vtkhdf", ".vtu", ".ply"])
def test_values_that_are_not_finite_are_detected_in_written_files(tmp_path, suffix):
    from ddgcli.io.mesh_file import write_mesh
    from ddgcli.mesh.fields import AnnotatedMesh
    from ddgcli.mesh.triangle_mesh import TriangleMesh

    mesh = TriangleMesh.from_arrays(np.eye(3), np.array([[0, 1, 2]]))
    file = f"a{suffix}"
    write_mesh(str(tmp_path / file), AnnotatedMesh(mesh, {"f": np.array([0.0, np.nan, 1])}))
    call = outcome(stdout=json.dumps({"results": {}, "outputs": [file]}), new_files=[file])
    with pytest.raises(call_checks.CallError, match=rf"NaN in f of a\{suffix}"):
        call_checks.check_outcome(call, MESH, tmp_path)


def test_distances_and_radii_of_straight_lines_may_be_infinite_but_no_other_array():
    values = np.array([np.inf])
    for name in ("geodesic_distance", "osculating_radius"):
        call_checks.check_finite("", "a.npz", name, values)  # raises no error
    with pytest.raises(call_checks.CallError, match="infinity in f"):
        call_checks.check_finite("", "a.npz", "f", values)


SOURCE = "geodesic {input} --source 0"


@pytest.mark.parametrize(
    "words, message, expected",
    [
        (
            "geodesic {input} --path-to 3",
            "--path-to: needs a source, e.g. --source 0",
            "geodesic {input} --path-to 3 --source 0",
        ),
        (
            f"{SOURCE} --method heat --path-to 3",
            "--path-to: follows the exact distance, not that of heat; use --method exact",
            f"{SOURCE} --path-to 3 --method exact",
        ),
        (
            "curvature {input} --jobs 2 --scheme cotan",
            "--jobs: is for --scheme quadric; leave it out",
            "curvature {input} --scheme cotan",
        ),
        (
            f"{SOURCE} --method heat --tolerance 0.1 --jobs 2 --fan 3",
            "needs the exact distance; leave --tolerance and --jobs out",
            f"{SOURCE} --method heat --fan 3",
        ),
    ],
)
def test_the_remedy_of_a_refusal_is_read_from_its_text(words, message, expected):
    place = place_of(Random(0), words.split(), MESH)
    assert next(remedies(words.split(), message, place, "mesh.npz")).words == expected.split()


def test_a_repair_that_a_refusal_names_is_a_call():
    message = "no area; remove such faces with ddgcli repair mesh.ply --drop-degenerate -o mesh-repaired.ply"
    words = ["shell-sim", "{input}"]
    remedy = next(remedies(words, message, place_of(Random(0), words, MESH), "mesh.ply"))
    assert remedy.before == ("repair", "{input}", "--drop-degenerate", "-o", "{folder}/repaired.ply")
    assert remedy.words == ["shell-sim", "{folder}/repaired.ply"]
    message = "one-sided; cut it open with ddgcli repair repaired.ply --cut-to-disk -o repaired-repaired.ply"
    second = next(remedies(remedy.words, message, place_of(Random(0), words, MESH), "repaired.ply"))
    assert second.before[1] == "{folder}/repaired.ply" and second.before[-1] == "{folder}/twice_repaired.ply"
    assert second.words == ["shell-sim", "{folder}/twice_repaired.ply"]
