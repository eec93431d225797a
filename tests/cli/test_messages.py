"""Warnings of a run on standard error and in its summary."""

import logging

import pytest

from ddgcli.cli.messages import WARNINGS_OF_A_KIND, MessageHandler


@pytest.fixture
def handler():
    log, handler = logging.getLogger("ddgcli"), MessageHandler(0, False, {})
    log.addHandler(handler)
    yield handler
    log.removeHandler(handler)


@pytest.mark.parametrize(
    ("count", "more"), [(3, ""), (4, "(1 more such warning "), (12, "(9 more such warnings ")]
)
def test_warnings_that_differ_in_numbers_only_are_counted(handler, count, more):
    log = logging.getLogger("ddgcli")
    log.warning("the mesh is open")
    for k in range(count):
        log.warning("%d faces are flat: edges are longer by %.1e", k, 10.0**-k)
    log.warning("the run ends early")
    first, *steps, end = handler.warnings()
    assert (first, end) == ("the mesh is open", "the run ends early")
    assert len(steps) == WARNINGS_OF_A_KIND
    assert more in steps[-1] and ("more such" in steps[-1]) == (count > WARNINGS_OF_A_KIND)
    assert all("more such" not in text for text in steps[:-1])


def test_warnings_of_objects_whose_names_hold_numbers_all_come(handler):
    texts = [f"object 's{k}': step of {1.5 * k:g} s is long" for k in range(6)]
    for text in texts:
        logging.getLogger("ddgcli").warning(text)
    assert handler.warnings() == texts


def test_the_same_warning_comes_once(handler):
    for _ in range(5):
        logging.getLogger("ddgcli").warning("3 faces are flat")
    assert handler.warnings() == ["3 faces are flat"]


def test_a_print_of_warnings_has_those_of_the_summary(handler, capsys):
    for k in range(7):
        logging.getLogger("ddgcli").warning("face %d is flat", k)
    handler.print_warnings()
    assert capsys.readouterr().err.splitlines() == [f"Warning: {text}" for text in handler.warnings()]


def test_a_warning_of_several_rows_comes_once_with_their_names(handler):
    log = logging.getLogger("ddgcli")
    log.warning("the mesh is open")
    for label, text in [
        ("reference", "the error is 5 %"),
        ("cotan", "the error is 5 %"),
        ("cotan", "the mesh is open"),
        ("quadric", "3 faces are flat"),
        ("corrected", "the error is 7 %"),
    ]:
        log.warning(f"{label}: {text}", extra={"row_label": label})
    assert handler.warnings() == [
        "the mesh is open",
        "reference, cotan, corrected: the error is 5 % (the numbers are of reference)",
        "quadric: 3 faces are flat",
    ]


@pytest.mark.parametrize("quiet", [False, True])
def test_the_reason_of_a_failed_run_comes_last_and_when_quiet_alone(handler, quiet, capsys):
    handler.quiet = quiet
    log = logging.getLogger("ddgcli")
    log.error("the step is too long")
    log.warning("the mesh is open")
    handler.print_warnings()
    lines = (
        ["Error: the step is too long"]
        if quiet
        else ["Warning: the mesh is open", "Error: the step is too long"]
    )
    assert capsys.readouterr().err.splitlines() == lines
    assert handler.warnings() == ["the step is too long", "the mesh is open"]
