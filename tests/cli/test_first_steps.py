"""Predictions by the first steps of a run: what they cost, and where a trial of them ends."""

import logging
from dataclasses import replace

import pytest

from ddgcli.cli.forecast.prediction import predict
from ddgcli.cli.forecast.simulator_kernels import ITERATIONS_TO_REST
from ddgcli.cli.forecast.use import InputSize, Use
from ddgcli.cli.simulation import first_steps
from ddgcli.cli.simulation.simulate import Job
from ddgcli.simulation.account import Account
from ddgcli.simulation.model import Model, Observation, Schedule, StepRejected
from tests.simulate import HANGING_CLOTH, shell_models


class Clock:
    """Stands for the CPU clock: a first step takes 0.5 s, later ones 0.01 s."""

    now, calls = 0.0, 0

    def advance(self, state, time, dt):
        if time > 0.985:
            raise StepRejected("newton")
        self.calls += 1
        self.now += 0.5 if self.calls == 1 else 0.01
        return state

    def process_time(self):
        return self.now


@pytest.mark.parametrize(
    ("steps", "times", "expected"),
    [(100, 100.0, 1.0), (1000, 1000.0, 10.0), (5, 5.0, None), (100, 1e5, None)],
)
def test_steps_cost_what_the_first_ones_of_the_run_cost(steps, times, expected, monkeypatch):
    """The first alone prepares; few steps, and long ones, are left to the table."""
    clock = Clock()
    monkeypatch.setattr(first_steps.time, "process_time", clock.process_time)
    model = Model(0, clock.advance, lambda state: Observation(None), lambda state: {}, lambda arrays: 0)
    job = Job({"a": model}, [], Schedule(0.98 / steps, steps), Account(), moving=False)
    range_ = (0.6, 3.0)
    size = InputSize("surface", 2000)
    kernels = [Use("shell-sim"), Use("shell-sim implicit step", times, range=range_)]
    by_table = predict(kernels, size, calibrate=False)
    trial = first_steps.with_first_steps(by_table, job)
    if expected is None:
        assert trial == by_table and clock.calls == 0
        return
    assert clock.calls <= max(10, 0.1 * steps)
    assert trial.kernels[1]["seconds"] == pytest.approx(expected) and trial.kernels[1]["times"] == times
    others = trial.seconds - expected
    assert trial.seconds_range == pytest.approx((others + 0.6 * expected, others + 3 * expected))
    # before contact steps are a free fall
    assert first_steps.with_first_steps(by_table, job, at_least_table=True) == by_table
    failing = replace(job, schedule=replace(job.schedule, on_failure="stop", dt=0.99))
    assert first_steps.with_first_steps(by_table, failing) == by_table


def test_the_trial_ends_within_steps_of_very_many_parts_and_warns(monkeypatch, caplog):
    """Adaptive steps of a flow that relaxes in 1e-8 s: the dry run took as long as the run."""
    clock = Clock()
    monkeypatch.setattr(first_steps.time, "process_time", clock.process_time)
    monkeypatch.setattr(logging.getLogger("ddgcli"), "propagate", True)
    model = Model(
        0, clock.advance, lambda state: Observation(None), lambda state: {}, lambda arrays: 0,
        distance=lambda a, b: 0.81e-3, order=1, largest_step=1e-6,
    )  # fmt: skip
    schedule = Schedule(0.01, 90, 1, 1e-3, first_dt=1e-6)
    job = Job({"a": model}, [], schedule, Account(), moving=False)
    by_table = predict([Use("shell-sim implicit step", 90)], InputSize("surface", 2000), calibrate=False)
    assert first_steps.with_first_steps(by_table, job) == by_table
    assert clock.now < 1.2 * first_steps.MAX_TRIAL_SECONDS and "may take far longer" in caplog.text


def test_the_trial_ends_within_first_steps_that_take_long_and_counts_them(monkeypatch, caplog):
    """A shell that shatters: 0.8 s predicted, one of ten steps took 2 s and the run over 200."""
    seconds = 3.0
    clock = Clock()
    monkeypatch.setattr(first_steps.time, "process_time", clock.process_time)
    monkeypatch.setattr(logging.getLogger("ddgcli"), "propagate", True)

    def advance(state, time, dt):
        clock.now += seconds
        return state

    model = Model(0, advance, lambda state: Observation(None), lambda state: {}, lambda arrays: 0)
    job = Job({"a": model}, [], Schedule(0.01, 90), Account(), moving=False)
    use = Use("shell-sim implicit step", 90, range=(0.6, 3.0))
    by_table = predict([use], InputSize("surface", 2000), calibrate=False)
    trial = first_steps.with_first_steps(by_table, job)
    assert clock.now == seconds and "may take far longer" in caplog.text
    assert trial.kernels[0]["seconds"] == pytest.approx(90 * seconds)
    assert trial.seconds_range[0] == by_table.seconds_range[0]
    assert trial.seconds_range[1] == pytest.approx(3.0 * 90 * seconds)


