"""The list of deliberate faults is current: every line exists once, every package has a fault."""

from pathlib import Path

import pytest

from benchmarks import mutants
from benchmarks.mutant_list import MUTANTS, Mutant
from benchmarks.mutants import ROOT, Outcome, check, mutated

WITHOUT_COMPUTATION = {"errors", "choices", "progress"}


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda m: f"{m.path}: {m.fault[:30]}")
def test_the_line_of_every_fault_and_its_test_exist(mutant):
    source = (ROOT / mutant.path).read_text(encoding="utf-8")
    changed = mutated(source, mutant)
    assert changed != source and len(changed.splitlines()) == len(source.splitlines())
    file, name = mutant.test.split("::")
    assert f"def {name.split('[')[0]}(" in (ROOT / file).read_text(encoding="utf-8")


def test_there_are_thirty_faults_and_one_in_every_package():
    packages = {path.parent.name for path in (ROOT / "ddgcli").glob("*/__init__.py")}
    topics = {path.parent.name for path in (ROOT / "ddgcli" / "algorithms").glob("*/__init__.py")}
    assert len(MUTANTS) >= 30
    assert packages - {Path(m.path).parts[1] for m in MUTANTS} == set()
    assert topics - {Path(m.path).parts[2] for m in MUTANTS if "algorithms" in m.path} == set()


def test_a_line_that_no_longer_exists_is_an_error():
    with pytest.raises(ValueError, match="0 occurrences"):
        mutated("x = 1\n", Mutant("a.py", "x = 2", "x = 3", "t"))
    with pytest.raises(ValueError, match="2 occurrences"):
        mutated("x = 1\nx = 1\n", Mutant("a.py", "x = 1", "x = 3", "t"))


@pytest.mark.parametrize(
    "before, after, good, report",
    [
        (0, 1, True, "caught by"),
        (0, 0, False, "SURVIVES"),
        (1, 1, False, "WITHOUT THE FAULT"),
        (0, 4, False, "pytest exit 4"),
    ],
)
def test_only_a_test_that_passes_without_and_fails_with_the_fault_counts(
    before, after, good, report, tmp_path, monkeypatch
):
    file = tmp_path / "a.py"
    file.write_text("x = 1\n")

    def run(tree, test):
        return Outcome(before if file.read_text() == "x = 1\n" else after, "")

    monkeypatch.setattr(mutants, "run_test", run)
    outcome = check(tmp_path, Mutant("a.py", "x = 1", "x = 2", "t"), {})
    assert outcome[0] is good and report in outcome[1]
    assert file.read_text() == "x = 1\n"
