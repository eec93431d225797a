"""The table ranks planted candidates where they belong, and keeps its budget."""

import contextlib
import logging
import re
import time
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from ddgcli.cli.commands.tradeoff import row_command
from ddgcli.cli.commands.tradeoff_options import CommandCall
from ddgcli.errors import MeshError, ParameterError, SolveError
from ddgcli.mesh import shapes
from ddgcli.mesh.triangle_mesh import TriangleMesh
from ddgcli.tradeoff.candidates import (
    UNKNOWN,
    Candidate,
    ErrorNorms,
    Problem,
    Reference,
    Row,
    Table,
    relative_to_each,
    relative_to_largest,
    relative_to_rms,
)
from ddgcli.tradeoff.measure import run_problem
from ddgcli.tradeoff.pareto import assign_verdicts, break_even, cheapest_within
from ddgcli.tradeoff.problems import curvature
from ddgcli.tradeoff.report import chart_of, csv_of, results_of
from ddgcli.tradeoff.richardson import richardson_limit
from ddgcli.tradeoff.time_budget import BudgetExceeded, TimeBudget
from ddgcli.tradeoff.truths import SHAPES, ellipsoid, parse_truth

TRUTH = np.linspace(1.0, 2.0, 11)


def planted(name: str, error: float, seconds: float, setup: float = 0.0, work: float = 0.0) -> Candidate:
    """A candidate that sleeps, and errs at entry 3 by `error` of the largest value."""

    def solve(_):
        time.sleep(seconds)
        answer = TRUTH.copy()
        answer[3] += error * TRUTH.max()
        return answer

    return Candidate(name, {}, lambda: time.sleep(setup), solve, {"method": name}, work)


def problem(*candidates: Candidate) -> Problem:
    reference = Reference("the truth", TRUTH, 1e-15, is_truth=True)
    return Problem(candidates, [(0.0, lambda: reference)], relative_to_largest, "the largest value")


def test_planted_candidates_are_ranked_where_they_belong():
    table = run_problem(
        problem(
            planted("rough", 1e-1, 0.001),
            planted("good", 1e-4, 0.01),
            planted("slow", 1e-4, 0.3),
            planted("wrong", 1e-2, 0.3),
        ),
        repeat=2,
    )
    cheapest = assign_verdicts(table, 1e-3)
    rows = {row.method: row for row in table.rows}
    assert {name for name, row in rows.items() if row.on_front} == {"rough", "good"}
    assert cheapest is rows["good"]
    assert rows["wrong"].verdict == "misses 0.001"
    assert rows["slow"].verdict.startswith("beaten by good")
    assert rows["good"].max_error == pytest.approx(1e-4) and rows["good"].max_error_at == 3
    assert rows["good"].mean_error == pytest.approx(1e-4 / 11)
    assert rows["slow"].seconds >= 0.3 > rows["good"].seconds


def test_a_row_whose_answer_is_the_reference_has_its_uncertainty_as_error():
    uncertain = Reference("agreement of two", TRUTH, 0.1, mean_uncertainty=0.02)
    errors = {"near": 0.05, "same": 0.0, "beyond": 0.145, "far": 0.25}
    candidates = [planted(name, e, 0.001 + 0.03 * k) for k, (name, e) in enumerate(errors.items())]
    planted_problem = replace(problem(*candidates), references=[(0.0, lambda: uncertain)])
    table = run_problem(planted_problem, repeat=1)
    rows = {row.method: row for row in table.rows}
    assert [row.is_reference for row in table.rows] == [False, True, False, False]
    same = rows["same"]
    assert (same.max_error, same.mean_error, same.max_error_at) == (0.1, 0.02, None)
    assert assign_verdicts(table, None) is None
    assert same.verdict.endswith("its answer is the reference, and its error the uncertainty")
    assert rows["beyond"].verdict.startswith("no verdict possible")
    assert rows["far"].verdict == "beaten by near"
    rows["near"].max_error = 0.9  # the reference is sure to beat those beyond twice its uncertainty alone
    rows["near"].seconds = 10.0
    assign_verdicts(table, None)
    hidden = "no verdict possible: the uncertainty may hide the difference from same"
    assert rows["beyond"].verdict.startswith(hidden)
    assert rows["far"].verdict == "beaten by same"
    assert assign_verdicts(table, 0.1) is same and assign_verdicts(table, 0.09) is None
    assert same.verdict.startswith("no verdict possible: 0.09")
    known = replace(
        problem(planted("same", 0.0, 0.0)), references=[(0.0, lambda: problem().references[0][1]())]
    )
    assert run_problem(known, repeat=1).rows[0].max_error == 0.0


