"""A scheme whose stable step is far below the step of the scene: refused at once, not run for years."""

import pytest

from ddgcli.errors import SolveError
from ddgcli.simulation.account import Account
from ddgcli.simulation.model import MAX_STEP_COUNT, Model, Observation, RunFailed, Schedule
from ddgcli.simulation.time_loop import evolve


def explicit_model(largest_step, taken):
    def advance(state, time, dt):
        assert dt <= largest_step * (1 + 1e-12)
        taken.append(dt)
        return state + dt

    return Model(
        0.0, advance, lambda state: Observation(None), lambda state: {}, lambda arrays: 0,
        distance=lambda a, b: 0.0, order=1, largest_step=largest_step,
    )  # fmt: skip


@pytest.mark.parametrize("tolerance, most_parts", [(None, 4096), (1.0, MAX_STEP_COUNT)])
def test_a_step_far_above_the_stability_limit_is_refused(tolerance, most_parts):
    taken = []
    schedule = Schedule(1.0, 1, 1, tolerance)
    model = explicit_model(0.999 / most_parts, taken)
    message = f"is over {most_parts:,.0f} times shorter.*implicit scheme"
    with pytest.raises((SolveError, RunFailed), match=message):
        list(evolve({"a": model}, schedule, Account()))
    assert not taken


@pytest.mark.parametrize("tolerance", [None, 1.0])
def test_a_step_some_times_above_it_is_divided(tolerance):
    taken = []
    snapshots = list(evolve({"a": explicit_model(0.1, taken)}, Schedule(1.0, 1, 1, tolerance), Account()))
    assert snapshots[-1].time == 1.0 and 10 <= snapshots[-1].steps <= 32
    assert len(taken) >= 10  # `advance` checks their lengths