def test_later_steps_count_their_further_iterations(monkeypatch):
    """Once as many as the first, 4 of later 10: 2.5 s were predicted for 4.7."""

    def growth(steps, count):
        clock = Clock()
        monkeypatch.setattr(first_steps.time, "process_time", clock.process_time)

        def advance(state, time, dt):
            clock.now += 0.01
            return state + count

        model = Model(
            0, advance, lambda state: Observation(None), lambda state: {}, lambda arrays: 0,
            iterations=(lambda state: float(state)) if count else None,
        )  # fmt: skip
        job = Job({"a": model}, [], Schedule(0.98 / steps, steps), Account(), moving=False)
        by_table = predict(
            [Use("shell-sim implicit step", steps)], InputSize("surface", 2000), calibrate=False
        )
        trial = first_steps.with_first_steps(by_table, job)
        return trial.kernels[0]["seconds"] / (0.01 * steps)

    assert growth(100, 0) == pytest.approx(1)
    assert 1.2 < growth(10, 3) < growth(30, 3) < 2.5
    assert growth(100, 6) == pytest.approx(first_steps.LATER_ITERATIONS / 6)
    assert growth(100, 12) == pytest.approx(1)


def test_only_implicit_steps_of_shells_that_something_holds_grow():
    """What moves freely falls rigidly first."""
    for pin, scheme, grows in ((True, "newmark", True), (False, "newmark", False), (True, "verlet", False)):
        text = HANGING_CLOTH.format(cells=4)
        text = text.replace("step = 4e-3", f'step = 4e-5\nintegrator = "{scheme}"')
        _, _, models, _ = shell_models(text if pin else text[: text.index("pin =")])
        assert (models["cloth"].iterations is not None) == grows


def test_a_dry_run_of_equilibria_counts_the_iterations_of_a_trial(tmp_path, summary, monkeypatch):
    """Once 120 for all: 7.7 s for a plate at rest after 3.3, 2.5 s for a cloth after 8.7."""
    text, scene = HANGING_CLOTH.format(cells=6), tmp_path / "a.toml"
    scene.write_text('[time]\nintegrator = "static"\n' + text[text.index("[[object]]") :])

    def dry_run():
        results = summary("shell-sim", scene, "--dry-run")["results"]
        (row,) = (row for row in results["kernels"] if row["kernel"].endswith(" iteration"))
        return row, results

    monkeypatch.setattr(first_steps, "MAX_TRIAL_SECONDS", 60.0)
    row, results = dry_run()
    assert "assumes" not in row and results["seconds_range"] == pytest.approx(2 * [results["seconds"]])
    monkeypatch.setattr(first_steps, "MAX_TRIAL_SECONDS", 1e-3)
    monkeypatch.setattr(first_steps, "MIN_TRIED_SHARE", 0.0)
    row, results = dry_run()
    low, high = results["seconds_range"]
    assert low < results["seconds"] < high and "iterations to rest" in row["assumes"]
    monkeypatch.setattr(first_steps, "MIN_TRIED_SHARE", 1e3)
    assert dry_run()[0]["times"] == ITERATIONS_TO_REST


def test_divided_first_steps_leave_the_table_in_the_range(monkeypatch):
    """Of a plate that a load makes yield at once: 45 s (27 to 130) were predicted for 6."""
    clock = Clock()
    monkeypatch.setattr(first_steps.time, "process_time", clock.process_time)

    def advance(state, time, dt):
        clock.now += 0.1
        if state < 8 and dt > 0.3:
            raise StepRejected("energy falls")
        return state + 1

    model = Model(0, advance, lambda state: Observation(None), lambda state: {}, lambda arrays: 0)
    job = Job({"a": model}, [], Schedule(1.0, 100), Account(), moving=False)
    by_table = predict([Use("shell-sim implicit step", 100)], InputSize("surface", 2000), calibrate=False)
    trial = first_steps.with_first_steps(by_table, job)
    assert trial.seconds > 2 * by_table.seconds
    assert trial.seconds_range[0] <= by_table.seconds