def test_quadric_fits_have_no_error_of_zero_where_they_are_the_reference():
    sphere = shapes.icosphere(3)
    noise = np.random.default_rng(0).normal(scale=0.003, size=sphere.points.shape)
    mesh = TriangleMesh.from_arrays(sphere.points * (3, 2, 1) + noise, sphere.faces)
    table = run_problem(curvature.problem(mesh), repeat=1)
    for row in table.rows:  # the reference is the fastest row: only errors decide
        row.setup_seconds, row.setup_spread = 0.0, None
        row.seconds = 1.0 if row.is_reference else 2.0
        row.seconds_spread = row.seconds, row.seconds
    assign_verdicts(table, None, "mean")
    doubt = table.reference.error_bound("mean")
    [own] = [row for row in table.rows if row.is_reference]
    assert own.label == "quadric radius=own" and own.mean_error == doubt > 0.05
    beaten = [row for row in table.rows if row.verdict.startswith("beaten by quadric radius=own")]
    assert beaten and all(row.mean_error >= 2 * doubt for row in beaten)
    assert any(doubt < row.mean_error < 2 * doubt for row in table.rows)


@pytest.mark.parametrize(
    "size, reason", [(1.0, "every vertex is on the boundary"), (0.0, "no triangle of any")]
)
def test_meshes_without_a_mean_curvature_are_not_compared(size, reason):
    """All rows had no error and one was on the front; a point was an internal error."""
    square = shapes.grid(3, 1)
    with pytest.raises(MeshError, match=reason):
        curvature.problem(square.moved(size * square.points))


@pytest.mark.parametrize("within", [1e-5, 2e-4, 0.05, 1.0])
@pytest.mark.parametrize("norm", ["max", "mean"])
def test_within_never_names_a_row_above(within, norm):
    table = run_problem(problem(*(planted(f"m{k}", 10.0**-k, 0.001) for k in range(5))), repeat=1)
    cheapest = cheapest_within(table.rows, within, norm)
    assert cheapest is None or cheapest.error(norm) <= within
    assert (cheapest is None) == all(row.error(norm) > within for row in table.rows)


def test_an_answer_that_is_not_finite_is_never_within():
    bad = Candidate("nan", {}, lambda: None, lambda _: np.full(11, np.nan), {}, 0.0)
    table = run_problem(problem(bad), repeat=1)
    assert table.rows == [] and table.left_out == [("nan", "its answer is not finite at vertex 0")]
    assert cheapest_within(table.rows, 1e9) is None


def test_set_up_pays_off_after_the_number_of_queries_that_the_seconds_give():
    table = run_problem(
        problem(planted("direct", 1e-3, 0.02), planted("factored", 1e-3, 0.002, setup=0.05)), repeat=3
    )
    (pair,) = break_even(table.rows)
    assert pair["row"] == "factored" and pair["against"] == "direct"
    assert 2 <= pair["queries"] <= 5


