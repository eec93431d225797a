"""`make kernels`: agreement passes, a planted disagreement fails, a missing kernel is skipped with a note."""

import math
import os
import subprocess
import sys

import pytest

from benchmarks import kernels


def test_one_command_agrees_on_two_kernels_and_a_planted_difference_does_not(monkeypatch, capsys):
    environments = {name: kernels.ENVIRONMENTS[name] for name in ("numpy baseline",)}
    monkeypatch.setattr(kernels, "ENVIRONMENTS", environments)
    assert kernels.main(["curvature of a curve"]) == 0
    assert "2 comparisons, 0 disagree" in capsys.readouterr().out
    assert kernels.main(["--plant=1e-8", "curvature of a curve"]) == 1
    out = capsys.readouterr().out
    assert out.count("DISAGREES") == 2 and "2 comparisons, 2 disagree" in out


def test_a_kernel_that_the_cpu_has_not_is_skipped(monkeypatch):
    monkeypatch.setattr(kernels, "cpu_features", lambda: {"sse2"})
    monkeypatch.setattr(
        kernels, "results_of", lambda case, variables: {"length": 1.0, "total_curvature": 2.0}
    )
    rows, notes = kernels.compare_all(["curvature of a curve"])
    assert {row.environment for row in rows} == {"numpy baseline"}
    assert [note.split(":")[0] for note in notes] == ["Haswell", "Sandybridge", "SkylakeX"]


def test_a_command_that_fails_in_one_environment_disagrees(monkeypatch):
    def results(case, variables):
        if variables:
            raise RuntimeError("exit 1")
        return {"length": 1.0, "total_curvature": 2.0}

    monkeypatch.setattr(kernels, "results_of", results)
    rows, _ = kernels.compare_all(["curvature of a curve"])
    assert rows and not any(row.agrees for row in rows)


@pytest.mark.parametrize("a, b, expected", [
    ([1.0, 4.0], [1.0, 4.4], 0.1), ([0.0], [0.0], 0.0),
    ([1.0], [1.0, 2.0], math.inf), ([1.0], [math.nan], math.inf),
])  # fmt: skip
def test_differences_are_relative_to_the_largest_number(a, b, expected):
    assert kernels.difference(a, b) == pytest.approx(expected)


def test_every_command_on_samples_has_a_case():
    commands = {case.words[0] for case in kernels.CASES.values()}
    assert len(kernels.CASES) >= 12
    others = "info curvature delaunay laplacian hodge geodesic shell-sim fluid-sim willmore-flow"
    assert commands == set(others.split())


def test_the_baseline_of_numpy_has_none_of_its_dispatched_instructions():
    """NumPy 2.4 renamed them: with the old names nothing was turned off, and all results agreed."""
    variables, _ = kernels.ENVIRONMENTS["numpy baseline"]
    program = (
        "from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__\n"
        "print([name for name in __cpu_dispatch__ if __cpu_features__[name]])"
    )
    child = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        capture_output=True, text=True, env=os.environ | variables, check=True,
    )  # fmt: skip
    assert child.stdout.strip() == "[]"
