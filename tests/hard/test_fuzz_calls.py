"""Random valid calls of the fuzz: every option occurs, calls run or are refused, faults are detected."""

import json
from random import Random
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.fuzz import call_checks, call_meshes, call_options
from benchmarks.fuzz.call_cures import cures, place_of
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
        if not call_options.is_known(option)
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
    for seed in range(3):
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


def outcome(words="info a.ply --json", code=0, stdout="{}", stderr="", files=(), seconds=0.0):
    error = stderr.removeprefix("Error: ")
    return SimpleNamespace(
        words=words.split(), exit_code=code, stdout=stdout, stderr=stderr, new_files=list(files),
        seconds=seconds, exception=None, error=error if stderr.startswith("Error: ") else "",
        summary=json.loads(stdout) if stdout else None,
    )  # fmt: skip


@pytest.mark.parametrize(
    "fault, text",
    [
        (outcome(code=1, stderr="Error: internal error: KeyError: 3"), "internal error"),
        (outcome(code=-9), "exit code -9"),
        (outcome(code=2, stdout="", stderr="Error: a\nand b"), "2 lines"),
        (outcome(code=2, stdout="", stderr="Error: " + "long " * 200), "1000 characters"),
        (outcome(code=2, stdout="", stderr="Error: a", files=["a.npz"]), "refused, but wrote"),
        (outcome(files=["a.vtu"]), "does not list"),
        (outcome(seconds=100), "took 100 s"),
        (outcome(code=1, stderr="Error: out of memory"), "out of memory"),
        (outcome(stdout='{"results": {"length": -1.0}}'), "length -1.0"),
    ],
)
def test_a_fault_of_a_call_is_detected(tmp_path, fault, text):
    with pytest.raises(call_checks.CallError, match=text):
        call_checks.check_outcome(fault, MESH, tmp_path)


def test_values_that_are_not_finite_are_detected_in_every_written_format(tmp_path):
    np.savez(tmp_path / "a.npz", points=np.eye(3), faces=[[0, 1, 2]], f=[0.0, np.nan, 1])
    summary = json.dumps({"results": {}, "outputs": ["a.npz"]})
    with pytest.raises(call_checks.CallError, match=r"NaN in f of a\.npz"):
        call_checks.check_outcome(outcome(stdout=summary, files=["a.npz"]), MESH, tmp_path)
    call_checks.check_finite("geodesic", "a.npz", "geodesic_distance", np.array([np.inf]))


@pytest.mark.parametrize(
    "words, message, cured",
    [
        ("geodesic {input} --path-to 3", "--path-to: needs a source, e.g. --source 0", "--source 0"),
        (
            "geodesic {input} --source 0 --method heat --path-to 3",
            "--path-to: follows the exact distance, not that of heat; use --method exact",
            "--method exact",
        ),
        (
            "curvature {input} --jobs 2 --scheme cotan",
            "--jobs: is for --scheme quadric; leave it out",
            "--scheme cotan",
        ),
    ],
)
def test_the_cure_of_a_refusal_is_read_from_its_text(words, message, cured):
    place = place_of(Random(0), words.split(), MESH)
    cure = next(cures(words.split(), message, place, "mesh.npz"))
    assert cured in " ".join(cure.words)
    assert "--jobs" not in cure.words


def test_a_repair_that_a_refusal_names_is_a_call():
    message = "no area; remove such faces with ddgcli repair mesh.ply --drop-degenerate -o mesh-repaired.ply"
    words = ["shell-sim", "{input}"]
    cure = next(cures(words, message, place_of(Random(0), words, MESH), "mesh.ply"))
    assert cure.before == ("repair", "{input}", "--drop-degenerate", "-o", "{folder}/repaired.ply")
    assert cure.words == ["shell-sim", "{folder}/repaired.ply"]