def test_errors_are_relative_to_the_largest_or_rms_truth():
    answer, truth = np.array([1.5, 0.5, -4.4, np.nan, 7.0]), np.array([1.0, 0.0, -4.0, 2.0, np.inf])
    largest, rms = relative_to_largest(answer, truth), relative_to_rms(answer, truth)
    assert largest == pytest.approx([0.125, 0.125, 0.1, np.inf, 0])
    assert rms == pytest.approx(np.array([0.5, 0.5, 0.4, np.inf, 0]) / np.sqrt(21 / 4))
    assert relative_to_each(answer[:4], truth[:4]) == pytest.approx([0.5, 0.5, 0.1, np.inf])


def row(method: str, setup: float, seconds: float, error: float) -> Row:
    return Row(method, {}, setup, seconds, (seconds, seconds), 3, 1.0, error, 0, error, {"method": method})


@pytest.mark.parametrize(
    "direct, factored, queries",
    [
        ((0.0, 3.0, 0.1), (10.0, 1.0, 0.1), 5),  # 10 / (3 - 1)
        ((2.0, 3.0, 0.1), (10.0, 1.0, 0.1), 4),  # its own set-up counts
        ((0.0, 3.0, 0.05), (10.0, 1.0, 0.1), 5),  # a rival may be more accurate,
        ((0.0, 3.0, 0.2), (10.0, 1.0, 0.1), None),  # not less
        ((0.0, 3.0, 0.1), (10.0, 3.0, 0.1), None),  # no query is faster
        ((20.0, 3.0, 0.1), (10.0, 1.0, 0.1), None),  # better in both: no question
        ((0.0, 3.0, 0.1), (0.5, 1.0, 0.1), None),  # a set-up below one query
        ((0.0, 9.0, 0.1), (2.0, 1.0, 0.1), None),  # repaid within one query
    ],
)
def test_break_even_counts_equal_those_computed_by_hand(direct, factored, queries):
    pairs = break_even([row("direct", *direct), row("factored", *factored)])
    expected = {"row": "factored", "against": "direct", "queries": queries}
    assert pairs == ([expected] if queries else [])


def test_an_error_equal_to_the_bound_is_within():
    rows = [row("a", 0.0, 1.0, 0.1), row("b", 0.0, 2.0, 0.05)]
    assert cheapest_within(rows, 0.1) is rows[0] and cheapest_within(rows, 0.099) is rows[1]


def test_rows_below_the_reference_uncertainty_say_so():
    table = Table([row("a", 0.0, 1.0, 0.1), row("b", 0.0, 2.0, 0.05)], Reference("r", TRUTH, 0.05))
    assign_verdicts(table, None)
    assert [r.verdict.endswith("within the error of the reference") for r in table.rows] == [False, True]


def test_a_candidate_estimated_above_the_budget_is_left_out():
    table = run_problem(
        problem(planted("a", 1e-1, 0.01, work=0.01), planted("b", 1e-2, 300.0, work=300.0)), budget=2.0
    )
    assert [row.method for row in table.rows] == ["a"]
    (omission,) = table.left_out
    assert omission[0] == "b" and "estimated" in omission[1]


def busy(_):
    while True:
        pass


@pytest.mark.parametrize("solve", [lambda _: time.sleep(300), busy])
def test_a_run_that_exceeds_the_budget_is_stopped(solve):
    """A slow method whose estimate is far too low would never return."""
    endless = Candidate("endless", {}, lambda: None, solve, {}, 1e-3)
    table = run_problem(problem(planted("a", 0.1, 0.0, work=1e-3), endless), budget=1.0, repeat=1)
    assert [row.method for row in table.rows] == ["a"]
    assert table.left_out[0][0] == "endless" and "stopped after" in table.left_out[0][1]


