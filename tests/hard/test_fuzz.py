"""A fixed budget of mutated inputs of every kind; `make fuzz` runs longer."""

import os
import signal
import time

import pytest

from benchmarks.fuzz import ledger, run, scratch
from benchmarks.fuzz.inputs import Kind, kinds
from ddgcli.errors import DdgError, InputError

FEWER = {"scene": 6, "fluid scene": 6, "vtkhdf": 12, "trajectory": 6, "expression": 300}  # by their cost
NEVER_REFUSED = ("batch.jsonl", "batch.csv")  # a line of an interrupted batch that is damaged is left out
MUTATED_KINDS = [name for name, kind in kinds().items() if kind.random_input is None]


@pytest.mark.parametrize("name", MUTATED_KINDS)
def test_mutated_inputs_end_in_our_own_errors(name):
    account = run.fuzz(kinds()[name], FEWER.get(name, 80), seed=1)
    assert account.escapes == []
    assert account.refused > 0 or name in NEVER_REFUSED


@pytest.mark.parametrize("name", MUTATED_KINDS)
def test_the_inputs_that_are_mutated_are_valid(name):
    kind = kinds()[name]
    with kind.without_guard():
        assert {run.outcome(kind.reader(), data) for data in kind.seeds()} == {("accepted", "")}


def test_a_foreign_exception_a_long_message_and_a_slow_reader_escape(monkeypatch):
    def read(data):
        {1: lambda: data.missing, 2: lambda: long_winded(), 3: lambda: sum(range(10**6))}[len(data)]()

    def long_winded():
        raise InputError("long " * 1000)

    assert run.outcome(read, b"1")[0] == "escape"
    assert run.outcome(read, b"12")[0] == "escape"
    assert run.outcome(read, b"123", cpu_seconds=0.0) == ("escape", "took 0 s")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="limits children as Linux does")
@pytest.mark.parametrize("guarded", [False, True])
def test_a_crash_a_loop_and_a_foreign_exception_in_a_child_are_counted_with_their_inputs(
    monkeypatch, guarded
):
    def read(data):
        if data == b"crash":
            os.kill(os.getpid(), signal.SIGTERM)
        while data == b"loop":
            pass
        if data == b"bug":
            raise KeyError("bug")
        if data == b"bad":
            raise DdgError("bad")

    inputs = [b"good", b"bad", b"crash", b"bug", b"good", b"loop", b"bad"]
    monkeypatch.setattr(run, "input_of", lambda kind, pool, seed, k: inputs[k % len(inputs)])
    monkeypatch.setattr(run, "INPUTS_OF_A_CHILD", len(inputs))
    kind = Kind("any", lambda: [b""], lambda: read, cpu_seconds=0.2, guarded=guarded)
    account = run.fuzz_in_processes(kind, 0.2, seed=0)
    assert account.inputs % len(inputs) == 6  # one loop takes all the time
    assert [message.split(":")[0] for message, _ in account.escapes[:3]] == [
        "the process ended with -15", "KeyError", "took 0 s",
    ]  # fmt: skip
    assert [data for _, data in account.escapes[:3]] == [b"crash", b"bug", b"loop"]


def test_an_interrupted_run_counts_what_it_tried(monkeypatch):
    def read(data):
        while (
            data == b"loop"
        ):  # again: Python drops an exception that is raised in a callback of the collector
            os.kill(os.getppid(), signal.SIGINT)
            time.sleep(0.5)

    monkeypatch.setattr(run, "input_of", lambda kind, pool, seed, k: b"loop" if k == 3 else b"good")
    monkeypatch.setattr(run, "INPUTS_OF_A_CHILD", 3)
    kind = Kind("any", lambda: [b""], lambda: read)
    account = run.fuzz_in_processes(kind, 1000.0, seed=0)
    assert (account.inputs, account.accepted, account.interrupted) == (3, 3, True)


def test_a_trial_leaves_no_folder_behind(monkeypatch, tmp_path):
    """An hour of meshes left thousands in memory: each child has one of its own."""
    monkeypatch.setattr(scratch, "MEMORY", str(tmp_path))
    account = run.fuzz_in_processes(kinds()["array.npy"], 0.5, seed=0)
    assert account.inputs > run.INPUTS_OF_A_CHILD and not any(tmp_path.iterdir())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_right_after_the_fork_leaves_no_child(monkeypatch, number):
    children, fork, handler = [], os.fork, signal.signal(number, signal.default_int_handler)

    def fork_with_interrupt():
        child = fork()
        if child:
            children.append(child)
            os.kill(os.getpid(), number)
        return child

    monkeypatch.setattr(os, "fork", fork_with_interrupt)
    account = run.fuzz_in_processes(
        Kind("any", lambda: [b""], lambda: lambda data: time.sleep(5)), 1e3, seed=0
    )
    signal.signal(number, handler)
    assert account.interrupted and len(children) == 1
    with pytest.raises(ProcessLookupError):
        os.kill(children[0], 0)


def test_stored_runs_add_up_and_take_another_seed_each(monkeypatch, tmp_path):
    monkeypatch.setattr(ledger, "LEDGER", tmp_path / "ledger.json")
    assert ledger.next_seed("ply") == 1
    for seconds in (1.0, 2.5):
        account = run.Account(5, 3, 1, 0.5, seconds, [("KeyError", b"")])
        ledger.add_to_ledger("ply", account)
    assert ledger.next_seed("ply") == 3
    row = ledger.ledger()["ply"]
    assert (row["inputs"], row["escapes"], row["cpu_seconds"]) == (10, 2, 3.5)


def test_an_escape_ends_the_hours_without_one(monkeypatch, tmp_path):
    monkeypatch.setattr(ledger, "LEDGER", tmp_path / "ledger.json")
    hours = []
    for accepted, seconds in ((3, 1.0), (3, 2.5), (2, 4.0), (3, 8.0)):
        ledger.add_to_ledger("ply", run.Account(3, accepted, 0, 0.5, seconds, []))
        hours.append(ledger.ledger()["ply"]["seconds_without_escape"])
    assert hours == [1.0, 3.5, 0.0, 8.0]


def test_the_same_number_gives_the_same_input_and_another_seed_another_one():
    kind = kinds()["npz"]
    pool = run.Pool(kind.seeds())
    assert run.input_of(kind, pool, 1, 5) == run.input_of(kind, pool, 1, 5)
    assert len({run.input_of(kind, pool, seed, 5) for seed in range(9)}) > 5
