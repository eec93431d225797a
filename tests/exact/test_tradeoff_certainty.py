"""Rows are ranked where no truth within the uncertainty of the reference reverses their order."""

from dataclasses import replace

import numpy as np
import pytest

from ddgcli.tradeoff.candidates import Candidate, Problem, Reference, relative_to_largest
from ddgcli.tradeoff.certainty import AnswerDeviation, is_surely_nearer
from ddgcli.tradeoff.measure import run_problem
from ddgcli.tradeoff.pareto import assign_verdicts

NORM = {"max": np.max, "mean": np.mean}


def lengths(answer, reference):
    difference = answer - reference
    return np.linalg.norm(difference, axis=1) if difference.ndim == 2 else np.abs(difference)


def reversing_gain(x, y, uncertainty, norm, rng, n_draws=3000):
    """Least error of the far answer minus that of the near one, over truths within the uncertainty."""
    reference, gains = np.zeros_like(x), []
    for _ in range(n_draws):
        shift = rng.standard_normal(x.shape) * (rng.random(len(x)) < 0.5).reshape(-1, *[1] * (x.ndim - 1))
        if rng.random() < 0.5:  # truths at the far answer in some entries, and beyond the near one in others
            shift = np.where(shift > 0.0, y, -x)
        size = NORM[norm](lengths(shift, reference))
        shift *= uncertainty / size if size > 0.0 else 0.0
        gains.append(NORM[norm](lengths(y, shift)) - NORM[norm](lengths(x, shift)))
    return min(gains)


@pytest.mark.parametrize("norm", ["max", "mean"])
@pytest.mark.parametrize("shape", [(1,), (3,), (2, 3)])
def test_no_truth_within_the_uncertainty_reverses_a_sure_order(norm, shape):
    rng, n_sure = np.random.default_rng(4), 0
    for _ in range(30):
        x, y = rng.standard_normal(shape), 1.5 * rng.standard_normal(shape)
        near, far = (AnswerDeviation(v, reference := np.zeros(shape), lengths) for v in (x, y))
        far = replace(far, reference=near.reference)
        uncertainty = 0.3 * rng.random() * NORM[norm](lengths(y, reference))
        if is_surely_nearer(near, far, uncertainty, norm):
            n_sure += 1
            assert reversing_gain(x, y, uncertainty, norm, rng, 300) > 0.0
    assert n_sure >= 5


@pytest.mark.parametrize("norm", ["max", "mean"])
def test_the_order_of_answers_that_are_alike_is_sure_exactly_where_no_truth_reverses_it(norm):
    reference = np.zeros(2)
    for x, y in ((1.0, 1.5), (1.0, -1.5), (0.0, 1.0), (-0.2, 3.0), (0.2, 3.0)):
        near, far = (AnswerDeviation(np.full(2, value), reference, lengths) for value in (x, y))
        least = 0.5 * abs(x + y)  # the truth in the middle of both answers
        if norm == "mean" and x * y > 0.0:
            least = 0.5 * abs(y)  # one entry of the truth is that of the far answer
        assert is_surely_nearer(near, far, 0.999 * least, norm)
        assert not is_surely_nearer(near, far, 1.001 * least, norm)
        assert not is_surely_nearer(far, near, 0.0, norm)


TRUTH = np.linspace(1.0, 2.0, 5)


@pytest.mark.parametrize(
    "errors, verdict",
    [
        ((0.10, 0.104), "beaten by first"),  # on the same side: the difference is exact
        ((0.010, -0.026), "no verdict possible"),  # on opposite sides: both may be 0.018
        ((0.010, -0.032), "beaten by first"),
    ],
)
def test_the_side_of_the_reference_counts(errors, verdict):
    """A difference of 0.016 was a verdict, one of 0.004 none."""
    uncertain = Reference("planted", TRUTH, 0.01, mean_uncertainty=0.01)

    def answer(error):
        return lambda _: TRUTH + 2.0 * error

    rows = [Candidate(n, {}, lambda: None, answer(e), {}, 0.0) for n, e in zip(("first", "second"), errors)]
    problem = Problem(rows, [(0.0, lambda: uncertain)], relative_to_largest, "the largest value")
    table = run_problem(problem, repeat=0)
    first, second = table.rows
    first.seconds, second.seconds = 1.0, 2.0
    first.setup_seconds = second.setup_seconds = 0.0
    first.seconds_spread = second.seconds_spread = (0.0, 0.0)
    for norm in ("max", "mean"):
        assign_verdicts(table, None, norm)
        assert second.verdict.startswith(verdict)
        second.seconds = 0.5  # then it is on the front, and the other one surely better or not
        assign_verdicts(table, None, norm)
        assert first.on_front == (verdict != "no verdict possible")
        second.seconds = 2.0