def test_a_row_that_takes_too_long_leaves_time_to_the_others():
    """The first one took the whole budget, and the table was empty."""
    hogs = [Candidate("hog", {"dt": dt}, lambda: None, busy, {}, 1e-3) for dt in (0.2, 0.1)]
    rows = [planted("a", 0.1, 0.0, work=1e-3), planted("b", 0.1, 0.0, work=1e-3)]
    table = run_problem(problem(hogs[0], rows[0], hogs[1], rows[1]), budget=0.6, repeat=1)
    assert [row.method for row in table.rows] == ["a", "b"]
    first, second = (why for _, why in table.left_out)
    assert 0.1 < float(re.match(r"stopped after ([\d.]+) s", first).group(1)) < 0.4
    assert re.match(r"estimated 0\.[12]\d* s, and may take", second), "as long as the first one"


def test_a_run_may_take_as_long_as_it_is_estimated():
    rows = planted("a", 0.1, 0.15, work=0.15), planted("b", 0.1, 0.0, work=0.3)
    table = run_problem(problem(*rows), budget=0.4, repeat=0)
    assert table.rows[0].method == "a", "longer than a share of the budget"


@pytest.mark.parametrize("inner", [0.01, 10.0])
def test_a_limit_of_time_within_another_one_leaves_it_in_force(inner):
    budget, began = TimeBudget(60.0), time.perf_counter()
    with pytest.raises(BudgetExceeded), budget.limit_time(0.1):
        with contextlib.suppress(BudgetExceeded), budget.limit_time(inner):
            busy(None) if inner < 1 else None
        busy(None)
    assert 0.09 < time.perf_counter() - began < 5.0


def run_with_references(*references, budget):
    one = problem(planted("a", 0.1, 0.001, work=0.001))
    return run_problem(Problem(one.candidates, references, one.error, "it"), budget=budget, repeat=1)


def never():
    raise AssertionError("begun, though it exceeds the budget")


def test_the_best_affordable_reference_is_chosen():
    middle = Reference("middle", TRUTH, 1e-3)
    hung = (1e-3, lambda: time.sleep(300))
    table = run_with_references((1e6, never), hung, (1e-3, lambda: middle), (1e-3, never), budget=1.0)
    assert table.reference is middle
    assert [name for name, _ in table.left_out] == ["a finer reference"] * 2


def test_a_share_of_a_budget_that_is_used_up_is_not_stated_in_seconds():
    budget = TimeBudget(0.5, began=time.perf_counter() - 2.0)
    assert budget.beyond(2.19, 0.5 * budget.seconds_left()).endswith("after the 0.5 s budget was used up")
    assert TimeBudget(9.0).beyond(6.0, 4.5) == "estimated 6 s, and may take 4.5 s of the 9 s budget"


def test_without_an_affordable_reference_nothing_runs():
    with pytest.raises(SolveError, match=r"no reference is affordable.*`budget=\d+` or more"):
        run_with_references((1e6, never), budget=1.0)


def test_a_longer_budget_counts_the_seconds_before_the_reference():
    one = problem(planted("a", 0.1, 0.001, work=0.001))
    for estimate in (0.3, 1e-3):  # too long for what is left, and stopped
        slow = Problem(one.candidates, ((estimate, lambda: time.sleep(300)),), one.error, "it")
        with pytest.raises(SolveError) as error:
            run_problem(slow, budget=1.0, repeat=1, began=time.perf_counter() - 0.8)
        assert int(re.search(r"`budget=(\d+)` or more", str(error.value)).group(1)) > 1


def test_zero_repeats_measure_errors_only():
    (row,) = run_problem(problem(planted("a", 0.1, 0.0)), repeat=0).rows
    assert row.max_error == pytest.approx(0.1) and row.repeats == 0 and np.isnan(row.peak_mib)


def test_verdicts_and_pareto_front_use_the_chosen_norm():
    spiky = planted("spiky", 1e-2, 0.001)  # one entry off by much
    even = Candidate("even", {}, lambda: None, lambda _: TRUTH * 1.005, {}, 0.0)
    table = run_problem(problem(spiky, even), repeat=1)
    for norm, best in (("max", "even"), ("mean", "spiky")):
        assign_verdicts(table, None, norm)
        assert min(table.rows, key=lambda r: r.error(norm)).method == best
        assert {row.method: row.on_front for row in table.rows}[best]


