"""The accuracy check goes red on a planted error and a planted rate, and only then."""

import copy

import pytest

from benchmarks.accuracy import rates, summary_of, worse


def rows(factor: float = 1.0, rate: float = 2.0) -> list[dict]:
    """Two meshes of one configuration whose error is factor h^rate."""
    head = {"truth": "sphere:1", "family": "good", "configuration": "exact"}
    return [
        head | {"level": k, "h": h, "max_error": 2 * factor * h**rate, "mean_error": factor * h**rate}
        for k, h in enumerate((0.2, 0.1))
    ]


def test_rates_are_slopes():
    assert rates(rows(rate=1.5)) == {("sphere:1", "good", "exact"): pytest.approx(1.5)}


def test_nothing_worse_is_silent_and_better_is_no_fault():
    stored = summary_of(rows())
    assert worse(stored, summary_of(rows())) == []
    assert worse(stored, summary_of(rows(factor=0.5))) == []


@pytest.mark.parametrize("planted", [rows(factor=1.2), rows(factor=0.05, rate=0.5), rows()[:1]])
def test_a_planted_loss_is_seen(planted):
    stored = summary_of(rows())
    assert worse(stored, summary_of(copy.deepcopy(planted)))