def test_a_failed_candidate_is_left_out_with_its_error():
    def fail(_):
        raise SolveError("did not converge")

    table = run_problem(problem(Candidate("x", {}, lambda: None, fail, {}), planted("a", 0.0, 0.0)), repeat=1)
    assert table.left_out == [("x", "did not converge")]
    assert [row.method for row in table.rows] == ["a"]


def test_an_interrupt_keeps_the_rows_so_far():
    def interrupt(_):
        raise KeyboardInterrupt

    table = run_problem(
        problem(planted("a", 0.0, 0.0), Candidate("b", {}, lambda: None, interrupt, {})), repeat=1
    )
    assert table.interrupted and [row.method for row in table.rows] == ["a"]


def test_peak_memory_of_a_run_is_measured():
    size = 30 * 2**20

    def hungry(_):
        block = np.ones(size // 8)
        return TRUTH + 0 * block[0]

    table = run_problem(problem(Candidate("hungry", {}, lambda: None, hungry, {})), repeat=1)
    assert 25 < table.rows[0].peak_mib < 60


def test_csv_holds_every_row_with_its_command_quoted_for_a_shell():
    table = run_problem(problem(planted("a", 0.1, 0.0), planted("b", 0.0, 0.001)), repeat=1)
    assign_verdicts(table, None)
    results = results_of(
        table,
        problem(),
        partial(row_command, "geodesic", CommandCall("m y.ply", {}, "--source 3")),
        cheapest=None,
        within=None,
        norm="max",
    )
    lines = csv_of(results["rows"]).decode().splitlines()
    assert len(lines) == 3 and lines[0].startswith("method,parameters,setup_seconds")
    assert results["rows"][0]["command"] == "ddgcli geodesic 'm y.ply' --source 3 --method a"


def test_truths_are_checked_against_the_mesh():
    mesh = shapes.icosphere(2)
    assert parse_truth("sphere:1", mesh.points).name == "sphere of radius 1"
    for text in ("sphere:2", "sphere", "sphere:x", "sphere:-1", "cone:1", "torus:1"):
        with pytest.raises(ParameterError, match="text: "):
            parse_truth(text, mesh.points)
    assert set(SHAPES) >= {"sphere", "torus"}


def test_ellipsoid_truth_has_the_sphere_as_its_round_case():
    mesh = shapes.icosphere(1)
    assert ellipsoid(1, 1, 1).mean_curvature(mesh.points) == pytest.approx(1.0)
    pole = np.array([[0.0, 0.0, 2.0]])
    assert ellipsoid(1, 1, 2).mean_curvature(pole) == pytest.approx(2.0)  # principal curvatures c / a^2


def test_rows_that_differ_only_by_clock_noise_are_level():
    def timed(method: str, seconds: float, error: float) -> Row:
        return replace(row(method, 0.0, seconds, error), seconds_spread=(0.9 * seconds, 1.2 * seconds))

    table = Table([timed("a", 1.0, 0.0), timed("b", 1.1, 0.0), timed("c", 2.0, 0.0), timed("d", 1.1, 0.1)])
    assign_verdicts(table, None)
    assert [r.verdict.split(";")[0] for r in table.rows] == [
        "no other beats it", "level with a", "beaten by a", "beaten by a",
    ]  # fmt: skip


def test_warnings_begin_with_the_label_of_their_row(caplog):
    def solve(_):
        logging.getLogger("ddgcli").warning("%d faces are flat", 3)
        return TRUTH

    with caplog.at_level(logging.WARNING, "ddgcli"):
        run_problem(problem(Candidate("heat", {"refine": 3}, lambda: None, solve, {})), repeat=0)
        logging.getLogger("ddgcli").warning("after")
    assert caplog.messages == ["heat refine=3: 3 faces are flat", "after"]


@pytest.mark.parametrize("rate", [0.5, 0.25, 1 / 16])
def test_the_extrapolation_of_a_geometric_sequence_is_its_limit(rate):
    coarse, middle, fine = (TRUTH * (1.0 + rate**k) for k in range(3))
    limit, uncertainty = richardson_limit(coarse, middle, fine)
    np.testing.assert_allclose(limit, TRUTH, rtol=1e-13)
    np.testing.assert_allclose(uncertainty, TRUTH * rate**2, rtol=1e-12)


def test_a_warning_about_the_input_is_not_repeated_for_each_row():
    from ddgcli.cli.messages import MessageHandler
    from ddgcli.tradeoff.measure import _prefix_warnings

    log, handler = logging.getLogger("ddgcli"), MessageHandler(0, False, {})
    log.addHandler(handler)
    try:
        log.warning("the object %s names no material", "hat")
        for label in ("newmark dt=0.1", "verlet dt=0.1"):
            with _prefix_warnings(label):
                log.warning("the object hat names no material")
                log.warning("steps are long")
    finally:
        log.removeHandler(handler)
    assert handler.warnings() == [
        "the object hat names no material",
        "newmark dt=0.1, verlet dt=0.1: steps are long",
    ]


def test_a_line_of_the_plot_joins_rows_that_differ_in_numbers_alone():
    """Two operators at two refinements are two lines of one colour, not a zigzag."""
    planted = [(1.0, "cotan", 0, 4.0), (2.0, "tufted", 0, 2.0), (3.0, "cotan", 1, 1.0)]
    rows = [
        replace(
            row("conformal", 0.0, seconds, error),
            parameters={"operator": name, "subdivide": n},
            on_front=n > 0,
        )
        for seconds, name, n, error in planted
    ]
    rows.insert(1, row("harmonic", 0.0, 1.5, 3.0))
    chart = chart_of(rows, "max", None)
    assert list(chart["series"]) == ["conformal", "harmonic"]
    x, y = chart["series"]["conformal"]
    np.testing.assert_array_equal(y, [4.0, 1.0, np.nan, 2.0])
    np.testing.assert_array_equal(x, [1.0, 3.0, np.nan, 2.0])
    assert chart["labels"]["conformal"] == ["cotan 0", "cotan 1", "", "tufted 0"]
    assert chart["ringed"]["conformal"] == [1]


def test_the_plot_shows_the_errors_of_the_table_with_their_uncertainty():
    bound = ErrorNorms(2e-3, 2e-3)
    near, far = row("a", 0.0, 1.0, 4e-4), row("a", 0.0, 2.0, 5e-3)
    rows = [replace(near, uncertainty=bound, on_front=True), replace(far, uncertainty=bound)]
    chart = chart_of(rows, "max", None)
    assert list(chart["series"]["a"][1]) == [4e-4, 5e-3]
    assert list(chart["bars"]["a"]) == [2e-3, 2e-3]
    assert chart["pareto_front"] is None  # a line of one point has no length
    exact = replace(rows[0], max_error=0.0)
    assert list(chart_of([exact], "max", None)["series"]["a"][1]) == [2e-3]
    unknown = replace(far, uncertainty=UNKNOWN)  # where no limit of fine meshes is known
    assert list(chart_of([near, unknown], "max", None)["bars"]["a"]) == [0.0, 0.0]


def test_what_compiled_code_makes_of_the_end_of_a_budget_counts_as_that_end():
    """Pydantic made an error of its own of it in the first use of a scene: an internal error."""
    with pytest.raises(BudgetExceeded), TimeBudget(1.0).limit_time(0.01):
        try:
            time.sleep(1.0)
        except BudgetExceeded:
            raise ValueError("schema") from None
    with pytest.raises(ValueError, match="schema"), TimeBudget(1.0).limit_time(1.0):
        raise ValueError("schema")
